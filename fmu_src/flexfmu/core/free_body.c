#include "free_body.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "tree.h"

int64_t coordinates(const Program *p) { return p->turn_axes + p->modes - p->rigid; }

double total_mass(const Program *p) {
    double sum = 0.0;
    for (int64_t i = 0; i < p->rigid; i++) sum += dot(p->turn_coordinates + 6 * i, p->turn_coordinates + 6 * i, 3);
    return sum / 3.0;
}

void take_end(const Body *body, Arena *arena, End *end) {
    const int64_t n = coordinates(body->p);
    end->mass.whole = take(arena, n * n);
    end->mass.shift = take(arena, 3 * n);
    end->z = take(arena, n);
}

void take_turning(const Body *body, Arena *arena, Turning *room) {
    const int64_t m = body->p->modes;
    room->modal = take(arena, m * m);
    room->matrix = take(arena, m * m);
    if (body->p->inertial) take_flow(body, arena, &room->flow);
    room->turned = take(arena, m);
    room->rates = take(arena, m);
    room->followers = take(arena, body->p->followers ? 6 * body->p->nodes : 0);
    room->inputs = take(arena, body->p->loads);
}

void modal_rates(const Program *p, const double *z, const double *velocity, double *v) {
    double motion[6] = {velocity[0], velocity[1], velocity[2], 0.0, 0.0, 0.0};
    for (int64_t a = 0; a < p->turn_axes; a++)
        for (int i = 0; i < 3; i++) motion[3 + i] += p->turn_axis[3 * a + i] * z[a];
    rows_times(p->turn_coordinates, motion, v, p->rigid, 6);
    memcpy(v + p->rigid, z + p->turn_axes, (size_t)(p->modes - p->rigid) * sizeof(double));
}

/* The polynomial is that of the mass about the centre of mass: `shift` is that of the undeformed body until here. */
static void shift_centre(const Body *body, const Configuration *at, Turning *room, Inertia *out) {
    const Program *p = body->p;
    const int64_t t = p->turn_axes, n = coordinates(p), m = p->modes;
    double *derivative = room->matrix;
    polynomial_centre(body, at->q, &room->flow.polynomial, out->centre, derivative);
    /* e_b x c of the undeformed body. */
    out->centre[0] += out->shift[n + 2];
    out->centre[1] += out->shift[2 * n];
    out->centre[2] += out->shift[1];
    for (int64_t a = 0; a < t; a++) {
        double moved[3];
        cross(p->turn_axis + 3 * a, out->centre, moved);
        for (int i = 0; i < 3; i++) out->shift[i * n + a] = moved[i];
    }
    for (int i = 0; i < 3; i++) memcpy(out->shift + i * n + t, derivative + i * m + p->rigid, (size_t)(m - p->rigid) * sizeof(double));
}

void inertia_at(const Body *body, const Configuration *at, Turning *room, Inertia *out) {
    const Program *p = body->p;
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
        if (p->turn_slides && p->lumped) mass_centre(body, at, out->centre);
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
    if (p->centres) shift_centre(body, at, room, out);
}

void momentum_of(const Program *p, const Inertia *inertia, const double *z, int excess, double *out) {
    const int64_t t = p->turn_axes, n = coordinates(p);
    for (int64_t i = 0; i < n; i++) out[i] = dot(inertia->whole + i * n, z, n) - (excess && i >= t ? z[i] : 0.0);
}

void along_axes(const Program *p, const double *z, double *spin) {
    memset(spin, 0, 3 * sizeof(double));
    add_rows(z, p->turn_axis, spin, p->turn_axes, 3);
}

void spread_turned(const Body *body, const double *inputs, const double *forces, const double *moments, Turning *room) {
    const Program *p = body->p;
    for (int64_t i = 0; i < p->loads / 3; i++)
        apply_back(i % 2 && i < 2 * p->interfaces ? moments : forces, inputs + 3 * i, room->inputs + 3 * i);
    /* What turns with its interface is in the body's own axes already. */
    for (int64_t i = 0; i < p->followers; i++)
        memcpy(room->inputs + 6 * p->follower[i], inputs + 6 * p->follower[i], 6 * sizeof(double));
    spread(body, room->inputs, room->loads);
}

void sum_loads(const Program *p, const double *loads, double *sum) {
    memset(sum, 0, 3 * sizeof(double));
    for (int64_t k = 0; k < p->nodes; k++)
        for (int i = 0; i < 3; i++) sum[i] += loads[3 * k + i];
}

void total_force(const Program *p, const double *inputs, double *sum) {
    memset(sum, 0, 3 * sizeof(double));
    for (int64_t k = 0; k < p->interfaces; k++)
        for (int i = 0; i < 3; i++) sum[i] += inputs[6 * k + i];
    for (int64_t k = 0; k < p->followers; k++)
        for (int i = 0; i < 3; i++) sum[i] -= inputs[6 * p->follower[k] + i];
    for (int64_t k = 0; k < p->masses; k++)
        for (int i = 0; i < 3; i++) sum[i] -= p->mass[k] * inputs[6 * p->interfaces + i];
}

void end_momentum(const Program *p, const double *turned, const double *start, const double *mean, const double *turning,
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

void resist(const Body *body, const Stretch *from, const Stretch *to, Turning *room, double *out) {
    const Program *p = body->p;
    if (!p->stretches) return;
    memset(room->turned, 0, (size_t)p->modes * sizeof(double));
    subtract_stretch_force(body, from, to, room->turned);
    for (int64_t j = 0; j < p->modes - p->rigid; j++) out[j] += room->turned[p->rigid + j];
}

void push_of_followers(const Body *body, const Loads *loads, const Configuration *at, const double *centre, Turning *room,
                              double *total, double *about) {
    const Program *p = body->p;
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

void elastic_force(const Body *body, const Loads *loads, int with_moments, const Configuration *at, const double *shift,
                          const double *total, Turning *room, double *out) {
    const Program *p = body->p;
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

void accelerations(Body *body, const double *inputs, const End *end, Turning *room, double *out) {
    const Program *p = body->p;
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
    stretch_at(body, end->at->q, room->stretch);
    resist(body, room->stretch, room->stretch, room, out + t);
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
    }
    if (!p->lumped) {
        momentum_of(p, &end->mass, end->z, 1, room->rates);
        along_axes(p, room->rates, momentum);
        cross(momentum, spin, turned);
        for (int64_t a = 0; a < t; a++) out[a] += dot(p->turn_axis + 3 * a, turned, 3);
    }
    for (int64_t j = 0; j < m - r; j++) out[t + j] -= body->opened->stiffness[r + j] * end->at->q[r + j];
    const int64_t solved = p->inertial ? n : t;
    for (int64_t i = 0; i < solved; i++) memcpy(room->matrix + i * solved, end->mass.whole + i * n, (size_t)solved * sizeof(double));
    if (lu_factor(room->matrix, body->pivot, solved, 0)) lu_solve(room->matrix, body->pivot, out, solved, 1, 0);
    for (int64_t j = 0; j < m - r; j++) out[t + j] += body->opened->stiffness[r + j] * end->at->q[r + j];
}

void end_rates(const Body *body, const double *v, End *end) {
    const Program *p = body->p;
    const int64_t m = p->modes, r = p->rigid, t = p->turn_axes, n = coordinates(p);
    double spin[3], moved[3], turned[3];
    for (int i = 0; i < 3; i++) {
        end->velocity[i] = dot(p->operator_ + i * m, v, r);
        spin[i] = dot(p->operator_ + (3 * p->nodes + i) * m, v, r);
    }
    for (int64_t a = 0; a < t; a++) end->z[a] = dot(p->turn_axis + 3 * a, spin, 3);
    memcpy(end->z + t, v + r, (size_t)(m - r) * sizeof(double));
    for (int i = 0; i < 3; i++) moved[i] = dot(end->mass.shift + i * n, end->z, n);
    apply(end->rotation, moved, turned);
    for (int i = 0; i < 3; i++) end->velocity[i] += turned[i];
}

void enter_end(Body *body, const double *q, const double *v, End *end, Turning *room) {
    const Program *p = body->p;
    const int64_t m = p->modes, r = p->rigid;
    double displacement[3], jacobian[9], arm[3];
    const double *turning = p->operator_ + 3 * p->nodes * m;
    for (int i = 0; i < 3; i++) {
        displacement[i] = dot(p->operator_ + i * m, q, r);
        end->angle[i] = dot(turning + i * m, q, r);
    }
    exponential(end->angle, end->rotation, jacobian);
    memset(room->turned, 0, (size_t)r * sizeof(double));
    memcpy(room->turned + r, q + r, (size_t)(m - r) * sizeof(double));
    configure(body, room->turned, end->at);
    inertia_at(body, end->at, room, &end->mass);
    apply(end->rotation, end->mass.centre, arm);
    for (int i = 0; i < 3; i++) end->place[i] = displacement[i] + arm[i];
    end_rates(body, v, end);
}

void leave_end(Body *body, const End *end, double *q, double *v) {
    const Program *p = body->p;
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

double mean_rotation(const double *start, const double *spin, double h, double *end, double *mean, double *inverse,
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
