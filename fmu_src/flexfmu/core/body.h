/* A flexible body under one method: equilibrium, steps, motion and what it is watched for. Knows nothing of FMI.
 *
 * The program is constant; a `Body` holds besides it only workspaces and what follows from its options, so that results
 * depend on nothing but arguments. One call at a time may use a Body; different ones are independent. */
#ifndef FLEX_BODY_H
#define FLEX_BODY_H

#include <stdint.h>

#include "program.h"

#if defined(_WIN32)
#define FLEX_EXPORT __declspec(dllexport)
#else
#define FLEX_EXPORT __attribute__((visibility("default")))
#endif

/* Hash of the C files that this was compiled from; empty where the command did not say. */
FLEX_EXPORT const char *core_sources(void);

/* Where all nodes are for one q. Pointers go into a workspace. */
typedef struct {
    double *q;        /* (m) */
    double *straight; /* (6K): the part of b and phi that is linear in q */
    double *bent;     /* (parts, m): coordinates that bend each part */
    double *turned;   /* curvature times these, (r) of each row that is curved: its share of the derivatives */
    double *local;    /* (6K): b of all nodes, then phi */
    double *position; /* (K, 3) */
    double *rotation, *parent, *jacobian; /* (K, 3, 3): R, R of the parent, T(phi) */
} Configuration;

/* Which of a node's offset and rotation a call needs. */
typedef struct {
    unsigned char offset, turn;
} Need;

/* Rows of the operator that one part's coordinates bend, and their curvature as pack_symmetric lays it, rows by the four. */
typedef struct {
    int64_t count, start; /* of rows; where their numbers begin in Configuration.turned */
    const int64_t *row;
    const double *curvature;
} Bend;

/* Loads on the nodes, with what follows from them alone; `f_`: without moments, which have no potential. */
typedef struct {
    double *force, *moment;           /* (K, 3), fixed in direction */
    double *follow;                   /* (I, 6): force and moment in the axes of an interface that they turn with */
    double *constant, *f_constant;    /* (m): modal force on the undeformed body */
    double *geometric, *f_geometric;  /* (m, m): geometric stiffness */
    int active, has_moments;          /* whether the modal force depends on q; whether loads have no potential */
    int following;                    /* whether any load turns with its interface */
} Loads;

/* What all internal steps of one length have in common: the exact propagation of the modes, docs/theory.md section 6. */
typedef struct {
    double step;
    double *p11, *p12, *p21, *p22, *gq, *gv, *ramp, *ramp_rate, *lag; /* (m) */
    double *response; /* (m, m), of a body with ties: B / g_q of (17a) */
} Rule;

enum { RULES = 16, TIED_RULES = 8 };

typedef struct {
    double longest;   /* internal step, s; 0 for none */
    double tolerance; /* error accepted in an internal step, relative, in the energy norm */
    double most;      /* work that one call may take, discarded tries included, in internal steps of ordinary cost */
} StepLimits;

typedef struct {
    int64_t substeps, iterations;
    double error;
} Work;

typedef struct Body {
    Program p;
    double damping_scale;
    StepLimits limits;
    double *stiffness;    /* (m) */
    double *zeta;         /* (m), scaled */
    double *operator_t;   /* (m, 6K): the operator, column by column */
    Bend *bends;          /* (parts) */
    int64_t *bent_row;    /* of all parts in turn */
    double *curvature_t;  /* of all parts, packed */
    double *four;         /* (m, 4): four rows of Configuration.turned in the making */
    int64_t bend_rows;    /* numbers of Configuration.turned */
    int64_t *turned_start; /* (6K): where those of each row begin */
    Need *need;           /* (K): of the step at hand */
    Need *lumped;         /* (K): what inertia needs */
    Configuration memo;   /* of the q last seen: a step begins, and outputs are read, where the step before it ended */
    Need *memo_need;
    int memo_known;
    double *coupled;      /* (m, m): damping between modes of a body with ties */
    double *rate;         /* (m): damping of each mode, 1/s */
    Rule rules[RULES];
    int rule_count, rule_next, rule_limit;
    double *work;         /* of one call */
    int64_t *pivot;       /* (2m) */
    int64_t work_size;
    double *arena;
    int64_t arena_size;   /* numbers */
    void *image;          /* the program's bytes, this body's own copy */
    int64_t image_size;
} Body;

enum {
#define ANSWER(symbol, ...) FLEX_##symbol,
#include "interface.def"
};

/* Make a body of an image, which is copied; null with words in `why` where it cannot be. */
FLEX_EXPORT Body *body_open(const void *image, int64_t size, const char **why);
FLEX_EXPORT void body_close(Body *body);
/* Bytes of the program and of all workspaces: no call takes more. */
FLEX_EXPORT int64_t body_bytes(const Body *body);
/* Options; FLEX_BAD_OPTION where one is out of range. */
FLEX_EXPORT int body_options(Body *body, double damping_scale, const StepLimits *limits);

/* Stable equilibrium q (m) under loads (L); `share` is how much of the load was reached, `rounds` Newton's. */
FLEX_EXPORT int body_static(Body *body, const double *inputs, double *q, double *share, int64_t *rounds);
/* A step from (q, v), overwritten where the answer is FLEX_OK; `inputs_end` null for loads held over the step.
 * `hint` is the number of internal steps to begin with, and the one for the next step. */
FLEX_EXPORT int body_step(Body *body, const double *inputs, const double *inputs_end, double step, double *q, double *v,
              int64_t *hint, Work *work);

/* What a step was refused for, in words. */
FLEX_EXPORT void body_refusal(const Body *body, int answer, double step, const Work *work, char *text, int64_t size);
/* The same of an equilibrium that reached a share of the load. */
FLEX_EXPORT void body_static_refusal(const Body *body, int answer, double share, char *text, int64_t size);

/* Displacement and rotation vector of each interface (I, 2, 3); velocity and spin unless null (v may then be null). */
FLEX_EXPORT void body_motion(Body *body, const double *q, const double *v, double *motion, double *rates);
/* Places (K, 3) and rotations (K, 3, 3) of all nodes. */
FLEX_EXPORT void body_nodes(Body *body, const double *q, double *position, double *rotation);
/* Largest von Mises stress of each set, N/m2. */
FLEX_EXPORT void body_stress(Body *body, const double *q, double *largest);
FLEX_EXPORT void body_energies(Body *body, const double *q, const double *v, double *strain, double *kinetic);
/* Modal force Q(q) and the tangent stiffness (m, m) under loads (L); either may be null. */
FLEX_EXPORT void body_forces(Body *body, const double *inputs, const double *q, double *force, double *tangent);
/* M(q), (m, m). */
FLEX_EXPORT void body_mass(Body *body, const double *q, double *mass);
/* Angle of each watched rotation within a frame, (turnings), rad; the largest. */
FLEX_EXPORT double body_rotations(Body *body, const double *q, double *angles);
/* Smallest eigenvalue of the tangent over the unloaded one; its shape (m) unless null. */
FLEX_EXPORT double body_stability(Body *body, const double *inputs, const double *q, double *shape);
FLEX_EXPORT int body_is_stable(Body *body, const double *inputs, const double *q, double margin);
/* What loads alone take off the stability in a shape. */
FLEX_EXPORT double body_softening(Body *body, const double *inputs, const double *q, const double *shape);
/* Error of deflections from stiffness that the method misses: whether it may exceed a limit; itself; its own margin. */
FLEX_EXPORT int body_may_miss(Body *body, const double *inputs, double limit);
FLEX_EXPORT double body_missed(Body *body, const double *inputs, double *margin);
/* Spin of a body that turns as a whole with constant mass over its lowest elastic frequency; 0 for others. */
FLEX_EXPORT double body_spin(Body *body, const double *q, const double *v);
/* Its angular momentum so far, from rest: impulse of the moments, rotation vector and its derivative where it was last
 * looked at, the largest of impulse and momentum, and by what share of it they differ. Followed to a step's end. */
typedef struct {
    double impulse[3], angle[3], rate[3], largest, drift;
} Momentum;
FLEX_EXPORT void body_momentum(Body *body, const double *q, const double *v, Momentum *so_far);
/* The largest of twice the kinetic energy so far, and of what constant mass leaves out of it. */
typedef struct {
    double kinetic, missed;
} MissedInertia;
FLEX_EXPORT void body_missed_inertia(Body *body, const double *q, const double *v, MissedInertia *so_far);
/* Derivative (6n, 6n) of n interfaces' motion at a step's end by loads on them held over the step, in load order. */
FLEX_EXPORT void body_compliance(Body *body, const double *inputs, double step, const double *q, const int64_t *interfaces,
                     int64_t n, double *out);
/* Change (6I) of the interfaces' displacements and rotation vectors at a step's end with loads that change along
 * `direction` (L), held over the step. */
FLEX_EXPORT void body_derivative(Body *body, const double *inputs, double step, const double *q, const double *direction, double *out);

#endif
