/* A step of any length: the exact one where nothing depends on q, else as many internal steps as its error asks for. */
#ifndef FLEX_STEPPING_H
#define FLEX_STEPPING_H

#include "data.h"

void step_demand(const Body *body, Arena *arena);
void internal_demand(const Body *body, Arena *arena);

/* Whether no step has an error, whatever the loads. */
int steps_are_exact(const Body *body);
/* A step from (q, v), overwritten where the answer is FLEX_OK; `inputs_end` null for loads held over the step.
 * `hint` is the number of internal steps to begin with, and the one for the next step. */
int body_step(Body *body, const double *inputs, const double *inputs_end, double step, double *q, double *v,
                          int64_t *hint, Work *work);

/* Find what internal steps of a length have in common, before one is taken. */
void foresee_steps(Body *body, double step);
/* Ask for the memory that a step uses. */
void fetch_body(const Body *body);

#endif
