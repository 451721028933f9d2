/* Looks at a body after each step for what it is watched for, and remembers what it has said. */
#ifndef FLEX_MONITOR_H
#define FLEX_MONITOR_H

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

/* What the monitor remembers: all of it is state. */
typedef struct {
    double *inputs;          /* (L): loads for which stability was last looked at */
    double largest;          /* square of the largest loads so far */
    Momentum momentum;
    MissedInertia inertia;
    double warned[WATCHES];  /* once a run, since a body that swings would be told of twice a period */
} Memory;

enum { FINDING_TEXT = 640 };
typedef struct {
    int count;
    OnLimit action[WATCHES];
    char text[WATCHES][FINDING_TEXT];
} Findings;

/* Look at the end of a step, or where none was `stepped` yet, under loads (L); `memory` is changed, as it counts if the step is accepted.
 * `inputs_room` and `shape_room` are workspaces of L and m numbers. */
void look(Body *body, const Watch *watch, const double *q, const double *v, int stepped, const double *inputs, Memory *memory, double *inputs_room,
          double *shape_room, Findings *found);

#endif
