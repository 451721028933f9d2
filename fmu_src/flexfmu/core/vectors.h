/* The products that take most of the time, and those of several symmetric matrices with one vector at once. */
#ifndef FLEX_VECTORS_H
#define FLEX_VECTORS_H

#include <stdint.h>

/* A build that counts the floating-point operations of these functions; what others do by the number is not counted. */
#ifdef FLEX_COUNT
__attribute__((visibility("default"))) extern int64_t flex_operations;
#define COUNT(operations) (flex_operations += (operations))
#else
#define COUNT(operations) ((void)0)
#endif

double dot(const double *a, const double *b, int64_t n);
/* out (m) += x (n) M of m columns of a matrix whose rows lie `stride` apart. */
void add_strided_rows(const double *x, const double *matrix, int64_t stride, double *out, int64_t n, int64_t m);
/* The same of whole numbers, those of each row in its unit. */
void add_strided_shorts(const double *x, const double *unit, const int16_t *matrix, int64_t stride, double *out, int64_t n, int64_t m);
/* out (m) += p a + q b. */
void add_two_rows(double p, const double *a, double q, const double *b, double *out, int64_t m);
/* out (n) = M x, M (n, m). */
void rows_times(const double *matrix, const double *x, double *out, int64_t n, int64_t m);
/* out (n, k) += A B with A (n, m), its rows `stride` apart, B (m, k): one pass over B. */
void add_product(const double *a, int64_t stride, const double *b, double *out, int64_t n, int64_t m, int64_t k);
/* out (m, k) += Aᵀ B with A (n, m), B (n, k). */
void add_transposed_product(const double *a, const double *b, double *out, int64_t n, int64_t m, int64_t k);

enum { LANES = 4 };

/* Numbers of LANES matrices (r, r) once packed. */
int64_t packed_size(int64_t r);
/* The same of any number of matrices. */
int64_t packed_total(int64_t matrices, int64_t r);
/* Groups of their rows, of which the following do those from one up to another, in turn. */
int64_t packed_groups(int64_t r);
/* out (r, LANES) = matrices times x (r). */
void packed_times(const double *packed, const double *x, double *out, int64_t r, int64_t group, int64_t end);
/* out (r, r) += the sum of matrices times factors (LANES). */
void add_packed(const double *factors, const double *packed, double *out, int64_t r, int64_t group, int64_t end);
/* out (n, LANES) = numbers a and b (n, LANES) times factors p and q (LANES); += where there is more than they. */
void add_lanes(const double *p, const double *a, const double *q, const double *b, double *out, int64_t n, int more);
/* rows (LANES, r) = the transpose of four (r, LANES). */
void unpack(const double *four, double *rows, int64_t r);

#endif
