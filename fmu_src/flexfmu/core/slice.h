/* Work that is too much for one call, done by several: the code goes through all of it in each call, and does the pieces that
 * are due. What goes from piece to piece lies in work arrays that stay. */
#ifndef FLEX_SLICE_H
#define FLEX_SLICE_H

#include <math.h>
#include <stdint.h>
#include <string.h>

/* What can be done at once only; what is to be done again, of joints without tension, or first without that of stretches. */
enum { FAILED_PIECEMEAL = 2, FAILED_TENSE, FAILED_STEEP };
/* Bits of what is done otherwise. */
enum { SLACK = 1, EASED = 2 };

/* Costs are in multiplications. Without a slice all pieces are due. */
typedef struct {
    int64_t met, done;          /* pieces met in this call; pieces done so far */
    double spent, until, whole; /* cost of those done; where this call ends, or one of the below; of all there are */
    int failed, fresh, otherwise; /* no piece is due any more; none was done in this call; how it is done again */
} Slice;

/* A call that only counts, and one that has done its share: what comes later need not be met. */
#define COUNTS (-2.0)
#define OVER (-1.0)
static inline int over(const Slice *slice) { return slice && slice->until == OVER; }

/* Pieces of a loop that are done now, `at` to `end`. */
typedef struct {
    int64_t at, end;
} Rows;

/* Those of `count` pieces of like cost. */
static inline Rows rows_due(Slice *slice, int64_t count, double cost) {
    Rows rows = {0, count};
    if (!slice) return rows;
    const int64_t before = slice->done - slice->met;
    if (slice->until == COUNTS) slice->whole += (double)count * cost;
    slice->met += count;
    rows.at = rows.end = before < 0 ? 0 : before < count ? before : count;
    if (rows.at == count || slice->failed) return rows;
    const double room = slice->until - slice->spent, left = (double)(count - rows.at);
    /* What is too much for any call is done by one that has done nothing else. */
    const int64_t now = room < 0.5 * cost ? slice->fresh : left * cost <= room ? count - rows.at : (int64_t)(room / cost + 0.5);
    rows.end += now < count - rows.at ? now : count - rows.at;
    slice->spent += (double)(rows.end - rows.at) * cost;
    slice->done += rows.end - rows.at;
    slice->fresh = slice->fresh && rows.end == rows.at;
    /* Nor is a smaller one that comes later. */
    if (rows.end < count && slice->until != COUNTS) slice->until = OVER;
    return rows;
}

/* The same of rows that products take by the four: so do their pieces, of each of which this is the cost. */
typedef struct {
    int64_t at, count;
} Fours;
static inline Fours fours_due(Slice *slice, int64_t rows, double cost) {
    const int64_t fours = (rows + 3) / 4;
    const Rows now = rows_due(slice, fours, cost);
    return (Fours){4 * now.at, now.at == now.end ? 0 : (now.end == fours ? rows : 4 * now.end) - 4 * now.at};
}

static inline int due(Slice *slice, double cost) {
    const Rows rows = rows_due(slice, 1, cost);
    return rows.at < rows.end;
}

/* The pair i >= k of a triangle's number: rows one after the other. */
static inline void pair_of(int64_t number, int64_t *i, int64_t *k) {
    *i = 0;
    while (number > *i) number -= ++*i;
    *k = number;
}
static inline int64_t pairs_of(int64_t n) { return n * (n + 1) / 2; }
/* The same i >= k < n, columns one after the other: what a column needs of others does not wait for what is above it. */
static inline void column_pair_of(int64_t number, int64_t n, int64_t *i, int64_t *k) {
    pair_of(pairs_of(n) - 1 - number, k, i);
    *i = n - 1 - *i;
    *k = n - 1 - *k;
}

/* Rows (e) of one matrix into another, and rows of zeros. Each by itself: few instructions, but memory that is far away. */
static inline double cost_of_copy(int64_t e) { return 20.0 + 3.0 * (double)e; }
static inline void copy_rows(const double *from, double *to, int64_t e, Rows rows) {
    for (int64_t i = rows.at; i < rows.end; i++) memcpy(to + i * e, from + i * e, (size_t)e * sizeof(double));
}
static inline void clear_rows(double *to, int64_t e, Rows rows) {
    for (int64_t i = rows.at; i < rows.end; i++) memset(to + i * e, 0, (size_t)e * sizeof(double));
}

/* 0, as the answer of what cannot go on. */
static inline int fails(Slice *slice) {
    if (slice) slice->failed = 1;
    return 0;
}

/* Whether all pieces met so far were done, so that what they have found is known. */
static inline int caught_up(const Slice *slice) { return !slice || (slice->until >= 0.0 && slice->met <= slice->done); }

/* Whether so many pieces lie behind, which then are met. */
static inline int passed(Slice *slice, int64_t pieces) {
    if (!slice || slice->met + pieces > slice->done) return 0;
    slice->met += pieces;
    return 1;
}

/* Rows of a triangle whose pieces lie behind, which then are met: those of the first k are k (2n + 1 - k). */
static inline int64_t rows_passed(Slice *slice, int64_t n) {
    if (!slice || slice->until == COUNTS || slice->done <= slice->met) return 0;
    const double all = (double)(2 * n + 1), behind = (double)(slice->done - slice->met);
    const int64_t k = (int64_t)(0.5 * (all - sqrt(all * all - 4.0 * behind)));
    return passed(slice, k * (2 * n + 1 - k)) ? k : 0;
}

/* The same, or so many of like cost that are only counted. */
static inline int dealt_with(Slice *slice, int64_t pieces, double cost) {
    if (!slice || slice->until != COUNTS) return passed(slice, pieces);
    slice->whole += (double)pieces * cost;
    slice->met += pieces;
    return 1;
}

/* Pieces of a block, which the call that counts finds: where it begins; -1 where it lies behind, and is met at once. */
static inline int64_t enter_block(Slice *slice, const double *pieces) {
    if (!slice || slice->until == COUNTS) return slice ? slice->met : 0;
    return passed(slice, (int64_t)*pieces) ? -1 : slice->met;
}
static inline void leave_block(const Slice *slice, int64_t began, double *pieces) {
    if (slice && slice->until == COUNTS) *pieces = (double)(slice->met - began);
}

/* Whether what the call that counts has laid out is still there. */
static inline int laid_out(const Slice *slice) { return slice && slice->until != COUNTS; }

static inline int failed(const Slice *slice) { return slice && slice->failed; }

#endif
