/* A component behind the FMI: parameters and inputs of a body, its start and its steps. What the standard asks of calls is in
 * fmi2.c; mechanics are the body's. */
#ifndef FLEX_INSTANCE_H
#define FLEX_INSTANCE_H

#include "instance_data.h"
#include "instance_watch.h"

/* Make an instance of the FMU's resources folder; null with words in `why` (TEXT_SIZE) where it cannot be. */
Instance *instance_open(const char *folder, const char *guid, char *why);
void instance_close(Instance *instance);
/* Whom warnings are told. */
void instance_tell(Instance *instance, Teller teller, void *to);
/* Take the body and its shadow away: which they are is open again. */
void instance_forget_body(Instance *instance);
/* As after instance_open. */
void instance_reset(Instance *instance);

const Program *instance_description(const Instance *instance);
/* The text of a variable: its name, or a choice of a String from 1 on. "" where there is none. */
const char *variable_text(const Instance *instance, int64_t variable, int64_t index, char *room);

void set_parameter(Instance *instance, int64_t index, double value);
/* Whether a parameter may be set between steps. */
int parameter_is_tunable(int64_t index);
/* Inputs from `index` on. */
void set_inputs(Instance *instance, int64_t index, int64_t count, const double *values);
void set_input_rate(Instance *instance, int64_t index, double value);
/* Inputs or parameters were set before the first step: where the body starts is open again. */
void start_changed(Instance *instance);

/* Fix parameters and the start. */
Answer instance_start(Instance *instance, char *why);
/* ANSWER_REFUSED leaves the state as it was; ANSWER_FAILED ends the simulation. A refused step is tried at most so many
 * times at half its length; those left are told. */
Answer instance_step(Instance *instance, double time, double step, int *halvings, char *why);
/* Tell what is still to be looked at. */
void instance_end(Instance *instance);
/* Body and state, found from parameters and inputs when first asked for. */
Answer instance_begin(Instance *instance, char *why);
/* The last time that was reached. */
double instance_time(const Instance *instance);
void instance_begin_at(Instance *instance, double time);
#endif
