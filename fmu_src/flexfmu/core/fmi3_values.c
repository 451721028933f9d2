/* FMI 3.0: values of variables and derivatives. The reference of an array is that of its first number in FMI 2.0; time, which
 * FMI 2.0 has not among its variables, comes after all. */
#include <stdio.h>
#include <stdlib.h>

#include "component.h"
#include "fmi3_types.h"

/* How many numbers the variable of a reference has: 0 for one within an array; what is none is left to calls of FMI 2.0. */
static size_t axes_of(const Component *c, fmi3ValueReference reference) {
    const Program *p = instance_description(c->body);
    if ((int64_t)reference >= p->variables) return 1;
    switch (p->variable_role[reference]) {
#define ROLE(symbol, causality, axes, ...) \
    case ROLE_##symbol: \
        return p->variable_index[reference] % axes ? 0 : axes;
#include "interface.def"
    default: return 1;
    }
}

static fmi3Status wrong_count(Component *c, size_t expected, size_t found, const char *call) {
    snprintf(c->text, TEXT_SIZE, "%s: %llu values, expected the %llu of these variables", call, (unsigned long long)found, (unsigned long long)expected);
    return fail(c, c->text);
}

/* References of the numbers of `n` variables, from `at` on in c->numbers; null, told, where they are not `count`. */
static fmi2ValueReference *numbered(Component *c, size_t at, const fmi3ValueReference vr[], size_t n, size_t count, const char *call) {
    size_t total = 0;
    for (size_t i = 0; i < n; i++) {
        const size_t axes = axes_of(c, vr[i]);
        total += axes;
        if (axes) continue;
        snprintf(c->text, TEXT_SIZE, "%s: value reference %u is within an array; see modelDescription.xml", call, vr[i]);
        tell(c, fmi2Error, c->text);
        return 0;
    }
    if (total != count) {
        wrong_count(c, total, count, call);
        return 0;
    }
    if (at + total >= c->number_room) {
        fmi2ValueReference *wider = realloc(c->numbers, (at + total + 1) * sizeof *wider);
        if (!wider) {
            fail(c, "there is not enough memory");
            return 0;
        }
        c->numbers = wider;
        c->number_room = at + total + 1;
    }
    for (size_t i = 0, k = at; i < n; i++) {
        const size_t axes = axes_of(c, vr[i]);
        for (size_t j = 0; j < axes; j++) c->numbers[k++] = vr[i] + (fmi2ValueReference)j;
    }
    return c->numbers + at;
}

FMI_EXPORT fmi3Status fmi3GetFloat64(fmi3Instance handle, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t m) {
    Component *c = given(allowed(handle, READABLE, "fmi2GetReal"), !n || (vr && value), "fmi2GetReal");
    if (!c) return fmi2Error;
    const int64_t time = instance_description(c->body)->variables;
    size_t k = 0;
    for (size_t i = 0, end; i < n; i = end + 1) {
        /* What stands before time, at once; then time. */
        size_t count = 0;
        for (end = i; end < n && (int64_t)vr[end] != time; end++) count += axes_of(c, vr[end]);
        const size_t whole = k + count + (end < n);
        if (whole > m) return wrong_count(c, whole, m, "fmi2GetReal");
        const fmi2ValueReference *number = numbered(c, 0, vr + i, end - i, count, "fmi2GetReal");
        if (!number || fmi2GetReal(c, number, count, value + k) != fmi2OK) return fmi2Error;
        k = whole;
        if (end < n) value[k - 1] = instance_time(c->body);
    }
    return k == m ? fmi2OK : wrong_count(c, k, m, "fmi2GetReal");
}

FMI_EXPORT fmi3Status fmi3SetFloat64(fmi3Instance handle, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[], size_t m) {
    Component *c = given(allowed(handle, SETTABLE, "fmi2SetReal"), !n || (vr && value), "fmi2SetReal");
    const fmi2ValueReference *number = c ? numbered(c, 0, vr, n, m, "fmi2SetReal") : 0;
    return number ? fmi2SetReal(c, number, m, value) : fmi2Error;
}

/* A call for variables of one number each. */
static Component *single(fmi3Instance handle, size_t n, size_t m, const char *call) {
    Component *c = allowed(handle, ANY, call);
    if (!c || n == m) return c;
    wrong_count(c, n, m, call);
    return 0;
}

FMI_EXPORT fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 value[], size_t m) {
    return single(c, n, m, "fmi2GetInteger") ? fmi2GetInteger(c, vr, n, value) : fmi2Error;
}

FMI_EXPORT fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 value[], size_t m) {
    return single(c, n, m, "fmi2SetInteger") ? fmi2SetInteger(c, vr, n, value) : fmi2Error;
}

FMI_EXPORT fmi3Status fmi3GetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3String value[], size_t m) {
    return single(c, n, m, "fmi2GetString") ? fmi2GetString(c, vr, n, value) : fmi2Error;
}

FMI_EXPORT fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3String value[], size_t m) {
    return single(c, n, m, "fmi2SetString") ? fmi2SetString(c, vr, n, value) : fmi2Error;
}

/* Booleans are bytes here, and whole numbers there. */
FMI_EXPORT fmi3Status fmi3GetBoolean(fmi3Instance handle, const fmi3ValueReference vr[], size_t n, fmi3Boolean value[], size_t m) {
    Component *c = given(single(handle, n, m, "fmi2GetBoolean"), !n || (vr && value), "fmi2GetBoolean");
    if (!c) return fmi2Error;
    for (size_t i = 0; i < n; i++) {
        fmi2Boolean one;
        if (fmi2GetBoolean(c, vr + i, 1, &one) != fmi2OK) return fmi2Error;
        value[i] = one != 0;
    }
    return fmi2OK;
}

FMI_EXPORT fmi3Status fmi3SetBoolean(fmi3Instance handle, const fmi3ValueReference vr[], size_t n, const fmi3Boolean value[], size_t m) {
    Component *c = given(single(handle, n, m, "fmi2SetBoolean"), !n || (vr && value), "fmi2SetBoolean");
    if (!c) return fmi2Error;
    fmi2Boolean *numbers = malloc((n + 1) * sizeof *numbers);
    if (!numbers) return fail(c, "fmi2SetBoolean: there is not enough memory");
    for (size_t i = 0; i < n; i++) numbers[i] = value[i];
    const fmi3Status status = fmi2SetBoolean(c, vr, n, numbers);
    free(numbers);
    return status;
}

/* What a derivative is of and by, as numbers; null, told, where they do not fit. */
static Component *numbered_pair(fmi3Instance handle, const fmi3ValueReference unknown[], size_t unknowns, size_t results,
                                const fmi3ValueReference known[], size_t knowns, size_t causes, int whole, const char *call) {
    whole = whole && (unknown || !unknowns) && (known || !knowns);
    Component *c = given(allowed(handle, READABLE, call), whole, call);
    return c && numbered(c, 0, unknown, unknowns, results, call) && numbered(c, results, known, knowns, causes, call) ? c : 0;
}

FMI_EXPORT fmi3Status fmi3GetDirectionalDerivative(fmi3Instance handle, const fmi3ValueReference unknown[], size_t unknowns,
                                                   const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds,
                                                   fmi3Float64 result[], size_t results) {
    Component *c = numbered_pair(handle, unknown, unknowns, results, known, knowns, seeds, (seed || !seeds) && (result || !results),
                                 "fmi2GetDirectionalDerivative");
    return c ? fmi2GetDirectionalDerivative(c, c->numbers, results, c->numbers + results, seeds, seed, result) : fmi2Error;
}

FMI_EXPORT fmi3Status fmi3GetAdjointDerivative(fmi3Instance handle, const fmi3ValueReference unknown[], size_t unknowns,
                                               const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds,
                                               fmi3Float64 result[], size_t results) {
    Component *c = numbered_pair(handle, unknown, unknowns, seeds, known, knowns, results, (seed || !seeds) && (result || !results),
                                 "fmi2GetAdjointDerivative");
    if (!c) return fmi2Error;
    double *column = malloc((seeds + 1) * sizeof *column);
    if (!column) return fail(c, "fmi2GetAdjointDerivative: there is not enough memory");
    const double one = 1.0;
    fmi3Status status = fmi2OK;
    for (size_t k = 0; k < results && status == fmi2OK; k++) {
        status = fmi2GetDirectionalDerivative(c, c->numbers, seeds, c->numbers + seeds + k, 1, &one, column);
        result[k] = 0.0;
        for (size_t i = 0; i < seeds && status == fmi2OK; i++) result[k] += seed[i] * column[i];
    }
    free(column);
    return status;
}
