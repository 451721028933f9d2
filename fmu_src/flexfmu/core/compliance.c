#include "compliance.h"

#include <string.h>

#include "algebra.h"
#include "forces.h"
#include "propagation.h"
#include "rates.h"
#include "ties.h"
#include "tree.h"

typedef struct {
    Configuration at;
    Loads loads;
    ForceRoom scratch;
    TangentRoom rest;
    Foreseen foreseen;
    Jacobians of;
    Pull pull;
    Rates rates;
    double *tangent, *lower, *row, *force, *tense;
    double *motion, *change; /* (6I, m) and (m, 6I) */
} Room;

static void take_room(const Body *body, Arena *arena, Room *room) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    take_configuration(body, arena, &room->at);
    take_loads(body, arena, &room->loads);
    take_force_room(body, arena, &room->scratch);
    take_tangent_room(body, arena, &room->rest);
    take_foreseen(body, arena, &room->foreseen);
    take_jacobians(body, arena, &room->of);
    take_pull(body, arena, &room->pull);
    take_rates(body, arena, &room->rates);
    room->tangent = take(arena, m * m);
    room->lower = take(arena, m * m);
    room->row = take(arena, m);
    room->force = take(arena, 2 * m);
    room->tense = take(arena, 12 * p->ties);
    room->motion = take(arena, 6 * p->interfaces * m);
    room->change = take(arena, 6 * p->interfaces * m);
}

void compliance_demand(const Body *body, Arena *arena) {
    Room room;
    take_room(body, arena, &room);
}

/* Factors in room->lower of 1 + g_q (T - Lambda) / 2, of the step's own equation with its mean linearised about the step's
 * end: half the loads' stiffness acts at its end, half at its start. 0 where it is singular. */
static int factor_response(Body *body, const double *inputs, double step, const double *q, Room *room, const Rule **used) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    const Rule *rule = rule_of(body, step);
    const double *tense = 0;
    *used = rule;
    configure(body, q, &room->at);
    spread(body, inputs, &room->loads);
    if (p->tied) {
        /* Between steps stiff springs ring; halfway through what they do next, their tension is that of the motion. */
        modal_force(body, &room->loads, 1, &room->at, 0, &room->scratch, room->force);
        for (int64_t j = 0; j < m; j++)
            room->force[j] = rule->gq[j] * (room->force[j] + dot(p->tie_initial + j * m, q, m) - body->opened->stiffness[j] * q[j]);
        if (pull_at(body, rule, &room->at, &room->at, body->pivot, &room->pull)) {
            respond(body, rule, &room->pull, room->force, 0, room->row);
            for (int64_t j = 0; j < m; j++) room->row[j] *= 0.5;
            foreseen_tension(body, &room->at, room->row, &room->foreseen, room->tense);
            tense = room->tense;
        }
    }
    tangent_stiffness(body, &room->loads, 1, &room->at, tense, &room->rest, room->tangent);
    for (int64_t i = 0; i < m; i++)
        for (int64_t j = 0; j < m; j++) {
            const double slope = room->tangent[i * m + j] - (i == j ? body->opened->stiffness[i] : 0.0);
            const double coupled = crossed(p) ? body->coupled[i * m + j] / step : 0.0;
            room->lower[i * m + j] = (i == j ? 1.0 : 0.0) + rule->gq[i] * (0.5 * slope + coupled);
        }
    return lu_factor(room->lower, body->pivot, m, 0);
}

/* Derivative (m) of the modal force by a load: force or moment `c` on an interface, whose motion is `motion` (6, m). */
static void force_by_load(const Body *body, const Configuration *at, int64_t interface, int c, const double *motion, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes, k = p->frames + interface, load = 6 * interface + c;
    const double *moved = p->load_operator + 3 * interface * m, *turned = p->load_operator + 3 * (p->interfaces + interface) * m;
    int follows = 0;
    for (int64_t i = 0; i < p->followers; i++) follows |= p->follower[i] == interface;
    if (follows) {
        memset(out, 0, (size_t)m * sizeof(double));
        for (int i = 0; i < 3; i++) add_rows(at->rotation + 9 * k + 3 * i + c % 3, motion + (3 * (c / 3) + i) * m, out, 1, m);
    } else if (p->placement == PLACE_DEFORMED) {
        memcpy(out, motion + c * m, (size_t)m * sizeof(double));
    } else {
        memcpy(out, c < 3 ? moved + c * m : turned + (c - 3) * m, (size_t)m * sizeof(double));
        if (p->placement == PLACE_CORRECTIVE_MOMENT && c < 3) {
            double displacement[3], unit[3] = {0.0, 0.0, 0.0}, moment[3];
            for (int i = 0; i < 3; i++) displacement[i] = at->position[3 * k + i] - p->point[3 * k + i];
            unit[c] = 1.0;
            cross(displacement, unit, moment);
            add_rows(moment, turned, out, 3, m);
        }
    }
    if (p->by_load_given)
        for (int64_t i = 0; i < m; i++) out[i] -= dot(p->by_load + (load * m + i) * m, at->q, m);
}

int body_compliance(Body *body, const double *inputs, double step, const double *q, const int64_t *interfaces,
                     int64_t n, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes, size = 3 * m;
    const Rule *rule;
    Arena arena = work_arena(body);
    Room room;
    /* The room is that of every interface once. */
    if (n > p->interfaces) return FLEX_NO_ROOM;
    for (int64_t i = 0; i < n; i++)
        if (interfaces[i] < 0 || interfaces[i] >= p->interfaces) return FLEX_NO_ROOM;
    take_room(body, &arena, &room);
    if (arena.refused) return FLEX_NO_ROOM;
    memset(out, 0, (size_t)(36 * n * n) * sizeof(double));
    if (!factor_response(body, inputs, step, q, &room, &rule)) return FLEX_OK;
    jacobians_at(body, &room.at, &room.of);
    for (int64_t i = 0; i < n; i++) {
        const int64_t k = p->frames + interfaces[i];
        memcpy(room.motion + 6 * i * m, room.of.translation + k * size, (size_t)size * sizeof(double));
        memcpy(room.motion + (6 * i + 3) * m, room.of.spin + k * size, (size_t)size * sizeof(double));
    }
    for (int64_t k = 0; k < 6 * n; k++) {
        force_by_load(body, &room.at, interfaces[k / 6], (int)(k % 6), room.motion + k / 6 * 6 * m, room.row);
        for (int64_t i = 0; i < m; i++) room.change[i * 6 * n + k] = rule->gq[i] * room.row[i];
    }
    lu_solve(room.lower, body->pivot, room.change, m, 6 * n, 0);
    product(room.motion, room.change, out, 6 * n, m, 6 * n);
    return FLEX_OK;
}

int body_derivative(Body *body, const double *inputs, double step, const double *q, const double *direction, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    const Rule *rule;
    Arena arena = work_arena(body);
    Room room;
    take_room(body, &arena, &room);
    if (arena.refused) return FLEX_NO_ROOM;
    memset(out, 0, (size_t)(6 * p->interfaces) * sizeof(double));
    if (!factor_response(body, inputs, step, q, &room, &rule)) return FLEX_OK;
    /* Modal forces are linear in the loads. */
    double *with = room.force, *without = room.force + m;
    spread(body, direction, &room.loads);
    modal_force(body, &room.loads, 1, &room.at, 0, &room.scratch, with);
    memset(room.row, 0, (size_t)m * sizeof(double));
    memset(room.loads.force, 0, (size_t)(3 * p->nodes) * sizeof(double));
    memset(room.loads.moment, 0, (size_t)(3 * p->nodes) * sizeof(double));
    memset(room.loads.constant, 0, (size_t)m * sizeof(double));
    room.loads.following = 0;
    memset(room.loads.geometric, 0, (size_t)(p->by_load_given * m * m) * sizeof(double));
    modal_force(body, &room.loads, 1, &room.at, 0, &room.scratch, without);
    for (int64_t j = 0; j < m; j++) room.row[j] = rule->gq[j] * (with[j] - without[j]);
    lu_solve(room.lower, body->pivot, room.row, m, 1, 0);
    node_rates(body, 0, &room.at, room.row, &room.rates);
    for (int64_t i = 0; i < p->interfaces; i++) {
        const int64_t k = p->frames + i;
        double vector[3], rotation[9], jacobian[9];
        int64_t pivot[3];
        memcpy(out + 6 * i, room.rates.velocity + 3 * k, 3 * sizeof(double));
        memcpy(out + 6 * i + 3, room.rates.spin + 3 * k, 3 * sizeof(double));
        /* A spin turns the rotation vector by T^-1. */
        rotation_vector(room.at.rotation + 9 * k, vector);
        exponential(vector, rotation, jacobian);
        if (lu_factor(jacobian, pivot, 3, 0)) lu_solve(jacobian, pivot, out + 6 * i + 3, 3, 1, 0);
    }
    return FLEX_OK;
}
