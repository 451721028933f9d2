/* Looks that take long, in slices: the error, stability, and stiffness that is missed. */
#ifndef FLEX_LOOKS_H
#define FLEX_LOOKS_H

#include "body.h"

typedef enum {
#define ON_LIMIT(symbol, ...) ON_##symbol,
#include "interface.def"
} OnLimit;
enum {
#define WATCH(symbol, ...) WATCH_##symbol,
#include "interface.def"
    WATCHES
};

typedef struct {
    double limit;
    OnLimit action;
} Watch;

/* Of the error: the largest deflection of the interfaces so far, m; strain energy when it was last looked at, and the largest
 * then; steps since; its largest bound so far; how much softer than the body the shadow was along the slow motion where that
 * had the most energy, over twice of it, and that. */
typedef struct {
    double deflection, energy, largest, steps, bound, softer, softened;
} ErrorMemory;

/* Of the whole motion so far. */
typedef struct {
    Momentum momentum;
    Astray astray;
    Truncation truncation;
    double calm; /* of loads that push a free body together: theirs at a right angle over the least couple they made */
} Course;

/* What takes long is looked at in slices, one a step, at a state that is kept for it. In the meantime another may come to wait: the
 * one with the most energy, or the largest loads. */
enum { LOOK_ERROR, LOOK_STABILITY, LOOK_MISSED, LOOK_CAUSE, LOOK_HOW_MUCH, LOOKS };
/* What follows where a look finds something to tell of. */
enum { FOLLOWING = LOOK_CAUSE - LOOK_STABILITY, WAITING = LOOK_CAUSE, STATES = 1 + WAITING };
typedef struct {
    double under_way, look, otherwise; /* whether one is; which; how it is done again */
    double slices, done;           /* those that it takes, and that were done */
    double deflection, waiting[WAITING], deflections[WAITING]; /* at the state looked at; how much those that wait weigh, 0: none */
} Looking;

/* That its pieces are counted; that the look which it follows has just ended. */
enum { COUNTED = 1, FOLLOWS };
/* What the slices have found so far: of the states that are kept, and no state itself. */
typedef struct {
    Slice slice;
    int begun;     /* 0; or what it is of the look under way */
    double beyond; /* what stability is known to lie above */
    double energy; /* twice that of the body where the last step ended; NaN where nobody asked */
    double slow;   /* by how much longer looks at the error may take than of a small shadow */
    double part;   /* slices that a step does: one for each internal step, less where it takes longer than the last one */
    Arena arena;
    double whole[LOOKS], by_load, eased; /* cost of all pieces of each look; of those of the cause also for each load that acts; of the error where it is eased */
    double *laid_out;             /* (WAITING, LAID_OUT): what the arena of each look begins with */
} Pieces;

/* What the monitor remembers: all of it is state. */
typedef struct {
    double *inputs;          /* (L): loads for which stability was last looked at */
    double *drift;           /* (5, m): of what the mass leaves out, and what it would be by forces that grow as energy does */
    const double *astray;    /* (3, m): of what steps leave out, which they follow themselves */
    double *states;          /* (STATES, m + L): q and loads that are looked at, and of those that wait */
    Looking looking;
    double largest;          /* square of the largest loads so far */
    double beyond;           /* what stability was known to lie above then */
    Course course;
    ErrorMemory error;
    double warned[WATCHES];  /* once a run, since a body that swings would be told of twice a period */
} Memory;

enum { FINDING_TEXT = 640 };
typedef struct {
    int count;
    OnLimit action[WATCHES + 1]; /* stability has two */
    char text[WATCHES + 1][FINDING_TEXT];
} Findings;

/* Material `stiffness` times as stiff as the body's, and denser: loads act on the body by the factors `force` and `acceleration`,
 * and its time runs `pace` times as fast (docs/theory.md section 6). */
typedef struct {
    double stiffness, force, acceleration, pace;
} Scale;

Scale scale_of(double stiffness, double density);
/* Inputs (L) as they act on the body. */
void scale_inputs(const Scale *scale, const Program *program, const double *inputs, double *out);

/* A body with its shadow, or null, and what is looked for; `interval` of steps between looks at the error. `inputs`, `shape` and `errors` are workspaces of L, m and 2I
 * numbers. */
typedef struct {
    Body *body, *shadow;
    Scale scale;
    Watch watch[WATCHES];
    double interval, *inputs, *shape, *errors;
    Pieces *pieces;
} Monitor;

/* The name of an interface; behind these are those of frames, then those of inputs. */
const char *name_of(const Program *p, int64_t index);
/* What was warned of is not said again. */
int silenced(const Watch *watch, double warned);
/* Room for words of what was found, which `warned` remembers; null where it was said before. */
char *add_finding(Findings *found, OnLimit action, double *warned);
/* The interface that has moved farthest, and how far: of a body that can move freely, against the first one. */
double farthest(const Program *p, const double *motion, int64_t *interface);

/* How much softer than the body its shadow is along the slow motion, over twice the energy; 0 as long as no look has met as much
 * as there was at most. */
double softer_at_most(const ErrorMemory *seen, double most);

/* Room that looks take. */
int64_t look_size(const Body *body, const Body *shadow);
/* Count the pieces of all looks, so that no step has to. */
void count_looks(const Monitor *monitor);
/* Energy with which the error is due to be looked at; 0 where it is not. */
double error_due(const Monitor *monitor, const StepEnd *end, Memory *memory);
/* What loads change: whether stability and stiffness that is missed are due to be looked at. */
void loads_due(const Monitor *monitor, const double *inputs, Memory *memory, double *due);
void look_at_once(const Monitor *monitor, int kind, const double *q, const double *inputs, double deflection, Memory *memory,
                  Findings *found);
/* Let a state be looked at, or wait. */
void submit(const Monitor *monitor, int kind, const StepEnd *end, double weight, Memory *memory);
/* The next slice of the look under way; after the last one what it has found is told. */
void go_on(const Monitor *monitor, Memory *memory, Findings *found);
/* All that is still to be looked at, at once. */
void finish_looks(const Monitor *monitor, Memory *memory, Findings *found);

#endif
