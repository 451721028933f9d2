/* Kinematics of the tree of frames, docs/theory.md sections 4 and 4a. */
#include "tree.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "opened.h"

static const double IDENTITY[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

/* Cost of placing a node, in multiplications. */
enum { NODE = 400 };

void take_configuration(const Body *body, Arena *arena, Configuration *at) {
    const Program *p = body->p;
    at->q = take(arena, p->modes);
    at->straight = take(arena, 6 * p->nodes);
    at->bent = take(arena, p->bending * p->modes);
    at->turned = take(arena, body->opened->bend_rows);
    at->local = take(arena, 6 * p->nodes);
    at->position = take(arena, 3 * p->nodes);
    at->rotation = take(arena, 9 * p->nodes);
    at->parent = take(arena, 9 * p->nodes);
    at->jacobian = take(arena, 9 * p->nodes);
}

void take_scratch(const Body *body, Arena *arena, int64_t work_size, Scratch *scratch) {
    const int64_t m = body->p->modes;
    scratch->end_q = take(arena, m);
    scratch->end_v = take(arena, m);
    scratch->four = take(arena, LANES * m);
    scratch->work = take(arena, work_size);
    scratch->work_size = work_size;
}

int64_t scratch_size(const Body *body, int64_t work_size) { return work_size + (2 + LANES) * body->p->modes; }

Scratch onto_stack(Body *body, double *room) {
    const Scratch own = body->scratch;
    const int64_t rest = ON_STACK - scratch_size(body, 0);
    Arena arena = {room, 0, ON_STACK, 0};
    if (body->step_size <= rest) take_scratch(body, &arena, own.work_size < rest ? own.work_size : rest, &body->scratch);
    return own;
}

Scratch elsewhere(Body *body, double *room) {
    const Scratch own = onto_stack(body, room);
    if (body->scratch.work != own.work) return own;
    const int64_t size = scratch_size(body, own.work_size);
    Arena arena = {borrow(body->opened), 0, size, 0};
    if (arena.start) take_scratch(body, &arena, own.work_size, &body->scratch);
    return own;
}

void put_back(Body *body, const Scratch *own) {
    if (body->scratch.end_q == body->opened->lent) give_back(body->opened);
    body->scratch = *own;
}

int64_t moving_rows(const Program *p) { return 6 * p->nodes - 3 * p->lumps; }

const double *part_basis(const Program *p, int64_t part) {
    const double *basis = p->basis;
    if (p->extent[part] == p->modes) return 0;
    for (int64_t i = 0; i < part; i++) basis += p->extent[i] < p->modes ? p->extent[i] * p->modes : 0;
    return basis;
}

void part_coordinates(const Program *p, const double *q, Slice *slice, double *x) {
    for (int64_t i = 0; i < p->bending; i++, x += p->modes) {
        const double *basis = part_basis(p, i);
        const Rows now = rows_due(slice, basis ? p->extent[i] : 1, (double)(2 * p->modes));
        if (basis)
            rows_times(basis + now.at * p->modes, q, x + now.at, now.end - now.at, p->modes);
        else if (now.at < now.end)
            memcpy(x, q, (size_t)p->modes * sizeof(double));
    }
}

int wanted(const Program *p, const Need *need, int64_t row) {
    const int64_t node = row / 3;
    return !need || (node < p->nodes ? need[node].offset : need[node - p->nodes].turn);
}

/* A number that comes from memory that is far away costs as much as four that do not; a group of few takes as long as its call. */
static double group_cost(int64_t r) { return 1.4 * (double)(LANES * r * r) / (double)packed_groups(r); }
static double packed_cost(int64_t r) { return 100.0 + group_cost(r); }
double added_cost(int64_t r) { return (r < 65 ? 0.65 + 0.03 * (double)r : 2.6) * group_cost(r); }

void four_rows(const Body *body, const double *packed, const double *x, double *rows, int64_t r) {
    const int64_t groups = packed_groups(r);
    const Rows now = body->slice ? rows_due(body->slice, groups, packed_cost(r)) : (Rows){0, groups};
    /* What goes on in another call waits in its place. */
    double *four = body->slice ? rows : body->scratch.four;
    if (now.at == now.end) return;
    packed_times(packed, x, four, r, now.at, now.end);
    if (now.end < groups) return;
    if (body->slice) memcpy(body->scratch.four, rows, (size_t)(LANES * r) * sizeof(double));
    unpack(body->scratch.four, rows, r);
}

void add_four(const Body *body, const double *factors, const double *packed, double *out, int64_t r, double cost) {
    const int64_t groups = packed_groups(r);
    const Rows now = rows_due(body->slice, groups, cost);
    if (now.at == now.end || all_zero(factors, LANES)) return;
    if (now.end - now.at == groups) add_packed(factors, packed, out, r, 0, groups);
    /* Of rows of a triangle a long and a short one in turn. */
    for (int64_t i = now.at; i < now.end && now.end - now.at < groups; i++) {
        const int64_t group = i % 2 == 0 ? i / 2 : groups - 1 - i / 2;
        add_packed(factors, packed, out, r, group, group + 1);
    }
}

void turn_rows(const Body *body, const Need *need, const double *bent, double *to) {
    const Program *p = body->p;
    for (int64_t part = 0; part < p->bending && !over(body->slice); part++) {
        const Bend *bend = body->opened->bends + part;
        const int64_t r = p->extent[part], size = packed_size(r);
        const double *curvature = bend->curvature;
        const int64_t groups = packed_groups(r);
        if (!need && passed(body->slice, groups * ((bend->count + LANES - 1) / LANES))) continue;
        const double cost = body->slice ? packed_cost(r) : 0.0;
        for (int64_t first = 0; first < bend->count && !over(body->slice); first += LANES, curvature += size) {
            int any = !need;
            if (!need && dealt_with(body->slice, groups, cost)) continue;
            for (int64_t k = first; !any && k < first + LANES && k < bend->count; k++) any |= wanted(p, need, bend->row[k]);
            if (any) four_rows(body, curvature, bent + part * p->modes, to + bend->start + first * r, r);
        }
    }
}

/* b and phi from their linear part and the curvature's share in their derivatives. */
static void bend_rows(const Body *body, const Need *need, Configuration *at) {
    const Program *p = body->p;
    if (due(body->slice, (double)(6 * p->nodes))) memcpy(at->local, at->straight, (size_t)(6 * p->nodes) * sizeof(double));
    for (int64_t part = 0; part < p->bending; part++) {
        const Bend *bend = body->opened->bends + part;
        const int64_t r = p->extent[part];
        const Rows now = rows_due(body->slice, bend->count, 1.5 * (double)r);
        for (int64_t k = now.at; k < now.end; k++)
            if (wanted(p, need, bend->row[k]))
                at->local[bend->row[k]] += 0.5 * dot(at->turned + bend->start + k * r, at->bent + part * p->modes, r);
    }
}

/* The pass outwards, (4) and (6). What is not needed stays where it was undeformed. */
static void place(const Body *body, const Need *need, Configuration *at) {
    const Program *p = body->p;
    const Rows now = rows_due(body->slice, p->nodes, 2.0 * NODE);
    for (int64_t k = now.at; k < now.end; k++) {
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

void configure_linear(const Body *body, const Need *need, const double *q, Configuration *at) {
    const Program *p = body->p;
    const int64_t size = 6 * p->nodes, fours = (p->modes + 3) / 4;
    const Rows now = rows_due(body->slice, fours, (double)(12 * size));
    const int64_t first = 4 * now.at, count = now.end == fours ? p->modes - first : 4 * now.end - first;
    if (now.at == 0 && count > 0) {
        if (at->q != q) memcpy(at->q, q, (size_t)p->modes * sizeof(double));
        memset(at->straight, 0, (size_t)size * sizeof(double));
    }
    if (now.at < now.end) add_strided_rows(q + first, body->opened->columns + first * size, size, at->straight, count, moving_rows(p));
    if (!p->curved) return;
    part_coordinates(p, q, body->slice, at->bent);
    turn_rows(body, need, at->bent, at->turned);
}

void configure_places(const Body *body, const Need *need, Configuration *at) {
    bend_rows(body, need, at);
    if (!over(body->slice)) place(body, need, at);
}

void configure(const Body *body, const double *q, Configuration *at) {
    configure_linear(body, 0, q, at);
    configure_places(body, 0, at);
}

double configuration_cost(const Body *body) {
    const Program *p = body->p;
    return (double)((6 * p->nodes + body->opened->bend_rows) * p->modes + NODE * p->nodes);
}

static void mean_of(const double *a, const double *b, double *out, int64_t n) {
    for (int64_t i = 0; i < n; i++) out[i] = 0.5 * (a[i] + b[i]);
}

void configure_halfway(const Body *body, const Need *need, const Configuration *a, const Configuration *b, Configuration *at) {
    const Program *p = body->p;
    mean_of(a->q, b->q, at->q, p->modes);
    mean_of(a->straight, b->straight, at->straight, 6 * p->nodes);
    if (p->curved) {
        mean_of(a->bent, b->bent, at->bent, p->bending * p->modes);
        mean_of(a->turned, b->turned, at->turned, body->opened->bend_rows);
    }
    configure_places(body, need, at);
}

static int64_t configuration_size(const Body *body) {
    Arena count = {0};
    Configuration at;
    take_configuration(body, &count, &at);
    return count.used;
}

/* Their numbers lie in one run, from q on. */
static void copy_configuration(const Body *body, const Configuration *from, Configuration *to) {
    memcpy(to->q, from->q, (size_t)configuration_size(body) * sizeof(double));
}

static int same(const double *a, const double *b, int64_t n) { return memcmp(a, b, (size_t)n * sizeof(double)) == 0; }

void find_need(Body *body, const double *inputs, const double *inputs_end) {
    const Program *p = body->p;
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

void remember(Body *body, const Need *need, const Configuration *at) {
    copy_configuration(body, at, &body->memo);
    memcpy(body->memo_need, need, (size_t)body->p->nodes * sizeof *need);
    body->memo_known = 1;
}

int recall(const Body *body, const Need *need, const double *q, Configuration *at) {
    if (!body->memo_known || !same(q, body->memo.q, body->p->modes)) return 0;
    for (int64_t k = 0; k < body->p->nodes; k++)
        if (need[k].offset > body->memo_need[k].offset || need[k].turn > body->memo_need[k].turn) return 0;
    copy_configuration(body, &body->memo, at);
    return 1;
}

const Configuration *whole_configuration(Body *body, const double *q) {
    const int64_t n = body->p->nodes;
    if (!body->memo_known || !same(q, body->memo.q, body->p->modes)) {
        configure(body, q, &body->memo);
    } else {
        int missing = 0;
        for (int64_t k = 0; k < n; k++) {
            body->need[k].offset = !body->memo_need[k].offset;
            body->need[k].turn = !body->memo_need[k].turn;
            missing |= body->need[k].offset | body->need[k].turn;
        }
        if (!missing) return &body->memo;
        if (body->p->curved) turn_rows(body, body->need, body->memo.bent, body->memo.turned);
        configure_places(body, 0, &body->memo);
    }
    memset(body->memo_need, 1, (size_t)n * sizeof *body->memo_need);
    body->memo_known = 1;
    return &body->memo;
}

void places_in(const Program *p, const Configuration *at, double *out) {
    for (int64_t i = 0; i < p->interfaces; i++) {
        memcpy(out + 12 * i, at->position + 3 * (p->frames + i), 3 * sizeof(double));
        memcpy(out + 12 * i + 3, at->rotation + 9 * (p->frames + i), 9 * sizeof(double));
    }
}

double apart(const double *a, const double *b, int64_t interfaces, double *out) {
    double largest = 0.0;
    for (int64_t i = 0; i < interfaces; i++, a += 12, b += 12) {
        double between[3], back[9], turn[9], angle[3];
        for (int c = 0; c < 3; c++) between[c] = a[c] - b[c];
        for (int c = 0; c < 9; c++) back[c] = b[3 + 3 * (c % 3) + c / 3];
        multiply(a + 3, back, turn);
        rotation_vector(turn, angle);
        out[2 * i] = norm(between, 3);
        out[2 * i + 1] = norm(angle, 3);
        largest = fmax(largest, out[2 * i]);
    }
    return largest;
}
