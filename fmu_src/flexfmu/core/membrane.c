/* V = sum of s_r (sigma_r^2 - (l_r.q)^2) with sigma_r = l_r.q + k_r, k_r = q.S_r q. The change of a square is twice its mean times
 * its change, and the change of k_r is 2 S_r mean(q) . dq: so the mean force below is an exact discrete gradient of V. */
#include "membrane.h"

#include <string.h>

#include "algebra.h"
#include "tree.h"

void take_stretch(const Body *body, Arena *arena, Stretch *at) {
    const int64_t count = body->p->stretches;
    at->slope = take(arena, (count + LANES - 1) / LANES * LANES * body->p->modes);
    at->bent = take(arena, count);
    at->whole = take(arena, count);
}

void stretch_at(const Body *body, const double *q, Stretch *at) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    if (passed(body->slice, packed_groups(m) * ((p->stretches + LANES - 1) / LANES) + 1)) return;
    for (int64_t r = 0; r < p->stretches; r += LANES) four_rows(body, p->stretch + r / LANES * packed_size(m), q, at->slope + r * m, m);
    if (!due(body->slice, (double)(2 * m * p->stretches))) return;
    for (int64_t r = 0; r < p->stretches; r++) {
        at->bent[r] = dot(at->slope + r * m, q, m);
        at->whole[r] = at->bent[r] + dot(p->stretch_linear + r * m, q, m);
    }
}

double stretch_energy(const Body *body, const Stretch *at) {
    double energy = 0.0;
    for (int64_t r = 0; r < body->p->stretches; r++)
        energy += body->p->stretch_sign[r] * at->bent[r] * (2.0 * at->whole[r] - at->bent[r]);
    return energy;
}

void subtract_stretch_force(const Body *body, const Stretch *a, const Stretch *b, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    for (int64_t r = 0; r < p->stretches; r++) {
        const double sign = p->stretch_sign[r];
        const double bent = sign * (a->bent[r] + b->bent[r]), whole = sign * (a->whole[r] + b->whole[r]);
        const double *linear = p->stretch_linear + r * m, *first = a->slope + r * m, *last = b->slope + r * m;
        for (int64_t j = 0; j < m; j++) out[j] -= bent * linear[j] + whole * (first[j] + last[j]);
    }
}

void add_turned_stretch(const Body *body, const Stretch *at, const double *direction, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    for (int64_t r = 0; r < p->stretches; r++) {
        if (p->stretch_sign[r] < 0.0) continue;
        const double *linear = p->stretch_linear + r * m, *slope = at->slope + r * m;
        const double first = 2.0 * dot(linear, direction, m), more = 4.0 * dot(slope, direction, m), whole = first + more;
        for (int64_t j = 0; j < m; j++) out[j] += more * linear[j] + 2.0 * whole * slope[j];
    }
}

void add_stretch_stiffness(const Body *body, const Stretch *at, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    for (int64_t group = 0; group < p->stretches && !over(body->slice); group += LANES) {
        double whole[LANES] = {0.0};
        for (int64_t r = group; r < group + LANES && r < p->stretches; r++) {
            const double *linear = p->stretch_linear + r * m, *slope = at->slope + r * m;
            const double four = 4.0 * p->stretch_sign[r];
            whole[r - group] = four * at->whole[r];
            const Rows rows = rows_due(body->slice, m, (double)(2 * m));
            for (int64_t i = rows.at; i < rows.end; i++)
                add_two_rows(four * (linear[i] + 2.0 * slope[i]), slope, four * slope[i], linear, out + i * m, m);
        }
        add_four(body, whole, p->stretch + group / LANES * packed_size(m), out, m);
    }
}
