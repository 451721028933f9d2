/* How far a body's motion is off, by a shadow: the same body reduced finer (docs/theory.md section 7a). */
#ifndef FLEX_CERTIFICATE_H
#define FLEX_CERTIFICATE_H

#include "data.h"

void certificate_demand(const Body *body, Arena *arena);
/* Whether a program is that of a shadow of the body. */
int is_shadow(const Body *shadow, const Body *body);
/* Errors (I, 2) of displacements, m, and rotations, rad, of the interfaces at q under loads (L). `deflection`, the largest so
 * far, m, is followed; `share` is the largest error over it, `bound` one of it in which is what the shadow does not see: what
 * warnings go by. Where the shadow tells no more than that the motion is wrong, errors are the deflections themselves. */
int body_error(Body *body, Body *shadow, const double *inputs, const double *q, double *error, double *deflection, double *share,
               double *bound);
/* The same in an arena of certificate_demand(shadow), by pieces; what they found. */
void pieces_of_error(Body *body, Body *shadow, const double *inputs, const double *q, Arena arena, Slice *slice);
/* How much softer than the body the shadow is along its slow motion, and twice the strain energy of that. */
double softer_found(const Body *shadow, Arena arena, double *energy);
void error_found(const Body *body, const Body *shadow, Arena arena, double *error, double *deflection, double *share, double *bound);

#endif
