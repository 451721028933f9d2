/* What Python asks the core beside FMI, by name: a library has no other names than those of FMI. */
#include <string.h>

#include "body.h"
#include "channel.h"
#include "coupling.h"
#include "fmi2_types.h"

/* Pages call what fmi2_web.c has. */
#if !defined(__wasm__)
typedef void (*Call)(void);

static const struct {
    const char *name;
    Call call;
} CALLS[] = {
#define CALL(name) {#name, (Call)name},
    CALL(core_sources)
    CALL(body_open)
    CALL(body_close)
    CALL(body_bytes)
    CALL(body_options)
    CALL(body_refusal)
    CALL(body_static_refusal)
    CALL(body_error)
    CALL(body_compliance)
    CALL(body_rotations)
    CALL(body_strain)
    CALL(body_motion)
    CALL(body_nodes)
    CALL(body_stress)
    CALL(body_surface)
    CALL(body_energies)
    CALL(body_forces)
    CALL(body_mass)
    CALL(body_static)
    CALL(body_step)
    CALL(body_stability)
    CALL(body_is_stable)
    CALL(body_may_miss)
    CALL(body_missed)
    CALL(coupling_open)
    CALL(coupling_begin)
    CALL(coupling_run)
    CALL(coupling_record)
    CALL(coupling_slope)
    CALL(coupling_close)
    CALL(channel_join)
    CALL(channel_serve)
    CALL(channel_leave)
#undef CALL
};

/* The function of a name; null where there is none. */
FMI_EXPORT Call fmi2FlexfmuCall(const char *name) {
    for (size_t i = 0; i < sizeof CALLS / sizeof *CALLS; i++)
        if (strcmp(CALLS[i].name, name) == 0) return CALLS[i].call;
    return 0;
}
#endif
