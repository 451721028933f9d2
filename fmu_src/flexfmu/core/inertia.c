#include "inertia.h"

#include <string.h>

#include "algebra.h"

void take_flow(const Body *body, Arena *arena, Flow *flow) {
    const Program *p = body->p;
    const int64_t n = p->nodes, size = 3 * p->inertial_modes;
    if (!p->lumped) {
        take_polynomial(body, arena, &flow->polynomial);
        return;
    }
    take_rates(body, arena, &flow->rates);
    flow->force = take(arena, 3 * n);
    flow->moment = take(arena, 3 * n);
    flow->acceleration = take(arena, 9 * n);
    flow->whirl = take(arena, 3 * n);
    flow->rows = take(arena, 2 * p->modes);
    take_back(body, arena, &flow->back);
    take_back_rate(body, arena, &flow->back_rate);
    flow->moved = take(arena, p->frames * size);
    flow->turned = take(arena, p->frames * size);
    for (int k = 0; k < 3; k++) flow->one[k] = take(arena, size);
}

static int64_t first_lump(const Program *p) { return p->frames + p->interfaces + p->masses; }

/* Rates of all nodes for those of the first coordinates alone. */
static void lump_rates(const Body *body, const Configuration *at, const double *v, Flow *flow) {
    const Program *p = body->p;
    const int64_t r = p->inertial_modes;
    memcpy(flow->rows, v, (size_t)r * sizeof(double));
    memset(flow->rows + r, 0, (size_t)(p->modes - r) * sizeof(double));
    node_rates(body, body->opened->lumped, at, flow->rows, &flow->rates);
}

/* Momenta of lumps and frames as loads on the nodes. */
static void momenta(const Body *body, const Configuration *at, const double *v, Flow *flow) {
    const Program *p = body->p;
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
    const Program *p = body->p;
    const int64_t m = p->modes, r = p->inertial_modes;
    if (!p->lumped) {
        polynomial_momentum(body, at->q, v, &flow->polynomial, out);
        return;
    }
    lump_rates(body, at, v, flow);
    momenta(body, at, v, flow);
    memset(out, 0, (size_t)m * sizeof(double));
    pass_back(body, at, flow->force, flow->moment, &flow->back, out);
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
    if (!body->p->lumped) {
        polynomial_gradient(body, at->q, v, &flow->polynomial, out);
        return;
    }
    lump_rates(body, at, v, flow);
    turn_rates(body, body->opened->lumped, &flow->rates);
    momenta(body, at, v, flow);
    memset(out, 0, (size_t)body->p->modes * sizeof(double));
    pass_back_rate(body, at, &flow->rates, flow->force, flow->moment, &flow->back_rate, out);
}

void convective_force(const Body *body, const Configuration *at, const double *v, Flow *flow, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes, r = p->inertial_modes, first = first_lump(p);
    if (!p->lumped) {
        polynomial_convective(body, at->q, v, &flow->polynomial, out);
        return;
    }
    lump_rates(body, at, v, flow);
    turn_rates(body, body->opened->lumped, &flow->rates);
    node_accelerations(body, body->opened->lumped, at, &flow->rates, flow->acceleration, flow->whirl);
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
    pass_back(body, at, flow->force, flow->moment, &flow->back, out);
    memset(out + r, 0, (size_t)(m - r) * sizeof(double));
}

void mass_centre(const Body *body, const Configuration *at, double *out) {
    const Program *p = body->p;
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
    const Program *p = body->p;
    const int64_t r = p->inertial_modes, n = p->nodes, size = 3 * r, first = first_lump(p);
    double *moved = flow->moved, *turned = flow->turned, *rows = flow->one[0], *place = flow->one[1], *half = flow->one[2];
    if (!p->lumped) {
        polynomial_mass(body, at->q, &flow->polynomial, out);
        return;
    }
    memcpy(out, p->inertial_rest, (size_t)(r * r) * sizeof(double));
    for (int64_t k = 0; k < first + p->lumps; k++) {
        if (!body->opened->lumped[k].offset) continue;
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
