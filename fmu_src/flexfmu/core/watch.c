/* What tells how far a body is to be trusted: rotation within its frames, stability, stiffness that its method misses; and
 * its compliance. docs/theory.md section 7. */
#include <math.h>
#include <string.h>

#include "internal.h"

/* Tangent of the elastic coordinates over the unloaded one, and workspaces. */
typedef struct {
    Configuration at;
    Loads loads;
    double *tangent, *unloaded, *scaled, *lower, *shapes, *values, *rest, *operator_, *translation, *spin, *gaps, *row;
    double *motion, *change, *scratch, *unit, *force, *tense;
    Pull pull;
} Room;

static void take_room(const Body *body, Arena *arena, Room *room) {
    const Program *p = &body->p;
    const int64_t m = p->modes, n = p->nodes, most = 6 * p->interfaces * m;
    take_configuration(body, arena, &room->at);
    take_loads(body, arena, &room->loads);
    room->tangent = take(arena, m * m);
    room->unloaded = take(arena, p->tied * m * m);
    room->scaled = take(arena, m * m);
    room->lower = take(arena, m * m);
    room->shapes = take(arena, m * m);
    room->values = take(arena, m);
    room->rest = take(arena, tangent_size(body));
    room->operator_ = take(arena, 6 * n * m);
    room->translation = take(arena, 3 * n * m);
    room->spin = take(arena, 3 * n * m);
    room->gaps = take(arena, gap_derivative_size(body));
    room->row = take(arena, m);
    room->motion = take(arena, most);
    room->change = take(arena, most);
    room->scratch = take(arena, modal_force_size(body) + foreseen_tension_size(body));
    room->unit = take(arena, 6 * n + pass_back_size(body));
    room->force = take(arena, 2 * m);
    room->tense = take(arena, 12 * p->ties);
    take_pull(body, arena, &room->pull);
}

int64_t watch_size(const Body *body) {
    Arena count = {0, 0};
    Room room;
    take_room(body, &count, &room);
    return count.used;
}

double body_rotations(Body *body, const double *q, double *angles) {
    const Program *p = &body->p;
    double largest = 0.0;
    for (int64_t i = 0; i < p->turnings; i++) {
        double turned[3];
        rows_times(p->turning + 3 * i * p->modes, q, turned, 3, p->modes);
        const double square = dot(turned, turned, 3);
        if (angles) angles[i] = sqrt(square);
        if (!(square <= largest)) largest = square;
    }
    return sqrt(largest);
}

/* The scaled tangent (e, e) in room->scaled, e is returned. */
static int64_t scaled_tangent(Body *body, const double *inputs, const double *q, Room *room) {
    const Program *p = &body->p;
    const int64_t m = p->modes, e = p->elastic_count, first = p->elastic_first;
    configure(body, q, &room->at);
    spread(body, inputs, &room->loads);
    tangent_stiffness(body, &room->loads, 1, &room->at, 0, room->rest, room->tangent);
    if (!p->tied) {
        for (int64_t i = 0; i < e; i++)
            for (int64_t j = 0; j < e; j++) {
                const int64_t a = (first + i) * m + first + j, b = (first + j) * m + first + i;
                room->scaled[i * e + j] = 0.5 * (room->tangent[a] + room->tangent[b]) / (p->omega[first + i] * p->omega[first + j]);
            }
        return e;
    }
    /* Turned frames stretch the modes' linear springs without any cause: what the tangent has to be compared with is the
     * material's own stiffness and that of the ties where they are now. */
    full_operator(body, &room->at, room->operator_);
    node_jacobians(body, &room->at, room->operator_, room->translation, room->spin);
    gap_derivative(body, &room->at, room->translation, room->spin, room->gaps);
    for (int64_t i = 0; i < m * m; i++) room->unloaded[i] = (i % (m + 1) == 0 ? body->stiffness[i / (m + 1)] : 0.0) - p->tie_initial[i];
    for (int64_t i = 0; i < 12 * p->ties; i++) {
        const double k = p->tie_stiffness[3 * (i / 12) + i % 3];
        for (int64_t j = 0; j < m; j++) room->row[j] = k * room->gaps[i * m + j];
        add_transposed_product(room->gaps + i * m, room->row, room->unloaded, 1, m, m);
    }
    for (int64_t i = 0; i < m; i++)
        for (int64_t j = 0; j < m; j++) {
            room->lower[i * m + j] = 0.5 * (room->unloaded[i * m + j] + room->unloaded[j * m + i]);
            room->scaled[i * m + j] = 0.5 * (room->tangent[i * m + j] + room->tangent[j * m + i]);
        }
    if (!cholesky(room->lower, m)) {
        /* The ties' own springs are unstable: nothing is left of stability. */
        memset(room->scaled, 0, (size_t)(m * m) * sizeof(double));
        return m;
    }
    congruent(room->lower, room->scaled, m);
    return m;
}

double body_stability(Body *body, const double *inputs, const double *q, double *shape) {
    const int64_t first = body->p.tied ? 0 : body->p.elastic_first;
    Arena arena = work_arena(body);
    Room room;
    take_room(body, &arena, &room);
    const int64_t e = scaled_tangent(body, inputs, q, &room);
    for (int64_t i = 0; i < e * e; i++)
        if (!isfinite(room.scaled[i])) return NAN;
    symmetric_eigen(room.scaled, room.values, room.shapes, e);
    if (shape) {
        memset(shape, 0, (size_t)body->p.modes * sizeof(double));
        for (int64_t i = 0; i < e; i++) shape[first + i] = room.shapes[i * e];
    }
    return room.values[0];
}

int body_is_stable(Body *body, const double *inputs, const double *q, double margin) {
    Arena arena = work_arena(body);
    Room room;
    take_room(body, &arena, &room);
    const int64_t e = scaled_tangent(body, inputs, q, &room);
    for (int64_t i = 0; i < e; i++) room.scaled[i * e + i] -= margin;
    return cholesky(room.scaled, e);
}

double body_softening(Body *body, const double *inputs, const double *q, const double *shape) {
    const int64_t first = body->p.tied ? 0 : body->p.elastic_first;
    Arena arena = work_arena(body);
    Room room;
    take_room(body, &arena, &room);
    const int64_t e = scaled_tangent(body, inputs, q, &room);
    double whole = 0.0, left = 0.0;
    for (int64_t i = 0; i < e; i++) {
        whole += shape[first + i] * shape[first + i];
        left += shape[first + i] * dot(room.scaled + i * e, shape + first, e);
    }
    return whole - left;
}

/* true = 1 + sum of loads times `change`, and what is missed of it. */
static void judged(const Body *body, const double *inputs, double *change, double *missed) {
    const int64_t e = body->p.elastic_count;
    for (int64_t i = 0; i < e * e; i++) change[i] = i % (e + 1) == 0 ? 1.0 : 0.0;
    memset(missed, 0, (size_t)(e * e) * sizeof(double));
    add_rows(inputs, body->p.judge_change, change, body->p.loads, e * e);
    add_rows(inputs, body->p.judge_missed, missed, body->p.loads, e * e);
}

int body_may_miss(Body *body, const double *inputs, double limit) {
    const Program *p = &body->p;
    const int64_t e = p->elastic_count;
    if (!p->judged) return 0;
    double stiffness = 1.0, missed = 0.0;
    for (int64_t i = 0; i < p->loads; i++) {
        stiffness -= fabs(inputs[i]) * p->judge_bound[i];
        missed += fabs(inputs[i]) * p->judge_missed_bound[i];
    }
    /* A bound that costs next to nothing. */
    if (missed <= limit * (stiffness - missed)) return 0;
    if (limit >= 1.0) return 1;
    Arena arena = work_arena(body);
    double *change = take(&arena, e * e), *off = take(&arena, e * e), *sum = take(&arena, e * e);
    judged(body, inputs, change, off);
    for (int64_t i = 0; i < e * e; i++) sum[i] = limit / (1.0 - limit) * change[i] - off[i];
    if (!cholesky(sum, e)) return 1;
    for (int64_t i = 0; i < e * e; i++) sum[i] = limit / (1.0 + limit) * change[i] + off[i];
    return !cholesky(sum, e);
}

double body_missed(Body *body, const double *inputs, double *margin) {
    const int64_t e = body->p.elastic_count;
    if (margin) *margin = 1.0;
    if (!body->p.judged) return 0.0;
    Arena arena = work_arena(body);
    double *change = take(&arena, e * e), *missed = take(&arena, e * e), *values = take(&arena, e);
    judged(body, inputs, change, missed);
    if (margin) {
        symmetric_eigen(change, values, 0, e);
        *margin = values[0];
        judged(body, inputs, change, missed);
    }
    if (!cholesky(change, e)) return 1.0;
    congruent(change, missed, e);
    symmetric_eigen(missed, values, 0, e);
    if (values[0] <= -0.5) return 1.0;
    double largest = 0.0;
    for (int64_t i = 0; i < e; i++) largest = fmax(largest, fabs(values[i] / (1.0 + values[i])));
    return largest;
}

/* Factors in room->lower of 1 + g_q (T - Lambda) / 2, of the step's own equation with its mean linearised about the step's
 * end: half the loads' stiffness acts at its end, half at its start. 0 where it is singular. */
static int factor_response(Body *body, const double *inputs, double step, const double *q, Room *room, const Rule **used) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    const Rule *rule = rule_of(body, step);
    const double *tense = 0;
    *used = rule;
    configure(body, q, &room->at);
    spread(body, inputs, &room->loads);
    if (p->tied) {
        /* Between steps stiff springs ring; halfway through what they do next, their tension is that of the motion. */
        modal_force(body, &room->loads, 1, &room->at, 0, room->scratch, room->force);
        for (int64_t j = 0; j < m; j++)
            room->force[j] = rule->gq[j] * (room->force[j] + dot(p->tie_initial + j * m, q, m) - body->stiffness[j] * q[j]);
        if (pull_at(body, rule, &room->at, room->unit, body->pivot, &room->pull)) {
            respond(body, rule, &room->pull, room->force, room->row);
            for (int64_t j = 0; j < m; j++) room->row[j] *= 0.5;
            foreseen_tension(body, &room->at, room->row, room->scratch, room->tense);
            tense = room->tense;
        }
    }
    tangent_stiffness(body, &room->loads, 1, &room->at, tense, room->rest, room->tangent);
    for (int64_t i = 0; i < m; i++)
        for (int64_t j = 0; j < m; j++) {
            const double slope = room->tangent[i * m + j] - (i == j ? body->stiffness[i] : 0.0);
            const double coupled = p->tied ? body->coupled[i * m + j] / step : 0.0;
            room->lower[i * m + j] = (i == j ? 1.0 : 0.0) + rule->gq[i] * (0.5 * slope + coupled);
        }
    return lu_factor(room->lower, body->pivot, m);
}

void body_compliance(Body *body, const double *inputs, double step, const double *q, const int64_t *interfaces,
                     int64_t n, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes, size = 3 * m;
    const Rule *rule;
    Arena arena = work_arena(body);
    Room room;
    take_room(body, &arena, &room);
    memset(out, 0, (size_t)(36 * n * n) * sizeof(double));
    if (!factor_response(body, inputs, step, q, &room, &rule)) return;
    full_operator(body, &room.at, room.operator_);
    node_jacobians(body, &room.at, room.operator_, room.translation, room.spin);
    for (int64_t i = 0; i < n; i++) {
        const int64_t k = p->frames + interfaces[i];
        memcpy(room.motion + 6 * i * m, room.translation + k * size, (size_t)size * sizeof(double));
        memcpy(room.motion + (6 * i + 3) * m, room.spin + k * size, (size_t)size * sizeof(double));
    }
    for (int64_t i = 0; i < m; i++)
        for (int64_t k = 0; k < 6 * n; k++) room.change[i * 6 * n + k] = rule->gq[i] * room.motion[k * m + i];
    lu_solve(room.lower, body->pivot, room.change, m, 6 * n);
    product(room.motion, room.change, out, 6 * n, m, 6 * n);
}

void body_derivative(Body *body, const double *inputs, double step, const double *q, const double *direction, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    const Rule *rule;
    Arena arena = work_arena(body);
    Room room;
    take_room(body, &arena, &room);
    memset(out, 0, (size_t)(6 * p->interfaces) * sizeof(double));
    if (!factor_response(body, inputs, step, q, &room, &rule)) return;
    /* Modal forces are linear in the loads. */
    double *with = room.force, *without = room.force + m;
    spread(body, direction, &room.loads);
    modal_force(body, &room.loads, 1, &room.at, 0, room.scratch, with);
    memset(room.row, 0, (size_t)m * sizeof(double));
    memset(room.loads.force, 0, (size_t)(3 * p->nodes) * sizeof(double));
    memset(room.loads.moment, 0, (size_t)(3 * p->nodes) * sizeof(double));
    memset(room.loads.constant, 0, (size_t)m * sizeof(double));
    memset(room.loads.geometric, 0, (size_t)(p->by_load_given * m * m) * sizeof(double));
    modal_force(body, &room.loads, 1, &room.at, 0, room.scratch, without);
    for (int64_t j = 0; j < m; j++) room.row[j] = rule->gq[j] * (with[j] - without[j]);
    lu_solve(room.lower, body->pivot, room.row, m, 1);
    node_rates(body, &room.at, room.row, room.scratch, room.translation, room.spin);
    for (int64_t i = 0; i < p->interfaces; i++) {
        const int64_t k = p->frames + i;
        double vector[3], rotation[9], jacobian[9];
        int64_t pivot[3];
        memcpy(out + 6 * i, room.translation + 3 * k, 3 * sizeof(double));
        memcpy(out + 6 * i + 3, room.spin + 3 * k, 3 * sizeof(double));
        /* A spin turns the rotation vector by T^-1. */
        rotation_vector(room.at.rotation + 9 * k, vector);
        exponential(vector, rotation, jacobian);
        if (lu_factor(jacobian, pivot, 3)) lu_solve(jacobian, pivot, out + 6 * i + 3, 3, 1);
    }
}
