/* Mass of the deformed body, M(q), from lumps that the frames carry (docs/theory.md section 9).
 *
 * A lump moves as the point that its centre of mass is; what its matter turns about that point, and is bent within it, goes
 * by its frame. T - |v|²/2 is then
 *
 *     sum over lumps of m |x'|²/2 + sum over frames of (w I w / 2 + w · H v) + v rest v / 2,
 *
 * w being a frame's spin on its own axes; `rest` makes it zero at q = 0. Only the rates of the first coordinates count in
 * it: the mean and the change of what pass_back makes of the lumps' momenta are all that a step needs. Source: J. Wittenburg,
 * Dynamics of Multibody Systems, 2nd ed., chapter 5 (equations of motion of a tree). */
#include <string.h>

#include "internal.h"

void take_flow(const Body *body, Arena *arena, Flow *flow) {
    const Program *p = &body->p;
    const int64_t n = p->nodes, r = p->inertial_modes, rate = pass_back_rate_size(body), jacobians = (6 * p->frames + 9) * r;
    take_rates(body, arena, &flow->rates);
    flow->force = take(arena, 3 * n);
    flow->moment = take(arena, 3 * n);
    flow->acceleration = take(arena, 9 * n);
    flow->whirl = take(arena, 3 * n);
    flow->own = take(arena, p->modes);
    flow->rows = take(arena, 2 * p->modes);
    flow->scratch = take(arena, rate > jacobians ? rate : jacobians);
}

static int64_t first_lump(const Program *p) { return p->frames + p->interfaces + p->masses; }

/* Rates of all nodes for those of the first coordinates alone. */
static void lump_rates(const Body *body, const Configuration *at, const double *v, Flow *flow) {
    const Program *p = &body->p;
    const int64_t r = p->inertial_modes;
    memcpy(flow->rows, v, (size_t)r * sizeof(double));
    memset(flow->rows + r, 0, (size_t)(p->modes - r) * sizeof(double));
    node_rates(body, body->lumped, at, flow->rows, &flow->rates);
}

/* Momenta of lumps and frames as loads on the nodes. */
static void momenta(const Body *body, const Configuration *at, const double *v, Flow *flow) {
    const Program *p = &body->p;
    const int64_t r = p->inertial_modes, first = first_lump(p);
    memset(flow->force, 0, (size_t)(3 * p->nodes) * sizeof(double));
    memset(flow->moment, 0, (size_t)(3 * p->nodes) * sizeof(double));
    for (int64_t i = 0; i < p->lumps; i++)
        for (int c = 0; c < 3; c++) flow->force[3 * (first + i) + c] = p->lump_mass[i] * flow->rates.velocity[3 * (first + i) + c];
    for (int64_t k = 0; k < p->frames; k++) {
        double spin[3], own[3], swept[3];
        apply_back(at->rotation + 9 * k, flow->rates.spin + 3 * k, spin);
        apply(p->turning_inertia + 9 * k, spin, own);
        rows_times(p->turning_sweep + 3 * k * r, v, swept, 3, r);
        for (int c = 0; c < 3; c++) own[c] += swept[c];
        apply(at->rotation + 9 * k, own, flow->moment + 3 * k);
    }
}

void excess_momentum(const Body *body, const Configuration *at, const double *v, Flow *flow, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes, r = p->inertial_modes;
    lump_rates(body, at, v, flow);
    momenta(body, at, v, flow);
    memset(out, 0, (size_t)m * sizeof(double));
    pass_back(body, at, flow->force, flow->moment, flow->scratch, out);
    memset(out + r, 0, (size_t)(m - r) * sizeof(double));
    for (int64_t k = 0; k < p->frames; k++) {
        double spin[3];
        apply_back(at->rotation + 9 * k, flow->rates.spin + 3 * k, spin);
        add_rows(spin, p->turning_sweep + 3 * k * r, out, 3, r);
    }
    add_rows(v, p->inertial_rest, out, r, r);
}

/* With V = J v, dT/dq is the change of Jᵀ along v, times the momenta: J is itself a derivative. For spins, whose derivatives
 * do not commute, what that leaves out cancels against the turn of the inertia with its frame. */
void kinetic_gradient(const Body *body, const Configuration *at, const double *v, Flow *flow, double *out) {
    lump_rates(body, at, v, flow);
    turn_rates(body, body->lumped, &flow->rates);
    momenta(body, at, v, flow);
    memset(out, 0, (size_t)body->p.modes * sizeof(double));
    pass_back_rate(body, at, &flow->rates, flow->force, flow->moment, flow->scratch, out);
}

void convective_force(const Body *body, const Configuration *at, const double *v, Flow *flow, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes, r = p->inertial_modes, first = first_lump(p);
    lump_rates(body, at, v, flow);
    turn_rates(body, body->lumped, &flow->rates);
    node_accelerations(body, body->lumped, at, &flow->rates, flow->acceleration, flow->whirl);
    momenta(body, at, v, flow);
    memset(out, 0, (size_t)m * sizeof(double));
    for (int64_t i = 0; i < p->lumps; i++)
        for (int c = 0; c < 3; c++) flow->force[3 * (first + i) + c] = p->lump_mass[i] * flow->acceleration[3 * (first + i) + c];
    for (int64_t k = 0; k < p->frames; k++) {
        double *whirl = flow->whirl + 3 * k, *moment = flow->moment + 3 * k, own[3], turned[3], carried[3];
        cross(flow->rates.spin + 3 * k, moment, carried);
        apply_back(at->rotation + 9 * k, whirl, own);
        add_rows(own, p->turning_sweep + 3 * k * r, out, 3, r);
        apply(p->turning_inertia + 9 * k, own, turned);
        apply(at->rotation + 9 * k, turned, moment);
        for (int c = 0; c < 3; c++) moment[c] += carried[c];
    }
    pass_back(body, at, flow->force, flow->moment, flow->scratch, out);
    memset(out + r, 0, (size_t)(m - r) * sizeof(double));
}

void mass_centre(const Body *body, const Configuration *at, double *out) {
    const Program *p = &body->p;
    const int64_t first = first_lump(p);
    double whole = 0.0;
    memset(out, 0, 3 * sizeof(double));
    for (int64_t i = 0; i < p->lumps; i++) {
        for (int c = 0; c < 3; c++) out[c] += p->lump_mass[i] * (at->position[3 * (first + i) + c] - p->point[c]);
        whole += p->lump_mass[i];
    }
    for (int c = 0; c < 3; c++) out[c] /= whole;
}

void excess_mass(const Body *body, const Configuration *at, Flow *flow, double *out) {
    const Program *p = &body->p;
    const int64_t r = p->inertial_modes, n = p->nodes, size = 3 * r, first = first_lump(p);
    double *moved = flow->scratch, *turned = moved + p->frames * size, *rows = turned + p->frames * size;
    double *place = rows + size, *half = place + size;
    memcpy(out, p->inertial_rest, (size_t)(r * r) * sizeof(double));
    for (int64_t k = 0; k < first + p->lumps; k++) {
        if (!body->lumped[k].offset) continue;
        const int64_t on = p->parent[k];
        const int frame = k < p->frames;
        double *x = frame ? moved + k * size : place, both[9], arm[3], hat[9];
        for (int i = 0; i < 3; i++) row_derivative(body, at, 3 * k + i, r, rows + i * r);
        apply_rows(at->parent + 9 * k, rows, x, r);
        if (on >= 0) {
            apply(at->parent + 9 * k, at->local + 3 * k, arm);
            skew(arm, hat);
            apply_rows(hat, turned + on * size, rows, r);
            for (int64_t j = 0; j < size; j++) x[j] += moved[on * size + j] - rows[j];
        }
        if (!frame) {
            for (int64_t j = 0; j < size; j++) rows[j] = p->lump_mass[k - first] * x[j];
            add_transposed_product(x, rows, out, 3, r, r);
            continue;
        }
        for (int i = 0; i < 3; i++) row_derivative(body, at, 3 * (n + k) + i, r, rows + i * r);
        multiply(at->parent + 9 * k, at->jacobian + 9 * k, both);
        apply_rows(both, rows, turned + k * size, r);
        for (int64_t j = 0; on >= 0 && j < size; j++) turned[k * size + j] += turned[on * size + j];
        /* w I w + w · H v + (w · H v)ᵀ, on the frame's axes. */
        const double *sweep = p->turning_sweep + 3 * k * r;
        apply_back_rows(at->rotation + 9 * k, turned + k * size, rows, r);
        apply_rows(p->turning_inertia + 9 * k, rows, half, r);
        for (int64_t j = 0; j < size; j++) half[j] += sweep[j];
        add_transposed_product(rows, half, out, 3, r, r);
        add_transposed_product(sweep, rows, out, 3, r, r);
    }
}
