#include "body.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "algebra.h"
#include "files.h"
#include "propagation.h"
#include "tree.h"

static const char NO_MEMORY[] = "there is not enough memory";

/* What each call takes of the workspace: first, those of a step. */
enum { OF_STEPS = 2 };
static void (*const demands[])(const Body *body, Arena *arena) = {
    step_demand, internal_demand, statics_demand, motion_demand, pushes_demand,
    stability_demand, judgement_demand, inertia_demand, compliance_demand, certificate_demand, surface_demand,
};

/* Constant numbers of a body, then its workspace; the sum of all where `arena` counts only. */
static void lay_out(Body *body, Arena *arena) {
    const int64_t m = body->p.modes;
    body->stiffness = take(arena, m);
    body->zeta = take(arena, m);
    body->rate = take(arena, m);
    body->coupled = take(arena, crossed(&body->p) * m * m);
    body->square = take(arena, crossed(&body->p) * m * m);
    body->four = take(arena, LANES * m);
    take_configuration(body, arena, &body->memo);
    take_rules(body, arena);
    take_deformed(body, arena, &body->deformed);
    body->softens = take(arena, (body->p.loads + 2) / 3);
    body->end_q = take(arena, m);
    body->end_v = take(arena, m);
    body->work_size = 0;
    for (size_t i = 0; i < sizeof demands / sizeof *demands; i++) {
        Arena count = {0};
        demands[i](body, &count);
        body->work_size = larger(body->work_size, count.used);
        if (i < OF_STEPS) body->step_size = body->work_size;
    }
    body->work = take(arena, body->work_size);
}

/* Which rows each part bends. */
static void gather_bends(Body *body) {
    const Program *p = &body->p;
    int64_t *row = body->bent_row;
    const double *curvature = p->curvature;
    for (int64_t part = 0; part < p->parts; part++) {
        Bend *bend = body->bends + part;
        bend->row = row;
        bend->curvature = curvature;
        bend->start = body->bend_rows;
        for (int64_t i = 0; p->curved && i < 6 * p->nodes; i++)
            if (p->part[i] == part) {
                body->turned_start[i] = bend->start + (row - bend->row) * p->extent[part];
                *row++ = i;
            }
        bend->count = row - bend->row;
        curvature += packed_total(bend->count, p->extent[part]);
        body->bend_rows += (bend->count + LANES - 1) / LANES * LANES * p->extent[part];
    }
}

/* Give the body its arrays, and what follows from its program once; 0 without memory. */
static int furnish(Body *body) {
    Arena arena = {0};
    const int64_t nodes = body->p.nodes;
    body->bends = calloc((size_t)body->p.parts + 1, sizeof *body->bends);
    body->bent_row = calloc((size_t)(6 * nodes), sizeof *body->bent_row);
    body->turned_start = calloc((size_t)(6 * nodes), sizeof *body->turned_start);
    body->need = calloc((size_t)(3 * nodes), sizeof *body->need);
    if (!body->bends || !body->bent_row || !body->turned_start || !body->need) return 0;
    body->memo_need = body->need + nodes;
    body->lumped = body->memo_need + nodes;
    memset(body->lumped, 1, (size_t)body->p.frames * sizeof *body->lumped);
    for (int64_t i = 0; i < body->p.lumps; i++)
        body->lumped[body->p.frames + body->p.interfaces + body->p.masses + i].offset = 1;
    gather_bends(body);
    lay_out(body, &arena);
    body->arena = calloc((size_t)arena.used, sizeof(double));
    body->pivot = calloc((size_t)(2 * body->p.modes + body->p.pulls), sizeof(int64_t));
    if (!body->arena || !body->pivot) return 0;
    body->arena_size = arena.used;
    arena = (Arena){body->arena, 0, body->arena_size, 0};
    lay_out(body, &arena);
    const Program *p = &body->p;
    for (int64_t j = 0; j < p->modes; j++) body->stiffness[j] = p->omega[j] * p->omega[j];
    find_reach(body);
    const StepLimits usual = {0.0, 1e-3, 4096.0};
    body_options(body, 1.0, &usual);
    return 1;
}

/* The body with the program that its image is; closed, with words in `why`, where it cannot be. */
static Body *opened(Body *body, Image base, const char **why) {
    *why = open_program((Image){body->image, body->image_size}, base, &body->p);
    if (!*why && furnish(body)) return body;
    if (!*why) *why = NO_MEMORY;
    body_close(body);
    return 0;
}

Body *body_open(const void *image, int64_t size, const char **why) {
    *why = NO_MEMORY;
    Body *body = calloc(1, sizeof *body);
    if (!body) return 0;
    body->copy = size > 0 ? malloc((size_t)size + IMAGE_ALIGNMENT) : 0;
    if (!body->copy) {
        body_close(body);
        return 0;
    }
    char *to = body->copy;
    while ((uintptr_t)to % IMAGE_ALIGNMENT) to++;
    body->image = memcpy(to, image, (size_t)size);
    body->image_size = size;
    return opened(body, (Image){0, 0}, why);
}

Body *body_open_file(const char *folder, const char *name, const Body *base, const char **why) {
    *why = NO_MEMORY;
    Body *body = calloc(1, sizeof *body);
    if (!body) return 0;
    body->image = map_file(folder, name, &body->image_size);
    if (body->image) return opened(body, base ? (Image){base->image, base->image_size} : (Image){0, 0}, why);
    *why = 0;
    body_close(body);
    return 0;
}

uint64_t body_mark(const Body *body) { return program_mark(body->image); }

int64_t body_bytes(const Body *body) {
    return body->image_size + 8 * body->arena_size;
}

void body_close(Body *body) {
    if (!body) return;
    free(body->arena);
    free(body->bends);
    free(body->bent_row);
    free(body->turned_start);
    free(body->need);
    free(body->pivot);
    if (body->image && !body->copy) unmap_file(body->image, body->image_size);
    free(body->copy);
    free(body);
}

int body_options(Body *body, double damping_scale, const StepLimits *limits) {
    const Program *p = &body->p;
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
        for (int64_t k = 0; k < m; k++) share[k * m + i] = (i == k ? 1.0 : 0.0) - p->tie_welded[i * m + k] / body->stiffness[k];
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
