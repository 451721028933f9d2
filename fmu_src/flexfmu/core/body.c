#include "body.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "algebra.h"
#include "opened.h"
#include "propagation.h"
#include "tree.h"

static const char NO_MEMORY[] = "there is not enough memory";

/* What each call takes of the workspace: first, those of a step and of what follows its motion. */
enum { OF_STEPS = 4 };
static void (*const demands[])(const Body *body, Arena *arena) = {
    step_demand, internal_demand, seen_demand, inertia_demand, statics_demand, motion_demand, pushes_demand,
    stability_demand, judgement_demand, compliance_demand, certificate_demand, surface_demand,
};

/* Numbers of a body, those that any step needs first: of many bodies in turn few pages are touched. Then what calls overwrite;
 * the sum of all where `arena` counts only. */
static void lay_out(Body *body, Arena *arena) {
    const int64_t m = body->p->modes, nodes = body->p->nodes;
    int64_t size = 0;
    take_deformed(body, arena, &body->deformed);
    body->need = (Need *)take(arena, (2 * nodes * (int64_t)sizeof *body->need + 7) / 8);
    take_configuration(body, arena, &body->memo);
    body->zeta = take(arena, m);
    body->rate = take(arena, m);
    take_rules(body, arena);
    body->coupled = take(arena, crossed(body->p) * m * m);
    body->square = take(arena, crossed(body->p) * m * m);
    body->pivot = (int64_t *)take(arena, 2 * m + body->p->pulls);
    for (size_t i = 0; i < sizeof demands / sizeof *demands; i++) {
        Arena count = {0};
        demands[i](body, &count);
        size = larger(size, count.used);
        if (i < OF_STEPS) body->step_size = size;
    }
    take_scratch(body, arena, size, &body->scratch);
}

/* Which rows each part bends. */
static void gather_bends(Opened *opened) {
    const Program *p = &opened->p;
    int64_t *row = opened->bent_row;
    const double *curvature = p->curvature;
    for (int64_t part = 0; part < p->bending; part++) {
        Bend *bend = opened->bends + part;
        bend->row = row;
        bend->curvature = curvature;
        bend->start = opened->bend_rows;
        for (int64_t i = 0; p->curved && i < 6 * p->nodes; i++)
            if (p->part[i] == part) {
                opened->turned_start[i] = bend->start + (row - bend->row) * p->extent[part];
                *row++ = i;
            }
        bend->count = row - bend->row;
        curvature += packed_total(bend->count, p->extent[part]);
        opened->bend_rows += (bend->count + LANES - 1) / LANES * LANES * p->extent[part];
    }
}

/* Columns of the operator, a few of which share lines of memory: these go together. */
static void gather_columns(Opened *opened) {
    const Program *p = &opened->p;
    const int64_t m = p->modes, rows = 6 * p->nodes;
    enum { TOGETHER = 8 };
    for (int64_t first = 0; first < m; first += TOGETHER)
        for (int64_t i = 0; i < rows; i++)
            for (int64_t j = first; j < m && j < first + TOGETHER; j++) opened->columns[j * rows + i] = p->operator_[i * m + j];
}

/* What follows from a program once; 0 without memory. */
static int complete(Opened *opened) {
    const Program *p = &opened->p;
    const int64_t nodes = p->nodes, m = p->modes;
    opened->stiffness = calloc((size_t)(m + (p->loads + 2) / 3), sizeof(double));
    opened->columns = calloc((size_t)(6 * nodes * m), sizeof(double));
    opened->rule_numbers = calloc((size_t)(RULES * RULE_ROWS * m), sizeof(double));
    opened->bends = calloc((size_t)p->bending + 1, sizeof *opened->bends);
    opened->bent_row = calloc((size_t)(6 * nodes), sizeof *opened->bent_row);
    opened->turned_start = calloc((size_t)(6 * nodes), sizeof *opened->turned_start);
    opened->lumped = calloc((size_t)nodes, sizeof *opened->lumped);
    opened->alike = calloc((size_t)p->variables + 1, sizeof *opened->alike);
    if (!opened->stiffness || !opened->columns || !opened->rule_numbers || !opened->bends || !opened->bent_row || !opened->turned_start ||
        !opened->lumped || !opened->alike)
        return 0;
    gather_columns(opened);
    for (int64_t i = p->variables - 1; i >= 0; i--) {
        const int64_t next = i + 1;
        const int goes_on = next < p->variables && p->variable_role[next] == p->variable_role[i] &&
                            p->variable_type[next] == p->variable_type[i] && (uint64_t)p->variable_index[next] == (uint64_t)p->variable_index[i] + 1;
        opened->alike[i] = goes_on ? 1 + opened->alike[next] : 1;
    }
    opened->softens = opened->stiffness + m;
    memset(opened->lumped, 1, (size_t)p->frames * sizeof *opened->lumped);
    for (int64_t i = 0; i < p->lumps; i++) opened->lumped[p->frames + p->interfaces + p->masses + i].offset = 1;
    gather_bends(opened);
    const Body one = {.p = p};
    Arena arena = {opened->rule_numbers, 0, RULES * RULE_ROWS * m, 0};
    for (int i = 0; i < RULES; i++) take_rule(&one, &arena, opened->rules + i);
    for (int64_t j = 0; j < m; j++) opened->stiffness[j] = p->omega[j] * p->omega[j];
    for (int64_t i = 0; i < p->stretches * m; i++) opened->keeps_shapes |= p->stretch_linear[i] != 0.0;
    find_reach(opened);
    return 1;
}

/* A body of what is open; null, which is one user less, with words in `why` without memory. */
static Body *body_of(Opened *opened, const char **why) {
    Body counted = {.p = &opened->p, .opened = opened};
    Arena arena = {0};
    lay_out(&counted, &arena);
    Body *body = calloc(1, sizeof *body + (size_t)arena.used * sizeof(double));
    *why = NO_MEMORY;
    if (!body || !make_lent(opened, scratch_size(&counted, counted.scratch.work_size))) {
        free(body);
        leave_opened(opened);
        return 0;
    }
    *body = counted;
    body->arena_size = arena.used;
    arena = (Arena){(double *)(body + 1), 0, body->arena_size, 0};
    lay_out(body, &arena);
    body->memo_need = body->need + body->p->nodes;
    const StepLimits usual = {0.0, 1e-3, 4096.0};
    body_options(body, 1.0, &usual);
    *why = 0;
    return body;
}

/* A body of the image of `made`, which may take arrays from `base`; null, which frees it, with words in `why` where it cannot be. */
static Body *body_made(Opened *made, Opened *base, const char **why) {
    *why = open_program(made->image, base ? base->image : (Image){0, 0}, &made->p);
    if (!*why && !complete(made)) *why = NO_MEMORY;
    if (*why) {
        leave_opened(made);
        return 0;
    }
    if (program_base(made->image.bytes)) made->base = base;
    share_opened(made);
    return body_of(made, why);
}

Body *body_open(const void *image, int64_t size, const char **why) {
    Opened *made = calloc(1, sizeof *made);
    *why = NO_MEMORY;
    if (made && size > 0) made->copy = malloc((size_t)size + IMAGE_ALIGNMENT);
    if (!made || !made->copy) {
        leave_opened(made);
        return 0;
    }
    char *to = made->copy;
    while ((uintptr_t)to % IMAGE_ALIGNMENT) to++;
    made->image = (Image){memcpy(to, image, (size_t)size), size};
    return body_made(made, 0, why);
}

Body *body_open_file(const char *folder, const char *name, const Body *base, const char **why) {
    Opened *made = calloc(1, sizeof *made), *of = base ? base->opened : 0;
    *why = NO_MEMORY;
    if (!made) return 0;
    made->image.bytes = map_file(folder, name, &made->image.size, &made->mark);
    Opened *found = made->image.bytes ? find_opened(&made->mark, of) : 0;
    if (made->image.bytes && !found) return body_made(made, of, why);
    leave_opened(made);
    *why = 0;
    return found ? body_of(found, why) : 0;
}

uint64_t body_mark(const Body *body) { return program_mark(body->opened->image.bytes); }

int64_t body_bytes(const Body *body) { return body->opened->image.size + 8 * body->arena_size; }

void body_close(Body *body) {
    if (!body) return;
    leave_opened(body->opened);
    free(body);
}

int body_options(Body *body, double damping_scale, const StepLimits *limits) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    if (!(isfinite(damping_scale) && damping_scale >= 0.0 && isfinite(limits->longest) && limits->longest >= 0.0 &&
          isfinite(limits->tolerance) && limits->tolerance > 0.0 && isfinite(limits->most) && limits->most >= 1.0))
        return FLEX_BAD_OPTION;
    body->damping_scale = damping_scale;
    body->limits = *limits;
    body->rule_count = body->rule_next = 0;
    for (int64_t j = 0; j < m; j++) {
        body->zeta[j] = damping_scale * p->zeta[j];
        body->rate[j] = 2.0 * body->zeta[j] * p->omega[j];
    }
    if (crossed(p)) memset(body->coupled, 0, (size_t)(m * m) * sizeof(double));
    for (int64_t i = 0; i < p->dampers * m; i++) {
        const double *row = p->damper + i / m * m, factor = damping_scale * p->damper[i];
        add_rows(&factor, row, body->coupled + i % m * m, 1, m);
    }
    if (!p->tied) return FLEX_OK;
    /* A mode is damped by way of the forces in its material. Those of the springs between the sections are left out: turned
     * frames stretch the modes' linear springs without any cause. */
    double *share = body->square, *weighed = body->coupled;
    for (int64_t i = 0; i < m; i++)
        for (int64_t k = 0; k < m; k++) share[k * m + i] = (i == k ? 1.0 : 0.0) - p->tie_welded[i * m + k] / body->opened->stiffness[k];
    for (int64_t k = 0; k < m; k++)
        for (int64_t i = 0; i < m; i++) {
            const double factor = share[k * m + i] * 2.0 * body->zeta[k] * p->omega[k];
            add_rows(&factor, share + k * m, weighed + i * m, 1, m);
        }
    for (int64_t j = 0; j < m; j++) {
        body->rate[j] = weighed[j * m + j];
        weighed[j * m + j] = 0.0;
    }
    return FLEX_OK;
}
