/* An FMU in a coupling, by the functions of FMI 2.0: its share of inputs and signals, its steps, states and results. */
#ifndef FLEX_PARTICIPANT_H
#define FLEX_PARTICIPANT_H

#include <stddef.h>
#include <stdint.h>

/* Its functions are those of its library, or of whoever stands for it. */
typedef struct {
    void *instance;
    int (*set_real)(void *, const unsigned *, size_t, const double *);
    int (*get_real)(void *, const unsigned *, size_t, double *);
    int (*get_integer)(void *, const unsigned *, size_t, int *);
    int (*get_boolean)(void *, const unsigned *, size_t, int *);
    int (*end_initialization)(void *);
    int (*begin_step)(void *, double, double, int); /* or null: what do_step then only waits for */
    int (*do_step)(void *, double, double, int);
    int (*get_state)(void *, void **);
    int (*set_state)(void *, void *);
    int (*free_state)(void *, void **);
    void (*take_back)(void *); /* of the instance: its log goes back to what it was when the state was kept */
    /* Its share of the driven inputs and of the signals; variables of the results, Real, Integer and Boolean, and the
     * columns that they fill. */
    int64_t first_input, inputs, first_signal, signals, recorded[3];
    const unsigned *input_references, *signal_references, *recorded_references;
    const int64_t *recorded_columns;
    /* References, or -1: status.code, internal steps that a step took, and the parameter that says how many it takes at
     * least, with its start value. */
    int64_t status, substeps, fewest;
    double fewest_start;
    int64_t *marks; /* (2): tries of steps so far; whether it logged since its state was kept */
    /* Of the loop. */
    void *state;
    int64_t saved, tried, begun; /* whether a state is kept; internal steps of the last try of a step; whether one is under way */
} Participant;

/* What was asked of an FMU. */
typedef enum { START, TAKE_INPUTS, GIVE_VALUES, TAKE_STEP, SAVE_STATE, GO_BACK, HOLD_STEPS } Asked;
/* A call that was not honoured, or what came of it; `ok` where it was. */
typedef enum { ANSWERED, CALL_FAILED, STEP_REFUSED, NOT_FINITE } Reply;
typedef struct {
    Reply reply;
    int64_t what, status; /* Asked, or the signal; FMI's status */
    double value;         /* of the signal */
} Answer;

/* Each of these is 1 where the FMU did it; else the answer says what went wrong. Vectors are those of all FMUs. */
int participant_take(Participant *one, const double *inputs, Answer *answer);
int participant_give(Participant *one, double *signals, Answer *answer);
int participant_reals(Participant *one, const unsigned *references, int64_t count, double *values, Answer *answer);
/* Begin a step from a time (s) by a step (s), where the FMU can go on beside others. */
int participant_begin_step(Participant *one, double time, double step, Answer *answer);
/* Take it, or wait for its end. */
int participant_step(Participant *one, double time, double step, Answer *answer);
/* What its status.code tells; 0 where it has none. */
int participant_status(Participant *one, int *status, Answer *answer);
/* Fill its columns of a row; values and whole are room for as many numbers. */
int participant_record(Participant *one, double *row, double *values, int *whole, Answer *answer);
int participant_begin(Participant *one, Answer *answer);
int participant_save(Participant *one, Answer *answer);
/* Go back to the state kept; `hold`: the step that is repeated takes no fewer internal steps than its last try. Otherwise
 * the answer would jump by the error of an internal step where one try takes more of them than another. */
int participant_restore(Participant *one, int hold, Answer *answer);
/* Drop the state kept, if any; the next step takes as many internal steps as it wants. */
void participant_forget(Participant *one);

#endif
