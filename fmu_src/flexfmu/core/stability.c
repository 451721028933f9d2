#include "stability.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "forces.h"
#include "opened.h"
#include "tree.h"

/* Growth of vibrations over the lowest frequency that is none but round-off. */
static const double FLUTTER = 1e-6;

/* Tangent of the elastic coordinates over the unloaded one, and what it is made in; its softest shape. */
typedef struct {
    Configuration at;
    Loads loads;
    TangentRoom rest;
    double *tangent, *unloaded, *scaled, *lower, *shapes, *values, *gaps, *row, *alone, *shape, *found;
    double *state; /* (2e, 2e) with loads that turn with the body */
} Room;
/* Numbers found on the way: the smallest eigenvalue; what each load by itself leaves of it in its shape, and what is left
 * without loads. */
enum { SMALLEST, BY_LOADS };

/* A room fits where it is kept. */
typedef char Fits[sizeof(Room) <= LAID_OUT * sizeof(double) ? 1 : -1];

/* What lies in the arena from call to call; null where it is refused. */
static Room *room_in(const Body *body, Arena *arena, const Slice *slice) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Room none, *kept = (Room *)take(arena, LAID_OUT), *room = kept ? kept : &none;
    if (kept && laid_out(slice)) return kept;
    take_configuration(body, arena, &room->at);
    take_loads(body, arena, &room->loads);
    take_tangent_room(body, arena, &room->rest);
    room->tangent = take(arena, m * m);
    room->unloaded = take(arena, p->tied * m * m);
    room->scaled = take(arena, m * m);
    room->lower = take(arena, m * m);
    room->shapes = take(arena, m * m);
    room->values = take(arena, 4 * m + 2);
    room->gaps = take(arena, 12 * p->ties * m);
    room->row = take(arena, m);
    room->alone = take(arena, p->loads);
    room->shape = take(arena, m);
    room->found = take(arena, BY_LOADS + p->loads + 1);
    room->state = take(arena, p->followers ? 4 * p->elastic_count * p->elastic_count : 0);
    return arena->refused ? 0 : kept;
}

void stability_demand(const Body *body, Arena *arena) { room_in(body, arena, 0); }

/* Where a thin sheet has turned by a degree, what bends it lies in what was its own plane, and is no softer for that. */
static const double STIFFEST = 10.0;

double unloaded_frequency(const Program *p, int64_t i) {
    return p->stretches ? fmin(p->omega[i], STIFFEST * p->omega[p->elastic_first]) : p->omega[i];
}

/* The scaled tangent (e, e) in room->scaled of the body as room->at is configured, e is returned. */
static int64_t scaled_tangent(Body *body, const double *inputs, Room *room) {
    const Program *p = body->p;
    const int64_t m = p->modes, e = p->elastic_count, first = p->elastic_first;
    Slice *slice = body->slice;
    Rows now;
    if (due(slice, (double)(3 * p->loads * m + 2 * p->by_load_given * p->loads * m * m))) spread(body, inputs, &room->loads);
    tangent_stiffness(body, &room->loads, 1, &room->at, 0, &room->rest, room->tangent);
    if (!p->tied) {
        now = rows_due(slice, e, (double)(12 * e));
        for (int64_t i = now.at; i < now.end; i++)
            for (int64_t j = 0; j < e; j++) {
                const int64_t a = (first + i) * m + first + j, b = (first + j) * m + first + i;
                const double unloaded = unloaded_frequency(p, first + i) * unloaded_frequency(p, first + j);
                room->scaled[i * e + j] = 0.5 * (room->tangent[a] + room->tangent[b]) / unloaded;
            }
        return e;
    }
    /* Turned frames stretch the modes' linear springs without any cause: what the tangent has to be compared with is the
     * material's own stiffness and that of the ties where they are now. */
    gap_derivative(body, &room->at, &room->rest.of, room->gaps);
    now = rows_due(slice, m, (double)(2 * m));
    for (int64_t i = now.at; i < now.end; i++)
        for (int64_t j = 0; j < m; j++)
            room->unloaded[i * m + j] = (i == j ? body->opened->stiffness[i] : 0.0) - p->tie_initial[i * m + j];
    for (int64_t i = 0; i < 12 * p->ties; i++) {
        const double k = p->tie_stiffness[3 * (i / 12) + i % 3];
        if (!due(slice, (double)(m * m))) continue;
        for (int64_t j = 0; j < m; j++) room->row[j] = k * room->gaps[i * m + j];
        add_transposed_product(room->gaps + i * m, room->row, room->unloaded, 1, m, m);
    }
    now = rows_due(slice, m, (double)(4 * m));
    for (int64_t i = now.at; i < now.end; i++)
        for (int64_t j = 0; j < m; j++) {
            room->lower[i * m + j] = 0.5 * (room->unloaded[i * m + j] + room->unloaded[j * m + i]);
            room->scaled[i * m + j] = 0.5 * (room->tangent[i * m + j] + room->tangent[j * m + i]);
        }
    if (cholesky(room->lower, m, slice)) {
        congruent(room->lower, room->scaled, m, slice);
    } else {
        /* The ties' own springs are unstable: nothing is left of stability. */
        memset(room->scaled, 0, (size_t)(m * m) * sizeof(double));
        if (slice) slice->failed = FAILED_PIECEMEAL;
    }
    return m;
}

/* With loads that turn with the body the tangent is not symmetric. The smallest real part of the eigenvalues of the scaled
 * tangent tells divergence; where vibrations grow, how fast, over the lowest frequency, with its sign reversed: flutter. */
static double follower_stability(const Body *body, Room *room) {
    const Program *p = body->p;
    const int64_t m = p->modes, e = p->elastic_count, first = p->elastic_first, n = 2 * e;
    double *state = room->state;
    memset(state, 0, (size_t)(n * n) * sizeof(double));
    for (int64_t i = 0; i < e; i++) {
        const int64_t a = first + i;
        /* Coordinates by their frequency, which balances the matrix: y = omega q, v. */
        state[i * n + e + i] = -p->omega[a];
        state[(e + i) * n + e + i] = body->rate[a];
        for (int64_t j = 0; j < e; j++) {
            const double of = room->tangent[a * m + first + j];
            state[(e + i) * n + j] = of / p->omega[first + j];
            room->scaled[i * e + j] = of / (p->omega[a] * p->omega[first + j]);
        }
    }
    const double growth = -smallest_real_part(state, n) / p->omega[first];
    return growth > FLUTTER ? -growth : smallest_real_part(room->scaled, e);
}

/* Where coordinates of the softest shape begin. */
static int64_t softest_first(const Body *body) { return body->p->tied ? 0 : body->p->elastic_first; }

double body_stability(Body *body, const double *inputs, const double *q, double *shape) {
    Arena arena = work_arena(body);
    Room *room = room_in(body, &arena, 0);
    if (!room) return NAN;
    configure(body, q, &room->at);
    const int64_t e = scaled_tangent(body, inputs, room);
    for (int64_t i = 0; i < e * e; i++)
        if (!isfinite(room->scaled[i])) return NAN;
    memset(room->shape, 0, (size_t)body->p->modes * sizeof(double));
    smallest_eigen(room->scaled, room->values, room->found + SMALLEST, room->shape + softest_first(body), e, 0);
    if (shape) memcpy(shape, room->shape, (size_t)body->p->modes * sizeof(double));
    return room->loads.following && !body->p->tied ? follower_stability(body, room) : room->found[SMALLEST];
}

/* Beyond this the smallest eigenvalue is not looked at more closely. */
static const double FAR_ABOVE = 0.5;

/* Whether the scaled tangent's eigenvalues lie above `least`, by a factor in `factor`. */
static int lies_above(const Room *room, double least, double *factor, int64_t e, Slice *slice) {
    const Rows now = rows_due(slice, e, cost_of_copy(e));
    copy_rows(room->scaled, factor, e, now);
    for (int64_t i = now.at; i < now.end; i++) factor[i * e + i] -= least;
    return cholesky(factor, e, slice);
}

double pieces_of_stability(Body *body, const double *inputs, const double *q, double margin, Arena arena, Slice *slice) {
    const int64_t tied = body->p->tied;
    Room *room = room_in(body, &arena, slice);
    if (!room) return -HUGE_VAL;
    body->slice = slice;
    configure(body, q, &room->at);
    const int64_t e = scaled_tangent(body, inputs, room);
    body->slice = 0;
    if (caught_up(slice) && room->loads.following && !tied) {
        if (slice) slice->failed = FAILED_PIECEMEAL;
        return !slice && follower_stability(body, room) > margin ? margin : -HUGE_VAL;
    }
    if (lies_above(room, fmax(margin, FAR_ABOVE), room->lower, e, slice) && caught_up(slice)) {
        if (slice) slice->spent = slice->whole;
        return fmax(margin, FAR_ABOVE);
    }
    return lies_above(room, margin, room->shapes, e, slice) ? margin : -HUGE_VAL;
}

double body_stable_beyond(Body *body, const double *inputs, const double *q, double margin) {
    Arena arena = work_arena(body);
    Room *room = room_in(body, &arena, 0);
    if (!room) return -HUGE_VAL;
    spread(body, inputs, &room->loads);
    /* The tangent of loads that turn with nothing is that of the unloaded body. */
    if (!room->loads.active && !body->p->tied) return margin < 1.0 ? 1.0 : -HUGE_VAL;
    return pieces_of_stability(body, inputs, q, margin, work_arena(body), 0);
}

int body_is_stable(Body *body, const double *inputs, const double *q, double margin) {
    return body_stable_beyond(body, inputs, q, margin) >= margin;
}

void pieces_of_cause(Body *body, const double *inputs, const double *q, Arena arena, Slice *slice) {
    const Program *p = body->p;
    const int64_t first = softest_first(body), e = p->tied ? p->modes : p->elastic_count;
    Room *room = room_in(body, &arena, slice);
    double *shape = room->shape, *found = room->found;
    /* In pieces both are those of the look before. */
    if (!slice) configure(body, q, &room->at);
    if (!slice) scaled_tangent(body, inputs, room);
    if (due(slice, (double)p->modes)) memset(shape, 0, (size_t)p->modes * sizeof(double));
    smallest_eigen(room->scaled, room->values, found + SMALLEST, shape + first, e, slice);
    if (!slice && room->loads.following && !p->tied) found[SMALLEST] = follower_stability(body, room);
    body->slice = slice;
    for (int64_t l = 0; l <= p->loads && !over(slice); l++) {
        const int alone = l < p->loads;
        /* What the stretch stiffens or softens is there without the loads, too. */
        if (alone ? inputs[l] == 0.0 : !p->stretches) continue;
        if (due(slice, (double)p->loads)) {
            memset(room->alone, 0, (size_t)p->loads * sizeof(double));
            if (alone) room->alone[l] = inputs[l];
        }
        scaled_tangent(body, room->alone, room);
        if (!due(slice, (double)(e * e))) continue;
        double left = 0.0;
        for (int64_t i = 0; i < e; i++) left += shape[first + i] * dot(room->scaled + i * e, shape + first, e);
        found[BY_LOADS + l] = left;
    }
    body->slice = 0;
}

Cause cause_found(const Body *body, const double *inputs, Arena arena) {
    const Program *p = body->p;
    const Room *room = room_in(body, &arena, 0);
    const double *left = room->found + BY_LOADS, without = p->stretches ? left[p->loads] : dot(room->shape, room->shape, p->modes);
    Cause cause = {room->found[SMALLEST], -HUGE_VAL, 0, 0};
    for (int64_t j = 0; j < p->modes; j++)
        if (fabs(room->shape[j]) > fabs(room->shape[cause.mode])) cause.mode = j;
    for (int64_t i = 0; i < p->loads; i++) {
        if (inputs[i] == 0.0 || !(without - left[i] > cause.most)) continue;
        cause.most = without - left[i];
        cause.load = i;
    }
    return cause;
}

/* Whether the tangent is that of the unloaded body and a sum over the loads, whatever the body's shape. */
static int softened_by_loads_alone(const Program *p) {
    return !p->tied && !p->stretches && !p->by_mode_given && !p->followers;
}

/* What a bent body adds to the bound of the undeformed one. */
static const double BENT = 2.0;

void find_softening(Body *body) {
    const Program *p = body->p;
    Arena arena = work_arena(body);
    Room *room = room_in(body, &arena, 0);
    if (!softened_by_loads_alone(p) || !room || softens_known(body->opened)) return;
    double *rest = body->scratch.end_q, *softens = room->found;
    memset(rest, 0, (size_t)p->modes * sizeof(double));
    configure(body, rest, &room->at);
    memset(softens, 0, (size_t)((p->loads + 2) / 3) * sizeof(double));
    for (int64_t l = 0; l < p->loads; l++) {
        memset(room->alone, 0, (size_t)p->loads * sizeof(double));
        room->alone[l] = 1.0;
        const int64_t e = scaled_tangent(body, room->alone, room);
        for (int64_t i = 0; i < e; i++) room->scaled[i * (e + 1)] -= 1.0;
        softens[l / 3] += dot(room->scaled, room->scaled, e * e);
    }
    for (int64_t k = 0; 3 * k < p->loads; k++) softens[k] = BENT * sqrt(softens[k]);
    keep_softens(body->opened, softens);
}

/* Weyl's inequality: no eigenvalue changes by more than the norm of what is added. A force or moment may turn against the
 * body, so that its three components count alike. */
double body_softening_bound(const Body *body, const double *inputs) {
    const Program *p = body->p;
    if (!softened_by_loads_alone(p)) return HUGE_VAL;
    double bound = 0.0;
    for (int64_t k = 0; 3 * k < p->loads; k++) bound += body->opened->softens[k] * norm(inputs + 3 * k, 3);
    return bound;
}
