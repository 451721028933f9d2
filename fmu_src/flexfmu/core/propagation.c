#include "propagation.h"

#include <math.h>

#include "algebra.h"
#include "opened.h"

/* Newer versions of the C library have others of these functions, with the same digits: by the old ones the library loads
 * with glibc 2.17, too. */
#if defined(__GLIBC__) && defined(__x86_64__)
__asm__(".symver exp, exp@GLIBC_2.2.5");
#elif defined(__GLIBC__) && defined(__aarch64__)
__asm__(".symver exp, exp@GLIBC_2.17");
#endif

/* Angle by which a mode that the step resolves turns in it at the most, of a body with ties, rad. */
static const double RESOLVED = 1.5;
/* Below this h omega the response to a ramp is taken from its series, where the closed form would cancel. */
static const double SMALL_ANGLE = 1e-2;

void propagate(const Rule *r, int64_t j, double w, double z) {
    const double h = r->step, x = w * h, root = sqrt(fabs(1.0 - z * z)) * x;
    const double decay = exp(-z * x);
    double cosine, sinc, lack;
    if (z > 1.0) {
        /* The two real exponentials, which cannot overflow. */
        const double slow = exp(-z * x + root), fast = exp(-z * x - root), half = expm1(-root);
        cosine = 0.5 * (slow + fast);
        sinc = -0.5 * slow * expm1(-2.0 * root) / root;
        lack = -0.5 * slow * half * half;
    } else {
        const double half = sin(0.5 * root);
        cosine = decay * cos(root);
        sinc = decay * sin(root) / root;
        lack = 2.0 * decay * half * half;
    }
    /* Next to critical damping, and for the shortest steps, two terms of the series are exact. */
    if (root < 1e-5) sinc = decay * (1.0 - (1.0 - z * z) * x * x / 6.0);
    r->p11[j] = cosine + z * x * sinc;
    r->p12[j] = h * sinc;
    r->p21[j] = -w * w * r->p12[j];
    r->p22[j] = cosine - z * x * sinc;
    /* 1 - P11 without cancelling: what the cosine lacks of the decay, then what the decay lacks of 1. */
    r->gq[j] = w == 0.0 ? 0.5 * h * h : (lack - expm1(-z * x) - z * x * sinc) / (w * w);
    r->gv[j] = r->p12[j];
    const double end = x < SMALL_ANGLE ? h * h / 6.0 * (1.0 - z * x / 2.0)
                                       : (h - r->gv[j] - 2.0 * z * w * r->gq[j]) / (w * w * h);
    r->ramp[j] = end - 0.5 * r->gq[j];
    r->ramp_rate[j] = r->gq[j] / h - 0.5 * r->gv[j];
    r->lag[j] = 0.0;
}

void propagate_middle(const Rule *r, int64_t j, double stiffness, double rate) {
    const double h = r->step, a = 0.25 * stiffness * h * h, b = 0.5 * rate * h, whole = 1.0 + a + b;
    r->p11[j] = (1.0 - a + b) / whole;
    r->p12[j] = h / whole;
    r->p21[j] = -stiffness * h / whole;
    r->p22[j] = (1.0 - a - b) / whole;
    r->gq[j] = 0.5 * h * h / whole;
    r->gv[j] = h / whole;
}

/* Of a body with ties: modes that the step does not resolve go by the rule of the middle (17). */
static void tie_rule(Body *body, Rule *r) {
    const int64_t m = body->p->modes;
    for (int64_t j = 0; j < m; j++) {
        if (body->p->omega[j] * r->step > RESOLVED) {
            propagate_middle(r, j, body->opened->stiffness[j], body->rate[j]);
            /* No shorter step is wanted for what vibrates faster than the step can tell: there is always more of it. */
            r->ramp[j] = 0.0;
        }
        r->lag[j] = r->ramp[j] == 0.0 ? 0.0 : r->ramp[j] / r->gq[j];
    }
}

/* The response (17a) of modes that damp each other. */
static void response_rule(Body *body, Rule *r) {
    const int64_t m = body->p->modes;
    double *matrix = body->square;
    for (int64_t i = 0; i < m; i++)
        for (int64_t j = 0; j < m; j++) {
            const double held = body->p->tied ? 0.5 * body->p->tie_initial[i * m + j] : 0.0;
            const double coupling = body->coupled[i * m + j] / r->step - held;
            matrix[i * m + j] = r->gq[i] * coupling + (i == j ? 1.0 : 0.0);
            r->response[i * m + j] = i == j ? 1.0 : 0.0;
        }
    if (lu_factor(matrix, body->pivot, m, 0))
        lu_solve(matrix, body->pivot, r->response, m, m, 0);
    else
        for (int64_t i = 0; i < m * m; i++) r->response[i] = NAN;
}

void take_rule(const Body *body, Arena *arena, Rule *r) {
    double **each[RULE_ROWS] = {&r->p11, &r->p12, &r->p21, &r->p22, &r->gq, &r->gv, &r->ramp, &r->ramp_rate, &r->lag};
    for (int k = 0; k < RULE_ROWS; k++) *each[k] = take(arena, body->p->modes);
}

void take_rules(Body *body, Arena *arena) {
    const int64_t m = body->p->modes;
    body->rule_limit = body->p->tied ? TIED_RULES : RULES;
    for (int i = 0; i < body->rule_limit; i++) {
        take_rule(body, arena, body->rules + i);
        body->rules[i].response = take(arena, crossed(body->p) * m * m);
    }
    body->rule_count = body->rule_next = 0;
}

const Rule *rule_of(Body *body, double step) {
    for (int i = 0; i < body->rule_count; i++)
        if (body->known[i]->step == step) return body->known[i];
    Rule *r = body->rules + body->rule_next;
    const Rule **known = body->known + body->rule_next;
    body->rule_next = (body->rule_next + 1) % body->rule_limit;
    if (body->rule_count < body->rule_limit) body->rule_count++;
    const int alike = !crossed(body->p);
    *known = alike ? find_rule(body->opened, step, body->damping_scale) : 0;
    if (*known) return *known;
    r->step = step;
    for (int64_t j = 0; j < body->p->modes; j++) {
        const double w = body->p->omega[j];
        propagate(r, j, w, body->p->tied ? body->rate[j] / (2.0 * w) : body->zeta[j]);
    }
    if (body->p->tied) tie_rule(body, r);
    if (crossed(body->p)) response_rule(body, r);
    const Rule *kept = alike ? keep_rule(body->opened, r, body->damping_scale) : 0;
    return *known = kept ? kept : r;
}
