#include "step_plain.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "algebra.h"

/* What may be left of the error of Omega q relative to its size: energy that is not kept adds up. */
static const double TOLERANCE = 1e-14;
/* Change below which the discrete gradient's bracket joins the iteration: its own error is then far below the tolerance. */
static const double SETTLED_ENOUGH = 1e-5;

typedef struct {
    Step step;
    double *free, *first, *last, *force, *bare, *mean, *growth, *off, *speed_mean;
    double start_work, end_work, reach, speed;
    int corrected;
} Plain;

static void take_plain(const Body *body, Arena *arena, Plain *x) {
    double **each[] = {&x->free, &x->first, &x->last, &x->force, &x->bare, &x->mean, &x->growth, &x->off, &x->speed_mean};
    take_step(body, arena, &x->step);
    for (size_t i = 0; i < sizeof each / sizeof *each; i++) *each[i] = take(arena, body->p->modes);
}

static void enter(Step *s, const double *q, const double *v) {
    Plain *x = (Plain *)s;
    /* What loads that grow over a step do beyond their mean: exact on the undeformed body. */
    spread_growth(s, x->growth);
    enter_state(s, q, v);
    stretch_at(s->body, q, s->from);
}

/* Modal force at an end, and the work of the loads there. */
static double end_force(Step *s, const Configuration *at, const Stretch *stretch, const double *rates, double *force) {
    modal_force(s->body, &s->loads, 1, at, 0, &s->scratch, force);
    subtract_stretch_force(s->body, stretch, stretch, force);
    subtract_damping(s->body, rates, force);
    return force_work(s->body, &s->loads, at);
}

static int begin(Step *s) {
    Plain *x = (Plain *)s;
    const int64_t m = s->body->p->modes;
    const Rule *rule = s->rule;
    const double *q = s->here->q;
    if (s->all->inputs_end) spread_at(s, (double)s->number + 0.5);
    if (s->all->inputs_end || s->number == 0) x->start_work = end_force(s, s->here, s->from, s->v0, x->first);
    x->reach = work_reach(s->body, s->loads.force, s->body->p->nodes) + fabs(x->start_work);
    x->speed = norm(s->v0, m);
    for (int64_t j = 0; j < m; j++) {
        x->free[j] = rule->p11[j] * q[j] + rule->p12[j] * s->v0[j];
        s->q1[j] = x->free[j] + rule->gq[j] * x->first[j];
    }
    return 1;
}

static int residual(Step *s) {
    Plain *x = (Plain *)s;
    Body *body = s->body;
    const int64_t m = body->p->modes;
    const Rule *rule = s->rule;
    const double *conservative = x->force;
    double square = 0.0;
    configure_linear(body, body->need, s->q1, s->there);
    configure_halfway(body, body->need, s->here, s->there, &s->middle);
    for (int64_t j = 0; j < m; j++) {
        s->way[j] = s->q1[j] - s->here->q[j];
        square += s->way[j] * s->way[j];
    }
    modal_force(body, &s->loads, 1, &s->middle, 0, &s->scratch, x->force);
    x->corrected = s->change <= SETTLED_ENOUGH;
    if (x->corrected && has_potential(body) && square > 0.0) {
        configure_places(body, body->need, s->there);
        x->end_work = force_work(body, &s->loads, s->there);
        if (s->loads.has_moments) {
            modal_force(body, &s->loads, 0, &s->middle, 0, &s->scratch, x->bare);
            conservative = x->bare;
        }
        close_bracket(s, x->end_work - x->start_work - dot(conservative, s->way, m), x->reach + fabs(x->end_work), square);
    }
    for (int64_t j = 0; j < m; j++) x->mean[j] = x->force[j] + s->factor * s->way[j];
    stretch_at(body, s->q1, s->to);
    subtract_stretch_force(body, s->from, s->to, x->mean);
    for (int64_t j = 0; j < m; j++) x->speed_mean[j] = s->way[j] / s->all->step;
    subtract_damping(body, x->speed_mean, x->mean);
    for (int64_t j = 0; j < m; j++) x->off[j] = s->q1[j] - x->free[j] - rule->gq[j] * x->mean[j];
    return 1;
}

static Progress correct(Step *s) {
    Plain *x = (Plain *)s;
    const Program *p = s->body->p;
    double moved = 0.0, sized = 0.0, blurred = 0.0;
    if (p->dampers) {
        rows_times(s->rule->response, x->off, x->bare, p->modes, p->modes);
        memcpy(x->off, x->bare, (size_t)p->modes * sizeof(double));
    }
    for (int64_t j = 0; j < p->modes; j++) {
        s->q1[j] -= x->off[j];
        const double step = p->weight[j] * x->off[j], reached = p->weight[j] * s->q1[j];
        const double blur = p->weight[j] * s->rule->gq[j] * s->blur * s->way[j];
        moved += step * step;
        sized += reached * reached;
        blurred += blur * blur;
    }
    const Progress progress = progress_of(s, moved, sqrt(sized) + x->speed, blurred, TOLERANCE);
    return progress == SETTLED && !x->corrected ? GOING_ON : progress;
}

static int accept(Step *s, double *error) {
    Plain *x = (Plain *)s;
    Body *body = s->body;
    const Rule *rule = s->rule;
    const double *q = s->here->q;
    for (int64_t j = 0; j < body->p->modes; j++) {
        const double rate = rule->p21[j] * q[j] + rule->p22[j] * s->v0[j] + rule->gv[j] * x->mean[j];
        s->v0[j] = rate + rule->ramp_rate[j] * x->growth[j];
        s->q1[j] += rule->ramp[j] * x->growth[j];
    }
    configure_linear(body, body->need, s->q1, s->there);
    configure_places(body, body->need, s->there);
    stretch_at(body, s->q1, s->to);
    x->end_work = end_force(s, s->there, s->to, s->v0, x->last);
    *error = leading_error(s, x->first, x->last, s->v0);
    for (int64_t j = 0; j < body->p->modes; j++) x->off[j] = x->last[j] - x->first[j];
    lead_astray(s, x->first, x->last, x->mean, x->off);
    return 1;
}

static void pass(Step *s) {
    Plain *x = (Plain *)s;
    double *kept = x->first;
    x->first = x->last;
    x->last = kept;
    x->start_work = x->end_work;
    pass_on(s);
}

void plain_demand(const Body *body, Arena *arena) {
    Plain x;
    take_plain(body, arena, &x);
}

int plain_steps(Body *body, Substeps *all, double *q, double *v) {
    static const Stepper stepper = {enter, begin, residual, correct, accept, pass, leave_state};
    Arena arena = work_arena(body);
    Plain x;
    take_plain(body, &arena, &x);
    if (arena.refused) return NO_ROOM;
    return internal_steps(&stepper, &x.step, body, all, q, v);
}
