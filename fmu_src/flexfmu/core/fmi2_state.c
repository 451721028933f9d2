/* FMI 2.0: states of an FMU. */
#include <stdlib.h>
#include <string.h>

#include "component.h"
#include "instance_state.h"

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

FMI_EXPORT fmi2Status fmi2GetFMUstate(fmi2Component handle, fmi2FMUstate *state) {
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

FMI_EXPORT fmi2Status fmi2SetFMUstate(fmi2Component handle, fmi2FMUstate state) {
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

FMI_EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component handle, fmi2FMUstate *state) {
    Component *c = allowed(handle, ANY, "fmi2FreeFMUstate");
    if (!c) return fmi2Error;
    if (!state || !*state) return fmi2OK;
    free(*state);
    *state = 0;
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component handle, fmi2FMUstate state, size_t *size) {
    Component *c = allowed(handle, ANY, "fmi2SerializedFMUstateSize");
    StateHead head;
    if (!given(c, state && size, "fmi2SerializedFMUstateSize")) return fmi2Error;
    if (!head_of(state, &head)) return fail(c, NO_STATE);
    *size = sizeof head + (size_t)head.size;
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component handle, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    Component *c = allowed(handle, ANY, "fmi2SerializeFMUstate");
    size_t needed;
    if (!given(c, bytes != 0, "fmi2SerializeFMUstate") || fmi2SerializedFMUstateSize(handle, state, &needed) != fmi2OK) return fmi2Error;
    if (size < needed) return fail(c, "fmi2SerializeFMUstate: there is not enough room; expected what fmi2SerializedFMUstateSize says");
    memcpy(bytes, state, needed);
    return fmi2OK;
}

FMI_EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component handle, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
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
