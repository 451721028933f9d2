#include "learning.h"

#include <math.h>
#include <string.h>

/* Part of a difference of two rounds' errors that has to be new, for it to tell anything. */
static const double NEW = 1e-6;

void take_learning(int64_t size, int64_t most, Arena *arena, Learning *learning) {
    learning->size = size;
    learning->most = most;
    learning->pairs = 0;
    learning->seen = take(arena, 2 * (most + 1) * size);
}

double learn(Learning *learning, const double *weight, const double *mean, int64_t round, double *change) {
    const int64_t m = learning->size;
    double *seen = learning->seen, *error = seen + 2 * learning->most * m, *place = error + m;
    if (round == 1) learning->pairs = 0;
    double *y = seen + 2 * learning->pairs * m, *x = y + m;
    if (round > 1) {
        double whole = 0.0, left = 0.0;
        for (int64_t j = 0; j < m; j++) {
            y[j] = change[j] - error[j];
            x[j] = mean[j] - place[j];
            whole += weight[j] * y[j] * y[j];
        }
        for (int64_t i = 0; i < learning->pairs; i++) {
            const double *old = seen + 2 * i * m;
            double along = 0.0;
            for (int64_t j = 0; j < m; j++) along += weight[j] * y[j] * old[j];
            for (int64_t j = 0; j < 2 * m; j++) y[j] -= along * old[j];
        }
        for (int64_t j = 0; j < m; j++) left += weight[j] * y[j] * y[j];
        if (left > NEW * NEW * whole) {
            for (int64_t j = 0; j < 2 * m; j++) y[j] /= sqrt(left);
            learning->pairs++;
        }
    }
    double square = 0.0;
    for (int64_t j = 0; j < m; j++) square += weight[j] * change[j] * change[j];
    memcpy(error, change, (size_t)m * sizeof(double));
    memcpy(place, mean, (size_t)m * sizeof(double));
    for (int64_t i = 0; i < learning->pairs; i++) {
        const double *old = seen + 2 * i * m;
        double along = 0.0;
        for (int64_t j = 0; j < m; j++) along += weight[j] * error[j] * old[j];
        for (int64_t j = 0; j < m; j++) change[j] += along * (old[m + j] - old[j]);
    }
    return square;
}
