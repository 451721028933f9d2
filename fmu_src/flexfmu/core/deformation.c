#include "deformation.h"

#include <math.h>
#include <string.h>

#include "algebra.h"

/* Round-off of the bound on what has not been looked at. */
static const double CAUTION = 1.0 + 1e-9;

void take_deformed(const Body *body, Arena *arena, Deformed *deformed) { deformed->q = take(arena, body->p->modes); }

/* The largest norm of `count` sets of `rows` rows times q; each of them in `sizes` unless null. */
static double largest_of(const double *matrix, int64_t count, int64_t rows, int64_t m, const double *q, double *sizes) {
    double largest = 0.0;
    for (int64_t i = 0; i < count; i++) {
        double found[6];
        rows_times(matrix + rows * i * m, q, found, rows, m);
        const double square = dot(found, found, rows);
        if (sizes) sizes[i] = sqrt(square);
        if (!(square <= largest)) largest = square;
    }
    return sqrt(largest);
}

double body_rotations(Body *body, const double *q, double *angles) {
    return largest_of(body->p->turning, body->p->turnings, 3, body->p->modes, q, angles);
}

double body_strain(Body *body, const double *q) { return largest_of(body->p->strain, body->p->strains, 6, body->p->modes, q, 0); }

/* The first coordinate that deforms: frames turn with rigid motions. */
static int64_t first_of(const Program *p) { return p->frames ? p->rigid : 0; }

/* What a change of the coordinates by one (J^0.5) changes of any of them at the most. */
static double reach_of(const Program *p, const double *matrix, int64_t count, int64_t rows) {
    double most = 0.0;
    for (int64_t i = 0; i < count; i++) {
        double sum = 0.0;
        for (int64_t row = rows * i; row < rows * (i + 1); row++)
            for (int64_t j = first_of(p); j < p->modes; j++) {
                const double scaled = matrix[row * p->modes + j] / p->weight[j];
                sum += scaled * scaled;
            }
        most = fmax(most, sum);
    }
    return CAUTION * sqrt(most);
}

void find_reach(Opened *opened) {
    const Program *p = &opened->p;
    opened->rotation_reach = reach_of(p, p->turning, p->turnings, 3);
    opened->strain_reach = reach_of(p, p->strain, p->strains, 6);
}

int deforms_within(Body *body, const double *q, double rotation, double strain) {
    const Program *p = body->p;
    Deformed *last = &body->deformed;
    double square[2] = {0.0, 0.0};
    for (int64_t j = first_of(p); j < p->modes; j++) {
        const double change = p->weight[j] * (q[j] - last->q[j]);
        square[j % 2] += change * change;
    }
    const double way = CAUTION * sqrt(square[0] + square[1]);
    if (last->rotation + body->opened->rotation_reach * way <= rotation && last->strain + body->opened->strain_reach * way <= strain) return 1;
    memcpy(last->q, q, (size_t)p->modes * sizeof(double));
    last->rotation = body_rotations(body, q, 0);
    last->strain = body_strain(body, q);
    return last->rotation <= rotation && last->strain <= strain;
}
