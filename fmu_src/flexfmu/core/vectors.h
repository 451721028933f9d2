/* Products of several symmetric matrices with one vector. */
#ifndef FLEX_VECTORS_H
#define FLEX_VECTORS_H

#include <stdint.h>

enum { LANES = 4 };

/* Numbers of LANES matrices (r, r) once packed. */
int64_t packed_size(int64_t r);
/* Pack matrices (r, r), null for none: each pair of a row and a column once, the LANES matrices side by side. */
void pack_symmetric(const double *const *matrices, double *packed, int64_t r);
/* out (r, LANES) = matrices times x (r). */
void packed_times(const double *packed, const double *x, double *out, int64_t r);
/* rows (LANES, r) = the transpose of four (r, LANES). */
void unpack(const double *four, double *rows, int64_t r);

#endif
