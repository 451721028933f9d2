/* Mass of the deformed body, M(q) (docs/theory.md section 9): of lumps that the frames carry, or a polynomial of them.
 *
 * A lump moves as the point that its centre of mass is; what its matter turns about that point, and is bent within it, goes
 * by its frame. T - |v|²/2 is then
 *
 *     sum over lumps of m |x'|²/2 + sum over frames of (w I w / 2 + w · H v) + v rest v / 2,
 *
 * w being a frame's spin on its own axes; `rest` makes it zero at q = 0. Only the rates of the first coordinates count in
 * it: the mean and the change of what pass_back makes of the lumps' momenta are all that a step needs. Source: J. Wittenburg,
 * Dynamics of Multibody Systems, 2nd ed., chapter 5 (equations of motion of a tree). */
#ifndef FLEX_INERTIA_H
#define FLEX_INERTIA_H

#include "pass_back.h"
#include "polynomial.h"
#include "rates.h"

typedef struct {
    Polynomial polynomial;
    Rates rates;
    Back back;
    BackRate back_rate;
    double *force, *moment, *acceleration, *whirl, *rows;
    double *moved, *turned, *one[3]; /* (S, 3, r) and (3, r) */
} Flow;

void take_flow(const Body *body, Arena *arena, Flow *flow);
/* Loads of the mass beyond that of the undeformed body, (m): (M - 1) v. */
void excess_momentum(const Body *body, const Configuration *at, const double *v, Flow *flow, double *out);
/* Derivative of v M(q) v / 2 by q at a fixed v. */
void kinetic_gradient(const Body *body, const Configuration *at, const double *v, Flow *flow, double *out);
/* d(M v)/dt - d(v M v / 2)/dq - M dv/dt: centrifugal and Coriolis forces with their sign reversed. */
void convective_force(const Body *body, const Configuration *at, const double *v, Flow *flow, double *out);
/* Centre of mass less the first frame's undeformed place. */
void mass_centre(const Body *body, const Configuration *at, double *out);
/* M - 1 of the first coordinates, (r, r). */
void excess_mass(const Body *body, const Configuration *at, Flow *flow, double *out);

#endif
