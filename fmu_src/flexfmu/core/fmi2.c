/* FMI 2.0 for co-simulation: the order of calls, types and statuses, logging. Knows nothing of mechanics.
 * Source: Functional Mock-up Interface 2.0.4, sections 2.1 and 4.2. */
#include "fmi2.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"
#include "program.h"

/* States of an instance, as bits, so that a call can name those in which it is allowed. */
typedef enum {
    INSTANTIATED = 1,
    INITIALIZING = 2,
    STEPPING = 4,
    STEP_FAILED = 8,
    TERMINATED = 16,
    FAILED = 32
} Phase;

enum { READABLE = INITIALIZING | STEPPING | STEP_FAILED | TERMINATED | FAILED };
enum { SETTABLE = INSTANTIATED | INITIALIZING | STEPPING | STEP_FAILED };
enum { ANY = 63 };

enum { CATEGORIES = 4 };
static const char *const CATEGORY[CATEGORIES] = {"logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"};

static const uint64_t SIGN = UINT64_C(0x464C4558464D5532);

typedef struct {
    uint64_t sign;
    Instance *body;
    fmi2CallbackFunctions callbacks;
    char *name;
    Phase phase;
    int logging, logged[CATEGORIES];
    char text[TEXT_SIZE], line[2 * TEXT_SIZE], room[TEXT_SIZE / 4];
    /* Names handed out by fmi2GetString stay until the next call. */
    char *strings;
} Component;

static void tell(void *to, int status, const char *text) {
    Component *c = to;
    const int category = status == fmi2Warning ? 0 : status == fmi2Discard ? 1 : status == fmi2Fatal ? 3 : 2;
    if (!c->logging || !c->logged[category] || !c->callbacks.logger) return;
    /* The master may take the text for a printf format. */
    size_t n = 0;
    for (const char *at = text; *at && n < sizeof c->line - 2; at++) {
        if (*at == '%') c->line[n++] = '%';
        c->line[n++] = *at;
    }
    c->line[n] = 0;
    c->callbacks.logger(c->callbacks.componentEnvironment, c->name, (fmi2Status)status, CATEGORY[category], c->line);
}

static fmi2Status fail(Component *c, const char *text) {
    tell(c, fmi2Error, text);
    return fmi2Error;
}

/* The component behind a handle if a call is allowed in its phase; else null, told. */
static Component *allowed(fmi2Component handle, int phases, const char *call) {
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

/* The same for calls with arrays, none of which may be missing. */
static Component *given(Component *c, int whole, const char *call) {
    if (!c || whole) return c;
    snprintf(c->text, TEXT_SIZE, "%s: a null pointer was given, expected an array or a place for the result", call);
    tell(c, fmi2Error, c->text);
    return 0;
}

static char *copied(const char *text) {
    const size_t size = strlen(text) + 1;
    char *copy = malloc(size);
    if (copy) memcpy(copy, text, size);
    return copy;
}

FMI2_EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI2_EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

FMI2_EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component handle, fmi2Boolean on, size_t count, const fmi2String categories[]) {
    Component *c = given(allowed(handle, ANY, "fmi2SetDebugLogging"), !count || categories, "fmi2SetDebugLogging");
    if (!c) return fmi2Error;
    int chosen[CATEGORIES] = {0};
    for (size_t i = 0; i < count; i++) {
        int known = 0;
        for (int k = 0; k < CATEGORIES; k++)
            if (categories[i] && strcmp(categories[i], CATEGORY[k]) == 0) known = chosen[k] = 1;
        /* The standard's name for all of them. */
        if (categories[i] && strcmp(categories[i], "logAll") == 0)
            for (int k = 0; k < CATEGORIES; k++) known = chosen[k] = 1;
        if (!known) {
            snprintf(c->text, TEXT_SIZE, "fmi2SetDebugLogging: log category '%.100s', expected one of logAll, %s, %s, %s, %s",
                     categories[i] ? categories[i] : "(null)", CATEGORY[0], CATEGORY[1], CATEGORY[2], CATEGORY[3]);
            return fail(c, c->text);
        }
    }
    for (int k = 0; k < CATEGORIES; k++) c->logged[k] = count ? chosen[k] : 1;
    c->logging = on != 0;
    return fmi2OK;
}

FMI2_EXPORT void fmi2FreeInstance(fmi2Component handle) {
    Component *c = handle;
    if (!c || c->sign != SIGN) return;
    instance_close(c->body);
    c->sign = 0;
    free(c->name);
    free(c->strings);
    free(c);
}

FMI2_EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                                          const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)visible;
    if (!callbacks) return 0;
    Component *c = calloc(1, sizeof *c);
    if (!c) return 0;
    c->sign = SIGN;
    c->callbacks = *callbacks;
    c->phase = INSTANTIATED;
    c->logging = 1;
    for (int k = 0; k < CATEGORIES; k++) c->logged[k] = 1;
    c->name = copied(name ? name : "");
    if (!c->name) {
        fmi2FreeInstance(c);
        return 0;
    }
    const char *wrong = !name || !*name ? "the instance has no name"
                        : type != fmi2CoSimulation ? "this FMU is for co-simulation, not for model exchange"
                        : !location            ? "no location of the FMU's resources was given"
                                               : 0;
    if (!wrong && !(c->body = instance_open(location, guid, c->text))) wrong = c->text;
    if (wrong) {
        tell(c, fmi2Error, wrong);
        fmi2FreeInstance(c);
        return 0;
    }
    /* What refuses a call is told in any case; warnings where logging is on. */
    c->logged[0] = logging != 0;
    instance_tell(c->body, tell, c);
    return c;
}

FMI2_EXPORT fmi2Status fmi2SetupExperiment(fmi2Component handle, fmi2Boolean tolerance_given, fmi2Real tolerance, fmi2Real start,
                                           fmi2Boolean stop_given, fmi2Real stop) {
    /* The state follows from the state before it and the inputs alone, not from time. */
    Component *c = allowed(handle, INSTANTIATED, "fmi2SetupExperiment");
    if (!c) return fmi2Error;
    if (!isfinite(start) || (stop_given && !(stop >= start)) || (tolerance_given && !(tolerance > 0.0))) {
        snprintf(c->text, TEXT_SIZE, "fmi2SetupExperiment: start %g s, stop %g s, tolerance %g: expected start <= stop and a positive tolerance",
                 start, stop, tolerance);
        return fail(c, c->text);
    }
    instance_begin_at(c->body, start);
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component handle) {
    Component *c = allowed(handle, INSTANTIATED, "fmi2EnterInitializationMode");
    if (!c) return fmi2Error;
    c->phase = INITIALIZING;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component handle) {
    Component *c = allowed(handle, INITIALIZING, "fmi2ExitInitializationMode");
    if (!c) return fmi2Error;
    if (instance_start(c->body, c->text) != ANSWER_OK) {
        c->phase = FAILED;
        return fail(c, c->text);
    }
    c->phase = STEPPING;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2Terminate(fmi2Component handle) {
    Component *c = allowed(handle, STEPPING | STEP_FAILED, "fmi2Terminate");
    if (!c) return fmi2Error;
    c->phase = TERMINATED;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2Reset(fmi2Component handle) {
    Component *c = allowed(handle, ANY, "fmi2Reset");
    if (!c) return fmi2Error;
    instance_reset(c->body);
    c->phase = INSTANTIATED;
    return fmi2OK;
}

/* The variable of a reference, checked for its type; -1, told, where there is none. */
static int64_t variable_of(Component *c, fmi2ValueReference reference, int type, const char *call) {
    static const char *const types[] = {"Real", "Integer", "Boolean", "String"};
    const Program *p = instance_description(c->body);
    if ((int64_t)reference < p->variables && p->variable_type[reference] == type) return (int64_t)reference;
    snprintf(c->text, TEXT_SIZE, "%s: value reference %u is no %s variable of this FMU; see its modelDescription.xml", call, reference, types[type]);
    tell(c, fmi2Error, c->text);
    return -1;
}

/* Values of variables of one type as numbers, one after another. */
static fmi2Status numbers_of(fmi2Component handle, const fmi2ValueReference references[], size_t count, int type,
                             const char *call, void *values) {
    Component *c = given(allowed(handle, READABLE, call), !count || (references && values), call);
    if (!c) return fmi2Error;
    for (size_t i = 0; i < count; i++)
        if (variable_of(c, references[i], type, call) < 0) return fmi2Error;
    for (size_t i = 0; i < count; i++) {
        double number;
        if (get_number(c->body, (int64_t)references[i], &number, c->text) != ANSWER_OK) return fail(c, c->text);
        const int64_t role = instance_description(c->body)->variable_role[references[i]];
        /* Inputs and parameters are what the master set. */
        if (!isfinite(number) && role != ROLE_INPUT && role != ROLE_PARAMETER) {
            snprintf(c->text, TEXT_SIZE, "%s: %s has no finite value: the loads are too large for the arithmetic; lower them", call,
                     variable_text(c->body, (int64_t)references[i], 0, c->room));
            return fail(c, c->text);
        }
        if (type == TYPE_REAL)
            ((fmi2Real *)values)[i] = number;
        else
            ((fmi2Integer *)values)[i] = number > 2147483647.0 ? 2147483647 : (fmi2Integer)number;
    }
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    return numbers_of(c, vr, n, TYPE_REAL, "fmi2GetReal", value);
}

FMI2_EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    return numbers_of(c, vr, n, TYPE_INTEGER, "fmi2GetInteger", value);
}

FMI2_EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
    return numbers_of(c, vr, n, TYPE_BOOLEAN, "fmi2GetBoolean", value);
}

FMI2_EXPORT fmi2Status fmi2GetString(fmi2Component handle, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    Component *c = given(allowed(handle, READABLE, "fmi2GetString"), !n || (vr && value), "fmi2GetString");
    if (!c) return fmi2Error;
    for (size_t i = 0; i < n; i++)
        if (variable_of(c, vr[i], TYPE_STRING, "fmi2GetString") < 0) return fmi2Error;
    char *kept = realloc(c->strings, (n ? n : 1) * sizeof c->room);
    if (!kept) return fail(c, "fmi2GetString: there is not enough memory");
    c->strings = kept;
    for (size_t i = 0; i < n; i++) {
        double chosen = 0.0;
        if (get_number(c->body, (int64_t)vr[i], &chosen, c->text) != ANSWER_OK) return fail(c, c->text);
        char *text = kept + i * sizeof c->room;
        if (!*variable_text(c->body, (int64_t)vr[i], 1 + (int64_t)chosen, text)) *text = 0;
        value[i] = text;
    }
    return fmi2OK;
}

/* Whether all references are settable ones of a type. Sets are whole or refused. */
static Component *settable(fmi2Component handle, const fmi2ValueReference vr[], size_t n, int type, const char *call, const void *value) {
    Component *c = given(allowed(handle, SETTABLE, call), !n || (vr && value), call);
    if (!c) return 0;
    const Program *p = instance_description(c->body);
    for (size_t i = 0; i < n; i++) {
        if (variable_of(c, vr[i], type, call) < 0) return 0;
        if (p->variable_role[vr[i]] == ROLE_INPUT || p->variable_role[vr[i]] == ROLE_PARAMETER) continue;
        snprintf(c->text, TEXT_SIZE, "%s: %s cannot be set, expected an input or a parameter", call, variable_text(c->body, (int64_t)vr[i], 0, c->room));
        tell(c, fmi2Error, c->text);
        return 0;
    }
    return c;
}

/* Set a parameter; after the start it keeps its value, with a warning. */
static fmi2Status put_parameter(Component *c, fmi2ValueReference reference, double value) {
    const Program *p = instance_description(c->body);
    if (c->phase & (INSTANTIATED | INITIALIZING) || parameter_is_tunable(p->variable_index[reference])) {
        set_parameter(c->body, p->variable_index[reference], value);
        return fmi2OK;
    }
    snprintf(c->text, TEXT_SIZE, "%s is fixed once initialisation has ended; it keeps its value", variable_text(c->body, (int64_t)reference, 0, c->room));
    tell(c, fmi2Warning, c->text);
    return fmi2Warning;
}

FMI2_EXPORT fmi2Status fmi2SetReal(fmi2Component handle, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Component *c = settable(handle, vr, n, TYPE_REAL, "fmi2SetReal", value);
    if (!c) return fmi2Error;
    const Program *p = instance_description(c->body);
    fmi2Status status = fmi2OK;
    for (size_t i = 0; i < n; i++) {
        if (p->variable_role[vr[i]] == ROLE_INPUT) {
            set_input(c->body, p->variable_index[vr[i]], value[i]);
        } else if (put_parameter(c, vr[i], value[i]) != fmi2OK) {
            status = fmi2Warning;
        }
    }
    start_changed(c->body);
    return status;
}

FMI2_EXPORT fmi2Status fmi2SetInteger(fmi2Component handle, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    return settable(handle, vr, n, TYPE_INTEGER, "fmi2SetInteger", value) ? fmi2OK : fmi2Error;
}

FMI2_EXPORT fmi2Status fmi2SetBoolean(fmi2Component handle, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
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

FMI2_EXPORT fmi2Status fmi2SetString(fmi2Component handle, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
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

FMI2_EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component handle, const fmi2ValueReference vr[], size_t n,
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

FMI2_EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component handle, const fmi2ValueReference vr[], size_t n,
                                                    const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    Component *c = allowed(handle, READABLE, "fmi2GetRealOutputDerivatives");
    if (!c) return fmi2Error;
    return n ? fail(c, "fmi2GetRealOutputDerivatives: none are offered; build with velocities = true for those of displacements") : fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2DoStep(fmi2Component handle, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state) {
    (void)no_set_state;
    /* After a refused step the state is as it was: another step, shorter or with other inputs, may be tried. */
    Component *c = allowed(handle, STEPPING | STEP_FAILED, "fmi2DoStep");
    if (!c) return fmi2Error;
    switch (instance_step(c->body, time, step, c->text)) {
    case ANSWER_OK: c->phase = STEPPING; return fmi2OK;
    case ANSWER_REFUSED:
        c->phase = STEP_FAILED;
        tell(c, fmi2Discard, c->text);
        return fmi2Discard;
    default:
        c->phase = FAILED;
        return fail(c, c->text);
    }
}

FMI2_EXPORT fmi2Status fmi2CancelStep(fmi2Component handle) {
    Component *c = allowed(handle, ANY, "fmi2CancelStep");
    return c ? fail(c, "fmi2CancelStep: no step is under way; steps end before fmi2DoStep returns") : fmi2Error;
}

/* The component whose status of a kind is asked for; null with a status to be returned where there is none. */
static Component *asked(fmi2Component handle, int kind, int offered, const void *value, const char *call, fmi2Status *status) {
    Component *c = given(allowed(handle, STEPPING | STEP_FAILED | TERMINATED | FAILED, call), value != 0, call);
    *status = fmi2Error;
    if (!c || kind == offered) return c;
    snprintf(c->text, TEXT_SIZE, "%s: no status of kind %d; steps end before fmi2DoStep returns, ask fmi2GetRealStatus for the last time reached", call, kind);
    tell(c, fmi2Discard, c->text);
    *status = fmi2Discard;
    return 0;
}

FMI2_EXPORT fmi2Status fmi2GetStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2Status *value) {
    fmi2Status status;
    Component *c = asked(handle, kind, fmi2DoStepStatus, value, "fmi2GetStatus", &status);
    if (!c) return status;
    *value = c->phase == STEP_FAILED ? fmi2Discard : c->phase == FAILED ? fmi2Error : fmi2OK;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2GetRealStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2Real *value) {
    fmi2Status status;
    Component *c = asked(handle, kind, fmi2LastSuccessfulTime, value, "fmi2GetRealStatus", &status);
    if (!c) return status;
    *value = instance_time(c->body);
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2Integer *value) {
    fmi2Status status;
    /* None of any kind. */
    asked(handle, kind, !kind, value, "fmi2GetIntegerStatus", &status);
    return status;
}

FMI2_EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2Boolean *value) {
    fmi2Status status;
    Component *c = asked(handle, kind, fmi2Terminated, value, "fmi2GetBooleanStatus", &status);
    if (!c) return status;
    /* A master that would go on repeating the same step ends here. */
    *value = (c->phase & (STEP_FAILED | FAILED)) != 0;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2GetStringStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2String *value) {
    fmi2Status status;
    Component *c = asked(handle, kind, fmi2PendingStatus, value, "fmi2GetStringStatus", &status);
    if (!c) return status;
    *value = "";
    return fmi2OK;
}

static int known_phase(int64_t phase) {
    return phase == INSTANTIATED || phase == INITIALIZING || phase == STEPPING || phase == STEP_FAILED || phase == TERMINATED || phase == FAILED;
}

/* A state: which phase it belongs to, its size, and the block. */
typedef struct {
    uint64_t sign;
    int64_t size;
    int64_t phase;
    uint64_t checksum; /* of the words before */
} StateHead;

enum { HEAD_WORDS = 3 };

static const char NO_STATE[] = "the FMU state is none of flexfmu's, or damaged: expected one of fmi2GetFMUstate or fmi2DeSerializeFMUstate";

/* Whether memory begins like a state; then its head. */
static int head_of(const void *state, StateHead *head) {
    memcpy(head, state, sizeof *head);
    return head->sign == SIGN && head->checksum == checksum(head, HEAD_WORDS) && known_phase(head->phase);
}

FMI2_EXPORT fmi2Status fmi2GetFMUstate(fmi2Component handle, fmi2FMUstate *state) {
    Component *c = given(allowed(handle, ANY, "fmi2GetFMUstate"), state != 0, "fmi2GetFMUstate");
    if (!c) return fmi2Error;
    const int64_t size = instance_state_size(c->body);
    StateHead head;
    /* A state that is handed in is written over. */
    if (*state && !(head_of(*state, &head) && head.size == size)) return fail(c, "fmi2GetFMUstate: the state handed in is of another FMU; expected a null pointer");
    char *block = *state ? *state : malloc(sizeof head + (size_t)size);
    if (!block) return fail(c, "fmi2GetFMUstate: there is not enough memory");
    head = (StateHead){SIGN, size, c->phase, 0};
    head.checksum = checksum(&head, HEAD_WORDS);
    memcpy(block, &head, sizeof head);
    instance_save(c->body, block + sizeof head);
    *state = block;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2SetFMUstate(fmi2Component handle, fmi2FMUstate state) {
    Component *c = allowed(handle, ANY, "fmi2SetFMUstate");
    StateHead head;
    if (!c) return fmi2Error;
    if (!state) return fail(c, "fmi2SetFMUstate: no state was given");
    if (!head_of(state, &head)) return fail(c, NO_STATE);
    const char *wrong = instance_restore(c->body, (const char *)state + sizeof head, head.size);
    if (wrong) return fail(c, wrong);
    c->phase = (Phase)head.phase;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component handle, fmi2FMUstate *state) {
    Component *c = allowed(handle, ANY, "fmi2FreeFMUstate");
    if (!c) return fmi2Error;
    if (!state || !*state) return fmi2OK;
    free(*state);
    *state = 0;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component handle, fmi2FMUstate state, size_t *size) {
    Component *c = allowed(handle, ANY, "fmi2SerializedFMUstateSize");
    StateHead head;
    if (!given(c, state && size, "fmi2SerializedFMUstateSize")) return fmi2Error;
    if (!head_of(state, &head)) return fail(c, NO_STATE);
    *size = sizeof head + (size_t)head.size;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component handle, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    Component *c = allowed(handle, ANY, "fmi2SerializeFMUstate");
    size_t needed;
    if (!given(c, bytes != 0, "fmi2SerializeFMUstate") || fmi2SerializedFMUstateSize(handle, state, &needed) != fmi2OK) return fmi2Error;
    if (size < needed) return fail(c, "fmi2SerializeFMUstate: there is not enough room; expected what fmi2SerializedFMUstateSize says");
    memcpy(bytes, state, needed);
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component handle, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    Component *c = allowed(handle, ANY, "fmi2DeSerializeFMUstate");
    StateHead head;
    if (!given(c, bytes && state, "fmi2DeSerializeFMUstate")) return fmi2Error;
    if (size < sizeof head || !head_of(bytes, &head)) return fail(c, NO_STATE);
    /* Its contents are looked at when it is set. */
    if (head.size != instance_state_size(c->body) || size - sizeof head != (size_t)head.size)
        return fail(c, "the FMU state is of another FMU, or cut: states go between instances of the same FMU only, whole");
    char *block = malloc(sizeof head + (size_t)head.size);
    if (!block) return fail(c, "fmi2DeSerializeFMUstate: there is not enough memory");
    memcpy(block, bytes, sizeof head + (size_t)head.size);
    *state = block;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component handle, const fmi2ValueReference unknown[], size_t unknowns,
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
