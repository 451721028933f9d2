/* What an instance is watched for after each step, and tells. */
#ifndef FLEX_INSTANCE_WATCH_H
#define FLEX_INSTANCE_WATCH_H

#include "instance_data.h"

/* The answer, kept in status.code. */
Answer instance_failed(Instance *instance, Answer answer);
/* The same where the core refuses a call for want of room. */
Answer instance_lacks_room(Instance *instance, char *why);
/* Motion and rates at q and v, in times of the body; 0 where the core lacks room. */
int find_motion_at(Instance *instance, const double *q, const double *v);
/* What a refused step means to the run. */
Answer step_refused(const Instance *instance);
/* By how much internal steps are divided once more as what they miss nears its limit, or would be, were it `soon` times as much. */
int64_t finer_by(const Instance *x, double soon);
/* What is left to looks of a step that took so many rounds, where the last one took so many internal steps: an ordinary one takes
 * six for each, and a slice for each is little beside it. */
void leave_to_looks(Instance *x, double rounds, double substeps);
/* Look at where a step of the body ends; ANSWER_OK where only warnings were found, which are told. Finds the motion there.
 * `rests`: the step before was the same, and nothing moved in either. */
Answer inspect(Instance *instance, const double *q, const double *v, double step, const double *inputs, int rests, char *why);
/* Room for looks at the body that is known, their pieces counted; 0 without memory. */
int prepare_looks(Instance *instance);
/* What is still to be looked at. */
void inspect_rest(Instance *instance);
/* Ask for the memory that a step uses, and the slice of a look. */
void fetch_step(const Instance *x);

#endif
