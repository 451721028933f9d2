/* Internal steps with the mass of the deformed body (docs/theory.md section 9): the rule of step_plain.c with (15).
 *
 * The modes feel what the mass has beyond that of the undeformed body as a force. Momentum enters its mean by its
 * difference, not by impulses at the ends, so that modes which the step does not resolve are pushed as by a force that is
 * spread over it. Places and rates at the end are linear in that mean, which is the only unknown. It is found by a fixed
 * derivative that knows of the mass alone, where the step is foreseen to end, and by what earlier rounds have shown of the true
 * one. */
#ifndef FLEX_STEP_INERTIAL_H
#define FLEX_STEP_INERTIAL_H

#include "steps.h"

void inertial_demand(const Body *body, Arena *arena);
int inertial_steps(Body *body, Substeps *all, double *q, double *v);

#endif
