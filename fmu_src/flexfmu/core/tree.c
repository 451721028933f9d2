/* Kinematics of the tree of frames, docs/theory.md sections 4 and 4a. */
#include <string.h>

#include "internal.h"
#include "vectors.h"

static const double IDENTITY[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

void take_configuration(const Body *body, Arena *arena, Configuration *at) {
    const Program *p = &body->p;
    at->q = take(arena, p->modes);
    at->straight = take(arena, 6 * p->nodes);
    at->bent = take(arena, p->parts * p->modes);
    at->turned = take(arena, body->bend_rows);
    at->local = take(arena, 6 * p->nodes);
    at->position = take(arena, 3 * p->nodes);
    at->rotation = take(arena, 9 * p->nodes);
    at->parent = take(arena, 9 * p->nodes);
    at->jacobian = take(arena, 9 * p->nodes);
}

/* Rows that move: seen from its frame no lump turns, and those rows come last. */
static int64_t moving_rows(const Program *p) { return 6 * p->nodes - 3 * p->lumps; }

/* Basis (r, m) of the coordinates that bend a part; null where q itself does: without any, or where there are m of them. */
static const double *part_basis(const Program *p, int64_t part) {
    const double *basis = p->basis;
    if (!basis || p->extent[part] == p->modes) return 0;
    for (int64_t i = 0; i < part; i++) basis += p->extent[i] * p->modes;
    return basis;
}

/* Coordinates that bend each part at q, (parts, m) with r of them in each row. */
static void part_coordinates(const Program *p, const double *q, double *x) {
    for (int64_t i = 0; i < p->parts; i++) {
        const double *basis = part_basis(p, i);
        if (basis)
            rows_times(basis, q, x + i * p->modes, p->extent[i], p->modes);
        else
            memcpy(x + i * p->modes, q, (size_t)p->modes * sizeof(double));
    }
}

/* Whether a row of the operator is needed. */
static int wanted(const Program *p, const Need *need, int64_t row) {
    const int64_t node = row / 3;
    return !need || (node < p->nodes ? need[node].offset : need[node - p->nodes].turn);
}

/* Curvature times the coordinates, of rows that are needed, by the LANES of them. */
static void turn_rows(const Body *body, const Need *need, const double *bent, double *to) {
    const Program *p = &body->p;
    for (int64_t part = 0; part < p->parts; part++) {
        const Bend *bend = body->bends + part;
        const int64_t r = p->extent[part], size = packed_size(r);
        const double *curvature = bend->curvature;
        for (int64_t first = 0; first < bend->count; first += LANES, curvature += size) {
            int any = 0;
            for (int64_t k = first; k < first + LANES && k < bend->count; k++) any |= wanted(p, need, bend->row[k]);
            if (!any) continue;
            packed_times(curvature, bent + part * p->modes, body->four, r);
            unpack(body->four, to + bend->start + first * r, r);
        }
    }
}

/* b and phi from their linear part and the curvature's share in their derivatives. */
static void bend_rows(const Body *body, const Need *need, Configuration *at) {
    const Program *p = &body->p;
    memcpy(at->local, at->straight, (size_t)(6 * p->nodes) * sizeof(double));
    for (int64_t part = 0; part < p->parts; part++) {
        const Bend *bend = body->bends + part;
        const int64_t r = p->extent[part];
        for (int64_t k = 0; k < bend->count; k++)
            if (wanted(p, need, bend->row[k]))
                at->local[bend->row[k]] += 0.5 * dot(at->turned + bend->start + k * r, at->bent + part * p->modes, r);
    }
}

/* The pass outwards, (4) and (6). What is not needed stays where it was undeformed. */
static void place(const Program *p, const Need *need, Configuration *at) {
    for (int64_t k = 0; k < p->nodes; k++) {
        const int64_t on = p->parent[k];
        const double *parent = on < 0 ? IDENTITY : at->rotation + 9 * on;
        double *b = at->local + 3 * k, arm[3], relative[9];
        memcpy(at->parent + 9 * k, parent, sizeof IDENTITY);
        if (!need || need[k].turn) {
            exponential(at->local + 3 * (p->nodes + k), relative, at->jacobian + 9 * k);
            multiply(parent, relative, at->rotation + 9 * k);
            /* Rates of a body that turns as a whole are its spin in its own axes. */
            if (p->turns && k == 0) memcpy(at->jacobian, relative, sizeof relative);
        }
        if (need && !need[k].offset) {
            memcpy(at->position + 3 * k, p->point + 3 * k, 3 * sizeof(double));
            continue;
        }
        for (int i = 0; i < 3; i++) b[i] += p->offset[3 * k + i];
        apply(parent, b, arm);
        for (int i = 0; i < 3; i++) {
            const double from = on < 0 ? 0.0 : at->position[3 * on + i] - p->base[3 * on + i];
            at->position[3 * k + i] = p->base[3 * k + i] + from + arm[i];
        }
    }
}

/* All that is linear in q: what places are made of. */
void configure_linear(const Body *body, const Need *need, const double *q, Configuration *at) {
    const Program *p = &body->p;
    if (at->q != q) memcpy(at->q, q, (size_t)p->modes * sizeof(double));
    memset(at->straight, 0, (size_t)(6 * p->nodes) * sizeof(double));
    add_strided_rows(q, body->operator_t, 6 * p->nodes, at->straight, p->modes, moving_rows(p));
    if (!p->curved) return;
    part_coordinates(p, q, at->bent);
    turn_rows(body, need, at->bent, at->turned);
}

void configure_places(const Body *body, const Need *need, Configuration *at) {
    bend_rows(body, need, at);
    place(&body->p, need, at);
}

void configure(const Body *body, const double *q, Configuration *at) {
    configure_linear(body, 0, q, at);
    configure_places(body, 0, at);
}

static void mean_of(const double *a, const double *b, double *out, int64_t n) {
    for (int64_t i = 0; i < n; i++) out[i] = 0.5 * (a[i] + b[i]);
}

/* Halfway between the q of two others: all that comes before places is linear in q. */
void configure_halfway(const Body *body, const Need *need, const Configuration *a, const Configuration *b, Configuration *at) {
    const Program *p = &body->p;
    mean_of(a->q, b->q, at->q, p->modes);
    mean_of(a->straight, b->straight, at->straight, 6 * p->nodes);
    if (p->curved) {
        mean_of(a->bent, b->bent, at->bent, p->parts * p->modes);
        mean_of(a->turned, b->turned, at->turned, body->bend_rows);
    }
    configure_places(body, need, at);
}

int64_t configuration_size(const Body *body) {
    Arena count = {0, 0};
    Configuration at;
    take_configuration(body, &count, &at);
    return count.used;
}

/* Their numbers lie in one run, from q on. */
void copy_configuration(const Body *body, const Configuration *from, Configuration *to) {
    memcpy(to->q, from->q, (size_t)configuration_size(body) * sizeof(double));
}

static int same(const double *a, const double *b, int64_t n) { return memcmp(a, b, (size_t)n * sizeof(double)) == 0; }

/* What of each node steps under some loads need: frames carry others, ties hold others. */
void find_need(Body *body, const double *inputs, const double *inputs_end) {
    const Program *p = &body->p;
    const int64_t first = p->frames, masses = first + p->interfaces, lumps = masses + p->masses;
    memset(body->need, 1, (size_t)p->nodes * sizeof *body->need);
    for (int64_t k = lumps; k < lumps + p->lumps; k++) body->need[k].turn = 0;
    for (int64_t k = first; k < lumps; k++) {
        const double *loads[2] = {inputs, inputs_end ? inputs_end : inputs};
        body->need[k].offset = body->need[k].turn = 0;
        for (int end = 0; end < 2; end++) {
            const double *own = loads[end] + (k < masses ? 6 * (k - first) : 6 * p->interfaces);
            body->need[k].offset |= !(own[0] == 0.0 && own[1] == 0.0 && own[2] == 0.0);
            if (k < masses) body->need[k].turn |= !(own[3] == 0.0 && own[4] == 0.0 && own[5] == 0.0);
        }
    }
    for (int64_t i = 0; i < p->followers; i++) {
        Need *own = body->need + first + p->follower[i];
        own->offset = own->turn = own->offset || own->turn;
    }
}

/* Keep the configuration of a q, of which what `need` says is known. */
void remember(Body *body, const Need *need, const Configuration *at) {
    copy_configuration(body, at, &body->memo);
    memcpy(body->memo_need, need, (size_t)body->p.nodes * sizeof *need);
    body->memo_known = 1;
}

/* The configuration of q where what is needed is known already: 1. */
int recall(const Body *body, const Need *need, const double *q, Configuration *at) {
    if (!body->memo_known || !same(q, body->memo.q, body->p.modes)) return 0;
    for (int64_t k = 0; k < body->p.nodes; k++)
        if (need[k].offset > body->memo_need[k].offset || need[k].turn > body->memo_need[k].turn) return 0;
    copy_configuration(body, &body->memo, at);
    return 1;
}

const Configuration *whole_configuration(Body *body, const double *q) {
    const int64_t n = body->p.nodes;
    if (!body->memo_known || !same(q, body->memo.q, body->p.modes)) {
        configure(body, q, &body->memo);
    } else {
        int missing = 0;
        for (int64_t k = 0; k < n; k++) {
            body->need[k].offset = !body->memo_need[k].offset;
            body->need[k].turn = !body->memo_need[k].turn;
            missing |= body->need[k].offset | body->need[k].turn;
        }
        if (!missing) return &body->memo;
        if (body->p.curved) turn_rows(body, body->need, body->memo.bent, body->memo.turned);
        configure_places(body, 0, &body->memo);
    }
    memset(body->memo_need, 1, (size_t)n * sizeof *body->memo_need);
    body->memo_known = 1;
    return &body->memo;
}

/* out (count, m) += factors (count, 6K) times what is bent, (r) of each row that is curved; `scratch` holds (count, parts, m). */
static void add_times_bent(const Body *body, const double *turned, const double *factors, int64_t count, double *scratch,
                           double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes, each = p->parts * m;
    if (!p->curved) return;
    memset(scratch, 0, (size_t)(count * each) * sizeof(double));
    for (int64_t part = 0; part < p->parts; part++) {
        const Bend *bend = body->bends + part;
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
    for (int64_t part = 0; part < p->parts; part++) {
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
    const Program *p = &body->p;
    add_product(factors, 6 * p->nodes, p->operator_, out, count, moving_rows(p), p->modes);
    add_times_bent(body, at->turned, factors, count, scratch, out);
}

int64_t pass_back_size(const Body *body) { return 6 * body->p.nodes + body->p.parts * body->p.modes; }

static int no_load(const double *x) { return x[0] == 0.0 && x[1] == 0.0 && x[2] == 0.0; }

void gather(const Body *body, const Configuration *at, double *force, double *moment, double *rows) {
    const Program *p = &body->p;
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

/* The pass back, (8): out (m) += generalised force of loads (K, 3), which are gathered in place. */
void pass_back(const Body *body, const Configuration *at, double *force, double *moment, double *scratch, double *out) {
    gather(body, at, force, moment, scratch);
    add_times_derivative(body, at, scratch, 1, scratch + 6 * body->p.nodes, out);
}

/* Derivatives (6K, m) of b and phi by q. */
void full_operator(const Body *body, const Configuration *at, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    memcpy(out, p->operator_, (size_t)(6 * p->nodes * m) * sizeof(double));
    if (!p->curved) return;
    for (int64_t part = 0; part < p->parts; part++) {
        const Bend *bend = body->bends + part;
        const double *basis = part_basis(p, part);
        const int64_t r = p->extent[part];
        for (int64_t k = 0; k < bend->count; k++) {
            const double *turned = at->turned + bend->start + k * r;
            double *row = out + bend->row[k] * m;
            if (basis)
                add_rows(turned, basis, row, r, m);
            else
                for (int64_t j = 0; j < m; j++) row[j] += turned[j];
        }
    }
}

/* Derivatives of places and spins by q, each (K, 3, m). */
void node_jacobians(const Body *body, const Configuration *at, const double *operator_, double *translation, double *spin) {
    const Program *p = &body->p;
    const int64_t m = p->modes, size = 3 * m;
    for (int64_t k = 0; k < p->nodes; k++) {
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

int64_t load_stiffness_size(const Body *body) {
    return 6 * body->p.nodes + 6 * body->p.nodes + 3 * body->p.nodes * body->p.modes + 6 * body->p.modes + body->p.modes * body->p.modes;
}

/* out (m, m) += dQ/dq under loads (K, 3) at fixed forces and moments. */
void add_load_stiffness(const Body *body, const Configuration *at, const double *force, const double *moment,
                        const double *operator_, const double *translation, const double *spin, double *scratch,
                        double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes, n = p->nodes, size = 3 * m;
    double *rows = scratch, *total = rows + 6 * n, *about = total + 3 * n, *change = about + 3 * n;
    double *one = change + n * size, *other = one + size, *square = other + size;
    memcpy(total, force, (size_t)(3 * n) * sizeof(double));
    memcpy(about, moment, (size_t)(3 * n) * sizeof(double));
    gather(body, at, total, about, rows);
    /* Of the moments about each node: sum of (x_d' - x_k') x f_d over what lies beyond it. */
    for (int64_t k = 0; k < n; k++) {
        double hat[9];
        skew(force + 3 * k, hat);
        for (int i = 0; i < 9; i++) hat[i] = -hat[i];
        apply_rows(hat, translation + k * size, change + k * size, m);
    }
    for (int64_t k = n - 1; k >= 0; k--) {
        const int64_t on = p->parent[k];
        if (on >= 0)
            for (int64_t j = 0; j < size; j++) change[on * size + j] += change[k * size + j];
    }
    for (int64_t k = 0; k < n; k++) {
        const int64_t on = p->parent[k];
        const double *d = operator_ + k * size, *c = operator_ + (n + k) * size, *parent = at->parent + 9 * k;
        double hat_force[9], hat_moment[9], local[3], slope[9];
        skew(total + 3 * k, hat_force);
        skew(about + 3 * k, hat_moment);
        if (on >= 0) {
            apply_rows(hat_force, spin + on * size, one, m);
            apply_back_rows(parent, one, other, m);
            add_transposed_product(d, other, out, 3, m, m);
        }
        apply_rows(hat_force, translation + k * size, one, m);
        for (int64_t j = 0; j < size; j++) one[j] += change[k * size + j];
        if (on >= 0) {
            apply_rows(hat_moment, spin + on * size, other, m);
            for (int64_t j = 0; j < size; j++) one[j] += other[j];
        }
        apply_back_rows(parent, one, other, m);
        apply_back_rows(at->jacobian + 9 * k, other, one, m);
        apply_back(parent, about + 3 * k, local);
        if (p->turns && k == 0) {
            apply_back(at->jacobian, about, local);
            skew(local, slope);
        } else {
            transposed_jacobian_derivative(at->local + 3 * (n + k), local, slope);
        }
        apply_rows(slope, c, other, m);
        for (int64_t j = 0; j < size; j++) one[j] += other[j];
        add_transposed_product(c, one, out, 3, m, m);
    }
    if (!p->curved) return;
    for (int64_t part = 0; part < p->parts; part++) {
        const int64_t r = p->extent[part];
        const double *basis = part_basis(p, part);
        memset(square, 0, (size_t)(r * r) * sizeof(double));
        for (int64_t i = 0; i < 6 * n; i++)
            if (p->part[i] == part) add_rows(rows + i, p->curvature + p->core_start[i], square, 1, r * r);
        if (!basis) {
            for (int64_t j = 0; j < m * m; j++) out[j] += square[j];
            continue;
        }
        /* Basisᵀ square basis, a row of the middle at a time. */
        for (int64_t i = 0; i < r; i++) {
            memset(one, 0, (size_t)m * sizeof(double));
            add_rows(square + i * r, basis, one, r, m);
            add_transposed_product(basis + i * m, one, out, 1, m, m);
        }
    }
}

void take_rates(const Body *body, Arena *arena, Rates *rates) {
    const Program *p = &body->p;
    rates->local = take(arena, 6 * p->nodes);
    rates->bent = take(arena, p->parts * p->modes);
    rates->turned = take(arena, body->bend_rows);
    rates->velocity = take(arena, 3 * p->nodes);
    rates->spin = take(arena, 3 * p->nodes);
}

void node_rates(const Body *body, const Need *need, const Configuration *at, const double *v, Rates *rates) {
    const Program *p = &body->p;
    const int64_t n = p->nodes;
    double *local = rates->local, *velocity = rates->velocity, *spin = rates->spin;
    memset(local, 0, (size_t)(6 * n) * sizeof(double));
    add_strided_rows(v, body->operator_t, 6 * n, local, p->modes, moving_rows(p));
    if (p->curved) {
        part_coordinates(p, v, rates->bent);
        for (int64_t part = 0; part < p->parts; part++) {
            const Bend *bend = body->bends + part;
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

/* The curvature's share in how b' and phi' change as the body moves on. */
void turn_rates(const Body *body, const Need *need, Rates *rates) {
    if (body->p.curved) turn_rows(body, need, rates->bent, rates->turned);
}

void node_accelerations(const Body *body, const Need *need, const Configuration *at, const Rates *rates, double *acceleration,
                        double *whirl) {
    const Program *p = &body->p;
    const int64_t n = p->nodes;
    double *second = acceleration + 3 * n; /* b'', phi'' */
    memset(second, 0, (size_t)(6 * n) * sizeof(double));
    for (int64_t part = 0; part < p->parts; part++) {
        const Bend *bend = body->bends + part;
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

int64_t pass_back_rate_size(const Body *body) { return 15 * body->p.nodes + body->p.parts * body->p.modes; }

void pass_back_rate(const Body *body, const Configuration *at, const Rates *rates, double *force, double *moment,
                    double *scratch, double *out) {
    const Program *p = &body->p;
    const int64_t n = p->nodes;
    double *rows = scratch, *change = rows + 6 * n, *about = change + 6 * n;
    memset(scratch, 0, (size_t)(15 * n) * sizeof(double));
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
    add_times_derivative(body, at, change, 1, scratch + 15 * n, out);
    add_times_bent(body, rates->turned, rows, 1, scratch + 15 * n, out);
}

/* Derivatives (count) of one row of b or phi by the first coordinates. */
void row_derivative(const Body *body, const Configuration *at, int64_t row, int64_t count, double *out) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    memcpy(out, p->operator_ + row * m, (size_t)count * sizeof(double));
    if (!p->curved || p->part[row] < 0) return;
    const double *basis = part_basis(p, p->part[row]), *turned = at->turned + body->turned_start[row];
    if (basis)
        add_strided_rows(turned, basis, m, out, p->extent[p->part[row]], count);
    else
        for (int64_t j = 0; j < count; j++) out[j] += turned[j];
}
