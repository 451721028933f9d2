#include "participant.h"

#include <math.h>

/* Statuses of FMI 2.0: beyond a warning a call was not honoured; that of a step refused. */
enum { WARNING = 1, DISCARD = 2 };

static int answered(int status, Asked what, Answer *answer) {
    if (status >= 0 && status <= WARNING) return 1;
    *answer = (Answer){CALL_FAILED, what, status, 0.0};
    return 0;
}

int participant_take(Participant *one, const double *inputs, Answer *answer) {
    if (!one->inputs) return 1;
    return answered(one->set_real(one->instance, one->input_references, (size_t)one->inputs, inputs + one->first_input), TAKE_INPUTS, answer);
}

int participant_reals(Participant *one, const unsigned *references, int64_t count, double *values, Answer *answer) {
    return !count || answered(one->get_real(one->instance, references, (size_t)count, values), GIVE_VALUES, answer);
}

int participant_give(Participant *one, double *signals, Answer *answer) {
    double *own = signals + one->first_signal;
    if (!participant_reals(one, one->signal_references, one->signals, own, answer)) return 0;
    for (int64_t i = 0; i < one->signals; i++)
        if (!isfinite(own[i])) {
            *answer = (Answer){NOT_FINITE, i, 0, own[i]};
            return 0;
        }
    return 1;
}

/* A whole number of a reference. */
static int whole_number(Participant *one, int64_t reference, int *value, Answer *answer) {
    const unsigned references[1] = {(unsigned)reference};
    return answered(one->get_integer(one->instance, references, 1, value), GIVE_VALUES, answer);
}

int participant_begin_step(Participant *one, double time, double step, Answer *answer) {
    if (!one->begin_step) return 1;
    one->marks[0]++;
    one->begun = answered(one->begin_step(one->instance, time, step, !one->saved), TAKE_STEP, answer);
    return (int)one->begun;
}

int participant_step(Participant *one, double time, double step, Answer *answer) {
    one->marks[0] += !one->begun;
    one->begun = 0;
    /* A step that may be repeated must leave what lies before it within reach. */
    const int status = one->do_step(one->instance, time, step, !one->saved);
    if (!answered(status, TAKE_STEP, answer)) {
        if (status == DISCARD) answer->reply = STEP_REFUSED;
        return 0;
    }
    int count = 1;
    if (one->saved && one->fewest >= 0 && !whole_number(one, one->substeps, &count, answer)) return 0;
    one->tried = count;
    return 1;
}

int participant_status(Participant *one, int *status, Answer *answer) {
    *status = 0;
    return one->status < 0 || whole_number(one, one->status, status, answer);
}

int participant_record(Participant *one, double *row, double *values, int *whole, Answer *answer) {
    const unsigned *references = one->recorded_references;
    const int64_t *columns = one->recorded_columns;
    for (int type = 0; type < 3; type++) {
        const size_t count = (size_t)one->recorded[type];
        int status = 0;
        if (count && type == 0) status = one->get_real(one->instance, references, count, values);
        if (count && type == 1) status = one->get_integer(one->instance, references, count, whole);
        if (count && type == 2) status = one->get_boolean(one->instance, references, count, whole);
        if (!answered(status, GIVE_VALUES, answer)) return 0;
        for (size_t i = 0; i < count; i++) row[columns[i]] = type == 0 ? values[i] : type == 1 ? whole[i] : whole[i] != 0;
        references += count;
        columns += count;
    }
    return 1;
}

int participant_begin(Participant *one, Answer *answer) { return answered(one->end_initialization(one->instance), START, answer); }

int participant_save(Participant *one, Answer *answer) {
    participant_forget(one);
    if (!answered(one->get_state(one->instance, &one->state), SAVE_STATE, answer)) return 0;
    one->saved = 1;
    one->marks[1] = 0;
    return 1;
}

/* Set how many internal steps it takes at least. */
static int set_fewest(Participant *one, double fewest, Answer *answer) {
    const unsigned references[1] = {(unsigned)one->fewest};
    return answered(one->set_real(one->instance, references, 1, &fewest), HOLD_STEPS, answer);
}

int participant_restore(Participant *one, int hold, Answer *answer) {
    if (!answered(one->set_state(one->instance, one->state), GO_BACK, answer)) return 0;
    if (one->marks[1]) one->take_back(one->instance);
    one->marks[1] = 0;
    return !hold || one->fewest < 0 || one->tried <= 1 || set_fewest(one, (double)one->tried, answer);
}

void participant_forget(Participant *one) {
    Answer unheard;
    if (one->saved) {
        one->free_state(one->instance, &one->state);
        one->state = 0;
        one->saved = 0;
        if (one->fewest >= 0 && one->tried > 1) set_fewest(one, one->fewest_start, &unheard);
    }
    one->tried = 1;
}
