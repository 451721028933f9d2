#include "watch.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "algebra.h"
#include "polynomial.h"
#include "propagation.h"
#include "tree.h"

/* e: elastic coordinates; columns: the loads, then unit loads on the interfaces. */
typedef struct {
    double *change, *missed; /* (e, e) */
    double *lower, *square, *values; /* workspaces (e, e) and (5e + 2) */
    double *loads, *right;           /* (e, columns) */
    double *deflection, *off;        /* (6I, columns) */
    double *found;
    int64_t *pivot;
} Judgement;
/* Numbers found on the way: whether the true stiffness is stable; extremes of what is missed over it; error of interfaces, and
 * the least of all; of one of them, by a disturbance. */
enum { STABLE, LEAST, MOST, WORST, MISSED, OFF, FOUND };

static void take_judgement(const Body *body, Arena *arena, Judgement *room) {
    const int64_t e = body->p->elastic_count, rows = 6 * body->p->interfaces, columns = 1 + rows;
    room->change = take(arena, e * e);
    room->missed = take(arena, e * e);
    room->lower = take(arena, e * e);
    room->square = take(arena, e * e);
    room->values = take(arena, 5 * e + 2);
    room->loads = take(arena, e * columns);
    room->right = take(arena, e * columns);
    room->deflection = take(arena, rows * columns);
    room->off = take(arena, rows * columns);
    room->found = take(arena, FOUND);
    room->pivot = (int64_t *)take(arena, e);
}

void judgement_demand(const Body *body, Arena *arena) {
    Judgement room;
    take_judgement(body, arena, &room);
}

/* out (e, e) = the sum of symmetric matrices, their lower triangles in units, times factors. */
static void sum_of_triangles(const double *factors, const double *unit, const int16_t *triangles, int64_t count, int64_t e, double *out, Slice *slice) {
    const Rows now = rows_due(slice, e, (double)(count * e) * 0.7 + (double)(10 * e));
    for (int64_t k = now.at; k < now.end; k++) {
        /* A short and a long one in turn. */
        const int64_t i = k % 2 == 0 ? k / 2 : e - 1 - k / 2;
        memset(out + i * e, 0, (size_t)(i + 1) * sizeof(double));
        add_strided_shorts(factors, unit, triangles + i * (i + 1) / 2, e * (e + 1) / 2, out + i * e, count, i + 1);
        for (int64_t j = 0; j < i; j++) out[j * e + i] = out[i * e + j];
    }
}

/* true = 1 + sum of loads times `change`, and what is missed of it. */
static void judged(const Body *body, const double *inputs, double *change, double *missed, Slice *slice) {
    const Program *p = body->p;
    const int64_t e = p->elastic_count;
    sum_of_triangles(inputs, p->judge_unit, p->judge_change, p->loads, e, change, slice);
    /* Methods that know of no loads miss all that they do. */
    if (p->judge_missed == p->judge_change)
        copy_rows(change, missed, e, rows_due(slice, e, cost_of_copy(e)));
    else
        sum_of_triangles(inputs, p->judge_unit + p->loads, p->judge_missed, p->loads, e, missed, slice);
    const Rows now = rows_due(slice, e, (double)(2 * e));
    for (int64_t i = now.at * e; i < now.end * e; i++) missed[i] = -missed[i];
    for (int64_t i = now.at; i < now.end; i++) change[i * (e + 1)] += 1.0;
}

int body_might_miss(const Body *body, const double *inputs, double limit) {
    const Program *p = body->p;
    if (!p->judged) return 0;
    double stiffness = 1.0, missed = 0.0;
    for (int64_t i = 0; i < p->loads; i++) {
        stiffness -= fabs(inputs[i]) * p->judge_bound[i];
        missed += fabs(inputs[i]) * p->judge_missed_bound[i];
    }
    return !(missed <= limit * (stiffness - missed));
}

/* Whether share * change + sign * missed is positive definite. */
static int covers(const Judgement *room, double share, double sign, double *sum, int64_t e, Slice *slice) {
    const Rows now = rows_due(slice, e, (double)(2 * e));
    for (int64_t i = now.at * e; i < now.end * e; i++) sum[i] = share * room->change[i] + sign * room->missed[i];
    return cholesky(sum, e, slice);
}

int pieces_of_missing(Body *body, const double *inputs, double limit, Arena arena, Slice *slice) {
    const int64_t e = body->p->elastic_count;
    Judgement room;
    take_judgement(body, &arena, &room);
    if (arena.refused) return 1;
    judged(body, inputs, room.change, room.missed, slice);
    if (limit >= 1.0) return 1;
    const int above = covers(&room, limit / (1.0 - limit), -1.0, room.lower, e, slice);
    if (!above && !slice) return 1;
    return !covers(&room, limit / (1.0 + limit), 1.0, room.square, e, slice) || !above;
}

int body_may_miss(Body *body, const double *inputs, double limit) {
    return body_might_miss(body, inputs, limit) && pieces_of_missing(body, inputs, limit, work_arena(body), 0);
}

/* Disturbance that any loads may come with, as a share of their size: nothing is aligned better. */
static const double DISTURBANCE = 0.01;

/* Of the singular values of (6, 6), in multiplications. */
static const double OF_EIGENVALUES = 6000.0;

/* Largest singular value of the motions (6, 6) of one interface in `x` (6 n, 1 + 6 I) under unit loads on it. */
static double answer_size(const double *x, int64_t interface, int64_t columns) {
    double own[36], square[36] = {0}, values[6];
    for (int i = 0; i < 6; i++) memcpy(own + 6 * i, x + (6 * interface + i) * columns + 1 + 6 * interface, 6 * sizeof(double));
    add_transposed_product(own, own, square, 6, 6, 6);
    symmetric_eigen(square, values, 0, 6);
    return sqrt(fmax(values[5], 0.0));
}

/* What interfaces' motions in `loads` and `right` come to, of the interface that is off most. */
static void find_worst(const Body *body, const double *inputs, const Judgement *room, Slice *slice) {
    const Program *p = body->p;
    const int64_t columns = 1 + 6 * p->interfaces, e = p->elastic_count;
    double *deflection = room->deflection, *off = room->off, disturbance = 0.0;
    const Rows now = rows_due(slice, 6 * p->interfaces, (double)(2 * e * columns));
    for (int64_t i = now.at; i < now.end; i++) {
        product(p->judge_force + i * e, room->right, deflection + i * columns, 1, e, columns);
        product(p->judge_force + i * e, room->loads, off + i * columns, 1, e, columns);
        for (int64_t c = i * columns; c < (i + 1) * columns; c++) {
            deflection[c] /= p->judge_size[i];
            off[c] /= p->judge_size[i];
        }
    }
    for (int64_t l = 0; l < p->loads; l++) disturbance += inputs[l] * p->judge_size[l] * inputs[l] * p->judge_size[l];
    disturbance = DISTURBANCE * sqrt(disturbance);
    for (int64_t k = 0; k < p->interfaces && !over(slice); k++) {
        double error = 0.0, size = 0.0;
        if (due(slice, OF_EIGENVALUES)) room->found[OFF] = answer_size(off, k, columns);
        if (!due(slice, OF_EIGENVALUES)) continue;
        for (int i = 0; i < 6; i++) {
            error += off[(6 * k + i) * columns] * off[(6 * k + i) * columns];
            size += deflection[(6 * k + i) * columns] * deflection[(6 * k + i) * columns];
        }
        error = sqrt(error) + disturbance * room->found[OFF];
        size = fmax(sqrt(size), disturbance * answer_size(deflection, k, columns));
        if (size > 0.0) room->found[WORST] = fmax(room->found[WORST], error / size);
    }
}

/* Of the loads as they are, and of a disturbance that acts on an interface in the worst direction, over the larger of the two
 * deflections. Never more than that of any shape of the body. */
void pieces_of_missed(Body *body, const double *inputs, Arena arena, Slice *slice) {
    const Program *p = body->p;
    const int64_t e = p->elastic_count, columns = 1 + 6 * p->interfaces, rows = 6 * p->interfaces;
    Judgement room;
    take_judgement(body, &arena, &room);
    if (arena.refused) return;
    double *change = room.change, *missed = room.missed, *lower = room.lower, *square = room.square, *found = room.found;
    double *loads = room.loads, *right = room.right;
    if (due(slice, 1.0)) {
        found[MISSED] = 1.0;
        found[STABLE] = found[WORST] = 0.0;
    }
    copy_rows(change, lower, e, rows_due(slice, e, cost_of_copy(e)));
    if (!cholesky(lower, e, slice)) {
        fails(slice);
        return;
    }
    if (due(slice, 1.0)) found[STABLE] = 1.0;
    copy_rows(missed, square, e, rows_due(slice, e, cost_of_copy(e)));
    congruent(lower, square, e, slice);
    Rows now = rows_due(slice, e, (double)(2 * e));
    for (int64_t i = now.at * e; i < now.end * e; i++) lower[i] = -square[i];
    smallest_eigen(square, room.values + e, found + LEAST, room.values, e, slice);
    smallest_eigen(lower, room.values + e, found + MOST, room.values, e, slice);
    if (caught_up(slice) && found[LEAST] <= -0.5) {
        fails(slice);
        return;
    }
    if (over(slice)) return;
    /* The loads, then unit loads on the interfaces, in columns. */
    now = rows_due(slice, e, (double)(4 * (columns + p->loads)));
    for (int64_t i = now.at; i < now.end; i++) {
        loads[i * columns] = 0.0;
        for (int64_t l = 0; l < p->loads; l++) loads[i * columns] += inputs[l] * p->judge_force[l * e + i];
        for (int64_t r = 0; r < rows; r++) loads[i * columns + 1 + r] = p->judge_force[r * e + i] / p->judge_size[r];
        memcpy(right + i * columns, loads + i * columns, (size_t)columns * sizeof(double));
    }
    copy_rows(change, square, e, rows_due(slice, e, cost_of_copy(e)));
    if (!lu_factor(square, room.pivot, e, slice)) return;
    lu_solve(square, room.pivot, right, e, columns, slice);
    now = rows_due(slice, e, (double)(2 * e));
    for (int64_t i = now.at * e; i < now.end * e; i++) change[i] += missed[i];
    if (!lu_factor(change, room.pivot, e, slice)) return;
    lu_solve(change, room.pivot, loads, e, columns, slice);
    now = rows_due(slice, e, (double)columns);
    for (int64_t i = now.at * columns; i < now.end * columns; i++) loads[i] -= right[i];
    find_worst(body, inputs, &room, slice);
    if (!due(slice, 1.0)) return;
    const double of_any_shape = fmax(fabs(found[LEAST] / (1.0 + found[LEAST])), fabs(found[MOST] / (1.0 - found[MOST])));
    found[MISSED] = fmin(1.0, fmin(of_any_shape, found[WORST]));
}

double missed_found(const Body *body, Arena arena, int *stable) {
    Judgement room;
    take_judgement(body, &arena, &room);
    *stable = room.found[STABLE] > 0.0;
    return room.found[MISSED];
}

double body_missed(Body *body, const double *inputs, double *margin) {
    const int64_t e = body->p->elastic_count;
    Arena arena = work_arena(body);
    Judgement room;
    int stable;
    if (margin) *margin = 1.0;
    if (!body->p->judged) return 0.0;
    take_judgement(body, &arena, &room);
    if (arena.refused) return NAN;
    judged(body, inputs, room.change, room.missed, 0);
    if (margin) {
        memcpy(room.square, room.change, (size_t)(e * e) * sizeof(double));
        smallest_eigen(room.square, room.values + e, margin, room.values, e, 0);
    }
    pieces_of_missed(body, inputs, work_arena(body), 0);
    return missed_found(body, work_arena(body), &stable);
}

/* Rotation vector, its derivative, the rotation and T of a body that turns as a whole. */
static void whole_turn(const Program *p, const double *q, const double *v, double *angle, double *rate, double *rotation,
                       double *jacobian) {
    rows_times(p->spin_rotation, q, angle, 3, p->rigid);
    rows_times(p->spin_rotation, v, rate, 3, p->rigid);
    exponential(angle, rotation, jacobian);
}

double body_spin(Body *body, const double *q, const double *v) {
    double angle[3], rate[3], rotation[9], jacobian[9], spin[3];
    if (!body->p->spins) return 0.0;
    whole_turn(body->p, q, v, angle, rate, rotation, jacobian);
    apply(body->p->turns ? rotation : jacobian, rate, spin);
    return norm(spin, 3) / body->p->omega[body->p->rigid];
}

/* Largest linear displacement of an interface by elastic coordinates, or rotation, squared. */
static double linear_reach(const Program *p, int kind, const double *q) {
    const int64_t r = p->rigid, first = kind == BY_TURN ? 3 * p->interfaces : 0;
    double most = 0.0;
    if (all_zero(q, p->modes)) return most;
    for (int64_t i = 0; i < p->interfaces; i++) {
        double square = 0.0;
        for (int c = 0; c < 3; c++) {
            const double moved = dot(p->load_operator + (first + 3 * i + c) * p->modes + r, q + r, p->modes - r);
            square += moved * moved;
        }
        most = fmax(most, square);
    }
    return most;
}

/* The same of where rates carry the undeformed body from there, with `ahead` (m) to work in. */
static double carried_reach(const Program *p, int kind, const double *v, double *ahead) {
    for (int64_t j = p->rigid; j < p->modes; j++) ahead[j] = v[j] / p->omega[j];
    return linear_reach(p, kind, ahead);
}

/* Deflection over the size of the body below which no motion matters. */
static const double UNSEEN = 1e-3;

/* Of the polynomial's error over what the next order makes it: orders after that may add as much again. Of that of steps over what
 * follows it as vibrations of the undeformed body: how errors change forces may add as much. */
static const double BEYOND = 2.0;
/* Of that of softness, which is known along the motion where it is largest: other ways may be softer. */
static const double ELSEWHERE = 1.25;

/* Momentum that the mass of steps leaves out, and how it pushes; where the step is half over. */
typedef struct {
    Polynomial polynomial;
    double *momentum, *push, *q, *v;
} MissedRoom;

static void take_missed(const Body *body, Arena *arena, MissedRoom *room) {
    double **each[] = {&room->momentum, &room->push, &room->q, &room->v};
    take_polynomial(body, arena, &room->polynomial);
    for (int i = 0; i < 4; i++) *each[i] = take(arena, body->p->modes);
}

void inertia_demand(const Body *body, Arena *arena) {
    MissedRoom room;
    take_missed(body, arena, &room);
}

/* How far motion is off where a step ends, and the momentum left out there. */
static void follow_drift(Body *body, const StepEnd *end, double *off, double *rate, double *before) {
    const int64_t m = body->p->modes;
    double on_stack[ON_STACK];
    const Scratch own = onto_stack(body, on_stack);
    Arena arena = work_arena(body);
    body->scratch = own;
    MissedRoom room;
    take_missed(body, &arena, &room);
    if (arena.refused) return;
    const Rule *rule = rule_of(body, end->step);
    for (int64_t j = 0; j < m; j++) {
        room.q[j] = 0.5 * (end->q0[j] + end->q[j]);
        room.v[j] = 0.5 * (end->v0[j] + end->v[j]);
    }
    omitted_gradient(body, room.q, room.v, &room.polynomial, room.push);
    room.polynomial.known = 0;
    omitted_momentum(body, end->q, end->v, &room.polynomial, room.momentum);
    for (int64_t j = 0; j < m; j++) {
        const double mean = room.push[j] - (room.momentum[j] - before[j]) / end->step, was = off[j];
        off[j] = rule->p11[j] * was + rule->p12[j] * rate[j] + rule->gq[j] * mean;
        rate[j] = rule->p21[j] * was + rule->p22[j] * rate[j] + rule->gv[j] * mean;
        before[j] = room.momentum[j];
    }
}

/* Of a mean over a step: what holds amid it, over both ends. */
static const double AMID = 4.0;

/* How far motion is off, where a step ends, by a stiffness of which a share is missed that grows with the energy: of what bodies that
 * are right to second order miss, the first. Resonance makes it grow from period to period. */
static void follow_softness(const Body *body, const StepEnd *end, double *off, double *rate, double *most) {
    const int64_t r = body->p->rigid, m = body->p->modes;
    const double *stiffness = body->opened->stiffness;
    double first = 0.0, amid = 0.0, last = 0.0;
    for (int64_t j = r; j < m; j++) {
        const double q0 = end->q0[j], q1 = end->q[j];
        if (!drifts(body->p, j)) continue;
        first += stiffness[j] * q0 * q0;
        amid += 0.25 * stiffness[j] * (q0 + q1) * (q0 + q1);
        last += stiffness[j] * q1 * q1;
    }
    if (isfinite(last)) *most = fmax(*most, last);
    const Rule *rule = rule_of((Body *)body, end->step);
    for (int64_t j = r; j < m; j++) {
        const double q0 = end->q0[j], q1 = end->q[j], was = off[j];
        if (!drifts(body->p, j)) continue;
        const double mean = stiffness[j] * (first * q0 + AMID * amid * 0.5 * (q0 + q1) + last * q1) / (AMID + 2.0);
        off[j] = rule->p11[j] * was + rule->p12[j] * rate[j] + rule->gq[j] * mean;
        rate[j] = rule->p21[j] * was + rule->p22[j] * rate[j] + rule->gv[j] * mean;
    }
}

int mass_is_exact(const Program *p) { return p->inertial ? !p->mass_products : !p->mass_forms; }

static void follow_error(const Body *body, int cause, double beyond, Astray *so_far) {
    const double least = UNSEEN * body->p->body_size[0];
    if (so_far->off[cause] > 0.0)
        so_far->error[cause] = beyond * sqrt(so_far->off[cause] / fmax(so_far->moved, least * least * so_far->time));
}

void body_off_by_softness(const Body *body, double softer, Astray *so_far) { follow_error(body, BY_SOFTNESS, ELSEWHERE * softer, so_far); }

void body_astray(Body *body, const StepEnd *end, double *drift, const double *astray, double *ahead, Astray *so_far) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    /* Nothing is left out of what does not move. */
    if (!end->zero && !mass_is_exact(p) && (!all_zero(end->v, m) || !all_zero(end->v0, m) || !all_zero(drift, 3 * m))) {
        follow_drift(body, end, drift, drift + m, drift + 2 * m);
        if (!all_finite(drift, 3 * m)) memset(drift, 0, (size_t)(3 * m) * sizeof(double));
    }
    double *soft = drift + 3 * m;
    if (!end->zero) follow_softness(body, end, soft, soft + m, &so_far->energy);
    if (!end->zero && !all_finite(soft, 2 * m)) memset(soft, 0, (size_t)(2 * m) * sizeof(double));
    const double *off[CAUSES] = {drift, astray, soft}, beyond[BY_SOFTNESS] = {p->inertial ? BEYOND : 1.0, BEYOND};
    count_in(&so_far->time, end->step);
    if (!end->zero)
        count_in(&so_far->moved, end->step * fmax(linear_reach(p, BY_SHIFT, end->q), carried_reach(p, BY_SHIFT, end->v, ahead)));
    for (int k = 0; k < CAUSES; k++) {
        if (!end->zero) count_in(&so_far->off[k], end->step * linear_reach(p, BY_SHIFT, off[k]));
        if (k != BY_SOFTNESS) follow_error(body, k, beyond[k], so_far);
    }
}

/* The square of a motion over the largest one yet from which it has grown. */
static const double GROWN = 1.04;

int truncation_settled(const Body *body, const Truncation *so_far) {
    return (so_far->time - so_far->grown) * body->p->omega[body->p->rigid] >= 3.14159265358979323846;
}

/* What is off over what has moved, of both ways; of turns half counts, over turns, or over the deflection by the size. */
static double off_over(const double *mixed, const double *moved, double size, double before) {
    const double shift = fmax(moved[BY_SHIFT], UNSEEN * UNSEEN * size * size), turn = 4.0 * fmax(moved[BY_TURN], shift / (size * size));
    return shift > 0.0 ? sqrt(fmax(mixed[BY_SHIFT] / shift, mixed[BY_TURN] / turn)) : before;
}

void body_truncation(const Body *body, const StepEnd *end, double *ahead, Truncation *so_far) {
    const Program *p = body->p;
    const int64_t m = p->modes, count = p->interfaces;
    const double size = p->body_size[0];
    double mixed[WAYS] = {0.0}, moved[WAYS];
    if (!p->mixed) return;
    count_in(&so_far->time, end->step);
    for (int64_t i = 0; i < p->mixed; i++) {
        const double rate = end->v[p->mixed_mode[i]] * fmin(1.0, p->mixed_drift[i] * so_far->time);
        for (int k = 0; k < WAYS; k++) {
            const double off = p->mixed_reach[k * p->mixed + i] * rate;
            mixed[k] += off * off;
        }
    }
    if (mixed[BY_SHIFT] == 0.0 && mixed[BY_TURN] == 0.0 && end->step > 0.0) return;
    for (int k = 0; k < WAYS; k++) {
        so_far->mixed[k] = fmax(so_far->mixed[k], mixed[k]);
        const double reached = linear_reach(p, k, end->q);
        so_far->moved[k] = fmax(so_far->moved[k], reached);
        count_in(&so_far->whole[k], end->step * reached);
        /* A body that has just been pushed is on its way: to where its rates carry it, and to where the loads would hold it. */
        moved[k] = fmax(so_far->moved[k], carried_reach(p, k, end->v, ahead));
    }
    memset(ahead, 0, (size_t)m * sizeof(double));
    for (int64_t i = 0; i < count; i++) {
        add_rows(end->inputs + 6 * i, p->load_operator + 3 * i * m, ahead, 3, m);
        add_rows(end->inputs + 6 * i + 3, p->load_operator + 3 * (count + i) * m, ahead, 3, m);
    }
    if (p->loads > 6 * count) add_rows(end->inputs + 6 * count, p->inertia_operator, ahead, 3, m);
    for (int64_t j = p->rigid; j < m; j++) ahead[j] /= p->omega[j] * p->omega[j];
    for (int k = 0; k < WAYS; k++) moved[k] = fmax(moved[k], linear_reach(p, k, ahead));
    /* Of loads beyond 1e154 that is no number any more. */
    const double reach = fmin(moved[BY_SHIFT] + size * size * moved[BY_TURN], DBL_MAX);
    if (reach > GROWN * so_far->reach) {
        so_far->reach = reach;
        so_far->grown = so_far->time;
    }
    so_far->error = off_over(so_far->mixed, moved, size, so_far->error);
    for (int k = 0; k < WAYS && so_far->time > 0.0; k++) moved[k] = fmin(moved[k], so_far->whole[k] / so_far->time);
    so_far->mean = fmax(so_far->error, off_over(so_far->mixed, moved, size, so_far->mean));
}

/* Share of a moment below which the model hardly feels it, near full turns: what it is cannot be told from the motion. */
static const double UNFELT = 0.05;

void body_momentum(Body *body, const double *q, const double *v, Momentum *so_far) {
    const Program *p = body->p;
    double angle[3], rate[3], middle[3], rotation[9], jacobian[9], other[9], square[9] = {0}, values[3], axes[9], change[3];
    double felt[3], moment[3] = {0}, spin[3], turned[3], momentum[3], off[3];
    if (!p->spin_inertia_given) return;
    whole_turn(p, q, v, angle, rate, rotation, jacobian);
    /* The model's own law is I theta'' = Tᵀ M: from it follow the moments, whatever exerts them. */
    for (int i = 0; i < 3; i++) {
        middle[i] = 0.5 * (so_far->angle[i] + angle[i]);
        change[i] = rate[i] - so_far->rate[i];
    }
    double turn[9];
    exponential(middle, turn, other);
    apply(p->spin_inertia, change, felt);
    /* The least moment with Tᵀ M = felt: T (Tᵀ T)^-1, its small eigenvalues left out. */
    add_transposed_product(other, other, square, 3, 3, 3);
    symmetric_eigen(square, values, axes, 3);
    for (int k = 0; k < 3; k++) {
        if (!(values[k] > UNFELT * UNFELT * values[2])) continue;
        double along = 0.0, column[3];
        for (int i = 0; i < 3; i++) {
            column[i] = axes[3 * i + k];
            along += column[i] * felt[i] / values[k];
        }
        apply(other, column, turned);
        for (int i = 0; i < 3; i++) moment[i] += along * turned[i];
    }
    apply(jacobian, rate, spin);
    apply_back(rotation, spin, turned);
    apply(p->spin_inertia, turned, spin);
    apply(rotation, spin, momentum);
    for (int i = 0; i < 3; i++) {
        so_far->impulse[i] += moment[i];
        so_far->angle[i] = angle[i];
        so_far->rate[i] = rate[i];
        off[i] = momentum[i] - so_far->impulse[i];
    }
    so_far->largest = fmax(so_far->largest, fmax(norm(so_far->impulse, 3), norm(momentum, 3)));
    so_far->drift = so_far->largest > 0.0 ? norm(off, 3) / so_far->largest : 0.0;
}
