#include "channel.h"

#include <string.h>

/* Statuses of FMI 2.0. */
enum { OK, WARNING, FATAL = 4 };
/* Lists of values that may come with a step: places in a row of the table, but one. */
enum { ROW = 16 };

/* Words of a call with so many values, each with a reference. */
static int64_t room_of(int64_t count) { return 2 + (count + 1) / 2 + count; }

static unsigned *references_of(int64_t *call) { return (unsigned *)(call + 2); }

static void *values_of(int64_t *call) { return call + 2 + (call[1] + 1) / 2; }

/* Calls take the first half of the memory, lists of values a quarter for each kind of step. */
static int64_t list_begin(const Channel *c, int64_t kind) { return c->words / 4 * (2 + kind); }

/* Write a call; where it ends. */
static int64_t put(Channel *c, int64_t at, Called what, const unsigned *references, int64_t count, const void *values, size_t bytes) {
    int64_t *call = c->shared + at;
    call[0] = what;
    call[1] = count;
    if (references) memcpy(references_of(call), references, (size_t)count * sizeof *references);
    if (values) memcpy(values_of(call), values, bytes);
    return at + room_of(count);
}

/* Send what is written, and so many lists of values of a kind after it. */
static void post(Channel *c, Called called, int64_t kind, int64_t lists) {
    const char byte = 0;
    c->shared[ASKED_SO_FAR]++;
    c->shared[CALLS_FIRST] = c->calls;
    c->shared[CALLS_FURTHER] = list_begin(c, kind);
    c->shared[COUNT_FURTHER] = lists;
    c->called = called;
    c->waiting = 1;
    /* Who is gone is found out by its answer. */
    (void)c->write((int)c->to, &byte, 1);
}

/* Which call was the first that was not honoured. */
static Called refused(const Channel *c, int64_t honoured) {
    int64_t at = FIRST_CALL;
    for (int64_t k = 0; k < honoured && at < list_begin(c, 0); k++) at += room_of(c->shared[at + 1]);
    return (Called)c->shared[at];
}

/* Wait for the answer, if one is awaited: the status of the last of the calls. */
static int settle(Channel *c) {
    char byte;
    while (c->waiting && !c->gone) {
        const int got = (int)c->read((int)c->from, &byte, 1);
        if (got > 0) break;
        if (got == 0) c->gone = 1;
        if (got < 0) c->hear(0);
    }
    const int64_t answered = c->waiting && !c->gone;
    c->waiting = 0;
    if (!answered) return c->gone ? FATAL : OK;
    if (c->shared[LINES]) c->hear(c->shared[LINES]);
    const int64_t honoured = c->shared[HONOURED], calls = c->calls;
    c->ahead = honoured - calls;
    c->calls = 0;
    c->end = FIRST_CALL;
    if (honoured >= calls) return OK;
    if (honoured == calls - 1) return (int)c->shared[LAST_STATUS];
    c->failed = 1 + refused(c, honoured);
    return FATAL;
}

/* Write a call after those that wait; 0, or the status of those, which go where there is no room. */
static int append(Channel *c, Called what, const unsigned *references, size_t count, const void *values, size_t bytes) {
    int status = settle(c);
    if (!c->gone && c->end + room_of((int64_t)count) > list_begin(c, 0)) {
        post(c, what, 0, 0);
        status = settle(c);
    }
    if (c->gone || status > WARNING) return c->gone ? FATAL : status;
    c->end = put(c, c->end, what, references, (int64_t)count, values, bytes);
    c->calls++;
    return OK;
}

static int set_real(void *of, const unsigned *references, size_t count, const double *values) {
    Channel *c = of;
    const int status = append(c, SET_REALS, references, count, values, count * sizeof *values);
    c->ahead = 0;
    return status;
}

/* Ask for values of a size each, or take those that came with the last step. */
static int get(Channel *c, Called what, const unsigned *references, size_t count, void *values, size_t size) {
    const int64_t kind = c->kind;
    int64_t *places = c->places + ROW * kind, *known = c->asked + kind;
    for (int64_t i = 0; i < c->ahead && i < *known; i++) {
        int64_t *call = c->shared + places[i];
        if (call[0] != (int64_t)what || call[1] != (int64_t)count) continue;
        if (memcmp(references_of(call), references, count * sizeof *references) != 0) continue;
        memcpy(values, values_of(call), count * size);
        return OK;
    }
    const int64_t ahead = c->ahead;
    int status = append(c, what, references, count, 0, 0);
    if (status > WARNING) return status;
    int64_t *call = c->shared + c->end - room_of((int64_t)count);
    post(c, what, 0, 0);
    status = settle(c);
    if (c->gone || status > WARNING) return status;
    memcpy(values, values_of(call), count * size);
    c->ahead = ahead;
    if (!*known) places[0] = list_begin(c, kind);
    if (*known < ROW - 1 && places[*known] + room_of((int64_t)count) <= list_begin(c, kind + 1)) {
        places[*known + 1] = put(c, places[*known], what, references, (int64_t)count, 0, 0);
        ++*known;
    }
    return OK;
}

static int get_real(void *of, const unsigned *references, size_t count, double *values) {
    return get(of, GET_REALS, references, count, values, sizeof *values);
}

static int get_integer(void *of, const unsigned *references, size_t count, int *values) {
    return get(of, GET_INTEGERS, references, count, values, sizeof *values);
}

static int get_boolean(void *of, const unsigned *references, size_t count, int *values) {
    return get(of, GET_BOOLEANS, references, count, values, sizeof *values);
}

static int end_initialization(void *of) {
    Channel *c = of;
    const int status = append(c, END_INITIALIZATION, 0, 0, 0, 0);
    if (status > WARNING) return status;
    post(c, END_INITIALIZATION, 0, 0);
    return settle(c);
}

static int begin_step(void *of, double time, double step, int last) {
    Channel *c = of;
    const double values[3] = {time, step, last};
    const int status = append(c, DO_STEP, 0, 3, values, sizeof values);
    if (status > WARNING) return status;
    c->kind = c->saved;
    c->saved = 0;
    post(c, DO_STEP, c->kind, c->asked[c->kind]);
    return OK;
}

static int do_step(void *of, double time, double step, int last) {
    Channel *c = of;
    const int begun = c->waiting && c->called == DO_STEP;
    const int status = begun ? OK : begin_step(of, time, step, last);
    return status > WARNING ? status : settle(c);
}

static int get_state(void *of, void **state) {
    Channel *c = of;
    c->saved = 1;
    *state = of; /* any but null: one state is kept, on the other side */
    return append(c, GET_STATE, 0, 0, 0, 0);
}

static int set_state(void *of, void *state) {
    Channel *c = of;
    (void)state;
    const int status = append(c, SET_STATE, 0, 0, 0, 0);
    c->ahead = 0;
    return status;
}

static int free_state(void *of, void **state) {
    (void)state;
    return append(of, FREE_STATE, 0, 0, 0, 0);
}

void channel_join(Channel *c, Participant *one) {
    c->end = FIRST_CALL;
    one->instance = c;
    one->set_real = set_real;
    one->get_real = get_real;
    one->get_integer = get_integer;
    one->get_boolean = get_boolean;
    one->end_initialization = end_initialization;
    one->begin_step = begin_step;
    one->do_step = do_step;
    one->get_state = get_state;
    one->set_state = set_state;
    one->free_state = free_state;
}

void channel_leave(Channel *c) {
    settle(c);
    if (c->gone) return;
    c->shared[LEAVING] = 1;
    post(c, FREE_STATE, 0, 0);
    c->waiting = 0;
}

/* FMI's status of a call. */
static int carried_out(Participant *one, int64_t *call) {
    const unsigned *references = references_of(call);
    const size_t count = (size_t)call[1];
    double *numbers = values_of(call);
    switch ((Called)call[0]) {
    case SET_REALS: return one->set_real(one->instance, references, count, numbers);
    case GET_REALS: return one->get_real(one->instance, references, count, numbers);
    case GET_INTEGERS: return one->get_integer(one->instance, references, count, values_of(call));
    case GET_BOOLEANS: return one->get_boolean(one->instance, references, count, values_of(call));
    case END_INITIALIZATION: return one->end_initialization(one->instance);
    case DO_STEP: return one->do_step(one->instance, numbers[0], numbers[1], (int)numbers[2]);
    case GET_STATE: return one->get_state(one->instance, &one->state);
    case SET_STATE: return one->set_state(one->instance, one->state);
    case FREE_STATE: return one->free_state(one->instance, &one->state);
    }
    return OK;
}

/* Carry out so many calls, as far as they are honoured. */
static int honour(Participant *one, int64_t *shared, int64_t *call, int64_t count) {
    for (int64_t k = 0; k < count; k++) {
        const int status = carried_out(one, call);
        if (status < OK || status > WARNING) {
            shared[LAST_STATUS] = status;
            return 0;
        }
        shared[HONOURED]++;
        call += room_of(call[1]);
    }
    return 1;
}

void channel_serve(Channel *c, Participant *one) {
    int64_t *shared = c->shared;
    char byte;
    for (;;) {
        const int got = (int)c->read((int)c->from, &byte, 1);
        if (got == 0) return;
        if (got < 0) continue;
        shared[HONOURED] = shared[LINES] = 0;
        if (honour(one, shared, shared + FIRST_CALL, shared[CALLS_FIRST])) honour(one, shared, shared + shared[CALLS_FURTHER], shared[COUNT_FURTHER]);
        if (shared[LEAVING]) return;
        (void)c->write((int)c->to, &byte, 1);
    }
}
