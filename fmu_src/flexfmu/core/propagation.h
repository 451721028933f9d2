/* Exact propagation of damped linear modes over a step of any length (docs/theory.md section 6), and what ties make of
 * it (section 10). Source: e.g. M. Geradin, D. J. Rixen, Mechanical Vibrations, 3rd ed., section 2.8 (Duhamel). */
#ifndef FLEX_PROPAGATION_H
#define FLEX_PROPAGATION_H

#include "data.h"

void take_rules(Body *body, Arena *arena);
void take_rule(const Body *body, Arena *arena, Rule *rule);
/* The rule of one mode of frequency w and damping ratio z. */
void propagate(const Rule *rule, int64_t mode, double w, double z);
/* The rule of the middle, which keeps energy as well, of a stiffness and 2 zeta w. */
void propagate_middle(const Rule *rule, int64_t mode, double stiffness, double rate);
/* The rule of a length of step; the last few are kept, since a master hardly ever changes its step. */
const Rule *rule_of(Body *body, double step);

#endif
