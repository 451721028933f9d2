/* Internal steps of a body in one piece with the mass of the undeformed body (docs/theory.md section 6).
 *
 * The modal force is replaced by a mean, the discrete gradient (9) of the loads' work, and each mode is propagated exactly
 * under it: an undamped mode gains exactly the energy that the mean does work. Sources: O. Gonzalez, J. Nonlinear Sci. 6
 * (1996) 449 (discrete gradient); Y.-W. Li, X. Wu, SIAM J. Sci. Comput. 38 (2016) A1876 (in an exponential integrator). */
#include <math.h>
#include <string.h>

#include "internal.h"

/* What may be left of the error of Omega q relative to its size: energy that is not kept adds up. */
static const double TOLERANCE = 1e-14;
/* Change below which the discrete gradient's bracket joins the iteration: its own error is then far below the tolerance. */
static const double SETTLED = 1e-5;
/* A fixed point that has not settled after this many rounds is slow: the step is divided. Newton's method would settle some
 * of these steps, but hardly one of them to the tolerance. */
enum { MOST_ROUNDS = 16 };

int64_t plain_size(const Body *body) {
    const int64_t m = body->p.modes;
    return ends_size(body) + 2 * stretch_size(body) + 11 * m + body->p.loads + modal_force_size(body);
}

int plain_steps(Body *body, Division *d, double *q, double *v) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    const int potential = has_potential(body);
    Arena arena = work_arena(body);
    Ends ends;
    take_ends(body, &arena, &ends);
    Configuration *here = &ends.first, *there = &ends.second, *middle = &ends.middle;
    Loads *loads = &ends.loads;
    Stretch first, last, *stretched = &first, *stretch = &last;
    take_stretch(body, &arena, stretched);
    take_stretch(body, &arena, stretch);
    double *v0 = take(&arena, m), *q1 = take(&arena, m), *free = take(&arena, m), *start = take(&arena, m);
    double *end = take(&arena, m), *force = take(&arena, m), *mean = take(&arena, m), *way = take(&arena, m);
    double *bare = take(&arena, m), *growth = take(&arena, m), *change = take(&arena, m);
    double *between = take(&arena, p->loads), *scratch = take(&arena, modal_force_size(body));
    const Rule *rule = rule_of(body, d->step);
    double start_work = 0.0, end_work = 0.0;

    d->worst = 0.0;
    /* What loads that grow over a step do beyond their mean: exact on the undeformed body. */
    spread_growth(body, d, loads, growth);
    memcpy(v0, v, (size_t)m * sizeof(double));
    find_need(body, d->inputs, d->inputs_end);
    const Need *need = body->need;
    if (!recall(body, need, q, here)) {
        configure_linear(body, need, q, here);
        configure_places(body, need, here);
    }
    stretch_at(body, q, stretched);
    for (int64_t number = 0; number < d->count; number++) {
        if (d->rounds >= d->most_rounds) return EXHAUSTED;
        if (d->inputs_end) spread_at(body, d, (double)number + 0.5, between, loads);
        if (d->inputs_end || number == 0) {
            modal_force(body, loads, 1, here, 0, scratch, start);
            subtract_stretch_force(body, stretched, stretched, start);
            start_work = force_work(body, loads, here);
        }
        const double reach = work_reach(body, loads->force, p->nodes) + fabs(start_work), speed = norm(v0, m);
        for (int64_t j = 0; j < m; j++) {
            free[j] = rule->p11[j] * here->q[j] + rule->p12[j] * v0[j];
            q1[j] = free[j] + rule->gq[j] * start[j];
        }
        double size = HUGE_VAL, before = HUGE_VAL, correction = 0.0, uncertain = 0.0;
        int settled = 0;
        for (int round = 1; !settled; round++) {
            if (round > MOST_ROUNDS) return UNSETTLED;
            d->rounds++;
            double square = 0.0;
            configure_linear(body, need, q1, there);
            configure_halfway(body, need, here, there, middle);
            for (int64_t j = 0; j < m; j++) {
                way[j] = q1[j] - here->q[j];
                square += way[j] * way[j];
            }
            modal_force(body, loads, 1, middle, 0, scratch, force);
            const int corrected = size <= SETTLED;
            if (corrected && potential && square > 0.0) {
                const double *conservative = force;
                configure_places(body, need, there);
                end_work = force_work(body, loads, there);
                if (loads->has_moments) {
                    modal_force(body, loads, 0, middle, 0, scratch, bare);
                    conservative = bare;
                }
                const double bracket = end_work - start_work - dot(conservative, way, m);
                const double round_off = ROUND_OFF * (reach + fabs(end_work));
                correction = fabs(bracket) > round_off ? bracket / square : 0.0;
                uncertain = correction != 0.0 ? NOISE * round_off / square : 0.0;
            }
            for (int64_t j = 0; j < m; j++) mean[j] = force[j] + correction * way[j];
            stretch_at(body, q1, stretch);
            subtract_stretch_force(body, stretched, stretch, mean);
            for (int64_t j = 0; j < m; j++) {
                change[j] = q1[j] - free[j] - rule->gq[j] * mean[j];
            }
            double moved = 0.0, sized = 0.0, blurred = 0.0;
            for (int64_t j = 0; j < m; j++) {
                q1[j] -= change[j];
                const double step = p->weight[j] * change[j], reached = p->weight[j] * q1[j];
                const double blur = p->weight[j] * rule->gq[j] * uncertain * way[j];
                moved += step * step;
                sized += reached * reached;
                blurred += blur * blur;
            }
            const double scale = sqrt(sized) + speed;
            size = scale > 0.0 ? sqrt(moved) / scale : 0.0;
            if (!isfinite(size)) return UNSETTLED;
            /* What is left of the error is the change times the rate at which changes fall. */
            const double rate = size < before ? size / before : 1.0;
            settled = corrected && size * rate * scale <= fmax(TOLERANCE * scale, sqrt(blurred));
            before = size;
        }
        for (int64_t j = 0; j < m; j++) {
            const double rate = rule->p21[j] * here->q[j] + rule->p22[j] * v0[j] + rule->gv[j] * mean[j];
            v0[j] = rate + rule->ramp_rate[j] * growth[j];
            q1[j] += rule->ramp[j] * growth[j];
        }
        configure_linear(body, need, q1, there);
        configure_places(body, need, there);
        modal_force(body, loads, 1, there, 0, scratch, end);
        stretch_at(body, q1, stretch);
        subtract_stretch_force(body, stretch, stretch, end);
        end_work = force_work(body, loads, there);
        /* What the force's change over the step would do beyond its mean is the leading error. */
        double error = 0.0, energy = 0.0;
        for (int64_t j = 0; j < m; j++) {
            const double lost = p->weight[j] * rule->ramp[j] * (end[j] - start[j]), strained = p->omega[j] * q1[j];
            error += lost * lost;
            energy += strained * strained + v0[j] * v0[j];
        }
        error = energy > 0.0 ? sqrt(error / energy) : 0.0;
        if (!(error <= d->worst)) d->worst = error;
        if (!(d->worst <= d->tolerance)) return INACCURATE;
        double *kept = start;
        start = end;
        end = kept;
        start_work = end_work;
        Configuration *passed = here;
        here = there;
        there = passed;
        Stretch *left = stretched;
        stretched = stretch;
        stretch = left;
    }
    remember(body, need, here);
    memcpy(q, here->q, (size_t)m * sizeof(double));
    memcpy(v, v0, (size_t)m * sizeof(double));
    return DONE;
}
