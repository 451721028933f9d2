/* Energy of strain of second order that no displacement takes away: docs/theory.md section 4c. */
#ifndef FLEX_MEMBRANE_H
#define FLEX_MEMBRANE_H

#include "data.h"

typedef struct Stretch {
    double *slope;        /* S_r q, of those of a part in its coordinates */
    double *bent, *whole; /* (R): q.S_r q; sigma_r */
    double *own, *sum;    /* (m) each: workspaces, coordinates of a part */
    double *push;         /* (R): factors of slopes */
    double *square, *row; /* (r, r) and (r, m) of the largest part, where the stiffness is wanted */
    /* Another one whose slopes these are, or null; and whether q has moved since, which enters to first order. */
    const struct Stretch *base;
    int moved;
    int third; /* whether what places miss at third order has stiffness, too */
    /* Of steps alone: */
    double *place, *found; /* (m), (2, R): that q, bent and whole there */
    double *turn;          /* what a way does to the slopes in the sum of a force: S_r by its sigma_r, summed, packed */
    double *gap, *way;     /* (m): what q has moved; the same in the coordinates of each set of forms in turn */
} Stretch;

void take_stretch(const Body *body, Arena *arena, Stretch *at);
/* The same with room for the stiffness. */
void take_stretch_stiffness(const Body *body, Arena *arena, Stretch *at);
void stretch_at(const Body *body, const double *q, Stretch *at);
/* The same with room for what `stretch_towards` needs. */
void take_moving_stretch(const Body *body, Arena *arena, Stretch *at);
/* The start of a step, exactly. */
void stretch_from(const Body *body, const double *q, Stretch *from);
/* Its end, in the first round or a later one: to first order about the start, or where it was found exactly in an earlier round, if it
 * is near enough; whether that is as good as round-off. */
int stretch_towards(const Body *body, const Stretch *from, const double *q, int first, Stretch *to);
/* out (m) += a factor times the sum of t eta, (18b). */
void add_along_shapes(const Body *body, const Stretch *at, double factor, double *out);
double stretch_energy(const Body *body, const Stretch *at);
/* out -= the discrete gradient of the energy between two places; its derivative where they are one and the same. */
void subtract_stretch_force(const Body *body, const Stretch *a, const Stretch *b, double *out);
/* out -= the forces at q. What places miss at third order goes by coordinates `left` (m) without what shapes have; `missed` (m) is its. */
void subtract_all_forces(const Body *body, const double *q, Stretch *at, double *left, double *missed, double *out);
/* out (m) += what stretch that does not flatten adds to the stiffness along a direction, as it is now turned: no tension. */
void add_turned_stretch(const Body *body, const Stretch *at, const double *direction, double *out);

/* out (m, m) += what stretch adds to the stiffness; or subtract what its tension does. */
void add_stretch_stiffness(const Body *body, const Stretch *at, double *out);
void subtract_stretch_tension(const Body *body, const Stretch *at, double *out);

#endif
