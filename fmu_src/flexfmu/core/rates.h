/* How nodes move for rates v of the coordinates, and what that makes of loads on them. */
#ifndef FLEX_RATES_H
#define FLEX_RATES_H

#include "data.h"

typedef struct {
    double *local;           /* (6K): rates of b and phi */
    double *bent, *turned;   /* (bending, m) and (r) of each row that is curved: as of a configuration */
    double *velocity, *spin; /* (K, 3) */
} Rates;

/* (6K), (6K), (3K) and (bending, m). */
typedef struct {
    double *rows, *change, *about, *bent;
} BackRate;

void take_rates(const Body *body, Arena *arena, Rates *rates);
void node_rates(const Body *body, const Need *need, const Configuration *at, const double *v, Rates *rates);
/* `turned`, the curvature's share in how b' and phi' change as the body moves on, which the following need. */
void turn_rates(const Body *body, const Need *need, Rates *rates);
/* How velocity and spin (K, 3) change at constant rates v; `acceleration` has room for 9K. */
void node_accelerations(const Body *body, const Need *need, const Configuration *at, const Rates *rates, double *acceleration,
                        double *whirl);
void take_back_rate(const Body *body, Arena *arena, BackRate *back);
/* out (m) += derivative along the rates of what pass_back makes of loads that stay what they are. */
void pass_back_rate(const Body *body, const Configuration *at, const Rates *rates, double *force, double *moment,
                    BackRate *back, double *out);

#endif
