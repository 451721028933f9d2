/* Equilibrium Lambda q = Q(q) under constant loads, by Newton's method with load increments where it needs them
 * (docs/theory.md section 7). */
#ifndef FLEX_STATICS_H
#define FLEX_STATICS_H

#include "data.h"

void statics_demand(const Body *body, Arena *arena);
/* Whether a tangent (m, m) gives way in no direction: no eigenvalue has lost its positive real part; `factor` is room. */
int stable_tangent(const double *tangent, double *factor, int64_t m, Slice *slice);
/* Stable equilibrium q (m) under loads (L); `share` is how much of the load was reached, `rounds` Newton's. */
int body_static(Body *body, const double *inputs, double *q, double *share, int64_t *rounds);

#endif
