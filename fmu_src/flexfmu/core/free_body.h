/* A body that turns freely as a whole (docs/theory.md section 9): in the axes of its root frame, which makes the rigid motions
 * alone, mass depends on elastic coordinates only. t: axes about which it turns; e: elastic coordinates. */
#ifndef FLEX_FREE_BODY_H
#define FLEX_FREE_BODY_H

#include "forces.h"
#include "inertia.h"
#include "membrane.h"

/* Mass of turn and elastic coordinates about the centre of mass, and what moves that centre. */
typedef struct {
    double *whole; /* (t + e, t + e) */
    double *shift; /* (3, t + e): velocity of the centre of mass seen from the root, per unit coordinate */
    double centre[3];
} Inertia;

/* One end of an internal step, in the root frame's axes but for `place` and `velocity`, of the centre of mass. */
typedef struct {
    Configuration *at;
    Inertia mass;
    double *z; /* (t + e): turn rates along the axes, elastic velocities */
    double rotation[9], place[3], velocity[3], angle[3];
} End;

typedef struct {
    double *modal, *matrix, *turned, *rates; /* (m, m) and (m) */
    double *followers, *inputs;              /* (2, K, 3) and (L) */
    Flow flow;
    Loads *loads;
    ForceRoom *scratch;
    Stretch *stretch;
} Turning;

int64_t coordinates(const Program *p);
double total_mass(const Program *p);
void take_end(const Body *body, Arena *arena, End *end);
void take_turning(const Body *body, Arena *arena, Turning *room);

/* Rates at an end whose place and mass are known: linear in v. */
void end_rates(const Body *body, const double *v, End *end);
/* From a state to an end. The rotation vector only holds the rotation; rates are those of the root's own axes. */
void enter_end(Body *body, const double *q, const double *v, End *end, Turning *room);
/* And back. */
void leave_end(Body *body, const End *end, double *q, double *v);

/* Modal rates (m) of a body that turns and bends by z and whose root moves by `velocity`, in the root's axes. */
void modal_rates(const Program *p, const double *z, const double *velocity, double *v);
/* Inertia at a configuration whose root is where it was undeformed. */
void inertia_at(const Body *body, const Configuration *at, Turning *room, Inertia *out);
/* out = mass times z, less z itself of the elastic part where `excess`. */
void momentum_of(const Program *p, const Inertia *inertia, const double *z, int excess, double *out);
/* Spin (3) of turn rates along the axes. */
void along_axes(const Program *p, const double *z, double *spin);
/* Momentum along the axes at an internal step's end, (t). */
void end_momentum(const Program *p, const double *turned, const double *start, const double *mean, const double *turning,
                  const double *moment, double h, double *z);
/* The mean R of the rotations at both ends of a turn by h `spin`, the inverse of its transpose, the rotation halfway, and the
 * stretch of w. */
double mean_rotation(const double *start, const double *spin, double h, double *end, double *mean, double *inverse,
                     double *middle);

/* Loads in axes that are turned by `forces` and `moments`, (3, 3) each. */
void spread_turned(const Body *body, const double *inputs, const double *forces, const double *moments, Turning *room);
/* Sum (3) of loads (K, 3). */
void sum_loads(const Program *p, const double *loads, double *sum);
/* All forces of fixed direction, global axes. */
void total_force(const Program *p, const double *inputs, double *sum);
/* Add the force and the moment about the centre of mass of loads that turn with their interfaces, in the root's axes. */
void push_of_followers(const Body *body, const Loads *loads, const Configuration *at, const double *centre, Turning *room,
                       double *total, double *about);
/* Elastic forces (e) of the loads about the centre of mass. */
void elastic_force(const Body *body, const Loads *loads, int with_moments, const Configuration *at, const double *shift,
                   const double *total, Turning *room, double *out);
/* Take off what membrane energy resists between two places, of elastic forces (e). */
void resist(const Body *body, const Stretch *from, const Stretch *to, Turning *room, double *out);
/* Accelerations (t + e) at an end; elastic ones without what stiffness makes of them. */
void accelerations(Body *body, const double *inputs, const End *end, Turning *room, double *out);

#endif
