#include "acceleration.h"

#include <math.h>
#include <string.h>

#include "algebra.h"

/* Least new part of a difference: of this step, where less is noise, and of earlier ones. Those are off by the curvature
 * between steps, some per mille, which a smaller new part would divide: the inputs would jump by far. */
static const double DEPENDENT = 1e-6, DEPENDENT_EARLIER = 1e-3;

void take_update(Arena *arena, Update *update, int64_t n) {
    double **const squares[] = {&update->basis, &update->triangle, &update->matrix};
    double **const rows[] = {&update->scaled, &update->alpha, &update->rest, &update->right};
    update->n = n;
    for (int i = 0; i < 3; i++) *squares[i] = take(arena, n * n);
    for (int i = 0; i < 4; i++) *rows[i] = take(arena, n);
    /* A pointer is no longer than a number. */
    update->residuals = (const double **)take(arena, n);
    update->inputs = (const double **)take(arena, n);
    update->pivot = (int64_t *)take(arena, n);
}

/* Keep a difference if it adds a direction to those kept: an orthonormal row of the basis. */
static void keep(Update *u, const double *residuals, const double *inputs, const double *scale, double least) {
    const int64_t n = u->n;
    double *row = u->basis + u->kept * n;
    for (int64_t i = 0; i < n; i++) row[i] = u->scaled[i] = residuals[i] / scale[i];
    const double size = norm(row, n);
    /* Twice is enough to be orthogonal to round-off. */
    for (int pass = 0; pass < 2; pass++) {
        for (int64_t k = 0; k < u->kept; k++) u->alpha[k] = -dot(u->basis + k * n, row, n);
        add_rows(u->alpha, u->basis, row, u->kept, n);
    }
    const double rest = norm(row, n);
    if (!(size > 0.0 && isfinite(size) && rest > least * size)) return;
    for (int64_t i = 0; i < n; i++) row[i] /= rest;
    for (int64_t k = 0; k <= u->kept; k++) u->triangle[k * n + u->kept] = dot(u->basis + k * n, u->scaled, n);
    u->residuals[u->kept] = residuals;
    u->inputs[u->kept++] = inputs;
}

/* Smallest and largest ratio of inputs to residuals among the differences, at most one. */
static void responses(const Update *u, const double *scale, double *least, double *most) {
    *least = 1.0;
    *most = 0.0;
    for (int64_t k = 0; k < u->kept; k++) {
        double moved = 0.0, answered = 0.0;
        for (int64_t i = 0; i < u->n; i++) {
            const double input = u->inputs[k][i] / scale[i], residual = u->residuals[k][i] / scale[i];
            moved += input * input;
            answered += residual * residual;
        }
        const double ratio = fmin(sqrt(moved / answered), 1.0);
        *least = fmin(*least, ratio);
        *most = fmax(*most, ratio);
    }
}

/* out += inverse of M times what is left of the residual; where nothing is known M is 1/part. */
static void add_unexplained(Update *u, const double *scale, double part, const KnownResponse *model, double *out) {
    const int64_t n = u->n;
    if (model) {
        for (int64_t i = 0; i < n; i++) {
            for (int64_t j = 0; j < n; j++) u->matrix[i * n + j] = -model->slope[i * n + j] * scale[j] / scale[i];
            u->matrix[i * n + i] += model->known[i] ? 1.0 : 1.0 / part;
            u->right[i] = u->rest[i] / scale[i];
        }
        if (lu_factor(u->matrix, u->pivot, n, 0)) {
            lu_solve(u->matrix, u->pivot, u->right, n, 1, 0);
            for (int64_t i = 0; i < n; i++) out[i] += scale[i] * u->right[i];
            return;
        }
    }
    for (int64_t i = 0; i < n; i++) out[i] += part * u->rest[i];
}

void quasi_newton_update(Update *u, const double *residual, const Secants *const *secants, int64_t sets, const double *scale,
                         double relaxation, const KnownResponse *model, double *change, double *estimate) {
    const int64_t n = u->n;
    double least = relaxation, most = 1.0;
    u->kept = 0;
    for (int64_t set = 0; set < sets; set++)
        for (int64_t k = secants[set]->count - 1; k >= 0 && u->kept < n; k--)
            keep(u, secants[set]->residuals + k * n, secants[set]->inputs + k * n, scale, set ? DEPENDENT_EARLIER : DEPENDENT);
    for (int64_t i = 0; i < n; i++) u->scaled[i] = residual[i] / scale[i];
    for (int64_t k = u->kept - 1; k >= 0; k--) {
        double sum = -dot(u->basis + k * n, u->scaled, n);
        for (int64_t j = k + 1; j < u->kept; j++) sum -= u->triangle[k * n + j] * u->alpha[j];
        u->alpha[k] = sum / u->triangle[k * n + k];
    }
    memcpy(u->rest, residual, (size_t)n * sizeof *residual);
    memset(change, 0, (size_t)n * sizeof *change);
    for (int64_t k = 0; k < u->kept; k++)
        for (int64_t i = 0; i < n; i++) {
            u->rest[i] += u->alpha[k] * u->residuals[k][i];
            change[i] += u->alpha[k] * u->inputs[k][i];
        }
    memcpy(estimate, change, (size_t)n * sizeof *change);
    if (u->kept) responses(u, scale, &least, &most);
    add_unexplained(u, scale, least, model, change);
    add_unexplained(u, scale, most, model, estimate);
}
