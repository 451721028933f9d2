/* What a body shows: motion of its interfaces and nodes, stress, energies, mass, forces. */
#ifndef FLEX_MOTION_H
#define FLEX_MOTION_H

#include "data.h"

/* Of what is seen after each step; then of any call below. */
void seen_demand(const Body *body, Arena *arena);
void motion_demand(const Body *body, Arena *arena);
void pushes_demand(const Body *body, Arena *arena);

/* Displacement and rotation vector of each interface (I, 2, 3); velocity and spin unless null (v may then be null). */
int body_motion(Body *body, const double *q, const double *v, double *motion, double *rates);
/* Places (K, 3) and rotations (K, 3, 3) of all nodes. */
void body_nodes(Body *body, const double *q, double *position, double *rotation);
/* Largest von Mises stress of each set, N/m2. */
void body_stress(Body *body, const double *q, double *largest);
int body_energies(Body *body, const double *q, const double *v, double *strain, double *kinetic);
/* Modal force Q(q) and the tangent stiffness (m, m) under loads (L); either may be null. */
int body_forces(Body *body, const double *inputs, const double *q, double *force, double *tangent);
/* M(q), (m, m). */
int body_mass(Body *body, const double *q, double *mass);

#endif
