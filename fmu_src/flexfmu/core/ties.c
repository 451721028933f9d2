#include "ties.h"

#include <string.h>

#include "algebra.h"
#include "forces.h"

void take_pull(const Body *body, Arena *arena, Pull *pull) {
    const int64_t n = body->p->pulls, m = body->p->modes;
    pull->rows = take(arena, n * m);
    pull->answer = take(arena, n * m);
    pull->hold = take(arena, n * n);
    pull->square = take(arena, n * n);
    pull->strain = take(arena, n);
    pull->force = take(arena, n);
    pull->loads = take(arena, 6 * body->p->nodes);
    pull->factors = take(arena, 6 * n * body->p->nodes);
    pull->bent = take(arena, n * body->p->bending * m);
}

/* Entry of the stiffness (6, 6) of a tie: the force on its end a, with its levers where that pulls, by motion relative to end b,
 * with those where that is strained. */
static double entry(const double *k, const double *pulled, const double *strained, int64_t i, int64_t j) {
    double sum = 0.0;
    if (i < 3 || j < 3) return i == j ? k[i] : 0.0;
    for (int c = 0; c < 3; c++) {
        double force[9], strain[9];
        skew(pulled + 3 * c, force);
        skew(strained + 3 * c, strain);
        for (int l = 0; l < 3; l++) sum += force[3 * l + i - 3] * k[l] * strain[3 * l + j - 3];
    }
    return sum;
}

/* J: how ends of ties move against each other. */
static void find_rows(const Body *body, const Configuration *at, Pull *pull) {
    const Program *p = body->p;
    const int64_t n = p->pulls, nodes = p->nodes;
    double *loads = pull->loads;
    memset(pull->rows, 0, (size_t)(n * p->modes) * sizeof(double));
    for (int64_t i = 0; i < n; i++) {
        const int64_t c = p->pull[i] % 6, a = nodes - 2 * p->ties + p->pull[i] / 6, b = a + p->ties;
        double *side = loads + (c < 3 ? 0 : 3 * nodes);
        memset(loads, 0, (size_t)(6 * nodes) * sizeof(double));
        side[3 * a + c % 3] = 1.0;
        side[3 * b + c % 3] = -1.0;
        gather(body, at, loads, loads + 3 * nodes, pull->factors + 6 * i * nodes);
    }
    add_times_derivative(body, at, pull->factors, n, pull->bent, pull->rows);
}

int pull_at(const Body *body, const Rule *rule, const Configuration *at, const Configuration *end, int64_t *pivot, Pull *pull) {
    const Program *p = body->p;
    const int64_t m = p->modes, n = p->pulls;
    double *shared = pull->strain;
    memset(pull->answer, 0, (size_t)(n * m) * sizeof(double));
    memset(pull->hold, 0, (size_t)(n * n) * sizeof(double));
    memset(pull->square, 0, (size_t)(n * n) * sizeof(double));
    find_rows(body, at, pull);
    add_product(pull->rows, m, rule->response, pull->answer, n, m, m);
    if (end != at) find_rows(body, end, pull);
    for (int64_t i = 0; i < n; i++) {
        const int64_t tie = p->pull[i] / 6, a = p->nodes - 2 * p->ties + tie;
        double pulled[9], strained[9];
        tie_levers(body, at, tie, a, pulled);
        tie_levers(body, end, tie, a, strained);
        for (int64_t j = 0; j < n; j++)
            if (p->pull[j] / 6 == tie)
                pull->hold[i * n + j] = entry(p->tie_stiffness + 3 * tie, pulled, strained, p->pull[i] % 6, p->pull[j] % 6);
        for (int64_t j = 0; j < m; j++) pull->answer[i * m + j] *= rule->gq[j];
    }
    for (int64_t i = 0; i < n; i++) {
        rows_times(pull->rows, pull->answer + i * m, shared, n, m);
        for (int64_t k = 0; k < n; k++) pull->square[k * n + i] += 0.5 * dot(pull->hold + k * n, shared, n);
        pull->square[i * n + i] += 1.0;
    }
    if (!lu_factor(pull->square, pivot, n, 0)) return 0;
    lu_solve(pull->square, pivot, pull->hold, n, n, 0);
    return 1;
}

void respond(const Body *body, const Rule *rule, Pull *pull, const double *x, const double *way, double *out) {
    const int64_t m = body->p->modes, n = body->p->pulls;
    rows_times(rule->response, x, out, m, m);
    for (int64_t j = 0; way && j < m; j++) out[j] += way[j];
    rows_times(pull->rows, out, pull->strain, n, m);
    rows_times(pull->hold, pull->strain, pull->force, n, n);
    for (int64_t i = 0; i < n; i++) pull->force[i] *= -0.5;
    add_rows(pull->force, pull->answer, out, n, m);
}
