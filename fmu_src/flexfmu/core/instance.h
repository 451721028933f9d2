/* A component behind the FMI: parameters, inputs, state and outputs of a body. What the standard asks of calls is in fmi2.c;
 * mechanics are the body's. */
#ifndef FLEX_INSTANCE_H
#define FLEX_INSTANCE_H

#include "body.h"
#include "monitor.h"

/* Roles of variables, as program/description.py writes them. */
enum { ROLE_INPUT, ROLE_MOTION, ROLE_RATE, ROLE_STRESS, ROLE_COMPLIANCE, ROLE_STATUS, ROLE_PARAMETER, ROLE_DIAGNOSTIC };
enum { TYPE_REAL, TYPE_INTEGER, TYPE_BOOLEAN, TYPE_STRING };
/* Parameters by index; from P_FIXED on one for each interface that the scene may fix. */
enum {
    P_METHOD, P_INITIALIZATION, P_INTERPOLATION, P_DAMPING_SCALE, P_STEP_LIMIT, P_STEP_TOLERANCE, P_STEP_MOST, P_STEP_FEWEST, P_ON_STEP,
    P_ROTATION_LIMIT, P_ON_ROTATION, P_STABILITY_LIMIT, P_ON_STABILITY, P_MISSED_LIMIT, P_ON_MISSED, P_SPIN_LIMIT,
    P_ON_SPIN, P_MOMENTUM_LIMIT, P_ON_MOMENTUM, P_INERTIA_LIMIT, P_ON_INERTIA, P_FIXED
};
enum { START_AT_REST, START_STATIC };
enum { INPUT_CONSTANT, INPUT_LINEAR, INPUT_RAMP };
enum { REFUSE_DISCARD, REFUSE_TERMINATE };
enum { D_ROTATION, D_STABILITY, D_MISSED, D_SPIN, D_MOMENTUM, D_INERTIA, D_STEP_ERROR, D_STRAIN, D_KINETIC, D_ITERATIONS, D_SUBSTEPS };
/* Values of status.code. */
enum { STATE_SOUND, STATE_REFUSED, STATE_PASSED };

enum { MESSAGE = 1024 };
typedef enum { ANSWER_OK, ANSWER_REFUSED, ANSWER_FAILED } Answer;

/* What a call has to say: `status` is an FMI status. */
typedef struct Instance Instance;
typedef void (*Teller)(void *to, int status, const char *text);

/* Make an instance of the FMU's resources folder; null with words in `why` (MESSAGE) where it cannot be. */
Instance *instance_open(const char *folder, const char *guid, char *why);
void instance_close(Instance *instance);
/* Whom warnings are told. */
void instance_tell(Instance *instance, Teller teller, void *to);
/* As after instance_open. */
void instance_reset(Instance *instance);

const Program *instance_description(const Instance *instance);
/* The text of a variable: its name, or a choice of a String from 1 on. "" where there is none. */
const char *variable_text(const Instance *instance, int64_t variable, int64_t index, char *room);

/* Values. References and types are checked by the caller. ANSWER_FAILED with words in `why`. */
Answer get_number(Instance *instance, int64_t variable, double *value, char *why);
void set_parameter(Instance *instance, int64_t index, double value);
/* Whether a parameter may be set between steps. */
int parameter_is_tunable(int64_t index);
void set_input(Instance *instance, int64_t index, double value);
void set_input_rate(Instance *instance, int64_t index, double value);
/* Inputs or parameters were set before the first step: where the body starts is open again. */
void start_changed(Instance *instance);

/* Fix parameters and the start. */
Answer instance_start(Instance *instance, char *why);
/* ANSWER_REFUSED leaves the state as it was; ANSWER_FAILED ends the simulation. */
Answer instance_step(Instance *instance, double time, double step, char *why);
/* The last time that was reached. */
double instance_time(const Instance *instance);
void instance_begin_at(Instance *instance, double time);
/* Derivative of outputs (motion) by inputs over a step as long as the last one. */
Answer instance_derivative(Instance *instance, const int64_t *outputs, int64_t output_count, const int64_t *inputs,
                           int64_t input_count, const double *direction, double *result, char *why);

/* State as one block of bytes. */
int64_t instance_state_size(const Instance *instance);
void instance_save(const Instance *instance, void *block);
/* Null, or what is wrong with the block; the instance is then as it was. */
const char *instance_restore(Instance *instance, const void *block, int64_t size);

#endif
