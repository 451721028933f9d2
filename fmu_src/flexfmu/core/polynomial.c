#include "polynomial.h"

#include <string.h>

#include "algebra.h"

void take_polynomial(const Body *body, Arena *arena, Polynomial *room) {
    const int64_t pairs = body->p->mass_pairs, columns = body->p->modes + body->p->mass_squares + body->p->mass_products;
    room->x = take(arena, columns);
    room->slope = take(arena, columns);
    room->value = take(arena, body->p->mass_forms);
    room->pairs = take(arena, pairs);
    room->rates = take(arena, pairs);
    room->at = take(arena, body->p->modes);
    room->known = 0;
}

/* M - 1 by pairs, or its rate, of x or its rate. */
static void by_pairs(const Body *body, Polynomial *room, double *out) {
    const Program *p = body->p;
    const int64_t pairs = p->mass_pairs;
    rows_times(p->mass_value, room->x, room->value, p->mass_forms, p->modes + p->mass_squares);
    memset(out, 0, (size_t)pairs * sizeof(double));
    add_rows(room->value, p->mass_form, out, p->mass_forms, pairs);
}

/* q and the pairs of its first coordinates. */
static void powers(const Program *p, const double *q, double *x) {
    const int64_t r = p->slow_modes;
    memcpy(x, q, (size_t)p->modes * sizeof(double));
    x += p->modes;
    for (int64_t a = 0; a < r; a++)
        for (int64_t b = a; b < r; b++) *x++ = q[a] * q[b];
}

/* M - 1 by pairs at q, where it is not known already. */
static void place(const Body *body, const double *q, Polynomial *room) {
    const size_t size = (size_t)body->p->modes * sizeof(double);
    if (room->known && memcmp(room->at, q, size) == 0) return;
    memcpy(room->at, q, size);
    powers(body->p, q, room->x);
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
    const int64_t r = body->p->inertial_modes;
    const double *pair = room->pairs;
    place(body, q, room);
    for (int64_t a = 0; a < r; a++) {
        out[a * r + a] = *pair++;
        for (int64_t b = a + 1; b < r; b++) out[a * r + b] = out[b * r + a] = 0.5 * *pair++;
    }
}

void polynomial_diagonal(const Body *body, const double *q, Polynomial *room, double *out) {
    const int64_t r = body->p->inertial_modes;
    const double *pair = room->pairs;
    place(body, q, room);
    for (int64_t a = 0; a < r; pair += r - a, a++) out[a] = *pair;
}

void polynomial_momentum(const Body *body, const double *q, const double *v, Polynomial *room, double *out) {
    place(body, q, room);
    memset(out, 0, (size_t)body->p->modes * sizeof(double));
    add_times(room->pairs, v, body->p->inertial_modes, out);
}

/* out (m) = derivative by q of what q and its pairs change by `slope`, which is spent. */
static void by_coordinates(const Body *body, const double *q, Polynomial *room, double *out) {
    double *pair = room->slope + body->p->modes;
    memcpy(out, room->slope, (size_t)body->p->modes * sizeof(double));
    /* A pair's product changes by both of its factors. */
    for (int64_t i = 0; i < body->p->mass_squares; i++) pair[i] *= 2.0;
    add_times(pair, q, body->p->slow_modes, out);
}

/* What a table's columns do to v M v / 2 at a fixed v. */
static void kinetic_slope(const Body *body, const double *v, const double *table, int64_t columns, Polynomial *room, double *slope) {
    const Program *p = body->p;
    const int64_t r = p->inertial_modes;
    double *rate = room->rates;
    for (int64_t a = 0; a < r; a++)
        for (int64_t b = a; b < r; b++) *rate++ = 0.5 * v[a] * v[b];
    rows_times(p->mass_form, room->rates, room->value, p->mass_forms, p->mass_pairs);
    memset(slope, 0, (size_t)columns * sizeof(double));
    add_rows(room->value, table, slope, p->mass_forms, columns);
}

void polynomial_gradient(const Body *body, const double *q, const double *v, Polynomial *room, double *out) {
    kinetic_slope(body, v, body->p->mass_value, body->p->modes + body->p->mass_squares, room, room->slope);
    by_coordinates(body, q, room, out);
}

/* Products of q beyond pairs of its first coordinates, each of a coordinate and what stands before it, behind these. */
static void products(const Program *p, const double *q, double *x) {
    double *next = x + p->modes + p->mass_squares;
    powers(p, q, x);
    for (int64_t k = 0; k < p->mass_products; k++) *next++ = q[p->mass_factor[2 * k]] * x[p->mass_factor[2 * k + 1]];
}

void omitted_momentum(const Body *body, const double *q, const double *v, Polynomial *room, double *out) {
    const Program *p = body->p;
    if (!p->inertial) {
        polynomial_momentum(body, q, v, room, out);
        return;
    }
    products(p, q, room->x);
    rows_times(p->mass_further, room->x + p->modes + p->mass_squares, room->value, p->mass_forms, p->mass_products);
    memset(room->pairs, 0, (size_t)p->mass_pairs * sizeof(double));
    add_rows(room->value, p->mass_form, room->pairs, p->mass_forms, p->mass_pairs);
    memset(out, 0, (size_t)p->modes * sizeof(double));
    add_times(room->pairs, v, p->inertial_modes, out);
}

void omitted_gradient(const Body *body, const double *q, const double *v, Polynomial *room, double *out) {
    const Program *p = body->p;
    const int64_t before = p->modes + p->mass_squares;
    if (!p->inertial) {
        polynomial_gradient(body, q, v, room, out);
        return;
    }
    products(p, q, room->x);
    kinetic_slope(body, v, p->mass_further, p->mass_products, room, room->slope + before);
    memset(room->slope, 0, (size_t)before * sizeof(double));
    memset(out, 0, (size_t)p->modes * sizeof(double));
    for (int64_t k = 0; k < p->mass_products; k++) {
        const int64_t one = p->mass_factor[2 * k], other = p->mass_factor[2 * k + 1];
        const double by = room->slope[before + k];
        out[one] += by * room->x[other];
        room->slope[other] += by * q[one];
    }
    double *kept = room->x;
    by_coordinates(body, q, room, kept);
    for (int64_t j = 0; j < p->modes; j++) out[j] += kept[j];
}

int factor_mass(double *mass, int64_t n) {
    if (!cholesky(mass, n, 0)) return 0;
    /* The square of a pivot is the mass of some motion. */
    for (int64_t j = 0; j < n; j++)
        if (!(mass[j * n + j] * mass[j * n + j] > LEAST_MASS)) return 0;
    return 1;
}

void polynomial_centre(const Body *body, const double *q, Polynomial *room, double *centre, double *derivative) {
    const Program *p = body->p;
    const int64_t columns = p->modes + p->mass_squares;
    powers(body->p, q, room->slope);
    rows_times(p->mass_centre, room->slope, centre, 3, columns);
    for (int i = 0; i < 3; i++) {
        memcpy(room->slope, p->mass_centre + i * columns, (size_t)columns * sizeof(double));
        by_coordinates(body, q, room, derivative + i * p->modes);
    }
}

void polynomial_convective(const Body *body, const double *q, const double *v, Polynomial *room, double *out) {
    const int64_t r = body->p->slow_modes, m = body->p->modes;
    double *x = room->x + m;
    polynomial_gradient(body, q, v, room, out);
    for (int64_t j = 0; j < m; j++) out[j] = -out[j];
    memcpy(room->x, v, (size_t)m * sizeof(double));
    for (int64_t a = 0; a < r; a++)
        for (int64_t b = a; b < r; b++) *x++ = q[a] * v[b] + v[a] * q[b];
    by_pairs(body, room, room->rates);
    add_times(room->rates, v, body->p->inertial_modes, out);
}
