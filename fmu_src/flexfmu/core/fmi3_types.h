/* Declarations of FMI 3.0 for co-simulation, from the standard (Functional Mock-up Interface, version 3.0.2, chapters 2
 * and 4). Only what this component offers; statuses have the numbers of FMI 2.0. */
#ifndef FLEX_FMI3_TYPES_H
#define FLEX_FMI3_TYPES_H

#include <stdbool.h>
#include <stdint.h>

#include "fmi2_types.h"

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef bool fmi3Clock;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef int fmi3Status, fmi3DependencyKind, fmi3IntervalQualifier;

typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String category, fmi3String message);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64 time, fmi3Boolean set, fmi3Boolean get, fmi3Boolean finished,
                                               fmi3Boolean may_return, fmi3Boolean *returns, fmi3Float64 *return_time);
typedef void (*fmi3Callback)(void);

#endif
