/* A point is carried as any node of the tree is (docs/theory.md, sections 4, 4a and 4b): its offset in its frame is that of (6),
 * with the second-order part (19) where the method has one. */
#include "surface.h"

#include <string.h>

#include "algebra.h"
#include "membrane.h"
#include "tree.h"

typedef struct {
    int64_t kind, points, forms, pieces, floats;
    const int64_t *frame, *piece;
    const double *point, *mode, *second, *form, *turn, *pivot, *joint, *bend;
} Surface;

/* What all points have in common at one q. */
typedef struct {
    Stretch stretch;
    double *taken;        /* (m): part of w that coordinates hold already (section 4c) */
    double *moved;        /* (S, 6): of each frame its joint's displacement and its rotation, linear in q */
    double *bent;         /* (S, 6): the same at second order */
    double *slope;        /* (m) */
} Shared;

static void take_shared(const Body *body, Arena *arena, Shared *room) {
    take_stretch(body, arena, &room->stretch);
    room->taken = take(arena, body->p->modes);
    room->moved = take(arena, 6 * body->p->frames);
    room->bent = take(arena, 6 * body->p->frames);
    room->slope = take(arena, body->p->modes);
}

void surface_demand(const Body *body, Arena *arena) {
    Shared room;
    take_shared(body, arena, &room);
}

static Surface surface_of(const Body *body, const int64_t *sizes, const int64_t *on, const double *numbers) {
    const int64_t m = body->p->modes, n = sizes[1], r = sizes[2], g = sizes[3];
    Surface s = {sizes[0], n, r, g, sizes[4], on, on + n, numbers, 0, 0, 0, 0, 0, 0, 0};
    s.mode = s.point + 3 * n;
    s.second = s.mode + 3 * n * m;
    s.form = s.second + 3 * n * r;
    s.turn = s.form + r * m * m;
    s.pivot = s.turn + 3 * g * m;
    s.joint = s.pivot + 3 * g;
    s.bend = s.joint + 6 * body->p->frames * m;
    return s;
}

/* q A q / 2. */
static double half_form(const double *a, const double *q, double *slope, int64_t m) {
    rows_times(a, q, slope, m, m);
    return 0.5 * dot(slope, q, m);
}

static void share(const Body *body, const Surface *s, const double *q, Shared *to) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    rows_times(s->joint, q, to->moved, 6 * p->frames, m);
    memset(to->taken, 0, (size_t)m * sizeof(double));
    if (s->kind != POINTS_SECOND_ORDER) return;
    stretch_at(body, q, &to->stretch);
    for (int64_t r = 0; r < p->stretches; r++)
        for (int64_t j = p->rigid; j < m; j++)
            to->taken[j] += 2.0 * to->stretch.bent[r] * p->stretch_linear[r * m + j] / body->opened->stiffness[j];
    rows_times(s->joint, to->taken, to->bent, 6 * p->frames, m);
    for (int64_t i = 0; i < 6 * p->frames; i++) to->bent[i] += half_form(s->bend + i * m * m, q, to->slope, m);
}

/* out += turn x (change + turn x arm / 2). */
static void add_turned(const double *turn, const double *change, const double *arm, double sign, double *out) {
    double way[3];
    cross(turn, arm, way);
    for (int c = 0; c < 3; c++) way[c] = change[c] + 0.5 * way[c];
    cross(turn, way, way);
    for (int c = 0; c < 3; c++) out[c] += sign * way[c];
}

/* w / 2 of a point, seen as the tree's nodes are: from the ground, or from the floating frame. */
static void from_ground(const Surface *s, int64_t i, const double *value, const Shared *at, const double *q, int64_t m, double *out) {
    rows_times(s->mode + 3 * i * m, at->taken, out, 3, m);
    for (int64_t r = 0; r < s->forms; r++)
        for (int c = 0; c < 3; c++) out[c] += s->second[(3 * i + c) * s->forms + r] * value[r];
    if (!s->pieces) return;
    const int64_t g = s->piece[i];
    double turn[3], change[3], arm[3];
    rows_times(s->turn + 3 * g * m, q, turn, 3, m);
    rows_times(s->mode + 3 * i * m, q, change, 3, m);
    for (int c = 0; c < 3; c++) arm[c] = s->point[3 * i + c] - s->pivot[3 * g + c];
    double own[3];
    cross(turn, arm, own);
    for (int c = 0; c < 3; c++) change[c] -= own[c];
    add_turned(turn, change, arm, 1.0, out);
}

/* Of a point on frame f with the displacement u: place, from its arm and its second-order part. */
static void carry(const Program *p, const Surface *s, const Shared *at, const Configuration *tree, int64_t f, const double *point,
                  const double *u, const double *second, double *out) {
    const double *moved = at->moved + 6 * f, *bent = at->bent + 6 * f, *joint = p->point + 3 * f;
    double arm[3], change[3], turned[3], local[3];
    for (int c = 0; c < 3; c++) {
        arm[c] = point[c] - joint[c];
        change[c] = u[c] - moved[c];
    }
    if (s->kind == POINTS_LITERAL || s->kind == POINTS_SECANT) {
        /* Only displacements turn. */
        apply(tree->rotation + 9 * f, change, local);
        for (int c = 0; c < 3; c++) out[c] = point[c] + tree->position[3 * f + c] - joint[c] + local[c];
        return;
    }
    cross(moved + 3, arm, turned);
    for (int c = 0; c < 3; c++) {
        change[c] -= turned[c];
        local[c] = arm[c] + change[c];
    }
    if (s->kind == POINTS_SECOND_ORDER) {
        double turn[3];
        cross(bent + 3, arm, turned);
        for (int c = 0; c < 3; c++) {
            local[c] += second[c] - bent[c] - turned[c];
            turn[c] = moved[3 + c] - (s->floats ? at->moved[3 + c] : 0.0);
        }
        add_turned(turn, change, arm, -1.0, local);
    }
    apply(tree->rotation + 9 * f, local, out);
    for (int c = 0; c < 3; c++) out[c] += tree->position[3 * f + c];
}

int body_surface(Body *body, const int64_t *sizes, const int64_t *on, const double *numbers, const double *q, double *value,
                 double *places) {
    const Program *p = body->p;
    const Surface s = surface_of(body, sizes, on, numbers);
    const int64_t m = p->modes;
    const int tree = s.kind != POINTS_LINEAR && p->frames;
    Arena arena = work_arena(body);
    Shared at;
    take_shared(body, &arena, &at);
    if (arena.refused) return FLEX_NO_ROOM;
    const Configuration *where = tree ? whole_configuration(body, q) : 0;
    if (tree) share(body, &s, q, &at);
    for (int64_t r = 0; tree && r < s.forms; r++) value[r] = half_form(s.form + r * m * m, q, at.slope, m);
    for (int64_t i = 0; i < s.points; i++) {
        const double *point = s.point + 3 * i;
        double u[3], second[3] = {0.0, 0.0, 0.0};
        rows_times(s.mode + 3 * i * m, q, u, 3, m);
        if (tree && s.kind == POINTS_SECOND_ORDER && s.forms) from_ground(&s, i, value, &at, q, m, second);
        if (tree && s.frame[i] >= 0)
            carry(p, &s, &at, where, s.frame[i], point, u, second, places + 3 * i);
        else
            for (int c = 0; c < 3; c++) places[3 * i + c] = point[c] + u[c] + second[c];
    }
    return FLEX_OK;
}
