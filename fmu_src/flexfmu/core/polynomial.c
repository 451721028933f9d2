#include "polynomial.h"

#include <string.h>

#include "algebra.h"

void take_polynomial(const Body *body, Arena *arena, Polynomial *room) {
    const int64_t pairs = body->p.mass_pairs, columns = body->p.inertial_modes + pairs;
    room->x = take(arena, columns);
    room->slope = take(arena, columns);
    room->value = take(arena, body->p.mass_forms);
    room->pairs = take(arena, pairs);
    room->rates = take(arena, pairs);
    room->at = take(arena, body->p.inertial_modes);
    room->known = 0;
}

/* M - 1 by pairs, or its rate, of x or its rate. */
static void by_pairs(const Body *body, Polynomial *room, double *out) {
    const Program *p = &body->p;
    const int64_t pairs = p->mass_pairs;
    rows_times(p->mass_value, room->x, room->value, p->mass_forms, p->inertial_modes + pairs);
    memset(out, 0, (size_t)pairs * sizeof(double));
    add_rows(room->value, p->mass_form, out, p->mass_forms, pairs);
}

/* M - 1 by pairs at q, where it is not known already. */
static void place(const Body *body, const double *q, Polynomial *room) {
    const int64_t r = body->p.inertial_modes;
    const size_t size = (size_t)r * sizeof(double);
    double *x = room->x + r;
    if (room->known && memcmp(room->at, q, size) == 0) return;
    memcpy(room->at, q, size);
    memcpy(room->x, q, size);
    for (int64_t a = 0; a < r; a++)
        for (int64_t b = a; b < r; b++) *x++ = q[a] * q[b];
    by_pairs(body, room, room->pairs);
    room->known = 1;
}

/* out += a symmetric matrix by pairs times v. */
static void add_times(const double *pairs, const double *v, int64_t r, double *out) {
    for (int64_t a = 0; a < r; a++) {
        double sum = *pairs++ * v[a];
        const double half = 0.5 * v[a];
        for (int64_t b = a + 1; b < r; b++, pairs++) {
            sum += 0.5 * *pairs * v[b];
            out[b] += half * *pairs;
        }
        out[a] += sum;
    }
}

void polynomial_mass(const Body *body, const double *q, Polynomial *room, double *out) {
    const int64_t r = body->p.inertial_modes;
    const double *pair = room->pairs;
    place(body, q, room);
    for (int64_t a = 0; a < r; a++) {
        out[a * r + a] = *pair++;
        for (int64_t b = a + 1; b < r; b++) out[a * r + b] = out[b * r + a] = 0.5 * *pair++;
    }
}

void polynomial_diagonal(const Body *body, const double *q, Polynomial *room, double *out) {
    const int64_t r = body->p.inertial_modes;
    const double *pair = room->pairs;
    place(body, q, room);
    for (int64_t a = 0; a < r; pair += r - a, a++) out[a] = *pair;
}

void polynomial_momentum(const Body *body, const double *q, const double *v, Polynomial *room, double *out) {
    place(body, q, room);
    memset(out, 0, (size_t)body->p.modes * sizeof(double));
    add_times(room->pairs, v, body->p.inertial_modes, out);
}

void polynomial_gradient(const Body *body, const double *q, const double *v, Polynomial *room, double *out) {
    const Program *p = &body->p;
    const int64_t r = p->inertial_modes, pairs = p->mass_pairs;
    double *rate = room->rates;
    for (int64_t a = 0; a < r; a++)
        for (int64_t b = a; b < r; b++) *rate++ = 0.5 * v[a] * v[b];
    rows_times(p->mass_form, room->rates, room->value, p->mass_forms, pairs);
    memset(room->slope, 0, (size_t)(r + pairs) * sizeof(double));
    add_rows(room->value, p->mass_value, room->slope, p->mass_forms, r + pairs);
    memset(out, 0, (size_t)p->modes * sizeof(double));
    memcpy(out, room->slope, (size_t)r * sizeof(double));
    /* A pair's product changes by both of its factors. */
    for (int64_t i = r; i < r + pairs; i++) room->slope[i] *= 2.0;
    add_times(room->slope + r, q, r, out);
}

void polynomial_convective(const Body *body, const double *q, const double *v, Polynomial *room, double *out) {
    const int64_t r = body->p.inertial_modes;
    double *x = room->x + r;
    polynomial_gradient(body, q, v, room, out);
    for (int64_t j = 0; j < r; j++) out[j] = -out[j];
    memcpy(room->x, v, (size_t)r * sizeof(double));
    for (int64_t a = 0; a < r; a++)
        for (int64_t b = a; b < r; b++) *x++ = q[a] * v[b] + v[a] * q[b];
    by_pairs(body, room, room->rates);
    add_times(room->rates, v, r, out);
}
