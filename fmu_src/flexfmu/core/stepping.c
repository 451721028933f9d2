#include "stepping.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "propagation.h"
#include "step_free.h"
#include "step_inertial.h"
#include "step_plain.h"
#include "step_tied.h"

/* Rounds of the iteration in an internal step of ordinary cost, and multiply-adds of such a round. */
static const double ORDINARY_ROUNDS = 5.0, ORDINARY_ROUND = 5e4;
/* Numbers that a processor reads from far memory in the time of an internal step, where all that a call may take last two thirds
 * of a second. */
static const double READ = 4e5;
/* Angle by which the slowest mode of a body with ties turns in an internal step at the most, rad: a step that resolves no
 * mode at all has no estimate of its error. */
static const double RESOLVED = 1.5;
/* Numbers of steps above this are all alike. */
static const double UNCOUNTED = 1e15;
/* Steps (s) up to this would vanish when divided; nothing moves in them by more than round-off. */
static const double INDIVISIBLE = 1e-300;
/* Square of coordinates and rates beyond which arithmetic overflows: far beyond anything that a body bears. */
static const double LARGEST_SQUARE = 1e200;
/* Internal steps from which on it is looked at whether more of them can help, and rotation within a frame, rad, of the
 * linear body at the step's end from which on they cannot. */
enum { SUSPECT = 32 };
static const double SENSELESS = 4.0 * 3.141592653589793;

/* How a body takes internal steps. */
typedef struct {
    void (*demand)(const Body *body, Arena *arena);
    int (*steps)(Body *body, Substeps *all, double *q, double *v);
} Kind;

static const Kind *kind_of(const Program *p) {
    static const Kind plain = {plain_demand, plain_steps}, inertial = {inertial_demand, inertial_steps};
    static const Kind turning = {free_demand, free_steps}, tied = {tied_demand, tied_steps};
    return p->tied ? &tied : p->turns ? &turning : p->inertial ? &inertial : &plain;
}

void internal_demand(const Body *body, Arena *arena) { kind_of(body->p)->demand(body, arena); }

/* Loads, and how a step without internal ones takes them; the first of what is taken for any step. */
typedef struct {
    Loads loads;
    double *growth, *mean;
} Exact;

static void take_exact(const Body *body, Arena *arena, Exact *room) {
    take_loads(body, arena, &room->loads);
    room->growth = take(arena, body->p->modes);
    room->mean = take(arena, body->p->modes);
}

typedef struct {
    Configuration at;
    Loads loads;
    ForceRoom scratch;
    double *force, *middle;
} Reach;

static void take_reach(const Body *body, Arena *arena, Reach *room) {
    take_configuration(body, arena, &room->at);
    take_loads(body, arena, &room->loads);
    take_force_room(body, arena, &room->scratch);
    room->force = take(arena, body->p->modes);
    room->middle = take(arena, body->p->loads);
}

void step_demand(const Body *body, Arena *arena) {
    Arena other = *arena;
    Exact exact;
    Reach reach;
    take_exact(body, arena, &exact);
    take_reach(body, &other, &reach);
    arena->used = larger(arena->used, other.used);
}

enum { DIVISIBLE, EXACT, SHORT };

/* Whether a body whose loads do not depend on q needs internal steps. */
static int divides(const Program *p) { return p->inertial || p->turns || (p->dampers && !p->tied); }

int steps_are_exact(const Body *body) { return !divides(body->p) && !body->p->stretches && !forces_depend(body); }

/* A step of any length where no load depends on q: nothing to iterate, nothing to divide. */
static int exact_step(Body *body, const double *inputs, const double *inputs_end, double step, double *q, double *v, double *astray) {
    const int64_t m = body->p->modes;
    Arena arena = work_arena(body);
    Exact room;
    if (divides(body->p)) return DIVISIBLE;
    take_exact(body, &arena, &room);
    if (arena.refused) return SHORT;
    Loads *loads = &room.loads;
    double *growth = room.growth, *mean = room.mean;
    spread(body, inputs, loads);
    if (loads->active) return DIVISIBLE;
    memcpy(mean, loads->constant, (size_t)m * sizeof(double));
    memset(growth, 0, (size_t)m * sizeof(double));
    if (inputs_end) {
        spread(body, inputs_end, loads);
        if (loads->active) return DIVISIBLE;
        for (int64_t j = 0; j < m; j++) {
            growth[j] = loads->constant[j] - mean[j];
            mean[j] += 0.5 * growth[j];
        }
    }
    const Rule *r = rule_of(body, step);
    for (int64_t j = 0; j < m; j++) {
        const double start = q[j];
        q[j] = r->p11[j] * start + r->p12[j] * v[j] + r->gq[j] * mean[j] + r->ramp[j] * growth[j];
        v[j] = r->p21[j] * start + r->p22[j] * v[j] + r->gv[j] * mean[j] + r->ramp_rate[j] * growth[j];
    }
    if (astray && !all_zero(astray, 2 * m)) carry_astray(r, astray, m);
    return EXACT;
}

/* Whether the loads would turn the linear body within a frame beyond all sense: more internal steps are no use then. */
static int beyond_reach(Body *body, const double *inputs, const double *inputs_end, double step, const double *q,
                        const double *v) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    const Rule *r = rule_of(body, step);
    Arena arena = work_arena(body);
    Reach room;
    take_reach(body, &arena, &room);
    if (arena.refused) return 0;
    double *force = room.force;
    for (int64_t i = 0; i < p->loads; i++) room.middle[i] = inputs_end ? 0.5 * (inputs[i] + inputs_end[i]) : inputs[i];
    spread(body, room.middle, &room.loads);
    configure(body, q, &room.at);
    modal_force(body, &room.loads, 1, &room.at, 0, &room.scratch, force);
    for (int64_t j = 0; j < m; j++) force[j] = r->p11[j] * q[j] + r->p12[j] * v[j] + r->gq[j] * force[j];
    for (int64_t i = 0; i < 3 * p->turnings; i++)
        if (!(fabs(dot(p->turning + i * m, force, m)) < SENSELESS)) return 1;
    return 0;
}

/* Rounds that a call may take: those of ordinary steps, and more where they cost less. */
static double most_rounds(const Body *body) {
    return fmin(UNCOUNTED, ORDINARY_ROUNDS * body->limits.most * fmax(1.0, ORDINARY_ROUND / round_cost(body->p)));
}

/* Rounds that are in vain, up to which a step is tried again. Those of bodies of hundreds of modes last as long as what they read. */
static double doubtful_rounds(const Body *body) {
    const Program *p = body->p;
    const double m = (double)p->modes, joints = p->tied ? m * m * (1.0 + (double)p->pulls) : 0.0;
    const double mass = p->inertial || p->turns ? 2.0 * (double)p->mass_forms * (m + (double)(p->mass_squares + p->mass_pairs)) : 0.0;
    return READ * body->limits.most / fmax(1.0, (double)p->bends + (double)p->stretch_numbers + joints + mass);
}

/* Internal steps that a step has at least. */
static double fewest_steps(const Body *body, double step) {
    const double longest = body->limits.longest;
    double fewest = longest > 0.0 ? step / longest * (1.0 - 1e-9) : 1.0;
    /* An error as large as the motion is none that anyone asks for. */
    if (body->p->tied && body->limits.tolerance < 1.0) fewest = fmax(fewest, step * body->p->omega[0] / RESOLVED);
    return fmax(1.0, ceil(fmin(fewest, UNCOUNTED)));
}

/* Internal steps, more of them until their error is small enough; from (q, v) to (q1, v1). */
static int divided_step(Body *body, const double *inputs, const double *inputs_end, double step, const double *q, const double *v,
                        int64_t *hint, Work *work) {
    const size_t size = (size_t)body->p->modes * sizeof(double);
    /* An internal step takes two rounds at least. */
    const double rounds = most_rounds(body), most = fmax(1.0, floor(0.5 * rounds)), least = fewest_steps(body, step);
    work->substeps = (int64_t)least;
    work->iterations = 0;
    if (least > most) return FLEX_TOO_MANY_STEPS;
    const int64_t fewest = (int64_t)least;
    Substeps all = {inputs, inputs_end, 0.0, 0, body->limits.tolerance, 0, (int64_t)rounds, 0.0, 0, work->astray, 0, 0, 0};
    const int64_t usual = larger(fewest, *hint), finer = (double)(usual * work->finer) <= most ? larger(1, work->finer) : 1;
    all.count = usual * finer;
    if ((double)all.count > most) all.count = (int64_t)most;
    all.doubtful = (int64_t)fmin(doubtful_rounds(body), rounds - 1.0);
    int answer = UNSETTLED;
    double vain = 0.0, farthest = 0.0;
    while ((double)all.count <= most && all.rounds < all.most_rounds && vain <= (double)all.doubtful) {
        all.before = all.rounds;
        all.step = step / (double)all.count;
        memcpy(body->scratch.end_q, q, size);
        memcpy(body->scratch.end_v, v, size);
        answer = kind_of(body->p)->steps(body, &all, body->scratch.end_q, body->scratch.end_v);
        if (answer == NO_ROOM) return FLEX_NO_ROOM;
        work->iterations = all.rounds;
        work->substeps = all.count;
        work->error = answer == INACCURATE ? all.worst : HUGE_VAL;
        if (answer == DONE) break;
        /* The nearer than those before a try has come to the end, the likelier is the next one to reach it. */
        const double share = (double)all.reached / (double)all.count, nearer = fmax(0.0, share - farthest) / (1.0 - farthest);
        vain += (double)(all.rounds - all.before) * (1.0 - nearer);
        farthest = fmax(farthest, share);
        all.count *= 2;
        if (all.count >= SUSPECT && all.massless) return FLEX_BEYOND_MASS;
        if (all.count >= SUSPECT && beyond_reach(body, inputs, inputs_end, step, q, v)) return FLEX_NOT_CONVERGED;
    }
    if (answer != DONE) return all.massless ? FLEX_BEYOND_MASS : FLEX_TOO_MUCH_WORK;
    work->error = all.worst;
    /* The error falls with the cube of the internal step: half as many are tried next time only if that would do. */
    const double next = 16.0 * (double)(finer * finer * finer) * all.worst;
    *hint = larger(1, next < all.tolerance && all.count > finer * fewest ? all.count / (2 * finer) : all.count / finer);
    return FLEX_OK;
}

/* A step with its arrays in the body's workspace. */
static int step_in_workspace(Body *body, const double *inputs, const double *inputs_end, double step, double *q, double *v,
                             int64_t *hint, Work *work) {
    const int64_t m = body->p->modes;
    const size_t size = (size_t)m * sizeof(double);
    if (!(isfinite(step) && step > 0.0)) return FLEX_BAD_STEP;
    Work done = {1, 0, 0.0, work->astray, work->finer};
    if (step <= INDIVISIBLE) {
        *work = done;
        return FLEX_OK;
    }
    /* What rests without loads goes on resting. */
    if (*hint == 1 && !(body->limits.longest > 0.0) && !body->p->tied && all_zero(inputs, body->p->loads) &&
        all_zero(inputs_end, body->p->loads) && all_zero(q, m) && all_zero(v, m)) {
        *work = done;
        return FLEX_OK;
    }
    int64_t next = *hint;
    /* A step that fails leaves the state as it was. */
    double *q1 = body->scratch.end_q, *v1 = body->scratch.end_v;
    memcpy(q1, q, size);
    memcpy(v1, v, size);
    const int found = exact_step(body, inputs, inputs_end, step, q1, v1, work->astray);
    if (found == SHORT) return FLEX_NO_ROOM;
    if (found == DIVISIBLE) {
        const int answer = divided_step(body, inputs, inputs_end, step, q, v, &next, work);
        if (answer != FLEX_OK) return answer;
        done = *work;
    }
    /* Not a number compares as false. What is larger would overflow on its way to the outputs. */
    if (!(dot(q1, q1, m) + dot(v1, v1, m) < LARGEST_SQUARE)) return FLEX_NOT_FINITE;
    memcpy(q, q1, size);
    memcpy(v, v1, size);
    *hint = next;
    *work = done;
    return FLEX_OK;
}

void foresee_steps(Body *body, double step) { rule_of(body, step); }

void fetch_body(const Body *body) {
    fetch(body, body->rules);
    fetch(body->deformed.q, body->p->frames ? body->rate + body->p->modes : body->deformed.q + body->p->modes);
}

int body_step(Body *body, const double *inputs, const double *inputs_end, double step, double *q, double *v,
              int64_t *hint, Work *work) {
    double room[ON_STACK];
    const Scratch own = elsewhere(body, room);
    const int answer = step_in_workspace(body, inputs, inputs_end, step, q, v, hint, work);
    put_back(body, &own);
    return answer;
}
