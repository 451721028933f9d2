/* What the files of the core share among themselves. */
#ifndef FLEX_INTERNAL_H
#define FLEX_INTERNAL_H

#include "algebra.h"
#include "body.h"

/* Workspaces are taken from an arena front to back; the same calls with a null arena count what they need. */
typedef struct {
    double *start;
    int64_t used;
} Arena;

double *take(Arena *arena, int64_t count);
static inline int64_t larger(int64_t a, int64_t b) { return a > b ? a : b; }
void take_configuration(const Body *body, Arena *arena, Configuration *at);
void take_loads(const Body *body, Arena *arena, Loads *loads);
Arena work_arena(Body *body);

/* tree.c */
void configure(const Body *body, const double *q, Configuration *at);
/* Null `need`: all. */
void configure_linear(const Body *body, const Need *need, const double *q, Configuration *at);
void configure_places(const Body *body, const Need *need, Configuration *at);
void configure_halfway(const Body *body, const Need *need, const Configuration *a, const Configuration *b, Configuration *at);
int64_t configuration_size(const Body *body);
void copy_configuration(const Body *body, const Configuration *from, Configuration *to);
void find_need(Body *body, const double *inputs, const double *inputs_end);
void remember(Body *body, const Need *need, const Configuration *at);
int recall(const Body *body, const Need *need, const double *q, Configuration *at);
/* The configuration of q, all of it, kept for the next call; it may not be written to. */
const Configuration *whole_configuration(Body *body, const double *q);
/* Loads (K, 3) gathered from the tips to the roots, in place; rows (6K): their components on the parents' axes, T included. */
void gather(const Body *body, const Configuration *at, double *force, double *moment, double *rows);
/* out (count, m) += factors (count, 6K) times the derivatives of b and phi; `scratch` holds (count, parts, m). */
void add_times_derivative(const Body *body, const Configuration *at, const double *factors, int64_t count, double *scratch,
                          double *out);
int64_t pass_back_size(const Body *body);
void pass_back(const Body *body, const Configuration *at, double *force, double *moment, double *scratch, double *out);
void full_operator(const Body *body, const Configuration *at, double *out);
void node_jacobians(const Body *body, const Configuration *at, const double *operator_, double *translation, double *spin);
int64_t load_stiffness_size(const Body *body);
void add_load_stiffness(const Body *body, const Configuration *at, const double *force, const double *moment,
                        const double *operator_, const double *translation, const double *spin, double *scratch,
                        double *out);
/* How all nodes move for rates v of the coordinates. */
typedef struct {
    double *local;           /* (6K): rates of b and phi */
    double *bent, *turned;   /* (parts, m) and (r) of each row that is curved: as of a configuration */
    double *velocity, *spin; /* (K, 3) */
} Rates;
void take_rates(const Body *body, Arena *arena, Rates *rates);
void node_rates(const Body *body, const Need *need, const Configuration *at, const double *v, Rates *rates);
/* `turned`, which the following need. */
void turn_rates(const Body *body, const Need *need, Rates *rates);
/* How velocity and spin (K, 3) change at constant rates v; `acceleration` has room for 9K. */
void node_accelerations(const Body *body, const Need *need, const Configuration *at, const Rates *rates, double *acceleration,
                        double *whirl);
/* out (m) += derivative along the rates of what pass_back makes of loads that stay what they are. */
int64_t pass_back_rate_size(const Body *body);
void pass_back_rate(const Body *body, const Configuration *at, const Rates *rates, double *force, double *moment,
                    double *scratch, double *out);
void row_derivative(const Body *body, const Configuration *at, int64_t row, int64_t count, double *out);

/* forces.c */
void spread(const Body *body, const double *inputs, Loads *loads);
/* Add loads that turn with their interfaces to (K, 3) each. */
void add_followers(const Body *body, const Loads *loads, const Configuration *at, double *force, double *moment);
int64_t modal_force_size(const Body *body);
void modal_force(const Body *body, const Loads *loads, int with_moments, const Configuration *at, const double *tense,
                 double *scratch, double *out);
double force_work(const Body *body, const Loads *loads, const Configuration *at);
int has_potential(const Body *body);
double work_reach(const Body *body, const double *force, int64_t n);
int64_t tangent_size(const Body *body);
/* Lambda - dQ/dq (m, m). */
void tangent_stiffness(const Body *body, const Loads *loads, int with_moments, const Configuration *at,
                       const double *tense, double *scratch, double *out);
double tie_tension(const Body *body, const Configuration *at, double *tense);
void tie_levers(const Body *body, const Configuration *at, int64_t tie, int64_t node, double *out);
int64_t gap_derivative_size(const Body *body);
/* Derivative (T, 4, 3, m) of the springs' stretch. */
void gap_derivative(const Body *body, const Configuration *at, const double *translation, const double *spin, double *out);
/* Tension (T, 4, 3) that springs will have once q has changed by `change`. */
int64_t foreseen_tension_size(const Body *body);
void foreseen_tension(const Body *body, const Configuration *at, const double *change, double *scratch, double *tense);

/* membrane.c */
typedef struct {
    double *slope;        /* (R, m): S_r q */
    double *bent, *whole; /* (R): q.S_r q; sigma_r */
} Stretch;
int64_t stretch_size(const Body *body);
void take_stretch(const Body *body, Arena *arena, Stretch *at);
void stretch_at(const Body *body, const double *q, Stretch *at);
double stretch_energy(const Body *body, const Stretch *at);
/* out -= the discrete gradient of the energy between two places; its derivative where they are one and the same. */
void subtract_stretch_force(const Body *body, const Stretch *a, const Stretch *b, double *out);
void add_stretch_stiffness(const Body *body, const Stretch *at, double *out);

/* propagation.c */
const Rule *rule_of(Body *body, double step);
void take_rules(Body *body, Arena *arena);

/* step_*.c: equal internal steps; DONE, INACCURATE or UNSETTLED. */
enum { DONE = 0, UNSETTLED = 1, INACCURATE = 2, EXHAUSTED = 3 };
typedef struct {
    const double *inputs, *inputs_end;
    double step;
    int64_t count;
    double tolerance;
    int64_t rounds, most_rounds;
    double worst;
} Division;

/* division.c */
typedef struct {
    Configuration first, second, middle;
    Loads loads;
} Ends;
int64_t ends_size(const Body *body);
void take_ends(const Body *body, Arena *arena, Ends *ends);
/* Loads at a place of a division over which they grow, in internal steps; `scratch` has room for the inputs. */
void spread_at(const Body *body, const Division *d, double place, double *scratch, Loads *loads);
/* Modal loads' growth over an internal step on the undeformed body; leaves the loads of one end. */
void spread_growth(const Body *body, const Division *d, Loads *loads, double *growth);

/* The discrete gradient's bracket is skipped below this part of what it is a difference of: it is round-off there, cubic in
 * the way of a step, and would be divided by its square. */
#define ROUND_OFF (64.0 * 2.220446049250313e-16)
/* Part of that bound by which the bracket is uncertain where it is not round-off: no change below what it makes counts. */
#define NOISE (1.0 / 16.0)

int64_t plain_size(const Body *body);
int plain_steps(Body *body, Division *d, double *q, double *v);
int64_t tied_size(const Body *body);
int tied_steps(Body *body, Division *d, double *q, double *v);
int64_t inertial_size(const Body *body);
int inertial_steps(Body *body, Division *d, double *q, double *v);
/* Take what earlier rounds have shown of how errors follow from changes out of the error at hand: `change` (m), an error of
 * the mean, becomes the change to be subtracted. `seen`, 2 (LEARNT_ROUNDS + 1) m numbers, holds pairs: of errors, orthonormal
 * as `size` weighs them, and of the means that made them; the pair in the making comes last, with the error and the mean of
 * the round before. */
enum { LEARNT_ROUNDS = 16 };
void learn(const double *size, const double *mean, int64_t m, int round, int *pairs, double *seen, double *change);
int64_t free_size(const Body *body);
int free_steps(Body *body, Division *d, double *q, double *v);

/* inertia.c */
typedef struct {
    Rates rates;
    double *force, *moment, *acceleration, *whirl, *own, *rows, *scratch;
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

/* ties.c */
typedef struct {
    double *rows, *answer, *hold; /* (n, m) J, (n, m) J B, (n, n) (1 + S J B Jᵀ / 2)⁻¹ S */
    double *square, *strain, *force;
    double *loads, *factors, *bent; /* (6K), (n, 6K), (n, parts, m) */
} Pull;
int64_t pull_size(const Body *body);
void take_pull(const Body *body, Arena *arena, Pull *pull);
int pull_at(const Body *body, const Rule *rule, const Configuration *at, int64_t *pivot, Pull *pull);
void respond(const Body *body, const Rule *rule, Pull *pull, const double *x, const double *way, double *out);

int64_t statics_size(const Body *body);
int64_t watch_size(const Body *body);

#endif
