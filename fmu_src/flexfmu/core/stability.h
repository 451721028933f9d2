/* How near the critical load a body is, docs/theory.md section 7. */
#ifndef FLEX_STABILITY_H
#define FLEX_STABILITY_H

#include "data.h"

/* Frequency of an unloaded elastic coordinate with which its stiffness is compared: of bodies that stretch, ten times the lowest at
 * the most. */
double unloaded_frequency(const Program *p, int64_t i);
void stability_demand(const Body *body, Arena *arena);

/* Smallest eigenvalue of the tangent over the unloaded one; its shape (m) unless null. */
double body_stability(Body *body, const double *inputs, const double *q, double *shape);
int body_is_stable(Body *body, const double *inputs, const double *q, double margin);
/* Number that the smallest eigenvalue is known to lie above: `margin`, or more; -HUGE_VAL where it may lie below the margin. */
double body_stable_beyond(Body *body, const double *inputs, const double *q, double margin);
/* The same in an arena of stability_demand, by pieces; then, by pieces in the same arena, what comes of a number below the margin. */
double pieces_of_stability(Body *body, const double *inputs, const double *q, double margin, Arena arena, Slice *slice);
void pieces_of_cause(Body *body, const double *inputs, const double *q, Arena arena, Slice *slice);
/* The smallest eigenvalue, and what of it the load takes off that takes most; the mode that its shape is mostly of. */
typedef struct {
    double margin, most;
    int64_t load, mode;
} Cause;
Cause cause_found(const Body *body, const double *inputs, Arena arena);
/* Bound of what loads, or a change of loads, can take off it; HUGE_VAL where nothing but a look tells. */
double body_softening_bound(const Body *body, const double *inputs);
/* Find what that bound is made of, once. */
void find_softening(Body *body);

#endif
