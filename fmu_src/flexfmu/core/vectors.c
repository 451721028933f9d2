/* The loops that take most of the time, in vectors of the processor at hand.
 *
 * Each loop is written once and compiled twice, for vectors that every processor has and for those of four numbers. No
 * operation is fused or taken in another order in one than in the other: results are the same bits. */
#include "vectors.h"

#include <string.h>

#if defined(__x86_64__) && !defined(FLEX_NARROW)
#include <cpuid.h>
#include <immintrin.h>

#define ALIKE static inline __attribute__((always_inline))
#define WIDE __attribute__((target("avx")))

/* The only number that is no function's own: whether the processor has vectors of four; set while the library is loaded. */
static int wide;

__attribute__((constructor)) static void look_at_processor(void) {
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_OSXSAVE) || !(c & bit_AVX)) return;
    /* The system has to keep these registers, too. */
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    wide = (low & 6) == 6;
}

#define COMPILE(result, name, parameters, arguments)                                     \
    WIDE static result name##_wide parameters { return name##_body arguments; }        \
    result name parameters { return wide ? name##_wide arguments : name##_body arguments; }
#else
#define ALIKE static inline
#define COMPILE(result, name, parameters, arguments) \
    result name parameters { return name##_body arguments; }
#endif

/* Four sums at a time: a single one would wait for itself. */
ALIKE double dot_body(const double *a, const double *b, int64_t n) {
    COUNT(2 * n);
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    int64_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (int k = 0; k < 4; k++) sum[k] += a[i + k] * b[i + k];
    for (; i < n; i++) sum[0] += a[i] * b[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

COMPILE(double, dot, (const double *a, const double *b, int64_t n), (a, b, n))

ALIKE void add_strided_rows_body(const double *x, const double *matrix, int64_t stride, double *restrict out, int64_t n, int64_t m) {
    int64_t i = 0;
    /* Four rows at a time: one pass over `out` for eight operations an element. */
    for (; i + 4 <= n; i += 4) {
        const double *a = matrix + i * stride, *b = a + stride, *c = b + stride, *d = c + stride;
        const double p = x[i], q = x[i + 1], r = x[i + 2], s = x[i + 3];
        if (p == 0.0 && q == 0.0 && r == 0.0 && s == 0.0) continue;
        COUNT(8 * m);
        for (int64_t j = 0; j < m; j++) out[j] += (p * a[j] + q * b[j]) + (r * c[j] + s * d[j]);
    }
    for (; i < n; i++) {
        const double *row = matrix + i * stride;
        const double factor = x[i];
        if (factor == 0.0) continue;
        COUNT(2 * m);
        for (int64_t j = 0; j < m; j++) out[j] += factor * row[j];
    }
}

COMPILE(void, add_strided_rows, (const double *x, const double *matrix, int64_t stride, double *restrict out, int64_t n, int64_t m),
        (x, matrix, stride, out, n, m))

#if defined(__x86_64__) && !defined(FLEX_NARROW)
/* By the four, of four rows, as many as there are: what compilers make of the loop takes half as long again. */
WIDE static int64_t add_short_rows_wide(const double *factor, const int16_t *rows, int64_t stride, double *out, int64_t m) {
    int64_t j = 0;
    for (; j + 4 <= m; j += 4) {
        __m256d product[4];
        for (int k = 0; k < 4; k++) {
            const __m128i four = _mm_loadl_epi64((const __m128i *)(const void *)(rows + k * stride + j));
            product[k] = _mm256_mul_pd(_mm256_set1_pd(factor[k]), _mm256_cvtepi32_pd(_mm_cvtepi16_epi32(four)));
        }
        const __m256d sum = _mm256_add_pd(_mm256_add_pd(product[0], product[1]), _mm256_add_pd(product[2], product[3]));
        _mm256_storeu_pd(out + j, _mm256_add_pd(_mm256_loadu_pd(out + j), sum));
    }
    return j;
}
#endif

void add_strided_shorts(const double *x, const double *unit, const int16_t *matrix, int64_t stride, double *out, int64_t n, int64_t m) {
    int64_t i = 0;
    for (; i + 4 <= n; i += 4) {
        const int16_t *a = matrix + i * stride, *b = a + stride, *c = b + stride, *d = c + stride;
        const double factor[4] = {x[i] * unit[i], x[i + 1] * unit[i + 1], x[i + 2] * unit[i + 2], x[i + 3] * unit[i + 3]};
        int64_t j = 0;
        if (factor[0] == 0.0 && factor[1] == 0.0 && factor[2] == 0.0 && factor[3] == 0.0) continue;
        COUNT(8 * m);
#if defined(__x86_64__) && !defined(FLEX_NARROW)
        if (wide) j = add_short_rows_wide(factor, a, stride, out, m);
#endif
        for (; j < m; j++) out[j] += (factor[0] * a[j] + factor[1] * b[j]) + (factor[2] * c[j] + factor[3] * d[j]);
    }
    for (; i < n; i++) {
        const double factor = x[i] * unit[i];
        if (factor == 0.0) continue;
        COUNT(2 * m);
        for (int64_t j = 0; j < m; j++) out[j] += factor * matrix[i * stride + j];
    }
}

ALIKE void add_product_body(const double *a, int64_t stride, const double *b, double *restrict out, int64_t n, int64_t m, int64_t k) {
    int64_t i = 0;
    for (; i + 4 <= m; i += 4)
        for (int64_t row = 0; row < n; row++) add_strided_rows_body(a + row * stride + i, b + i * k, k, out + row * k, 4, k);
    for (int64_t row = 0; row < n; row++) add_strided_rows_body(a + row * stride + i, b + i * k, k, out + row * k, m - i, k);
}

COMPILE(void, add_product,
        (const double *a, int64_t stride, const double *b, double *restrict out, int64_t n, int64_t m, int64_t k),
        (a, stride, b, out, n, m, k))

ALIKE void add_transposed_product_body(const double *a, const double *b, double *restrict out, int64_t n, int64_t m, int64_t k) {
    int64_t i = 0;
    /* Four rows in one pass over `out`, one after the other: the same sums. */
    for (; i + 4 <= n; i += 4)
        for (int64_t j = 0; j < m; j++) {
            const double *each = a + i * m + j, *row = b + i * k;
            const double p = each[0], q = each[m], r = each[2 * m], s = each[3 * m];
            double *target = out + j * k;
            if (p == 0.0 && q == 0.0 && r == 0.0 && s == 0.0) continue;
            COUNT(8 * k);
            for (int64_t l = 0; l < k; l++)
                target[l] = (((target[l] + p * row[l]) + q * row[k + l]) + r * row[2 * k + l]) + s * row[3 * k + l];
        }
    for (; i < n; i++)
        for (int64_t j = 0; j < m; j++) {
            const double factor = a[i * m + j];
            const double *row = b + i * k;
            double *target = out + j * k;
            if (factor == 0.0) continue;
            COUNT(2 * k);
            for (int64_t l = 0; l < k; l++) target[l] += factor * row[l];
        }
}

COMPILE(void, add_transposed_product, (const double *a, const double *b, double *restrict out, int64_t n, int64_t m, int64_t k),
        (a, b, out, n, m, k))

ALIKE void add_two_rows_body(double p, const double *a, double q, const double *b, double *restrict out, int64_t m) {
    COUNT(4 * m);
    for (int64_t j = 0; j < m; j++) out[j] += p * a[j] + q * b[j];
}

COMPILE(void, add_two_rows, (double p, const double *a, double q, const double *b, double *restrict out, int64_t m), (p, a, q, b, out, m))

#ifdef FLEX_COUNT
int64_t flex_operations;
#endif

/* Rows of packed matrices that go together: each number is loaded once and used twice, for its row and for its column. */
enum { BLOCK = 4 };

static int64_t rows_of_group(int64_t a, int64_t r) { return r - a < BLOCK ? 1 : BLOCK; }

int64_t packed_groups(int64_t r) { return r / BLOCK + r % BLOCK; }

/* Where the rows of a group begin. */
static int64_t first_row(int64_t group, int64_t r) { return group < r / BLOCK ? group * BLOCK : r / BLOCK * BLOCK + group - r / BLOCK; }

/* Numbers of the rows before a. */
static int64_t packed_before(int64_t a, int64_t r) {
    const int64_t most = r / BLOCK * BLOCK, whole = a < most ? a : most, blocks = whole / BLOCK, rest = a - whole;
    const int64_t pairs = BLOCK * (blocks * r - BLOCK * blocks * (blocks - 1) / 2) + rest * (r - whole) - rest * (rest - 1) / 2;
    return LANES * pairs;
}

int64_t packed_size(int64_t r) { return packed_before(r, r); }

int64_t packed_total(int64_t matrices, int64_t r) { return (matrices + LANES - 1) / LANES * packed_size(r); }

#if defined(__x86_64__) && !defined(FLEX_NARROW)
/* Rows a to a + BLOCK of four matrices: sums of their numbers times factors in the order of add_packed. */
WIDE static void add_block_wide(const double *factors, const double *packed, double *out, int64_t r, int64_t a) {
    const __m256d factor = _mm256_loadu_pd(factors);
    for (int64_t b = a; b < r; b++, packed += BLOCK * LANES) {
        __m256d product[BLOCK];
        double sums[BLOCK];
        for (int row = 0; row < BLOCK; row++) product[row] = _mm256_mul_pd(factor, _mm256_loadu_pd(packed + row * LANES));
        const __m256d first = _mm256_hadd_pd(product[0], product[1]), last = _mm256_hadd_pd(product[2], product[3]);
        const __m256d sum = _mm256_add_pd(_mm256_permute2f128_pd(first, last, 0x20), _mm256_permute2f128_pd(first, last, 0x31));
        _mm256_storeu_pd(sums, sum);
        for (int row = 0; row < BLOCK; row++) out[(a + row) * r + b] += sums[row];
        if (b >= a + BLOCK) _mm256_storeu_pd(out + b * r + a, _mm256_add_pd(_mm256_loadu_pd(out + b * r + a), sum));
    }
}
#endif

void add_packed(const double *factors, const double *packed, double *out, int64_t r, int64_t group, int64_t end) {
    COUNT(8 * r * r * (end - group) / packed_groups(r));
    const int64_t last = first_row(end, r);
    int64_t a = first_row(group, r);
    packed += packed_before(a, r);
    for (int64_t rows; a < last; a += rows) {
        rows = rows_of_group(a, r);
#if defined(__x86_64__) && !defined(FLEX_NARROW)
        if (wide && rows == BLOCK) {
            add_block_wide(factors, packed, out, r, a);
            packed += BLOCK * LANES * (r - a);
            continue;
        }
#endif
        for (int64_t b = a; b < r; b++)
            for (int64_t row = a; row < a + rows; row++, packed += LANES) {
                const double sum = (factors[0] * packed[0] + factors[1] * packed[1]) + (factors[2] * packed[2] + factors[3] * packed[3]);
                out[row * r + b] += sum;
                /* Within the block both of a pair are there. */
                if (b >= a + rows) out[b * r + row] += sum;
            }
    }
}

typedef double Two __attribute__((vector_size(16), aligned(8), may_alias));
/* Vectors of `Vector`, `parts` of which make LANES. */
#define DEFINE_TIMES(name, Vector, parts)                                                                \
    static void name(const double *packed, const double *restrict x, double *restrict out, int64_t r, int64_t first, int64_t end) { \
        for (int part = 0; part < parts; part++) {                                                       \
            const Vector *matrix = (const Vector *)packed + part;                                        \
            Vector *to = (Vector *)out + part;                                                           \
            int64_t a = first;                                                                           \
            for (; a + BLOCK <= r && a < end; a += BLOCK) {                                                         \
                Vector p = to[a * parts], q = to[(a + 1) * parts];                                       \
                Vector s = to[(a + 2) * parts], t = to[(a + 3) * parts];                                 \
                for (int64_t b = a; b < a + BLOCK; b++, matrix += BLOCK * parts) {                       \
                    p += matrix[0] * x[b];                                                               \
                    q += matrix[parts] * x[b];                                                           \
                    s += matrix[2 * parts] * x[b];                                                       \
                    t += matrix[3 * parts] * x[b];                                                       \
                }                                                                                        \
                for (int64_t b = a + BLOCK; b < r; b++, matrix += BLOCK * parts) {                       \
                    const Vector one = matrix[0], two = matrix[parts];                                   \
                    const Vector three = matrix[2 * parts], four = matrix[3 * parts];                    \
                    p += one * x[b];                                                                     \
                    q += two * x[b];                                                                     \
                    s += three * x[b];                                                                   \
                    t += four * x[b];                                                                    \
                    to[b * parts] += (one * x[a] + two * x[a + 1]) + (three * x[a + 2] + four * x[a + 3]); \
                }                                                                                        \
                to[a * parts] = p;                                                                       \
                to[(a + 1) * parts] = q;                                                                 \
                to[(a + 2) * parts] = s;                                                                 \
                to[(a + 3) * parts] = t;                                                                 \
            }                                                                                            \
            for (; a < end; a++) {                                                                       \
                Vector p = to[a * parts] + matrix[0] * x[a];                                             \
                matrix += parts;                                                                         \
                for (int64_t b = a + 1; b < r; b++, matrix += parts) {                                   \
                    p += matrix[0] * x[b];                                                               \
                    to[b * parts] += matrix[0] * x[a];                                                   \
                }                                                                                        \
                to[a * parts] = p;                                                                       \
            }                                                                                            \
        }                                                                                                \
    }

DEFINE_TIMES(packed_times_narrow, Two, 2)
#if defined(__x86_64__) && !defined(FLEX_NARROW)
typedef double Four __attribute__((vector_size(32), aligned(8), may_alias));
WIDE DEFINE_TIMES(packed_times_wide, Four, 1)
#endif

/* As `dot` of each row, four rows at a time: each number of x is loaded once, and no sum waits for itself. */
#define DEFINE_ROWS(name, Vector, parts, single)                                                         \
    static void name(const double *matrix, const double *x, double *out, int64_t n, int64_t m) {         \
        int64_t i = 0;                                                                                   \
        for (; i + 4 <= n; i += 4) {                                                                     \
            Vector sum[4][parts] = {{{0.0}}};                                                            \
            const double *rows = matrix + i * m;                                                         \
            int64_t j = 0;                                                                               \
            for (; j + 4 <= m; j += 4)                                                                   \
                for (int part = 0; part < parts; part++) {                                               \
                    const int64_t at = j + part * (4 / parts);                                           \
                    const Vector factor = *(const Vector *)(x + at);                                     \
                    for (int row = 0; row < 4; row++) sum[row][part] += *(const Vector *)(rows + row * m + at) * factor; \
                }                                                                                        \
            for (int row = 0; row < 4; row++) {                                                          \
                double four[4];                                                                          \
                memcpy(four, sum[row], sizeof four);                                                     \
                for (int64_t k = j; k < m; k++) four[0] += rows[row * m + k] * x[k];                     \
                out[i + row] = (four[0] + four[1]) + (four[2] + four[3]);                                \
            }                                                                                            \
        }                                                                                                \
        for (; i < n; i++) out[i] = single(matrix + i * m, x, m);                                        \
    }

DEFINE_ROWS(rows_times_narrow, Two, 2, dot_body)
#if defined(__x86_64__) && !defined(FLEX_NARROW)
WIDE DEFINE_ROWS(rows_times_wide, Four, 1, dot_wide)
#endif

void rows_times(const double *matrix, const double *x, double *out, int64_t n, int64_t m) {
    COUNT(8 * (n / 4) * m);
#if defined(__x86_64__) && !defined(FLEX_NARROW)
    if (wide) {
        rows_times_wide(matrix, x, out, n, m);
        return;
    }
#endif
    rows_times_narrow(matrix, x, out, n, m);
}

void packed_times(const double *packed, const double *x, double *out, int64_t r, int64_t group, int64_t end) {
    COUNT(2 * LANES * r * r * (end - group) / packed_groups(r));
    const int64_t first = first_row(group, r), last = first_row(end, r);
    for (int lane = 0; group == 0 && lane < LANES; lane++) memset(out + lane * r, 0, (size_t)r * sizeof(double));
    packed += packed_before(first, r);
#if defined(__x86_64__) && !defined(FLEX_NARROW)
    if (wide) {
        packed_times_wide(packed, x, out, r, first, last);
        return;
    }
#endif
    packed_times_narrow(packed, x, out, r, first, last);
}

/* Of a new sum, or one that goes on. */
#define DEFINE_LANES(name, Vector, parts)                                                                \
    static void name(const double *p, const double *a, const double *q, const double *b, double *restrict out, int64_t n, int more) { \
        for (int part = 0; part < parts; part++) {                                                       \
            const Vector *one = (const Vector *)a + part, *two = (const Vector *)b + part;               \
            const Vector by = ((const Vector *)p)[part], with = ((const Vector *)q)[part];               \
            Vector *to = (Vector *)out + part;                                                           \
            for (int64_t i = 0; more && i < n * parts; i += parts) to[i] += by * one[i] + with * two[i]; \
            for (int64_t i = 0; !more && i < n * parts; i += parts) to[i] = by * one[i] + with * two[i]; \
        }                                                                                                \
    }

DEFINE_LANES(add_lanes_narrow, Two, 2)
#if defined(__x86_64__) && !defined(FLEX_NARROW)
WIDE DEFINE_LANES(add_lanes_wide, Four, 1)
#endif

void add_lanes(const double *p, const double *a, const double *q, const double *b, double *out, int64_t n, int more) {
    COUNT(4 * LANES * n);
#if defined(__x86_64__) && !defined(FLEX_NARROW)
    if (wide) {
        add_lanes_wide(p, a, q, b, out, n, more);
        return;
    }
#endif
    add_lanes_narrow(p, a, q, b, out, n, more);
}

ALIKE void unpack_body(const double *restrict four, double *restrict rows, int64_t r) {
    double *restrict a = rows, *restrict b = a + r, *restrict c = b + r, *restrict d = c + r;
    for (int64_t j = 0; j < r; j++) {
        a[j] = four[LANES * j];
        b[j] = four[LANES * j + 1];
        c[j] = four[LANES * j + 2];
        d[j] = four[LANES * j + 3];
    }
}
COMPILE(void, unpack, (const double *restrict four, double *restrict rows, int64_t r), (four, rows, r))
