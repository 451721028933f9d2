/* What stands behind a handle of FMI, of either version: the phase it is in, and whom it tells. */
#ifndef FLEX_COMPONENT_H
#define FLEX_COMPONENT_H

#include "fmi2_types.h"
#include "instance.h"

/* States of an instance, as bits, so that a call can name those in which it is allowed. */
typedef enum {
    INSTANTIATED = 1,
    INITIALIZING = 2,
    STEPPING = 4,
    STEP_FAILED = 8,
    TERMINATED = 16,
    FAILED = 32
} Phase;

enum { READABLE = INITIALIZING | STEPPING | STEP_FAILED | TERMINATED | FAILED };
enum { SETTABLE = INSTANTIATED | INITIALIZING | STEPPING | STEP_FAILED };
enum { ANY = 63 };

enum { CATEGORIES = 4 };
extern const char *const CATEGORY[CATEGORIES];
extern const char NO_MODEL_EXCHANGE[];

#define SIGN UINT64_C(0x464C4558464D5532)

typedef struct {
    uint64_t sign;
    Instance *body;
    Phase phase;
    int set_up; /* whether fmi2SetupExperiment was called */
    double stop; /* s: steps end here at the latest, once it is set up: a state may come before */
    int halvings; /* FMI 3.0: how often a refused step is tried at half its length; 0: the master wants whole steps */
    int talkative; /* whether the master asked for the log: else it gets refusals and the first warning of a kind */
    fmi2CallbackFunctions callbacks;
    /* Of an FMI 3.0 handle alone, whose texts are no formats; else null. */
    void (*log)(fmi2ComponentEnvironment, int status, fmi2String category, fmi2String message);
    char *name;
    int logging, logged[CATEGORIES];
    char text[TEXT_SIZE], line[2 * TEXT_SIZE], room[TEXT_SIZE / 4];
    /* Names handed out by fmi2GetString stay until the next call. */
    char *strings;
    /* Room for references of FMI 3.0's arrays, number by number. */
    fmi2ValueReference *numbers;
    size_t number_room;
} Component;

/* A component that tells as `how` does; null, told, where `wrong` is given or there is no body. */
Component *component_open(const Component *how, fmi2String name, const char *wrong, fmi2String guid, fmi2String location, int logging);
void component_close(Component *c);
/* Tell what a run that ends here was still being looked at for, whichever call ends it. */
void run_ends(Component *c);
/* fmi2DoStep, with `halvings` as of instance_step. */
fmi2Status component_step(fmi2Component handle, double time, double step, int *halvings);
/* Tell the master, of a status. */
void tell(void *to, int status, const char *text);
fmi2Status fail(Component *c, const char *text);
/* The component behind a handle if a call is allowed in its phase; else null, told. */
Component *allowed(fmi2Component handle, int phases, const char *call);
/* The same for calls with arrays, none of which may be missing. */
Component *given(Component *c, int whole, const char *call);
/* Whether a reference is that of a variable of a type. */
static inline int of_type(const Program *p, fmi2ValueReference reference, int type) {
    return (int64_t)reference < p->variables && p->variable_type[reference] == type;
}
/* The variable of a reference, checked for its type; -1, told, where there is none. */
int64_t variable_of(Component *c, fmi2ValueReference reference, int type, const char *call);
/* How many references from the first of `count` on follow each other, of variables of a type that are alike; 0, told, where the first
 * is none. */
size_t run_of(Component *c, const fmi2ValueReference references[], size_t count, int type, const char *call);

#endif
