/* What an instance consists of: a body, and all numbers that its future depends on. */
#ifndef FLEX_INSTANCE_DATA_H
#define FLEX_INSTANCE_DATA_H

#include <stddef.h>

#include "body.h"
#include "monitor.h"

/* All that follows is in the order of interface.def. */
enum {
#define ROLE(symbol, ...) ROLE_##symbol,
#include "interface.def"
    ROLES
};
enum { TYPE_REAL, TYPE_INTEGER, TYPE_BOOLEAN, TYPE_STRING };
/* Parameters by index; from P_FIXED on one for each interface that the scene may fix. */
enum {
#define PARAMETER(symbol, ...) P_##symbol,
#define WATCH(symbol, ...) P_##symbol##_LIMIT, P_ON_##symbol,
#include "interface.def"
    P_FIXED
};
enum {
#define START(symbol, ...) START_##symbol,
#include "interface.def"
};
enum {
#define INTERPOLATION(symbol, ...) INTERPOLATION_##symbol,
#include "interface.def"
};
enum {
#define ON_REFUSAL(symbol, ...) ON_REFUSAL_##symbol,
#include "interface.def"
};
enum {
#define DIAGNOSTIC(symbol, ...) D_##symbol,
#include "interface.def"
    DIAGNOSTICS
};
/* Values of status.code. */
enum {
#define STATE(symbol, ...) STATE_##symbol,
#include "interface.def"
};

enum { TEXT_SIZE = 1024 };
typedef enum { ANSWER_OK, ANSWER_REFUSED, ANSWER_FAILED } Answer;

/* What a call has to say: `status` is an FMI status. */
typedef void (*Teller)(void *to, int status, const char *text);

/* REST: nothing moved in the last step; ZERO, known at rest alone: nor does anything deform, or is off; QUIET: and nothing is looked
 * at, so that only counts and times go on, those of the others. */
enum {
    CACHED_MOTION = 1, CACHED_STRESS = 2, CACHED_COMPLIANCE = 4, CACHED_ERROR = 8, CACHED_REST = 16, CACHED_ZERO = 32, CACHED_QUIET = 64,
    CACHED_SEEN = 128, CACHED_MIXED = 256, CACHED_ASTRAY = 512
};

/* What calls overwrite: loads at a step's start and end, (L) like `room`; where it ends, (m) like `shape`; loads that were last looked
 * at, and drift, (L + 5m); where steps have led astray, (3m). */
typedef struct {
    double *start_inputs, *end_inputs, *seen, *astray, *room, *q1, *v1, *shape;
} Overwritten;

/* First what every step takes: of many instances in turn few lines of memory are touched. Numbers lie behind. */
typedef struct {
    Body *described; /* of the method at the start */
    Body *body;      /* of the method chosen, once it is known */
    Body *shadow;    /* what tells its error; null where there is none */
    int64_t modes, loads;
    int cached, changed, rated; /* whether inputs may be others than those before; whether any may have a derivative */
    /* All that the future depends on, one run of numbers from the parameters on. */
    double *parameter, *input, *input_rate, *previous, *single, *q, *v, *seen, *drift, *astray, *states;
    /* What is found when it is asked for. */
    double *motion, *rates;
    Overwritten *over; /* those below, or on the stack in a step */
    Scale scale;   /* of the parameters, where the body is known */
    Pieces pieces; /* of the look under way */
    Overwritten own;
    double *stress, *compliance, *errors, *kept;
    double error, bound; /* over the deflection */
    double *numbers;
    int64_t number_count, parameters, fixable;
    uint64_t owner;  /* what states are known by */
    Teller teller;
    void *told;
    char *folder;
} Instance;

/* Single numbers of the state. */
enum {
    S_LAST_STEP, S_TIME, S_KNOWN, S_RUNNING, S_STATUS, S_HINT, S_MODES, S_SUBSTEPS, S_ITERATIONS, S_ERROR, S_LARGEST, S_BEYOND,
    S_WARNED, S_COURSE = S_WARNED + WATCHES, S_SEEN = S_COURSE + sizeof(Course) / sizeof(double),
    S_LOOKING = S_SEEN + sizeof(ErrorMemory) / sizeof(double), S_COUNT = S_LOOKING + sizeof(Looking) / sizeof(double)
};

/* Of the motion so far: the number at a place of its Course. */
static inline double of_course(const Instance *x, size_t place) { return x->single[S_COURSE + place / sizeof(double)]; }

static inline const Program *description(const Instance *x) { return x->described->p; }

/* Whether body and state are known, so that instance_begin has nothing to do. */
static inline int begun(const Instance *x) { return x->body && x->single[S_KNOWN] != 0.0; }

static inline int runs(const Instance *x) { return x->single[S_RUNNING] != 0.0; }

#endif
