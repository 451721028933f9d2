#include "monitor.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "algebra.h"
#include "messages.h"

/* Share of the largest loads' norm by which loads must have changed for stability to be looked at again. */
static const double CHANGED = 0.05;
static const double DEGREES = 57.29577951308232;

enum { ADVICE_ROTATION, ADVICE_MISSED, SOURCE_MISSED, ADVICE_SPIN };

static const char *name_of(const Program *p, int64_t index) { return text_at(p->names, p->name_bytes, index); }
static const char *input_name(const Program *p, int64_t input) { return name_of(p, p->interfaces + p->frames + input); }

static char *add_finding(Findings *found, OnLimit action, double *warned) {
    /* What was warned of is not said again. */
    if (action == ON_WARN && *warned != 0.0) return 0;
    *warned = 1.0;
    found->action[found->count] = action;
    return found->text[found->count++];
}

static void rotation(Body *body, const Watch *watch, const double *q, Memory *memory, Findings *found) {
    const Program *p = &body->p;
    const double limit = watch->limit * (double)p->turning_limit / 100.0;
    if (!(limit > 0.0) || body_rotations(body, q, 0) <= limit) return;
    int64_t worst = 0;
    double most = -1.0;
    for (int64_t i = 0; i < p->turnings; i++) {
        double turned[3];
        rows_times(p->turning + 3 * i * p->modes, q, turned, 3, p->modes);
        const double angle = norm(turned, 3);
        if (!(angle <= most)) {
            most = angle;
            worst = i;
        }
    }
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_ROTATION]);
    if (!text) return;
    const int framed = p->frames > 0;
    snprintf(text, FINDING_TEXT, SAY_ROTATION,
             DEGREES * most, framed ? "frame '" : "the body as one piece",
             framed ? name_of(p, p->interfaces + p->turning_frame[worst]) : "", framed ? "'" : "", DEGREES * limit,
             text_at(p->advice, p->advice_bytes, ADVICE_ROTATION));
}

static void stability(Body *body, const Watch *watch, const double *q, const double *inputs, Memory *memory, double *alone,
                      double *shape, Findings *found) {
    const Program *p = &body->p;
    if (!(watch->limit > 0.0) || body_is_stable(body, inputs, q, watch->limit)) return;
    const double margin = body_stability(body, inputs, q, shape);
    int64_t mode = 0, worst = 0;
    double most = -HUGE_VAL;
    for (int64_t j = 0; j < p->modes; j++)
        if (fabs(shape[j]) > fabs(shape[mode])) mode = j;
    for (int64_t i = 0; i < p->loads; i++) {
        if (inputs[i] == 0.0) continue;
        memset(alone, 0, (size_t)p->loads * sizeof(double));
        alone[i] = inputs[i];
        const double softening = body_softening(body, alone, q, shape);
        if (softening > most) {
            most = softening;
            worst = i;
        }
    }
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_STABILITY]);
    if (!text) return;
    snprintf(text, FINDING_TEXT, SAY_STABILITY,
             margin <= 0.0 ? "beyond the critical load" : "near the critical load", margin, watch->limit,
             input_name(p, worst), inputs[worst], most, (long long)mode + 1, p->omega[mode] / 6.283185307179586);
}

static void missed(Body *body, const Watch *watch, const double *inputs, Memory *memory, Findings *found) {
    const Program *p = &body->p;
    if (!(watch->limit > 0.0) || !body_may_miss(body, inputs, watch->limit)) return;
    double margin;
    const double error = body_missed(body, inputs, &margin);
    /* The quick looks are of every shape of the body, loaded or not. */
    if (error <= watch->limit && error < 1.0) return;
    int64_t worst = 0;
    for (int64_t i = 1; i < p->loads; i++)
        if (fabs(inputs[i]) * p->judge_missed_bound[i] > fabs(inputs[worst]) * p->judge_missed_bound[worst]) worst = i;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_MISSED]), words[96];
    if (!text) return;
    snprintf(words, sizeof words, margin > 0.0 ? "deflections are off by up to %.3g %%"
                                               : "the loads are beyond the critical load, which the method does not know of",
             100.0 * error);
    snprintf(text, FINDING_TEXT, SAY_MISSED,
             text_at(p->advice, p->advice_bytes, SOURCE_MISSED), words, 100.0 * watch->limit, input_name(p, worst),
             inputs[worst], text_at(p->advice, p->advice_bytes, ADVICE_MISSED));
}

static void spinning(Body *body, const Watch *watch, const double *q, const double *v, Memory *memory, Findings *found) {
    const Program *p = &body->p;
    const double ratio = body_spin(body, q, v);
    if (!(watch->limit > 0.0) || !(ratio > watch->limit)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_SPIN]);
    if (!text) return;
    const double first = p->omega[p->rigid];
    snprintf(text, FINDING_TEXT, SAY_SPIN,
             ratio * first, 100.0 * ratio, first / 6.283185307179586, 100.0 * watch->limit,
             text_at(p->advice, p->advice_bytes, ADVICE_SPIN));
}

static void momentum(Body *body, const Watch *watch, const double *q, const double *v, Memory *memory, Findings *found) {
    const Program *p = &body->p;
    body_momentum(body, q, v, &memory->momentum);
    if (!(watch->limit > 0.0) || !(memory->momentum.drift > watch->limit)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_MOMENTUM]);
    if (!text) return;
    snprintf(text, FINDING_TEXT, SAY_MOMENTUM,
             100.0 * memory->momentum.drift, 100.0 * watch->limit, text_at(p->advice, p->advice_bytes, ADVICE_SPIN));
}

static void inertia(Body *body, const Watch *watch, const double *q, const double *v, Memory *memory, Findings *found) {
    body_missed_inertia(body, q, v, &memory->inertia);
    const double share = memory->inertia.kinetic > 0.0 ? memory->inertia.missed / memory->inertia.kinetic : 0.0;
    if (!(watch->limit > 0.0) || !(share > watch->limit)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_INERTIA]);
    if (!text) return;
    snprintf(text, FINDING_TEXT, SAY_INERTIA,
             100.0 * share, 100.0 * watch->limit);
}

void look(Body *body, const Watch *watch, const double *q, const double *v, int stepped, const double *inputs, Memory *memory, double *inputs_room,
          double *shape_room, Findings *found) {
    const int64_t loads = body->p.loads;
    const double square = dot(inputs, inputs, loads);
    found->count = 0;
    /* Of loads beyond 1e154 the square is no number any more. */
    if (square > memory->largest) memory->largest = square < DBL_MAX ? square : DBL_MAX;
    rotation(body, watch + WATCH_ROTATION, q, memory, found);
    if (stepped && body->p.spins) {
        spinning(body, watch + WATCH_SPIN, q, v, memory, found);
        momentum(body, watch + WATCH_MOMENTUM, q, v, memory, found);
    }
    if (stepped && body->p.missed_modes) inertia(body, watch + WATCH_INERTIA, q, v, memory, found);
    if (!(watch[WATCH_STABILITY].limit > 0.0 || watch[WATCH_MISSED].limit > 0.0)) return;
    double change = 0.0;
    for (int64_t i = 0; i < loads; i++) change += (inputs[i] - memory->inputs[i]) * (inputs[i] - memory->inputs[i]);
    if (!(change > CHANGED * CHANGED * memory->largest)) return;
    stability(body, watch + WATCH_STABILITY, q, inputs, memory, inputs_room, shape_room, found);
    if (!(memory->warned[WATCH_MISSED] != 0.0 && watch[WATCH_MISSED].action == ON_WARN))
        missed(body, watch + WATCH_MISSED, inputs, memory, found);
    memcpy(memory->inputs, inputs, (size_t)loads * sizeof(double));
}
