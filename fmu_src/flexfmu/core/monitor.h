/* Looks at a body after each step for what it is watched for, and remembers what it has said. */
#ifndef FLEX_MONITOR_H
#define FLEX_MONITOR_H

#include <stddef.h>

#include "looks.h"

/* Beyond these no method means anything; 0 for no bound. */
typedef struct {
    double rotation, displacement; /* rad; over the size of the body */
} Bounds;

/* Whether a step's end is within the bounds; else why not, in `why` (size). */
int within_bounds(Body *body, const Bounds *bounds, const StepEnd *end, char *why, size_t size);
/* Whether the body deforms less than the bounds, and all that has not been warned of yet, allow. */
int deforms_little(const Monitor *monitor, const Bounds *bounds, const double *q, const Memory *memory);
/* Warn of truncation, whether the motion still grows or not. */
void find_truncation(const Monitor *monitor, Memory *memory, Findings *found);
/* Warn of how soft the body is, by what is known of it. */
void find_softness(const Monitor *monitor, Memory *memory, Findings *found);
/* Look at a step's end; `memory` is changed, as it counts if the step is accepted. */
void look(const Monitor *monitor, const StepEnd *end, Memory *memory, Findings *found);

#endif
