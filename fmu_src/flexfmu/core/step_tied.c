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
static const double ROUND_OFF = 64.0 * 2.220446049250313e-16;
/* A chord iteration that has not settled after this many rounds is slow: Newton's method takes over. */
enum { CHORD_ROUNDS = 16, NEWTON_ROUNDS = 12 };

int64_t tied_size(const Body *body) {
    const int64_t m = body->p.modes;
    Arena count = {0, 0};
    Configuration at;
    Loads loads;
    for (int i = 0; i < 3; i++) take_configuration(body, &count, &at);
    take_loads(body, &count, &loads);
    return count.used + pull_size(body) + 14 * m + 2 * m * m + body->p.loads + 12 * body->p.ties + modal_force_size(body) +
           6 * body->p.nodes + pass_back_size(body) + tangent_size(body);
}

/* Energy that the ties hold beyond what the modes do, E - q H q / 2, is E less this. */
static double held_by_modes(const Body *body, const double *q) {
    const int64_t m = body->p.modes;
    double sum = 0.0;
    for (int64_t j = 0; j < m; j++) sum += q[j] * dot(body->p.tie_initial + j * m, q, m);
    return 0.5 * sum;
}

int tied_steps(Body *body, Division *d, double *q, double *v) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    const int potential = has_potential(body);
    Arena arena = work_arena(body);
    Configuration states[2], middle, *here = states, *there = states + 1;
    Loads loads;
    Pull pull;
    take_configuration(body, &arena, here);
    take_configuration(body, &arena, there);
    take_configuration(body, &arena, &middle);
    take_loads(body, &arena, &loads);
    take_pull(body, &arena, &pull);
    double *v0 = take(&arena, m), *q1 = take(&arena, m), *free = take(&arena, m), *force = take(&arena, m);
    double *bare = take(&arena, m), *mean = take(&arena, m), *way = take(&arena, m), *speed = take(&arena, m);
    double *off = take(&arena, m), *change = take(&arena, m), *slope = take(&arena, m);
    double *tangent = take(&arena, m * m), *newton = take(&arena, m * m), *between = take(&arena, p->loads);
    double *tense = take(&arena, 12 * p->ties), *scratch = take(&arena, modal_force_size(body));
    double *unit = take(&arena, 6 * p->nodes + pass_back_size(body)), *rest = take(&arena, tangent_size(body));
    const Rule *rule = rule_of(body, d->step);
    const double h = d->step, noise = p->tie_noise[0] / p->omega[m - 1];

    d->worst = 0.0;
    memcpy(v0, v, (size_t)m * sizeof(double));
    configure(body, q, here);
    spread(body, d->inputs, &loads);
    for (int64_t number = 0; number < d->count; number++) {
        if (d->inputs_end) {
            const double share = ((double)number + 0.5) / (double)d->count;
            for (int64_t i = 0; i < p->loads; i++) between[i] = d->inputs[i] + share * (d->inputs_end[i] - d->inputs[i]);
            spread(body, between, &loads);
        }
        const double held = tie_tension(body, here, tense), start_work = force_work(body, &loads, here) - held;
        const double rate = norm(v0, m), reach = load_reach(body, &loads) + fabs(start_work);
        double last = HUGE_VAL, earlier = HUGE_VAL;
        for (int64_t j = 0; j < m; j++) {
            free[j] = rule->p11[j] * here->q[j] + rule->p12[j] * v0[j];
            q1[j] = here->q[j] + h * v0[j];
        }
        configure(body, q1, there);
        configure_halfway(body, 0, here, there, &middle);
        if (!pull_at(body, rule, &middle, unit, body->pivot, &pull)) return UNSETTLED;
        int settled = 0, newtons = 0;
        for (int round = 1; !settled; round++) {
            if (round > CHORD_ROUNDS + NEWTON_ROUNDS) return UNSETTLED;
            if (d->most_rounds && d->rounds >= d->most_rounds) return EXHAUSTED;
            d->rounds++;
            if (round > 1) {
                configure(body, q1, there);
                configure_halfway(body, 0, here, there, &middle);
            }
            for (int64_t j = 0; j < m; j++) {
                way[j] = q1[j] - here->q[j];
                speed[j] = way[j] / h;
            }
            modal_force(body, &loads, 1, &middle, 0, scratch, force);
            const double square = dot(way, way, m);
            const double *conservative = force;
            double correction = 0.0;
            if (potential && square > 0.0) {
                const double end_work = force_work(body, &loads, there) - tie_tension(body, there, tense);
                if (loads.has_moments) {
                    modal_force(body, &loads, 0, &middle, 0, scratch, bare);
                    conservative = bare;
                }
                const double bracket = end_work - start_work - dot(conservative, way, m);
                if (fabs(bracket) > ROUND_OFF * (reach + fabs(end_work))) correction = bracket / square;
            }
            for (int64_t j = 0; j < m; j++) {
                mean[j] = force[j] + correction * way[j] + dot(p->tie_initial + j * m, middle.q, m) -
                          dot(body->coupled + j * m, speed, m);
                off[j] = q1[j] - free[j] - rule->gq[j] * mean[j];
            }
            if (newtons) {
                tangent_stiffness(body, &loads, 1, &middle, 0, rest, tangent);
                memset(slope, 0, (size_t)m * sizeof(double));
                if (correction != 0.0) {
                    /* How the correction's factor changes with q1. */
                    memcpy(change, conservative, (size_t)m * sizeof(double));
                    if (loads.has_moments) tangent_stiffness(body, &loads, 0, &middle, 0, rest, newton);
                    const double *of_forces = loads.has_moments ? newton : tangent;
                    for (int64_t j = 0; j < m; j++)
                        slope[j] = body->stiffness[j] * way[j] - dot(of_forces + j * m, way, m) -
                                   dot(p->tie_initial + j * m, way, m);
                    modal_force(body, &loads, 0, there, 0, scratch, bare);
                    for (int64_t j = 0; j < m; j++)
                        slope[j] = (bare[j] - change[j] - 0.5 * slope[j] - 2.0 * correction * way[j]) / square;
                }
                for (int64_t i = 0; i < m; i++)
                    for (int64_t j = 0; j < m; j++) {
                        const double one = i == j ? 1.0 : 0.0;
                        const double by_q = 0.5 * (one * body->stiffness[i] - tangent[i * m + j]) + one * correction +
                                            way[i] * slope[j];
                        newton[i * m + j] = one - rule->gq[i] * (by_q - body->coupled[i * m + j] / h);
                    }
                memcpy(change, off, (size_t)m * sizeof(double));
                if (!lu_factor(newton, body->pivot, m)) return UNSETTLED;
                lu_solve(newton, body->pivot, change, m, 1);
            } else {
                respond(body, rule, &pull, off, change);
            }
            for (int64_t j = 0; j < m; j++) q1[j] -= change[j];
            const double size = norm(change, m), enough = TOLERANCE * (norm(q1, m) + h * rate);
            if (!isfinite(size)) return UNSETTLED;
            settled = size <= (enough > noise ? enough : noise);
            newtons = newtons || size > 0.5 * earlier || round >= CHORD_ROUNDS;
            earlier = last;
            last = size;
        }
        configure(body, q1, there);
        configure_halfway(body, 0, here, there, &middle);
        /* Stiff springs that vibrate faster than the step can tell are strained by it at its ends as they never are in
         * truth: their tension is taken as it is in the middle, and how it changes from how the body gives way. */
        tie_tension(body, &middle, tense);
        modal_force(body, &loads, 1, there, tense, scratch, force);
        modal_force(body, &loads, 1, here, tense, scratch, bare);
        for (int64_t j = 0; j < m; j++) {
            way[j] = q1[j] - here->q[j];
            v0[j] = rule->p21[j] * here->q[j] + rule->p22[j] * v0[j] + rule->gv[j] * mean[j];
        }
        double strain = 2.0 * (tie_tension(body, there, tense) - held_by_modes(body, q1)), error = 0.0;
        for (int64_t j = 0; j < m; j++) {
            speed[j] = body->stiffness[j] * way[j];
            off[j] = rule->gq[j] * (force[j] - bare[j] + dot(p->tie_initial + j * m, way, m) - speed[j]);
            strain += body->stiffness[j] * q1[j] * q1[j];
        }
        respond(body, rule, &pull, off, change);
        for (int64_t j = 0; j < m; j++) {
            /* A mode of the straight body that the turned one only follows, at hardly any acceleration of its own, asks
             * for no shorter step, however its force changes. */
            const double moved = rule->lag[j] * change[j], followed = moved + rule->ramp[j] * speed[j];
            const double lost = p->omega[j] * fmin(fabs(moved), fabs(followed));
            error += lost * lost;
        }
        const double size = fabs(strain) + dot(v0, v0, m);
        error = size > 0.0 ? sqrt(error / size) : 0.0;
        if (!(error <= d->worst)) d->worst = error;
        if (!(d->worst <= d->tolerance)) return INACCURATE;
        Configuration *passed = here;
        here = there;
        there = passed;
    }
    memcpy(q, here->q, (size_t)m * sizeof(double));
    memcpy(v, v0, (size_t)m * sizeof(double));
    return DONE;
}
