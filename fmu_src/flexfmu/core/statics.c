#include "statics.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "forces.h"
#include "tree.h"

/* Newton converges in 4 to 6 rounds or not at all; more increments are cheaper than more rounds. */
enum { MOST_ROUNDS = 15 };
/* Change of Omega q relative to it; the last round squares it. */
static const double TOLERANCE = 1e-9;
/* Round-off leaves a tangent that has a potential symmetric to this. */
static const double SYMMETRIC = 1e-9;
/* Halving the increment ten times: a load that still fails is at a limit point. */
static const double SMALLEST_INCREMENT = 1.0 / 1024.0;

/* What a round costs, in internal steps of ordinary cost. */
static const double STEPS_PER_ROUND = 20.0;

typedef struct {
    Configuration at;
    Loads loads;
    Stretch stretch;
    ForceRoom scratch;
    TangentRoom rest;
    Foreseen foreseen;
    double *inputs, *trial, *residual, *change, *tangent, *factor, *tense, *start, *between;
} Room;

static void take_room(const Body *body, Arena *arena, Room *room) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    take_configuration(body, arena, &room->at);
    take_loads(body, arena, &room->loads);
    take_stretch(body, arena, &room->stretch);
    room->inputs = take(arena, p->loads);
    room->between = take(arena, p->loads);
    room->trial = take(arena, m);
    room->start = take(arena, m);
    room->residual = take(arena, m);
    room->change = take(arena, m);
    room->tangent = take(arena, m * m);
    room->factor = take(arena, m * m);
    room->tense = take(arena, 12 * p->ties);
    take_force_room(body, arena, &room->scratch);
    take_tangent_room(body, arena, &room->rest);
    take_foreseen(body, arena, &room->foreseen);
}

void statics_demand(const Body *body, Arena *arena) {
    Room room;
    take_room(body, arena, &room);
}

/* Without a potential it is not symmetric, and its symmetric part may be indefinite where the body is stable. */
int stable_tangent(const double *tangent, double *factor, int64_t m, Slice *slice) {
    double off = 0.0, most = 0.0;
    const Rows now = rows_due(slice, m, (double)(12 * m));
    for (int64_t i = now.at; i < now.end; i++)
        for (int64_t j = 0; j < m; j++) {
            if (!isfinite(tangent[i * m + j])) return fails(slice);
            factor[i * m + j] = 0.5 * (tangent[i * m + j] + tangent[j * m + i]);
        }
    if (cholesky(factor, m, slice)) return 1;
    for (int64_t i = 0; i < m; i++)
        for (int64_t j = 0; j < m; j++) {
            off = fmax(off, fabs(tangent[i * m + j] - tangent[j * m + i]));
            most = fmax(most, fabs(tangent[i * m + j]));
        }
    if (off <= SYMMETRIC * most) return fails(slice);
    if (slice) slice->failed = FAILED_PIECEMEAL;
    if (slice) return 0;
    memcpy(factor, tangent, (size_t)(m * m) * sizeof(double));
    return smallest_real_part(factor, m) > 0.0;
}

/* Newton's method from q, overwritten where it ends in a stable equilibrium: 1. */
static int newton(Body *body, Room *room, double *q, int64_t *rounds) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    const double noise = p->tied ? p->tie_noise[0] : 0.0;
    int foreseen = 0;
    memcpy(room->trial, q, (size_t)m * sizeof(double));
    spread(body, room->inputs, &room->loads);
    for (int round = 1; round <= MOST_ROUNDS; round++) {
        ++*rounds;
        configure(body, room->trial, &room->at);
        modal_force(body, &room->loads, 1, &room->at, 0, &room->scratch, room->residual);
        stretch_at(body, room->trial, &room->stretch);
        subtract_stretch_force(body, &room->stretch, &room->stretch, room->residual);
        /* With the tension that the last round foresaw: that of stiff springs which do not quite fit yet leads astray. */
        tangent_stiffness(body, &room->loads, 1, &room->at, foreseen ? room->tense : 0, &room->rest, room->tangent);
        /* Scaled by Omega the tangent is one and something small, and errors are measured in energy. */
        for (int64_t i = 0; i < m; i++) {
            double force = room->residual[i];
            if (p->tied) force += dot(p->tie_initial + i * m, room->trial, m);
            room->change[i] = (body->opened->stiffness[i] * room->trial[i] - force) / p->omega[i];
            for (int64_t j = 0; j < m; j++) room->tangent[i * m + j] /= p->omega[i] * p->omega[j];
        }
        if (!stable_tangent(room->tangent, room->factor, m, 0)) return 0;
        if (!lu_factor(room->tangent, body->pivot, m, 0)) return 0;
        lu_solve(room->tangent, body->pivot, room->change, m, 1, 0);
        const double size = norm(room->change, m);
        double whole = 0.0;
        for (int64_t j = 0; j < m; j++) {
            room->residual[j] = -room->change[j] / p->omega[j];
            room->trial[j] += room->residual[j];
            whole += body->opened->stiffness[j] * room->trial[j] * room->trial[j];
        }
        if (p->tied) {
            foreseen_tension(body, &room->at, room->residual, &room->foreseen, room->tense);
            foreseen = 1;
        }
        if (!isfinite(size)) return 0;
        if (size <= fmax(TOLERANCE * sqrt(whole), noise)) {
            memcpy(q, room->trial, (size_t)m * sizeof(double));
            return 1;
        }
    }
    return 0;
}

/* Places between two equilibria at which a body must be stable: else it has snapped, or buckled the other way. */
enum { BETWEEN = 3 };

/* Whether an equilibrium under room->inputs follows stably from room->start, one under a smaller part of the loads. */
static int follows(Body *body, Room *room, const double *q, double earlier) {
    const int64_t m = body->p->modes;
    /* Between equilibria of a cut body its stiff springs do not fit, and their tension tells nothing. */
    if (body->p->ties) return 1;
    for (int k = 1; k <= BETWEEN; k++) {
        const double part = (double)k / (BETWEEN + 1), less = earlier + part * (1.0 - earlier);
        for (int64_t j = 0; j < m; j++) room->trial[j] = room->start[j] + part * (q[j] - room->start[j]);
        for (int64_t i = 0; i < body->p->loads; i++) room->between[i] = less * room->inputs[i];
        spread(body, room->between, &room->loads);
        configure(body, room->trial, &room->at);
        tangent_stiffness(body, &room->loads, 1, &room->at, 0, &room->rest, room->tangent);
        for (int64_t i = 0; i < m; i++)
            for (int64_t j = 0; j < m; j++) room->tangent[i * m + j] /= body->p->omega[i] * body->p->omega[j];
        if (!stable_tangent(room->tangent, room->factor, m, 0)) return 0;
    }
    return 1;
}

int body_static(Body *body, const double *inputs, double *q, double *share, int64_t *rounds) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Arena arena = work_arena(body);
    Room room;
    take_room(body, &arena, &room);
    *share = 0.0;
    *rounds = 0;
    if (arena.refused) return FLEX_NO_ROOM;
    if (p->rigid) return FLEX_FREE;
    spread(body, inputs, &room.loads);
    for (int64_t j = 0; j < m; j++) q[j] = room.loads.active ? 0.0 : room.loads.constant[j] / body->opened->stiffness[j];
    double reached = room.loads.active ? 0.0 : 1.0, increment = 1.0;
    while (reached < 1.0) {
        const double target = fmin(1.0, reached + increment);
        if ((double)*rounds * STEPS_PER_ROUND >= body->limits.most) {
            *share = reached;
            return FLEX_TOO_MUCH_WORK;
        }
        for (int64_t i = 0; i < p->loads; i++) room.inputs[i] = target * inputs[i];
        memcpy(room.start, q, (size_t)m * sizeof(double));
        int found = newton(body, &room, q, rounds);
        if (found && !follows(body, &room, q, reached / target)) {
            memcpy(q, room.start, (size_t)m * sizeof(double));
            found = 0;
        }
        if (found) {
            reached = target;
            increment *= 2.0;
        } else {
            increment *= 0.5;
            if (increment < SMALLEST_INCREMENT) {
                *share = reached;
                return FLEX_BEYOND_CRITICAL;
            }
        }
    }
    *share = 1.0;
    for (int64_t j = 0; j < m; j++)
        if (!isfinite(q[j])) return FLEX_NOT_FINITE;
    return FLEX_OK;
}
