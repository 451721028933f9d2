/* How ties pull on q in one place, and what that makes of the modes' response, (17a) of docs/theory.md. */
#ifndef FLEX_TIES_H
#define FLEX_TIES_H

#include "data.h"

typedef struct {
    double *rows, *answer, *hold; /* (n, m) J, (n, m) J B, (n, n) (1 + S J B Jᵀ / 2)⁻¹ S */
    double *square, *strain, *force;
    double *loads, *factors, *bent; /* (6K), (n, 6K), (n, bending, m) */
} Pull;

void take_pull(const Body *body, Arena *arena, Pull *pull);
/* Returns 0 where the ties' response is singular. */
int pull_at(const Body *body, const Rule *rule, const Configuration *at, const Configuration *end, int64_t *pivot, Pull *pull);
/* out = what q does under x = g_q f, the ties giving way as they do in the place of `pull`; where q has gone a `way` (else
 * null), under x and what is linear in the way. */
void respond(const Body *body, const Rule *rule, Pull *pull, const double *x, const double *way, double *out);

#endif
