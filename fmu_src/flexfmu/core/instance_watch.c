#include "instance_watch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "algebra.h"
#include "messages.h"

Answer instance_failed(Instance *x, Answer answer) {
    x->single[S_STATUS] = STATE_REFUSED;
    return answer;
}

Answer instance_lacks_room(Instance *x, char *why) {
    snprintf(why, TEXT_SIZE, SAY_NO_ROOM);
    return instance_failed(x, ANSWER_FAILED);
}

int find_motion_at(Instance *x, const double *q, const double *v) {
    if (body_motion(x->body, q, v, x->motion, x->rates) != FLEX_OK) return 0;
    for (int64_t i = 0; i < 6 * description(x)->interfaces; i++) x->rates[i] *= x->scale.pace;
    return 1;
}

/* Above a tenth of the limit, and a fifth: where forces soften the body the error is some times what is known of it. Once it is
 * passed, shorter ones are no use. */
int64_t finer_by(const Instance *x, double soon) {
    const double off = soon * of_course(x, offsetof(Course, astray.error[BY_STEPS])) / x->parameter[P_ASTRAY_LIMIT];
    return !(off > 0.1 && off <= 1.0) ? 1 : off > 0.2 ? 4 : 2;
}

void leave_to_looks(Instance *x, double rounds, double substeps) {
    x->pieces.part = substeps * fmin(1.0, fmax(0.125, (14.0 - rounds / substeps) / 8.0));
}

/* What is looked for; limits and what happens beyond them follow each other in turn. */
static Monitor monitor_of(Instance *x) {
    Monitor monitor = {x->body, x->shadow, x->scale, {{0}}, x->parameter[P_ERROR_INTERVAL], x->over->room, x->over->shape, x->errors, &x->pieces};
    const double *limit = x->parameter + P_ROTATION_LIMIT;
    for (int i = 0; i < WATCHES; i++, limit += 2) monitor.watch[i] = (Watch){limit[0], (OnLimit)limit[1]};
    return monitor;
}

/* Numbers of the smallest page of memory. */
enum { PAGE = 512 };

int prepare_looks(Instance *x) {
    Arena *arena = &x->pieces.arena;
    const int64_t size = look_size(x->body, x->shadow), all = size + WAITING * LAID_OUT;
    volatile double *touched = calloc((size_t)all, sizeof(double));
    if (!touched) return 0;
    *arena = (Arena){(double *)touched, 0, size, 0};
    x->pieces.laid_out = arena->start + size;
    x->pieces.part = 1.0;
    /* Memory that nobody has touched yet would cost the first look more than its slices. */
    for (int64_t i = 0; i < all; i += PAGE) touched[i] = 0.0;
    if (x->shadow) memset(x->shadow->scratch.four, 0, (size_t)(LANES * x->shadow->p->modes) * sizeof(double));
    const Monitor monitor = monitor_of(x);
    count_looks(&monitor);
    return 1;
}

void fetch_step(const Instance *x) {
    fetch(x->motion, x->single + S_COUNT);
    if (!x->body) return;
    fetch_body(x->body);
    fetch(x->q, x->seen + x->loads + (steps_are_exact(x->body) ? 0 : 8 * x->modes));
    if (x->single[S_LOOKING] == 0.0) return;
    fetch(x->states, x->states + x->modes + x->loads);
    fetch(x->pieces.arena.start, x->pieces.arena.start + LAID_OUT);
    if (x->shadow) fetch(x->shadow, x->shadow->rules);
}

/* What a refused step means to the run. */
Answer step_refused(const Instance *x) {
    return x->parameter[P_ON_STEP] == ON_REFUSAL_TERMINATE ? ANSWER_FAILED : ANSWER_REFUSED;
}

/* What the monitor remembers lies among the numbers of the state. */
static Memory recalled(const Instance *x) {
    Memory memory = {.inputs = x->seen, .drift = x->drift, .astray = x->astray, .states = x->states, .largest = x->single[S_LARGEST], .beyond = x->single[S_BEYOND]};
    memcpy(memory.warned, x->single + S_WARNED, sizeof memory.warned);
    memcpy(&memory.course, x->single + S_COURSE, sizeof memory.course);
    memcpy(&memory.error, x->single + S_SEEN, sizeof memory.error);
    memcpy(&memory.looking, x->single + S_LOOKING, sizeof memory.looking);
    return memory;
}

static void keep_memory(Instance *x, const Memory *memory) {
    memcpy(x->single + S_SEEN, &memory->error, sizeof memory->error);
    memcpy(x->single + S_LOOKING, &memory->looking, sizeof memory->looking);
    x->single[S_LARGEST] = memory->largest;
    x->single[S_BEYOND] = memory->beyond;
    memcpy(x->single + S_COURSE, &memory->course, sizeof memory->course);
    memcpy(x->single + S_WARNED, memory->warned, sizeof memory->warned);
}

static void tell_warnings(Instance *x, const Findings *found) {
    for (int i = 0; i < found->count; i++) {
        if (x->single[S_STATUS] == STATE_SOUND) x->single[S_STATUS] = STATE_PASSED;
        if (x->teller) x->teller(x->told, 1, found->text[i]);
    }
}

void inspect_rest(Instance *x) {
    const Monitor monitor = monitor_of(x);
    Memory memory = recalled(x);
    Findings found;
    finish_looks(&monitor, &memory, &found);
    find_truncation(&monitor, &memory, &found);
    find_softness(&monitor, &memory, &found);
    keep_memory(x, &memory);
    tell_warnings(x, &found);
}

/* Whether what is found may refuse a step. */
static int may_refuse(const Monitor *monitor) {
    int refuses = 0;
    for (int i = 0; i < WATCHES; i++) refuses |= monitor->watch[i].action != ON_WARN;
    return refuses;
}

/* What goes on in steps that are as one before at rest, where nothing else changes, now or later; 0 where something may. */
static int quiet(const Instance *x, const Memory *before, const Memory *after, double step) {
    const Looking *looks = &after->looking;
    Memory would = *before;
    int on = CACHED_QUIET;
    if (after->error.steps != before->error.steps) would.error.steps += 1.0, on |= CACHED_SEEN;
    if (after->course.truncation.time != before->course.truncation.time) count_in(&would.course.truncation.time, step), on |= CACHED_MIXED;
    if (after->course.astray.time != before->course.astray.time) count_in(&would.course.astray.time, step), on |= CACHED_ASTRAY;
    if (memcmp(&would, after, sizeof would) != 0 || x->body->p->rigid || looks->under_way != 0.0) return 0;
    for (int kind = 0; kind < WAITING; kind++)
        if (looks->waiting[kind] != 0.0) return 0;
    for (int k = 0; k < CAUSES; k++)
        if (after->course.astray.off[k] != 0.0) return 0;
    /* The error is looked at again where energy is another than then, or at every step. */
    const int looked = x->shadow && x->parameter[P_ERROR_LIMIT] > 0.0;
    return !looked || ((on & CACHED_SEEN) && after->error.energy == x->pieces.energy) ? on : 0;
}

static void rest_quietly(Instance *x, double step) {
    fetch(x->motion, x->numbers);
    if (x->cached & CACHED_SEEN) x->single[S_SEEN + offsetof(ErrorMemory, steps) / sizeof(double)] += 1.0;
    if (x->cached & CACHED_MIXED) count_in(x->single + S_COURSE + offsetof(Course, truncation.time) / sizeof(double), step);
    if (x->cached & CACHED_ASTRAY) count_in(x->single + S_COURSE + offsetof(Course, astray.time) / sizeof(double), step);
}

/* Look at where a step of the body ends; ANSWER_OK where only warnings were found, which are told. Finds the motion there. */
Answer inspect(Instance *x, const double *q, const double *v, double step, const double *inputs, int rests, char *why) {
    if (rests && (x->cached & CACHED_QUIET)) {
        rest_quietly(x, step);
        return ANSWER_OK;
    }
    if (rests) leave_to_looks(x, 0.0, 1.0);
    const Bounds bounds = {x->parameter[P_BOUND_ROTATION], x->parameter[P_BOUND_DISPLACEMENT]};
    const Monitor monitor = monitor_of(x);
    StepEnd end = {q, v, x->motion, inputs, step, x->q, x->v, rests, rests, 0};
    Memory memory = recalled(x);
    const Memory before = memory;
    Findings found;
    Answer answer = ANSWER_OK;
    const int64_t m = x->body->p->modes;
    if (step > 0.0 && !rests && !steps_are_exact(x->body)) {
        memory.astray = x->over->astray;
        if (!all_finite(memory.astray, 3 * m)) memset(x->over->astray, 0, (size_t)(3 * m) * sizeof(double));
    }
    if (rests) end.zero = (x->cached & CACHED_ZERO) || (all_zero(q, m) && all_zero(v, m) && all_zero(x->drift, 5 * m) && all_zero(x->astray, 3 * m));
    /* A body at rest is where it was. */
    const size_t size = (size_t)m * sizeof(double), kept = (size_t)(x->loads + 5 * x->modes) * sizeof(double);
    const int still = rests || (step > 0.0 && (x->cached & CACHED_MOTION) && memcmp(q, x->q, size) == 0 && memcmp(v, x->v, size) == 0);
    x->cached = 0;
    if (!still && !find_motion_at(x, q, v)) return instance_lacks_room(x, why);
    if (!rests) end.calm = deforms_little(&monitor, &bounds, q, &memory);
    if (!rests && !within_bounds(x->body, &bounds, &end, why, TEXT_SIZE)) return step_refused(x);
    /* Loads seen, and drift behind them. */
    if (may_refuse(&monitor)) memcpy(x->over->seen, x->seen, kept);
    look(&monitor, &end, &memory, &found);
    for (int i = 0; i < found.count; i++) {
        if (found.action[i] == ON_WARN) continue;
        snprintf(why, TEXT_SIZE, "%s", found.text[i]);
        if (found.action[i] == ON_TERMINATE) answer = ANSWER_FAILED;
        if (answer == ANSWER_OK) answer = ANSWER_REFUSED;
    }
    if (answer != ANSWER_OK) {
        memcpy(x->seen, x->over->seen, kept);
        return answer;
    }
    keep_memory(x, &memory);
    tell_warnings(x, &found);
    x->cached = CACHED_MOTION | (still ? CACHED_REST : 0) | (end.zero ? CACHED_ZERO : 0);
    if (end.zero && !found.count) x->cached |= quiet(x, &before, &memory, step);
    return ANSWER_OK;
}
