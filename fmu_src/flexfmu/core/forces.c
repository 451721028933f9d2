#include "forces.h"

#include <math.h>
#include <string.h>

#include "algebra.h"

/* Cost of the springs of a tie, in multiplications. */
enum { TIE = 200 };

void take_loads(const Body *body, Arena *arena, Loads *loads) {
    const int64_t m = body->p->modes, n = body->p->nodes, square = body->p->by_load_given * m * m;
    loads->force = take(arena, 3 * n);
    loads->moment = take(arena, 3 * n);
    loads->follow = take(arena, body->p->followers ? 6 * body->p->interfaces : 0);
    loads->constant = take(arena, m);
    loads->f_constant = take(arena, m);
    loads->geometric = take(arena, square);
    loads->f_geometric = take(arena, square);
}

int forces_depend(const Body *body) {
    const Program *p = body->p;
    return p->placement != PLACE_REFERENCE || p->by_load_given || p->by_mode_given || p->ties;
}

void spread(const Body *body, const double *inputs, Loads *loads) {
    const Program *p = body->p;
    const int64_t m = p->modes, first = p->frames, count = p->interfaces;
    static const double none[3] = {0.0, 0.0, 0.0};
    const double *acceleration = p->masses ? inputs + 6 * count : none;
    int any = 0;
    loads->has_moments = loads->following = 0;
    memset(loads->follow, 0, (size_t)(p->followers ? 6 * count : 0) * sizeof(double));
    memset(loads->force, 0, (size_t)(3 * p->nodes) * sizeof(double));
    memset(loads->moment, 0, (size_t)(3 * p->nodes) * sizeof(double));
    memset(loads->f_constant, 0, (size_t)m * sizeof(double));
    for (int64_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            loads->force[3 * (first + i) + c] = inputs[6 * i + c];
            loads->moment[3 * (first + i) + c] = inputs[6 * i + 3 + c];
            any |= inputs[6 * i + c] != 0.0;
            loads->has_moments |= inputs[6 * i + 3 + c] != 0.0;
        }
    for (int64_t i = 0; i < p->followers; i++) {
        const int64_t one = p->follower[i], k = first + one;
        for (int c = 0; c < 6; c++) loads->following |= inputs[6 * one + c] != 0.0;
        memcpy(loads->follow + 6 * one, inputs + 6 * one, 6 * sizeof(double));
        memset(loads->force + 3 * k, 0, 3 * sizeof(double));
        memset(loads->moment + 3 * k, 0, 3 * sizeof(double));
    }
    /* They have no potential, as moments have none. */
    loads->has_moments |= loads->following;
    /* d'Alembert: in the supports' frame each mass feels the acceleration as a force against it. */
    for (int64_t i = 0; i < p->masses; i++)
        for (int c = 0; c < 3; c++) {
            const double f = -p->mass[i] * acceleration[c];
            loads->force[3 * (first + count + i) + c] = f;
            any |= f != 0.0;
        }
    add_rows(loads->force + 3 * first, p->load_operator, loads->f_constant, 3 * count, m);
    add_rows(acceleration, p->inertia_operator, loads->f_constant, 3, m);
    memcpy(loads->constant, loads->f_constant, (size_t)m * sizeof(double));
    if (loads->has_moments)
        add_rows(loads->moment + 3 * first, p->load_operator + 3 * count * m, loads->constant, 3 * count, m);
    for (int64_t i = 0; loads->following && i < p->followers; i++) {
        const int64_t one = p->follower[i];
        add_rows(inputs + 6 * one, p->load_operator + 3 * one * m, loads->constant, 3, m);
        add_rows(inputs + 6 * one + 3, p->load_operator + 3 * (count + one) * m, loads->constant, 3, m);
    }
    if (p->by_load_given) {
        memset(loads->geometric, 0, (size_t)(m * m) * sizeof(double));
        memset(loads->f_geometric, 0, (size_t)(m * m) * sizeof(double));
        add_rows(inputs, p->by_load, loads->geometric, p->loads, m * m);
        for (int64_t i = 0; i < p->loads; i++)
            if (i >= 6 * count || i % 6 < 3) add_rows(inputs + i, p->by_load + i * m * m, loads->f_geometric, 1, m * m);
    }
    loads->active = p->by_mode_given || p->ties || p->stretches || (forces_depend(body) && (any || loads->has_moments));
}

void tie_levers(const Body *body, const Configuration *at, int64_t tie, int64_t node, double *out) {
    double turned[9];
    multiply(at->rotation + 9 * node, body->p->tie_lever + 9 * tie, turned);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 3; i++) out[3 * c + i] = turned[3 * i + c];
}

double tie_tension(const Body *body, const Configuration *at, double *tense) {
    const Program *p = body->p;
    double held = 0.0;
    for (int64_t t = 0; t < p->ties; t++) {
        const int64_t a = p->nodes - 2 * p->ties + t, b = a + p->ties;
        double gap[12], other[9];
        for (int i = 0; i < 3; i++)
            gap[i] = at->position[3 * a + i] - at->position[3 * b + i] - p->tie_apart[3 * t + i];
        tie_levers(body, at, t, a, gap + 3);
        tie_levers(body, at, t, b, other);
        for (int i = 0; i < 9; i++) gap[3 + i] -= other[i];
        for (int i = 0; i < 12; i++) {
            tense[12 * t + i] = p->tie_stiffness[3 * t + i % 3] * gap[i];
            held += 0.5 * tense[12 * t + i] * gap[i];
        }
    }
    return held;
}

/* Add the loads of springs of a given tension to those on the nodes. */
static void add_tie_loads(const Body *body, const Configuration *at, const double *tense, double *force, double *moment) {
    const Program *p = body->p;
    for (int64_t t = 0; t < p->ties; t++)
        for (int end = 0; end < 2; end++) {
            const int64_t k = p->nodes - (2 - end) * p->ties + t;
            const double sign = end ? 1.0 : -1.0;
            double arms[9], about[3];
            tie_levers(body, at, t, k, arms);
            for (int i = 0; i < 3; i++) force[3 * k + i] += sign * tense[12 * t + i];
            for (int c = 0; c < 3; c++) {
                cross(arms + 3 * c, tense + 12 * t + 3 + 3 * c, about);
                for (int i = 0; i < 3; i++) moment[3 * k + i] += sign * about[i];
            }
        }
}

void add_followers(const Body *body, const Loads *loads, const Configuration *at, double *force, double *moment) {
    const Program *p = body->p;
    for (int64_t i = 0; loads->following && i < p->followers; i++) {
        const int64_t k = p->frames + p->follower[i];
        double turned[3];
        for (int end = 0; end < 2; end++) {
            double *to = (end ? moment : force) + 3 * k;
            apply(at->rotation + 9 * k, loads->follow + 6 * p->follower[i] + 3 * end, turned);
            for (int c = 0; c < 3; c++) to[c] += turned[c];
        }
    }
}

void take_force_room(const Body *body, Arena *arena, ForceRoom *room) {
    const Program *p = body->p;
    room->tense = take(arena, 12 * p->ties);
    room->loads = take(arena, 6 * p->nodes);
    take_back(body, arena, &room->back);
    room->square = take(arena, p->by_mode_given * p->modes * p->modes);
}

void modal_force(const Body *body, const Loads *loads, int with_moments, const Configuration *at, const double *tense,
                 ForceRoom *room, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes, n = p->nodes;
    const double *constant = with_moments ? loads->constant : loads->f_constant;
    const int moving = p->placement == PLACE_DEFORMED || p->ties;
    double *own = room->tense, *force = room->loads, *moment = force + 3 * n;
    if (due(body->slice, (double)(1500 + m + 20 * n + TIE * p->ties))) {
        memset(out, 0, (size_t)m * sizeof(double));
        memset(force, 0, (size_t)(6 * n) * sizeof(double));
        if (p->placement == PLACE_DEFORMED) memcpy(force, loads->force, (size_t)(3 * n) * sizeof(double));
        if (p->placement == PLACE_DEFORMED && with_moments) memcpy(moment, loads->moment, (size_t)(3 * n) * sizeof(double));
        if (with_moments) add_followers(body, loads, at, force, moment);
        if (moving && !tense) tie_tension(body, at, own);
        add_tie_loads(body, at, tense ? tense : own, force, moment);
    }
    if (moving) pass_back(body, at, force, moment, &room->back, out);
    if (!due(body->slice, (double)(3 * p->interfaces * m + p->by_load_given * m * m + p->by_mode_given * m * m * m))) return;
    if (p->placement != PLACE_DEFORMED) {
        for (int64_t j = 0; j < m; j++) out[j] += constant[j];
        if (p->placement == PLACE_CORRECTIVE_MOMENT)
            for (int64_t i = 0; i < p->interfaces; i++) {
                const int64_t k = p->frames + i;
                double displacement[3], moment[3];
                for (int c = 0; c < 3; c++) displacement[c] = at->position[3 * k + c] - p->point[3 * k + c];
                cross(displacement, loads->force + 3 * k, moment);
                add_rows(moment, p->load_operator + 3 * (p->interfaces + i) * m, out, 3, m);
            }
    }
    if (p->by_load_given) {
        const double *geometric = with_moments ? loads->geometric : loads->f_geometric;
        for (int64_t i = 0; i < m; i++) out[i] -= dot(geometric + i * m, at->q, m);
    }
    if (p->by_mode_given) {
        /* Sum of q_j K_j q and no more. Made the gradient of an energy, it would be bounded by the quartic term alone,
         * which modes do not have: a bent cantilever then collapses. */
        double *total = room->square;
        memset(total, 0, (size_t)(m * m) * sizeof(double));
        add_rows(at->q, p->by_mode, total, m, m * m);
        for (int64_t i = 0; i < m; i++) out[i] -= dot(total + i * m, at->q, m);
    }
}

int has_potential(const Body *body) {
    return body->p->placement != PLACE_CORRECTIVE_MOMENT && !body->p->by_mode_given;
}

double force_work(const Body *body, const Loads *loads, const Configuration *at) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    double work = 0.0;
    if (p->placement == PLACE_DEFORMED)
        for (int64_t i = 0; i < 3 * p->nodes; i++) work += loads->force[i] * (at->position[i] - p->point[i]);
    else
        work = dot(loads->f_constant, at->q, m);
    if (p->by_load_given)
        for (int64_t i = 0; i < m; i++) work -= 0.5 * at->q[i] * dot(loads->f_geometric + i * m, at->q, m);
    return work;
}

double work_reach(const Body *body, const double *force, int64_t n) {
    double sum = 0.0, far = 0.0;
    for (int64_t i = 0; i < n; i++) sum += norm(force + 3 * i, 3);
    for (int64_t k = 0; k < body->p->nodes; k++) far = fmax(far, dot(body->p->point + 3 * k, body->p->point + 3 * k, 3));
    return sum * sqrt(far);
}

void gap_derivative(const Body *body, const Configuration *at, const Jacobians *of, double *out) {
    const Program *p = body->p;
    const double *translation = of->translation, *spin = of->spin;
    const int64_t m = p->modes, size = 3 * m;
    for (int64_t t = 0; t < p->ties; t++) {
        const int64_t a = p->nodes - 2 * p->ties + t, b = a + p->ties;
        double arms_a[9], arms_b[9], *row = out + 12 * t * m;
        if (!due(body->slice, (double)(60 * m))) continue;
        tie_levers(body, at, t, a, arms_a);
        tie_levers(body, at, t, b, arms_b);
        for (int64_t j = 0; j < size; j++) row[j] = translation[a * size + j] - translation[b * size + j];
        for (int c = 0; c < 3; c++) {
            double hat_a[9], hat_b[9];
            skew(arms_a + 3 * c, hat_a);
            skew(arms_b + 3 * c, hat_b);
            row += size;
            for (int i = 0; i < 3; i++)
                for (int64_t j = 0; j < m; j++) {
                    double sum = 0.0;
                    for (int l = 0; l < 3; l++)
                        sum += hat_b[3 * i + l] * spin[b * size + l * m + j] - hat_a[3 * i + l] * spin[a * size + l * m + j];
                    row[i * m + j] = sum;
                }
        }
    }
}

void take_foreseen(const Body *body, Arena *arena, Foreseen *room) {
    take_jacobians(body, arena, &room->of);
    room->gaps = take(arena, 12 * body->p->ties * body->p->modes);
}

void foreseen_tension(const Body *body, const Configuration *at, const double *change, Foreseen *room, double *tense) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    jacobians_at(body, at, &room->of);
    gap_derivative(body, at, &room->of, room->gaps);
    tie_tension(body, at, tense);
    for (int64_t i = 0; i < 12 * p->ties; i++)
        tense[i] += p->tie_stiffness[3 * (i / 12) + i % 3] * dot(room->gaps + i * m, change, m);
}

/* out += sum of Wᵀ (dm/dw) W of the moments of springs of a given tension, which turn with their points, negative. */
static void subtract_moment_stiffness(const Body *body, const Configuration *at, const double *tense, const double *spin,
                                      double *scratch, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    for (int64_t t = 0; t < p->ties; t++)
        for (int end = 0; end < 2; end++) {
            const int64_t k = p->nodes - (2 - end) * p->ties + t;
            double arms[9], change[9] = {0}, trace = 0.0;
            if (!due(body->slice, (double)(3 * m * (m + 3)))) continue;
            tie_levers(body, at, t, k, arms);
            /* (w x r) x t = r (w.t) - w (r.t) */
            for (int c = 0; c < 3; c++)
                for (int i = 0; i < 3; i++) {
                    for (int j = 0; j < 3; j++) change[3 * i + j] += arms[3 * c + i] * tense[12 * t + 3 + 3 * c + j];
                    trace += arms[3 * c + i] * tense[12 * t + 3 + 3 * c + i];
                }
            for (int i = 0; i < 3; i++) change[4 * i] -= trace;
            /* Minus, and minus again at end a, whose loads have the other sign. */
            for (int i = 0; i < 9; i++) change[i] *= end ? -1.0 : 1.0;
            apply_rows(change, spin + 3 * k * m, scratch, m);
            add_transposed_product(spin + 3 * k * m, scratch, out, 3, m, m);
        }
}

void take_tangent_room(const Body *body, Arena *arena, TangentRoom *room) {
    const Program *p = body->p;
    const int64_t m = p->modes, n = p->nodes;
    take_jacobians(body, arena, &room->of);
    take_load_slope(body, arena, &room->slope);
    room->loads = take(arena, 6 * n);
    room->turned = take(arena, p->followers ? 6 * n : 0);
    room->tense = take(arena, 12 * p->ties);
    room->gaps = take(arena, 12 * p->ties * m);
    room->row = take(arena, 3 * m);
    room->square = take(arena, p->by_mode_given * m * m);
    take_stretch_stiffness(body, arena, &room->stretch);
}

/* out (m, m) += what loads that turn with an interface change by its spin; they themselves join room->loads. */
static void add_follower_stiffness(const Body *body, const Loads *loads, const Configuration *at, TangentRoom *room,
                                   double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes, n = p->nodes;
    const double *translation = room->of.translation, *spin = room->of.spin;
    double *turned = room->turned, *row = room->row, hat[9];
    memset(turned, 0, (size_t)(6 * n) * sizeof(double));
    add_followers(body, loads, at, turned, turned + 3 * n);
    for (int64_t i = 0; i < 6 * n; i++) room->loads[i] += turned[i];
    for (int64_t i = 0; i < p->followers; i++)
        for (int end = 0; end < 2; end++) {
            const int64_t k = p->frames + p->follower[i];
            skew(turned + 3 * n * end + 3 * k, hat);
            for (int c = 0; c < 9; c++) hat[c] = -hat[c];
            apply_rows(hat, spin + 3 * k * m, row, m);
            add_transposed_product((end ? spin : translation) + 3 * k * m, row, out, 3, m, m);
        }
}

/* out (m, m) += dQ/dq of loads on the moving body, and of springs of a given tension. */
static void add_moving_stiffness(const Body *body, const Loads *loads, int with_moments, const Configuration *at,
                                 const double *tense, TangentRoom *room, double *out) {
    const Program *p = body->p;
    const int64_t n = p->nodes;
    double *force = room->loads, *moment = force + 3 * n;
    if (due(body->slice, (double)(500 + TIE * p->ties + 18 * n + 6 * p->followers * p->modes * p->modes))) {
        memset(force, 0, (size_t)(6 * n) * sizeof(double));
        if (p->placement == PLACE_DEFORMED) memcpy(force, loads->force, (size_t)(3 * n) * sizeof(double));
        if (p->placement == PLACE_DEFORMED && with_moments) memcpy(moment, loads->moment, (size_t)(3 * n) * sizeof(double));
        if (with_moments && loads->following) add_follower_stiffness(body, loads, at, room, out);
        add_tie_loads(body, at, tense, force, moment);
    }
    add_load_stiffness(body, at, force, moment, &room->of, &room->slope, out);
}

/* out (m, m) += the stiffness of springs of a given tension, without that of their pull on the moving body. */
static void add_tie_stiffness(const Body *body, const Configuration *at, const double *tense, TangentRoom *room, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    double *gaps = room->gaps, *row = room->row;
    gap_derivative(body, at, &room->of, gaps);
    for (int64_t i = 0; i < 12 * p->ties; i++) {
        const double k = p->tie_stiffness[3 * (i / 12) + i % 3];
        if (!due(body->slice, (double)(m * m))) continue;
        for (int64_t j = 0; j < m; j++) row[j] = k * gaps[i * m + j];
        add_transposed_product(gaps + i * m, row, out, 1, m, m);
    }
    if (due(body->slice, (double)(m * m)))
        for (int64_t j = 0; j < m * m; j++) out[j] -= p->tie_initial[j];
    subtract_moment_stiffness(body, at, tense, room->of.spin, row, out);
}

void add_turned_joints(const Body *body, const TangentRoom *room, const double *direction, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    for (int64_t i = 0; i < 12 * p->ties; i++) {
        const double tension = p->tie_stiffness[3 * (i / 12) + i % 3] * dot(room->gaps + i * m, direction, m);
        for (int64_t j = 0; j < m; j++) out[j] += tension * room->gaps[i * m + j];
    }
    for (int64_t j = 0; j < p->tied * m; j++) out[j] -= dot(p->tie_initial + j * m, direction, m);
}

static void add_mode_stiffness(const Body *body, const Configuration *at, double *square, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    memset(square, 0, (size_t)(m * m) * sizeof(double));
    add_rows(at->q, p->by_mode, square, m, m * m);
    for (int64_t j = 0; j < m * m; j++) out[j] += square[j];
    /* (K_b q)_a of the stiffness of mode b. */
    for (int64_t b = 0; b < m; b++)
        for (int64_t a = 0; a < m; a++) out[a * m + b] += dot(p->by_mode + (b * m + a) * m, at->q, m);
}

void tangent_stiffness(const Body *body, const Loads *loads, int with_moments, const Configuration *at,
                       const double *tense, TangentRoom *room, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Rows now;
    clear_rows(out, m, rows_due(body->slice, m, cost_of_copy(m)));
    if (!loads->active && !body->slice) {
        for (int64_t j = 0; j < m; j++) out[j * m + j] = body->opened->stiffness[j];
        return;
    }
    if (!tense && due(body->slice, (double)(TIE * p->ties))) tie_tension(body, at, room->tense);
    const double *pull = tense ? tense : room->tense;
    jacobians_at(body, at, &room->of);
    if (over(body->slice)) return;
    /* First dQ/dq, with its sign reversed below. */
    if (p->placement == PLACE_DEFORMED || p->ties) add_moving_stiffness(body, loads, with_moments, at, pull, room, out);
    if (p->placement == PLACE_CORRECTIVE_MOMENT)
        for (int64_t i = 0; i < p->interfaces; i++) {
            const int64_t k = p->frames + i;
            double hat[9];
            if (!due(body->slice, (double)(3 * m * (m + 3)))) continue;
            skew(loads->force + 3 * k, hat);
            for (int c = 0; c < 9; c++) hat[c] = -hat[c];
            apply_rows(hat, room->of.translation + 3 * k * m, room->row, m);
            add_transposed_product(p->load_operator + 3 * (p->interfaces + i) * m, room->row, out, 3, m, m);
        }
    if (over(body->slice)) return;
    now = rows_due(body->slice, m, (double)(5 * m));
    for (int64_t j = now.at * m; j < now.end * m; j++) out[j] = -out[j];
    for (int64_t j = now.at; j < now.end; j++) out[j * m + j] += body->opened->stiffness[j];
    if (p->ties) add_tie_stiffness(body, at, pull, room, out);
    if (p->stretches) {
        stretch_at(body, at->q, &room->stretch);
        add_stretch_stiffness(body, &room->stretch, out);
    }
    if (p->by_load_given) {
        const double *geometric = with_moments ? loads->geometric : loads->f_geometric;
        now = rows_due(body->slice, m, (double)(2 * m));
        for (int64_t j = now.at * m; j < now.end * m; j++) out[j] += geometric[j];
    }
    if (p->by_mode_given && due(body->slice, (double)(2 * m * m * m))) add_mode_stiffness(body, at, room->square, out);
}
