/* Mass of the deformed body, M(q), from constant integrals of each frame (docs/theory.md section 9).
 *
 * What frame s carries goes to x' = x_s + R_s y, y = r + sum of e_j q_j. Per unit of q_j all of it moves by
 * Rᵀ dx'/dq_j = t_j + w_j x y + e_j, so that the kinetic energy knows of the finite element model only the moments of r and
 * e_j. Index 0 stands for r, index j for e_j. Source: A. A. Shabana, Dynamics of Multibody Systems, 4th ed., chapter 5. */
#include <string.h>

#include "internal.h"

/* axial(A)_l = sum of eps_lik A_ik, so that that of a dyad a b is a x b. */
static void axial(const double *a, double *out) {
    out[0] = a[5] - a[7];
    out[1] = a[6] - a[2];
    out[2] = a[1] - a[3];
}

/* What all functions here begin with: derivatives of the frames' places, and workspaces. */
typedef struct {
    double *translation, *spin, *operator_; /* (S, 3, m), (S, 3, m), (6K, m) */
    double *translation_rate, *spin_rate;   /* (S, 3, m) */
    double *shape;                          /* (1 + m): 1, then q */
    double *twist;                          /* (6, m) of the part at hand, on its own axes */
    double *mixed, *moment;                 /* (1 + m, 3, 3): integral of rho y y_b, and of rho x' y_b */
    double *half;                           /* (6, m) */
    double first[3], square[9];
} Motion;

int64_t mass_size(const Body *body) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    if (!p->inertial) return 0;
    return 6 * p->nodes * m * 2 + 6 * p->frames * m + (1 + m) + 12 * m + 18 * (1 + m) + m + 9 * m;
}

static void begin(const Body *body, const Configuration *at, double *scratch, Motion *s) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    s->operator_ = scratch;
    s->translation = s->operator_ + 6 * p->nodes * m;
    s->spin = s->translation + 3 * p->nodes * m;
    s->translation_rate = s->spin + 3 * p->nodes * m;
    s->spin_rate = s->translation_rate + 3 * p->frames * m;
    s->shape = s->spin_rate + 3 * p->frames * m;
    s->twist = s->shape + 1 + m;
    s->half = s->twist + 6 * m;
    s->mixed = s->half + 6 * m;
    s->moment = s->mixed + 9 * (1 + m);
    full_operator(body, at, s->operator_);
    node_jacobians(body, at, s->operator_, s->translation, s->spin);
    s->shape[0] = 1.0;
    memcpy(s->shape + 1, at->q, (size_t)m * sizeof(double));
}

/* Moments of part i at q, and its frame's twists. */
static void part_moments(const Body *body, const Configuration *at, int64_t i, Motion *s) {
    const Program *p = &body->p;
    const int64_t m = p->modes, c = 1 + m, k = p->inertial_frame[i];
    const double *second = p->inertial_second + i * c * c * 9;
    apply_back_rows(at->rotation + 9 * k, s->translation + 3 * k * m, s->twist, m);
    apply_back_rows(at->rotation + 9 * k, s->spin + 3 * k * m, s->twist + 3 * m, m);
    memset(s->first, 0, sizeof s->first);
    memset(s->square, 0, sizeof s->square);
    memset(s->mixed, 0, (size_t)(9 * c) * sizeof(double));
    add_rows(s->shape, p->inertial_first + i * c * 3, s->first, c, 3);
    add_rows(s->shape, second, s->mixed, c, 9 * c);
    add_rows(s->shape, s->mixed, s->square, c, 9);
}

void mass_matrix(const Body *body, const Configuration *at, double *scratch, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    Motion s;
    begin(body, at, scratch, &s);
    memset(out, 0, (size_t)(m * m) * sizeof(double));
    for (int64_t i = 0; i < p->inertial_parts; i++) {
        part_moments(body, at, i, &s);
        const double *first = p->inertial_first + i * (1 + m) * 3;
        double lever[9], rigid[36] = {0};
        const double trace = s.square[0] + s.square[4] + s.square[8];
        skew(s.first, lever);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) {
                rigid[6 * a + b] = a == b ? p->inertial_mass[i] : 0.0;
                rigid[6 * (3 + a) + b] = lever[3 * a + b];
                rigid[6 * a + 3 + b] = -lever[3 * a + b];
                rigid[6 * (3 + a) + 3 + b] = (a == b ? trace : 0.0) - s.square[3 * a + b];
            }
        for (int a = 0; a < 36; a++) rigid[a] *= 0.5;
        product(rigid, s.twist, s.half, 6, 6, m);
        for (int64_t j = 0; j < m; j++) {
            double turned[3];
            axial(s.mixed + 9 * (1 + j), turned);
            for (int a = 0; a < 3; a++) {
                s.half[a * m + j] += first[3 * (1 + j) + a];
                s.half[(3 + a) * m + j] += turned[a];
            }
        }
        add_transposed_product(s.twist, s.half, out, 6, m, m);
    }
    for (int64_t a = 0; a < m; a++)
        for (int64_t b = 0; b <= a; b++) {
            const double sum = out[a * m + b] + out[b * m + a];
            out[a * m + b] = sum + p->inertial_elastic[a * m + b];
            out[b * m + a] = sum + p->inertial_elastic[b * m + a];
        }
}

/* Derivatives of the frames' translations and spins in a direction, (S, 3, m) each. */
static void motion_rates(const Body *body, const Configuration *at, const double *along, Motion *s) {
    const Program *p = &body->p;
    const int64_t m = p->modes, size = 3 * m;
    for (int64_t k = 0; k < p->frames; k++) {
        const int64_t on = p->parent[k];
        const double *c = s->operator_ + (p->nodes + k) * size, *d = s->operator_ + k * size, *parent = at->parent + 9 * k;
        double turn_along[3], slope[9], both[9], rate[3] = {0}, hat[9], arm[3], push[3], change[3], hat_arm[9], hat_change[9];
        double *x = s->translation_rate + k * size, *w = s->spin_rate + k * size;
        rows_times(c, along, turn_along, 3, m);
        jacobian_rate(at->local + 3 * (p->nodes + k), turn_along, slope);
        multiply(parent, slope, both);
        apply_rows(both, c, w, m);
        memset(x, 0, (size_t)size * sizeof(double));
        if (on < 0) continue;
        rows_times(s->spin + on * size, along, rate, 3, m);
        rows_times(d, along, push, 3, m);
        apply(parent, push, change);
        apply(parent, at->local + 3 * k, arm);
        cross(rate, arm, push);
        for (int i = 0; i < 3; i++) change[i] += push[i];
        skew(rate, hat);
        skew(arm, hat_arm);
        skew(change, hat_change);
        /* The part of the spin that is relative to the parent turns with it, and so does what the frame is pushed by. */
        double turned[9], pushed[9];
        multiply(parent, at->jacobian + 9 * k, both);
        multiply(hat, both, turned);
        multiply(hat, parent, pushed);
        const double *spin = s->spin + on * size, *spin_rate = s->spin_rate + on * size;
        const double *from = s->translation_rate + on * size;
        for (int i = 0; i < 3; i++)
            for (int64_t j = 0; j < m; j++) {
                double sum = spin_rate[i * m + j], moved = from[i * m + j];
                for (int l = 0; l < 3; l++) {
                    sum += turned[3 * i + l] * c[l * m + j];
                    moved += pushed[3 * i + l] * d[l * m + j] - hat_change[3 * i + l] * spin[l * m + j] -
                             hat_arm[3 * i + l] * spin_rate[l * m + j];
                }
                w[i * m + j] += sum;
                x[i * m + j] += moved;
            }
    }
}

/* out (m) += (dJ/dq a)ᵀ M_FE J b of part i, its moments and the rates along a at hand. */
static void add_momentum_change(const Body *body, const Configuration *at, int64_t i, Motion *s, const double *a,
                                const double *b, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes, c = 1 + m, k = p->inertial_frame[i];
    const double *first = p->inertial_first + i * c * 3, *second = p->inertial_second + i * c * c * 9;
    double rate_a[6], rate_b[6], hat_a[9], hat_b[9], momentum[3] = {0}, about[3], whole[9] = {0}, turned[9], moved[9] = {0};
    rows_times(s->twist, a, rate_a, 6, m);
    rows_times(s->twist, b, rate_b, 6, m);
    skew(rate_a + 3, hat_a);
    skew(rate_b + 3, hat_b);
    /* Momentum of the motion b: integrals of rho x', rho x' y_b, rho x' y. */
    add_rows(b, first + 3, momentum, m, 3);
    cross(rate_b + 3, s->first, about);
    for (int l = 0; l < 3; l++) momentum[l] += p->inertial_mass[i] * rate_b[l] + about[l];
    memset(s->moment, 0, (size_t)(9 * c) * sizeof(double));
    add_rows(b, second + 9 * c, s->moment, m, 9 * c);
    for (int64_t l = 0; l < c; l++) {
        double spun[9];
        multiply(hat_b, s->mixed + 9 * l, spun);
        for (int x = 0; x < 9; x++) s->moment[9 * l + x] += spun[x] + rate_b[x / 3] * first[3 * l + x % 3];
    }
    add_rows(s->shape, s->moment, whole, c, 9);
    add_rows(a, s->moment + 9, moved, m, 9);
    for (int x = 0; x < 3; x++)
        for (int y = 0; y < 3; y++) {
            double sum = moved[3 * x + y];
            for (int l = 0; l < 3; l++) sum += whole[3 * x + l] * hat_a[3 * y + l];
            turned[3 * x + y] = sum;
        }
    double force[3], spun[3], torque[3], back[6];
    axial(whole, spun);
    axial(turned, torque);
    apply(at->rotation + 9 * k, momentum, force);
    apply(at->rotation + 9 * k, spun, back);
    for (int l = 0; l < 3; l++) {
        back[l] = -back[l];
        torque[l] = -torque[l];
    }
    add_rows(force, s->translation_rate + 3 * k * m, out, 3, m);
    add_rows(back, s->spin_rate + 3 * k * m, out, 3, m);
    add_rows(torque, s->twist + 3 * m, out, 3, m);
    for (int64_t j = 0; j < m; j++) {
        axial(s->moment + 9 * (1 + j), spun);
        out[j] -= dot(spun, rate_a + 3, 3);
    }
}

/* Derivative of v M(q) v / 2 by q, (m), at a fixed v. */
void kinetic_gradient(const Body *body, const Configuration *at, const double *v, double *scratch, double *out) {
    Motion s;
    begin(body, at, scratch, &s);
    motion_rates(body, at, v, &s);
    memset(out, 0, (size_t)body->p.modes * sizeof(double));
    for (int64_t i = 0; i < body->p.inertial_parts; i++) {
        part_moments(body, at, i, &s);
        add_momentum_change(body, at, i, &s, v, v, out);
    }
}

void momentum_slope(const Body *body, const Configuration *at, const double *w, double *scratch, double *out) {
    const int64_t m = body->p.modes;
    Motion s;
    begin(body, at, scratch, &s);
    double *unit = s.moment + 9 * (1 + m);
    memset(unit, 0, (size_t)m * sizeof(double));
    memset(out, 0, (size_t)(m * m) * sizeof(double));
    for (int64_t j = 0; j < m; j++) {
        unit[j] = 1.0;
        for (int turn = 0; turn < 2; turn++) {
            const double *a = turn ? w : unit, *b = turn ? unit : w;
            motion_rates(body, at, a, &s);
            for (int64_t i = 0; i < body->p.inertial_parts; i++) {
                part_moments(body, at, i, &s);
                add_momentum_change(body, at, i, &s, a, b, out + j * m);
            }
        }
        unit[j] = 0.0;
    }
}

/* d(M v)/dt - d(v M v / 2)/dq - M dv/dt: centrifugal and Coriolis forces with their sign reversed. */
void convective_force(const Body *body, const Configuration *at, const double *v, double *scratch, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes, c = 1 + m;
    Motion s;
    begin(body, at, scratch, &s);
    motion_rates(body, at, v, &s);
    memset(out, 0, (size_t)m * sizeof(double));
    for (int64_t i = 0; i < p->inertial_parts; i++) {
        const int64_t k = p->inertial_frame[i];
        const double *first = p->inertial_first + i * c * 3, *second = p->inertial_second + i * c * c * 9;
        double global[6], linear[3], angular[3], rate[3], hat[9], whirl[9], twice[9], drift[3] = {0}, momentum[3], about[3];
        double whole[9] = {0}, wrench[6];
        part_moments(body, at, i, &s);
        rows_times(s.translation_rate + 3 * k * m, v, global, 3, m);
        rows_times(s.spin_rate + 3 * k * m, v, global + 3, 3, m);
        apply_back(at->rotation + 9 * k, global, linear);
        apply_back(at->rotation + 9 * k, global + 3, angular);
        rows_times(s.twist + 3 * m, v, rate, 3, m);
        /* Acceleration of y on the frame: angular x y + rate x (rate x y) + 2 rate x y'. */
        skew(rate, hat);
        multiply(hat, hat, twice);
        skew(angular, whirl);
        for (int x = 0; x < 9; x++) whirl[x] += twice[x];
        add_rows(v, first + 3, drift, m, 3);
        apply(whirl, s.first, momentum);
        cross(rate, drift, about);
        for (int x = 0; x < 3; x++) momentum[x] += p->inertial_mass[i] * linear[x] + 2.0 * about[x];
        memset(s.moment, 0, (size_t)(9 * c) * sizeof(double));
        add_rows(v, second + 9 * c, s.moment, m, 9 * c);
        for (int64_t l = 0; l < c; l++) {
            double spun[9], slow[9];
            multiply(whirl, s.mixed + 9 * l, spun);
            multiply(hat, s.moment + 9 * l, slow);
            for (int x = 0; x < 9; x++) s.moment[9 * l + x] = spun[x] + 2.0 * slow[x] + linear[x / 3] * first[3 * l + x % 3];
        }
        add_rows(s.shape, s.moment, whole, c, 9);
        memcpy(wrench, momentum, sizeof momentum);
        axial(whole, wrench + 3);
        for (int x = 3; x < 6; x++) wrench[x] = -wrench[x];
        add_rows(wrench, s.twist, out, 6, m);
        for (int64_t j = 0; j < m; j++) {
            const double *t = s.moment + 9 * (1 + j);
            out[j] += t[0] + t[4] + t[8];
        }
    }
}
