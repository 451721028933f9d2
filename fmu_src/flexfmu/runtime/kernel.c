/* The steps of stepping.py and tied_stepping.py and the outputs of body.py, compiled. A transcription of them, tree.py,
 * dynamics.py and ties.py for speed alone: the same formulas, the same tolerances, the same results to round-off. No
 * global data: everything is in the struct Body, whose arrays belong to the caller, row by row (C order), in SI units.
 * Equation numbers are those of docs/theory.md. */

#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Raised whenever the struct or a signature changes; kernel.py asks for it. */
#define KERNEL_VERSION 6

enum { REFERENCE = 0, CORRECTIVE_MOMENT = 1, DEFORMED = 2 };
enum { DONE = 0, UNSETTLED = 1, INACCURATE = 2, EXHAUSTED = 3 };

/* As in stepping.py. */
static const double TOLERANCE = 1e-12, SETTLED = 1e-5, ROUND_OFF = 64.0 * 2.220446049250313e-16, NOISE = 1.0 / 16.0;
enum { ROUNDS = 16 };

typedef struct {
    int64_t modes, nodes, frames, interfaces, masses, placement, nonlinear, turnings, parts, ties, pulls;
    const int64_t *parent;                                /* (K), -1 for the ground */
    const double *offset, *base, *point;                  /* (K, 3) */
    const double *operator_;                              /* (6K, m): D of all nodes, then C of all nodes */
    const double *curvature;                              /* (r, r) of each row that has one, or null */
    const int64_t *part, *core;                           /* (6K): the row's part, or -1, and where its (r, r) begins */
    const int64_t *extent;                                /* (parts): r, how many coordinates bend a part */
    const double *basis;                                  /* (r, m) of each part; null for q itself */
    const double *load_operator;                          /* (6I, m): displacements, then rotations */
    const double *mass;                                   /* (P) */
    const double *inertia;                                /* (3, m) */
    const double *by_load;                                /* (6I or 6I + 3, m, m), or null */
    const double *by_mode;                                /* (m, m, m), or null */
    const double *omega, *weight;                         /* (m) */
    const double *turning;                                /* (3T, m): rotations within frames */
    const double *tie_stiffness, *tie_lever, *tie_apart;  /* (T, 3), (T, 3, 3), (T, 3) */
    const double *tie_initial, *material;                 /* (m, m): H, and damping off its diagonal */
    const int64_t *pull;                                  /* (pulls): which of a tie's (T, 6) coordinates resist */
    double noise;                                         /* change of q that means nothing */
    double *work;                                         /* see kernel_work_size */
} Body;

typedef struct {
    const double *p11, *p12, *p21, *p22, *gq, *gv, *ramp, *ramp_rate; /* (m) */
} Propagator;

/* A configuration: what follows from q. */
typedef struct {
    double *q;                              /* (m) */
    double *local;                          /* (6K): b and φ of all nodes */
    double *straight;                       /* (6K): their part that is linear in q */
    double *bent;                           /* (parts, m): coordinates that bend each part, where there is curvature */
    double *turned;                         /* (6K, m): its share of the derivatives, in a part's coordinates */
    double *position;                       /* (K, 3) */
    double *rotation, *parent, *jacobian;   /* (K, 3, 3) */
} Configuration;

/* Loads on the tree's nodes; `with_moments` off leaves the moments out, which have no potential. */
typedef struct {
    double *force, *moment;                 /* (K, 3) */
    double *constant, *force_constant;      /* (m), with and without moments */
    double *geometric, *force_geometric;    /* (m, m) */
    int active, has_moments;
} Loads;

static void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Four sums at a time: a single one would wait for itself. */
static double dot(const double *a, const double *b, int64_t n) {
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    int64_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (int k = 0; k < 4; k++) sum[k] += a[i + k] * b[i + k];
    for (; i < n; i++) sum[0] += a[i] * b[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/* out = M x and out = Mᵀ x, M (3, 3). */
static void apply(const double *m, const double *x, double *out) {
    for (int i = 0; i < 3; i++) out[i] = m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2];
}

static void apply_back(const double *m, const double *x, double *out) {
    for (int i = 0; i < 3; i++) out[i] = m[i] * x[0] + m[3 + i] * x[1] + m[6 + i] * x[2];
}

static void multiply(const double *a, const double *b, double *out) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

/* out (n) = M x, M (n, m); out (m) = x M. */
static void rows_times(const double *matrix, const double *x, double *out, int64_t n, int64_t m) {
    for (int64_t i = 0; i < n; i++) out[i] = dot(matrix + i * m, x, m);
}

static void add_times_rows(const double *x, const double *matrix, double *out, int64_t n, int64_t m) {
    for (int64_t i = 0; i < n; i++) {
        const double *row = matrix + i * m;
        const double factor = x[i];
        if (factor != 0.0)
            for (int64_t j = 0; j < m; j++) out[j] += factor * row[j];
    }
}

/* exp(φ^) and its left Jacobian T, as rotations.py. */
static void exponential(const double *phi, double *rotation, double *jacobian) {
    const double square = dot(phi, phi, 3), angle = sqrt(square + 1e-20);
    const double twice = 2.0 * sin(0.5 * angle) / angle;
    const double alpha = twice * cos(0.5 * angle), beta = 0.5 * twice * twice, gamma = (1.0 - alpha) / (angle * angle);
    const double hat[9] = {0.0, -phi[2], phi[1], phi[2], 0.0, -phi[0], -phi[1], phi[0], 0.0};
    double twofold[9];
    multiply(hat, hat, twofold);
    for (int i = 0; i < 9; i++) {
        const double one = i % 4 == 0 ? 1.0 : 0.0;
        rotation[i] = one + alpha * hat[i] + beta * twofold[i];
        jacobian[i] = one + beta * hat[i] + gamma * twofold[i];
    }
}

/* Coordinates x that bend each part at q, (parts, m) with r of them in each row. */
static void part_coordinates(const Body *body, const double *q, double *x) {
    const int64_t m = body->modes;
    const double *basis = body->basis;
    if (!basis) memcpy(x, q, m * sizeof(double));
    for (int64_t p = 0; basis && p < body->parts; basis += body->extent[p++] * m)
        rows_times(basis, q, x + p * m, body->extent[p], m);
}

/* out (m) += factors (6K) times the derivatives of b and φ; `scratch` holds (parts, m). */
static void add_times_derivative(const Body *body, const Configuration *at, const double *factors, double *scratch,
                                 double *out) {
    const int64_t m = body->modes;
    add_times_rows(factors, body->operator_, out, 6 * body->nodes, m);
    if (!body->curvature) return;
    memset(scratch, 0, body->parts * m * sizeof(double));
    for (int64_t i = 0; i < 6 * body->nodes; i++)
        if (body->part[i] >= 0)
            add_times_rows(factors + i, at->turned + i * m, scratch + body->part[i] * m, 1,
                           body->extent[body->part[i]]);
    const double *basis = body->basis;
    for (int64_t j = 0; !basis && j < m; j++) out[j] += scratch[j];
    for (int64_t p = 0; basis && p < body->parts; basis += body->extent[p++] * m)
        add_times_rows(scratch + p * m, basis, out, body->extent[p], m);
}

/* b and φ from their linear part and the curvature's share in their derivatives. */
static void bend(const Body *body, Configuration *at) {
    memcpy(at->local, at->straight, 6 * body->nodes * sizeof(double));
    for (int64_t i = 0; body->curvature && i < 6 * body->nodes; i++)
        if (body->part[i] >= 0)
            at->local[i] += 0.5 * dot(at->turned + i * body->modes, at->bent + body->part[i] * body->modes,
                                      body->extent[body->part[i]]);
}

/* The pass outwards, (5) and (6). */
static void place(const Body *body, Configuration *at) {
    const int64_t k_count = body->nodes;
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (int64_t k = 0; k < k_count; k++) {
        const int64_t p = body->parent[k];
        double turned[3], relative[9];
        double *b = at->local + 3 * k;
        const double *parent = p < 0 ? identity : at->rotation + 9 * p;
        memcpy(at->parent + 9 * k, parent, sizeof identity);
        exponential(at->local + 3 * (k_count + k), relative, at->jacobian + 9 * k);
        multiply(parent, relative, at->rotation + 9 * k);
        for (int i = 0; i < 3; i++) b[i] += body->offset[3 * k + i];
        apply(parent, b, turned);
        for (int i = 0; i < 3; i++) {
            const double from = p < 0 ? 0.0 : at->position[3 * p + i] - body->base[3 * p + i];
            at->position[3 * k + i] = body->base[3 * k + i] + from + turned[i];
        }
    }
}

static void configure(const Body *body, const double *q, Configuration *at) {
    const int64_t m = body->modes;
    if (at->q != q) memcpy(at->q, q, m * sizeof(double));
    rows_times(body->operator_, q, at->straight, 6 * body->nodes, m);
    if (body->curvature) {
        part_coordinates(body, q, at->bent);
        for (int64_t i = 0; i < 6 * body->nodes; i++) {
            if (body->part[i] < 0) continue;
            const int64_t r = body->extent[body->part[i]];
            rows_times(body->curvature + body->core[i], at->bent + body->part[i] * m, at->turned + i * m, r, r);
        }
    }
    bend(body, at);
    place(body, at);
}

static void mean_of(const double *a, const double *b, double *out, int64_t n) {
    for (int64_t i = 0; i < n; i++) out[i] = 0.5 * (a[i] + b[i]);
}

/* The configuration halfway between the q of two others: the derivatives are linear in q. */
static void configure_halfway(const Body *body, const Configuration *a, const Configuration *b, Configuration *at) {
    const int64_t m = body->modes, rows = 6 * body->nodes;
    mean_of(a->q, b->q, at->q, m);
    mean_of(a->straight, b->straight, at->straight, rows);
    if (body->curvature) {
        mean_of(a->bent, b->bent, at->bent, body->parts * m);
        for (int64_t i = 0; i < rows; i++)
            if (body->part[i] >= 0)
                mean_of(a->turned + i * m, b->turned + i * m, at->turned + i * m, body->extent[body->part[i]]);
    }
    bend(body, at);
    place(body, at);
}

/* Put the interfaces' loads (I, 2, 3) and the acceleration (3) on the tree: spread() of dynamics.py. */
static void spread(const Body *body, const double *inputs, Loads *loads) {
    const int64_t m = body->modes, first = body->frames, interfaces = body->interfaces;
    const double none[3] = {0.0, 0.0, 0.0};
    const double *acceleration = body->masses ? inputs + 6 * interfaces : none;
    int any = 0;
    loads->has_moments = 0;
    memset(loads->force, 0, 3 * body->nodes * sizeof(double));
    memset(loads->moment, 0, 3 * body->nodes * sizeof(double));
    memset(loads->force_constant, 0, m * sizeof(double));
    for (int64_t i = 0; i < interfaces; i++) {
        memcpy(loads->force + 3 * (first + i), inputs + 6 * i, 3 * sizeof(double));
        memcpy(loads->moment + 3 * (first + i), inputs + 6 * i + 3, 3 * sizeof(double));
        for (int c = 0; c < 3; c++) {
            any |= inputs[6 * i + c] != 0.0;
            loads->has_moments |= inputs[6 * i + 3 + c] != 0.0;
        }
    }
    for (int64_t p = 0; p < body->masses; p++)
        for (int c = 0; c < 3; c++) {
            const double f = -body->mass[p] * acceleration[c];
            loads->force[3 * (first + interfaces + p) + c] = f;
            any |= f != 0.0;
        }
    add_times_rows(loads->force + 3 * first, body->load_operator, loads->force_constant, 3 * interfaces, m);
    add_times_rows(acceleration, body->inertia, loads->force_constant, 3, m);
    memcpy(loads->constant, loads->force_constant, m * sizeof(double));
    if (loads->has_moments)
        add_times_rows(loads->moment + 3 * first, body->load_operator + 3 * interfaces * m, loads->constant,
                       3 * interfaces, m);
    if (body->by_load) {
        memset(loads->force_geometric, 0, m * m * sizeof(double));
        add_times_rows(loads->force + 3 * first, body->by_load, loads->force_geometric, 3 * interfaces, m * m);
        if (body->masses)
            add_times_rows(acceleration, body->by_load + 6 * interfaces * m * m, loads->force_geometric, 3, m * m);
        memcpy(loads->geometric, loads->force_geometric, m * m * sizeof(double));
        if (loads->has_moments)
            add_times_rows(loads->moment + 3 * first, body->by_load + 3 * interfaces * m * m, loads->geometric,
                           3 * interfaces, m * m);
    }
    loads->active = body->by_mode != 0 || body->ties || (body->nonlinear && (any || loads->has_moments));
}

/* The pass back: out (m) += generalised force of loads (K, 3) on the nodes, which are gathered in place.
 * `scratch` holds 6K + parts m. */
static void pass_back(const Body *body, const Configuration *at, double *force, double *moment, double *scratch,
                      double *out) {
    const int64_t k_count = body->nodes;
    double *row = scratch;
    /* Children stand after their parents. */
    for (int64_t k = k_count - 1; k >= 0; k--) {
        const int64_t p = body->parent[k];
        const double *parent = at->parent + 9 * k;
        double turned[3];
        apply_back(parent, force + 3 * k, row + 3 * k);
        apply_back(parent, moment + 3 * k, turned);
        apply_back(at->jacobian + 9 * k, turned, row + 3 * (k_count + k));
        if (p < 0) continue;
        double arm[3], about[3];
        for (int i = 0; i < 3; i++)
            arm[i] = (at->position[3 * k + i] - body->base[3 * k + i]) -
                     (at->position[3 * p + i] - body->base[3 * p + i]);
        cross(arm, force + 3 * k, about);
        for (int i = 0; i < 3; i++) {
            force[3 * p + i] += force[3 * k + i];
            moment[3 * p + i] += moment[3 * k + i] + about[i];
        }
    }
    add_times_derivative(body, at, row, row + 6 * k_count, out);
}

/* Levers R l_c of a tie's end at node k, c by c. */
static void levers(const Body *body, const Configuration *at, int64_t tie, int64_t k, double *out) {
    double turned[9];
    multiply(at->rotation + 9 * k, body->tie_lever + 9 * tie, turned);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 3; i++) out[3 * c + i] = turned[3 * i + c];
}

/* Forces (T, 4, 3) in the ties' springs, and what these hold. */
static double tension(const Body *body, const Configuration *at, double *tense) {
    double held = 0.0;
    for (int64_t t = 0; t < body->ties; t++) {
        const int64_t a = body->nodes - 2 * body->ties + t, b = a + body->ties;
        double gap[12], other[9];
        for (int i = 0; i < 3; i++)
            gap[i] = at->position[3 * a + i] - at->position[3 * b + i] - body->tie_apart[3 * t + i];
        levers(body, at, t, a, gap + 3);
        levers(body, at, t, b, other);
        for (int i = 0; i < 9; i++) gap[3 + i] -= other[i];
        for (int i = 0; i < 12; i++) {
            tense[12 * t + i] = body->tie_stiffness[3 * t + i % 3] * gap[i];
            held += 0.5 * tense[12 * t + i] * gap[i];
        }
    }
    return held;
}

/* Add the loads of springs of a given tension to those on the nodes. */
static void add_tie_loads(const Body *body, const Configuration *at, const double *tense, double *force,
                          double *moment) {
    for (int64_t t = 0; t < body->ties; t++)
        for (int end = 0; end < 2; end++) {
            const int64_t k = body->nodes - (2 - end) * body->ties + t;
            const double sign = end ? 1.0 : -1.0;
            double arms[9], about[3];
            levers(body, at, t, k, arms);
            for (int i = 0; i < 3; i++) force[3 * k + i] += sign * tense[12 * t + i];
            for (int c = 0; c < 3; c++) {
                cross(arms + 3 * c, tense + 12 * t + 3 + 3 * c, about);
                for (int i = 0; i < 3; i++) moment[3 * k + i] += sign * about[i];
            }
        }
}

/* Q(q), modal_force() of dynamics.py, of ties without Hq; `tense` is null where their tension is that at q.
 * `scratch` holds 12K + 12T + max(m², parts m). */
static void modal_force(const Body *body, const Loads *loads, int with_moments, const Configuration *at,
                        const double *tense, double *scratch, double *out) {
    const int64_t m = body->modes, k_count = body->nodes;
    const double *constant = with_moments ? loads->constant : loads->force_constant;
    memset(out, 0, m * sizeof(double));
    if (body->placement == DEFORMED || body->ties) {
        double *own = scratch, *force = own + 12 * body->ties, *moment = force + 3 * k_count;
        memset(force, 0, 6 * k_count * sizeof(double));
        if (body->placement == DEFORMED) memcpy(force, loads->force, 3 * k_count * sizeof(double));
        if (body->placement == DEFORMED && with_moments) memcpy(moment, loads->moment, 3 * k_count * sizeof(double));
        if (!tense) tension(body, at, own);
        add_tie_loads(body, at, tense ? tense : own, force, moment);
        pass_back(body, at, force, moment, moment + 3 * k_count, out);
    }
    if (body->placement != DEFORMED) {
        for (int64_t j = 0; j < m; j++) out[j] += constant[j];
        if (body->placement == CORRECTIVE_MOMENT)
            for (int64_t i = 0; i < body->interfaces; i++) {
                const int64_t k = body->frames + i;
                double displacement[3], moment[3];
                for (int c = 0; c < 3; c++) displacement[c] = at->position[3 * k + c] - body->point[3 * k + c];
                cross(displacement, loads->force + 3 * k, moment);
                add_times_rows(moment, body->load_operator + 3 * (body->interfaces + i) * m, out, 3, m);
            }
    }
    if (body->by_load) {
        const double *geometric = with_moments ? loads->geometric : loads->force_geometric;
        for (int64_t i = 0; i < m; i++) out[i] -= dot(geometric + i * m, at->q, m);
    }
    if (body->by_mode) {
        double *total = scratch;
        memset(total, 0, m * m * sizeof(double));
        add_times_rows(at->q, body->by_mode, total, m, m * m);
        for (int64_t i = 0; i < m; i++) out[i] -= dot(total + i * m, at->q, m);
    }
}

/* J(q) of the forces, without ties; whether there is one is has_potential(). */
static double force_work(const Body *body, const Loads *loads, const Configuration *at) {
    const int64_t m = body->modes;
    double work = 0.0;
    if (body->placement == DEFORMED)
        for (int64_t i = 0; i < 3 * body->nodes; i++) work += loads->force[i] * (at->position[i] - body->point[i]);
    else
        work = dot(loads->force_constant, at->q, m);
    if (body->by_load)
        for (int64_t i = 0; i < m; i++) work -= 0.5 * at->q[i] * dot(loads->force_geometric + i * m, at->q, m);
    return work;
}

/* What the round-off of places can make of the work of forces (n, 3), over ε: work_reach() of dynamics.py. */
static double work_reach(const Body *body, const double *force, int64_t n) {
    double sum = 0.0, far = 0.0;
    for (int64_t i = 0; i < n; i++) sum += sqrt(dot(force + 3 * i, force + 3 * i, 3));
    for (int64_t k = 0; k < body->nodes; k++) far = fmax(far, dot(body->point + 3 * k, body->point + 3 * k, 3));
    return sum * sqrt(far);
}

/* Twice the strain energy of a body with ties, whose springs hold `held`; `linear` is Hq. */
static double strain_of(const Body *body, const double *q, double held, const double *linear) {
    double strain = 2.0 * held;
    for (int64_t j = 0; j < body->modes; j++) strain += q[j] * (body->omega[j] * body->omega[j] * q[j] - linear[j]);
    return fabs(strain);
}

static int has_potential(const Body *body) { return body->placement != CORRECTIVE_MOMENT && body->by_mode == 0; }

static double *take(double **free, int64_t count) {
    double *start = *free;
    *free += count;
    return start;
}

static void take_configuration(const Body *body, double **free, Configuration *at) {
    at->q = take(free, body->modes);
    at->local = take(free, 6 * body->nodes);
    at->straight = take(free, 6 * body->nodes);
    at->bent = take(free, body->parts * body->modes);
    at->turned = take(free, body->curvature ? 6 * body->nodes * body->modes : 0);
    at->position = take(free, 3 * body->nodes);
    at->rotation = take(free, 9 * body->nodes);
    at->parent = take(free, 9 * body->nodes);
    at->jacobian = take(free, 9 * body->nodes);
}

static void take_loads(const Body *body, double **free, Loads *loads) {
    const int64_t m = body->modes;
    loads->force = take(free, 3 * body->nodes);
    loads->moment = take(free, 3 * body->nodes);
    loads->constant = take(free, m);
    loads->force_constant = take(free, m);
    loads->geometric = take(free, m * m);
    loads->force_geometric = take(free, m * m);
}

/* Linkers of Windows look for it in whatever Python's tools build; nothing imports this library. */
EXPORT void *PyInit__kernel(void) { return 0; }

EXPORT int64_t kernel_version(void) { return KERNEL_VERSION; }

static int64_t scratch_size(const Body *body) {
    const int64_t m = body->modes, most = body->parts > m ? body->parts : m;
    return 12 * body->nodes + 12 * body->ties + m * most;
}

/* Numbers of type double that `work` must hold. */
EXPORT int64_t kernel_work_size(const Body *body) {
    const int64_t m = body->modes, n = body->pulls;
    const int64_t configuration = m + 42 * body->nodes + body->parts * m + (body->curvature ? 6 * body->nodes * m : 0);
    const int64_t pull = 2 * n * m + 2 * n * n + 2 * n + 12 * body->ties;
    return 3 * configuration + 6 * body->nodes + 2 * m + 2 * m * m + scratch_size(body) + pull + 22 * m +
           6 * body->interfaces + 3 + 12 * body->nodes;
}

/* Equal sub-steps from (q, v), which are overwritten where the result is DONE: _substeps() of stepping.py.
 * `inputs_end` is null for loads that are constant over the step; `most` bounds the rounds. */
EXPORT int64_t kernel_substeps(const Body *body, const Propagator *p, const double *inputs, const double *inputs_end,
                               double *q, double *v, int64_t substeps, double tolerance, int64_t most,
                               int64_t *rounds, double *worst) {
    const int64_t m = body->modes, width = 6 * body->interfaces + (body->masses ? 3 : 0);
    double *free = body->work;
    Configuration middle, here;
    Loads loads;
    take_configuration(body, &free, &middle);
    take_configuration(body, &free, &here);
    take_loads(body, &free, &loads);
    double *scratch = take(&free, scratch_size(body));
    double *q0 = take(&free, m), *v0 = take(&free, m), *q1 = take(&free, m), *target = take(&free, m);
    double *start = take(&free, m), *end = take(&free, m), *force = take(&free, m), *mean = take(&free, m);
    double *difference = take(&free, m), *bare = take(&free, m), *growth = take(&free, m), *half = take(&free, m);
    double *between = take(&free, width);
    const int potential = has_potential(body);
    double start_work = 0.0, end_work;

    *rounds = 0;
    *worst = 0.0;
    memset(growth, 0, m * sizeof(double));
    if (inputs_end) {
        spread(body, inputs, &loads);
        for (int64_t j = 0; j < m; j++) growth[j] = -loads.constant[j] / (double)substeps;
        spread(body, inputs_end, &loads);
        for (int64_t j = 0; j < m; j++) growth[j] += loads.constant[j] / (double)substeps;
    } else {
        spread(body, inputs, &loads);
    }
    memcpy(q0, q, m * sizeof(double));
    memcpy(v0, v, m * sizeof(double));
    configure(body, q0, &here);
    if (!inputs_end) {
        modal_force(body, &loads, 1, &here, 0, scratch, start);
        start_work = force_work(body, &loads, &here);
    }
    for (int64_t number = 0; number < substeps; number++) {
        if (*rounds >= most) return EXHAUSTED;
        if (inputs_end) {
            const double share = ((double)number + 0.5) / (double)substeps;
            for (int64_t i = 0; i < width; i++) between[i] = inputs[i] + share * (inputs_end[i] - inputs[i]);
            spread(body, between, &loads);
            modal_force(body, &loads, 1, &here, 0, scratch, start);
            start_work = force_work(body, &loads, &here);
        }
        const double reach = fabs(start_work) + work_reach(body, loads.force, body->nodes);
        double speed = 0.0, uncertain = 0.0;
        for (int64_t j = 0; j < m; j++) {
            target[j] = p->p11[j] * q0[j] + p->p12[j] * v0[j];
            q1[j] = target[j] + p->gq[j] * start[j];
            speed += v0[j] * v0[j];
        }
        speed = sqrt(speed);
        double size = HUGE_VAL, correction = 0.0;
        int settled = 0;
        for (int round = 0; round < ROUNDS && !settled; round++) {
            double square = 0.0;
            ++*rounds;
            for (int64_t j = 0; j < m; j++) {
                half[j] = 0.5 * (q0[j] + q1[j]);
                difference[j] = q1[j] - q0[j];
                square += difference[j] * difference[j];
            }
            configure(body, half, &middle);
            modal_force(body, &loads, 1, &middle, 0, scratch, force);
            const int corrected = size <= SETTLED;
            if (corrected && potential && square > 0.0) {
                configure(body, q1, &here);
                end_work = force_work(body, &loads, &here);
                const double *conservative = force;
                if (loads.has_moments) {
                    modal_force(body, &loads, 0, &middle, 0, scratch, bare);
                    conservative = bare;
                }
                const double bracket = end_work - start_work - dot(conservative, difference, m);
                const double round_off = ROUND_OFF * (reach + fabs(end_work));
                correction = fabs(bracket) > round_off ? bracket / square : 0.0;
                uncertain = correction != 0.0 ? NOISE * round_off / square : 0.0;
            }
            double change = 0.0, scale = 0.0, blurred = 0.0;
            for (int64_t j = 0; j < m; j++) {
                mean[j] = force[j] + correction * difference[j];
                const double next = target[j] + p->gq[j] * mean[j];
                const double moved = body->weight[j] * (q1[j] - next), sized = body->weight[j] * next;
                const double blur = body->weight[j] * p->gq[j] * uncertain * difference[j];
                change += moved * moved;
                scale += sized * sized;
                blurred += blur * blur;
                q1[j] = next;
            }
            scale = sqrt(scale) + speed;
            size = scale > 0.0 ? sqrt(change) / scale : 0.0;
            if (!isfinite(size)) return UNSETTLED;
            settled = corrected && size * scale <= fmax(TOLERANCE * scale, sqrt(blurred));
        }
        if (!settled) return UNSETTLED;
        double error = 0.0, energy = 0.0;
        for (int64_t j = 0; j < m; j++) {
            const double rate = p->p21[j] * q0[j] + p->p22[j] * v0[j] + p->gv[j] * mean[j];
            v0[j] = rate + p->ramp_rate[j] * growth[j];
            q0[j] = q1[j] + p->ramp[j] * growth[j];
        }
        configure(body, q0, &here);
        modal_force(body, &loads, 1, &here, 0, scratch, end);
        end_work = force_work(body, &loads, &here);
        for (int64_t j = 0; j < m; j++) {
            const double lost = body->weight[j] * p->ramp[j] * (end[j] - start[j]), strained = body->omega[j] * q0[j];
            error += lost * lost;
            energy += strained * strained + v0[j] * v0[j];
        }
        error = energy > 0.0 ? sqrt(error / energy) : 0.0;
        if (!(error <= *worst)) *worst = error;
        if (!(*worst <= tolerance)) return INACCURATE;
        memcpy(start, end, m * sizeof(double));
        start_work = end_work;
    }
    memcpy(q, q0, m * sizeof(double));
    memcpy(v, v0, m * sizeof(double));
    return DONE;
}

/* Steps of a body with ties: tied_stepping.py. */
static const double TIED_TOLERANCE = 1e-11, FAST = 0.02;
enum { TIED_ROUNDS = 16 };

typedef struct {
    const double *response, *lag;           /* (m, m), (m) */
    double step;
} TiedRule;

/* How ties pull on q in one place, and what that makes of the response: `Pull` of tied_stepping.py. */
typedef struct {
    double *rows, *answer;                  /* (pulls, m): J and J B */
    double *hold;                           /* (pulls, pulls): (1 + ½ S J B Jᵀ)⁻¹ S */
    double *square, *strain, *force;        /* (pulls, pulls), (pulls), (pulls) */
} Pull;

static double norm(const double *x, int64_t n) { return sqrt(dot(x, x, n)); }

/* Solve a x = b in place, a (n, n), b (n, columns), with pivoting; 0 where a is singular. */
static int solve(double *a, double *b, int64_t n, int64_t columns) {
    for (int64_t i = 0; i < n; i++) {
        int64_t best = i;
        for (int64_t k = i + 1; k < n; k++)
            if (fabs(a[k * n + i]) > fabs(a[best * n + i])) best = k;
        if (!(fabs(a[best * n + i]) > 0.0)) return 0;
        for (int64_t j = 0; j < n && best != i; j++) {
            const double kept = a[i * n + j];
            a[i * n + j] = a[best * n + j];
            a[best * n + j] = kept;
        }
        for (int64_t j = 0; j < columns && best != i; j++) {
            const double kept = b[i * columns + j];
            b[i * columns + j] = b[best * columns + j];
            b[best * columns + j] = kept;
        }
        for (int64_t k = i + 1; k < n; k++) {
            const double factor = a[k * n + i] / a[i * n + i];
            for (int64_t j = i; j < n; j++) a[k * n + j] -= factor * a[i * n + j];
            for (int64_t j = 0; j < columns; j++) b[k * columns + j] -= factor * b[i * columns + j];
        }
    }
    for (int64_t i = n - 1; i >= 0; i--)
        for (int64_t j = 0; j < columns; j++) {
            for (int64_t k = i + 1; k < n; k++) b[i * columns + j] -= a[i * n + k] * b[k * columns + j];
            b[i * columns + j] /= a[i * n + i];
        }
    return 1;
}

/* Entry of the stiffness (6, 6) of a tie against motions of its end a relative to its end b, levers `arms`. */
static double tie_entry(const double *k, const double *arms, int64_t i, int64_t j) {
    double sum = 0.0;
    if (i < 3 || j < 3) return i == j ? k[i] : 0.0;
    for (int c = 0; c < 3; c++) {
        const double *r = arms + 3 * c;
        const double hat[9] = {0.0, -r[2], r[1], r[2], 0.0, -r[0], -r[1], r[0], 0.0};
        for (int l = 0; l < 3; l++) sum += hat[3 * l + i - 3] * k[l] * hat[3 * l + j - 3];
    }
    return sum;
}

static int pull_at(const Body *body, const Propagator *p, const TiedRule *rule, const Configuration *at,
                   double *scratch, double *loads, Pull *pull) {
    const int64_t m = body->modes, n = body->pulls, k_count = body->nodes;
    memset(pull->rows, 0, n * m * sizeof(double));
    memset(pull->answer, 0, n * m * sizeof(double));
    memset(pull->hold, 0, n * n * sizeof(double));
    for (int64_t i = 0; i < n; i++) {
        const int64_t tie = body->pull[i] / 6, c = body->pull[i] % 6;
        const int64_t a = k_count - 2 * body->ties + tie, b = a + body->ties;
        double *side = loads + (c < 3 ? 0 : 3 * k_count), arms[9];
        memset(loads, 0, 6 * k_count * sizeof(double));
        side[3 * a + c % 3] = 1.0;
        side[3 * b + c % 3] = -1.0;
        pass_back(body, at, loads, loads + 3 * k_count, scratch, pull->rows + i * m);
        levers(body, at, tie, a, arms);
        for (int64_t j = 0; j < n; j++)
            if (body->pull[j] / 6 == tie)
                pull->hold[i * n + j] = tie_entry(body->tie_stiffness + 3 * tie, arms, c, body->pull[j] % 6);
    }
    for (int64_t i = 0; i < n; i++) {
        add_times_rows(pull->rows + i * m, rule->response, pull->answer + i * m, m, m);
        for (int64_t j = 0; j < m; j++) pull->answer[i * m + j] *= p->gq[j];
    }
    memset(pull->square, 0, n * n * sizeof(double));
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++) {
            const double shared = dot(pull->answer + i * m, pull->rows + j * m, m);
            for (int64_t k = 0; k < n; k++) pull->square[k * n + j] += 0.5 * pull->hold[k * n + i] * shared;
        }
    for (int64_t i = 0; i < n; i++) pull->square[i * n + i] += 1.0;
    return solve(pull->square, pull->hold, n, n);
}

/* out = what q does under x = g_q f, the ties giving way as they do in the place of `pull`. */
static void respond(const Body *body, const TiedRule *rule, Pull *pull, const double *x, double *out) {
    const int64_t m = body->modes, n = body->pulls;
    rows_times(rule->response, x, out, m, m);
    rows_times(pull->rows, out, pull->strain, n, m);
    rows_times(pull->hold, pull->strain, pull->force, n, n);
    for (int64_t i = 0; i < n; i++) pull->force[i] *= -0.5;
    add_times_rows(pull->force, pull->answer, out, n, m);
}

/* Equal sub-steps of a body with ties: as kernel_substeps. */
EXPORT int64_t kernel_tied_substeps(const Body *body, const Propagator *p, const TiedRule *rule, const double *inputs,
                                    const double *inputs_end, double *q, double *v, int64_t substeps,
                                    double tolerance, int64_t most, int64_t *rounds, double *worst) {
    const int64_t m = body->modes, n = body->pulls, width = 6 * body->interfaces + (body->masses ? 3 : 0);
    double *free = body->work;
    Configuration states[2], middle, *here = states, *there = states + 1;
    Loads loads;
    Pull pull;
    take_configuration(body, &free, here);
    take_configuration(body, &free, there);
    take_configuration(body, &free, &middle);
    take_loads(body, &free, &loads);
    double *scratch = take(&free, scratch_size(body)), *between = take(&free, width);
    double *target = take(&free, m), *v0 = take(&free, m), *q1 = take(&free, m), *force = take(&free, m);
    double *bare = take(&free, m), *mean = take(&free, m), *way = take(&free, m), *rate = take(&free, m);
    double *off = take(&free, m), *change = take(&free, m), *tense = take(&free, 12 * body->ties);
    double *unit = take(&free, 6 * body->nodes), *linear = take(&free, m), *end_linear = take(&free, m);
    pull.rows = take(&free, n * m), pull.answer = take(&free, n * m), pull.hold = take(&free, n * n);
    pull.square = take(&free, n * n), pull.strain = take(&free, n), pull.force = take(&free, n);
    const int potential = has_potential(body);
    double fastest = 0.0;
    for (int64_t j = 0; j < m; j++) fastest = fmax(fastest, body->omega[j]);
    /* Root of the energy that is round-off of the springs' strain and of the rates that follow from it. */
    const double noise = body->noise * (fastest + 2.0 / rule->step);

    *rounds = 0;
    *worst = 0.0;
    memcpy(v0, v, m * sizeof(double));
    configure(body, q, here);
    rows_times(body->tie_initial, q, linear, m, m);
    double start_energy = strain_of(body, q, tension(body, here, tense), linear) + dot(v0, v0, m);
    if (!inputs_end) spread(body, inputs, &loads);
    for (int64_t number = 0; number < substeps; number++) {
        if (*rounds >= most) return EXHAUSTED;
        if (inputs_end) {
            const double share = ((double)number + 0.5) / (double)substeps;
            for (int64_t i = 0; i < width; i++) between[i] = inputs[i] + share * (inputs_end[i] - inputs[i]);
            spread(body, between, &loads);
        }
        const double load_work = force_work(body, &loads, here);
        const double start_work = load_work - tension(body, here, tense);
        const double speed = norm(v0, m), reach = fabs(start_work) + work_reach(body, loads.force, body->nodes);
        double last = HUGE_VAL, earlier = HUGE_VAL;
        for (int64_t j = 0; j < m; j++) {
            target[j] = p->p11[j] * here->q[j] + p->p12[j] * v0[j];
            q1[j] = here->q[j] + rule->step * v0[j];
        }
        configure(body, q1, there);
        configure_halfway(body, here, there, &middle);
        int settled = 0, stale = 1;
        for (int round = 1; !settled; round++) {
            double correction = 0.0, blur = 0.0, blurred = 0.0;
            ++*rounds;
            if (round > 1) {
                configure(body, q1, there);
                configure_halfway(body, here, there, &middle);
            }
            if (stale && !pull_at(body, p, rule, &middle, scratch, unit, &pull)) return UNSETTLED;
            for (int64_t j = 0; j < m; j++) {
                way[j] = q1[j] - here->q[j];
                rate[j] = way[j] / rule->step;
            }
            modal_force(body, &loads, 1, &middle, 0, scratch, force);
            const double square = dot(way, way, m);
            if (potential && square > 0.0) {
                const double end_work = force_work(body, &loads, there) - tension(body, there, tense);
                const double *conservative = force;
                if (loads.has_moments) {
                    modal_force(body, &loads, 0, &middle, 0, scratch, bare);
                    conservative = bare;
                }
                const double bracket = end_work - start_work - dot(conservative, way, m);
                /* The springs' strain is a difference of places. */
                const double round_off =
                    ROUND_OFF * (reach + fabs(end_work) + work_reach(body, tense, 4 * body->ties));
                if (fabs(bracket) > round_off) correction = bracket / square, blur = NOISE * round_off / square;
            }
            for (int64_t j = 0; j < m; j++) {
                mean[j] = force[j] + correction * way[j] + dot(body->tie_initial + j * m, middle.q, m) -
                          dot(body->material + j * m, rate, m);
                off[j] = q1[j] - target[j] - p->gq[j] * mean[j];
                blurred += p->gq[j] * way[j] * p->gq[j] * way[j];
            }
            respond(body, rule, &pull, off, change);
            for (int64_t j = 0; j < m; j++) q1[j] -= change[j];
            const double size = norm(change, m), enough = TIED_TOLERANCE * (norm(q1, m) + rule->step * speed);
            if (!isfinite(size)) return UNSETTLED;
            settled = size <= fmax(fmax(enough, body->noise), blur * sqrt(blurred));
            if (!settled && (size > 0.5 * earlier || round >= TIED_ROUNDS)) return UNSETTLED;
            stale = size > FAST * last;
            earlier = last;
            last = size;
        }
        configure(body, q1, there);
        configure_halfway(body, here, there, &middle);
        /* Error: what the force's change does beyond its mean, at the tension in the middle. */
        tension(body, &middle, tense);
        modal_force(body, &loads, 1, there, tense, scratch, force);
        modal_force(body, &loads, 1, here, tense, scratch, bare);
        for (int64_t j = 0; j < m; j++) {
            way[j] = q1[j] - here->q[j];
            v0[j] = p->p21[j] * here->q[j] + p->p22[j] * v0[j] + p->gv[j] * mean[j];
        }
        double error = 0.0;
        rows_times(body->tie_initial, q1, end_linear, m, m);
        for (int64_t j = 0; j < m; j++) {
            rate[j] = body->omega[j] * body->omega[j] * way[j];
            off[j] = p->gq[j] * (force[j] - bare[j] + end_linear[j] - linear[j] - rate[j]);
        }
        respond(body, rule, &pull, off, change);
        for (int64_t j = 0; j < m; j++) {
            const double moved = rule->lag[j] * change[j], followed = moved + p->ramp[j] * rate[j];
            const double lost = body->omega[j] * fmin(fabs(moved), fabs(followed));
            error += lost * lost;
        }
        /* Work of the loads: forces by their potential, moments by their value in the middle. */
        double work = potential ? force_work(body, &loads, there) - load_work : 0.0;
        memset(tense, 0, 12 * body->ties * sizeof(double));
        if (!potential || loads.has_moments) {
            modal_force(body, &loads, 1, &middle, tense, scratch, force);
            work += dot(force, way, m);
        }
        if (potential && loads.has_moments) {
            modal_force(body, &loads, 0, &middle, tense, scratch, force);
            work -= dot(force, way, m);
        }
        const double energy = strain_of(body, q1, tension(body, there, tense), end_linear) + dot(v0, v0, m);
        const double bound = start_energy + 2.0 * fabs(work) + noise * noise + 2.0 * ROUND_OFF * (reach + energy);
        error = sqrt(error) + (!(energy <= bound) ? sqrt(energy) - sqrt(bound) : 0.0);
        error = !(error <= noise) ? error / sqrt(fmin(energy, bound)) : 0.0;
        start_energy = energy;
        memcpy(linear, end_linear, m * sizeof(double));
        if (!(error <= *worst)) *worst = error;
        if (!(*worst <= tolerance)) return INACCURATE;
        Configuration *passed = here;
        here = there;
        there = passed;
    }
    memcpy(q, here->q, m * sizeof(double));
    memcpy(v, v0, m * sizeof(double));
    return DONE;
}

/* One step where no load depends on q: exact. Returns 0, or 1 where a load does. */
EXPORT int64_t kernel_linear_step(const Body *body, const Propagator *p, const double *inputs, const double *inputs_end,
                                  double *q, double *v) {
    const int64_t m = body->modes;
    double *free = body->work;
    Loads loads;
    take_loads(body, &free, &loads);
    double *growth = take(&free, m), *mean = take(&free, m);
    spread(body, inputs, &loads);
    if (loads.active) return 1;
    memcpy(mean, loads.constant, m * sizeof(double));
    memset(growth, 0, m * sizeof(double));
    if (inputs_end) {
        for (int64_t j = 0; j < m; j++) growth[j] = -loads.constant[j];
        spread(body, inputs_end, &loads);
        if (loads.active) return 1;
        for (int64_t j = 0; j < m; j++) {
            growth[j] += loads.constant[j];
            mean[j] += 0.5 * growth[j];
        }
    }
    for (int64_t j = 0; j < m; j++) {
        const double start = q[j];
        q[j] = p->p11[j] * start + p->p12[j] * v[j] + p->gq[j] * mean[j] + p->ramp[j] * growth[j];
        v[j] = p->p21[j] * start + p->p22[j] * v[j] + p->gv[j] * mean[j] + p->ramp_rate[j] * growth[j];
    }
    return 0;
}

/* Largest rotation within a frame, rad: Turning of indicators.py. */
EXPORT double kernel_largest_rotation(const Body *body, const double *q) {
    double largest = 0.0;
    for (int64_t i = 0; i < body->turnings; i++) {
        double square = 0.0;
        for (int c = 0; c < 3; c++) {
            const double x = dot(body->turning + (3 * i + c) * body->modes, q, body->modes);
            square += x * x;
        }
        if (!(square <= largest)) largest = square;
    }
    return sqrt(largest);
}

/* ∂Q/∂q (m, m) by differences with the steps `change` (m); row j is the derivative with respect to q_j. */
EXPORT void kernel_force_derivative(const Body *body, const double *inputs, const double *q, const double *change,
                                    double *out) {
    const int64_t m = body->modes;
    double *free = body->work;
    Configuration at;
    Loads loads;
    take_configuration(body, &free, &at);
    take_loads(body, &free, &loads);
    double *scratch = take(&free, scratch_size(body));
    double *moved = take(&free, m), *here = take(&free, m), *ahead = take(&free, m);
    spread(body, inputs, &loads);
    memcpy(moved, q, m * sizeof(double));
    configure(body, moved, &at);
    modal_force(body, &loads, 1, &at, 0, scratch, here);
    for (int64_t j = 0; j < m; j++) {
        moved[j] = q[j] + change[j];
        configure(body, moved, &at);
        modal_force(body, &loads, 1, &at, 0, scratch, ahead);
        moved[j] = q[j];
        for (int64_t i = 0; i < m; i++) out[j * m + i] = (ahead[i] - here[i]) / change[j];
    }
}

/* Rotation vector of a rotation matrix by its unit quaternion, as rotations.py. */
static void rotation_vector(const double *r, double *out) {
    const double trace = r[0] + r[4] + r[8];
    const double axial[3] = {r[7] - r[5], r[2] - r[6], r[3] - r[1]};
    const double diagonal[4] = {r[0], r[4], r[8], trace};
    double quaternion[4];
    int best = 0;
    for (int i = 1; i < 4; i++)
        if (diagonal[i] > diagonal[best]) best = i;
    if (best == 3) {
        memcpy(quaternion, axial, sizeof axial);
        quaternion[3] = 1.0 + trace;
    } else {
        for (int i = 0; i < 3; i++) quaternion[i] = r[3 * i + best] + r[3 * best + i];
        quaternion[best] = 1.0 + 2.0 * r[4 * best] - trace;
        quaternion[3] = axial[best];
    }
    double length = 1.0 / sqrt(dot(quaternion, quaternion, 4));
    if (quaternion[3] < 0.0) length = -length;
    for (int i = 0; i < 4; i++) quaternion[i] *= length;
    const double sine = sqrt(dot(quaternion, quaternion, 3));
    const double scale = sine > 0.0 ? 2.0 * atan2(sine, quaternion[3]) / sine : 2.0;
    for (int i = 0; i < 3; i++) out[i] = scale * quaternion[i];
}

/* Velocity and angular velocity of each node for rates q' = v, by differentiating the pass outwards; `rates` (6K). */
static void move(const Body *body, const Configuration *at, const double *v, double *scratch, double *rates,
                 double *velocity, double *spin) {
    const int64_t k_count = body->nodes;
    rows_times(body->operator_, v, rates, 6 * k_count, body->modes);
    if (body->curvature) {
        part_coordinates(body, v, scratch);
        for (int64_t i = 0; i < 6 * k_count; i++)
            if (body->part[i] >= 0)
                rates[i] += dot(at->turned + i * body->modes, scratch + body->part[i] * body->modes,
                                body->extent[body->part[i]]);
    }
    for (int64_t k = 0; k < k_count; k++) {
        const int64_t p = body->parent[k];
        const double *parent = at->parent + 9 * k;
        double relative[3], turned[3], carried[3] = {0.0, 0.0, 0.0}, stretched[3], arm[3];
        apply(at->jacobian + 9 * k, rates + 3 * (k_count + k), relative);
        apply(parent, relative, turned);
        apply(parent, rates + 3 * k, stretched);
        if (p >= 0) {
            apply(parent, at->local + 3 * k, arm);
            cross(spin + 3 * p, arm, carried);
        }
        for (int i = 0; i < 3; i++) {
            spin[3 * k + i] = (p < 0 ? 0.0 : spin[3 * p + i]) + turned[i];
            velocity[3 * k + i] = (p < 0 ? 0.0 : velocity[3 * p + i]) + carried[i] + stretched[i];
        }
    }
}

/* Displacement and rotation vector of each interface, (I, 2, 3); velocity and angular velocity, the same, unless null. */
EXPORT void kernel_motion(const Body *body, const double *q, const double *v, double *out, double *rate) {
    double *free = body->work;
    Configuration at;
    take_configuration(body, &free, &at);
    configure(body, q, &at);
    for (int64_t i = 0; i < body->interfaces; i++) {
        const int64_t k = body->frames + i;
        for (int c = 0; c < 3; c++) out[6 * i + c] = at.position[3 * k + c] - body->point[3 * k + c];
        rotation_vector(at.rotation + 9 * k, out + 6 * i + 3);
    }
    if (!rate) return;
    double *rates = take(&free, 6 * body->nodes), *velocity = take(&free, 3 * body->nodes);
    double *spin = take(&free, 3 * body->nodes);
    move(body, &at, v, take(&free, body->parts * body->modes), rates, velocity, spin);
    for (int64_t i = 0; i < body->interfaces; i++) {
        memcpy(rate + 6 * i, velocity + 3 * (body->frames + i), 3 * sizeof(double));
        memcpy(rate + 6 * i + 3, spin + 3 * (body->frames + i), 3 * sizeof(double));
    }
}
