/* Small dense linear algebra on row-major arrays. Nothing is allocated. */
#ifndef FLEX_ALGEBRA_H
#define FLEX_ALGEBRA_H

#include <stdint.h>

#include "slice.h"
#include "vectors.h"

double norm(const double *x, int64_t n);
/* Of a null pointer, too. */
int all_zero(const double *x, int64_t count);
int all_finite(const double *x, int64_t count);

/* out (m) += x (n) M, M (n, m). */
void add_rows(const double *x, const double *matrix, double *out, int64_t n, int64_t m);
/* out (n, k) = A B with A (n, m), B (m, k). */
void product(const double *a, const double *b, double *out, int64_t n, int64_t m, int64_t k);

/* LU with row exchanges in place, a (n, n); 0 where a is singular. */
int lu_factor(double *a, int64_t *pivot, int64_t n, Slice *slice);
/* b (n, columns) becomes the solution. */
void lu_solve(const double *a, const int64_t *pivot, double *b, int64_t n, int64_t columns, Slice *slice);
/* The same of one column, several times as fast, with sums in another order. */
void lu_solve_one(const double *a, const int64_t *pivot, double *b, int64_t n, Slice *slice);
/* Lower Cholesky factor in place; 0 where a (its lower half) is not positive definite. */
int cholesky(double *a, int64_t n, Slice *slice);
/* b (n) becomes the solution for such a factor. */
void cholesky_solve(const double *lower, double *b, int64_t n);
/* L⁻¹ A L⁻ᵀ in place for a symmetric a (n, n). */
void congruent(const double *lower, double *a, int64_t n, Slice *slice);
/* Smallest eigenvalue of a symmetric matrix, which is overwritten, and its vector (n) of length 1; `work` has 4n + 2 numbers. */
void smallest_eigen(double *a, double *work, double *value, double *vector, int64_t n, Slice *slice);
/* Eigenvalues of a symmetric a (n, n), ascending, which is destroyed; vectors in the columns of v unless null. */
void symmetric_eigen(double *a, double *values, double *v, int64_t n);
/* Smallest real part of the eigenvalues of any a (n, n), which is destroyed; NaN where the iteration fails. */
double smallest_real_part(double *a, int64_t n);

/* Three dimensions; here, since calls would take longer than they do. */
static inline void cross(const double *a, const double *b, double *out) {
    COUNT(9);
    const double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
    out[2] = z;
}
/* out = M x, out = Mᵀ x, out = A B; all (3, 3). */
static inline void apply(const double *m, const double *x, double *out) {
    COUNT(15);
    double found[3];
    for (int i = 0; i < 3; i++) found[i] = m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2];
    for (int i = 0; i < 3; i++) out[i] = found[i];
}
static inline void apply_back(const double *m, const double *x, double *out) {
    COUNT(15);
    double found[3];
    for (int i = 0; i < 3; i++) found[i] = m[i] * x[0] + m[3 + i] * x[1] + m[6 + i] * x[2];
    for (int i = 0; i < 3; i++) out[i] = found[i];
}
static inline void multiply(const double *a, const double *b, double *out) {
    COUNT(45);
    double found[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) found[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    for (int i = 0; i < 9; i++) out[i] = found[i];
}
static inline void skew(const double *v, double *out) {
    const double x = v[0], y = v[1], z = v[2];
    out[0] = out[4] = out[8] = 0.0;
    out[1] = -z;
    out[2] = y;
    out[3] = z;
    out[5] = -x;
    out[6] = -y;
    out[7] = x;
}
/* out (3, m) = M X and Mᵀ X for X (3, m). */
void apply_rows(const double *m, const double *x, double *out, int64_t n);
void apply_back_rows(const double *m, const double *x, double *out, int64_t n);

/* Rotations (M. Geradin, A. Cardona, Flexible Multibody Dynamics, 2001, chapter 4): exp(phi^) and its left Jacobian T. */
void exponential(const double *phi, double *rotation, double *jacobian);
/* Derivative (3, 3) of Tᵀ(phi) moment by phi. */
void transposed_jacobian_derivative(const double *phi, const double *moment, double *out);
/* Derivative (3, 3) of T at phi in the direction `rate`. */
void jacobian_rate(const double *phi, const double *rate, double *out);
/* Rotation vector of a rotation matrix, by its unit quaternion. */
void rotation_vector(const double *rotation, double *out);

#endif
