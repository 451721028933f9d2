/* The driver of internal steps: a step is divided into equal ones, each found by an iteration. What is solved is the
 * stepper's, one for each kind of body: step_plain.c, step_inertial.c, step_free.c and step_tied.c. */
#ifndef FLEX_STEPS_H
#define FLEX_STEPS_H

#include "forces.h"
#include "membrane.h"
#include "tree.h"

/* A step as so many internal steps, and what they came to. */
typedef struct {
    const double *inputs, *inputs_end; /* the latter null for loads held over the step */
    double step;                       /* length of an internal step, s */
    int64_t count;
    double tolerance;
    int64_t rounds, most_rounds;
    double worst;
    int massless; /* 1 where the deformed body's mass was not positive */
    double *astray; /* that of Work */
    /* Rounds of tries before; those from which on a try goes on only where its pace lets it end within most_rounds; the internal
     * step that it has come to. */
    int64_t before, doubtful, reached;
} Substeps;

/* The discrete gradient's bracket is skipped below this part of what it is a difference of: it is round-off there, cubic in
 * the way of a step, and would be divided by its square. */
#define ROUND_OFF (64.0 * 2.220446049250313e-16)

/* How internal steps ended. */
enum { DONE, UNSETTLED, INACCURATE, EXHAUSTED, NO_ROOM };

/* An internal step under way; each stepper's own data begin with it. */
typedef struct {
    Body *body;
    Substeps *all;
    const Rule *rule;
    int64_t number, round;
    Configuration ends[2], middle, *here, *there;
    Stretch stretches[2], *from, *to; /* membrane energy at both ends */
    Loads loads;
    ForceRoom scratch;
    double *v0, *q1, *way;
    double *between; /* (L): loads at a place between */
    double *astray;  /* (3, m): that of the steps, up to here */
    double change;   /* of the last round, relative to the motion */
    double first_change;
    double factor;   /* of the way in the discrete gradient (9) */
    double blur;     /* how much of that factor is uncertain */
} Step;

/* What a round of the iteration says. */
typedef enum { GOING_ON, SETTLED, LOST } Progress;

/* A kind of internal steps. */
typedef struct {
    /* From a state to the first internal step's start. */
    void (*enter)(Step *step, const double *q, const double *v);
    /* What acts over the internal step at hand, and where its iteration begins; 0 where it cannot. */
    int (*begin)(Step *step);
    /* What the guess is off by; 0 where that cannot be found. */
    int (*residual)(Step *step);
    /* Take it out of the guess. */
    Progress (*correct)(Step *step);
    /* The guess becomes the internal step's end; its error. 0 where it has none. */
    int (*accept)(Step *step, double *error);
    /* The end becomes the next one's start. */
    void (*pass)(Step *step);
    void (*leave)(Step *step, double *q, double *v);
} Stepper;

/* A fixed point that has not settled after this many rounds is slow: the step is divided. Newton's method would settle some
 * of these steps, but hardly one of them to the tolerance. */
enum { MOST_ROUNDS = 16 };

/* Multiply-adds of a round: places and their derivatives, curvature, membrane energy, mass or joints. */
double round_cost(const Program *p);

void take_step(const Body *body, Arena *arena, Step *step);
/* All internal steps from a state, overwritten where the answer is DONE. */
int internal_steps(const Stepper *stepper, Step *step, Body *body, Substeps *all, double *q, double *v);

/* Parts of steppers. The configuration of a state, and its rates in v0. */
void enter_state(Step *step, const double *q, const double *v);
/* Ends change places. */
void pass_on(Step *step);
/* Back to a state, whose configuration is remembered. */
void leave_state(Step *step, double *q, double *v);
/* Loads at a place of a step over which they grow, in internal steps. */
void spread_at(Step *step, double place);
/* Modal loads' growth over an internal step on the undeformed body; leaves the loads of one end. */
void spread_growth(Step *step, double *growth);
/* The discrete gradient's factor: what is missing to the work of both ends, over the square of the way. `reach` is what the
 * bracket is a difference of. */
void close_bracket(Step *step, double bracket, double reach, double square);
/* Take from a force (m) what dampers make of rates. */
void subtract_damping(const Body *body, const double *rates, double *force);
/* Whether an iteration has settled whose last change has a square `moved`, of a motion of size `scale`, where a square of
 * `blurred` is uncertain. */
Progress progress_of(Step *step, double moved, double scale, double blurred, double tolerance);
/* Square of the weight that a mode's error has which turns by an angle, rad, in an internal step: one that the step does not
 * resolve follows its force. */
double felt(double turn);
/* What the force's change over the step would do beyond its mean is the leading error. */
double leading_error(const Step *step, const double *first, const double *last, const double *v);
/* Coordinates and rates (m) by which motion is off go on as the modes do, pushed by nothing. */
void carry_astray(const Rule *rule, double *astray, int64_t modes);
/* Add what an internal step does to them: its force goes from `first` to `last`, of which it takes `mean` alone; `grown` (m) is
 * by how much all that acts grows over it. */
void lead_astray(Step *step, const double *first, const double *last, const double *mean, const double *grown);

#endif
