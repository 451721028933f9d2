/* Internal steps of a body that turns freely as a whole (docs/theory.md section 9).
 *
 * The root frame turns by the exponential of the mean spin. With the mean R of its rotations at both ends, for which
 * R1 - R0 = R w^ (w along the spin), momentum moves by the cross product with w: momenta are kept to round-off whatever
 * is left of the iteration's error. Elastic modes follow the rule of step_inertial.c. Sources: J. C. Simo, N. Tarnow,
 * K. K. Wong, Comput. Methods Appl. Mech. Eng. 100 (1992) 63 (momenta); O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449. */
#ifndef FLEX_STEP_FREE_H
#define FLEX_STEP_FREE_H

#include "steps.h"

void free_demand(const Body *body, Arena *arena);
int free_steps(Body *body, Substeps *all, double *q, double *v);

#endif
