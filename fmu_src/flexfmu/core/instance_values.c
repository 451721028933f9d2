#include "instance_values.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* In times of the body. */
static double usual_step(const Instance *x) {
    return x->single[S_LAST_STEP] > 0.0 ? x->scale.pace * x->single[S_LAST_STEP] : description(x)->suggested_step[0];
}

/* Inputs of the last step as they act on the body, in a workspace. */
static const double *acting(Instance *x) {
    scale_inputs(&x->scale, description(x), x->previous, x->over->end_inputs);
    return x->over->end_inputs;
}

/* Diagnostics: `diagnose_symbol` of each in interface.def. Of the state alone. */
static double diagnose_rotation(Instance *x) { return body_rotations(x->body, x->q, 0); }

static double diagnose_strain(Instance *x) { return body_strain(x->body, x->q); }

/* Inputs set since the last step have not acted yet, and need not be finite. */
static double diagnose_stability(Instance *x) { return body_stability(x->body, acting(x), x->q, 0); }
static double diagnose_missed(Instance *x) { return body_missed(x->body, acting(x), 0); }

/* Errors by the shadow; -1 where there is none. */
static void judge(Instance *x) {
    double deflection = x->single[S_SEEN];
    if (x->cached & CACHED_ERROR) return;
    x->cached |= CACHED_ERROR;
    x->error = x->bound = -1.0;
    for (int64_t i = 0; i < 2 * description(x)->interfaces; i++) x->errors[i] = -1.0;
    if (x->shadow) body_error(x->body, x->shadow, acting(x), x->q, x->errors, &deflection, &x->error, &x->bound);
}

static double diagnose_error(Instance *x) {
    judge(x);
    return x->error;
}

static double diagnose_spin(Instance *x) { return body_spin(x->body, x->q, x->v); }

static double diagnose_momentum(Instance *x) { return of_course(x, offsetof(Course, momentum.drift)); }
static double diagnose_truncation(Instance *x) { return of_course(x, offsetof(Course, truncation.error)); }
static double diagnose_inertia(Instance *x) { return of_course(x, offsetof(Course, astray.error[BY_MASS])); }
static double diagnose_astray(Instance *x) { return of_course(x, offsetof(Course, astray.error[BY_STEPS])); }

static double diagnose_softness(Instance *x) { return of_course(x, offsetof(Course, astray.error[BY_SOFTNESS])); }

static double diagnose_step_error(Instance *x) { return x->single[S_ERROR]; }

static double diagnose_strain_energy(Instance *x) {
    double strain, kinetic;
    body_energies(x->body, x->q, x->v, &strain, &kinetic);
    return x->scale.stiffness * strain;
}

static double diagnose_kinetic_energy(Instance *x) {
    double strain, kinetic;
    body_energies(x->body, x->q, x->v, &strain, &kinetic);
    return x->scale.stiffness * kinetic;
}

static double diagnose_iterations(Instance *x) { return x->single[S_ITERATIONS]; }
static double diagnose_substeps(Instance *x) { return x->single[S_SUBSTEPS]; }

/* One that the table has and this file has not is an error of the compiler. */
static double (*const DIAGNOSE[])(Instance *) = {
#define DIAGNOSTIC(symbol, ...) diagnose_##symbol,
#include "interface.def"
};

/* What the roles of interface.def name: each finds its values when one of them is first asked for. */
static Answer ready(Instance *x, char *why) {
    (void)x, (void)why;
    return ANSWER_OK;
}

static Answer instance_begun(Instance *x, char *why) {
    return begun(x) || instance_begin(x, why) == ANSWER_OK ? ANSWER_OK : instance_failed(x, ANSWER_FAILED);
}

static Answer find_motion(Instance *x, char *why) {
    if (instance_begun(x, why) != ANSWER_OK) return ANSWER_FAILED;
    if (!(x->cached & CACHED_MOTION) && !find_motion_at(x, x->q, x->v)) return instance_lacks_room(x, why);
    x->cached |= CACHED_MOTION;
    return ANSWER_OK;
}

static Answer find_stress(Instance *x, char *why) {
    if (instance_begun(x, why) != ANSWER_OK) return ANSWER_FAILED;
    if (x->cached & CACHED_STRESS) return ANSWER_OK;
    body_stress(x->body, x->q, x->stress);
    for (int64_t i = 0; i < description(x)->stress_sets; i++) x->stress[i] *= x->scale.stiffness;
    x->cached |= CACHED_STRESS;
    return ANSWER_OK;
}

static Answer find_compliance(Instance *x, char *why) {
    if (instance_begun(x, why) != ANSWER_OK) return ANSWER_FAILED;
    const Program *p = description(x);
    if (x->cached & CACHED_COMPLIANCE) return ANSWER_OK;
    if (body_compliance(x->body, acting(x), usual_step(x), x->q, p->compliance_interface, p->compliances, x->compliance) != FLEX_OK)
        return instance_lacks_room(x, why);
    for (int64_t i = 0; i < 36 * p->compliances * p->compliances; i++) x->compliance[i] *= x->scale.force;
    x->cached |= CACHED_COMPLIANCE;
    return ANSWER_OK;
}

/* Variables go by pairs of interfaces: of the first by loads on the second, row by row. */
static int64_t compliance_place(const Program *p, int64_t index) {
    const int64_t n = p->compliances, pair = index / 36, row = index % 36 / 6, column = index % 6;
    return (6 * (pair / n) + row) * 6 * n + 6 * (pair % n) + column;
}

static Answer find_errors(Instance *x, char *why) {
    if (instance_begun(x, why) != ANSWER_OK) return ANSWER_FAILED;
    judge(x);
    return ANSWER_OK;
}

Answer get_numbers(Instance *x, int64_t variable, int64_t count, double *values, char *why) {
    const Program *p = description(x);
    const int64_t first = p->variable_index[variable];
    Answer answer = ANSWER_FAILED;
    switch (p->variable_role[variable]) {
#define ROLE(symbol, causality, axes, most, find, ...) \
    case ROLE_##symbol: \
        if ((answer = find(x, why)) != ANSWER_OK) break; \
        for (int64_t index = first; index < first + count; index++) values[index - first] = __VA_ARGS__; \
        break;
#include "interface.def"
    }
    return answer;
}

Answer instance_derivative(Instance *x, const int64_t *outputs, int64_t output_count, const int64_t *inputs,
                           int64_t input_count, const double *direction, double *result, char *why) {
    const Program *p = description(x);
    char room[TEXT_SIZE / 4];
    for (int64_t i = 0; i < output_count; i++)
        if (p->variable_role[outputs[i]] != ROLE_MOTION) {
            snprintf(why, TEXT_SIZE, "derivatives are offered of displacements and rotations, not of %s", variable_text(x, outputs[i], 0, room));
            return ANSWER_REFUSED;
        }
    for (int64_t i = 0; i < input_count; i++)
        if (p->variable_role[inputs[i]] != ROLE_INPUT) {
            snprintf(why, TEXT_SIZE, "derivatives are offered by inputs, not by %s", variable_text(x, inputs[i], 0, room));
            return ANSWER_REFUSED;
        }
    if (instance_begun(x, why) != ANSWER_OK) return ANSWER_FAILED;
    memset(x->over->start_inputs, 0, (size_t)x->loads * sizeof(double));
    for (int64_t i = 0; i < input_count; i++) x->over->start_inputs[p->variable_index[inputs[i]]] += direction[i];
    scale_inputs(&x->scale, p, x->over->start_inputs, x->over->start_inputs);
    if (body_derivative(x->body, acting(x), usual_step(x), x->q, x->over->start_inputs, x->rates) != FLEX_OK) return instance_lacks_room(x, why);
    x->cached &= ~CACHED_MOTION;
    for (int64_t i = 0; i < output_count; i++) {
        result[i] = x->rates[p->variable_index[outputs[i]]];
        if (isfinite(result[i])) continue;
        snprintf(why, TEXT_SIZE, "the derivative of %s is not finite: the loads, the direction or the step are too large for the arithmetic", variable_text(x, outputs[i], 0, room));
        return ANSWER_REFUSED;
    }
    return ANSWER_OK;
}
