/* Mass of the deformed body as a polynomial of its slow coordinates, (13a) of docs/theory.md section 9:
 *
 *     M(q) = 1 + sum over k of y_k(q) U_k,   y_k = l_k · q + q V_k q,   U_k and V_k symmetric.
 *
 * Pairs of coordinates a <= b go row by row; what belongs to a pair off the diagonal stands for both halves of its matrix. */
#ifndef FLEX_POLYNOMIAL_H
#define FLEX_POLYNOMIAL_H

#include "data.h"

/* Mass of any motion, over that of the undeformed body, below which the polynomial is out of its range. */
static const double LEAST_MASS = 0.1;

typedef struct {
    double *x, *slope; /* (m + p + n): q, its first ones' pairs and further products; what a change of them does */
    double *value;     /* (R): y */
    double *pairs, *rates; /* (p): M - 1 where it was last asked for; products of two rates, or dM/dt */
    double *at;        /* (m): that place */
    int known;
} Polynomial;

void take_polynomial(const Body *body, Arena *arena, Polynomial *room);
/* M - 1, (r, r), and its diagonal alone, (r). */
void polynomial_mass(const Body *body, const double *q, Polynomial *room, double *out);
void polynomial_diagonal(const Body *body, const double *q, Polynomial *room, double *out);
/* (M - 1) v, (m). */
void polynomial_momentum(const Body *body, const double *q, const double *v, Polynomial *room, double *out);
/* Derivative of v M(q) v / 2 by q at a fixed v, (m). */
void polynomial_gradient(const Body *body, const double *q, const double *v, Polynomial *room, double *out);
/* d(M v)/dt - d(v M v / 2)/dq - M dv/dt, (m). */
void polynomial_convective(const Body *body, const double *q, const double *v, Polynomial *room, double *out);

/* The same momentum and gradient of what the mass of steps leaves out: all beyond constant mass, or the polynomial's further
 * products; what was known of the place is not after the latter. */
void omitted_momentum(const Body *body, const double *q, const double *v, Polynomial *room, double *out);
void omitted_gradient(const Body *body, const double *q, const double *v, Polynomial *room, double *out);

/* Cholesky factor of the whole mass (n, n) in its place; 0 where the polynomial is out of its range. */
int factor_mass(double *mass, int64_t n);
/* Where the centre of mass has gone, seen from the root, and its derivative, (3, m). */
void polynomial_centre(const Body *body, const double *q, Polynomial *room, double *centre, double *derivative);

#endif
