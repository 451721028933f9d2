#include "rates.h"

#include <string.h>

#include "algebra.h"
#include "pass_back.h"
#include "tree.h"

void take_rates(const Body *body, Arena *arena, Rates *rates) {
    const Program *p = body->p;
    rates->local = take(arena, 6 * p->nodes);
    rates->bent = take(arena, p->bending * p->modes);
    rates->turned = take(arena, body->opened->bend_rows);
    rates->velocity = take(arena, 3 * p->nodes);
    rates->spin = take(arena, 3 * p->nodes);
}

void node_rates(const Body *body, const Need *need, const Configuration *at, const double *v, Rates *rates) {
    const Program *p = body->p;
    const int64_t n = p->nodes;
    double *local = rates->local, *velocity = rates->velocity, *spin = rates->spin;
    memset(local, 0, (size_t)(6 * n) * sizeof(double));
    add_strided_rows(v, body->opened->columns, 6 * n, local, p->modes, moving_rows(p));
    if (p->curved) {
        part_coordinates(p, v, 0, rates->bent);
        for (int64_t part = 0; part < p->bending; part++) {
            const Bend *bend = body->opened->bends + part;
            const int64_t r = p->extent[part];
            for (int64_t k = 0; k < bend->count; k++)
                if (wanted(p, need, bend->row[k]))
                    local[bend->row[k]] += dot(at->turned + bend->start + k * r, rates->bent + part * p->modes, r);
        }
    }
    for (int64_t k = 0; k < n; k++) {
        if (need && !need[k].offset) continue;
        const int64_t on = p->parent[k];
        const double *parent = at->parent + 9 * k;
        double relative[3], turned[3] = {0.0, 0.0, 0.0}, carried[3] = {0.0, 0.0, 0.0}, stretched[3], arm[3];
        if (!need || need[k].turn) {
            apply(at->jacobian + 9 * k, local + 3 * (n + k), relative);
            apply(parent, relative, turned);
        }
        apply(parent, local + 3 * k, stretched);
        if (on >= 0) {
            apply(parent, at->local + 3 * k, arm);
            cross(spin + 3 * on, arm, carried);
        }
        for (int i = 0; i < 3; i++) {
            spin[3 * k + i] = (on < 0 ? 0.0 : spin[3 * on + i]) + turned[i];
            velocity[3 * k + i] = (on < 0 ? 0.0 : velocity[3 * on + i]) + carried[i] + stretched[i];
        }
    }
}

void turn_rates(const Body *body, const Need *need, Rates *rates) {
    if (body->p->curved) turn_rows(body, need, rates->bent, rates->turned);
}

void node_accelerations(const Body *body, const Need *need, const Configuration *at, const Rates *rates, double *acceleration,
                        double *whirl) {
    const Program *p = body->p;
    const int64_t n = p->nodes;
    double *second = acceleration + 3 * n; /* b'', phi'' */
    memset(second, 0, (size_t)(6 * n) * sizeof(double));
    for (int64_t part = 0; part < p->bending; part++) {
        const Bend *bend = body->opened->bends + part;
        const int64_t r = p->extent[part];
        for (int64_t k = 0; k < bend->count; k++)
            if (wanted(p, need, bend->row[k]))
                second[bend->row[k]] = dot(rates->turned + bend->start + k * r, rates->bent + part * p->modes, r);
    }
    for (int64_t k = 0; k < n; k++) {
        if (need && !need[k].offset) continue;
        const int64_t on = p->parent[k];
        const double *parent = at->parent + 9 * k, *rate = rates->local + 3 * (n + k);
        static const double still[3] = {0.0, 0.0, 0.0};
        const double *spin = on < 0 ? still : rates->spin + 3 * on, *angular = on < 0 ? still : whirl + 3 * on;
        double sum[3], part[3], arm[3], slope[9], pushed[3];
        /* The rest of x'' = x_p'' + a x b + w x (w x b) + 2 w x b' + b'', the parent's spin w turning by a. */
        apply(parent, second + 3 * k, sum);
        if (on >= 0) {
            apply(parent, at->local + 3 * k, arm);
            apply(parent, rates->local + 3 * k, pushed);
            cross(angular, arm, part);
            for (int i = 0; i < 3; i++) sum[i] += part[i];
            cross(spin, arm, part);
            for (int i = 0; i < 3; i++) part[i] += 2.0 * pushed[i];
            cross(spin, part, pushed);
            for (int i = 0; i < 3; i++) sum[i] += pushed[i] + acceleration[3 * on + i];
        }
        memcpy(acceleration + 3 * k, sum, sizeof sum);
        memcpy(whirl + 3 * k, angular, sizeof sum);
        if (need && !need[k].turn) continue;
        jacobian_rate(at->local + 3 * (n + k), rate, slope);
        apply(slope, rate, part);
        apply(at->jacobian + 9 * k, second + 3 * (n + k), pushed);
        for (int i = 0; i < 3; i++) part[i] += pushed[i];
        apply(parent, part, sum);
        apply(at->jacobian + 9 * k, rate, part);
        apply(parent, part, pushed);
        cross(spin, pushed, part);
        for (int i = 0; i < 3; i++) whirl[3 * k + i] += sum[i] + part[i];
    }
}

void take_back_rate(const Body *body, Arena *arena, BackRate *back) {
    const int64_t n = body->p->nodes;
    back->rows = take(arena, 6 * n);
    back->change = take(arena, 6 * n);
    back->about = take(arena, 3 * n);
    back->bent = take(arena, body->p->bending * body->p->modes);
}

void pass_back_rate(const Body *body, const Configuration *at, const Rates *rates, double *force, double *moment,
                    BackRate *back, double *out) {
    const Program *p = body->p;
    const int64_t n = p->nodes;
    double *rows = back->rows, *change = back->change, *about = back->about;
    memset(rows, 0, (size_t)(6 * n) * sizeof(double));
    memset(change, 0, (size_t)(6 * n) * sizeof(double));
    memset(about, 0, (size_t)(3 * n) * sizeof(double));
    for (int64_t k = n - 1; k >= 0; k--) {
        if (no_load(force + 3 * k) && no_load(moment + 3 * k) && no_load(about + 3 * k)) continue;
        const int64_t on = p->parent[k];
        const double *parent = at->parent + 9 * k;
        static const double still[3] = {0.0, 0.0, 0.0};
        const double *spin = on < 0 ? still : rates->spin + 3 * on;
        double local[3], turned[3], slope[9];
        apply_back(parent, force + 3 * k, rows + 3 * k);
        /* Axes that turn with the parent see what stands still turn back. */
        cross(force + 3 * k, spin, turned);
        apply_back(parent, turned, change + 3 * k);
        if (!(no_load(moment + 3 * k) && no_load(about + 3 * k))) {
            apply_back(parent, moment + 3 * k, local);
            apply_back(at->jacobian + 9 * k, local, rows + 3 * (n + k));
            jacobian_rate(at->local + 3 * (n + k), rates->local + 3 * (n + k), slope);
            apply_back(slope, local, change + 3 * (n + k));
            cross(moment + 3 * k, spin, turned);
            for (int i = 0; i < 3; i++) turned[i] += about[3 * k + i];
            apply_back(parent, turned, local);
            apply_back(at->jacobian + 9 * k, local, turned);
            for (int i = 0; i < 3; i++) change[3 * (n + k) + i] += turned[i];
        }
        if (on < 0) continue;
        double arm[3], lever[3], swept[3], moved[3];
        for (int i = 0; i < 3; i++) {
            arm[i] = (at->position[3 * k + i] - p->base[3 * k + i]) - (at->position[3 * on + i] - p->base[3 * on + i]);
            moved[i] = rates->velocity[3 * k + i] - rates->velocity[3 * on + i];
        }
        cross(arm, force + 3 * k, lever);
        cross(moved, force + 3 * k, swept);
        for (int i = 0; i < 3; i++) {
            force[3 * on + i] += force[3 * k + i];
            moment[3 * on + i] += moment[3 * k + i] + lever[i];
            about[3 * on + i] += about[3 * k + i] + swept[i];
        }
    }
    add_times_derivative(body, at, change, 1, back->bent, out);
    add_times_bent(body, rates->turned, rows, 1, back->bent, out);
}
