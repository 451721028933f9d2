/* What the three kinds of internal steps share: room for a step's ends, and loads over it. */
#include "internal.h"

void take_ends(const Body *body, Arena *arena, Ends *ends) {
    take_configuration(body, arena, &ends->first);
    take_configuration(body, arena, &ends->second);
    take_configuration(body, arena, &ends->middle);
    take_loads(body, arena, &ends->loads);
}

int64_t ends_size(const Body *body) {
    Arena count = {0, 0};
    Ends ends;
    take_ends(body, &count, &ends);
    return count.used;
}

void spread_at(const Body *body, const Division *d, double place, double *scratch, Loads *loads) {
    const double share = place / (double)d->count;
    for (int64_t i = 0; i < body->p.loads; i++)
        scratch[i] = d->inputs[i] + share * (d->inputs_end[i] - d->inputs[i]);
    spread(body, scratch, loads);
}

void spread_growth(const Body *body, const Division *d, Loads *loads, double *growth) {
    const int64_t m = body->p.modes;
    for (int64_t j = 0; j < m; j++) growth[j] = 0.0;
    spread(body, d->inputs, loads);
    if (!d->inputs_end) return;
    for (int64_t j = 0; j < m; j++) growth[j] = -loads->constant[j] / (double)d->count;
    spread(body, d->inputs_end, loads);
    for (int64_t j = 0; j < m; j++) growth[j] += loads->constant[j] / (double)d->count;
}
