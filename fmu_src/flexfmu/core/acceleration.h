/* Interface quasi-Newton: from what the coupled inputs changed and what came back, to the next change of inputs.
 *
 * The coupled inputs x settle where the residual r(x) = g(x) - x is zero; g(x) is what the FMUs' outputs ask for after a
 * step with x. Columns of V and W are differences of residuals and of inputs between evaluations. Least squares on V
 * takes away what is known of the residual, the rest goes through a model M of -dr/dx,
 *
 *     alpha = argmin |V alpha + r|,   change of x = W alpha + inverse of M (r + V alpha).
 *
 * With M = 1 this is IQN-ILS: J. Degroote, K.-J. Bathe, J. Vierendeels, Performance of a new partitioned procedure
 * versus a monolithic procedure in fluid-structure interaction, Computers and Structures 87 (2009) 793-801. */
#ifndef FLEX_ACCELERATION_H
#define FLEX_ACCELERATION_H

#include <stdint.h>

#include "arena.h"

/* Differences of one step, the oldest first. */
typedef struct {
    int64_t count;
    double *residuals, *inputs; /* (count, n): a difference of V and of W is a row */
} Secants;

/* What is known beforehand of g. */
typedef struct {
    double *slope;  /* (n, n): dg/dx, zero where unknown */
    int64_t *known; /* (n): inputs of whose g the slope is known */
    int whole;      /* whether nothing is missing: no input, and no effect of one on another */
} KnownResponse;

/* Work arrays of an update of n inputs. */
typedef struct {
    int64_t n, kept;
    double *basis, *triangle, *scaled, *alpha, *rest, *matrix, *right; /* basis, triangle, matrix: (n, n) */
    const double **residuals, **inputs;                                /* (n) differences that are kept */
    int64_t *pivot;
} Update;

void take_update(Arena *arena, Update *update, int64_t n);

/* change (n) of the coupled inputs that should make the residual (n) zero, and estimate (n): how far off they may still be.
 *
 * What neither differences nor model (null: none) explain of the residual is added in part only: by the stiffest response
 * seen so far, or `relaxation` where there are no differences. The small change tells the rest. How far off the inputs
 * are is judged by the softest response instead. Of the sets of differences (sets) the first is of this step, the others of
 * earlier ones, the newest first. scale (n), > 0, makes inputs of different kinds comparable. */
void quasi_newton_update(Update *update, const double *residual, const Secants *const *secants, int64_t sets, const double *scale,
                         double relaxation, const KnownResponse *model, double *change, double *estimate);

#endif
