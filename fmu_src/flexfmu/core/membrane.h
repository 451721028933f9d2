/* Energy of strain of second order that no displacement takes away: docs/theory.md section 4c. */
#ifndef FLEX_MEMBRANE_H
#define FLEX_MEMBRANE_H

#include "data.h"

typedef struct {
    double *slope;        /* S_r q, of those of a part in its coordinates */
    double *bent, *whole; /* (R): q.S_r q; sigma_r */
    double *own, *sum;    /* (m) each: workspaces, coordinates of a part */
    double *square, *row; /* (r, r) and (r, m) of the largest part, where the stiffness is wanted */
} Stretch;

void take_stretch(const Body *body, Arena *arena, Stretch *at);
/* The same with room for the stiffness. */
void take_stretch_stiffness(const Body *body, Arena *arena, Stretch *at);
void stretch_at(const Body *body, const double *q, Stretch *at);
/* out (m) += a factor times the sum of t eta, (18b). */
void add_along_shapes(const Body *body, const Stretch *at, double factor, double *out);
double stretch_energy(const Body *body, const Stretch *at);
/* out -= the discrete gradient of the energy between two places; its derivative where they are one and the same. */
void subtract_stretch_force(const Body *body, const Stretch *a, const Stretch *b, double *out);
/* out (m) += what stretch that does not flatten adds to the stiffness along a direction, as it is now turned: no tension. */
void add_turned_stretch(const Body *body, const Stretch *at, const double *direction, double *out);

void add_stretch_stiffness(const Body *body, const Stretch *at, double *out);

#endif
