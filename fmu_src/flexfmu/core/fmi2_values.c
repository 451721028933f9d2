/* FMI 2.0: values of variables, and derivatives. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "algebra.h"
#include "component.h"
#include "instance_values.h"

/* Lengths of the first runs of a call's references, once they are known. */
typedef struct {
    size_t known, length[8];
} Runs;

/* The next run, which is number `at` of them. */
static size_t next_run(Component *c, Runs *runs, size_t at, const fmi2ValueReference references[], size_t count, int type, const char *call) {
    if (at < runs->known) return runs->length[at];
    const size_t run = run_of(c, references, count, type, call);
    if (at < sizeof runs->length / sizeof *runs->length) runs->length[runs->known++] = run;
    return run;
}

/* Values of variables of one type as numbers, one after another. */
static fmi2Status numbers_of(fmi2Component handle, const fmi2ValueReference references[], size_t count, int type,
                             const char *call, void *values) {
    Component *c = given(allowed(handle, READABLE, call), !count || (references && values), call);
    if (!c) return fmi2Error;
    const Program *p = instance_description(c->body);
    Runs runs = {0, {0}};
    for (size_t i = 0, at = 0, run; i < count; i += run)
        if (!(run = next_run(c, &runs, at++, references + i, count - i, type, call))) return fmi2Error;
    for (size_t i = 0, at = 0, run; i < count; i += run) {
        double number, *to = type == TYPE_REAL ? (double *)values + i : &number;
        run = type == TYPE_REAL ? next_run(c, &runs, at++, references + i, count - i, type, call) : 1;
        if (get_numbers(c->body, (int64_t)references[i], (int64_t)run, to, c->text) != ANSWER_OK) return fail(c, c->text);
        const int64_t role = p->variable_role[references[i]];
        /* Inputs and parameters are what the master set. */
        if (role != ROLE_INPUT && role != ROLE_PARAMETER && !all_finite(to, (int64_t)run)) {
            int64_t k = 0;
            while (isfinite(to[k])) k++;
            snprintf(c->text, TEXT_SIZE, "%s: %s has no finite value: the loads are too large for the arithmetic; lower them", call,
                     variable_text(c->body, (int64_t)references[i] + k, 0, c->room));
            return fail(c, c->text);
        }
        if (type != TYPE_REAL) ((fmi2Integer *)values)[i] = number > 2147483647.0 ? 2147483647 : (fmi2Integer)number;
    }
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    return numbers_of(c, vr, n, TYPE_REAL, "fmi2GetReal", value);
}

FMI_EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    return numbers_of(c, vr, n, TYPE_INTEGER, "fmi2GetInteger", value);
}

FMI_EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
    return numbers_of(c, vr, n, TYPE_BOOLEAN, "fmi2GetBoolean", value);
}

FMI_EXPORT fmi2Status fmi2GetString(fmi2Component handle, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    Component *c = given(allowed(handle, READABLE, "fmi2GetString"), !n || (vr && value), "fmi2GetString");
    if (!c) return fmi2Error;
    for (size_t i = 0; i < n; i++)
        if (variable_of(c, vr[i], TYPE_STRING, "fmi2GetString") < 0) return fmi2Error;
    char *kept = realloc(c->strings, (n ? n : 1) * sizeof c->room);
    if (!kept) return fail(c, "fmi2GetString: there is not enough memory");
    c->strings = kept;
    for (size_t i = 0; i < n; i++) {
        double chosen = 0.0;
        if (get_numbers(c->body, (int64_t)vr[i], 1, &chosen, c->text) != ANSWER_OK) return fail(c, c->text);
        char *text = kept + i * sizeof c->room;
        if (!*variable_text(c->body, (int64_t)vr[i], 1 + (int64_t)chosen, text)) *text = 0;
        value[i] = text;
    }
    return fmi2OK;
}

/* Whether all references are settable ones of a type, in runs. Sets are whole or refused. */
static Component *settable_runs(fmi2Component handle, const fmi2ValueReference vr[], size_t n, int type, const char *call, const void *value, Runs *runs) {
    Component *c = given(allowed(handle, SETTABLE, call), !n || (vr && value), call);
    if (!c) return 0;
    const Program *p = instance_description(c->body);
    for (size_t i = 0, at = 0, run; i < n; i += run) {
        if (!(run = next_run(c, runs, at++, vr + i, n - i, type, call))) return 0;
        if (p->variable_role[vr[i]] == ROLE_INPUT || p->variable_role[vr[i]] == ROLE_PARAMETER) continue;
        snprintf(c->text, TEXT_SIZE, "%s: %s cannot be set, expected an input or a parameter", call, variable_text(c->body, (int64_t)vr[i], 0, c->room));
        tell(c, fmi2Error, c->text);
        return 0;
    }
    return c;
}

static Component *settable(fmi2Component handle, const fmi2ValueReference vr[], size_t n, int type, const char *call, const void *value) {
    Runs runs = {0, {0}};
    return settable_runs(handle, vr, n, type, call, value, &runs);
}

/* Set a parameter; after the start it keeps its value, with a warning. */
static fmi2Status put_parameter(Component *c, fmi2ValueReference reference, double value) {
    const Program *p = instance_description(c->body);
    if (c->phase & (INSTANTIATED | INITIALIZING) || parameter_is_tunable(p->variable_index[reference])) {
        set_parameter(c->body, p->variable_index[reference], value);
        return fmi2OK;
    }
    snprintf(c->text, TEXT_SIZE, "%s is fixed once initialisation has ended; it keeps its value", variable_text(c->body, (int64_t)reference, 0, c->room));
    if (c->talkative) tell(c, fmi2Warning, c->text);
    return fmi2Warning;
}

FMI_EXPORT fmi2Status fmi2SetReal(fmi2Component handle, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Runs runs = {0, {0}};
    Component *c = settable_runs(handle, vr, n, TYPE_REAL, "fmi2SetReal", value, &runs);
    if (!c) return fmi2Error;
    const Program *p = instance_description(c->body);
    fmi2Status status = fmi2OK;
    for (size_t i = 0, at = 0, run; i < n; i += run) {
        run = next_run(c, &runs, at++, vr + i, n - i, TYPE_REAL, "fmi2SetReal");
        if (p->variable_role[vr[i]] == ROLE_INPUT) {
            set_inputs(c->body, p->variable_index[vr[i]], (int64_t)run, value + i);
            continue;
        }
        for (size_t k = i; k < i + run; k++)
            if (put_parameter(c, vr[k], value[k]) != fmi2OK) status = fmi2Warning;
    }
    start_changed(c->body);
    return status;
}

FMI_EXPORT fmi2Status fmi2SetInteger(fmi2Component handle, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    return settable(handle, vr, n, TYPE_INTEGER, "fmi2SetInteger", value) ? fmi2OK : fmi2Error;
}

FMI_EXPORT fmi2Status fmi2SetBoolean(fmi2Component handle, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
    Component *c = settable(handle, vr, n, TYPE_BOOLEAN, "fmi2SetBoolean", value);
    if (!c) return fmi2Error;
    fmi2Status status = fmi2OK;
    for (size_t i = 0; i < n; i++)
        if (put_parameter(c, vr[i], value[i] ? 1.0 : 0.0) != fmi2OK) status = fmi2Warning;
    start_changed(c->body);
    return status;
}

/* Place of a text among the choices of a String variable; -1, told, where it is none. */
static int64_t choice_of(Component *c, fmi2ValueReference reference, const char *text) {
    char offered[TEXT_SIZE / 2] = "";
    size_t used = 0;
    for (int64_t k = 0;; k++) {
        const char *choice = variable_text(c->body, (int64_t)reference, 1 + k, c->room);
        if (!*choice) break;
        if (text && strcmp(choice, text) == 0) return k;
        if (used < sizeof offered) used += (size_t)snprintf(offered + used, sizeof offered - used, "%s'%s'", k ? ", " : "", choice);
    }
    char name[TEXT_SIZE / 4];
    snprintf(c->text, TEXT_SIZE, "%s is '%.100s', expected one of %s", variable_text(c->body, (int64_t)reference, 0, name), text ? text : "(null)", offered);
    tell(c, fmi2Error, c->text);
    return -1;
}

FMI_EXPORT fmi2Status fmi2SetString(fmi2Component handle, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
    Component *c = settable(handle, vr, n, TYPE_STRING, "fmi2SetString", value);
    if (!c) return fmi2Error;
    for (size_t i = 0; i < n; i++)
        if (choice_of(c, vr[i], value[i]) < 0) return fmi2Error;
    fmi2Status status = fmi2OK;
    for (size_t i = 0; i < n; i++)
        if (put_parameter(c, vr[i], (double)choice_of(c, vr[i], value[i])) != fmi2OK) status = fmi2Warning;
    start_changed(c->body);
    return status;
}

FMI_EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component handle, const fmi2ValueReference vr[], size_t n,
                                                   const fmi2Integer order[], const fmi2Real value[]) {
    Component *c = settable(handle, vr, n, TYPE_REAL, "fmi2SetRealInputDerivatives", value);
    c = given(c, !n || order, "fmi2SetRealInputDerivatives");
    if (!c) return fmi2Error;
    const Program *p = instance_description(c->body);
    for (size_t i = 0; i < n; i++)
        if (order[i] != 1 || p->variable_role[vr[i]] != ROLE_INPUT) {
            snprintf(c->text, TEXT_SIZE, "fmi2SetRealInputDerivatives: order %d of %s: expected order 1 of an input", order[i],
                     variable_text(c->body, (int64_t)vr[i], 0, c->room));
            return fail(c, c->text);
        }
    for (size_t i = 0; i < n; i++) set_input_rate(c->body, p->variable_index[vr[i]], value[i]);
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component handle, const fmi2ValueReference vr[], size_t n,
                                                    const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    Component *c = allowed(handle, READABLE, "fmi2GetRealOutputDerivatives");
    if (!c) return fmi2Error;
    return n ? fail(c, "fmi2GetRealOutputDerivatives: none are offered; build with velocities = true for those of displacements") : fmi2OK;
}

FMI_EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component handle, const fmi2ValueReference unknown[], size_t unknowns,
                                                    const fmi2ValueReference known[], size_t knowns, const fmi2Real direction[],
                                                    fmi2Real result[]) {
    const int whole = (!unknowns || (unknown && result)) && (!knowns || (known && direction));
    Component *c = given(allowed(handle, READABLE, "fmi2GetDirectionalDerivative"), whole, "fmi2GetDirectionalDerivative");
    if (!c) return fmi2Error;
    for (size_t i = 0; i < unknowns; i++)
        if (variable_of(c, unknown[i], TYPE_REAL, "fmi2GetDirectionalDerivative") < 0) return fmi2Error;
    for (size_t i = 0; i < knowns; i++)
        if (variable_of(c, known[i], TYPE_REAL, "fmi2GetDirectionalDerivative") < 0) return fmi2Error;
    int64_t *references = malloc((unknowns + knowns + 1) * sizeof *references);
    if (!references) return fail(c, "fmi2GetDirectionalDerivative: there is not enough memory");
    for (size_t i = 0; i < unknowns; i++) references[i] = (int64_t)unknown[i];
    for (size_t i = 0; i < knowns; i++) references[unknowns + i] = (int64_t)known[i];
    const Answer answer = instance_derivative(c->body, references, (int64_t)unknowns, references + unknowns, (int64_t)knowns, direction, result, c->text);
    free(references);
    return answer == ANSWER_OK ? fmi2OK : fail(c, c->text);
}
