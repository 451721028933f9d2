/* What tells how far a body is to be trusted: stiffness and inertia that its method misses. docs/theory.md sections 7 and 9. */
#ifndef FLEX_WATCH_H
#define FLEX_WATCH_H

#include <math.h>

#include "data.h"

/* Where a step, s, ends; of 0 s where none was taken yet: in times of the body, and loads as they act on it. Where it began.
 * Whether the step before was the same, and nothing moved in either; whether deformation is known to be far from all limits;
 * whether nothing moves, deforms or is off. */
typedef struct {
    const double *q, *v, *motion, *inputs; /* (m), (m), (6I) and (L) */
    double step;
    const double *q0, *v0; /* (m) */
    int rests, calm, zero;
} StepEnd;

void judgement_demand(const Body *body, Arena *arena);
void inertia_demand(const Body *body, Arena *arena);

/* Error of deflections from stiffness that the method misses: whether it may exceed a limit; itself; its own margin. */
int body_may_miss(Body *body, const double *inputs, double limit);
double body_missed(Body *body, const double *inputs, double *margin);
/* By a bound that costs next to nothing: 0 where it may not; then whether it may, in an arena of judgement_demand, by pieces;
 * then itself in the same arena, and what was found: the error, and whether the true stiffness is stable. */
int body_might_miss(const Body *body, const double *inputs, double limit);
int pieces_of_missing(Body *body, const double *inputs, double limit, Arena arena, Slice *slice);
void pieces_of_missed(Body *body, const double *inputs, Arena arena, Slice *slice);
double missed_found(const Body *body, Arena arena, int *stable);
/* Spin of a body that turns as a whole with constant mass over its lowest elastic frequency; 0 for others. */
double body_spin(Body *body, const double *q, const double *v);
/* Its angular momentum so far, from rest: impulse of the moments, rotation vector and its derivative where it was last
 * looked at, the largest of impulse and momentum, and by what share of it they differ. Followed to a step's end. */
typedef struct {
    double impulse[3], angle[3], rate[3], largest, drift;
} Momentum;
void body_momentum(Body *body, const double *q, const double *v, Momentum *so_far);
/* Add what is a number still: after the shortest steps the longest may lead beyond all numbers. */
static inline void count_in(double *sum, double more) {
    if (isfinite(*sum + more)) *sum += more;
}
/* How far a motion is off by what the mass leaves out, by what steps leave out, and by how soft the body is: seconds so far,
 * integrals of the squares of how far interfaces have moved and were off, m2 s; the error of the motion that follows, rms; the
 * largest of twice the energy of slow motion. */
enum { BY_MASS, BY_STEPS, BY_SOFTNESS, CAUSES };
typedef struct {
    double time, moved, off[CAUSES], error[CAUSES], energy;
} Astray;
/* The error by softness: `softer` than the body for each unit of twice the strain energy. */
void body_off_by_softness(const Body *body, double softer, Astray *so_far);
/* Whether a mode is so slow that what is missed of its stiffness adds up. Stiff ones follow forces, and those of stretch have more
 * energy by themselves than with the stretch. */
static inline int drifts(const Program *p, int64_t mode) { return p->omega[mode] <= 10.0 * p->omega[p->rigid]; }
/* How far modes that are no vibrations of the finite element model have moved and turned interfaces out of phase: seconds so far,
 * the largest squares of both, and of linear displacements and rotations of interfaces; integrals of these; the error of the motion
 * that follows, over the largest motion and over its root mean square, which warnings go by;
 * the square of what that is over, and when it last grew. `ahead` is workspace of m numbers. */
enum { BY_SHIFT, BY_TURN, WAYS };
typedef struct {
    double time, mixed[WAYS], moved[WAYS], whole[WAYS], error, mean, reach, grown;
} Truncation;
void body_truncation(const Body *body, const StepEnd *end, double *ahead, Truncation *so_far);
/* Whether the motion that the error is over grows no more, as far as half of the slowest period tells. */
int truncation_settled(const Body *body, const Truncation *so_far);
/* Whether the mass of steps leaves nothing out. */
int mass_is_exact(const Program *p);
/* `drift` (5, m): how far coordinates and rates are off by the mass, and the momentum that it leaves out, where the step began and
 * ends, then (2, m): how far by a stiffness that is missed whole where twice the strain energy is one;
 * `astray`: those by the steps, where it ends. */
void body_astray(Body *body, const StepEnd *end, double *drift, const double *astray, double *ahead, Astray *so_far);

#endif
