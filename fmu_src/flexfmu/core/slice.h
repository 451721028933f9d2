/* Work that is too much for one call, done by several: the code goes through all of it in each call, and does the pieces that
 * are due. What goes from piece to piece lies in work arrays that stay. */
#ifndef FLEX_SLICE_H
#define FLEX_SLICE_H

#include <stdint.h>

/* What can be done at once only. */
enum { FAILED_PIECEMEAL = 2 };

/* Costs are in multiplications. Without a slice all pieces are due. */
typedef struct {
    int64_t met, done;          /* pieces met in this call; pieces done so far */
    double spent, until, whole; /* cost of those done; where this call ends; of all that were met */
    int failed;                 /* no piece is due any more */
} Slice;

static inline int due(Slice *slice, double cost) {
    if (!slice) return 1;
    slice->whole += cost;
    if (slice->met++ < slice->done || slice->failed) return 0;
    if (slice->spent + 0.5 * cost > slice->until) {
        /* Nor is a smaller one that comes later. */
        slice->until = -1.0;
        return 0;
    }
    slice->spent += cost;
    slice->done++;
    return 1;
}

/* 0, as the answer of what cannot go on. */
static inline int fails(Slice *slice) {
    if (slice) slice->failed = 1;
    return 0;
}

/* The same of loops over rows: some of them make a piece, or a long one by itself. */
enum { ROWS = 4, LONG = 1000 };
static inline int row_due(Slice *slice, int64_t row, double cost, int *doing) {
    if (row % ROWS == 0 || cost > LONG) *doing = due(slice, cost > LONG ? cost : ROWS * cost);
    return *doing;
}

/* Whether all pieces met so far were done, so that what they have found is known. */
static inline int caught_up(const Slice *slice) { return !slice || slice->met <= slice->done; }

static inline int failed(const Slice *slice) { return slice && slice->failed; }

#endif
