/* The step of stepping.py and the outputs of body.py, compiled. A transcription of tree.py, dynamics.py and stepping.py
 * for speed alone: the same formulas, the same tolerances, the same results to round-off. What it cannot settle by fixed
 * point it leaves to Newton's method there. No global data: everything is in the struct Body, whose arrays belong to the
 * caller, row by row (C order), in SI units. Equation numbers are those of docs/theory.md. */

#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Raised whenever the struct or a signature changes; kernel.py asks for it. */
#define KERNEL_VERSION 4

enum { REFERENCE = 0, CORRECTIVE_MOMENT = 1, DEFORMED = 2 };
enum { DONE = 0, UNSETTLED = 1, INACCURATE = 2 };

/* As in stepping.py. */
static const double TOLERANCE = 1e-12, SETTLED = 1e-5, ROUND_OFF = 64.0 * 2.220446049250313e-16;
enum { ROUNDS = 6 };

typedef struct {
    int64_t modes, nodes, frames, interfaces, masses, placement, nonlinear, turnings;
    const int64_t *parent;                                /* (K), -1 for the ground */
    const double *offset, *base, *point;                  /* (K, 3) */
    const double *operator_;                              /* (6K, m): D of all nodes, then C of all nodes */
    const double *curvature;                              /* (6K, m, m): their derivatives, or null */
    const int64_t *curved;                                /* (6K): whether there is any */
    const double *load_operator;                          /* (6I, m): displacements, then rotations */
    const double *mass;                                   /* (P) */
    const double *inertia;                                /* (3, m) */
    const double *by_load;                                /* (6I or 6I + 3, m, m), or null */
    const double *by_mode;                                /* (m, m, m), or null */
    const double *omega, *weight;                         /* (m) */
    const double *turning;                                /* (3T, m): rotations within frames */
    double *work;                                         /* see kernel_work_size */
} Body;

typedef struct {
    const double *p11, *p12, *p21, *p22, *gq, *gv, *ramp, *ramp_rate; /* (m) */
} Propagator;

/* A configuration: what follows from q. */
typedef struct {
    double *q;                              /* (m) */
    double *local;                          /* (6K): b and φ of all nodes */
    double *varying;                        /* (6K, m): their derivatives, where the tree has a curvature */
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

/* Derivatives (6K, m) of b and φ at a configuration. */
static const double *derivative(const Body *body, const Configuration *at) {
    return body->curvature ? at->varying : body->operator_;
}

/* The pass outwards, (5) and (6). */
static void configure(const Body *body, const double *q, Configuration *at) {
    const int64_t k_count = body->nodes;
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    if (at->q != q) memcpy(at->q, q, body->modes * sizeof(double));
    rows_times(body->operator_, q, at->local, 6 * k_count, body->modes);
    if (body->curvature) {
        const int64_t m = body->modes;
        memcpy(at->varying, body->operator_, 6 * k_count * m * sizeof(double));
        for (int64_t i = 0; i < 6 * k_count; i++) {
            if (!body->curved[i]) continue;
            double *row = at->varying + i * m;
            rows_times(body->curvature + i * m * m, q, row, m, m);
            at->local[i] += 0.5 * dot(row, q, m);
            for (int64_t j = 0; j < m; j++) row[j] += body->operator_[i * m + j];
        }
    }
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
    loads->active = body->by_mode != 0 || (body->nonlinear && (any || loads->has_moments));
}

/* The pass back: Q(q), modal_force() of dynamics.py. `scratch` holds 12K + m². */
static void modal_force(const Body *body, const Loads *loads, int with_moments, const Configuration *at,
                        double *scratch, double *out) {
    const int64_t m = body->modes, k_count = body->nodes;
    const double *constant = with_moments ? loads->constant : loads->force_constant;
    memset(out, 0, m * sizeof(double));
    if (body->placement == DEFORMED) {
        double *force = scratch, *moment = force + 3 * k_count, *row = moment + 3 * k_count;
        memcpy(force, loads->force, 3 * k_count * sizeof(double));
        if (with_moments)
            memcpy(moment, loads->moment, 3 * k_count * sizeof(double));
        else
            memset(moment, 0, 3 * k_count * sizeof(double));
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
        add_times_rows(row, derivative(body, at), out, 6 * k_count, m);
    } else {
        memcpy(out, constant, m * sizeof(double));
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

/* J(q) of the forces; whether there is one is has_potential(). */
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

static int has_potential(const Body *body) { return body->placement != CORRECTIVE_MOMENT && body->by_mode == 0; }

static double *take(double **free, int64_t count) {
    double *start = *free;
    *free += count;
    return start;
}

static void take_configuration(const Body *body, double **free, Configuration *at) {
    at->q = take(free, body->modes);
    at->local = take(free, 6 * body->nodes);
    at->varying = take(free, body->curvature ? 6 * body->nodes * body->modes : 0);
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

/* Numbers of type double that `work` must hold. */
EXPORT int64_t kernel_work_size(int64_t modes, int64_t nodes, int64_t interfaces, int64_t curved) {
    return 2 * (modes + 36 * nodes + (curved ? 6 * nodes * modes : 0)) + 6 * nodes + 2 * modes + 2 * modes * modes + 12 * nodes + modes * modes +
           12 * modes + 6 * interfaces + 3;
}

/* Equal sub-steps from (q, v), which are overwritten where the result is DONE: _substeps() of stepping.py.
 * `inputs_end` is null for loads that are constant over the step. */
EXPORT int64_t kernel_substeps(const Body *body, const Propagator *p, const double *inputs, const double *inputs_end,
                               double *q, double *v, int64_t substeps, double tolerance, int64_t *rounds,
                               double *worst) {
    const int64_t m = body->modes, width = 6 * body->interfaces + (body->masses ? 3 : 0);
    double *free = body->work;
    Configuration middle, here;
    Loads loads;
    take_configuration(body, &free, &middle);
    take_configuration(body, &free, &here);
    take_loads(body, &free, &loads);
    double *scratch = take(&free, 12 * body->nodes + m * m);
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
        modal_force(body, &loads, 1, &here, scratch, start);
        start_work = force_work(body, &loads, &here);
    }
    for (int64_t number = 0; number < substeps; number++) {
        if (inputs_end) {
            const double share = ((double)number + 0.5) / (double)substeps;
            for (int64_t i = 0; i < width; i++) between[i] = inputs[i] + share * (inputs_end[i] - inputs[i]);
            spread(body, between, &loads);
            modal_force(body, &loads, 1, &here, scratch, start);
            start_work = force_work(body, &loads, &here);
        }
        double reach = fabs(start_work), speed = 0.0;
        for (int64_t i = 0; i < 3 * body->nodes; i++) reach += fabs(loads.force[i]) * fabs(body->point[i]);
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
            modal_force(body, &loads, 1, &middle, scratch, force);
            const int corrected = size <= SETTLED;
            if (corrected && potential && square > 0.0) {
                configure(body, q1, &here);
                end_work = force_work(body, &loads, &here);
                const double *conservative = force;
                if (loads.has_moments) {
                    modal_force(body, &loads, 0, &middle, scratch, bare);
                    conservative = bare;
                }
                const double bracket = end_work - start_work - dot(conservative, difference, m);
                correction = fabs(bracket) > ROUND_OFF * (reach + fabs(end_work)) ? bracket / square : 0.0;
            }
            double change = 0.0, scale = 0.0;
            for (int64_t j = 0; j < m; j++) {
                mean[j] = force[j] + correction * difference[j];
                const double next = target[j] + p->gq[j] * mean[j];
                const double moved = body->weight[j] * (q1[j] - next), sized = body->weight[j] * next;
                change += moved * moved;
                scale += sized * sized;
                q1[j] = next;
            }
            scale = sqrt(scale) + speed;
            size = scale > 0.0 ? sqrt(change) / scale : 0.0;
            if (!isfinite(size)) return UNSETTLED;
            settled = corrected && size <= TOLERANCE;
        }
        if (!settled) return UNSETTLED;
        double error = 0.0, energy = 0.0;
        for (int64_t j = 0; j < m; j++) {
            const double rate = p->p21[j] * q0[j] + p->p22[j] * v0[j] + p->gv[j] * mean[j];
            v0[j] = rate + p->ramp_rate[j] * growth[j];
            q0[j] = q1[j] + p->ramp[j] * growth[j];
        }
        configure(body, q0, &here);
        modal_force(body, &loads, 1, &here, scratch, end);
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
    double *scratch = take(&free, 12 * body->nodes + m * m);
    double *moved = take(&free, m), *here = take(&free, m), *ahead = take(&free, m);
    spread(body, inputs, &loads);
    memcpy(moved, q, m * sizeof(double));
    configure(body, moved, &at);
    modal_force(body, &loads, 1, &at, scratch, here);
    for (int64_t j = 0; j < m; j++) {
        moved[j] = q[j] + change[j];
        configure(body, moved, &at);
        modal_force(body, &loads, 1, &at, scratch, ahead);
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
static void move(const Body *body, const Configuration *at, const double *v, double *rates, double *velocity,
                 double *spin) {
    const int64_t k_count = body->nodes;
    rows_times(derivative(body, at), v, rates, 6 * k_count, body->modes);
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
    move(body, &at, v, rates, velocity, spin);
    for (int64_t i = 0; i < body->interfaces; i++) {
        memcpy(rate + 6 * i, velocity + 3 * (body->frames + i), 3 * sizeof(double));
        memcpy(rate + 6 * i + 3, spin + 3 * (body->frames + i), 3 * sizeof(double));
    }
}
