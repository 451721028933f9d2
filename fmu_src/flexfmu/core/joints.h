/* Spring-dampers between interfaces that move and turn far, as energies of six relative coordinates.
 *
 * End a moves by u_a and turns by R_a, end b by u_b and R_b; both lay at the same place. Seen from b, the relative
 * coordinates are e = (R_b' (u_a - u_b), log(R_b' R_a)). The spring has the energy e' K e / 2, the damper the power
 * e_rate' D e_rate, and rates and loads follow from one matrix,
 *
 *     e_rate = B' (v_a, w_a, v_b, w_b),   (f_a, m_a, f_b, m_b) = -B (K e + D e_rate).
 *
 * The axes of K and D, A in rows, turn with b: e and B are taken along A. The ground does not turn. A motion that both ends
 * share leaves e as it is, so forces and moments balance, about any point: b also bears the moment of the force at a. */
#ifndef FLEX_JOINTS_H
#define FLEX_JOINTS_H

#include <stdint.h>

typedef struct {
    int64_t count, ends;               /* springs, and ends between which they are: end number `ends` is the ground */
    const int64_t *a, *b;              /* (count) ends */
    const double *stiffness, *damping; /* (count, 6): N/m, N m/rad; N s/m, N m s/rad; along the axes */
    const double *axes;                /* (count, 3, 3) */
} Joints;

/* e (6) and B (12, 6) along global axes that turn with b, of displacement and rotation vector (6) of the ends, global axes; m, rad. */
void relative_motion(const double *a, const double *b, double *relative, double *matrix);
/* rates (ends, 6): velocity and angular velocity from the motion (ends, 6) now and a step (s) ago. */
void backward_rates(const double *motion, const double *before, double step, double *rates, int64_t ends);
/* loads (ends, 6): forces and moments of all springs on the ends by their motion and rates, N, N m. */
void joint_loads(const Joints *joints, const double *motion, const double *rates, double *loads);
/* tangent (6 ends, 6 ends): derivative of the loads of springs that are kept (count; null: all) with respect to small
 * displacements and turns of the ends; by_motion (ends): by how much an end's rates change with its motion, 1/s. The change
 * of B is left out: it is the loads over the size of the body, against the stiffness. */
void joint_tangent(const Joints *joints, const int64_t *kept, const double *motion, const double *by_motion, double *tangent);
/* Energy e' K e / 2 of all springs, J. */
double joint_energy(const Joints *joints, const double *motion);
/* Energy that the dampers take over a step (s) in which the relative coordinates change evenly, J. */
double joint_losses(const Joints *joints, const double *motion, const double *before, double step);

#endif
