#include "looks.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "algebra.h"
#include "forces.h"
#include "messages.h"
#include "tree.h"

/* Share of the largest loads' norm by which loads must have changed for stability to be looked at again: where it is near
 * its limit, and far above. */
static const double CHANGED = 0.05, CHANGED_FAR = 0.2;

const char *name_of(const Program *p, int64_t index) { return text_at(p->names, p->name_bytes, index); }
static const char *input_name(const Program *p, int64_t input) { return name_of(p, p->interfaces + p->frames + input); }

Scale scale_of(double stiffness, double density) {
    return (Scale){stiffness, 1.0 / stiffness, density / stiffness, sqrt(stiffness / density)};
}

void scale_inputs(const Scale *scale, const Program *p, const double *inputs, double *out) {
    const int64_t forces = 6 * p->interfaces;
    if (out == inputs && scale->force == 1.0 && scale->acceleration == 1.0) return;
    for (int64_t i = 0; i < p->loads; i++) out[i] = inputs[i] * (i < forces ? scale->force : scale->acceleration);
}

/* An input as the master has set it. */
static double input_of(const Monitor *monitor, const double *inputs, int64_t input) {
    const int accelerates = input >= 6 * monitor->body->p->interfaces;
    return inputs[input] / (accelerates ? monitor->scale.acceleration : monitor->scale.force);
}

int silenced(const Watch *watch, double warned) { return watch->action == ON_WARN && warned != 0.0; }

char *add_finding(Findings *found, OnLimit action, double *warned) {
    if (action == ON_WARN && *warned != 0.0) return 0;
    *warned = 1.0;
    found->action[found->count] = action;
    return found->text[found->count++];
}

double farthest(const Program *p, const double *motion, int64_t *interface) {
    double most = 0.0;
    for (int64_t k = 0; k < p->interfaces; k++) {
        const double *moved = motion + 6 * k, *first = motion;
        double far = norm(moved, 3);
        if (p->rigid) {
            const double *x = p->point + 3 * (p->frames + k), *x0 = p->point + 3 * p->frames;
            double before[3], after[3];
            for (int i = 0; i < 3; i++) {
                before[i] = x[i] - x0[i];
                after[i] = before[i] + moved[i] - first[i];
            }
            far = fabs(norm(after, 3) - norm(before, 3));
        }
        if (far <= most) continue;
        most = far;
        *interface = k;
    }
    return most;
}

static void tell_stability(const Monitor *monitor, const double *inputs, Memory *memory, Findings *found) {
    const Watch *watch = monitor->watch + WATCH_STABILITY;
    const Program *p = monitor->body->p;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_STABILITY]);
    if (!text) return;
    const Cause cause = cause_found(monitor->body, inputs, monitor->pieces->arena);
    snprintf(text, FINDING_TEXT, SAY_STABILITY, cause.margin <= 0.0 ? "beyond the critical load" : "near the critical load",
             cause.margin, watch->limit, input_name(p, cause.load), input_of(monitor, inputs, cause.load), cause.most,
             (long long)cause.mode + 1, monitor->scale.pace * p->omega[cause.mode] / 6.283185307179586);
}

static void tell_missed(const Monitor *monitor, const double *inputs, Memory *memory, Findings *found) {
    const Watch *watch = monitor->watch + WATCH_MISSED;
    const Program *p = monitor->body->p;
    int stable;
    const double error = missed_found(monitor->body, monitor->pieces->arena, &stable);
    /* The quick looks are of every shape of the body, loaded or not. */
    if (error <= watch->limit && error < 1.0) return;
    int64_t worst = 0;
    for (int64_t i = 1; i < p->loads; i++)
        if (fabs(inputs[i]) * p->judge_missed_bound[i] > fabs(inputs[worst]) * p->judge_missed_bound[worst]) worst = i;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_MISSED]), words[96];
    if (!text) return;
    snprintf(words, sizeof words, stable ? "deflections are off by up to %.3g %%"
                                         : "the loads are beyond the critical load, which the method does not know of",
             100.0 * error);
    snprintf(text, FINDING_TEXT, SAY_MISSED,
             text_at(p->advice, p->advice_bytes, SOURCE_MISSED), words, 100.0 * watch->limit, input_name(p, worst),
             input_of(monitor, inputs, worst), text_at(p->advice, p->advice_bytes, ADVICE_MISSED));
}

/* Strain energy over the largest so far by which it has grown, or changed, when the error is looked at again: it grows no
 * faster than the energy, and is looked at in time for a fraction of its limit. */
static const double GROWN = 1.1, GROWN_FAR = 2.0, MOVED = 0.05, IN_TIME = 0.25;
/* Intervals that pass at most between looks at an error far below its limit; coordinates of a shadow whose looks may take an
 * interval each, and of larger ones in proportion more. */
static const double PATIENCE = 5.0, QUICK = 40.0;
/* Share of the deflection beyond which one step of Newton's method tells no more than that the motion is wrong. */
static const double WRONG = 0.1;
static const char MORE[] = "more than ";

/* Share of the most energy from which a look tells how soft the body is there. */
static const double MOST = 0.5;

/* Of the energy that waits to be looked at. */
static const double WAITED = 2.0;

double softer_at_most(const ErrorMemory *seen, double most) { return WAITED * seen->softened >= most ? seen->softer : 0.0; }

static void tell_error(const Monitor *monitor, double deflection, Memory *memory, Findings *found) {
    const Watch *watch = monitor->watch + WATCH_ERROR;
    const Program *p = monitor->body->p;
    ErrorMemory *seen = &memory->error;
    double share, bound, energy;
    const double softer = softer_found(monitor->shadow, monitor->pieces->arena, &energy) / energy;
    if (softer > 0.0 && isfinite(softer) && energy >= MOST * seen->softened && isfinite(energy)) {
        seen->softer = softer;
        seen->softened = energy;
    }
    error_found(monitor->body, monitor->shadow, monitor->pieces->arena, monitor->errors, &deflection, &share, &bound);
    seen->deflection = fmax(seen->deflection, deflection);
    seen->bound = fmax(seen->bound, bound);
    if (!(bound > watch->limit)) return;
    char *text = add_finding(found, watch->action, &memory->warned[WATCH_ERROR]);
    if (!text) return;
    int64_t worst = 0;
    for (int64_t i = 1; i < p->interfaces; i++)
        if (monitor->errors[2 * i] > monitor->errors[2 * worst]) worst = i;
    char bounded[48] = "";
    if (!(share > WRONG))
        snprintf(bounded, sizeof bounded, "; its bound is %s%.2g %%", bound > WRONG ? MORE : "", 100.0 * fmin(bound, WRONG));
    snprintf(text, FINDING_TEXT, SAY_ERROR, name_of(p, worst), share > WRONG ? MORE : "", 100.0 * fmin(share, WRONG), bounded,
             100.0 * watch->limit, text_at(p->advice, p->advice_bytes, ADVICE_ERROR));
}

/* Twice the strain energy. */
static double energy_at(const Body *body, const double *q) {
    double energy = 0.0;
    for (int64_t j = 0; j < body->p->modes; j++) energy += body->opened->stiffness[j] * q[j] * q[j];
    return energy;
}

/* The same but for round-off, far below its share: sums that do not wait for each other take a fraction of the time. */
static const double ROUND_OFF_SHARE = 1e-9;
static double rough_energy_at(const Body *body, const double *q) {
    const double *stiffness = body->opened->stiffness;
    const int64_t m = body->p->modes;
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    int64_t j = 0;
    for (; j + 4 <= m; j += 4)
        for (int k = 0; k < 4; k++) sum[k] += stiffness[j + k] * q[j + k] * q[j + k];
    for (; j < m; j++) sum[0] += stiffness[j] * q[j] * q[j];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

double error_due(const Monitor *monitor, const StepEnd *end, Memory *memory) {
    Body *body = monitor->body;
    const double *q = end->q;
    const Program *p = body->p;
    const Watch *watch = monitor->watch + WATCH_ERROR;
    ErrorMemory *seen = &memory->error;
    if (!monitor->shadow || !(watch->limit > 0.0)) return 0.0;
    int64_t worst = 0;
    seen->steps += 1.0;
    if (!end->rests && !p->rigid) seen->deflection = fmax(seen->deflection, farthest(p, end->motion, &worst));
    const double far = IN_TIME * watch->limit / seen->bound, always = monitor->interval <= 1.0;
    const double patience = fmin(fmax(far, 1.0), PATIENCE) * monitor->interval * monitor->pieces->slow;
    const double growth = fmin(fmax(far, GROWN), p->rigid ? GROWN : GROWN_FAR);
    const int long_ago = seen->steps >= patience;
    double *known = &monitor->pieces->energy;
    if (!end->rests) *known = NAN;
    if (!end->rests && !always && !long_ago && rough_energy_at(body, q) <= (1.0 - ROUND_OFF_SHARE) * growth * seen->largest) return 0.0;
    /* At rest it is what it was. */
    const double energy = isnan(*known) ? energy_at(body, q) : *known;
    *known = energy;
    const int waited = long_ago && fabs(energy - seen->energy) > MOVED * seen->largest;
    if (!always && !waited && !(energy > growth * seen->largest)) return 0.0;
    seen->energy = energy;
    seen->largest = fmax(seen->largest, fmin(energy, DBL_MAX));
    seen->steps = 0.0;
    return silenced(watch, memory->warned[WATCH_ERROR]) ? 0.0 : fmin(fmax(energy, DBL_MIN), DBL_MAX);
}

void loads_due(const Monitor *monitor, const double *inputs, Memory *memory, double *due) {
    Body *body = monitor->body;
    const int64_t loads = body->p->loads;
    const Watch *stability = monitor->watch + WATCH_STABILITY, *missed = monitor->watch + WATCH_MISSED;
    const double above = memory->beyond - stability->limit, weight = fmin(fmax(dot(inputs, inputs, loads), DBL_MIN), DBL_MAX);
    double *change = monitor->inputs;
    for (int64_t i = 0; i < loads; i++) change[i] = inputs[i] - memory->inputs[i];
    const double square = dot(change, change, loads), share = above > stability->limit ? CHANGED_FAR : CHANGED;
    if (!(square > share * share * memory->largest)) return;
    if (missed->limit > 0.0 && !silenced(missed, memory->warned[WATCH_MISSED]) && body_might_miss(body, inputs, missed->limit))
        due[LOOK_MISSED] = weight;
    const double softer = body_softening_bound(body, change);
    const int nearer = !(softer < above);
    if (!nearer && due[LOOK_MISSED] == 0.0) return;
    if (nearer && stability->limit > 0.0 && !silenced(stability, memory->warned[WATCH_STABILITY])) due[LOOK_STABILITY] = weight;
    if (!nearer) memory->beyond -= softer;
    memcpy(memory->inputs, inputs, (size_t)loads * sizeof(double));
}

int64_t look_size(const Body *body, const Body *shadow) {
    Arena of_body = {0}, of_shadow = {0}, of_judgement = {0};
    stability_demand(body, &of_body);
    if (shadow) certificate_demand(shadow, &of_shadow);
    if (body->p->judged) judgement_demand(body, &of_judgement);
    return larger(larger(of_body.used, of_shadow.used), of_judgement.used);
}

/* Do pieces of a look, all of them without a slice; whether it is followed by another. */
static int pieces_of(const Monitor *monitor, int kind, const double *q, const double *inputs, Slice *slice) {
    Body *body = monitor->body;
    const Arena arena = monitor->pieces->arena;
    const double limit = monitor->watch[WATCH_STABILITY].limit;
    switch (kind) {
    case LOOK_ERROR: pieces_of_error(body, monitor->shadow, inputs, q, arena, slice); return 0;
    case LOOK_MISSED: return pieces_of_missing(body, inputs, monitor->watch[WATCH_MISSED].limit, arena, slice);
    case LOOK_CAUSE: pieces_of_cause(body, inputs, q, arena, slice); return 0;
    case LOOK_HOW_MUCH: pieces_of_missed(body, inputs, arena, slice); return 0;
    default: break;
    }
    monitor->pieces->beyond = pieces_of_stability(body, inputs, q, limit, arena, slice);
    return monitor->pieces->beyond < limit;
}

/* Whether the body has what a look needs. */
static int can_look(const Monitor *monitor, int kind) {
    if (kind == LOOK_ERROR) return monitor->shadow != 0;
    return monitor->body->p->judged || (kind != LOOK_MISSED && kind != LOOK_HOW_MUCH);
}

void count_looks(const Monitor *monitor) {
    Pieces *pieces = monitor->pieces;
    double *inputs = monitor->inputs;
    pieces->slow = monitor->shadow ? fmax(1.0, (double)monitor->shadow->p->modes / QUICK) : 1.0;
    memset(inputs, 0, (size_t)monitor->body->p->loads * sizeof(double));
    /* The error first where it is eased: what is counted of both is the same. */
    for (int kind = -1; kind <= LOOKS; kind++) {
        Slice slice = {.until = COUNTS, .otherwise = kind < 0 ? EASED : 0};
        if (!can_look(monitor, kind < 0 ? LOOK_ERROR : kind)) continue;
        if (kind < 0) {
            pieces_of(monitor, LOOK_ERROR, monitor->shape, inputs, &slice);
            pieces->eased = slice.whole;
            continue;
        }
        if (kind == LOOKS) inputs[0] = 1.0;
        pieces_of(monitor, kind < LOOKS ? kind : LOOK_CAUSE, monitor->shape, inputs, &slice);
        if (kind < LOOKS) pieces->whole[kind] = slice.whole;
        if (kind == LOOKS) pieces->by_load = slice.whole - pieces->whole[LOOK_CAUSE];
        if (kind < WAITING) memcpy(pieces->laid_out + kind * LAID_OUT, pieces->arena.start, LAID_OUT * sizeof(double));
    }
}

/* What the last piece of a look has found, told, or else whether another look follows. */
static int concluded(const Monitor *monitor, int kind, int follows, double deflection, const double *inputs, Memory *memory, Findings *found) {
    if (kind == LOOK_ERROR) tell_error(monitor, deflection, memory, found);
    if (kind == LOOK_CAUSE) tell_stability(monitor, inputs, memory, found);
    if (kind == LOOK_HOW_MUCH) tell_missed(monitor, inputs, memory, found);
    if (kind == LOOK_STABILITY) memory->beyond = fmax(monitor->pieces->beyond, monitor->watch[WATCH_STABILITY].limit);
    return !follows;
}

void look_at_once(const Monitor *monitor, int kind, const double *q, const double *inputs, double deflection, Memory *memory,
                         Findings *found) {
    monitor->pieces->begun = 0;
    while (!concluded(monitor, kind, pieces_of(monitor, kind, q, inputs, 0), deflection, inputs, memory, found)) kind += FOLLOWING;
}

void submit(const Monitor *monitor, int kind, const StepEnd *end, double weight, Memory *memory) {
    Looking *now = &memory->looking;
    const int64_t m = monitor->body->p->modes, loads = monitor->body->p->loads;
    if (!(weight > now->waiting[kind])) return;
    now->waiting[kind] = weight;
    now->deflections[kind] = memory->error.deflection;
    double *state = memory->states + (1 + kind) * (m + loads);
    memcpy(state, end->q, (size_t)m * sizeof(double));
    memcpy(state + m, end->inputs, (size_t)loads * sizeof(double));
}

/* Multiplications of a slice: of a step whose forces do not depend on where the body is about a third; of any other a part of what
 * a configuration costs, a few of which make a step, and what all of them can bear. */
static double slice_size(const Body *body) {
    const double cost = configuration_cost(body);
    return forces_depend(body) ? 18000.0 + 0.285 * cost : fmax(3750.0, 100.0 + 1.25 * cost);
}

/* Slices up to which a look counts its pieces, and tells what it has found, in a step that does one: else each has a step. */
static const double FEW = 12.0;

/* A look is under way: how many slices it takes is counted when it goes on. */
static void begin_look(const Monitor *monitor, int kind, int begun, double otherwise, Memory *memory) {
    Looking *now = &memory->looking;
    now->under_way = 1.0;
    now->otherwise = otherwise;
    now->look = kind;
    now->done = now->slices = 0.0;
    monitor->pieces->begun = begun;
}

/* A state that waits, of each look in turn. */
static void next_look(const Monitor *monitor, Memory *memory) {
    Looking *now = &memory->looking;
    const int64_t size = monitor->body->p->modes + monitor->body->p->loads;
    int kind = (int)now->look;
    for (int turn = 0; turn < WAITING; turn++) {
        kind = kind + 1 < WAITING ? kind + 1 : 0;
        if (!(now->waiting[kind] > 0.0)) continue;
        memcpy(memory->states, memory->states + (1 + kind) * size, (size_t)size * sizeof(double));
        now->waiting[kind] = 0.0;
        now->deflection = now->deflections[kind];
        begin_look(monitor, kind, 0, 0.0, memory);
        return;
    }
}

void go_on(const Monitor *monitor, Memory *memory, Findings *found) {
    Looking *now = &memory->looking;
    Pieces *pieces = monitor->pieces;
    Slice *slice = &pieces->slice;
    const double *q = memory->states, *inputs = q + monitor->body->p->modes;
    if (now->under_way == 0.0) next_look(monitor, memory);
    if (now->under_way == 0.0) return;
    const int kind = (int)now->look;
    if (!can_look(monitor, kind)) {
        now->under_way = 0.0;
        return;
    }
    if (pieces->begun != COUNTED) {
        *slice = (Slice){.whole = pieces->whole[kind], .otherwise = (int)now->otherwise};
        if (slice->otherwise & EASED) slice->whole = pieces->eased;
        for (int64_t i = 0; kind == LOOK_CAUSE && i < monitor->body->p->loads; i++) slice->whole += inputs[i] != 0.0 ? pieces->by_load : 0.0;
        if (kind < WAITING)
            memcpy(pieces->arena.start, pieces->laid_out + kind * LAID_OUT, LAID_OUT * sizeof(double));
        else if (pieces->begun != FOLLOWS)
            pieces_of(monitor, kind - FOLLOWING, q, inputs, 0);
        pieces->begun = COUNTED;
    }
    if (now->slices == 0.0) {
        now->slices = fmax(1.0, ceil(slice->whole / slice_size(monitor->body)));
        if (now->slices > FEW) return;
    }
    now->done += pieces->part;
    const int last = now->done > now->slices - (now->slices > FEW ? 0.0 : 1.0);
    int follows = 0;
    /* Where slices were lost with another state, the rest makes up for them. */
    slice->until = last ? HUGE_VAL : slice->spent + pieces->part * (slice->whole - slice->spent) / (now->slices - now->done + pieces->part);
    /* Where no piece is left, only what failed, or may be followed, is gone through again. */
    const int left = !slice->failed && slice->spent < slice->whole * (1.0 - ROUND_OFF_SHARE);
    if (left || (last && (slice->failed || kind == LOOK_STABILITY || kind == LOOK_MISSED))) {
        slice->met = 0;
        slice->fresh = 1;
        follows = pieces_of(monitor, kind, q, inputs, slice);
    }
    if (!last) return;
    now->under_way = 0.0;
    pieces->begun = 0;
    if (slice->failed == FAILED_PIECEMEAL)
        look_at_once(monitor, kind, q, inputs, now->deflection, memory, found);
    else if (slice->failed == FAILED_TENSE || slice->failed == FAILED_STEEP)
        begin_look(monitor, kind, 0, slice->otherwise | (slice->failed == FAILED_TENSE ? SLACK : EASED), memory);
    else if (!concluded(monitor, kind, follows, now->deflection, inputs, memory, found))
        begin_look(monitor, kind + FOLLOWING, FOLLOWS, 0.0, memory);
}

void finish_looks(const Monitor *monitor, Memory *memory, Findings *found) {
    const Looking *now = &memory->looking;
    found->count = 0;
    while (now->under_way != 0.0 || now->waiting[LOOK_ERROR] > 0.0 || now->waiting[LOOK_STABILITY] > 0.0 || now->waiting[LOOK_MISSED] > 0.0) {
        memory->looking.done = now->slices;
        go_on(monitor, memory, found);
    }
}

