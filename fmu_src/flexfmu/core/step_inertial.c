#include "step_inertial.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "inertia.h"
#include "learning.h"
#include "propagation.h"

/* What may be left of the error of Omega q and its rate, relative to their size. */
static const double TOLERANCE = 1e-12;
/* Change below which what acts in the middle is left as it is: energy does not depend on it, and the rest far below the
 * error. */
static const double SETTLED_ENOUGH = 1e-6;
/* Angle by which a stiff mode that the step resolves turns in it at the most, rad. */
static const double RESOLVED = 0.75;

typedef struct {
    Step step;
    Flow flow;
    Learning learning;
    Rule own;             /* of the internal step at hand, with the modes' masses in it */
    double *v1, *free_q, *free_v, *first, *last, *force, *mean, *growth, *pushed, *bare, *momentum, *impulse, *gradient, *half, *off;
    double *before, *after; /* (m): accelerations at both ends */
    double *acted, *acts, *acting; /* (m): what loads, membrane energy and a changing mass do at both ends, and in the mean */
    double *trend;        /* (m): change of the force over the internal step before */
    double *excess;       /* (m): what the modes' masses have beyond one, m_j - 1 */
    double *size;         /* (m): what a change of the mean counts */
    double *mass, *chord; /* (r, r), the latter of all modes where these damp each other */
    double start_work, start_energy, load_reach, start_size;
} Inertial;

static void take_inertial(const Body *body, Arena *arena, Inertial *x) {
    const Program *p = body->p;
    const int64_t m = p->modes, r = p->inertial_modes;
    double **each[] = {&x->v1, &x->free_q, &x->free_v, &x->first, &x->last, &x->force, &x->mean, &x->growth, &x->pushed, &x->bare,
                       &x->momentum, &x->impulse, &x->gradient, &x->half, &x->off, &x->before, &x->after, &x->trend, &x->excess,
                       &x->size, &x->acted, &x->acts, &x->acting};
    take_step(body, arena, &x->step);
    take_flow(body, arena, &x->flow);
    take_learning(m, MOST_ROUNDS, arena, &x->learning);
    take_rule(body, arena, &x->own);
    for (size_t i = 0; i < sizeof each / sizeof *each; i++) *each[i] = take(arena, m);
    x->mass = take(arena, r * r);
    x->chord = take(arena, p->dampers ? m * m : r * r);
}

static double resisted(const Body *body, const double *q, const double *v, int64_t j) {
    return body->opened->stiffness[j] * q[j] + body->rate[j] * v[j];
}

/* Accelerations at one end. They start the iteration and tell the error: the mass may be that of a place nearby. 0 where it
 * is none. */
static int accelerate(Inertial *x, const Configuration *at, const double *v, double *acts, double *out) {
    Step *s = &x->step;
    Body *body = s->body;
    const int64_t m = body->p->modes, r = body->p->inertial_modes;
    double *convective = x->off;
    modal_force(body, &s->loads, 1, at, 0, &s->scratch, out);
    stretch_at(body, at->q, s->to);
    subtract_stretch_force(body, s->to, s->to, out);
    kinetic_gradient(body, at, v, &x->flow, acts);
    for (int64_t j = 0; j < m; j++) acts[j] += out[j];
    convective_force(body, at, v, &x->flow, convective);
    for (int64_t j = 0; j < m; j++) out[j] -= resisted(body, at->q, v, j) + convective[j];
    subtract_damping(body, v, out);
    memcpy(x->chord, x->mass, (size_t)(r * r) * sizeof(double));
    for (int64_t j = 0; j < r; j++) x->chord[j * r + j] += 1.0;
    s->all->massless = !(body->p->lumped ? cholesky(x->chord, r, 0) : factor_mass(x->chord, r));
    if (s->all->massless) return 0;
    cholesky_solve(x->chord, out, r);
    return 1;
}

/* All that acts on the modes at one end, inertia included, as their own masses see it: m q'' + 2 Z Omega q' + Lambda q. */
static void end_force(const Inertial *x, const double *q, const double *v, const double *acceleration, double *out) {
    const Body *body = x->step.body;
    for (int64_t j = 0; j < body->p->modes; j++) out[j] = (1.0 + x->excess[j]) * acceleration[j] + resisted(body, q, v, j);
}

/* Each mode goes exactly with the mass that it has, coupled to no other, about where the internal step is half over; 0 where
 * that is none. Lumps leave it at one, and so do stiff ones that follow slow motions: a force that is constant over a step that
 * does not resolve them would set them ringing, the rule of the middle does not. */
static int own_rule(Inertial *x) {
    Step *s = &x->step;
    const Body *body = s->body;
    const Program *p = body->p;
    const Rule *usual = rule_of(s->body, s->all->step), *own = &x->own;
    for (int64_t j = p->slow_modes; j < p->inertial_modes; j++)
        if (p->omega[j] * own->step > RESOLVED) propagate_middle(own, j, body->opened->stiffness[j], body->rate[j]);
    if (p->lumped) return 1;
    for (int64_t j = 0; j < p->modes; j++) x->half[j] = s->here->q[j] + 0.5 * usual->p12[j] * s->v0[j];
    polynomial_diagonal(body, x->half, &x->flow.polynomial, x->excess);
    for (int64_t j = p->slow_modes; j < p->inertial_modes; j++) x->excess[j] = 0.0;
    for (int64_t j = 0; j < p->slow_modes; j++) {
        const double mass = 1.0 + x->excess[j], root = sqrt(fmax(mass, 0.0));
        s->all->massless = !(mass > LEAST_MASS);
        if (s->all->massless) return 0;
        propagate(own, j, p->omega[j] / root, body->zeta[j] / root);
        own->gq[j] /= mass;
        own->gv[j] /= mass;
        own->ramp[j] /= mass;
        own->ramp_rate[j] /= mass;
    }
    return 1;
}

static void enter(Step *s, const double *q, const double *v) {
    Inertial *x = (Inertial *)s;
    const int64_t m = s->body->p->modes;
    const Rule *usual = s->rule;
    const double *from[] = {usual->p11, usual->p12, usual->p21, usual->p22, usual->gq, usual->gv, usual->ramp, usual->ramp_rate};
    double *to[] = {x->own.p11, x->own.p12, x->own.p21, x->own.p22, x->own.gq, x->own.gv, x->own.ramp, x->own.ramp_rate};
    for (size_t i = 0; i < sizeof to / sizeof *to; i++) memcpy(to[i], from[i], (size_t)m * sizeof(double));
    x->own.step = usual->step;
    s->rule = &x->own;
    spread_growth(s, x->growth);
    enter_state(s, q, v);
    stretch_at(s->body, q, s->from);
    excess_mass(s->body, s->here, &x->flow, x->mass);
    excess_momentum(s->body, s->here, s->v0, &x->flow, x->momentum);
    for (int64_t j = 0; j < m; j++) x->excess[j] = x->trend[j] = 0.0;
}

/* Places and rates at the end that follow from the mean. */
static void follow(Inertial *x, int64_t j) {
    Step *s = &x->step;
    s->q1[j] = x->free_q[j] + s->rule->gq[j] * x->mean[j];
    x->v1[j] = x->free_v[j] + s->rule->gv[j] * x->mean[j];
}

static int begin(Step *s) {
    Inertial *x = (Inertial *)s;
    const Program *p = s->body->p;
    const Rule *rule = s->rule;
    const double *q = s->here->q, *v = s->v0;
    if (!own_rule(x)) return 0;
    if (s->all->inputs_end) spread_at(s, (double)s->number + 0.5);
    if ((s->all->inputs_end || s->number == 0) && !accelerate(x, s->here, v, x->acted, x->before)) return 0;
    end_force(x, q, v, x->before, x->first);
    for (int64_t j = 0; j < p->inertial_modes; j++) x->momentum[j] -= x->excess[j] * v[j];
    x->start_work = force_work(s->body, &s->loads, s->here);
    x->start_energy = dot(v, x->momentum, p->inertial_modes);
    x->load_reach = work_reach(s->body, s->loads.force, p->nodes) + fabs(x->start_work);
    /* Of M v^2, not of what it has beyond that of the undeformed body: the lumps' share is a difference. */
    x->start_size = dot(v, v, p->inertial_modes);
    for (int64_t j = 0; j < p->modes; j++) {
        x->free_q[j] = rule->p11[j] * q[j] + rule->p12[j] * v[j] + rule->ramp[j] * x->growth[j];
        x->free_v[j] = rule->p21[j] * q[j] + rule->p22[j] * v[j] + rule->ramp_rate[j] * x->growth[j];
        /* Where the force goes on as it did in the step before, its mean is halfway to the end. */
        x->mean[j] = x->first[j] + (s->all->inputs_end ? 0.0 : 0.5 * x->trend[j]);
        follow(x, j);
        const double reached = p->weight[j] * rule->gq[j];
        x->size[j] = reached * reached + rule->gv[j] * rule->gv[j];
    }
    memset(x->gradient, 0, (size_t)p->modes * sizeof(double));
    return 1;
}

/* The factor c of (15), which makes the work of the mean that of loads less what kinetic energy gains. */
static void find_factor(Inertial *x) {
    Step *s = &x->step;
    const int64_t m = s->body->p->modes, r = s->body->p->inertial_modes;
    const double *v0 = s->v0, *v1 = x->v1, *way = s->way;
    double kinetic = dot(v1, x->impulse, r);
    for (int64_t j = 0; j < r; j++) kinetic += (v1[j] - v0[j]) * x->momentum[j];
    double bracket = dot(x->impulse, way, r) / s->all->step - dot(x->gradient, way, m) - 0.5 * kinetic;
    double reach = x->start_size + dot(v1, v1, r) + fabs(x->start_energy);
    if (has_potential(s->body)) {
        const double *conservative = s->loads.has_moments ? x->bare : x->pushed;
        const double work = force_work(s->body, &s->loads, s->there);
        bracket += work - x->start_work - dot(conservative, way, m);
        reach += x->load_reach + fabs(work);
    }
    close_bracket(s, bracket, reach, dot(way, way, m));
}

static int residual(Step *s) {
    Inertial *x = (Inertial *)s;
    Body *body = s->body;
    const int64_t m = body->p->modes, r = body->p->inertial_modes;
    const double h = s->all->step;
    configure_linear(body, body->need, s->q1, s->there);
    configure_places(body, body->need, s->there);
    for (int64_t j = 0; j < m; j++) s->way[j] = s->q1[j] - s->here->q[j];
    if (s->change > SETTLED_ENOUGH) {
        for (int64_t j = 0; j < m; j++) x->half[j] = 0.5 * (s->v0[j] + x->v1[j]);
        configure_halfway(body, body->need, s->here, s->there, &s->middle);
        kinetic_gradient(body, &s->middle, x->half, &x->flow, x->gradient);
        modal_force(body, &s->loads, 1, &s->middle, 0, &s->scratch, x->pushed);
        if (has_potential(body) && s->loads.has_moments) modal_force(body, &s->loads, 0, &s->middle, 0, &s->scratch, x->bare);
    }
    excess_momentum(body, s->there, x->v1, &x->flow, x->impulse);
    for (int64_t j = 0; j < m; j++) x->impulse[j] -= x->excess[j] * x->v1[j] + x->momentum[j];
    find_factor(x);
    for (int64_t j = 0; j < m; j++) x->acting[j] = x->pushed[j] + x->gradient[j] + s->factor * s->way[j];
    stretch_at(body, s->q1, s->to);
    subtract_stretch_force(body, s->from, s->to, x->acting);
    for (int64_t j = 0; j < m; j++) x->force[j] = x->acting[j] - x->impulse[j] / h;
    for (int64_t j = 0; j < m; j++) x->half[j] = s->way[j] / h;
    subtract_damping(body, x->half, x->force);
    for (int64_t j = 0; j < m; j++) x->off[j] = x->mean[j] - x->force[j];
    if (s->round > 1) return 1;
    /* The mass where the step is foreseen to end. */
    excess_mass(body, s->there, &x->flow, x->mass);
    const int64_t solved = body->p->dampers ? m : r;
    for (int64_t i = 0; i < solved; i++)
        for (int64_t j = 0; j < solved; j++) {
            const double own = i == j ? 1.0 : 0.0, damped = solved > r ? body->coupled[i * m + j] * s->rule->gq[j] : 0.0;
            const double heavy = i < r && j < r ? (x->mass[i * r + j] - own * x->excess[j]) * s->rule->gv[j] : 0.0;
            x->chord[i * solved + j] = own + (heavy + damped) / h;
        }
    return lu_factor(x->chord, body->pivot, solved, 0);
}

static Progress correct(Step *s) {
    Inertial *x = (Inertial *)s;
    const Program *p = s->body->p;
    double moved = 0.0, sized = 0.0, blurred = 0.0;
    lu_solve(x->chord, s->body->pivot, x->off, p->dampers ? p->modes : p->inertial_modes, 1, 0);
    const double left = learn(&x->learning, x->size, x->mean, s->round, x->off);
    for (int64_t j = 0; j < p->modes; j++) {
        const double blur = s->blur * s->way[j];
        x->mean[j] -= x->off[j];
        follow(x, j);
        const double reached = p->weight[j] * s->q1[j];
        moved += x->size[j] * x->off[j] * x->off[j];
        sized += reached * reached + x->v1[j] * x->v1[j];
        blurred += x->size[j] * blur * blur;
    }
    return progress_of(s, fmax(moved, left), sqrt(sized), blurred, TOLERANCE);
}

static int accept(Step *s, double *error) {
    Inertial *x = (Inertial *)s;
    Body *body = s->body;
    configure_linear(body, body->need, s->q1, s->there);
    configure_places(body, body->need, s->there);
    excess_momentum(body, s->there, x->v1, &x->flow, x->momentum);
    if (!accelerate(x, s->there, x->v1, x->acts, x->after)) return 0;
    end_force(x, s->there->q, x->v1, x->after, x->last);
    *error = leading_error(s, x->first, x->last, x->v1);
    for (int64_t j = 0; j < body->p->modes; j++) x->trend[j] = x->last[j] - x->first[j];
    /* Of momenta the mean is exact. */
    lead_astray(s, x->acted, x->acts, x->acting, x->trend);
    return 1;
}

static void pass(Step *s) {
    Inertial *x = (Inertial *)s;
    double *kept = x->before, *rates = s->v0;
    x->before = x->after;
    x->after = kept;
    kept = x->acted;
    x->acted = x->acts;
    x->acts = kept;
    s->v0 = x->v1;
    x->v1 = rates;
    pass_on(s);
}

void inertial_demand(const Body *body, Arena *arena) {
    Inertial x;
    take_inertial(body, arena, &x);
}

int inertial_steps(Body *body, Substeps *all, double *q, double *v) {
    static const Stepper stepper = {enter, begin, residual, correct, accept, pass, leave_state};
    Arena arena = work_arena(body);
    Inertial x;
    take_inertial(body, &arena, &x);
    if (arena.refused) return NO_ROOM;
    return internal_steps(&stepper, &x.step, body, all, q, v);
}
