/* What an instance shows: motion, stress, compliance, diagnostics, and derivatives. */
#ifndef FLEX_INSTANCE_VALUES_H
#define FLEX_INSTANCE_VALUES_H

#include "instance.h"

/* Values of a variable and those that follow it, all alike (Opened). References and types are checked by the caller.
 * ANSWER_FAILED with words in `why`. */
Answer get_numbers(Instance *instance, int64_t variable, int64_t count, double *values, char *why);
/* Derivative of outputs (motion) by inputs over a step as long as the last one. */
Answer instance_derivative(Instance *instance, const int64_t *outputs, int64_t output_count, const int64_t *inputs,
                           int64_t input_count, const double *direction, double *result, char *why);

#endif
