/* A component behind the FMI: parameters, inputs, state and outputs of a body. What the standard asks of calls is in fmi2.c;
 * mechanics are the body's. */
#ifndef FLEX_INSTANCE_H
#define FLEX_INSTANCE_H

#include "body.h"
#include "monitor.h"

/* All that follows is in the order of interface.def. */
enum {
#define ROLE(symbol, count) ROLE_##symbol,
#include "interface.def"
    ROLES
};
enum { TYPE_REAL, TYPE_INTEGER, TYPE_BOOLEAN, TYPE_STRING };
/* Parameters by index; from P_FIXED on one for each interface that the scene may fix. */
enum {
#define PARAMETER(symbol, ...) P_##symbol,
#define WATCH(symbol, ...) P_##symbol##_LIMIT, P_ON_##symbol,
#include "interface.def"
    P_FIXED
};
enum {
#define START(symbol, ...) START_##symbol,
#include "interface.def"
};
enum {
#define INTERPOLATION(symbol, ...) INTERPOLATION_##symbol,
#include "interface.def"
};
enum {
#define ON_REFUSAL(symbol, ...) ON_REFUSAL_##symbol,
#include "interface.def"
};
enum {
#define DIAGNOSTIC(symbol, ...) D_##symbol,
#include "interface.def"
    DIAGNOSTICS
};
/* Values of status.code. */
enum {
#define STATE(symbol, ...) STATE_##symbol,
#include "interface.def"
};

enum { TEXT_SIZE = 1024 };
typedef enum { ANSWER_OK, ANSWER_REFUSED, ANSWER_FAILED } Answer;

/* What a call has to say: `status` is an FMI status. */
typedef struct Instance Instance;
typedef void (*Teller)(void *to, int status, const char *text);

/* Make an instance of the FMU's resources folder; null with words in `why` (TEXT_SIZE) where it cannot be. */
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
