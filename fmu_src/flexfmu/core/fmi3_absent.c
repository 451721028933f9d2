/* FMI 3.0: calls for what the standard has and this FMU has not, as its model description says. */
#include <stdio.h>

#include "component.h"
#include "fmi3_types.h"

static fmi3Status absent(fmi3Instance handle, const char *call) {
    Component *c = allowed(handle, ANY, call);
    if (!c) return fmi2Error;
    snprintf(c->text, TEXT_SIZE, "%s: this FMU has nothing of the kind; see its modelDescription.xml", call);
    return fail(c, c->text);
}

#define ABSENT(call, ...) \
    FMI_EXPORT fmi3Status call(fmi3Instance c, __VA_ARGS__) { return absent(c, #call); }
#define ABSENT_MODE(call) \
    FMI_EXPORT fmi3Status call(fmi3Instance c) { return absent(c, #call); }
#define ABSENT_TYPE(get, set, type) \
    ABSENT(get, const fmi3ValueReference vr[], size_t n, type value[], size_t m) \
    ABSENT(set, const fmi3ValueReference vr[], size_t n, const type value[], size_t m)

ABSENT_TYPE(fmi3GetFloat32, fmi3SetFloat32, fmi3Float32)
ABSENT_TYPE(fmi3GetInt8, fmi3SetInt8, fmi3Int8)
ABSENT_TYPE(fmi3GetUInt8, fmi3SetUInt8, fmi3UInt8)
ABSENT_TYPE(fmi3GetInt16, fmi3SetInt16, fmi3Int16)
ABSENT_TYPE(fmi3GetUInt16, fmi3SetUInt16, fmi3UInt16)
ABSENT_TYPE(fmi3GetUInt32, fmi3SetUInt32, fmi3UInt32)
ABSENT_TYPE(fmi3GetInt64, fmi3SetInt64, fmi3Int64)
ABSENT_TYPE(fmi3GetUInt64, fmi3SetUInt64, fmi3UInt64)
ABSENT(fmi3GetBinary, const fmi3ValueReference vr[], size_t n, size_t size[], fmi3Binary value[], size_t m)
ABSENT(fmi3SetBinary, const fmi3ValueReference vr[], size_t n, const size_t size[], const fmi3Binary value[], size_t m)
ABSENT(fmi3GetClock, const fmi3ValueReference vr[], size_t n, fmi3Clock value[])
ABSENT(fmi3SetClock, const fmi3ValueReference vr[], size_t n, const fmi3Clock value[])
ABSENT(fmi3GetIntervalDecimal, const fmi3ValueReference vr[], size_t n, fmi3Float64 interval[], fmi3IntervalQualifier qualifier[])
ABSENT(fmi3GetIntervalFraction, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counter[], fmi3UInt64 resolution[],
       fmi3IntervalQualifier qualifier[])
ABSENT(fmi3GetShiftDecimal, const fmi3ValueReference vr[], size_t n, fmi3Float64 shift[])
ABSENT(fmi3GetShiftFraction, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counter[], fmi3UInt64 resolution[])
ABSENT(fmi3SetIntervalDecimal, const fmi3ValueReference vr[], size_t n, const fmi3Float64 interval[])
ABSENT(fmi3SetIntervalFraction, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
ABSENT(fmi3SetShiftDecimal, const fmi3ValueReference vr[], size_t n, const fmi3Float64 shift[])
ABSENT(fmi3SetShiftFraction, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
ABSENT(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *count)
ABSENT(fmi3GetVariableDependencies, fmi3ValueReference vr, size_t element[], fmi3ValueReference on[], size_t on_element[],
       fmi3DependencyKind kind[], size_t count)
ABSENT(fmi3GetOutputDerivatives, const fmi3ValueReference vr[], size_t n, const fmi3Int32 order[], fmi3Float64 value[], size_t m)
ABSENT_MODE(fmi3EnterConfigurationMode)
ABSENT_MODE(fmi3ExitConfigurationMode)
ABSENT_MODE(fmi3EnterEventMode)
ABSENT_MODE(fmi3EnterStepMode)
ABSENT_MODE(fmi3EvaluateDiscreteStates)
ABSENT(fmi3UpdateDiscreteStates, fmi3Boolean *update, fmi3Boolean *terminate, fmi3Boolean *nominals, fmi3Boolean *values,
       fmi3Boolean *event, fmi3Float64 *time)
/* Masters look for these, too, before they ask what the FMU is for. */
ABSENT_MODE(fmi3EnterContinuousTimeMode)
ABSENT(fmi3CompletedIntegratorStep, fmi3Boolean no_set_state, fmi3Boolean *event, fmi3Boolean *terminate)
ABSENT(fmi3SetTime, fmi3Float64 time)
ABSENT(fmi3SetContinuousStates, const fmi3Float64 state[], size_t n)
ABSENT(fmi3GetContinuousStateDerivatives, fmi3Float64 rate[], size_t n)
ABSENT(fmi3GetEventIndicators, fmi3Float64 indicator[], size_t n)
ABSENT(fmi3GetContinuousStates, fmi3Float64 state[], size_t n)
ABSENT(fmi3GetNominalsOfContinuousStates, fmi3Float64 nominal[], size_t n)
ABSENT(fmi3GetNumberOfEventIndicators, size_t *n)
ABSENT(fmi3GetNumberOfContinuousStates, size_t *n)
ABSENT(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
