/* Internal steps of a body that turns freely as a whole (docs/theory.md section 9): in the axes of its root frame, which
 * makes the rigid motions alone, mass depends on elastic coordinates only.
 *
 * The root frame turns by the exponential of the mean spin. With the mean R of its rotations at both ends, for which
 * R1 - R0 = R w^ (w along the spin), momentum moves by the cross product with w: momenta are kept to round-off whatever
 * is left of the iteration's error. Elastic modes follow the rule of step_inertial.c. Sources: J. C. Simo, N. Tarnow,
 * K. K. Wong, Comput. Methods Appl. Mech. Eng. 100 (1992) 63 (momenta); O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449. */
#include <math.h>
#include <string.h>

#include "internal.h"

static const double TOLERANCE = 1e-12;
/* Turn of the root frame in one internal step, rad, beyond which it is divided. */
static const double LONGEST_TURN = 1.0;
/* Change of that turn which is round-off. */
static const double SAME_TURN = 2e-16;
enum { MOST_ROUNDS = LEARNT_ROUNDS, MOST_TURNS = 60 };

/* Mass of turn and elastic coordinates about the centre of mass, and what moves that centre. */
typedef struct {
    double *whole;  /* (t + e, t + e) */
    double *shift;  /* (3, t + e): velocity of the centre of mass seen from the root, per unit coordinate */
    double centre[3];
} Inertia;

/* One end of an internal step, in the root frame's axes but for `place` and `velocity`, of the centre of mass. */
typedef struct {
    Configuration *at;
    Inertia mass;
    double *z; /* (t + e): turn rates along the axes, elastic velocities */
    double rotation[9], place[3], velocity[3], angle[3];
} End;

typedef struct {
    double *modal, *scratch, *matrix, *followers, *turned, *force, *bare, *inputs, *rates;
    Flow flow;
    Stretch from, to; /* membrane energy at both ends of a step */
    Loads *loads;
} Room;

static int64_t coordinates(const Program *p) { return p->turn_axes + p->modes - p->rigid; }

static double total_mass(const Program *p) {
    double sum = 0.0;
    for (int64_t i = 0; i < p->rigid; i++) sum += dot(p->turn_coordinates + 6 * i, p->turn_coordinates + 6 * i, 3);
    return sum / 3.0;
}

static void take_end(const Body *body, Arena *arena, End *end) {
    const int64_t n = coordinates(&body->p);
    end->mass.whole = take(arena, n * n);
    end->mass.shift = take(arena, 3 * n);
    end->z = take(arena, n);
}

static void take_room(const Body *body, Arena *arena, Room *room) {
    const int64_t m = body->p.modes;
    room->modal = take(arena, m * m);
    room->matrix = take(arena, m * m);
    room->scratch = take(arena, modal_force_size(body));
    if (body->p.inertial) take_flow(body, arena, &room->flow);
    room->turned = take(arena, m);
    room->force = take(arena, m);
    room->followers = take(arena, body->p.followers ? 6 * body->p.nodes : 0);
    room->bare = take(arena, m);
    room->rates = take(arena, m);
    room->inputs = take(arena, body->p.loads);
    take_stretch(body, arena, &room->from);
    take_stretch(body, arena, &room->to);
}

int64_t free_size(const Body *body) {
    Arena count = {0, 0};
    Room room;
    End end;
    take_room(body, &count, &room);
    take_end(body, &count, &end);
    take_end(body, &count, &end);
    return count.used + ends_size(body) + 18 * body->p.modes + 2 * (MOST_ROUNDS + 1) * body->p.modes + body->p.loads;
}

/* Modal rates (m) of a body that turns and bends by z and whose root moves by `velocity`, in the root's axes. */
static void modal_rates(const Program *p, const double *z, const double *velocity, double *v) {
    double motion[6] = {velocity[0], velocity[1], velocity[2], 0.0, 0.0, 0.0};
    for (int64_t a = 0; a < p->turn_axes; a++)
        for (int i = 0; i < 3; i++) motion[3 + i] += p->turn_axis[3 * a + i] * z[a];
    rows_times(p->turn_coordinates, motion, v, p->rigid, 6);
    memcpy(v + p->rigid, z + p->turn_axes, (size_t)(p->modes - p->rigid) * sizeof(double));
}

/* Inertia at a configuration whose root is where it was undeformed. */
static void inertia_at(const Body *body, const Configuration *at, Room *room, Inertia *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes, r = p->rigid, t = p->turn_axes, n = coordinates(p);
    const double mass = total_mass(p);
    memset(out->centre, 0, sizeof out->centre);
    memset(out->shift, 0, (size_t)(3 * n) * sizeof(double));
    memset(out->whole, 0, (size_t)(n * n) * sizeof(double));
    if (p->inertial) {
        const int64_t known = p->inertial_modes;
        memset(room->modal, 0, (size_t)(m * m) * sizeof(double));
        excess_mass(body, at, &room->flow, room->matrix);
        for (int64_t i = 0; i < known; i++) memcpy(room->modal + i * m, room->matrix + i * known, (size_t)known * sizeof(double));
        for (int64_t i = 0; i < m; i++) room->modal[i * m + i] += 1.0;
        if (p->turn_slides) mass_centre(body, at, out->centre);
    }
    /* Rigid coordinates of the root's translations, then of its turns about the axes, in columns. */
    for (int64_t a = 0; a < t + (p->inertial ? 3 * p->turn_slides : 0); a++) {
        double column[6], *row = room->rates;
        for (int64_t i = 0; i < r; i++)
            column[i] = a < t ? dot(p->turn_coordinates + 6 * i + 3, p->turn_axis + 3 * a, 3) : p->turn_coordinates[6 * i + a - t];
        memset(row, 0, (size_t)m * sizeof(double));
        if (p->inertial)
            add_rows(column, room->modal, row, r, m);
        else
            memcpy(row, column, (size_t)r * sizeof(double));
        double *to = a < t ? out->whole + a * n : out->shift + (a - t) * n;
        for (int64_t b = 0; b < t; b++) {
            for (int64_t i = 0; i < r; i++) to[b] += row[i] * dot(p->turn_coordinates + 6 * i + 3, p->turn_axis + 3 * b, 3);
        }
        memcpy(to + t, row + r, (size_t)(m - r) * sizeof(double));
        if (a >= t)
            for (int64_t j = 0; j < n; j++) to[j] /= mass;
    }
    for (int64_t i = 0; i < m - r; i++) {
        for (int64_t b = 0; b < t; b++) out->whole[(t + i) * n + b] = out->whole[b * n + t + i];
        if (p->inertial)
            memcpy(out->whole + (t + i) * n + t, room->modal + (r + i) * m + r, (size_t)(m - r) * sizeof(double));
        else
            out->whole[(t + i) * n + t + i] = 1.0;
    }
    /* About the centre of mass. */
    for (int64_t i = 0; p->inertial && p->turn_slides && i < n; i++)
        for (int64_t j = 0; j < n; j++)
            for (int k = 0; k < 3; k++) out->whole[i * n + j] -= mass * out->shift[k * n + i] * out->shift[k * n + j];
}

/* out = mass times z, less z itself of the elastic part where `excess`. */
static void momentum_of(const Program *p, const Inertia *inertia, const double *z, int excess, double *out) {
    const int64_t t = p->turn_axes, n = coordinates(p);
    for (int64_t i = 0; i < n; i++) out[i] = dot(inertia->whole + i * n, z, n) - (excess && i >= t ? z[i] : 0.0);
}

static void along_axes(const Program *p, const double *z, double *spin) {
    memset(spin, 0, 3 * sizeof(double));
    add_rows(z, p->turn_axis, spin, p->turn_axes, 3);
}

/* Loads in axes that are turned by `forces` and `moments`, (3, 3) each. */
static void spread_turned(const Body *body, const double *inputs, const double *forces, const double *moments, Room *room) {
    const Program *p = &body->p;
    for (int64_t i = 0; i < p->loads / 3; i++)
        apply_back(i % 2 && i < 2 * p->interfaces ? moments : forces, inputs + 3 * i, room->inputs + 3 * i);
    /* What turns with its interface is in the body's own axes already. */
    for (int64_t i = 0; i < p->followers; i++)
        memcpy(room->inputs + 6 * p->follower[i], inputs + 6 * p->follower[i], 6 * sizeof(double));
    spread(body, room->inputs, room->loads);
}

static void sum_loads(const Program *p, const double *loads, double *sum) {
    memset(sum, 0, 3 * sizeof(double));
    for (int64_t k = 0; k < p->nodes; k++)
        for (int i = 0; i < 3; i++) sum[i] += loads[3 * k + i];
}

/* All forces of fixed direction, global axes. */
static void total_force(const Program *p, const double *inputs, double *sum) {
    memset(sum, 0, 3 * sizeof(double));
    for (int64_t k = 0; k < p->interfaces; k++)
        for (int i = 0; i < 3; i++) sum[i] += inputs[6 * k + i];
    for (int64_t k = 0; k < p->followers; k++)
        for (int i = 0; i < 3; i++) sum[i] -= inputs[6 * p->follower[k] + i];
    for (int64_t k = 0; k < p->masses; k++)
        for (int i = 0; i < 3; i++) sum[i] -= p->mass[k] * inputs[6 * p->interfaces + i];
}

/* Momentum along the axes at an internal step's end, (t). */
static void end_momentum(const Program *p, const double *turned, const double *start, const double *mean, const double *turning,
                         const double *moment, double h, double *z) {
    double kept[3], carried[3], now[3];
    if (p->turn_axes == 3) {
        /* R1 p1 = R0 p0 + h R moment. */
        apply(start, turning, kept);
        apply(mean, moment, carried);
        for (int i = 0; i < 3; i++) kept[i] += h * carried[i];
        apply_back(turned, kept, now);
    } else {
        for (int i = 0; i < 3; i++) now[i] = turning[i] + h * moment[i];
    }
    for (int64_t a = 0; a < p->turn_axes; a++) z[a] = dot(p->turn_axis + 3 * a, now, 3);
}

/* Take off what membrane energy resists between two places, of elastic forces (m - r). */
static void resist(const Body *body, const Stretch *from, const Stretch *to, Room *room, double *out) {
    const Program *p = &body->p;
    if (!p->stretches) return;
    memset(room->turned, 0, (size_t)p->modes * sizeof(double));
    subtract_stretch_force(body, from, to, room->turned);
    for (int64_t j = 0; j < p->modes - p->rigid; j++) out[j] += room->turned[p->rigid + j];
}

/* Add the force and the moment about the centre of mass of loads that turn with their interfaces, in the root's axes. */
static void push_of_followers(const Body *body, const Loads *loads, const Configuration *at, const double *centre, Room *room,
                              double *total, double *about) {
    const Program *p = &body->p;
    if (!loads->following) return;
    double *force = room->followers, *moment = force + 3 * p->nodes, lever[3], turned[3];
    memset(force, 0, (size_t)(6 * p->nodes) * sizeof(double));
    add_followers(body, loads, at, force, moment);
    for (int64_t k = p->frames; k < p->frames + p->interfaces; k++) {
        for (int i = 0; i < 3; i++) lever[i] = at->position[3 * k + i] - p->point[i] - centre[i];
        cross(lever, force + 3 * k, turned);
        for (int i = 0; i < 3; i++) {
            total[i] += force[3 * k + i];
            about[i] += moment[3 * k + i] + turned[i];
        }
    }
}

/* Elastic forces (m - r) of the loads about the centre of mass. */
static void elastic_force(const Body *body, const Loads *loads, int with_moments, const Configuration *at, const double *shift,
                          const double *total, Room *room, double *out) {
    const Program *p = &body->p;
    const int64_t r = p->rigid, t = p->turn_axes, n = coordinates(p);
    if (!loads->active) {
        memset(out, 0, (size_t)(p->modes - r) * sizeof(double));
        return;
    }
    modal_force(body, loads, with_moments, at, 0, room->scratch, room->turned);
    for (int64_t j = 0; j < p->modes - r; j++) {
        out[j] = room->turned[r + j];
        for (int i = 0; i < 3; i++) out[j] -= shift[i * n + t + j] * total[i];
    }
}

/* Accelerations (t + e) at an end; elastic ones without what stiffness makes of them. */
static void accelerations(Body *body, const double *inputs, const End *end, Room *room, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes, r = p->rigid, t = p->turn_axes, n = coordinates(p);
    double total[3], moment[3], lever[3], about[3], spin[3], momentum[3] = {0}, turned[3], still[3] = {0};
    spread_turned(body, inputs, end->rotation, end->rotation, room);
    const Loads *loads = room->loads;
    sum_loads(p, loads->force, total);
    sum_loads(p, loads->moment, moment);
    push_of_followers(body, loads, end->at, end->mass.centre, room, total, moment);
    for (int64_t k = 0; k < p->nodes; k++) {
        for (int i = 0; i < 3; i++) lever[i] = end->at->position[3 * k + i] - p->point[i] - end->mass.centre[i];
        cross(lever, loads->force + 3 * k, about);
        for (int i = 0; i < 3; i++) moment[i] += about[i];
    }
    elastic_force(body, loads, 1, end->at, end->mass.shift, total, room, out + t);
    stretch_at(body, end->at->q, &room->to);
    resist(body, &room->to, &room->to, room, out + t);
    for (int64_t a = 0; a < t; a++) out[a] = dot(p->turn_axis + 3 * a, moment, 3);
    along_axes(p, end->z, spin);
    if (p->inertial) {
        modal_rates(p, end->z, still, room->rates);
        convective_force(body, end->at, room->rates, &room->flow, room->turned);
        double push[3] = {0}, turning[6] = {0};
        for (int64_t i = 0; i < r; i++) {
            for (int c = 0; c < 3; c++) {
                push[c] += p->turn_coordinates[6 * i + c] * room->turned[i];
                turning[c] += p->turn_coordinates[6 * i + 3 + c] * room->turned[i];
            }
        }
        for (int64_t a = 0; a < t; a++) out[a] -= dot(p->turn_axis + 3 * a, turning, 3);
        for (int64_t j = 0; j < m - r; j++) out[t + j] -= room->turned[r + j];
        for (int64_t j = 0; p->turn_slides && j < n; j++)
            for (int i = 0; i < 3; i++) out[j] += end->mass.shift[i * n + j] * push[i];
    } else {
        momentum_of(p, &end->mass, end->z, 1, room->rates);
        along_axes(p, room->rates, momentum);
        cross(momentum, spin, turned);
        for (int64_t a = 0; a < t; a++) out[a] += dot(p->turn_axis + 3 * a, turned, 3);
    }
    for (int64_t j = 0; j < m - r; j++) out[t + j] -= body->stiffness[r + j] * end->at->q[r + j];
    const int64_t solved = p->inertial ? n : t;
    for (int64_t i = 0; i < solved; i++) memcpy(room->matrix + i * solved, end->mass.whole + i * n, (size_t)solved * sizeof(double));
    if (lu_factor(room->matrix, body->pivot, solved)) lu_solve(room->matrix, body->pivot, out, solved, 1);
    for (int64_t j = 0; j < m - r; j++) out[t + j] += body->stiffness[r + j] * end->at->q[r + j];
}

/* From a state to an end. The rotation vector only holds the rotation; rates are those of the root's own axes. */
static void enter(Body *body, const double *q, const double *v, End *end, Room *room) {
    const Program *p = &body->p;
    const int64_t m = p->modes, r = p->rigid, t = p->turn_axes, n = coordinates(p);
    double displacement[3], spin[3], jacobian[9], arm[3], moved[3];
    const double *turning = p->operator_ + 3 * p->nodes * m;
    for (int i = 0; i < 3; i++) {
        displacement[i] = dot(p->operator_ + i * m, q, r);
        end->velocity[i] = dot(p->operator_ + i * m, v, r);
        end->angle[i] = dot(turning + i * m, q, r);
        spin[i] = dot(turning + i * m, v, r);
    }
    exponential(end->angle, end->rotation, jacobian);
    for (int64_t a = 0; a < t; a++) end->z[a] = dot(p->turn_axis + 3 * a, spin, 3);
    memcpy(end->z + t, v + r, (size_t)(m - r) * sizeof(double));
    memset(room->turned, 0, (size_t)r * sizeof(double));
    memcpy(room->turned + r, q + r, (size_t)(m - r) * sizeof(double));
    configure(body, room->turned, end->at);
    inertia_at(body, end->at, room, &end->mass);
    apply(end->rotation, end->mass.centre, arm);
    for (int i = 0; i < 3; i++) moved[i] = dot(end->mass.shift + i * n, end->z, n);
    apply(end->rotation, moved, spin);
    for (int i = 0; i < 3; i++) {
        end->place[i] = displacement[i] + arm[i];
        end->velocity[i] += spin[i];
    }
}

/* And back. */
static void leave(Body *body, const End *end, double *q, double *v) {
    const Program *p = &body->p;
    const int64_t m = p->modes, r = p->rigid, n = coordinates(p);
    double motion[6], moved[3], back[3], rate[3];
    apply(end->rotation, end->mass.centre, back);
    for (int i = 0; i < 3; i++) motion[i] = end->place[i] - back[i];
    if (p->turn_axes == 1)
        memcpy(motion + 3, end->angle, sizeof moved);
    else
        rotation_vector(end->rotation, motion + 3);
    rows_times(p->turn_coordinates, motion, q, r, 6);
    memcpy(q + r, end->at->q + r, (size_t)(m - r) * sizeof(double));
    for (int i = 0; i < 3; i++) moved[i] = dot(end->mass.shift + i * n, end->z, n);
    apply(end->rotation, moved, back);
    for (int i = 0; i < 3; i++) rate[i] = end->velocity[i] - back[i];
    modal_rates(p, end->z, rate, v);
}

/* The mean R of the rotations at both ends of a turn by h `spin`, the inverse of its transpose, the rotation halfway, and the
 * stretch of w. */
static double mean_rotation(const double *start, const double *spin, double h, double *end, double *mean, double *inverse,
                            double *middle) {
    double turn[3], half[3], jacobian[9], step[9], stretch[9] = {0};
    for (int i = 0; i < 3; i++) {
        turn[i] = h * spin[i];
        half[i] = 0.5 * turn[i];
    }
    exponential(turn, step, jacobian);
    multiply(start, step, end);
    exponential(half, step, jacobian);
    multiply(start, step, middle);
    for (int i = 0; i < 9; i++) mean[i] = 0.5 * (start[i] + end[i]);
    const double angle = norm(turn, 3), shorter = cos(0.5 * angle), square = angle * angle;
    /* mean = middle (c + (1 - c) n n): transposed and inverted, middle (1/c + (1 - 1/c) n n). */
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            stretch[3 * i + j] = (i == j ? 1.0 / shorter : 0.0) + (square > 0.0 ? (1.0 - 1.0 / shorter) * turn[i] * turn[j] / square : 0.0);
    multiply(middle, stretch, inverse);
    return angle > 1e-4 ? tan(0.5 * angle) / (0.5 * angle) : 1.0 + square / 12.0;
}

int free_steps(Body *body, Division *d, double *q, double *v) {
    const Program *p = &body->p;
    const int64_t m = p->modes, r = p->rigid, t = p->turn_axes, n = coordinates(p), e = m - r, solved = p->inertial ? n : t;
    const Rule *rule = rule_of(body, d->step);
    const double h = d->step, mass = total_mass(p), *gq = rule->gq + r, *gv = rule->gv + r;
    Arena arena = work_arena(body);
    Ends ends;
    Room room;
    End first, second, *start = &first, *end = &second;
    take_ends(body, &arena, &ends);
    take_room(body, &arena, &room);
    take_end(body, &arena, &first);
    take_end(body, &arena, &second);
    first.at = &ends.first;
    second.at = &ends.second;
    room.loads = &ends.loads;
    double *before = take(&arena, m), *after = take(&arena, m), *free_q = take(&arena, m), *free_v = take(&arena, m);
    double *q1 = take(&arena, m), *way = take(&arena, m), *momentum = take(&arena, m), *reached = take(&arena, m);
    double *gradient = take(&arena, m), *half = take(&arena, m), *z = take(&arena, m), *push = take(&arena, m);
    double *shift = take(&arena, 3 * m), *between = take(&arena, p->loads), *sizes = take(&arena, m), *mean_force = take(&arena, m);
    double *changed = take(&arena, m), *seen = take(&arena, 2 * (MOST_ROUNDS + 1) * m);

    d->worst = 0.0;
    enter(body, q, v, start, &room);
    for (int64_t j = 0; j < e; j++) {
        const double reached_by = p->weight[r + j] * gq[j];
        sizes[j] = reached_by * reached_by + gv[j] * gv[j];
    }
    memset(q1, 0, (size_t)r * sizeof(double));
    memset(gradient, 0, (size_t)m * sizeof(double));
    for (int64_t number = 0; number < d->count; number++) {
        if (d->rounds >= d->most_rounds) return EXHAUSTED;
        double turning[3], spin[3], total[3], followed[3] = {0}, everything[3], centre[3], growth[3] = {0}, moment[3], mean[9], inverse[9], middle[9];
        for (int64_t j = 0; j < e; j++) {
            const double at = start->at->q[r + j], rate = start->z[t + j];
            free_q[j] = rule->p11[r + j] * at + rule->p12[r + j] * rate;
            free_v[j] = rule->p21[r + j] * at + rule->p22[r + j] * rate;
        }
        const double *inputs = d->inputs;
        if (d->inputs_end) {
            /* What loads that grow over a step do beyond their mean, on the undeformed body. */
            for (int64_t i = 0; i < p->loads; i++) between[i] = (d->inputs_end[i] - d->inputs[i]) / (double)d->count;
            total_force(p, between, growth);
            spread_turned(body, between, start->rotation, start->rotation, &room);
            for (int64_t j = 0; j < e; j++) {
                free_q[j] += rule->ramp[r + j] * room.loads->constant[r + j];
                free_v[j] += rule->ramp_rate[r + j] * room.loads->constant[r + j];
            }
            const double share = ((double)number + 0.5) / (double)d->count;
            for (int64_t i = 0; i < p->loads; i++) between[i] = d->inputs[i] + share * (d->inputs_end[i] - d->inputs[i]);
            inputs = between;
        }
        if (d->inputs_end || number == 0) accelerations(body, inputs, start, &room, before);
        stretch_at(body, start->at->q, &room.from);
        momentum_of(p, &start->mass, start->z, 1, momentum);
        along_axes(p, momentum, turning);
        for (int64_t a = 0; a < t; a++) end->z[a] = start->z[a] + h * before[a];
        for (int64_t j = 0; j < e; j++) {
            mean_force[j] = before[t + j];
            q1[r + j] = free_q[j] + gq[j] * before[t + j];
            end->z[t + j] = free_v[j] + gv[j] * before[t + j];
        }
        for (int64_t i = 0; i < n; i++) half[i] = 0.5 * (start->z[i] + end->z[i]);
        along_axes(p, half, spin);
        if (!p->inertial) end->mass = start->mass;
        double size, before_size = 0.0;
        int pairs = 0;
        for (int round = 1;; round++) {
            if (round > MOST_ROUNDS || !(norm(spin, 3) * h <= LONGEST_TURN)) return UNSETTLED;
            d->rounds++;
            const double stretch = mean_rotation(start->rotation, spin, h, end->rotation, mean, inverse, middle);
            configure(body, q1, end->at);
            configure_halfway(body, 0, start->at, end->at, &ends.middle);
            if (p->inertial) inertia_at(body, end->at, &room, &end->mass);
            spread_turned(body, inputs, mean, inverse, &room);
            const Loads *loads = room.loads;
            sum_loads(p, loads->force, total);
            sum_loads(p, loads->moment, moment);
            double work = 0.0, reach = 0.0, lever[3], about[3];
            for (int64_t k = 0; k < p->nodes; k++) {
                const double *force = loads->force + 3 * k;
                for (int i = 0; i < 3; i++) {
                    const double from = start->at->position[3 * k + i], to = end->at->position[3 * k + i];
                    lever[i] = 0.5 * (from + to - start->mass.centre[i] - end->mass.centre[i]) - p->point[i];
                    work += force[i] * (to - from);
                }
                reach += norm(force, 3) * norm(p->point + 3 * k, 3);
                cross(lever, force, about);
                for (int i = 0; i < 3; i++) moment[i] += stretch * about[i];
            }
            for (int i = 0; i < 3; i++) {
                work -= total[i] * (end->mass.centre[i] - start->mass.centre[i]);
                centre[i] = 0.5 * (start->mass.centre[i] + end->mass.centre[i]);
                followed[i] = 0.0;
            }
            push_of_followers(body, loads, &ends.middle, centre, &room, followed, moment);
            for (int i = 0; i < 3; i++) everything[i] = total[i] + followed[i];
            for (int64_t i = 0; i < 3 * n; i++) shift[i] = 0.5 * (start->mass.shift[i] + end->mass.shift[i]);
            elastic_force(body, loads, 1, &ends.middle, shift, everything, &room, push);
            const double *conservative = push;
            if (loads->has_moments) {
                elastic_force(body, loads, 0, &ends.middle, shift, total, &room, room.bare);
                conservative = room.bare;
            }
            for (int64_t j = 0; j < e; j++) way[j] = q1[r + j] - start->at->q[r + j];
            double bracket = work - dot(conservative, way, e);
            if (p->inertial) {
                double slip[3];
                for (int64_t i = 0; i < n; i++) half[i] = 0.5 * (start->z[i] + end->z[i]);
                for (int i = 0; i < 3; i++) slip[i] = -dot(shift + i * n, half, n);
                modal_rates(p, half, slip, room.rates);
                kinetic_gradient(body, &ends.middle, room.rates, &room.flow, gradient);
                /* The bracket of (15) by differences of the mass, in which what turns as a whole has cancelled. */
                momentum_of(p, &end->mass, end->z, 1, reached);
                momentum_of(p, &start->mass, end->z, 1, z);
                const double gained = dot(start->z, reached, n), had = dot(start->z, z, n);
                bracket += 0.5 * (gained - had) - dot(gradient + r, way, e);
                reach += fabs(gained) + fabs(had);
                for (int64_t j = 0; j < e; j++) bracket += (reached[t + j] - momentum[t + j]) * (way[j] / h - half[t + j]);
            }
            const double square = dot(way, way, e);
            const double factor = square > 0.0 && fabs(bracket) > ROUND_OFF * reach ? bracket / square : 0.0;
            const double uncertain = factor != 0.0 ? NOISE * ROUND_OFF * reach / square : 0.0;
            for (int64_t j = 0; j < e; j++) push[j] += gradient[r + j] + factor * way[j];
            stretch_at(body, q1, &room.to);
            resist(body, &room.from, &room.to, &room, push);
            /* Spin and elastic rates at the end from the momenta there. */
            for (int64_t i = 0; i < solved; i++)
                for (int64_t j = 0; j < solved; j++) {
                    const double one = i == j ? 1.0 : 0.0, of = end->mass.whole[i * n + j];
                    room.matrix[i * solved + j] = i < t ? of : one + gv[i - t] / h * (of - one);
                }
            if (!lu_factor(room.matrix, body->pivot, solved)) return UNSETTLED;
            double off = HUGE_VAL, turn_by[3] = {0};
            for (int turn = 0; turn < MOST_TURNS && off > SAME_TURN; turn++) {
                double now[3];
                if (turn) mean_rotation(start->rotation, spin, h, end->rotation, mean, inverse, middle);
                end_momentum(p, end->rotation, start->rotation, mean, turning, moment, h, z);
                for (int64_t j = 0; j < e; j++) z[t + j] = free_v[j] + gv[j] * (push[j] + momentum[t + j] / h);
                lu_solve(room.matrix, body->pivot, z, solved, 1);
                for (int64_t a = 0; a < t; a++) half[a] = 0.5 * (start->z[a] + z[a]);
                along_axes(p, half, now);
                off = 0.0;
                for (int i = 0; i < 3; i++) {
                    off = fmax(off, h * fabs(now[i] - spin[i]));
                    spin[i] = now[i];
                }
                if (!(norm(spin, 3) * h <= LONGEST_TURN)) return UNSETTLED;
                if (t == 1) break;
            }
            momentum_of(p, &end->mass, z, 1, reached);
            for (int64_t j = 0; j < e; j++) changed[j] = mean_force[j] - push[j] + (reached[t + j] - momentum[t + j]) / h;
            learn(sizes, mean_force, e, round, &pairs, seen, changed);
            double moved = 0.0, sized = 0.0, blurred = 0.0;
            for (int64_t j = 0; j < e; j++) {
                const double blur = uncertain * way[j];
                mean_force[j] -= changed[j];
                q1[r + j] = free_q[j] + gq[j] * mean_force[j];
                const double rate = free_v[j] + gv[j] * mean_force[j], far = p->weight[r + j] * q1[r + j];
                /* What turns with it by the momentum that it leaves. */
                for (int64_t a = 0; p->inertial && a < t; a++) turn_by[a] += end->mass.whole[a * n + t + j] * (z[t + j] - rate);
                end->z[t + j] = rate;
                moved += sizes[j] * changed[j] * changed[j];
                sized += far * far + rate * rate;
                blurred += sizes[j] * blur * blur;
            }
            for (int64_t i = 0; i < t; i++) memcpy(room.matrix + i * t, end->mass.whole + i * n, (size_t)t * sizeof(double));
            if (!lu_factor(room.matrix, body->pivot, t)) return UNSETTLED;
            lu_solve(room.matrix, body->pivot, turn_by, t, 1);
            for (int64_t a = 0; a < t; a++) {
                const double unit = end->mass.whole[a * n + a], now = z[a] + turn_by[a], by = now - end->z[a];
                moved += unit * by * by;
                sized += unit * now * now;
                end->z[a] = now;
            }
            const double scale = sqrt(sized);
            size = scale > 0.0 ? sqrt(moved) / scale : 0.0;
            if (!isfinite(size)) return UNSETTLED;
            /* What is left is the change times the rate at which changes fall. */
            const double rate = size < before_size ? size / before_size : 1.0;
            if (size * rate * scale <= fmax(TOLERANCE * scale, sqrt(blurred))) break;
            before_size = size;
        }
        mean_rotation(start->rotation, spin, h, end->rotation, mean, inverse, middle);
        configure(body, q1, end->at);
        if (p->inertial) inertia_at(body, end->at, &room, &end->mass);
        /* Whatever is left of the iteration's error, momentum is what it ought to be. */
        end_momentum(p, end->rotation, start->rotation, mean, turning, moment, h, end->z);
        for (int64_t a = 0; a < t; a++) {
            end->z[a] -= dot(end->mass.whole + a * n + t, end->z + t, e);
            memcpy(room.matrix + a * t, end->mass.whole + a * n, (size_t)t * sizeof(double));
        }
        if (!lu_factor(room.matrix, body->pivot, t)) return UNSETTLED;
        lu_solve(room.matrix, body->pivot, end->z, t, 1);
        total_force(p, inputs, total);
        apply(middle, followed, everything);
        for (int i = 0; i < 3; i++) {
            const double pushed = p->turn_slides ? h * (total[i] + everything[i]) / mass : 0.0;
            end->angle[i] = start->angle[i] + h * spin[i];
            end->velocity[i] = start->velocity[i] + pushed;
            end->place[i] = start->place[i] + h * (start->velocity[i] + 0.5 * pushed);
            if (p->turn_slides) end->place[i] -= h * h / 12.0 * growth[i] / mass;
        }
        accelerations(body, inputs, end, &room, after);
        double error = 0.0, energy = mass * dot(end->velocity, end->velocity, 3);
        for (int64_t i = 0; i < n; i++) {
            const int64_t mode = i < t ? 0 : r + i - t;
            const double unit = i < t ? sqrt(end->mass.whole[i * n + i]) : 1.0, rate = unit * end->z[i];
            const double lost = unit * (i < t ? fmin(p->weight[0], 1.0 / h) : p->weight[mode]) * rule->ramp[mode] * (after[i] - before[i]);
            const double strained = p->omega[mode] * q1[mode];
            error += lost * lost;
            energy += strained * strained + rate * rate;
        }
        error = energy > 0.0 ? sqrt(error / energy) : 0.0;
        if (!(error <= d->worst)) d->worst = error;
        if (!(d->worst <= d->tolerance)) return INACCURATE;
        double *kept = before;
        before = after;
        after = kept;
        End *passed = start;
        start = end;
        end = passed;
    }
    leave(body, start, q, v);
    return DONE;
}
