#include "coupling.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "algebra.h"

/* Rounds after which a residual that falls no more, by so much a round, is as small as it gets. */
enum { STALLED = 5 };
static const double FALLS = 0.5;
/* Change of inputs, of their sizes, beside which the error of internal steps counts for nothing. */
static const double NEARBY = 0.01;
/* Halvings of a change of inputs with which an FMU refuses the step. */
enum { HALVINGS = 10 };
/* status.code of a step that failed, for masters that overlook its status. */
enum { FAILED_CODE = 1 };

struct Coupling {
    Setup s;
    Exchange exchange;
    Growth growth;
    Resolution resolution;
    EnergyCount energies;
    Update update;
    KnownResponse response;
    int64_t number, rows, rounds, notices, iterations, last_recorded;
    int64_t *is_coupled, *odd; /* (participants): whether inputs are fed to it; whether its status was told */
    double *signals, *before, *fresh, *mixed; /* (signals): now, a step ago, those of the step under way, and of both */
    double *held, *base, *inputs, *blocks;    /* inputs held over the step; without the coupling; both; (responses, 36) */
    double *values;
    int *whole;
    /* Iterated: (inputs) each; the last two steps' inputs; sizes of kinds so far. */
    double *first, *guess, *safe, *asked, *springs, *residual, *past, *past_residual, *scale, *change, *error, *noise;
    double *earlier, *last, *largest, *sizes;
    int64_t remembered, slot, kept; /* steps remembered, up to two; differences of this step; of how many steps before */
    Secants *secants;               /* (reuse + 1), by turns */
    const Secants **sets;
    int64_t *past_tried; /* (participants) */
    double *memory;
};

static void take_all(Arena *arena, Coupling *c) {
    const Wiring *w = &c->s.wiring;
    const int64_t slots = c->s.reuse + 1, most = c->s.most_iterations * w->inputs;
    double **const of_signals[] = {&c->signals, &c->before, &c->fresh, &c->mixed};
    double **const of_inputs[] = {&c->held,     &c->base,          &c->inputs, &c->first,  &c->guess, &c->safe,  &c->asked,  &c->springs, &c->residual,
                                  &c->past,     &c->past_residual, &c->scale,  &c->change, &c->error, &c->noise, &c->earlier, &c->last};
    take_exchange(arena, w, &c->exchange);
    take_resolution(arena, w, &c->resolution);
    for (size_t i = 0; i < sizeof of_signals / sizeof *of_signals; i++) *of_signals[i] = take(arena, w->signals);
    for (size_t i = 0; i < sizeof of_inputs / sizeof *of_inputs; i++) *of_inputs[i] = take(arena, w->inputs);
    c->is_coupled = (int64_t *)take(arena, w->participants);
    c->odd = (int64_t *)take(arena, w->participants);
    c->past_tried = (int64_t *)take(arena, w->participants);
    c->blocks = take(arena, 36 * w->responses);
    c->values = take(arena, c->s.columns);
    c->whole = (int *)take(arena, c->s.columns);
    c->response.slope = take(arena, w->inputs * w->inputs);
    c->response.known = (int64_t *)take(arena, w->inputs);
    if (c->s.scheme != ITERATED) return;
    take_update(arena, &c->update, w->inputs);
    c->largest = take(arena, c->s.kinds);
    c->sizes = take(arena, c->s.kinds);
    c->secants = (Secants *)take(arena, slots * (int64_t)((sizeof(Secants) + sizeof(double) - 1) / sizeof(double)));
    c->sets = (const Secants **)take(arena, slots);
    for (int64_t i = 0; i < slots; i++) {
        double *residuals = take(arena, most), *inputs = take(arena, most);
        if (arena->start) c->secants[i] = (Secants){0, residuals, inputs};
    }
}

Coupling *coupling_open(const Setup *setup) {
    Coupling *c = calloc(1, sizeof *c);
    Arena arena = {0};
    if (!c) return 0;
    c->s = *setup;
    take_all(&arena, c);
    arena = (Arena){calloc((size_t)arena.used + 1, sizeof(double)), 0, arena.used, 0};
    c->memory = arena.start;
    if (arena.start) take_all(&arena, c);
    if (!arena.start || arena.refused) {
        free(c->memory);
        free(c);
        return 0;
    }
    begin_growth(&c->growth);
    c->last_recorded = -1;
    for (int64_t i = 0; i < setup->wiring.inputs; i++)
        if (setup->wiring.coupled[i]) c->is_coupled[setup->wiring.input_role[i]] = 1;
    return c;
}

void coupling_close(Coupling *c, int64_t broken) {
    for (int64_t k = 0; k < c->s.wiring.participants; k++)
        if (k != broken) participant_forget(&c->s.participants[k]);
    free(c->memory);
    free(c);
}

/* Whose answer ends the run. */
static int ended_by(Outcome *outcome, int64_t who, const Answer *answer) {
    outcome->ending = answer->reply;
    outcome->who = who;
    outcome->what = answer->what;
    outcome->status = answer->status;
    outcome->figure = answer->value;
    return 0;
}

/* Begin an FMU's step with its share of base and held inputs. */
static int begin_participant(Coupling *c, int64_t k, Outcome *outcome) {
    Participant *one = &c->s.participants[k];
    const double step = c->s.wiring.step;
    Answer answer;
    for (int64_t i = one->first_input; i < one->first_input + one->inputs; i++) c->inputs[i] = c->base[i] + c->held[i];
    if (participant_take(one, c->inputs, &answer) && participant_begin_step(one, (double)c->number * step, step, &answer)) return 1;
    return ended_by(outcome, k, &answer);
}

/* Take it; the FMU's share of fresh signals is renewed. */
static int end_participant(Coupling *c, int64_t k, Outcome *outcome) {
    Participant *one = &c->s.participants[k];
    const double step = c->s.wiring.step;
    Answer answer;
    if (participant_step(one, (double)c->number * step, step, &answer) && participant_give(one, c->fresh, &answer)) return 1;
    return ended_by(outcome, k, &answer);
}

/* Let all FMUs step that are coupled or that are not, or both; those of other processes at the same time. */
static int step_all(Coupling *c, int coupled, int others, Outcome *outcome) {
    Outcome unheard;
    int ok = 1;
    for (int64_t k = 0; k < c->s.wiring.participants && ok; k++)
        if (c->is_coupled[k] ? coupled : others) ok = begin_participant(c, k, outcome);
    for (int64_t k = 0; k < c->s.wiring.participants; k++) {
        if (ok && (c->is_coupled[k] ? coupled : others)) ok = end_participant(c, k, outcome);
        /* What has begun has to end. */
        if (c->s.participants[k].begun) end_participant(c, k, &unheard);
    }
    return ok;
}

/* What tables give over the step: at its beginning, or the mean of its ends. */
static void find_base(Coupling *c) {
    const Wiring *w = &c->s.wiring;
    const double time = (double)c->number * w->step;
    base_inputs(w, time, 0, c->base);
    if (!c->s.mean_inputs) return;
    base_inputs(w, time + w->step, 1, c->inputs);
    for (int64_t i = 0; i < w->inputs; i++) c->base[i] = 0.5 * (c->base[i] + c->inputs[i]);
}

/* All FMUs step with the inputs of the last communication point. */
static int jacobi(Coupling *c, Outcome *outcome) {
    coupled_inputs(&c->s.wiring, &c->exchange, c->signals, c->before, DAMPERS_NOW, c->held);
    return step_all(c, 1, 1, outcome);
}

/* One FMU steps after the other; the later ones get the fresh outputs of the earlier. */
static int gauss_seidel(Coupling *c, Outcome *outcome) {
    const Wiring *w = &c->s.wiring;
    memcpy(c->mixed, c->before, (size_t)w->signals * sizeof *c->mixed);
    for (int64_t k = 0; k < w->participants; k++) {
        const Participant *one = &c->s.participants[k];
        coupled_inputs(w, &c->exchange, c->fresh, c->mixed, DAMPERS_NOW, c->guess);
        memcpy(c->held + one->first_input, c->guess + one->first_input, (size_t)one->inputs * sizeof *c->held);
        if (!begin_participant(c, k, outcome) || !end_participant(c, k, outcome)) return 0;
        memcpy(c->mixed + one->first_signal, c->signals + one->first_signal, (size_t)one->signals * sizeof *c->mixed);
    }
    return 1;
}

/* scale: size of each input's kind, the largest so far, in values (inputs) or before. */
static void find_scale(const Coupling *c, const double *values, double *scale) {
    const Wiring *w = &c->s.wiring;
    memcpy(c->sizes, c->largest, (size_t)c->s.kinds * sizeof *c->sizes);
    for (int64_t i = 0; i < w->inputs; i++) c->sizes[w->kind[i]] = fmax(c->sizes[w->kind[i]], fabs(values[i]));
    for (int64_t i = 0; i < w->inputs; i++) scale[i] = c->sizes[w->kind[i]] > 0.0 ? c->sizes[w->kind[i]] : 1.0;
}

/* Whether a guess is so near to the inputs of the last try that other internal steps would be seen. */
static int is_near(Coupling *c) {
    find_scale(c, c->past, c->noise);
    for (int64_t i = 0; i < c->s.wiring.inputs; i++)
        if (!(fabs(c->guess[i] - c->past[i]) / c->noise[i] < NEARBY)) return 0;
    return 1;
}

/* Step with the inputs guessed or, where an FMU refuses those, nearer to the ones that it took; held: which ones. */
static int evaluate(Coupling *c, int again, int near, Outcome *outcome) {
    const Wiring *w = &c->s.wiring;
    const size_t size = (size_t)w->inputs * sizeof *c->held;
    Answer answer;
    memcpy(c->safe, c->held, size);
    for (int halving = 0;; halving++) {
        int same = 1;
        for (int64_t k = 0; (again || halving) && k < w->participants; k++)
            if (c->is_coupled[k] && !participant_restore(&c->s.participants[k], near, &answer)) return ended_by(outcome, k, &answer);
        for (int64_t i = 0; i < w->inputs; i++) {
            same &= c->guess[i] == c->safe[i];
            c->held[i] = c->safe[i] + ldexp(c->guess[i] - c->safe[i], -halving);
        }
        if (step_all(c, 1, 0, outcome)) return 1;
        /* Nearer to inputs that equal the guess there is nothing to try. */
        if (outcome->ending != STEP_REFUSED || halving == HALVINGS || same) return 0;
        outcome->ending = DONE;
    }
}

/* asked, residual: what the inputs held over the step should be, of springs at its ends, of dampers by the motion over it. */
static void find_residual(Coupling *c) {
    const Wiring *w = &c->s.wiring;
    const double share = c->s.share;
    coupled_inputs(w, &c->exchange, c->fresh, c->signals, DAMPERS_NONE, c->springs);
    if (c->exchange.damped) coupled_inputs(w, &c->exchange, c->fresh, c->signals, DAMPERS_MEAN, c->asked);
    for (int64_t i = 0; i < w->inputs; i++) {
        const double dampers = c->exchange.damped ? c->asked[i] - c->springs[i] : 0.0;
        c->asked[i] = (1.0 - share) * c->first[i] + share * c->springs[i] + dampers;
        c->residual[i] = c->asked[i] - c->held[i];
    }
}

/* What the interfaces' compliance, of the step just taken, tells beforehand: 1, or 0 where nothing; -1 where a call failed. */
static int find_response(Coupling *c, const double *signals, double share, Dampers dampers, Outcome *outcome) {
    const Wiring *w = &c->s.wiring;
    Answer answer;
    for (int64_t r = 0; r < w->responses; r++) {
        const int64_t who = w->response_role[r];
        if (!participant_reals(&c->s.participants[who], c->s.response_references + 36 * r, 36, c->blocks + 36 * r, &answer))
            return ended_by(outcome, who, &answer) - 1;
    }
    return interface_response(w, &c->exchange, signals, c->blocks, share, dampers, &c->response);
}

/* Whether what the inputs are off by does not count, or is round-off: of nominal values where it stalls. */
static int settled(Coupling *c, int stalled) {
    const Wiring *w = &c->s.wiring;
    int all = 1;
    for (int64_t i = 0; i < w->inputs; i++) c->guess[i] = c->held[i] + c->error[i];
    find_scale(c, c->guess, c->noise);
    for (int64_t i = 0; i < w->inputs; i++) {
        const int small = fabs(c->error[i]) <= c->s.tolerance * c->noise[i];
        c->guess[i] = small;
        all &= small;
    }
    if (all) return 1;
    round_off(w, &c->exchange, c->fresh, stalled, c->noise);
    for (int64_t i = 0; i < w->inputs; i++)
        if (c->guess[i] == 0.0 && !(fabs(c->residual[i]) <= c->noise[i])) return 0;
    return 1;
}

/* Keep the difference to the last try. Beside a small change of inputs, what other internal steps make of the answer is not
 * small; past: the try becomes the last one. */
static void add_difference(Coupling *c, int has_past, int near) {
    const int64_t n = c->s.wiring.inputs;
    Secants *here = &c->secants[c->slot];
    int same = 1;
    for (int64_t k = 0; k < c->s.wiring.participants; k++) {
        same &= !c->is_coupled[k] || c->past_tried[k] == c->s.participants[k].tried;
        c->past_tried[k] = c->s.participants[k].tried;
    }
    if (has_past && (same || !near)) {
        double *residuals = here->residuals + here->count * n, *inputs = here->inputs + here->count * n;
        for (int64_t i = 0; i < n; i++) {
            residuals[i] = c->residual[i] - c->past_residual[i];
            inputs[i] = c->held[i] - c->past[i];
        }
        here->count++;
    }
    memcpy(c->past, c->held, (size_t)n * sizeof *c->past);
    memcpy(c->past_residual, c->residual, (size_t)n * sizeof *c->past);
}

/* Inputs and differences of a step that settled. */
static void remember(Coupling *c) {
    const Wiring *w = &c->s.wiring;
    double *oldest = c->earlier;
    for (int64_t i = 0; i < w->inputs; i++) c->largest[w->kind[i]] = fmax(c->largest[w->kind[i]], fabs(c->held[i]));
    c->earlier = c->last;
    c->last = oldest;
    memcpy(c->last, c->held, (size_t)w->inputs * sizeof *c->last);
    if (c->remembered < 2) c->remembered++;
    if (c->s.reuse && c->secants[c->slot].count) {
        c->slot = (c->slot + 1) % (c->s.reuse + 1);
        if (c->kept < c->s.reuse) c->kept++;
    }
}

/* What no iteration settled. */
static int unsettled(Coupling *c, Outcome *outcome) {
    const int64_t n = c->s.wiring.inputs;
    double worst = -1.0;
    find_scale(c, c->held, c->scale);
    for (int64_t i = 0; i < n; i++) {
        const double ratio = fabs(c->error[i]) / c->scale[i];
        if (ratio <= worst) continue;
        worst = ratio;
        outcome->who = i;
    }
    outcome->ending = UNSETTLED;
    outcome->figure = worst;
    return 0;
}

/* Save states, step what is not coupled, and the inputs to begin with: on the line through the last two steps. */
static int begin_iterations(Coupling *c, Outcome *outcome) {
    const Wiring *w = &c->s.wiring;
    const size_t size = (size_t)w->inputs * sizeof *c->held;
    Answer answer;
    coupled_inputs(w, &c->exchange, c->signals, c->before, DAMPERS_NONE, c->first);
    memset(c->held, 0, size);
    for (int64_t k = 0; k < w->participants; k++)
        if (c->is_coupled[k] && !participant_save(&c->s.participants[k], &answer)) return ended_by(outcome, k, &answer);
    if (!step_all(c, 0, 1, outcome)) return 0;
    memcpy(c->held, c->remembered ? c->last : c->first, size);
    memcpy(c->guess, c->held, size);
    for (int64_t i = 0; i < w->inputs && c->remembered == 2; i++) c->guess[i] = 2.0 * c->last[i] - c->earlier[i];
    c->secants[c->slot].count = 0;
    return 1;
}

/* Steps are taken back and repeated until the inputs held over them are those that the outputs ask for. */
static int iterate(Coupling *c, Outcome *outcome) {
    const Wiring *w = &c->s.wiring;
    const int64_t n = w->inputs, slots = c->s.reuse + 1;
    double least = INFINITY;
    int known = 0;
    if (!begin_iterations(c, outcome)) return 0;
    for (int64_t iteration = 1; iteration <= c->s.most_iterations; iteration++) {
        const int near = iteration > 1 && is_near(c);
        if (!evaluate(c, iteration > 1, near, outcome)) return 0;
        find_residual(c);
        if (iteration == 1 && (known = find_response(c, c->fresh, c->s.share, DAMPERS_MEAN, outcome)) < 0) return 0;
        add_difference(c, iteration > 1, near);
        find_scale(c, c->asked, c->scale);
        /* What earlier steps tell is older than a model that tells all. */
        const int64_t sets = known && c->response.whole ? 1 : 1 + c->kept;
        for (int64_t k = 0; k < sets; k++) c->sets[k] = &c->secants[(c->slot + slots - k) % slots];
        quasi_newton_update(&c->update, c->residual, c->sets, sets, c->scale, c->s.relaxation, known ? &c->response : 0, c->change, c->error);
        for (int64_t i = 0; i < n; i++) c->scale[i] = c->residual[i] / c->scale[i];
        const double size = norm(c->scale, n);
        const int stalled = iteration >= STALLED && size > FALLS * least;
        least = fmin(least, size);
        if (settled(c, stalled)) {
            remember(c);
            for (int64_t k = 0; k < w->participants; k++)
                if (c->is_coupled[k]) participant_forget(&c->s.participants[k]);
            c->iterations = iteration;
            return 1;
        }
        for (int64_t i = 0; i < n; i++) c->guess[i] = c->held[i] + c->change[i];
    }
    return unsettled(c, outcome);
}

static void notice(Coupling *c, Notice told) {
    told.step = c->number;
    c->s.notices[c->notices++] = told;
}

static int record(Coupling *c, Outcome *outcome) {
    Answer answer;
    if (c->rows == c->s.most_rows) {
        outcome->ending = NO_ROOM_FOR_ROWS;
        return 0;
    }
    double *row = c->s.rows + c->rows * c->s.columns;
    for (int64_t k = 0; k < c->s.wiring.participants; k++)
        if (!participant_record(&c->s.participants[k], row, c->values, c->whole, &answer)) return ended_by(outcome, k, &answer);
    row[c->s.columns - 2] = (double)c->iterations;
    row[c->s.columns - 1] = c->energies.created;
    c->s.times[c->rows++] = (double)c->number * c->s.wiring.step;
    c->last_recorded = c->number;
    return 1;
}

/* Say once of each FMU that its status is no longer sound. */
static int watch_status(Coupling *c, Outcome *outcome) {
    Answer answer;
    for (int64_t k = 0; k < c->s.wiring.participants; k++) {
        int status = 0;
        if (!participant_status(&c->s.participants[k], &status, &answer)) return ended_by(outcome, k, &answer);
        if (status == FAILED_CODE) {
            outcome->ending = FAILURE_TOLD;
            outcome->who = k;
            outcome->what = status;
            return 0;
        }
        if (status && !c->odd[k]) notice(c, (Notice){ODD_STATUS, 0, k, {status, 0.0}});
        c->odd[k] |= status != 0;
    }
    return 1;
}

/* What is done once a step is taken: look at it, record it. */
static int conclude(Coupling *c, int64_t last, Outcome *outcome) {
    const Wiring *w = &c->s.wiring;
    Notice told[2];
    int grows;
    c->number++;
    c->rounds += c->iterations;
    double *oldest = c->before;
    c->before = c->signals;
    c->signals = c->fresh;
    c->fresh = oldest;
    if (!watch_status(c, outcome)) return 0;
    count_energies(w, &c->exchange, c->signals, c->before, c->held, &c->energies);
    if ((c->number % c->s.every == 0 || c->number == last) && !record(c, outcome)) return 0;
    if (look_at_resolution(&c->resolution, w, c->signals, told)) notice(c, told[0]);
    const int said = look_at_growth(&c->growth, &c->energies, told, &grows);
    for (int i = 0; i < said; i++) notice(c, told[i]);
    if (grows) outcome->ending = GROWS;
    return !grows;
}

/* Let the caller know how far it came. */
static void report(const Coupling *c, Outcome *outcome) {
    outcome->steps = c->number;
    outcome->rows = c->rows;
    outcome->rounds = c->rounds;
    outcome->notices = c->notices;
    outcome->energies = c->energies;
    outcome->feeds = feeds(&c->energies);
}

void coupling_begin(Coupling *c, Outcome *outcome) {
    const Wiring *w = &c->s.wiring;
    Answer answer;
    int ok = 1;
    outcome->ending = DONE;
    base_inputs(w, 0.0, 0, c->base);
    for (int64_t k = 0; k < w->participants && ok; k++) {
        memcpy(c->inputs, c->base, (size_t)w->inputs * sizeof *c->inputs);
        for (int64_t i = 0; i < w->links; i++) c->inputs[w->link_to[i]] += w->link_factor[i] * c->signals[w->link_from[i]];
        ok = (participant_take(&c->s.participants[k], c->inputs, &answer) && participant_give(&c->s.participants[k], c->signals, &answer)) ||
             ended_by(outcome, k, &answer);
    }
    for (int64_t k = 0; k < w->participants && ok; k++)
        ok = (participant_begin(&c->s.participants[k], &answer) && participant_give(&c->s.participants[k], c->signals, &answer)) ||
             ended_by(outcome, k, &answer);
    memcpy(c->before, c->signals, (size_t)w->signals * sizeof *c->before);
    if (ok) record(c, outcome);
    report(c, outcome);
}

void coupling_run(Coupling *c, int64_t steps, int64_t last, Outcome *outcome) {
    const Wiring *w = &c->s.wiring;
    int ok = 1;
    outcome->ending = DONE;
    while (ok && c->number < steps) {
        memcpy(c->fresh, c->signals, (size_t)w->signals * sizeof *c->fresh);
        find_base(c);
        c->iterations = 1;
        ok = (c->s.scheme == ITERATED ? iterate : c->s.scheme == GAUSS_SEIDEL ? gauss_seidel : jacobi)(c, outcome) && conclude(c, last, outcome);
    }
    report(c, outcome);
}

void coupling_record(Coupling *c, Outcome *outcome) {
    outcome->ending = DONE;
    if (c->last_recorded != c->number) record(c, outcome);
    report(c, outcome);
}

int coupling_slope(Coupling *c, double *slope, Outcome *outcome) {
    const int64_t n = c->s.wiring.inputs;
    outcome->ending = DONE;
    if (find_response(c, c->signals, 1.0, DAMPERS_NOW, outcome) <= 0) return 0;
    memcpy(slope, c->response.slope, (size_t)(n * n) * sizeof *slope);
    return 1;
}
