/* Why a step or an equilibrium was refused, in words. */
#include "messages.h"

#include <math.h>
#include <stdio.h>

#include "body.h"

void body_refusal(const Body *body, int answer, double step, const Work *work, char *text, int64_t size) {
    const double most = body->limits.most;
    const size_t room = (size_t)size;
    char error[64] = "unsettled";
    switch (answer) {
    case FLEX_BAD_STEP: snprintf(text, room, SAY_BAD_STEP, step); return;
    case FLEX_NOT_FINITE: snprintf(text, room, SAY_NOT_FINITE); return;
    case FLEX_NO_ROOM: snprintf(text, room, SAY_NO_ROOM); return;
    case FLEX_BEYOND_MASS: snprintf(text, room, SAY_BEYOND_MASS, step); return;
    case FLEX_TOO_MANY_STEPS:
        snprintf(text, room, SAY_TOO_MANY_STEPS, step, (long long)work->substeps,
                 body->limits.longest > 0.0 ? "internal_step.limit" : "the slowest vibration", most);
        return;
    case FLEX_TOO_MUCH_WORK:
        if (isfinite(work->error)) snprintf(error, sizeof error, "error %.2g", work->error);
        snprintf(text, room, SAY_TOO_MUCH_WORK, step, most, (long long)work->substeps, error, body->limits.tolerance,
                 (long long)work->iterations);
        return;
    default: snprintf(text, room, SAY_NOT_CONVERGED, step);
    }
}

void body_static_refusal(const Body *body, int answer, double share, char *text, int64_t size) {
    const size_t room = (size_t)size;
    switch (answer) {
    case FLEX_NO_ROOM: snprintf(text, room, SAY_NO_ROOM); return;
    case FLEX_FREE: snprintf(text, room, SAY_FREE, (long long)body->p->rigid, body->p->rigid > 1 ? "s" : ""); return;
    case FLEX_TOO_MUCH_WORK: snprintf(text, room, SAY_STATIC_WORK, 100.0 * share, body->limits.most); return;
    default:
        snprintf(text, room, SAY_BEYOND_CRITICAL, 100.0 * share, text_at(body->p->advice, body->p->advice_bytes, ADVICE_LIMIT));
    }
}
