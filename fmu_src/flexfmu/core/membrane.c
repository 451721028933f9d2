/* V = sum of s_r (sigma_r^2 - (l_r.q)^2) with sigma_r = l_r.q + k_r, k_r = q.S_r q. The change of a square is twice its mean times
 * its change, and the change of k_r is 2 S_r mean(q) . dq: so the mean force below is an exact discrete gradient of V. */
#include "membrane.h"

#include <string.h>

#include "algebra.h"
#include "tree.h"

/* Way of q over q, energy being the measure, up to which its square is round-off; and up to which a first round may leave it out. */
static const double SAME = 1e-6, NEAR = 0.3;

/* Forms that go by the same coordinates, as many as `size`: of a part with their basis (size, m), at last q itself without. */
typedef struct {
    int64_t part, first, end, size;
    const double *basis, *packed;
    int64_t slope; /* where theirs begin */
} Forms;

/* The forms after those, of the first part after part -1; whether there are any. */
static int next_forms(const Program *p, Forms *forms) {
    forms->packed = forms->part < 0 ? p->stretch : forms->packed + packed_total(forms->end - forms->first, forms->size);
    forms->slope = forms->part < 0 ? 0 : forms->slope + (forms->end - forms->first + LANES - 1) / LANES * LANES * forms->size;
    forms->first = forms->end;
    for (forms->part++; forms->part < p->parts; forms->part++) {
        forms->basis = part_basis(p, forms->part);
        forms->size = p->extent[forms->part];
        forms->end += p->stretch_rows[forms->part];
        if (forms->end > forms->first) return 1;
    }
    forms->basis = 0;
    forms->size = p->modes;
    forms->end = p->stretches;
    return forms->end > forms->first;
}

static const Forms NO_FORMS = {-1, 0, 0, 0, 0, 0, 0};

void take_stretch(const Body *body, Arena *arena, Stretch *at) {
    const Program *p = body->p;
    Forms forms = NO_FORMS;
    int64_t slopes = 0, size = 0;
    while (next_forms(p, &forms)) {
        slopes += (forms.end - forms.first + LANES - 1) / LANES * LANES * forms.size;
        if (forms.basis) size = larger(size, forms.size);
    }
    at->slope = take(arena, slopes);
    at->bent = take(arena, p->stretches);
    at->whole = take(arena, p->stretches);
    at->own = take(arena, size);
    at->sum = take(arena, size);
    at->push = take(arena, p->stretches);
    at->square = at->row = 0;
    at->third = 0;
}

void take_stretch_stiffness(const Body *body, Arena *arena, Stretch *at) {
    const Program *p = body->p;
    Forms forms = NO_FORMS;
    int64_t size = 0;
    while (next_forms(p, &forms))
        if (forms.basis) size = larger(size, forms.size);
    take_stretch(body, arena, at);
    at->square = take(arena, size * size);
    at->row = take(arena, size * larger(p->modes, LANES));
}

/* Coordinates of a part, in a workspace; q itself without one. */
static const double *coordinates_of(const Body *body, const Forms *forms, const double *q, const Stretch *at) {
    const int64_t m = body->p->modes;
    if (!forms->basis) return q;
    const Rows now = rows_due(body->slice, forms->size, (double)(2 * m));
    rows_times(forms->basis + now.at * m, q, at->own + now.at, now.end - now.at, m);
    return at->own;
}

void stretch_at(const Body *body, const double *q, Stretch *at) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Forms forms = NO_FORMS;
    at->base = 0;
    at->moved = 0;
    while (next_forms(p, &forms)) {
        const int64_t k = forms.size, count = forms.end - forms.first, fours = (count + LANES - 1) / LANES;
        if (passed(body->slice, (forms.basis ? k : 0) + packed_groups(k) * fours + count)) continue;
        const double *x = coordinates_of(body, &forms, q, at);
        for (int64_t r = 0; r < count; r += LANES)
            four_rows(body, forms.packed + r / LANES * packed_size(k), x, at->slope + forms.slope + r * k, k);
        const Rows now = rows_due(body->slice, count, (double)(2 * k + 16));
        for (int64_t r = forms.first + now.at; r < forms.first + now.end; r++) {
            at->bent[r] = at->whole[r] = dot(at->slope + forms.slope + (r - forms.first) * k, x, k);
            if (!forms.basis) at->whole[r] += dot(p->stretch_linear + r * m, q, m);
        }
    }
}

void take_moving_stretch(const Body *body, Arena *arena, Stretch *at) {
    const Program *p = body->p;
    Forms forms = NO_FORMS;
    int64_t numbers = 0, size = 0;
    while (next_forms(p, &forms)) {
        numbers += packed_size(forms.size);
        size += forms.size;
    }
    take_stretch(body, arena, at);
    at->place = take(arena, size ? p->modes : 0);
    at->gap = take(arena, size ? p->modes : 0);
    at->way = take(arena, size);
    at->found = take(arena, 2 * p->stretches);
    at->turn = take(arena, numbers);
}

/* Of LANES forms from `group` on, all at q, whose coordinates are x; and factors of the sum of a force from `from`. */
static void find_group(const Body *body, const Forms *forms, int64_t group, const double *packed, const double *q, const double *x,
                       const Stretch *from, Stretch *at, double *factors) {
    const Program *p = body->p;
    const int64_t k = forms->size, m = p->modes;
    double *slope = at->slope + forms->slope + (group - forms->first) * k, bent[LANES];
    four_rows(body, packed, x, slope, k);
    rows_times(slope, x, bent, LANES, k);
    for (int64_t r = group; r < group + LANES && r < forms->end; r++) {
        at->bent[r] = at->whole[r] = bent[r - group];
        if (!forms->basis) at->whole[r] += dot(p->stretch_linear + r * m, q, m);
        factors[r - group] = p->stretch_sign[r] * (from->whole[r] + at->whole[r]);
    }
}

/* All at q, and, but for the start, what a way from there does to the slopes in the sum of a force. */
static void find_stretch(const Body *body, const Stretch *from, const double *q, Stretch *at) {
    const Program *p = body->p;
    Forms forms = NO_FORMS;
    double *turn = at->turn;
    at->base = 0;
    at->moved = 0;
    while (next_forms(p, &forms)) {
        const int64_t size = packed_size(forms.size);
        const double *x = coordinates_of(body, &forms, q, at), *packed = forms.packed;
        /* By two groups at a time, which still lie in the cache. */
        for (int64_t group = forms.first; group < forms.end; group += 2 * LANES, packed += 2 * size) {
            const int both = group + LANES < forms.end;
            double first[LANES] = {0.0}, last[LANES] = {0.0};
            find_group(body, &forms, group, packed, q, x, from, at, first);
            if (both) find_group(body, &forms, group + LANES, packed + size, q, x, from, at, last);
            if (at != from) add_lanes(first, packed, last, both ? packed + size : packed, turn, size / LANES, group > forms.first);
        }
        turn += size;
    }
    memcpy(at->found, at->bent, (size_t)p->stretches * sizeof(double));
    memcpy(at->found + p->stretches, at->whole, (size_t)p->stretches * sizeof(double));
    memcpy(at->place, q, (size_t)p->modes * sizeof(double));
}

/* The same to first order about where another one was found, whose way is in at->gap. */
static void move_stretch(const Body *body, const Stretch *base, Stretch *at) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Forms forms = NO_FORMS;
    double *way = at->way;
    at->base = base == at ? 0 : base;
    at->moved = 1;
    while (next_forms(p, &forms)) {
        const int64_t k = forms.size;
        if (forms.basis)
            rows_times(forms.basis, at->gap, way, k, m);
        else
            memcpy(way, at->gap, (size_t)m * sizeof(double));
        rows_times(base->slope + forms.slope, way, at->bent + forms.first, forms.end - forms.first, k);
        for (int64_t r = forms.first; r < forms.end; r++) {
            const double more = 2.0 * at->bent[r];
            at->bent[r] = base->found[r] + more;
            at->whole[r] = base->found[p->stretches + r] + more;
            if (!forms.basis) at->whole[r] += dot(p->stretch_linear + r * m, at->gap, m);
        }
        way += k;
    }
}

void stretch_from(const Body *body, const double *q, Stretch *from) {
    if (body->p->stretches) find_stretch(body, from, q, from);
}

int stretch_towards(const Body *body, const Stretch *from, const double *q, int first, Stretch *to) {
    const Program *p = body->p;
    const Stretch *base = first ? from : to->base ? to->base : to;
    double far = 0.0, size = 0.0;
    if (!p->stretches) return 1;
    for (int64_t j = 0; j < p->modes; j++) {
        to->gap[j] = q[j] - base->place[j];
        const double gone = p->omega[j] * to->gap[j], strained = p->omega[j] * q[j];
        far += gone * gone;
        size += strained * strained;
    }
    const int turned = far == 0.0 || (base == to && far <= SAME * SAME * size);
    if (turned || (first && far <= NEAR * NEAR * size))
        move_stretch(body, base, to);
    else
        find_stretch(body, from, q, to);
    return turned || !to->moved;
}

void add_along_shapes(const Body *body, const Stretch *at, double factor, double *out) {
    const Program *p = body->p;
    for (int64_t r = 0; r < p->stretches; r++)
        for (int64_t j = p->rigid; j < p->modes; j++)
            out[j] += 2.0 * factor * at->bent[r] * p->stretch_linear[r * p->modes + j] / body->opened->stiffness[j];
}

double stretch_energy(const Body *body, const Stretch *at) {
    double energy = 0.0;
    for (int64_t r = 0; r < body->p->stretches; r++)
        energy += body->p->stretch_sign[r] * at->bent[r] * (2.0 * at->whole[r] - at->bent[r]);
    return energy;
}

/* out (m) += what the coordinates of a part make of their sum, in its workspace. */
static void add_sum(const Body *body, const Forms *forms, const Stretch *at, double *out) {
    if (forms->basis) add_rows(at->sum, forms->basis, out, forms->size, body->p->modes);
}

static const double *slopes_of(const Stretch *at) { return at->base ? at->base->slope : at->slope; }

void subtract_stretch_force(const Body *body, const Stretch *a, const Stretch *b, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    if (!p->stretches) return;
    const double *turn = b->turn, *way = b->way, *first = slopes_of(a), *last = slopes_of(b);
    Forms forms = NO_FORMS;
    while (next_forms(p, &forms)) {
        const int64_t k = forms.size;
        double *sum = forms.basis ? b->sum : out;
        const Rows pushed = rows_due(body->slice, forms.end - forms.first, (double)(20 + 2 * m * body->opened->keeps_shapes));
        if (forms.basis && pushed.at == 0 && pushed.end > 0) memset(sum, 0, (size_t)k * sizeof(double));
        for (int64_t r = forms.first + pushed.at; r < forms.first + pushed.end; r++) {
            const double bent = -p->stretch_sign[r] * (a->bent[r] + b->bent[r]);
            b->push[r] = -p->stretch_sign[r] * (a->whole[r] + b->whole[r]) * (first == last ? 2.0 : 1.0);
            if (body->opened->keeps_shapes) add_rows(&bent, p->stretch_linear + r * m, out, 1, m);
        }
        Fours now = fours_due(body->slice, forms.end - forms.first, (double)(6 * k));
        if (now.count) add_rows(b->push + forms.first + now.at, last + forms.slope + now.at * k, sum, now.count, k);
        if (first != last) add_rows(b->push + forms.first, first + forms.slope, sum, forms.end - forms.first, k);
        if (b->moved && !b->base) {
            double *four = body->scratch.four;
            packed_times(turn, way, four, k, 0, packed_groups(k));
            for (int64_t j = 0; j < k; j++)
                sum[j] -= (a == b ? 2.0 : 1.0) * ((four[LANES * j] + four[LANES * j + 1]) + (four[LANES * j + 2] + four[LANES * j + 3]));
            turn += packed_size(k);
            way += k;
        }
        now = fours_due(body->slice, forms.basis ? k : 0, (double)(6 * m));
        if (now.count) add_rows(sum + now.at, forms.basis + now.at * m, out, now.count, m);
    }
}

/* out (m) += force (m) on coordinates that shapes have left, by all: (d(t eta)/dq)'f, slopes being at q. */
static void add_through_shapes(const Body *body, const Stretch *at, const double *force, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Forms forms = NO_FORMS;
    while (next_forms(p, &forms))
        for (int64_t r = forms.first; r < forms.end && !forms.basis; r++) {
            double along = 0.0;
            for (int64_t j = p->rigid; j < m; j++) along += 4.0 * p->stretch_linear[r * m + j] * force[j] / body->opened->stiffness[j];
            add_rows(&along, at->slope + forms.slope + (r - forms.first) * m, out, 1, m);
        }
}

/* Leave out what places miss at third order, or all else. */
static void leave_stretches(const Body *body, int missed, Stretch *at) {
    for (int64_t r = 0; r < body->p->stretches; r++)
        if ((body->p->stretch_stiff[r] == 0.0) == missed) at->bent[r] = at->whole[r] = 0.0;
}

void subtract_all_forces(const Body *body, const double *q, Stretch *at, double *left, double *missed, double *out) {
    const int64_t m = body->p->modes;
    const double cost = (double)(3 * body->p->stretches * m);
    stretch_at(body, q, at);
    if (body->opened->keeps_shapes) {
        if (due(body->slice, cost)) {
            memcpy(left, q, (size_t)m * sizeof(double));
            add_along_shapes(body, at, 1.0, left);
        }
        stretch_at(body, left, at);
        if (due(body->slice, cost)) {
            memset(missed, 0, (size_t)m * sizeof(double));
            leave_stretches(body, 0, at);
        }
        if (!over(body->slice)) subtract_stretch_force(body, at, at, missed);
        stretch_at(body, q, at);
        if (due(body->slice, cost)) {
            for (int64_t j = 0; j < m; j++) out[j] += missed[j];
            add_through_shapes(body, at, missed, out);
            leave_stretches(body, 1, at);
        }
    }
    if (!over(body->slice)) subtract_stretch_force(body, at, at, out);
}

void add_turned_stretch(const Body *body, const Stretch *at, const double *direction, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Forms forms = NO_FORMS;
    while (next_forms(p, &forms)) {
        const int64_t k = forms.size;
        const double *along = direction;
        if (forms.basis) {
            rows_times(forms.basis, direction, at->own, k, m);
            memset(at->sum, 0, (size_t)k * sizeof(double));
            along = at->own;
        }
        for (int64_t r = forms.first; r < forms.end; r++) {
            if (!(p->stretch_stiff[r] > 0.0)) continue;
            const double *linear = p->stretch_linear + r * m, *slope = at->slope + forms.slope + (r - forms.first) * k;
            const double first = forms.basis ? 0.0 : 2.0 * dot(linear, direction, m), more = 4.0 * dot(slope, along, k), whole = first + more;
            for (int64_t j = 0; forms.basis && j < k; j++) at->sum[j] += 2.0 * whole * slope[j];
            for (int64_t j = 0; !forms.basis && j < m; j++) out[j] += more * linear[j] + 2.0 * whole * slope[j];
        }
        add_sum(body, &forms, at, out);
    }
}

/* Both parts of the stiffness, or that of tension times a sign. */
static void add_stiffness(const Body *body, const Stretch *at, int steep, double sign, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Forms forms = NO_FORMS;
    while (next_forms(p, &forms) && !over(body->slice)) {
        const int64_t k = forms.size;
        double *square = forms.basis ? at->square : out;
        if (forms.basis) clear_rows(square, k, rows_due(body->slice, k, cost_of_copy(k)));
        for (int64_t group = forms.first; group < forms.end && !over(body->slice); group += LANES) {
            const double *slopes = at->slope + forms.slope + (group - forms.first) * k;
            const int64_t count = forms.end - group < LANES ? forms.end - group : LANES;
            double whole[LANES] = {0.0}, four[LANES];
            int stiff = 0;
            for (int64_t r = 0; r < count; r++) {
                const double *linear = p->stretch_linear + (group + r) * m, *slope = slopes + r * k;
                four[r] = 4.0 * (at->third && steep ? p->stretch_sign : p->stretch_stiff)[group + r];
                if (four[r] == 0.0) continue;
                whole[r] = sign * four[r] * at->whole[group + r];
                stiff = 1;
                const Rows rows = rows_due(body->slice, forms.basis || !steep ? 0 : k, (3.0 + 0.06 * (double)k) * (double)k);
                for (int64_t i = rows.at; i < rows.end; i++)
                    add_two_rows(four[r] * (linear[i] + 2.0 * slope[i]), slope, four[r] * slope[i], linear, out + i * m, m);
            }
            if (!stiff) continue;
            /* Of all at once a row is touched once. */
            const Rows rows = rows_due(body->slice, forms.basis && steep ? k : 0, (double)(8 * k));
            const int64_t some = rows.end - rows.at;
            for (int64_t r = 0; r < count; r++)
                for (int64_t i = 0; i < some; i++) at->row[r * some + i] = 2.0 * four[r] * slopes[r * k + rows.at + i];
            if (some) add_transposed_product(at->row, slopes, square + rows.at * k, count, some, k);
            add_four(body, whole, forms.packed + (group - forms.first) / LANES * packed_size(k), square, k, added_cost(k));
        }
        if (!forms.basis || over(body->slice)) continue;
        Rows now = rows_due(body->slice, k, 2.2 * (double)(k * m));
        product(square + now.at * k, forms.basis, at->row + now.at * m, now.end - now.at, k, m);
        /* All rows at once, or some of them: then a column of the basis lies where the square was. */
        now = rows_due(body->slice, m, 2.2 * (double)(k * m));
        if (now.end - now.at == m) add_transposed_product(forms.basis, at->row, out, k, m, m);
        for (int64_t j = now.at; j < now.end && now.end - now.at < m; j++) {
            for (int64_t i = 0; i < k; i++) square[i] = forms.basis[i * m + j];
            add_transposed_product(square, at->row, out + j * m, k, 1, m);
        }
    }
}

void add_stretch_stiffness(const Body *body, const Stretch *at, double *out) { add_stiffness(body, at, 1, 1.0, out); }
void subtract_stretch_tension(const Body *body, const Stretch *at, double *out) { add_stiffness(body, at, 0, -1.0, out); }
