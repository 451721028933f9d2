#include "monitor.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "algebra.h"
#include "forces.h"
#include "messages.h"

static const double DEGREES = 57.29577951308232;

/* Where the largest rotation is, in words: the frame's name, between what goes before and after it. */
typedef struct {
    const char *before, *name, *after;
} Where;

static Where most_turned(const Body *body, const double *q) {
    const Program *p = body->p;
    int64_t worst = 0;
    double most = -1.0;
    for (int64_t i = 0; i < p->turnings; i++) {
        double turned[3];
        rows_times(p->turning + 3 * i * p->modes, q, turned, 3, p->modes);
        const double square = dot(turned, turned, 3);
        if (!(square <= most)) {
            most = square;
            worst = i;
        }
    }
    if (!p->frames) return (Where){"the body as one piece", "", ""};
    return (Where){"frame '", name_of(p, p->interfaces + p->turning_frame[worst]), "'"};
}

static double rotation_limit(const Program *p, const Watch *watch) { return watch->limit * (double)p->turning_limit / 100.0; }
static double strain_limit(const Program *p, const Watch *watch) { return watch->limit * (double)p->strain_limit / 100.0; }

int deforms_little(const Monitor *monitor, const Bounds *bounds, const double *q, const Memory *memory) {
    const Watch *rotation = monitor->watch + WATCH_ROTATION, *strain = monitor->watch + WATCH_STRAIN;
    const double turned = rotation_limit(monitor->body->p, rotation), strained = strain_limit(monitor->body->p, strain);
    double most = bounds->rotation > 0.0 ? bounds->rotation : HUGE_VAL;
    if (turned > 0.0 && turned < most && !silenced(rotation, memory->warned[WATCH_ROTATION])) most = turned;
    return deforms_within(monitor->body, q, most, strained > 0.0 && !silenced(strain, memory->warned[WATCH_STRAIN]) ? strained : HUGE_VAL);
}

static void rotation(Body *body, const Watch *watch, const double *q, Memory *memory, Findings *found) {
    const Program *p = body->p;
    const double limit = rotation_limit(p, watch);
    if (!(limit > 0.0) || silenced(watch, memory->warned[WATCH_ROTATION]) || deforms_within(body, q, limit, HUGE_VAL)) return;
    const double most = body_rotations(body, q, 0);
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_ROTATION]);
    if (!text) return;
    const Where at = most_turned(body, q);
    snprintf(text, FINDING_TEXT, SAY_ROTATION, DEGREES * most, at.before, at.name, at.after, DEGREES * limit,
             text_at(p->advice, p->advice_bytes, ADVICE_ROTATION));
}

static void strain(Body *body, const Watch *watch, const double *q, Memory *memory, Findings *found) {
    const double limit = strain_limit(body->p, watch);
    if (!(limit > 0.0) || silenced(watch, memory->warned[WATCH_STRAIN]) || deforms_within(body, q, HUGE_VAL, limit)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_STRAIN]);
    if (text) snprintf(text, FINDING_TEXT, SAY_STRAIN, 100.0 * body_strain(body, q), 100.0 * limit);
}

int within_bounds(Body *body, const Bounds *bounds, const StepEnd *end, char *why, size_t size) {
    const Program *p = body->p;
    int64_t interface = 0;
    if (!end->calm && bounds->rotation > 0.0 && !deforms_within(body, end->q, bounds->rotation, HUGE_VAL)) {
        const Where at = most_turned(body, end->q);
        snprintf(why, size, SAY_BOUND_ROTATION, DEGREES * body_rotations(body, end->q, 0), at.before, at.name, at.after,
                 DEGREES * bounds->rotation);
        return 0;
    }
    const double far = farthest(p, end->motion, &interface), length = p->body_size[0];
    if (!(bounds->displacement > 0.0) || !(length > 0.0) || far <= bounds->displacement * length) return 1;
    snprintf(why, size, SAY_BOUND_DISPLACEMENT, name_of(p, interface), far, far / length, bounds->displacement);
    return 0;
}

static void spinning(const Monitor *monitor, const double *q, const double *v, Memory *memory, Findings *found) {
    Body *body = monitor->body;
    const Watch *watch = monitor->watch + WATCH_SPIN;
    const Program *p = body->p;
    const double ratio = body_spin(body, q, v);
    if (!(watch->limit > 0.0) || !(ratio > watch->limit)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_SPIN]);
    if (!text) return;
    const double first = monitor->scale.pace * p->omega[p->rigid];
    snprintf(text, FINDING_TEXT, SAY_SPIN,
             ratio * first, 100.0 * ratio, first / 6.283185307179586, 100.0 * watch->limit,
             text_at(p->advice, p->advice_bytes, ADVICE_SPIN));
}

static void momentum(Body *body, const Watch *watch, const double *q, const double *v, Memory *memory, Findings *found) {
    const Program *p = body->p;
    body_momentum(body, q, v, &memory->course.momentum);
    if (!(watch->limit > 0.0) || !(memory->course.momentum.drift > watch->limit)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_MOMENTUM]);
    if (!text) return;
    snprintf(text, FINDING_TEXT, SAY_MOMENTUM,
             100.0 * memory->course.momentum.drift, 100.0 * watch->limit, text_at(p->advice, p->advice_bytes, ADVICE_SPIN));
}

/* Loads that push a free body together turn it round where they keep their direction. Is their couple this large, over what it
 * may be, and was it as small as 1 / CHANCE before, the least disturbance has decided which way. */
static const double TURNING = 0.3, CHANCE = 1.2e6, BALANCED = 0.01;

static void turning_round(const Monitor *monitor, const StepEnd *end, Memory *memory, Findings *found) {
    const Program *p = monitor->body->p;
    const Watch *watch = monitor->watch + WATCH_STABILITY;
    double sum[3] = {0.0}, couple[3] = {0.0}, size = 0.0, most = 0.0, pulled = 0.0, *calm = &memory->course.calm;
    for (int64_t k = 0; k < p->interfaces; k++) {
        const double *force = end->inputs + 6 * k, *x = p->point + 3 * (p->frames + k), *x0 = p->point + 3 * p->frames;
        double arm[3], moment[3];
        for (int i = 0; i < 3; i++) arm[i] = x[i] - x0[i] + end->motion[6 * k + i] - end->motion[i];
        cross(arm, force, moment);
        for (int i = 0; i < 3; i++) {
            sum[i] += force[i];
            couple[i] += moment[i] + force[3 + i];
        }
        size += norm(force, 3);
        most += norm(force, 3) * norm(arm, 3);
        pulled += dot(force, arm, 3);
    }
    const double share = norm(couple, 3) / fmax(most, DBL_MIN);
    *calm = pulled < 0.0 && norm(sum, 3) <= BALANCED * size ? fmax(*calm, 1.0 / fmax(share, DBL_MIN)) : 0.0;
    if (!(watch->limit > 0.0) || !(*calm > CHANCE) || !(share > TURNING)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_STABILITY]);
    if (text) snprintf(text, FINDING_TEXT, SAY_TURNING_ROUND);
}

void find_softness(const Monitor *monitor, Memory *memory, Findings *found) {
    const Watch *watch = monitor->watch + WATCH_SOFTNESS;
    const Program *p = monitor->body->p;
    body_off_by_softness(monitor->body, softer_at_most(&memory->error, memory->course.astray.energy), &memory->course.astray);
    const double error = memory->course.astray.error[BY_SOFTNESS];
    if (!(watch->limit > 0.0) || !(error > watch->limit)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_SOFTNESS]);
    if (text) snprintf(text, FINDING_TEXT, SAY_SOFTNESS, 100.0 * error, 100.0 * watch->limit, text_at(p->advice, p->advice_bytes, ADVICE_ERROR));
}

static void going_astray(const Monitor *monitor, const StepEnd *end, Memory *memory, Findings *found) {
    static const int watches[BY_SOFTNESS] = {WATCH_INERTIA, WATCH_ASTRAY};
    Body *body = monitor->body;
    body_astray(body, end, memory->drift, memory->astray, monitor->shape, &memory->course.astray);
    find_softness(monitor, memory, found);
    for (int k = 0; k < BY_SOFTNESS; k++) {
        const Watch *watch = monitor->watch + watches[k];
        const double error = memory->course.astray.error[k];
        char *text = watch->limit > 0.0 && error > watch->limit ? add_finding(found, watch->action, memory->warned + watches[k]) : 0;
        if (text && k == BY_STEPS) snprintf(text, FINDING_TEXT, SAY_ASTRAY, 100.0 * error, 100.0 * watch->limit);
        if (!text || k == BY_STEPS) continue;
        snprintf(text, FINDING_TEXT, SAY_INERTIA, body->p->inertial ? "the mass polynomial" : "constant mass", 100.0 * error, 100.0 * watch->limit,
                 body->p->inertial ? "with mass = \"configuration\" in [formulation]"
                                   : "with mass = \"polynomial\" in [formulation], which bodies in one piece have");
    }
}

void find_truncation(const Monitor *monitor, Memory *memory, Findings *found) {
    const Watch *watch = monitor->watch + WATCH_TRUNCATION;
    const Truncation *so_far = &memory->course.truncation;
    /* The mean of a motion that has only begun says nothing of it. */
    const int meant = watch->action == ON_WARN && truncation_settled(monitor->body, so_far);
    const double off = meant ? so_far->mean : so_far->error;
    if (!(watch->limit > 0.0) || !(off > watch->limit)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_TRUNCATION]);
    if (!text) return;
    snprintf(text, FINDING_TEXT, SAY_TRUNCATION, 100.0 * off, 100.0 * watch->limit);
}

/* In its first moments a motion is small, whatever a load is going to do: then the error over it tells little. */
static void truncation(const Monitor *monitor, const StepEnd *end, Memory *memory, Findings *found) {
    body_truncation(monitor->body, end, monitor->shape, &memory->course.truncation);
    if (monitor->watch[WATCH_TRUNCATION].action != ON_WARN || truncation_settled(monitor->body, &memory->course.truncation))
        find_truncation(monitor, memory, found);
}

/* Whether a step is refused for what was found. */
static int refuses(const Findings *found) {
    for (int i = 0; i < found->count; i++)
        if (found->action[i] != ON_WARN) return 1;
    return 0;
}

void look(const Monitor *monitor, const StepEnd *end, Memory *memory, Findings *found) {
    Body *body = monitor->body;
    const Watch *watch = monitor->watch;
    const int64_t loads = body->p->loads;
    const double *q = end->q, *v = end->v, *inputs = end->inputs, square = end->rests ? 0.0 : dot(inputs, inputs, loads);
    double due[WAITING] = {0.0};
    found->count = 0;
    /* Of loads beyond 1e154 the square is no number any more. */
    if (square > memory->largest) memory->largest = square < DBL_MAX ? square : DBL_MAX;
    if (!end->calm) {
        rotation(body, watch + WATCH_ROTATION, q, memory, found);
        strain(body, watch + WATCH_STRAIN, q, memory, found);
    }
    due[LOOK_ERROR] = error_due(monitor, end, memory);
    truncation(monitor, end, memory, found);
    if (end->step > 0.0 && body->p->spins) {
        spinning(monitor, q, v, memory, found);
        momentum(body, watch + WATCH_MOMENTUM, q, v, memory, found);
    }
    if (end->step > 0.0 && !body->p->rigid && (forces_depend(body) || body->p->stretches || !mass_is_exact(body->p))) going_astray(monitor, end, memory, found);
    if (body->p->rigid == 6 && !body->p->followers) turning_round(monitor, end, memory, found);
    if (!end->rests) loads_due(monitor, inputs, memory, due);
    /* A step that may be refused, and the start, are looked at in full. */
    const Watch *of[WAITING] = {watch + WATCH_ERROR, watch + WATCH_STABILITY, watch + WATCH_MISSED};
    for (int kind = 0; kind < WAITING; kind++)
        if (due[kind] > 0.0 && (of[kind]->action != ON_WARN || end->step == 0.0 || (kind == LOOK_ERROR && monitor->interval <= 1.0))) {
            look_at_once(monitor, kind, q, inputs, memory->error.deflection, memory, found);
            due[kind] = 0.0;
        }
    if (refuses(found)) return;
    for (int kind = 0; kind < WAITING; kind++) submit(monitor, kind, end, due[kind], memory);
    if (due[LOOK_STABILITY] > 0.0) memory->beyond = watch[WATCH_STABILITY].limit;
    go_on(monitor, memory, found);
}
