/* Internal steps with the mass of the deformed body (docs/theory.md section 9): the rule of step_plain.c with (15).
 *
 * The modes feel what the mass has beyond that of the undeformed body as a force. Momentum enters its mean by its
 * difference, not by impulses at the ends, so that modes which the step does not resolve are pushed as by a force that is
 * spread over it. */
#include <math.h>
#include <string.h>

#include "internal.h"

static const double TOLERANCE = 1e-12;
/* Change below which the gradient of M is left as it is: energy does not depend on it, and the rest far below the error. */
static const double SETTLED = 1e-6;
enum { FIXED_POINT_ROUNDS = 8, NEWTON_ROUNDS = 12 };

int64_t inertial_size(const Body *body) {
    const int64_t m = body->p.modes;
    return ends_size(body) + 24 * m + body->p.loads + 9 * m * m + modal_force_size(body) + tangent_size(body) + mass_size(body);
}

typedef struct {
    double *mass, *matrix, *scratch, *rest, *inertia; /* workspaces */
} Room;

/* All that acts on the modes at one end, inertia included: q'' + Lambda q, damping apart. */
static void end_force(Body *body, const Loads *loads, const Configuration *at, const double *v, const Room *room,
                      double *spare, double *force) {
    const int64_t m = body->p.modes;
    modal_force(body, loads, 1, at, 0, room->scratch, force);
    convective_force(body, at, v, room->inertia, spare);
    for (int64_t j = 0; j < m; j++) force[j] -= body->stiffness[j] * at->q[j] + spare[j];
    memcpy(room->matrix, room->mass, (size_t)(m * m) * sizeof(double));
    if (lu_factor(room->matrix, body->pivot, m)) lu_solve(room->matrix, body->pivot, force, m, 1);
    for (int64_t j = 0; j < m; j++) force[j] += body->stiffness[j] * at->q[j];
}

/* out = (M - 1) v. */
static void excess_times(const double *mass, const double *v, int64_t m, double *out) {
    for (int64_t j = 0; j < m; j++) out[j] = dot(mass + j * m, v, m) - v[j];
}

int inertial_steps(Body *body, Division *d, double *q, double *v) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    const int potential = has_potential(body);
    Arena arena = work_arena(body);
    Ends ends;
    Room room;
    take_ends(body, &arena, &ends);
    Configuration *here = &ends.first, *there = &ends.second, *middle = &ends.middle;
    Loads *loads = &ends.loads;
    room.mass = take(&arena, m * m);
    room.matrix = take(&arena, m * m);
    room.scratch = take(&arena, modal_force_size(body));
    room.rest = take(&arena, tangent_size(body));
    room.inertia = take(&arena, mass_size(body));
    double *v0 = take(&arena, m), *q1 = take(&arena, m), *v1 = take(&arena, m), *free_q = take(&arena, m);
    double *free_v = take(&arena, m), *start = take(&arena, m), *end = take(&arena, m), *force = take(&arena, m);
    double *mean = take(&arena, m), *way = take(&arena, m), *bare = take(&arena, m), *growth = take(&arena, m);
    double *momentum = take(&arena, m), *impulse = take(&arena, m), *gradient = take(&arena, m);
    double *velocity = take(&arena, m), *spare = take(&arena, m), *change = take(&arena, 2 * m);
    double *half = take(&arena, m), *between = take(&arena, p->loads);
    double *newton = take(&arena, 4 * m * m), *slope = take(&arena, m * m), *tangent = take(&arena, m * m);
    const Rule *rule = rule_of(body, d->step);
    const double h = d->step;

    d->worst = 0.0;
    spread_growth(body, d, loads, growth);
    memcpy(v0, v, (size_t)m * sizeof(double));
    memset(body->need, 1, (size_t)p->nodes * sizeof *body->need);
    if (!recall(body, body->need, q, here)) configure(body, q, here);
    mass_matrix(body, here, room.inertia, room.mass);
    for (int64_t number = 0; number < d->count; number++) {
        if (d->rounds >= d->most_rounds) return EXHAUSTED;
        if (d->inputs_end) spread_middle(body, d, number, between, loads);
        if (d->inputs_end || number == 0) end_force(body, loads, here, v0, &room, spare, start);
        excess_times(room.mass, v0, m, momentum);
        const double start_work = force_work(body, loads, here);
        const double load_size = work_reach(body, loads->force, p->nodes) + fabs(start_work);
        for (int64_t j = 0; j < m; j++) {
            free_q[j] = rule->p11[j] * here->q[j] + rule->p12[j] * v0[j] + rule->ramp[j] * growth[j];
            free_v[j] = rule->p21[j] * here->q[j] + rule->p22[j] * v0[j] + rule->ramp_rate[j] * growth[j];
            q1[j] = free_q[j] + rule->gq[j] * start[j];
            v1[j] = free_v[j] + rule->gv[j] * start[j];
        }
        memset(gradient, 0, (size_t)m * sizeof(double));
        double size = HUGE_VAL;
        int settled = 0;
        for (int round = 1; !settled; round++) {
            if (round > FIXED_POINT_ROUNDS + NEWTON_ROUNDS) return UNSETTLED;
            d->rounds++;
            configure(body, q1, there);
            configure_halfway(body, 0, here, there, middle);
            mass_matrix(body, there, room.inertia, room.mass);
            for (int64_t j = 0; j < m; j++) {
                way[j] = q1[j] - here->q[j];
                half[j] = 0.5 * (v0[j] + v1[j]);
            }
            if (size > SETTLED) kinetic_gradient(body, middle, half, room.inertia, gradient);
            modal_force(body, loads, 1, middle, 0, room.scratch, force);
            excess_times(room.mass, v1, m, impulse);
            const double carried = dot(v1, impulse, m);
            for (int64_t j = 0; j < m; j++) impulse[j] -= momentum[j];
            /* The factor c of (15), which makes the work of the mean that of loads less what kinetic energy gains. */
            double kinetic = dot(v1, impulse, m);
            for (int64_t j = 0; j < m; j++) kinetic += (v1[j] - v0[j]) * momentum[j];
            double bracket = dot(impulse, way, m) / h - dot(gradient, way, m) - 0.5 * kinetic;
            double reach = fabs(carried) + fabs(dot(v0, momentum, m));
            if (potential) {
                const double *conservative = force;
                const double work = force_work(body, loads, there);
                if (loads->has_moments) {
                    modal_force(body, loads, 0, middle, 0, room.scratch, bare);
                    conservative = bare;
                }
                bracket += work - start_work - dot(conservative, way, m);
                reach += load_size + fabs(work);
            }
            for (int64_t j = 0; j < m; j++) force[j] += gradient[j];
            if (fabs(bracket) > ROUND_OFF * reach) {
                const double factor = bracket / dot(way, way, m);
                for (int64_t j = 0; j < m; j++) force[j] += factor * way[j];
            }
            if (round > FIXED_POINT_ROUNDS) {
                for (int64_t j = 0; j < m; j++) {
                    mean[j] = force[j] - impulse[j] / h;
                    change[j] = q1[j] - free_q[j] - rule->gq[j] * mean[j];
                    change[m + j] = v1[j] - free_v[j] - rule->gv[j] * mean[j];
                }
                if (round == FIXED_POINT_ROUNDS + 1) {
                    /* Derivative of the residual by q1 and v1, but for second derivatives of M. */
                    tangent_stiffness(body, loads, 1, middle, 0, room.rest, tangent);
                    momentum_slope(body, middle, half, room.inertia, slope);
                    for (int64_t i = 0; i < m; i++)
                        for (int64_t j = 0; j < m; j++) {
                            const double one = i == j ? 1.0 : 0.0;
                            const double by_q = 0.5 * (one * body->stiffness[i] - tangent[i * m + j]) - slope[i * m + j] / h;
                            const double by_v = 0.5 * slope[j * m + i] - (room.mass[i * m + j] - one) / h;
                            newton[i * 2 * m + j] = one - rule->gq[i] * by_q;
                            newton[i * 2 * m + m + j] = -rule->gq[i] * by_v;
                            newton[(m + i) * 2 * m + j] = -rule->gv[i] * by_q;
                            newton[(m + i) * 2 * m + m + j] = one - rule->gv[i] * by_v;
                        }
                    if (!lu_factor(newton, body->pivot, 2 * m)) return UNSETTLED;
                }
                lu_solve(newton, body->pivot, change, 2 * m, 1);
            } else {
                for (int64_t i = 0; i < m; i++) {
                    const double kick = rule->gv[i] / h;
                    for (int64_t j = 0; j < m; j++) {
                        const double one = i == j ? 1.0 : 0.0;
                        room.matrix[i * m + j] = one + kick * (room.mass[i * m + j] - one);
                    }
                    velocity[i] = free_v[i] + rule->gv[i] * force[i] + kick * momentum[i];
                }
                if (!lu_factor(room.matrix, body->pivot, m)) return UNSETTLED;
                lu_solve(room.matrix, body->pivot, velocity, m, 1);
                excess_times(room.mass, velocity, m, spare);
                for (int64_t j = 0; j < m; j++) {
                    mean[j] = force[j] - (spare[j] - momentum[j]) / h;
                    change[j] = q1[j] - free_q[j] - rule->gq[j] * mean[j];
                    change[m + j] = v1[j] - velocity[j];
                }
            }
            double moved = 0.0, sized = 0.0;
            for (int64_t j = 0; j < m; j++) {
                q1[j] -= change[j];
                v1[j] -= change[m + j];
                const double step = p->weight[j] * change[j], reached = p->weight[j] * q1[j];
                moved += step * step + change[m + j] * change[m + j];
                sized += reached * reached + v1[j] * v1[j];
            }
            size = sized > 0.0 ? sqrt(moved / sized) : 0.0;
            if (!isfinite(size)) return UNSETTLED;
            settled = size <= TOLERANCE;
        }
        configure(body, q1, there);
        mass_matrix(body, there, room.inertia, room.mass);
        end_force(body, loads, there, v1, &room, spare, end);
        double error = 0.0, energy = 0.0;
        for (int64_t j = 0; j < m; j++) {
            const double lost = p->weight[j] * rule->ramp[j] * (end[j] - start[j]), strained = p->omega[j] * q1[j];
            error += lost * lost;
            energy += strained * strained + v1[j] * v1[j];
        }
        error = energy > 0.0 ? sqrt(error / energy) : 0.0;
        if (!(error <= d->worst)) d->worst = error;
        if (!(d->worst <= d->tolerance)) return INACCURATE;
        memcpy(v0, v1, (size_t)m * sizeof(double));
        double *kept = start;
        start = end;
        end = kept;
        Configuration *passed = here;
        here = there;
        there = passed;
    }
    remember(body, body->need, here);
    memcpy(q, here->q, (size_t)m * sizeof(double));
    memcpy(v, v0, (size_t)m * sizeof(double));
    return DONE;
}
