/* Internal steps of a body in one piece with the mass of the undeformed body (docs/theory.md section 6).
 *
 * The modal force is replaced by a mean, the discrete gradient (9) of the loads' work, and each mode is propagated exactly
 * under it: an undamped mode gains exactly the energy that the mean does work. Sources: O. Gonzalez, J. Nonlinear Sci. 6
 * (1996) 449 (discrete gradient); Y.-W. Li, X. Wu, SIAM J. Sci. Comput. 38 (2016) A1876 (in an exponential integrator). */
#ifndef FLEX_STEP_PLAIN_H
#define FLEX_STEP_PLAIN_H

#include "steps.h"

void plain_demand(const Body *body, Arena *arena);
int plain_steps(Body *body, Substeps *all, double *q, double *v);

#endif
