/* What a page asks beside FMI: a library for WebAssembly alone has it. */
#include "component.h"

#if defined(__wasm__)
#include <string.h>

/* A page has functions that it calls, not pointers to its own: its logger is this one. */
__attribute__((import_module("page"), import_name("log")))
void fmi2FlexfmuLog(fmi2ComponentEnvironment to, fmi2String instance, fmi2Status status, fmi2String category, fmi2String message, ...);

/* Which C files this is of: whoever writes a page looks for it in the library. */
FMI_EXPORT const char *fmi2FlexfmuSources(void) { return core_sources(); }

FMI_EXPORT fmi2CallbackLogger fmi2FlexfmuLogger(void) { return fmi2FlexfmuLog; }

/* body_surface of an instance where it is now. */
FMI_EXPORT fmi2Status fmi2FlexfmuSurface(fmi2Component handle, const int64_t *sizes, const int64_t *on, const double *numbers,
                                          double *value, double *places) {
    Component *c = allowed(handle, READABLE, "fmi2FlexfmuSurface");
    if (!c || instance_begin(c->body, c->text) != ANSWER_OK) return fmi2Error;
    return body_surface(c->body->body, sizes, on, numbers, c->body->q, value, places) == FLEX_OK ? fmi2OK : fmi2Error;
}

/* Its modal coordinates there. */
FMI_EXPORT fmi2Status fmi2FlexfmuModes(fmi2Component handle, double *q, size_t count) {
    Component *c = allowed(handle, READABLE, "fmi2FlexfmuModes");
    if (!c || instance_begin(c->body, c->text) != ANSWER_OK) return fmi2Error;
    memcpy(q, c->body->q, count * sizeof(double));
    return fmi2OK;
}
/* Bound of diagnostics.error, once that was asked for; -1: none is known. */
FMI_EXPORT double fmi2FlexfmuBound(fmi2Component handle) {
    Component *c = allowed(handle, READABLE, "fmi2FlexfmuBound");
    return c ? c->body->bound : -1.0;
}
#endif
