/* FMI 3.0 for co-simulation, as calls of FMI 2.0 on the same component: what is named or handed over otherwise.
 * Source: Functional Mock-up Interface 3.0.2, sections 2.2, 2.3 and 4.2. */
#include "component.h"
#include "fmi3_types.h"

FMI_EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

FMI_EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String categories[]) {
    return fmi2SetDebugLogging(c, on, count, categories);
}

/* The shortest step that is taken in place of a refused one: 1/256 of it. */
enum { HALVINGS = 8 };

static fmi3Instance opened(fmi3String name, const char *wrong, fmi3String token, fmi3String path, fmi3Boolean logging,
                           fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    if (!log) return 0;
    const Component how = {.callbacks = {.componentEnvironment = environment}, .log = log};
    return component_open(&how, name, wrong, token, path, logging);
}

FMI_EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                                    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                                    const fmi3ValueReference between[], size_t count,
                                                    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                    fmi3IntermediateUpdateCallback update) {
    (void)visible, (void)between, (void)update;
    const char *wrong = events ? "this FMU has no event mode" : count ? "this FMU has no intermediate variables" : 0;
    Component *c = opened(name, wrong, token, path, logging, environment, log);
    if (c) c->halvings = early ? HALVINGS : 0;
    return c;
}

FMI_EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                                     fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                                     fmi3LogMessageCallback log) {
    (void)visible;
    return opened(name, NO_MODEL_EXCHANGE, token, path, logging, environment, log);
}

FMI_EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                                          fmi3LogMessageCallback log, fmi3Callback update, fmi3Callback lock,
                                                          fmi3Callback unlock) {
    (void)visible, (void)update, (void)lock, (void)unlock;
    return opened(name, "this FMU is for co-simulation, not for scheduled execution", token, path, logging, environment, log);
}

FMI_EXPORT void fmi3FreeInstance(fmi3Instance c) { component_close(c); }

FMI_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_given, fmi3Float64 tolerance, fmi3Float64 start,
                                                  fmi3Boolean stop_given, fmi3Float64 stop) {
    const fmi2Status status = fmi2SetupExperiment(c, tolerance_given, tolerance, start, stop_given, stop);
    return status == fmi2OK ? fmi2EnterInitializationMode(c) : status;
}

FMI_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return fmi2ExitInitializationMode(c); }
FMI_EXPORT fmi3Status fmi3Terminate(fmi3Instance c) { return fmi2Terminate(c); }
FMI_EXPORT fmi3Status fmi3Reset(fmi3Instance c) { return fmi2Reset(c); }

FMI_EXPORT fmi3Status fmi3DoStep(fmi3Instance handle, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_set_state, fmi3Boolean *events,
                                 fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached) {
    Component *c = given(allowed(handle, STEPPING | STEP_FAILED, "fmi2DoStep"), events && terminate && early && reached, "fmi2DoStep");
    if (!c) return fmi2Error;
    (void)no_set_state;
    int left = c->halvings;
    const fmi3Status status = component_step(c, time, step, &left);
    *events = *terminate = false;
    *reached = instance_time(c->body);
    *early = status == fmi2OK && left < c->halvings;
    return status;
}

FMI_EXPORT fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) { return fmi2GetFMUstate(c, state); }
FMI_EXPORT fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) { return fmi2SetFMUstate(c, state); }
FMI_EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) { return fmi2FreeFMUstate(c, state); }

FMI_EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    return fmi2SerializedFMUstateSize(c, state, size);
}

FMI_EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    return fmi2SerializeFMUstate(c, state, (fmi2Byte *)bytes, size);
}

FMI_EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    return fmi2DeSerializeFMUstate(c, (const fmi2Byte *)bytes, size, state);
}
