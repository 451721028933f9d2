/* A flexible body under one method: equilibrium, steps, motion and what it is watched for. Knows nothing of FMI.
 *
 * All that those above may call. What a call overwrites stays as it was unless the answer is FLEX_OK. */
#ifndef FLEX_BODY_H
#define FLEX_BODY_H

#include "certificate.h"
#include "compliance.h"
#include "data.h"
#include "deformation.h"
#include "motion.h"
#include "stability.h"
#include "statics.h"
#include "stepping.h"
#include "surface.h"
#include "watch.h"

/* Hash of the C files that this was compiled from; empty where the command did not say. */
const char *core_sources(void);

/* Make a body of an image that takes arrays from no other, which is copied; null with words in `why` where it cannot be. */
Body *body_open(const void *image, int64_t size, const char **why);
/* Make a body of the file `name` in a folder, whose program it shares with others; it may take arrays from that of `base`, or
 * null. `why` is null where there is no such file. */
Body *body_open_file(const char *folder, const char *name, const Body *base, const char **why);
/* What tells a program from others: the checksum in its head. */
uint64_t body_mark(const Body *body);
void body_close(Body *body);
/* Bytes of the program and of all workspaces: no call takes more. */
int64_t body_bytes(const Body *body);
/* Options; FLEX_BAD_OPTION where one is out of range. */
int body_options(Body *body, double damping_scale, const StepLimits *limits);

/* What a step was refused for, in words. */
void body_refusal(const Body *body, int answer, double step, const Work *work, char *text, int64_t size);
/* The same of an equilibrium that reached a share of the load. */
void body_static_refusal(const Body *body, int answer, double share, char *text, int64_t size);

#endif
