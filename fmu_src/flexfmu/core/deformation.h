/* How far the material of chosen elements turns within its frame, and how much frames are strained: what a body is trusted by.
 * docs/theory.md section 7. */
#ifndef FLEX_DEFORMATION_H
#define FLEX_DEFORMATION_H

#include "data.h"

void take_deformed(const Body *body, Arena *arena, Deformed *deformed);
/* How fast both can grow with the coordinates, once. */
void find_reach(Opened *opened);

/* Angle of each watched rotation within a frame, (turnings), rad; the largest. */
double body_rotations(Body *body, const double *q, double *angles);
/* The largest mean strain of a material in a frame. */
double body_strain(Body *body, const double *q);
/* Whether neither exceeds its limit; costs next to nothing until one nearly does. */
int deforms_within(Body *body, const double *q, double rotation, double strain);

#endif
