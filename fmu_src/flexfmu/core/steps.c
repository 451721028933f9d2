#include "steps.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "propagation.h"

/* Part of that bound by which the bracket is uncertain where it is not round-off: no change below what it makes counts. */
static const double NOISE = 1.0 / 16.0;
/* What a round takes beside the work on its arrays, in multiply-adds. */
static const double OVERHEAD = 2000.0;

double round_cost(const Program *p) {
    const double m = (double)p->modes, places = 18.0 * (double)p->nodes * m, bends = 4.0 * (double)p->bends;
    const double stretches = 4.0 * (double)p->stretch_numbers, square = p->inertial || crossed(p) ? 4.0 * m * m : 0.0;
    return OVERHEAD + (p->inertial || p->turns ? 3.0 : 1.0) * (places + bends) + stretches + square;
}

void take_step(const Body *body, Arena *arena, Step *step) {
    const int64_t m = body->p->modes;
    for (int i = 0; i < 2; i++) {
        take_configuration(body, arena, &step->ends[i]);
        (body->p->tied ? take_moving_stretch : take_stretch)(body, arena, &step->stretches[i]);
    }
    take_configuration(body, arena, &step->middle);
    take_loads(body, arena, &step->loads);
    take_force_room(body, arena, &step->scratch);
    step->v0 = take(arena, m);
    step->q1 = take(arena, m);
    step->way = take(arena, m);
    step->between = take(arena, body->p->loads);
    step->astray = take(arena, 3 * m);
}

/* Whether the next internal step may begin. */
static int may_go_on(const Substeps *all) {
    const double own = (double)(all->rounds - all->before);
    if (all->rounds >= all->most_rounds) return 0;
    if (all->rounds <= all->doubtful || all->reached == 0) return 1;
    return (double)all->before + own * (double)all->count / (double)all->reached <= (double)all->most_rounds;
}

int internal_steps(const Stepper *stepper, Step *step, Body *body, Substeps *all, double *q, double *v) {
    step->body = body;
    step->all = all;
    step->rule = rule_of(body, all->step);
    step->here = &step->ends[0];
    step->there = &step->ends[1];
    step->from = &step->stretches[0];
    step->to = &step->stretches[1];
    all->worst = 0.0;
    all->massless = 0;
    const size_t size = (size_t)(3 * body->p->modes) * sizeof(double);
    if (all->astray) memcpy(step->astray, all->astray, size);
    stepper->enter(step, q, v);
    for (step->number = 0; step->number < all->count; step->number++) {
        all->reached = step->number;
        if (!may_go_on(all)) return EXHAUSTED;
        step->change = HUGE_VAL;
        step->factor = step->blur = 0.0;
        if (!stepper->begin(step)) return UNSETTLED;
        Progress progress = GOING_ON;
        for (step->round = 1; progress == GOING_ON; step->round++) {
            if (step->round > MOST_ROUNDS) return UNSETTLED;
            all->rounds++;
            progress = stepper->residual(step) ? stepper->correct(step) : LOST;
        }
        double error;
        if (progress == LOST || !stepper->accept(step, &error)) return UNSETTLED;
        if (!(error <= all->worst)) all->worst = error;
        if (!(all->worst <= all->tolerance)) return INACCURATE;
        stepper->pass(step);
    }
    stepper->leave(step, q, v);
    if (all->astray) memcpy(all->astray, step->astray, size);
    return DONE;
}

void enter_state(Step *s, const double *q, const double *v) {
    Body *body = s->body;
    memcpy(s->v0, v, (size_t)body->p->modes * sizeof(double));
    find_need(body, s->all->inputs, s->all->inputs_end);
    if (!recall(body, body->need, q, s->here)) {
        configure_linear(body, body->need, q, s->here);
        configure_places(body, body->need, s->here);
    }
}

void pass_on(Step *s) {
    Configuration *passed = s->here;
    Stretch *left = s->from;
    s->here = s->there;
    s->there = passed;
    s->from = s->to;
    s->to = left;
}

void leave_state(Step *s, double *q, double *v) {
    const size_t size = (size_t)s->body->p->modes * sizeof(double);
    remember(s->body, s->body->need, s->here);
    memcpy(q, s->here->q, size);
    memcpy(v, s->v0, size);
}

void spread_at(Step *s, double place) {
    const Substeps *all = s->all;
    const double share = place / (double)all->count;
    for (int64_t i = 0; i < s->body->p->loads; i++)
        s->between[i] = all->inputs[i] + share * (all->inputs_end[i] - all->inputs[i]);
    spread(s->body, s->between, &s->loads);
}

void spread_growth(Step *s, double *growth) {
    const Substeps *all = s->all;
    const Loads *loads = &s->loads;
    const int64_t m = s->body->p->modes;
    for (int64_t j = 0; j < m; j++) growth[j] = 0.0;
    spread(s->body, all->inputs, &s->loads);
    if (!all->inputs_end) return;
    for (int64_t j = 0; j < m; j++) growth[j] = -loads->constant[j] / (double)all->count;
    spread(s->body, all->inputs_end, &s->loads);
    for (int64_t j = 0; j < m; j++) growth[j] += loads->constant[j] / (double)all->count;
}

void close_bracket(Step *s, double bracket, double reach, double square) {
    const double round_off = ROUND_OFF * reach;
    s->factor = square > 0.0 && fabs(bracket) > round_off ? bracket / square : 0.0;
    s->blur = s->factor != 0.0 ? NOISE * round_off / square : 0.0;
}

void subtract_damping(const Body *body, const double *rates, double *force) {
    const int64_t m = body->p->modes;
    for (int64_t j = 0; body->p->dampers && j < m; j++) force[j] -= dot(body->coupled + j * m, rates, m);
}

Progress progress_of(Step *s, double moved, double scale, double blurred, double tolerance) {
    const double before = s->change, size = scale > 0.0 ? sqrt(moved) / scale : 0.0;
    if (!isfinite(size)) return LOST;
    const double enough = fmax(tolerance * scale, sqrt(blurred));
    /* What is left of the error is the change times the rate at which changes fall: of this round and, lest it was a lucky
     * one, of all. */
    const double rate = s->round > 1 && size < before ? size / before : 1.0;
    if (s->round <= 1) s->first_change = size;
    s->change = size;
    if (size * rate * scale > enough) return GOING_ON;
    if (s->round <= 2 || size >= s->first_change || size * scale <= enough) return SETTLED;
    /* The mean rate is the root of size / first_change: both are compared by their powers. */
    double most = s->first_change;
    for (int64_t i = 1; i < s->round; i++) most *= enough / (size * scale);
    return size <= most ? SETTLED : GOING_ON;
}

double felt(double turn) { return turn > 1.0 ? 1.0 / (turn * turn) : 1.0; }

double leading_error(const Step *s, const double *first, const double *last, const double *v) {
    const Program *p = s->body->p;
    double error = 0.0, energy = 0.0;
    for (int64_t j = 0; j < p->modes; j++) {
        const double lost = p->weight[j] * s->rule->ramp[j] * (last[j] - first[j]), strained = p->omega[j] * s->q1[j];
        /* Those that lumps couple ring, unless they are resolved where the slowest is. */
        const int rings = p->lumped && j < p->slow_modes && p->omega[p->rigid] * s->all->step <= 1.0;
        error += (rings ? 1.0 : felt(p->omega[j] * s->all->step)) * lost * lost;
        energy += strained * strained + v[j] * v[j];
    }
    return energy > 0.0 ? sqrt(error / energy) : 0.0;
}

void carry_astray(const Rule *r, double *astray, int64_t modes) {
    double *off = astray, *rate = astray + modes;
    for (int64_t j = 0; j < modes; j++) {
        const double was = off[j];
        off[j] = r->p11[j] * was + r->p12[j] * rate[j];
        rate[j] = r->p21[j] * was + r->p22[j] * rate[j];
    }
}

void lead_astray(Step *s, const double *first, const double *last, const double *mean, const double *grown) {
    const int64_t m = s->body->p->modes;
    const Rule *r = s->rule;
    double *off = s->astray, *rate = off + m, *trend = rate + m;
    if (!s->all->astray) return;
    carry_astray(r, s->astray, m);
    for (int64_t j = 0; j < m; j++) {
        /* A parabola through what acts at both ends and, by its trend, before tells the mean that the force truly has. */
        const double change = last[j] - first[j], curved = change - trend[j] * s->all->step;
        const double missed = 0.5 * (first[j] + last[j]) - curved / 12.0 - mean[j];
        off[j] += r->gq[j] * missed + r->ramp[j] * grown[j];
        rate[j] += r->gv[j] * missed + r->ramp_rate[j] * grown[j];
        trend[j] = change / s->all->step;
    }
}
