/* How interfaces answer to loads over a step: docs/theory.md section 7. */
#ifndef FLEX_COMPLIANCE_H
#define FLEX_COMPLIANCE_H

#include "data.h"

void compliance_demand(const Body *body, Arena *arena);
/* Derivative (6n, 6n) of n interfaces' motion at a step's end by loads on them held over the step, in load order. */
int body_compliance(Body *body, const double *inputs, double step, const double *q, const int64_t *interfaces,
                                int64_t n, double *out);
/* Change (6I) of the interfaces' displacements and rotation vectors at a step's end with loads that change along
 * `direction` (L), held over the step. */
int body_derivative(Body *body, const double *inputs, double step, const double *q, const double *direction,
                                double *out);

#endif
