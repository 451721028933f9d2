#include "pass_back.h"

#include <string.h>

#include "algebra.h"
#include "tree.h"

void add_times_bent(const Body *body, const double *turned, const double *factors, int64_t count, double *scratch,
                    double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes, each = p->bending * m;
    if (!p->curved) return;
    memset(scratch, 0, (size_t)(count * each) * sizeof(double));
    for (int64_t part = 0; part < p->bending; part++) {
        const Bend *bend = body->opened->bends + part;
        const int64_t r = p->extent[part];
        /* Rows that lie together by the run. Nothing is known of rows without a factor. */
        for (int64_t i = 0; i < count; i++)
            for (int64_t k = 0, end; k < bend->count; k = end) {
                const double *factor = factors + 6 * i * p->nodes + bend->row[k];
                for (end = k; end < bend->count && bend->row[end] == bend->row[k] + end - k && factor[end - k] != 0.0;) end++;
                if (end > k) add_rows(factor, turned + bend->start + k * r, scratch + i * each + part * m, end - k, r);
                end = end > k ? end : k + 1;
            }
    }
    for (int64_t part = 0; part < p->bending; part++) {
        const double *basis = part_basis(p, part), *own = scratch + part * m;
        if (basis)
            add_product(own, each, basis, out, count, p->extent[part], m);
        else
            for (int64_t i = 0; i < count; i++)
                for (int64_t j = 0; j < m; j++) out[i * m + j] += own[i * each + j];
    }
}

void add_times_derivative(const Body *body, const Configuration *at, const double *factors, int64_t count, double *scratch,
                          double *out) {
    const Program *p = body->p;
    const int64_t rows = moving_rows(p), fours = (rows + 3) / 4;
    const Rows now = rows_due(body->slice, fours, (double)(12 * p->modes * count));
    const int64_t first = 4 * now.at, many = now.end == fours ? rows - first : 4 * now.end - first;
    if (now.at < now.end) add_product(factors + first, 6 * p->nodes, p->operator_ + first * p->modes, out, count, many, p->modes);
    if (due(body->slice, 1.5 * (double)(rows * p->modes * count))) add_times_bent(body, at->turned, factors, count, scratch, out);
}

void gather(const Body *body, const Configuration *at, double *force, double *moment, double *rows) {
    const Program *p = body->p;
    /* Children stand after their parents. */
    for (int64_t k = p->nodes - 1; k >= 0; k--) {
        const int64_t on = p->parent[k];
        const double *parent = at->parent + 9 * k;
        double turned[3];
        if (no_load(force + 3 * k) && no_load(moment + 3 * k)) {
            /* Nothing is known of a node without loads that was not needed. */
            memset(rows + 3 * k, 0, 3 * sizeof(double));
            memset(rows + 3 * (p->nodes + k), 0, 3 * sizeof(double));
            continue;
        }
        apply_back(parent, force + 3 * k, rows + 3 * k);
        if (no_load(moment + 3 * k)) {
            memset(rows + 3 * (p->nodes + k), 0, 3 * sizeof(double));
        } else {
            apply_back(parent, moment + 3 * k, turned);
            apply_back(at->jacobian + 9 * k, turned, rows + 3 * (p->nodes + k));
        }
        if (on < 0) continue;
        double arm[3], about[3];
        for (int i = 0; i < 3; i++)
            arm[i] = (at->position[3 * k + i] - p->base[3 * k + i]) - (at->position[3 * on + i] - p->base[3 * on + i]);
        cross(arm, force + 3 * k, about);
        for (int i = 0; i < 3; i++) {
            force[3 * on + i] += force[3 * k + i];
            moment[3 * on + i] += moment[3 * k + i] + about[i];
        }
    }
}

void take_back(const Body *body, Arena *arena, Back *back) {
    back->rows = take(arena, 6 * body->p->nodes);
    back->bent = take(arena, body->p->bending * body->p->modes);
}

void pass_back(const Body *body, const Configuration *at, double *force, double *moment, Back *back, double *out) {
    if (due(body->slice, (double)(300 * body->p->nodes))) gather(body, at, force, moment, back->rows);
    add_times_derivative(body, at, back->rows, 1, back->bent, out);
}

/* Derivatives (6K, m) of b and phi by q. */
static void full_operator(const Body *body, const Configuration *at, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    copy_rows(p->operator_, out, m, rows_due(body->slice, 6 * p->nodes, cost_of_copy(m)));
    if (!p->curved) return;
    for (int64_t part = 0; part < p->bending; part++) {
        const Bend *bend = body->opened->bends + part;
        const double *basis = part_basis(p, part);
        const int64_t r = p->extent[part];
        const Rows now = rows_due(body->slice, bend->count, (double)(basis ? r * m : 2 * m));
        for (int64_t k = now.at; k < now.end; k++) {
            const double *turned = at->turned + bend->start + k * r;
            double *row = out + bend->row[k] * m;
            if (basis)
                add_rows(turned, basis, row, r, m);
            else
                for (int64_t j = 0; j < m; j++) row[j] += turned[j];
        }
    }
}

void take_jacobians(const Body *body, Arena *arena, Jacobians *of) {
    const int64_t size = body->p->nodes * body->p->modes;
    of->operator_ = take(arena, 6 * size);
    of->translation = take(arena, 3 * size);
    of->spin = take(arena, 3 * size);
}

void jacobians_at(const Body *body, const Configuration *at, Jacobians *of) {
    const Program *p = body->p;
    const double *operator_ = of->operator_;
    double *translation = of->translation, *spin = of->spin;
    const int64_t m = p->modes, size = 3 * m;
    int64_t pieces = 7 * p->nodes;
    for (int64_t part = 0; p->curved && part < p->bending; part++) pieces += body->opened->bends[part].count;
    if (passed(body->slice, pieces)) return;
    full_operator(body, at, of->operator_);
    const Rows now = rows_due(body->slice, p->nodes, (double)(20 * size));
    for (int64_t k = now.at; k < now.end; k++) {
        const int64_t on = p->parent[k];
        double both[9], arm[3], hat[9], *x = translation + k * size, *w = spin + k * size;
        multiply(at->parent + 9 * k, at->jacobian + 9 * k, both);
        apply_rows(both, operator_ + (p->nodes + k) * size, w, m);
        apply_rows(at->parent + 9 * k, operator_ + k * size, x, m);
        if (on < 0) continue;
        const double *from = translation + on * size, *turn = spin + on * size;
        apply(at->parent + 9 * k, at->local + 3 * k, arm);
        skew(arm, hat);
        for (int i = 0; i < 3; i++)
            for (int64_t j = 0; j < m; j++) {
                x[i * m + j] += from[i * m + j] -
                                (hat[3 * i] * turn[j] + hat[3 * i + 1] * turn[m + j] + hat[3 * i + 2] * turn[2 * m + j]);
                w[i * m + j] += turn[i * m + j];
            }
    }
}

void take_load_slope(const Body *body, Arena *arena, LoadSlope *slope) {
    const int64_t m = body->p->modes, n = body->p->nodes;
    slope->rows = take(arena, 6 * n);
    slope->total = take(arena, 3 * n);
    slope->about = take(arena, 3 * n);
    slope->change = take(arena, 3 * n * m);
    slope->one = take(arena, LANES * m);
    slope->other = take(arena, 3 * m);
    slope->square = take(arena, m * m);
}

/* What moments about each node gain as what lies beyond it moves: (K, 3, m), the sum of (x_d' - x_k') x f_d. */
static void lever_changes(const Body *body, const double *force, const double *translation, double *change) {
    const Program *p = body->p;
    const int64_t m = p->modes, n = p->nodes, size = 3 * m;
    Rows now = rows_due(body->slice, n, (double)(4 * size));
    for (int64_t k = now.at; k < now.end; k++) {
        double hat[9];
        skew(force + 3 * k, hat);
        for (int i = 0; i < 9; i++) hat[i] = -hat[i];
        apply_rows(hat, translation + k * size, change + k * size, m);
    }
    now = rows_due(body->slice, n, (double)(2 * size));
    for (int64_t k = n - 1 - now.at; k > n - 1 - now.end; k--) {
        const int64_t on = p->parent[k];
        if (on >= 0)
            for (int64_t j = 0; j < size; j++) change[on * size + j] += change[k * size + j];
    }
}

/* Rows of out (m, m) += aᵀ b of up to four rows (count, m). */
static void add_columns(const double *a, const double *b, double *out, int64_t count, int64_t m, Rows now) {
    if (now.end - now.at == m) {
        add_transposed_product(a, b, out, count, m, m);
        return;
    }
    for (int64_t j = now.at; j < now.end; j++) {
        double column[LANES];
        for (int64_t i = 0; i < count; i++) column[i] = a[i * m + j];
        add_transposed_product(column, b, out + j * m, count, 1, m);
    }
}

/* out (m, m) += what rows (6K) of loads on b and phi make of the curvature. */
static void add_curvature_stiffness(const Body *body, const double *rows, LoadSlope *room, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    double *one = room->one, *square = room->square;
    if (!p->curved) return;
    for (int64_t part = 0; part < p->bending; part++) {
        const int64_t r = p->extent[part];
        const double *basis = part_basis(p, part);
        const Bend *bend = body->opened->bends + part;
        const double *curvature = bend->curvature;
        const int64_t groups = packed_groups(r), size = packed_size(r);
        /* They are near, since the places have just been found by them. */
        const double cost = 0.5 * added_cost(r);
        clear_rows(square, r, rows_due(body->slice, r, cost_of_copy(r)));
        for (int64_t first = 0; first < bend->count && !over(body->slice); first += LANES, curvature += size) {
            double factors[LANES] = {0.0};
            if (dealt_with(body->slice, groups, cost)) continue;
            for (int64_t k = first; k < first + LANES && k < bend->count; k++) factors[k - first] = rows[bend->row[k]];
            add_four(body, factors, curvature, square, r, cost);
        }
        if (!basis) {
            const Rows now = rows_due(body->slice, m, (double)(3 * m));
            for (int64_t j = now.at * m; j < now.end * m; j++) out[j] += square[j];
            continue;
        }
        /* Basisᵀ square basis, some rows of the middle at a time. */
        for (int64_t i = 0; i < r && !over(body->slice); i += LANES) {
            const int64_t count = r - i < LANES ? r - i : LANES;
            const double of_row = 1.2 * (double)(r * m), of_column = (1.4 + 0.7 * (double)count) * (double)m;
            if (dealt_with(body->slice, count + m, ((double)count * of_row + (double)m * of_column) / (double)(count + m))) continue;
            Rows now = rows_due(body->slice, count, of_row);
            product(square + (i + now.at) * r, basis, one + now.at * m, now.end - now.at, r, m);
            now = rows_due(body->slice, m, of_column);
            add_columns(basis + i * m, one, out, count, m, now);
        }
    }
}

static double three_cost(int64_t m) { return 4.0 * (double)m; }
/* out (m, m) += aᵀ b of three rows (3, m). */
static void add_three_products(const Body *body, const double *a, const double *b, double *out) {
    const int64_t m = body->p->modes;
    const Rows now = rows_due(body->slice, m, three_cost(m));
    if (now.at < now.end && !all_zero(b, 3 * m)) add_columns(a, b, out, 3, m, now);
}

/* What turns with a node (3, m) as the loads on it and beyond it move: in the parent's axes, in `other`. */
static void turned_in_parent(const Body *body, const Configuration *at, int64_t k, const Jacobians *of, const LoadSlope *room, double *one,
                             double *other) {
    const Program *p = body->p;
    const int64_t m = p->modes, size = 3 * m, on = p->parent[k];
    double hat[9];
    skew(room->total + 3 * k, hat);
    apply_rows(hat, of->translation + k * size, one, m);
    for (int64_t j = 0; j < size; j++) one[j] += room->change[k * size + j];
    if (on >= 0) {
        skew(room->about + 3 * k, hat);
        apply_rows(hat, of->spin + on * size, other, m);
        for (int64_t j = 0; j < size; j++) one[j] += other[j];
    }
    apply_back_rows(at->parent + 9 * k, one, other, m);
}

/* From there to the node's rotation vector, in `one`. */
static void turned_at(const Body *body, const Configuration *at, int64_t k, const Jacobians *of, const LoadSlope *room, double *one,
                      double *other) {
    const Program *p = body->p;
    const int64_t m = p->modes, size = 3 * m;
    const double *about = room->about + 3 * k;
    double local[3], slope[9];
    apply_back_rows(at->jacobian + 9 * k, other, one, m);
    apply_back(at->parent + 9 * k, about, local);
    if (p->turns && k == 0) {
        apply_back(at->jacobian, about, local);
        skew(local, slope);
    } else {
        transposed_jacobian_derivative(at->local + 3 * (p->nodes + k), local, slope);
    }
    apply_rows(slope, of->operator_ + (p->nodes + k) * size, other, m);
    for (int64_t j = 0; j < size; j++) one[j] += other[j];
}

/* Cost of what is done for each of a node's three rows of (m), in multiplications by the coordinate. */
static const double PULLED = 12.0, HALF_TURNED = 14.0;

void add_load_stiffness(const Body *body, const Configuration *at, const double *force, const double *moment,
                        const Jacobians *of, LoadSlope *room, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes, n = p->nodes, size = 3 * m;
    double *one = room->one, *other = room->other, hat[9];
    int64_t all = 2 * n;
    for (int64_t k = 0; k < n; k++) all -= p->parent[k] < 0;
    if (passed(body->slice, 1 + 3 * n + (1 + m) * all)) {
        add_curvature_stiffness(body, room->rows, room, out);
        return;
    }
    if (due(body->slice, (double)(300 * n))) {
        memcpy(room->total, force, (size_t)(3 * n) * sizeof(double));
        memcpy(room->about, moment, (size_t)(3 * n) * sizeof(double));
        gather(body, at, room->total, room->about, room->rows);
    }
    lever_changes(body, force, of->translation, room->change);
    for (int64_t k = 0; k < n && !over(body->slice); k++) {
        const int64_t on = p->parent[k];
        const int64_t pieces = 1 + (1 + m) * (on >= 0 ? 2 : 1);
        const double cost = (double)size * ((on >= 0 ? PULLED : 0.0) + 2.0 * HALF_TURNED) + (double)(on >= 0 ? 2 * m : m) * three_cost(m);
        if (dealt_with(body->slice, pieces, cost / (double)pieces)) continue;
        if (on >= 0) {
            if (due(body->slice, PULLED * (double)size)) {
                skew(room->total + 3 * k, hat);
                apply_rows(hat, of->spin + on * size, one, m);
                apply_back_rows(at->parent + 9 * k, one, other, m);
            }
            add_three_products(body, of->operator_ + k * size, other, out);
        }
        if (due(body->slice, HALF_TURNED * (double)size)) turned_in_parent(body, at, k, of, room, one, other);
        if (due(body->slice, HALF_TURNED * (double)size)) turned_at(body, at, k, of, room, one, other);
        add_three_products(body, of->operator_ + (n + k) * size, one, out);
    }
    if (!over(body->slice)) add_curvature_stiffness(body, room->rows, room, out);
}

void row_derivative(const Body *body, const Configuration *at, int64_t row, int64_t count, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    memcpy(out, p->operator_ + row * m, (size_t)count * sizeof(double));
    if (!p->curved || p->part[row] < 0) return;
    const double *basis = part_basis(p, p->part[row]), *turned = at->turned + body->opened->turned_start[row];
    if (basis)
        add_strided_rows(turned, basis, m, out, p->extent[p->part[row]], count);
    else
        for (int64_t j = 0; j < count; j++) out[j] += turned[j];
}
