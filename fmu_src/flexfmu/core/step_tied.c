/* Internal steps of a body whose cut parts ties join (docs/theory.md section 10).
 *
 * The modes hold the ties as they pull at q = 0; at turned frames these stiff springs pull in other directions. So only the
 * modes that a step resolves are propagated exactly, the others by the rule of the middle (17), all under the discrete
 * gradient (9) of every force beyond Lambda. Source of (17): J. C. Simo, N. Tarnow, ZAMP 43 (1992) 757. */
#include <math.h>
#include <string.h>

#include "internal.h"

/* Change of q over a round relative to q and to the way of a step. */
static const double TOLERANCE = 1e-11;
/* A round that leaves more than this of the change before it has the ties pull anew in its own middle. */
static const double FAST = 0.02;
/* Vibrations whose phase is lost may hold a twentieth of the energy at the usual tolerance of 1e-4. */
static const double PHASE = 0.04;
/* An iteration that has not settled after this many rounds is slow: the step is divided. */
enum { MOST_ROUNDS = 16 };

int64_t tied_size(const Body *body) {
    const int64_t m = body->p.modes;
    return ends_size(body) + 2 * stretch_size(body) + pull_size(body) + 17 * m + body->p.loads + 12 * body->p.ties + modal_force_size(body);
}

/* Twice the energy of vibrations that the step does not resolve, for an acceleration and rates at its start. With K the
 * stiffness, an acceleration a is that of a vibration about K^-1 a; (D + K)^-1 takes out what is slow, D being 4/h^2. */
static double ringing(const Body *body, const Rule *rule, Pull *pull, const double *acceleration, const double *rates,
                      double *x, double *answer) {
    const int64_t m = body->p.modes;
    double energy = 0.0;
    for (int moving = 0; moving < 2; moving++) {
        const double *start = moving ? rates : acceleration;
        for (int64_t j = 0; j < m; j++) x[j] = 0.5 * rule->gq[j] * start[j];
        respond(body, rule, pull, x, 0, answer);
        for (int64_t j = 0; j < m; j++) {
            if (rule->ramp[j] != 0.0) continue;
            const double slow = moving ? (2.0 / rule->gq[j] - body->stiffness[j]) * answer[j] : 0.0;
            energy += start[j] * (moving ? start[j] - slow : answer[j]);
        }
    }
    return energy;
}

/* Twice the strain energy, of springs that hold `held`; `linear` is Hq. */
static double strain_of(const Body *body, const double *q, double held, const double *linear) {
    double strain = 2.0 * held;
    for (int64_t j = 0; j < body->p.modes; j++) strain += q[j] * (body->stiffness[j] * q[j] - linear[j]);
    return fabs(strain);
}

int tied_steps(Body *body, Division *d, double *q, double *v) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    const int potential = has_potential(body);
    Arena arena = work_arena(body);
    Ends ends;
    Pull pull;
    take_ends(body, &arena, &ends);
    Configuration *here = &ends.first, *there = &ends.second, *middle = &ends.middle;
    Loads *loads = &ends.loads;
    take_pull(body, &arena, &pull);
    Stretch first, last, *stretched = &first, *stretch = &last;
    take_stretch(body, &arena, stretched);
    take_stretch(body, &arena, stretch);
    double *v0 = take(&arena, m), *q1 = take(&arena, m), *free = take(&arena, m), *force = take(&arena, m);
    double *bare = take(&arena, m), *mean = take(&arena, m), *way = take(&arena, m), *speed = take(&arena, m);
    double *off = take(&arena, m), *change = take(&arena, m), *linear = take(&arena, m), *end_linear = take(&arena, m);
    double *held = take(&arena, m), *lost = take(&arena, m), *begin = take(&arena, m);
    double *between = take(&arena, p->loads), *tense = take(&arena, 12 * p->ties);
    double *scratch = take(&arena, modal_force_size(body));
    const Rule *rule = rule_of(body, d->step);
    const double h = d->step, fastest = p->omega[m - 1], noise = p->tie_noise[0] / fastest;
    /* Root of the energy that is round-off of the springs' strain and of the rates that follow from it. */
    const double quiet = noise * (fastest + 2.0 / h);

    int64_t resolved = 0;
    while (resolved < m && rule->ramp[resolved] != 0.0) resolved++;
    d->worst = 0.0;
    memcpy(v0, v, (size_t)m * sizeof(double));
    find_need(body, d->inputs, d->inputs_end);
    const Need *need = body->need;
    if (!recall(body, need, q, here)) {
        configure_linear(body, need, q, here);
        configure_places(body, need, here);
    }
    spread(body, d->inputs, loads);
    rows_times(p->tie_initial, q, linear, m, m);
    stretch_at(body, q, stretched);
    double start_energy = strain_of(body, q, tie_tension(body, here, tense), linear) + dot(v0, v0, m) +
                          2.0 * stretch_energy(body, stretched);
    for (int64_t number = 0; number < d->count; number++) {
        if (d->rounds >= d->most_rounds) return EXHAUSTED;
        if (resolved < m) {
            if (d->inputs_end) spread_at(body, d, (double)number, between, loads);
            modal_force(body, loads, 1, here, 0, scratch, begin);
            for (int64_t j = 0; j < m; j++)
                begin[j] += linear[j] - body->stiffness[j] * here->q[j] - body->rate[j] * v0[j] - dot(body->coupled + j * m, v0, m);
            subtract_stretch_force(body, stretched, stretched, begin);
        }
        if (d->inputs_end) spread_at(body, d, (double)number + 0.5, between, loads);
        const double load_work = force_work(body, loads, here), start_work = load_work - tie_tension(body, here, tense);
        const double rate = norm(v0, m), reach = work_reach(body, loads->force, p->nodes) + fabs(start_work);
        double last = HUGE_VAL, earlier = HUGE_VAL;
        for (int64_t j = 0; j < m; j++) {
            free[j] = rule->p11[j] * here->q[j] + rule->p12[j] * v0[j];
            q1[j] = here->q[j] + h * v0[j];
        }
        configure_linear(body, need, q1, there);
        configure_places(body, need, there);
        configure_halfway(body, need, here, there, middle);
        int settled = 0, stale = 1;
        for (int round = 1; !settled; round++) {
            d->rounds++;
            if (round > 1) {
                configure_linear(body, need, q1, there);
                configure_places(body, need, there);
                configure_halfway(body, need, here, there, middle);
            }
            if (stale && !pull_at(body, rule, middle, body->pivot, &pull)) return UNSETTLED;
            for (int64_t j = 0; j < m; j++) way[j] = q1[j] - here->q[j];
            modal_force(body, loads, 1, middle, 0, scratch, force);
            const double square = dot(way, way, m);
            const double *conservative = force;
            double correction = 0.0, blur = 0.0, blurred = 0.0;
            if (potential && square > 0.0) {
                const double end_work = force_work(body, loads, there) - tie_tension(body, there, tense);
                if (loads->has_moments) {
                    modal_force(body, loads, 0, middle, 0, scratch, bare);
                    conservative = bare;
                }
                const double bracket = end_work - start_work - dot(conservative, way, m);
                /* The springs' strain is a difference of places. */
                const double round_off = ROUND_OFF * (reach + fabs(end_work) + work_reach(body, tense, 4 * p->ties));
                if (fabs(bracket) > round_off) {
                    correction = bracket / square;
                    blur = NOISE * round_off / square;
                }
            }
            /* What the mean holds beside Hq at the start and what is linear in the way, of which `respond` knows. */
            for (int64_t j = 0; j < m; j++) mean[j] = force[j] + correction * way[j];
            stretch_at(body, q1, stretch);
            subtract_stretch_force(body, stretched, stretch, mean);
            for (int64_t j = 0; j < m; j++) {
                off[j] = here->q[j] - free[j] - rule->gq[j] * (mean[j] + linear[j]);
                blurred += rule->gq[j] * way[j] * rule->gq[j] * way[j];
            }
            respond(body, rule, &pull, off, way, change);
            for (int64_t j = 0; j < m; j++) q1[j] -= change[j];
            const double size = norm(change, m), enough = TOLERANCE * (norm(q1, m) + h * rate);
            if (!isfinite(size)) return UNSETTLED;
            settled = size <= fmax(fmax(enough, noise), blur * sqrt(blurred));
            if (!settled && (size > 0.5 * earlier || round >= MOST_ROUNDS)) return UNSETTLED;
            stale = size > FAST * last;
            earlier = last;
            last = size;
        }
        for (int64_t j = 0; j < m; j++) speed[j] = way[j] / h;
        rows_times(p->tie_initial, middle->q, held, m, m);
        rows_times(body->coupled, speed, lost, m, m);
        for (int64_t j = 0; j < m; j++) mean[j] += held[j] - lost[j];
        configure_linear(body, need, q1, there);
        configure_places(body, need, there);
        configure_halfway(body, need, here, there, middle);
        const double lost_phase = resolved < m ? ringing(body, rule, &pull, begin, v0, off, change) : 0.0;
        /* Stiff springs that vibrate faster than the step can tell are strained by it at its ends as they never are in
         * truth: their tension is taken as it is in the middle, and how it changes from how the body gives way. */
        tie_tension(body, middle, tense);
        modal_force(body, loads, 1, there, tense, scratch, force);
        modal_force(body, loads, 1, here, tense, scratch, bare);
        stretch_at(body, q1, stretch);
        subtract_stretch_force(body, stretch, stretch, force);
        subtract_stretch_force(body, stretched, stretched, bare);
        for (int64_t j = 0; j < m; j++) {
            way[j] = q1[j] - here->q[j];
            v0[j] = rule->p21[j] * here->q[j] + rule->p22[j] * v0[j] + rule->gv[j] * mean[j];
        }
        double error = 0.0;
        rows_times(p->tie_initial, q1, end_linear, m, m);
        for (int64_t j = 0; j < m; j++) {
            speed[j] = body->stiffness[j] * way[j];
            off[j] = rule->gq[j] * (force[j] - bare[j] + end_linear[j] - linear[j] - speed[j]);
        }
        respond(body, rule, &pull, off, 0, change);
        for (int64_t j = 0; j < m; j++) {
            /* A mode of the straight body that the turned one only follows, at hardly any acceleration of its own, asks
             * for no shorter step, however its force changes. */
            const double moved = rule->lag[j] * change[j], followed = moved + rule->ramp[j] * speed[j];
            const double missed = p->omega[j] * fmin(fabs(moved), fabs(followed));
            error += missed * missed;
        }
        /* Work of the loads: forces by their potential, moments by their value in the middle-> */
        double work = potential ? force_work(body, loads, there) - load_work : 0.0;
        memset(tense, 0, (size_t)(12 * p->ties) * sizeof(double));
        if (!potential || loads->has_moments) {
            modal_force(body, loads, 1, middle, tense, scratch, force);
            work += dot(force, way, m);
        }
        if (potential && loads->has_moments) {
            modal_force(body, loads, 0, middle, tense, scratch, force);
            work -= dot(force, way, m);
        }
        /* Energy that neither was there at the start nor came from the loads is error as well, and what blows up may not be
         * measured by itself. */
        const double energy = strain_of(body, q1, tie_tension(body, there, tense), end_linear) + dot(v0, v0, m) +
                              2.0 * stretch_energy(body, stretch);
        const double bound = start_energy + 2.0 * fabs(work) + quiet * quiet + 2.0 * ROUND_OFF * (reach + energy);
        error = sqrt(error) + (!(energy <= bound) ? sqrt(energy) - sqrt(bound) : 0.0);
        error = !(error <= quiet) ? error / sqrt(fmin(energy, bound)) : 0.0;
        /* The phase of what the step does not resolve is lost. Of motion under a load its share is that of the energy. */
        const double share = lost_phase > quiet * quiet ? lost_phase / fmax(start_energy, fmin(energy, bound)) : 0.0;
        const double blind = PHASE * share * share;
        if (!(blind <= error)) error = blind;
        start_energy = energy;
        memcpy(linear, end_linear, (size_t)m * sizeof(double));
        if (!(error <= d->worst)) d->worst = error;
        if (!(d->worst <= d->tolerance)) return INACCURATE;
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
