/* Internal steps with the mass of the deformed body (docs/theory.md section 9): the rule of step_plain.c with (15).
 *
 * The modes feel what the mass has beyond that of the undeformed body as a force. Momentum enters its mean by its
 * difference, not by impulses at the ends, so that modes which the step does not resolve are pushed as by a force that is
 * spread over it. Places and rates at the end are linear in that mean, which is the only unknown. It is found by a fixed
 * derivative that knows of the mass alone, where the step is foreseen to end, and by what earlier rounds have shown of the true
 * one. Source of the latter: D. G. Anderson, J. ACM 12 (1965) 547. */
#include <math.h>
#include <string.h>

#include "internal.h"

/* What may be left of the error of Omega q and its rate, relative to their size. */
static const double TOLERANCE = 1e-12;
/* Change below which what acts in the middle is left as it is: energy does not depend on it, and the rest far below the
 * error. */
static const double SETTLED = 1e-6;
enum { MOST_ROUNDS = LEARNT_ROUNDS };
/* Part of a difference of two rounds' errors that has to be new, for it to tell anything. */
static const double NEW = 1e-6;

typedef struct {
    double *v0, *q1, *v1, *free_q, *free_v, *start, *end, *mean, *force, *growth, *way, *pushed, *bare, *momentum, *impulse, *gradient;
    double *half, *change, *between, *mass, *chord, *seen, *size, *scratch;
    Flow flow;
    Ends ends;
    Stretch stretched, stretch; /* at a step's start, and at its end */
} Room;

static void take_room(const Body *body, Arena *arena, Room *room) {
    const int64_t m = body->p.modes, r = body->p.inertial_modes;
    double **each[] = {&room->v0, &room->q1, &room->v1, &room->free_q, &room->free_v, &room->start, &room->end, &room->mean,
                       &room->force, &room->growth, &room->way, &room->pushed, &room->bare, &room->momentum, &room->impulse, &room->gradient,
                       &room->half, &room->change, &room->size};
    for (size_t i = 0; i < sizeof each / sizeof *each; i++) *each[i] = take(arena, m);
    room->between = take(arena, body->p.loads);
    room->mass = take(arena, r * r);
    room->chord = take(arena, r * r);
    room->seen = take(arena, 2 * (MOST_ROUNDS + 1) * m);
    room->scratch = take(arena, modal_force_size(body));
    take_flow(body, arena, &room->flow);
    take_ends(body, arena, &room->ends);
    take_stretch(body, arena, &room->stretched);
    take_stretch(body, arena, &room->stretch);
}

int64_t inertial_size(const Body *body) {
    Arena count = {0, 0};
    Room room;
    take_room(body, &count, &room);
    return count.used;
}

/* All that acts on the modes at one end, inertia included: q'' + 2 Z Omega q' + Lambda q. It starts the iteration and tells the
 * error: the mass may be that of a place nearby. */
static void end_force(Body *body, const Loads *loads, const Configuration *at, const double *v, Room *room, double *force) {
    const int64_t m = body->p.modes, r = body->p.inertial_modes;
    double *pulled = room->bare, *convective = room->change;
    modal_force(body, loads, 1, at, 0, room->scratch, force);
    stretch_at(body, at->q, &room->stretch);
    subtract_stretch_force(body, &room->stretch, &room->stretch, force);
    convective_force(body, at, v, &room->flow, convective);
    for (int64_t j = 0; j < m; j++) {
        pulled[j] = body->stiffness[j] * at->q[j] + body->rate[j] * v[j];
        force[j] -= pulled[j] + convective[j];
    }
    memcpy(room->chord, room->mass, (size_t)(r * r) * sizeof(double));
    for (int64_t j = 0; j < r; j++) room->chord[j * r + j] += 1.0;
    if (lu_factor(room->chord, body->pivot, r)) lu_solve(room->chord, body->pivot, force, r, 1);
    for (int64_t j = 0; j < m; j++) force[j] += pulled[j];
}

void learn(const double *size, const double *mean, int64_t m, int round, int *pairs, double *seen, double *change) {
    double *error = seen + 2 * MOST_ROUNDS * m, *place = error + m;
    double *y = seen + 2 * *pairs * m, *x = y + m;
    if (round > 1) {
        double whole = 0.0, left = 0.0;
        for (int64_t j = 0; j < m; j++) {
            y[j] = change[j] - error[j];
            x[j] = mean[j] - place[j];
            whole += size[j] * y[j] * y[j];
        }
        for (int i = 0; i < *pairs; i++) {
            const double *old = seen + 2 * i * m;
            double along = 0.0;
            for (int64_t j = 0; j < m; j++) along += size[j] * y[j] * old[j];
            for (int64_t j = 0; j < 2 * m; j++) y[j] -= along * old[j];
        }
        for (int64_t j = 0; j < m; j++) left += size[j] * y[j] * y[j];
        if (left > NEW * NEW * whole) {
            for (int64_t j = 0; j < 2 * m; j++) y[j] /= sqrt(left);
            ++*pairs;
        }
    }
    memcpy(error, change, (size_t)m * sizeof(double));
    memcpy(place, mean, (size_t)m * sizeof(double));
    for (int i = 0; i < *pairs; i++) {
        const double *old = seen + 2 * i * m;
        double along = 0.0;
        for (int64_t j = 0; j < m; j++) along += size[j] * error[j] * old[j];
        for (int64_t j = 0; j < m; j++) change[j] += along * (old[m + j] - old[j]);
    }
}

int inertial_steps(Body *body, Division *d, double *q, double *v) {
    const Program *p = &body->p;
    const int64_t m = p->modes, r = p->inertial_modes;
    const int potential = has_potential(body);
    Arena arena = work_arena(body);
    Room room;
    take_room(body, &arena, &room);
    Configuration *here = &room.ends.first, *there = &room.ends.second, *middle = &room.ends.middle;
    Loads *loads = &room.ends.loads;
    double *v0 = room.v0, *q1 = room.q1, *v1 = room.v1, *force = room.force, *mean = room.mean, *change = room.change;
    double *start = room.start, *end = room.end, *impulse = room.impulse, *momentum = room.momentum, *way = room.way;
    const Rule *rule = rule_of(body, d->step);
    const double h = d->step;

    d->worst = 0.0;
    spread_growth(body, d, loads, room.growth);
    memcpy(v0, v, (size_t)m * sizeof(double));
    find_need(body, d->inputs, d->inputs_end);
    const Need *need = body->need;
    if (!recall(body, need, q, here)) {
        configure_linear(body, need, q, here);
        configure_places(body, need, here);
    }
    excess_mass(body, here, &room.flow, room.mass);
    excess_momentum(body, here, v0, &room.flow, momentum);
    for (int64_t number = 0; number < d->count; number++) {
        if (d->rounds >= d->most_rounds) return EXHAUSTED;
        if (d->inputs_end) spread_at(body, d, (double)number + 0.5, room.between, loads);
        if (d->inputs_end || number == 0) end_force(body, loads, here, v0, &room, start);
        stretch_at(body, here->q, &room.stretched);
        const double start_work = force_work(body, loads, here), start_energy = dot(v0, momentum, r);
        const double load_size = work_reach(body, loads->force, p->nodes) + fabs(start_work);
        /* Of M v^2, not of what it has beyond that of the undeformed body: the lumps' share is a difference. */
        const double start_size = dot(v0, v0, r);
        for (int64_t j = 0; j < m; j++) {
            room.free_q[j] = rule->p11[j] * here->q[j] + rule->p12[j] * v0[j] + rule->ramp[j] * room.growth[j];
            room.free_v[j] = rule->p21[j] * here->q[j] + rule->p22[j] * v0[j] + rule->ramp_rate[j] * room.growth[j];
            /* Where the force goes on as it did in the step before, its mean is halfway to the end. */
            mean[j] = start[j] + (number > 0 && !d->inputs_end ? 0.5 * (start[j] - end[j]) : 0.0);
            q1[j] = room.free_q[j] + rule->gq[j] * mean[j];
            v1[j] = room.free_v[j] + rule->gv[j] * mean[j];
        }
        memset(room.gradient, 0, (size_t)m * sizeof(double));
        double size = HUGE_VAL, before = 0.0, uncertain = 0.0;
        int settled = 0, pairs = 0;
        for (int64_t j = 0; j < m; j++) {
            const double reached = p->weight[j] * rule->gq[j];
            room.size[j] = reached * reached + rule->gv[j] * rule->gv[j];
        }
        for (int round = 1; !settled; round++) {
            if (round > MOST_ROUNDS) return UNSETTLED;
            d->rounds++;
            configure_linear(body, need, q1, there);
            configure_places(body, need, there);
            for (int64_t j = 0; j < m; j++) way[j] = q1[j] - here->q[j];
            if (size > SETTLED) {
                for (int64_t j = 0; j < m; j++) room.half[j] = 0.5 * (v0[j] + v1[j]);
                configure_halfway(body, need, here, there, middle);
                kinetic_gradient(body, middle, room.half, &room.flow, room.gradient);
                modal_force(body, loads, 1, middle, 0, room.scratch, room.pushed);
                if (potential && loads->has_moments) modal_force(body, loads, 0, middle, 0, room.scratch, room.bare);
            }
            excess_momentum(body, there, v1, &room.flow, impulse);
            for (int64_t j = 0; j < m; j++) impulse[j] -= momentum[j];
            /* The factor c of (15), which makes the work of the mean that of loads less what kinetic energy gains. */
            double kinetic = dot(v1, impulse, r);
            for (int64_t j = 0; j < r; j++) kinetic += (v1[j] - v0[j]) * momentum[j];
            double bracket = dot(impulse, way, r) / h - dot(room.gradient, way, m) - 0.5 * kinetic;
            double reach = start_size + dot(v1, v1, r) + fabs(start_energy);
            if (potential) {
                const double *conservative = loads->has_moments ? room.bare : room.pushed;
                const double work = force_work(body, loads, there);
                bracket += work - start_work - dot(conservative, way, m);
                reach += load_size + fabs(work);
            }
            const double square = dot(way, way, m), round_off = ROUND_OFF * reach;
            const double correction = square > 0.0 && fabs(bracket) > round_off ? bracket / square : 0.0;
            uncertain = correction != 0.0 ? NOISE * round_off / square : 0.0;
            for (int64_t j = 0; j < m; j++) force[j] = room.pushed[j] + room.gradient[j] + correction * way[j] - impulse[j] / h;
            stretch_at(body, q1, &room.stretch);
            subtract_stretch_force(body, &room.stretched, &room.stretch, force);
            for (int64_t j = 0; j < m; j++) change[j] = mean[j] - force[j];
            if (round == 1) {
                /* The mass where the step is foreseen to end. */
                excess_mass(body, there, &room.flow, room.mass);
                for (int64_t i = 0; i < r; i++)
                    for (int64_t j = 0; j < r; j++)
                        room.chord[i * r + j] = (i == j ? 1.0 : 0.0) + room.mass[i * r + j] * rule->gv[j] / h;
                if (!lu_factor(room.chord, body->pivot, r)) return UNSETTLED;
            }
            lu_solve(room.chord, body->pivot, change, r, 1);
            learn(room.size, mean, m, round, &pairs, room.seen, change);
            double moved = 0.0, sized = 0.0, blurred = 0.0;
            for (int64_t j = 0; j < m; j++) {
                const double blur = uncertain * way[j];
                mean[j] -= change[j];
                q1[j] = room.free_q[j] + rule->gq[j] * mean[j];
                v1[j] = room.free_v[j] + rule->gv[j] * mean[j];
                const double reached = p->weight[j] * q1[j];
                moved += room.size[j] * change[j] * change[j];
                sized += reached * reached + v1[j] * v1[j];
                blurred += room.size[j] * blur * blur;
            }
            const double scale = sqrt(sized);
            size = scale > 0.0 ? sqrt(moved) / scale : 0.0;
            if (!isfinite(size)) return UNSETTLED;
            const double rate = size < before ? size / before : 1.0;
            settled = size * rate * scale <= fmax(TOLERANCE * scale, sqrt(blurred));
            before = size;
        }
        configure_linear(body, need, q1, there);
        configure_places(body, need, there);
        excess_momentum(body, there, v1, &room.flow, momentum);
        end_force(body, loads, there, v1, &room, end);
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
    remember(body, need, here);
    memcpy(q, here->q, (size_t)m * sizeof(double));
    memcpy(v, v0, (size_t)m * sizeof(double));
    return DONE;
}
