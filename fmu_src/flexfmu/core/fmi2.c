/* FMI 2.0 for co-simulation: the order of calls, types and statuses, logging. Knows nothing of mechanics.
 * Source: Functional Mock-up Interface 2.0.4, sections 2.1 and 4.2. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "component.h"

FMI_EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI_EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

FMI_EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component handle, fmi2Boolean on, size_t count, const fmi2String categories[]) {
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
    c->logging = c->talkative = on != 0;
    return fmi2OK;
}

FMI_EXPORT void fmi2FreeInstance(fmi2Component handle) { component_close(handle); }

FMI_EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                                          const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)visible;
    if (!callbacks) return 0;
    const Component how = {.callbacks = *callbacks};
    return component_open(&how, name, type == fmi2CoSimulation ? 0 : NO_MODEL_EXCHANGE, guid, location, logging);
}

FMI_EXPORT fmi2Status fmi2SetupExperiment(fmi2Component handle, fmi2Boolean tolerance_given, fmi2Real tolerance, fmi2Real start,
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
    c->set_up = 1;
    c->stop = stop_given ? stop : HUGE_VAL;
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component handle) {
    Component *c = allowed(handle, INSTANTIATED, "fmi2EnterInitializationMode");
    if (!c) return fmi2Error;
    if (!c->set_up) return fail(c, "fmi2EnterInitializationMode is not allowed yet; expected: after fmi2SetupExperiment");
    c->phase = INITIALIZING;
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component handle) {
    Component *c = allowed(handle, INITIALIZING, "fmi2ExitInitializationMode");
    if (!c) return fmi2Error;
    if (instance_start(c->body, c->text) != ANSWER_OK) {
        c->phase = FAILED;
        return fail(c, c->text);
    }
    c->phase = STEPPING;
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2Terminate(fmi2Component handle) {
    Component *c = allowed(handle, STEPPING | STEP_FAILED, "fmi2Terminate");
    if (!c) return fmi2Error;
    run_ends(c);
    c->phase = TERMINATED;
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2Reset(fmi2Component handle) {
    Component *c = allowed(handle, ANY, "fmi2Reset");
    if (!c) return fmi2Error;
    run_ends(c);
    instance_reset(c->body);
    c->set_up = 0;
    c->phase = INSTANTIATED;
    return fmi2OK;
}

/* Whether two times are the same but for round-off: that of single precision within a step, and that of long sums. */
static int same_time(double a, double b, double step) {
    return fabs(a - b) <= 1e-6 * step + 1e-12 * fmax(fabs(a), fabs(b));
}

fmi2Status component_step(fmi2Component handle, double time, double step, int *halvings) {
    /* After a refused step the state is as it was: another step, shorter or with other inputs, may be tried. */
    Component *c = allowed(handle, STEPPING | STEP_FAILED, "fmi2DoStep");
    if (!c) return fmi2Error;
    const double reached = instance_time(c->body);
    if (isfinite(time) && isfinite(step) && step >= 0.0) {
        if (!same_time(time, reached, step)) {
            snprintf(c->text, TEXT_SIZE, "fmi2DoStep: a step from %.16g s, expected one from %.16g s, where the last step ended", time, reached);
            return fail(c, c->text);
        }
        if (c->set_up && time + step > c->stop && !same_time(time + step, c->stop, step)) {
            snprintf(c->text, TEXT_SIZE, "fmi2DoStep: a step from %.16g s by %.16g s goes beyond the stop time of fmi2SetupExperiment, %.16g s",
                     time, step, c->stop);
            return fail(c, c->text);
        }
    }
    switch (instance_step(c->body, time, step, halvings, c->text)) {
    case ANSWER_OK:
        c->phase = STEPPING;
        if (c->set_up && isfinite(c->stop) && same_time(time + step, c->stop, step)) run_ends(c);
        return fmi2OK;
    case ANSWER_REFUSED:
        c->phase = STEP_FAILED;
        tell(c, fmi2Discard, c->text);
        return fmi2Discard;
    default:
        run_ends(c);
        c->phase = FAILED;
        return fail(c, c->text);
    }
}

FMI_EXPORT fmi2Status fmi2DoStep(fmi2Component handle, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state) {
    (void)no_set_state;
    int none = 0;
    return component_step(handle, time, step, &none);
}

FMI_EXPORT fmi2Status fmi2CancelStep(fmi2Component handle) {
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

FMI_EXPORT fmi2Status fmi2GetStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2Status *value) {
    fmi2Status status;
    Component *c = asked(handle, kind, fmi2DoStepStatus, value, "fmi2GetStatus", &status);
    if (!c) return status;
    *value = c->phase == STEP_FAILED ? fmi2Discard : c->phase == FAILED ? fmi2Error : fmi2OK;
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2GetRealStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2Real *value) {
    fmi2Status status;
    Component *c = asked(handle, kind, fmi2LastSuccessfulTime, value, "fmi2GetRealStatus", &status);
    if (!c) return status;
    *value = instance_time(c->body);
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2Integer *value) {
    fmi2Status status;
    /* None of any kind. */
    asked(handle, kind, !kind, value, "fmi2GetIntegerStatus", &status);
    return status;
}

FMI_EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2Boolean *value) {
    fmi2Status status;
    Component *c = asked(handle, kind, fmi2Terminated, value, "fmi2GetBooleanStatus", &status);
    if (!c) return status;
    /* A master that would go on repeating the same step ends here. */
    *value = (c->phase & (STEP_FAILED | FAILED)) != 0;
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2GetStringStatus(fmi2Component handle, const fmi2StatusKind kind, fmi2String *value) {
    fmi2Status status;
    Component *c = asked(handle, kind, fmi2PendingStatus, value, "fmi2GetStringStatus", &status);
    if (!c) return status;
    *value = "";
    return fmi2OK;
}
