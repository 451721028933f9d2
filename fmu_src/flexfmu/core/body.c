/* A body: what is made of a program once, the driver of steps, equilibrium, motion. */
#include "body.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "internal.h"
#include "vectors.h"

/* Rounds of the iteration in an internal step of ordinary cost. */
static const double ORDINARY_ROUNDS = 5.0;
/* Angle by which the slowest mode of a body with ties turns in an internal step at the most, rad: a step that resolves no
 * mode at all has no estimate of its error. */
static const double RESOLVED = 1.5;
/* Numbers of steps above this are all alike. */
static const double UNCOUNTED = 1e15;
/* Steps (s) up to this would vanish when divided; nothing moves in them by more than round-off. */
static const double INDIVISIBLE = 1e-300;
/* Square of coordinates and rates beyond which arithmetic overflows: far beyond anything that a body bears. */
static const double LARGEST_SQUARE = 1e200;
/* Internal steps from which on it is looked at whether more of them can help, and rotation within a frame, rad, of the
 * linear body at the step's end from which on they cannot. */
enum { SUSPECT = 32 };
static const double SENSELESS = 4.0 * 3.141592653589793;

double *take(Arena *arena, int64_t count) {
    double *at = arena->start ? arena->start + arena->used : 0;
    arena->used += count;
    return at;
}

Arena work_arena(Body *body) {
    const Arena arena = {body->work, 0};
    return arena;
}

/* Constant numbers of a body, then its workspace; the sum of all where `arena` counts only. */
static void lay_out(Body *body, Arena *arena) {
    const int64_t m = body->p.modes;
    body->stiffness = take(arena, m);
    body->zeta = take(arena, m);
    body->operator_t = take(arena, 6 * body->p.nodes * m);
    body->rate = take(arena, m);
    body->coupled = take(arena, body->p.tied * m * m);
    int64_t packed = LANES;
    for (int64_t i = 0; i < body->p.parts; i++) packed += (body->bends[i].count + LANES - 1) / LANES * packed_size(body->p.extent[i]);
    body->curvature_t = take(arena, packed);
    body->four = take(arena, LANES * m);
    take_configuration(body, arena, &body->memo);
    take_rules(body, arena);
    int64_t most = m * m;
    const int64_t sizes[] = {plain_size(body), body->p.tied ? tied_size(body) : 0, body->p.inertial ? inertial_size(body) : 0,
                             body->p.turns ? free_size(body) : 0,
                             statics_size(body), watch_size(body)};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        if (sizes[i] > most) most = sizes[i];
    body->work_size = most + 2 * m;
    body->work = take(arena, body->work_size);
}

/* Which rows each part bends. */
static void gather_bends(Body *body) {
    const Program *p = &body->p;
    int64_t *row = body->bent_row;
    for (int64_t part = 0; part < p->parts; part++) {
        Bend *bend = body->bends + part;
        bend->row = row;
        bend->start = body->bend_rows;
        for (int64_t i = 0; p->curved && i < 6 * p->nodes; i++)
            if (p->part[i] == part) {
                body->turned_start[i] = bend->start + (row - bend->row) * p->extent[part];
                *row++ = i;
            }
        bend->count = row - bend->row;
        body->bend_rows += (bend->count + LANES - 1) / LANES * LANES * p->extent[part];
    }
}

/* Their curvature, rows by the LANES. */
static void pack_bends(Body *body) {
    const Program *p = &body->p;
    double *to = body->curvature_t;
    /* Vectors that lie across two lines of the cache take twice as long. */
    while ((uintptr_t)to % (LANES * sizeof(double))) to++;
    for (int64_t part = 0; part < p->parts; part++) {
        Bend *bend = body->bends + part;
        bend->curvature = to;
        for (int64_t first = 0; first < bend->count; first += LANES, to += packed_size(p->extent[part])) {
            const double *rows[LANES] = {0};
            for (int lane = 0; lane < LANES && first + lane < bend->count; lane++)
                rows[lane] = p->curvature + p->core_start[bend->row[first + lane]];
            pack_symmetric(rows, to, p->extent[part]);
        }
    }
}

Body *body_open(const void *image, int64_t size, const char **why) {
    *why = "there is not enough memory";
    Body *body = calloc(1, sizeof *body);
    if (!body) return 0;
    body->image = size > 0 ? malloc((size_t)size) : 0;
    if (!body->image) {
        body_close(body);
        return 0;
    }
    memcpy(body->image, image, (size_t)size);
    body->image_size = size;
    const char *wrong = open_program(body->image, size, &body->p);
    if (wrong) {
        *why = wrong;
        body_close(body);
        return 0;
    }
    Arena arena = {0, 0};
    const int64_t nodes = body->p.nodes;
    body->bends = calloc((size_t)body->p.parts + 1, sizeof *body->bends);
    body->bent_row = calloc((size_t)(6 * nodes), sizeof *body->bent_row);
    body->turned_start = calloc((size_t)(6 * nodes), sizeof *body->turned_start);
    body->need = calloc((size_t)(3 * nodes), sizeof *body->need);
    if (!body->bends || !body->bent_row || !body->turned_start || !body->need) {
        body_close(body);
        return 0;
    }
    body->memo_need = body->need + nodes;
    body->lumped = body->memo_need + nodes;
    memset(body->lumped, 1, (size_t)body->p.frames * sizeof *body->lumped);
    for (int64_t i = 0; i < body->p.lumps; i++)
        body->lumped[body->p.frames + body->p.interfaces + body->p.masses + i].offset = 1;
    gather_bends(body);
    lay_out(body, &arena);
    body->arena = calloc((size_t)arena.used, sizeof(double));
    body->pivot = calloc((size_t)(2 * body->p.modes + body->p.pulls), sizeof(int64_t));
    if (!body->arena || !body->pivot) {
        body_close(body);
        return 0;
    }
    body->arena_size = arena.used;
    arena.start = body->arena;
    arena.used = 0;
    lay_out(body, &arena);
    const Program *p = &body->p;
    for (int64_t j = 0; j < p->modes; j++) body->stiffness[j] = p->omega[j] * p->omega[j];
    for (int64_t i = 0; i < 6 * p->nodes; i++)
        for (int64_t j = 0; j < p->modes; j++) body->operator_t[j * 6 * p->nodes + i] = p->operator_[i * p->modes + j];
    pack_bends(body);
    const StepLimits usual = {0.0, 1e-4, 4096.0};
    body_options(body, 1.0, &usual);
    *why = "";
    return body;
}

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
    free(body->image);
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
    if (!p->tied) return FLEX_OK;
    /* A mode is damped by way of the forces in its material. Those of the springs between the sections are left out: turned
     * frames stretch the modes' linear springs without any cause. */
    double *share = body->work, *weighed = body->coupled;
    for (int64_t i = 0; i < m; i++)
        for (int64_t j = 0; j < m; j++) share[i * m + j] = (i == j ? 1.0 : 0.0) - p->tie_welded[i * m + j] / body->stiffness[j];
    for (int64_t i = 0; i < m; i++)
        for (int64_t j = 0; j < m; j++) {
            double sum = 0.0;
            for (int64_t k = 0; k < m; k++) sum += share[i * m + k] * 2.0 * body->zeta[k] * p->omega[k] * share[j * m + k];
            weighed[i * m + j] = sum;
        }
    for (int64_t j = 0; j < m; j++) {
        body->rate[j] = weighed[j * m + j];
        weighed[j * m + j] = 0.0;
    }
    return FLEX_OK;
}

/* A step of any length where no load depends on q: nothing to iterate, nothing to divide. 0 where one does. */
static int exact_step(Body *body, const double *inputs, const double *inputs_end, double step, double *q, double *v) {
    const int64_t m = body->p.modes;
    Arena arena = work_arena(body);
    Loads loads;
    take_loads(body, &arena, &loads);
    double *growth = take(&arena, m), *mean = take(&arena, m);
    if (body->p.inertial || body->p.turns) return 0;
    spread(body, inputs, &loads);
    if (loads.active) return 0;
    memcpy(mean, loads.constant, (size_t)m * sizeof(double));
    memset(growth, 0, (size_t)m * sizeof(double));
    if (inputs_end) {
        spread(body, inputs_end, &loads);
        if (loads.active) return 0;
        for (int64_t j = 0; j < m; j++) {
            growth[j] = loads.constant[j] - mean[j];
            mean[j] += 0.5 * growth[j];
        }
    }
    const Rule *r = rule_of(body, step);
    for (int64_t j = 0; j < m; j++) {
        const double start = q[j];
        q[j] = r->p11[j] * start + r->p12[j] * v[j] + r->gq[j] * mean[j] + r->ramp[j] * growth[j];
        v[j] = r->p21[j] * start + r->p22[j] * v[j] + r->gv[j] * mean[j] + r->ramp_rate[j] * growth[j];
    }
    return 1;
}

/* Whether the loads would turn the linear body within a frame beyond all sense: more internal steps are no use then. */
static int beyond_reach(Body *body, const double *inputs, const double *inputs_end, double step, const double *q,
                        const double *v) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    const Rule *r = rule_of(body, step);
    Arena arena = work_arena(body);
    Configuration at;
    Loads loads;
    take_configuration(body, &arena, &at);
    take_loads(body, &arena, &loads);
    double *force = take(&arena, m), *scratch = take(&arena, modal_force_size(body)), *middle = take(&arena, p->loads);
    for (int64_t i = 0; i < p->loads; i++) middle[i] = inputs_end ? 0.5 * (inputs[i] + inputs_end[i]) : inputs[i];
    spread(body, middle, &loads);
    configure(body, q, &at);
    modal_force(body, &loads, 1, &at, 0, scratch, force);
    for (int64_t j = 0; j < m; j++) force[j] = r->p11[j] * q[j] + r->p12[j] * v[j] + r->gq[j] * force[j];
    for (int64_t i = 0; i < 3 * p->turnings; i++)
        if (!(fabs(dot(p->turning + i * m, force, m)) < SENSELESS)) return 1;
    return 0;
}

/* Internal steps that a step has at least. */
static double fewest_steps(const Body *body, double step) {
    const double longest = body->limits.longest;
    double fewest = longest > 0.0 ? step / longest * (1.0 - 1e-9) : 1.0;
    /* An error as large as the motion is none that anyone asks for. */
    if (body->p.tied && body->limits.tolerance < 1.0) fewest = fmax(fewest, step * body->p.omega[0] / RESOLVED);
    return fmax(1.0, ceil(fmin(fewest, UNCOUNTED)));
}

int body_step(Body *body, const double *inputs, const double *inputs_end, double step, double *q, double *v,
              int64_t *hint, Work *work) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    if (!(isfinite(step) && step > 0.0)) return FLEX_BAD_STEP;
    Work done = {1, 0, 0.0};
    if (step <= INDIVISIBLE) {
        *work = done;
        return FLEX_OK;
    }
    int64_t next = *hint;
    /* The result goes into the last part of the workspace first: a step that fails leaves the state as it was. */
    double *q1 = body->work + body->work_size - 2 * m, *v1 = q1 + m;
    memcpy(q1, q, (size_t)m * sizeof(double));
    memcpy(v1, v, (size_t)m * sizeof(double));
    if (!exact_step(body, inputs, inputs_end, step, q1, v1)) {
        const double most = body->limits.most, least = fewest_steps(body, step);
        work->substeps = (int64_t)least;
        work->iterations = 0;
        if (least > most) return FLEX_TOO_MANY_STEPS;
        const int64_t fewest = (int64_t)least;
        Division d = {inputs, inputs_end, 0.0, 0, body->limits.tolerance, 0, (int64_t)fmin(ORDINARY_ROUNDS * most, UNCOUNTED), 0.0};
        d.count = fewest > next ? fewest : next;
        if ((double)d.count > most) d.count = (int64_t)most;
        int answer = UNSETTLED;
        while ((double)d.count <= most && d.rounds < d.most_rounds) {
            d.step = step / (double)d.count;
            memcpy(q1, q, (size_t)m * sizeof(double));
            memcpy(v1, v, (size_t)m * sizeof(double));
            answer = p->tied      ? tied_steps(body, &d, q1, v1)
                     : p->turns    ? free_steps(body, &d, q1, v1)
                     : p->inertial ? inertial_steps(body, &d, q1, v1)
                                   : plain_steps(body, &d, q1, v1);
            work->iterations = d.rounds;
            work->substeps = d.count;
            work->error = answer == INACCURATE ? d.worst : HUGE_VAL;
            if (answer == DONE) break;
            d.count *= 2;
            if (d.count >= SUSPECT && beyond_reach(body, inputs, inputs_end, step, q, v)) return FLEX_NOT_CONVERGED;
        }
        if (answer != DONE) return FLEX_TOO_MUCH_WORK;
        done.substeps = d.count;
        done.iterations = d.rounds;
        done.error = d.worst;
        /* The error falls with the cube of the internal step: half as many are tried next time only if that would do. */
        next = 16.0 * d.worst < d.tolerance && d.count > fewest ? d.count / 2 : d.count;
        if (next < 1) next = 1;
    }
    /* Not a number compares as false. What is larger would overflow on its way to the outputs. */
    if (!(dot(q1, q1, m) + dot(v1, v1, m) < LARGEST_SQUARE)) return FLEX_NOT_FINITE;
    memcpy(q, q1, (size_t)m * sizeof(double));
    memcpy(v, v1, (size_t)m * sizeof(double));
    *hint = next;
    *work = done;
    return FLEX_OK;
}

void body_nodes(Body *body, const double *q, double *position, double *rotation) {
    const Configuration *at = whole_configuration(body, q);
    memcpy(position, at->position, (size_t)(3 * body->p.nodes) * sizeof(double));
    memcpy(rotation, at->rotation, (size_t)(9 * body->p.nodes) * sizeof(double));
}

void body_motion(Body *body, const double *q, const double *v, double *motion, double *rates) {
    const Program *p = &body->p;
    Arena arena = work_arena(body);
    const Configuration *at = whole_configuration(body, q);
    for (int64_t i = 0; i < p->interfaces; i++) {
        const int64_t k = p->frames + i;
        for (int c = 0; c < 3; c++) motion[6 * i + c] = at->position[3 * k + c] - p->point[3 * k + c];
        rotation_vector(at->rotation + 9 * k, motion + 6 * i + 3);
    }
    if (!rates) return;
    Rates of;
    take_rates(body, &arena, &of);
    node_rates(body, 0, at, v, &of);
    for (int64_t i = 0; i < p->interfaces; i++) {
        memcpy(rates + 6 * i, of.velocity + 3 * (p->frames + i), 3 * sizeof(double));
        memcpy(rates + 6 * i + 3, of.spin + 3 * (p->frames + i), 3 * sizeof(double));
    }
}

void body_stress(Body *body, const double *q, double *largest) {
    const Program *p = &body->p;
    for (int64_t s = 0; s < p->stress_sets; s++) {
        double most = 0.0;
        for (int64_t i = p->stress_start[s]; i < p->stress_start[s + 1]; i++) {
            double t[6];
            rows_times(p->stress + i * 6 * p->modes, q, t, 6, p->modes);
            const double a = t[0] - t[1], b = t[1] - t[2], c = t[2] - t[0];
            const double square = 0.5 * (a * a + b * b + c * c) + 3.0 * (t[3] * t[3] + t[4] * t[4] + t[5] * t[5]);
            if (!(square <= most)) most = square;
        }
        largest[s] = sqrt(most);
    }
}

void body_energies(Body *body, const double *q, const double *v, double *strain, double *kinetic) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    Arena arena = work_arena(body);
    Configuration at;
    take_configuration(body, &arena, &at);
    Flow flow;
    double *tense = take(&arena, 12 * p->ties), *momentum = take(&arena, m);
    take_flow(body, &arena, &flow);
    *strain = 0.0;
    for (int64_t j = 0; j < m; j++) *strain += 0.5 * body->stiffness[j] * q[j] * q[j];
    *kinetic = 0.5 * dot(v, v, m);
    if (p->stretches) {
        Stretch stretch;
        take_stretch(body, &arena, &stretch);
        stretch_at(body, q, &stretch);
        *strain += stretch_energy(body, &stretch);
    }
    if (!p->tied && !p->inertial) return;
    configure(body, q, &at);
    if (p->tied) {
        *strain += tie_tension(body, &at, tense);
        for (int64_t j = 0; j < m; j++) *strain -= 0.5 * q[j] * dot(p->tie_initial + j * m, q, m);
    }
    if (p->inertial) {
        excess_momentum(body, &at, v, &flow, momentum);
        *kinetic += 0.5 * dot(v, momentum, m);
    }
}

void body_mass(Body *body, const double *q, double *mass) {
    const int64_t m = body->p.modes;
    Arena arena = work_arena(body);
    Configuration at;
    const int64_t r = body->p.inertial_modes;
    for (int64_t i = 0; i < m * m; i++) mass[i] = i % (m + 1) == 0 ? 1.0 : 0.0;
    if (!body->p.inertial) return;
    Flow flow;
    take_configuration(body, &arena, &at);
    take_flow(body, &arena, &flow);
    double *excess = take(&arena, r * r);
    configure(body, q, &at);
    excess_mass(body, &at, &flow, excess);
    for (int64_t i = 0; i < r; i++)
        for (int64_t j = 0; j < r; j++) mass[i * m + j] += excess[i * r + j];
}

void body_forces(Body *body, const double *inputs, const double *q, double *force, double *tangent) {
    const Program *p = &body->p;
    const int64_t m = p->modes;
    Arena arena = work_arena(body);
    Configuration at;
    Loads loads;
    take_configuration(body, &arena, &at);
    take_loads(body, &arena, &loads);
    double *scratch = take(&arena, modal_force_size(body)), *rest = take(&arena, tangent_size(body));
    configure(body, q, &at);
    spread(body, inputs, &loads);
    if (force) {
        modal_force(body, &loads, 1, &at, 0, scratch, force);
        for (int64_t j = 0; p->tied && j < m; j++) force[j] += dot(p->tie_initial + j * m, q, m);
        Arena spare = {rest, 0};
        Stretch stretch;
        take_stretch(body, &spare, &stretch);
        stretch_at(body, q, &stretch);
        subtract_stretch_force(body, &stretch, &stretch, force);
    }
    if (tangent) tangent_stiffness(body, &loads, 1, &at, 0, rest, tangent);
}
