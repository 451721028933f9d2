/* Errors of interfaces as shares of how far they are moved and turned. */
#ifndef FLEX_SHARES_H
#define FLEX_SHARES_H

#include "data.h"

/* The largest angle by which interfaces are turned, of their distances and angles (I, 2). */
double largest_turn(const Program *p, const double *by);
/* The deflection of interfaces that are moved and turned by distances and angles (I, 2), of which `largest` is the largest. */
double reach_of(const Program *p, const double *by, double largest);
/* What an error of an angle counts as one of a deflection: half of it over the largest angle or the deflection's. */
double as_moved(const Program *p, double error, double deflection, double angle);
/* The largest error over a deflection, that of angles too; 0 of a body at rest. */
double share_of(const Program *p, const double *error, double deflection, double angle);

#endif
