/* Small dense linear algebra on row-major arrays. Nothing is allocated. */
#ifndef FLEX_ALGEBRA_H
#define FLEX_ALGEBRA_H

#include <stdint.h>

/* A build that counts the floating-point operations of these functions; what others do by the number is not counted. */
#ifdef FLEX_COUNT
__attribute__((visibility("default"))) extern int64_t flex_operations;
#define COUNT(operations) (flex_operations += (operations))
#else
#define COUNT(operations) ((void)0)
#endif

double dot(const double *a, const double *b, int64_t n);
double norm(const double *x, int64_t n);

/* out (m) += x (n) M, M (n, m). */
void add_rows(const double *x, const double *matrix, double *out, int64_t n, int64_t m);
/* The same of m columns of a matrix whose rows lie `stride` apart. */
void add_strided_rows(const double *x, const double *matrix, int64_t stride, double *out, int64_t n, int64_t m);
/* out (n) = M x, M (n, m). */
void rows_times(const double *matrix, const double *x, double *out, int64_t n, int64_t m);
/* out (n, k) = A B with A (n, m), B (m, k). */
void product(const double *a, const double *b, double *out, int64_t n, int64_t m, int64_t k);
/* out (m, k) += Aᵀ B with A (n, m), B (n, k). */
void add_transposed_product(const double *a, const double *b, double *out, int64_t n, int64_t m, int64_t k);

/* LU with row exchanges in place, a (n, n); 0 where a is singular. */
int lu_factor(double *a, int64_t *pivot, int64_t n);
/* b (n, columns) becomes the solution. */
void lu_solve(const double *a, const int64_t *pivot, double *b, int64_t n, int64_t columns);
/* Lower Cholesky factor in place; 0 where a (its lower half) is not positive definite. */
int cholesky(double *a, int64_t n);
/* L⁻¹ A L⁻ᵀ in place for a symmetric a (n, n). */
void congruent(const double *lower, double *a, int64_t n);
/* Eigenvalues of a symmetric a (n, n), ascending, which is destroyed; vectors in the columns of v unless null. */
void symmetric_eigen(double *a, double *values, double *v, int64_t n);
/* Smallest real part of the eigenvalues of any a (n, n), which is destroyed; NaN where the iteration fails. */
double smallest_real_part(double *a, int64_t n);

/* Three dimensions. */
void cross(const double *a, const double *b, double *out);
/* out = M x, out = Mᵀ x, out = A B; all (3, 3). */
void apply(const double *m, const double *x, double *out);
void apply_back(const double *m, const double *x, double *out);
void multiply(const double *a, const double *b, double *out);
void skew(const double *v, double *out);
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
