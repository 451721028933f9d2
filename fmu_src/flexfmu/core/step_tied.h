/* Internal steps of a body whose cut parts ties join (docs/theory.md section 10).
 *
 * The modes hold the ties as they pull at q = 0; at turned frames these stiff springs pull in other directions. So only the
 * modes that a step resolves are propagated exactly, the others by the rule of the middle (17), all under the discrete
 * gradient (9) of every force beyond Lambda. Source of (17): J. C. Simo, N. Tarnow, ZAMP 43 (1992) 757. */
#ifndef FLEX_STEP_TIED_H
#define FLEX_STEP_TIED_H

#include "steps.h"

void tied_demand(const Body *body, Arena *arena);
int tied_steps(Body *body, Substeps *all, double *q, double *v);

#endif
