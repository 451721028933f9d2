/* What earlier rounds of an iteration have shown of how errors follow from changes.
 * Source: D. G. Anderson, J. ACM 12 (1965) 547. */
#ifndef FLEX_LEARNING_H
#define FLEX_LEARNING_H

#include "arena.h"

/* Pairs of errors, orthonormal as they are weighed, and of the means that made them, side by side; the pair in the making comes
 * last, with the error and the mean of the round before. */
typedef struct {
    int64_t size, most; /* of an error; of rounds */
    int64_t pairs;
    double *seen;
} Learning;

void take_learning(int64_t size, int64_t most, Arena *arena, Learning *learning);
/* Take what earlier rounds have shown out of the error at hand: `change`, an error of the mean, becomes the change to be
 * subtracted. Returns the weighed square of that error: where the last round has shown nothing new, the change may be small
 * and the error is not. */
double learn(Learning *learning, const double *weight, const double *mean, int64_t round, double *change);

#endif
