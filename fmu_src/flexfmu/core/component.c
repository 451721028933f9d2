#include "component.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *const CATEGORY[CATEGORIES] = {"logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"};

const char NO_MODEL_EXCHANGE[] = "this FMU is for co-simulation, not for model exchange";

static char *copied(const char *text) {
    const size_t size = strlen(text) + 1;
    char *copy = malloc(size);
    if (copy) memcpy(copy, text, size);
    return copy;
}

void run_ends(Component *c) {
    if (c->phase & (STEPPING | STEP_FAILED)) instance_end(c->body);
}

void component_close(Component *c) {
    if (!c || c->sign != SIGN) return;
    run_ends(c);
    instance_close(c->body);
    c->sign = 0;
    free(c->name);
    free(c->strings);
    free(c->numbers);
    free(c);
}

Component *component_open(const Component *how, fmi2String name, const char *wrong, fmi2String guid, fmi2String location, int logging) {
    Component *c = malloc(sizeof *c);
    if (!c) return 0;
    *c = *how;
    c->sign = SIGN;
    c->phase = INSTANTIATED;
    c->logging = 1;
    for (int k = 0; k < CATEGORIES; k++) c->logged[k] = 1;
    c->name = copied(name ? name : "");
    if (!c->name) {
        component_close(c);
        return 0;
    }
    if (!name || !*name) wrong = "the instance has no name";
    if (!wrong && !location) wrong = "no location of the FMU's resources was given";
    if (!wrong && !(c->body = instance_open(location, guid, c->text))) wrong = c->text;
    if (wrong) {
        tell(c, fmi2Error, wrong);
        component_close(c);
        return 0;
    }
    c->talkative = logging != 0;
    instance_tell(c->body, tell, c);
    return c;
}

/* What FMI 3.0 names otherwise, in words that begin so. */
static const char *const RENAMED[][2] = {
    {"fmi2GetReal", "fmi3GetFloat64"},
    {"fmi2SetReal", "fmi3SetFloat64"},
    {"fmi2GetInteger", "fmi3GetInt32"},
    {"fmi2SetInteger", "fmi3SetInt32"},
    {"fmi2SetupExperiment", "fmi3EnterInitializationMode"},
    {"fmi2Instantiate", "fmi3InstantiateCoSimulation"},
    {"fmi2DeSerialize", "fmi3Deserialize"},
    {"FMUstate", "FMUState"},
    {"fmi2", "fmi3"},
};

/* A text with the names of FMI 3.0, in a place of as many bytes. */
static void renamed(const char *text, char *out, size_t size) {
    for (size_t n = 0; n + 32 < size; n++) {
        size_t k = 0, count = sizeof RENAMED / sizeof *RENAMED;
        while (k < count && strncmp(text, RENAMED[k][0], strlen(RENAMED[k][0])) != 0) k++;
        if (k < count) {
            n += (size_t)snprintf(out + n, size - n, "%s", RENAMED[k][1]) - 1;
            text += strlen(RENAMED[k][0]);
        } else if (!(out[n] = *text++)) {
            return;
        }
        out[n + 1] = 0;
    }
}

void tell(void *to, int status, const char *text) {
    Component *c = to;
    const int category = status == fmi2Warning ? 0 : status == fmi2Discard ? 1 : status == fmi2Fatal ? 3 : 2;
    if (!c->logging || !c->logged[category]) return;
    if (c->log) {
        renamed(text, c->line, sizeof c->line);
        c->log(c->callbacks.componentEnvironment, status, CATEGORY[category], c->line);
        return;
    }
    if (!c->callbacks.logger) return;
    /* The master may take the text for a printf format. */
    size_t n = 0;
    for (const char *at = text; *at && n < sizeof c->line - 2; at++) {
        if (*at == '%') c->line[n++] = '%';
        c->line[n++] = *at;
    }
    c->line[n] = 0;
    c->callbacks.logger(c->callbacks.componentEnvironment, c->name, (fmi2Status)status, CATEGORY[category], c->line);
}

fmi2Status fail(Component *c, const char *text) {
    tell(c, fmi2Error, text);
    return fmi2Error;
}

Component *allowed(fmi2Component handle, int phases, const char *call) {
    static const char *const names[] = {"instantiated", "in initialization mode", "in step mode", "after a refused step", "terminated",
                                        "after an error"};
    Component *c = handle;
    if (!c || c->sign != SIGN) return 0;
    if (c->phase & phases) return c;
    int number = 0;
    while (!(c->phase >> number & 1)) number++;
    snprintf(c->text, TEXT_SIZE, "%s is not allowed %s; expected: %s", call, names[number], phases == INSTANTIATED ? "right after fmi2Instantiate or fmi2Reset"
             : phases == INITIALIZING              ? "after fmi2EnterInitializationMode"
             : phases & INSTANTIATED               ? "before fmi2Terminate, and fmi2Reset after an error"
             : phases & INITIALIZING               ? "after fmi2EnterInitializationMode"
                                                   : "after fmi2ExitInitializationMode and before fmi2Terminate; fmi2Reset after an error");
    tell(c, fmi2Error, c->text);
    return 0;
}

Component *given(Component *c, int whole, const char *call) {
    if (!c || whole) return c;
    snprintf(c->text, TEXT_SIZE, "%s: a null pointer was given, expected an array or a place for the result", call);
    tell(c, fmi2Error, c->text);
    return 0;
}

int64_t variable_of(Component *c, fmi2ValueReference reference, int type, const char *call) {
    static const char *const types[][4] = {{"Real", "Integer", "Boolean", "String"}, {"Float64", "Int32", "Boolean", "String"}};
    const Program *p = instance_description(c->body);
    if (of_type(p, reference, type)) return (int64_t)reference;
    snprintf(c->text, TEXT_SIZE, "%s: value reference %u is no %s variable of this FMU; see its modelDescription.xml", call, reference, types[c->log != 0][type]);
    tell(c, fmi2Error, c->text);
    return -1;
}

size_t run_of(Component *c, const fmi2ValueReference references[], size_t count, int type, const char *call) {
    const fmi2ValueReference first = references[0];
    if (variable_of(c, first, type, call) < 0) return 0;
    const size_t alike = (size_t)c->body->described->opened->alike[first], most = alike < count ? alike : count;
    size_t run = 1;
    if (references[most - 1] == first + (fmi2ValueReference)(most - 1)) {
        fmi2ValueReference others = 0;
        for (size_t k = 1; k < most; k++) others |= references[k] ^ (first + (fmi2ValueReference)k);
        if (!others) return most;
    }
    while (run < most && references[run] == first + (fmi2ValueReference)run) run++;
    return run;
}
