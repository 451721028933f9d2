#include "instance.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "algebra.h"
#include "files.h"
#include "messages.h"

/* The program of the method that the FMU starts with describes its variables, too. */
static const char DESCRIPTION[] = "body.prog";
/* What begins the name of the program that tells the error. */
static const char SHADOW[] = "shadow";

enum { FIXED, TUNABLE };
/* Of parameters, but for those that fix interfaces. */
static const struct {
    double least;
    int variability;
} PARAMETERS[] = {
#define PARAMETER(symbol, name, type, unit, start, least, variability, ...) {least, variability},
#define WATCH(symbol, ...) {0.0, FIXED}, {0.0, FIXED},
#include "interface.def"
};
const Program *instance_description(const Instance *x) { return description(x); }

const char *variable_text(const Instance *x, int64_t variable, int64_t index, char *room) {
    const Program *p = description(x);
    const char *at = text_at(p->variable_texts, p->variable_bytes, variable);
    for (;;) {
        const char *end = strchr(at, '\n');
        if (!end) return "";
        if (index-- == 0) {
            snprintf(room, TEXT_SIZE / 4, "%.*s", (int)(end - at), at);
            return room;
        }
        at = end + 1;
    }
}

/* The variable of a parameter; -1 where the FMU has none. */
static int64_t parameter_variable(const Instance *x, int64_t index) {
    const Program *p = description(x);
    for (int64_t i = 0; i < p->variables; i++)
        if (p->variable_role[i] == ROLE_PARAMETER && p->variable_index[i] == index) return i;
    return -1;
}

static Body *open_named(Instance *x, const char *name, char *why) {
    const char *wrong;
    Body *body = body_open_file(x->folder, name, x->described, &wrong);
    if (body) return body;
    if (wrong) snprintf(why, TEXT_SIZE, "%s cannot be used: %s; build the FMU again", name, wrong);
    else snprintf(why, TEXT_SIZE, "%s is not in the FMU's resources (%.600s)", name, x->folder);
    return 0;
}

/* Whether the variables of a description are consistent with its body. */
static int variables_fit(const Program *p) {
    const int64_t most[] = {
#define ROLE(symbol, causality, axes, count, ...) count,
#include "interface.def"
    };
    static const int diagnostic_type[] = {
#define DIAGNOSTIC(symbol, name, type, ...) TYPE_##type,
#include "interface.def"
    };
    for (int64_t i = 0; i < p->variables; i++) {
        const int64_t role = p->variable_role[i], index = p->variable_index[i], type = p->variable_type[i];
        if (role < 0 || role >= ROLES || index < 0 || index >= most[role]) return 0;
        const int expected = role == ROLE_STATUS ? TYPE_INTEGER : role == ROLE_DIAGNOSTIC ? diagnostic_type[index] : TYPE_REAL;
        if (role == ROLE_PARAMETER ? type == TYPE_INTEGER : type != expected) return 0;
    }
    return 1;
}

static Overwritten take_overwritten(const Instance *x, Arena *arena) {
    Overwritten over;
    double **by_load[] = {&over.start_inputs, &over.end_inputs, &over.room}, **by_mode[] = {&over.q1, &over.v1, &over.shape};
    for (size_t i = 0; i < sizeof by_load / sizeof *by_load; i++) *by_load[i] = take(arena, x->loads);
    for (size_t i = 0; i < sizeof by_mode / sizeof *by_mode; i++) *by_mode[i] = take(arena, x->modes);
    over.seen = take(arena, x->loads + 5 * x->modes);
    over.astray = take(arena, 3 * x->modes);
    return over;
}

static void lay_out(Instance *x, Arena *arena) {
    const Program *p = description(x);
    x->motion = take(arena, 6 * p->interfaces);
    x->rates = take(arena, 6 * p->interfaces);
    x->numbers = take(arena, 0);
    const int64_t before = arena->used;
    x->parameter = take(arena, x->parameters);
    x->input = take(arena, x->loads);
    x->input_rate = take(arena, x->loads);
    x->previous = take(arena, x->loads);
    x->single = take(arena, S_COUNT);
    x->q = take(arena, x->modes);
    x->v = take(arena, x->modes);
    x->seen = take(arena, x->loads);
    x->drift = take(arena, 5 * x->modes);
    x->astray = take(arena, 3 * x->modes);
    x->states = take(arena, STATES * (x->modes + x->loads));
    x->number_count = arena->used - before;
    x->own = take_overwritten(x, arena);
    x->over = &x->own;
    x->kept = take(arena, x->number_count);
    x->stress = take(arena, p->stress_sets);
    x->compliance = take(arena, 36 * p->compliances * p->compliances);
    x->errors = take(arena, 2 * p->interfaces);
}

void instance_forget_body(Instance *x) {
    if (x->body != x->described) body_close(x->body);
    body_close(x->shadow);
    free(x->pieces.arena.start);
    x->pieces = (Pieces){0};
    x->body = x->shadow = 0;
    x->cached &= ~CACHED_REST;
}

void instance_reset(Instance *x) {
    const Program *p = description(x);
    instance_forget_body(x);
    memset(x->numbers, 0, (size_t)x->number_count * sizeof(double));
    x->parameter[P_STIFFNESS_SCALE] = x->parameter[P_DENSITY_SCALE] = 1.0;
    for (int64_t i = 0; i < p->variables; i++)
        if (p->variable_role[i] == ROLE_PARAMETER) x->parameter[p->variable_index[i]] = p->variable_start[i];
    x->single[S_HINT] = 1.0;
    x->single[S_MODES] = (double)x->modes;
    x->cached = x->rated = 0;
    x->changed = 1;
}

/* Let go what an instance holds; no instance. */
static Instance *instance_without(Instance *x) {
    instance_forget_body(x);
    body_close(x->described);
    free(x->folder);
    return 0;
}

Instance *instance_open(const char *location, const char *guid, char *why) {
    Instance counted = {.folder = path_of_location(location)}, *x = &counted;
    snprintf(why, TEXT_SIZE, "there is not enough memory");
    if (!x->folder || !(x->described = open_named(x, DESCRIPTION, why))) return instance_without(x);
    const Program *p = description(x);
    if (!guid || strcmp(guid, p->guid) != 0) {
        snprintf(why, TEXT_SIZE, "the guid %.80s is not that of this FMU's body, %.80s: modelDescription.xml and resources belong to different FMUs",
                 guid ? guid : "(none)", p->guid);
        return instance_without(x);
    }
    if (!p->variables || !variables_fit(p)) {
        snprintf(why, TEXT_SIZE, "%s describes no variables; build the FMU again", DESCRIPTION);
        return instance_without(x);
    }
    x->owner = body_mark(x->described);
    x->modes = p->modes;
    x->loads = p->loads;
    x->fixable = p->interfaces;
    x->parameters = P_FIXED + p->interfaces;
    Arena arena = {0};
    lay_out(x, &arena);
    x = calloc(1, sizeof *x + (size_t)arena.used * sizeof(double));
    if (!x) return instance_without(&counted);
    *x = counted;
    arena = (Arena){(double *)(x + 1), 0, arena.used, 0};
    lay_out(x, &arena);
    instance_reset(x);
    return x;
}

void instance_close(Instance *x) {
    if (!x) return;
    instance_without(x);
    free(x);
}

void instance_tell(Instance *x, Teller teller, void *to) {
    x->teller = teller;
    x->told = to;
}

double instance_time(const Instance *x) { return x->single[S_TIME]; }

void instance_begin_at(Instance *x, double time) { x->single[S_TIME] = time; }

void set_parameter(Instance *x, int64_t index, double value) {
    x->parameter[index] = value;
    x->cached &= ~CACHED_REST;
    if (!parameter_is_tunable(index) || !runs(x)) instance_forget_body(x);
}

int parameter_is_tunable(int64_t index) { return index < P_FIXED && PARAMETERS[index].variability == TUNABLE; }

void set_inputs(Instance *x, int64_t index, int64_t count, const double *values) {
    fetch(x->single, x->single + 1);
    const size_t size = (size_t)count * sizeof(double);
    if (memcmp(x->input + index, values, size) == 0) return;
    memcpy(x->input + index, values, size);
    x->changed = 1;
}

void set_input_rate(Instance *x, int64_t index, double value) { x->input_rate[index] = value, x->rated = 1; }

void start_changed(Instance *x) {
    if (runs(x)) return;
    x->single[S_KNOWN] = 0.0;
    x->cached = 0;
}

/* A program's file: of the method that the FMU starts with, or `word`, with the interfaces that are fixed. */
static void program_name(const Instance *x, const char *word, char *name, size_t size) {
    size_t n = (size_t)snprintf(name, size, "%s", word);
    for (int64_t i = 0; i < x->fixable && n < size; i++)
        if (x->parameter[P_FIXED + i] != 0.0) n += (size_t)snprintf(name + n, size - n, "-%lld", (long long)i);
    if (n < size) snprintf(name + n, size - n, ".prog");
}

/* That of the method chosen. */
static void chosen_name(const Instance *x, char *name, size_t size) {
    char room[TEXT_SIZE / 4];
    const int64_t variable = parameter_variable(x, P_METHOD);
    const int64_t chosen = (int64_t)x->parameter[P_METHOD];
    int fixed = 0;
    for (int64_t i = 0; i < x->fixable; i++) fixed |= x->parameter[P_FIXED + i] != 0.0;
    if (!fixed && (variable < 0 || chosen == (int64_t)description(x)->variable_start[variable]))
        snprintf(name, size, "%s", DESCRIPTION);
    else
        program_name(x, variable < 0 ? "body" : variable_text(x, variable, 1 + chosen, room), name, size);
}

/* Whether every number among the parameters can be used; else what is wrong with it. */
static Answer check_parameters(const Instance *x, char *why) {
    const Program *p = description(x);
    char room[TEXT_SIZE / 4];
    for (int64_t i = 0; i < p->variables; i++) {
        if (p->variable_role[i] != ROLE_PARAMETER || p->variable_type[i] != TYPE_REAL) continue;
        const int64_t index = p->variable_index[i];
        const double value = x->parameter[index], least = index < P_FIXED ? PARAMETERS[index].least : 0.0;
        /* In a run each step looks at it. */
        if (parameter_is_tunable(index) && runs(x)) continue;
        if (isfinite(value) && value >= least) continue;
        snprintf(why, TEXT_SIZE, SAY_PARAMETER_RANGE, variable_text(x, i, 0, room), value, least);
        return ANSWER_FAILED;
    }
    return ANSWER_OK;
}

static Body *open_chosen(Instance *x, const char *name, char *why) {
    if (strcmp(name, DESCRIPTION) == 0) return x->described;
    char path[TEXT_SIZE], room[TEXT_SIZE / 4];
    Body *body = open_named(x, name, path);
    if (body) return body;
    const int64_t method = parameter_variable(x, P_METHOD);
    snprintf(why, TEXT_SIZE, "method '%s' with the interfaces fixed as they are: %.700s; fix others, or choose another method",
             method < 0 ? "" : variable_text(x, method, 1 + (int64_t)x->parameter[P_METHOD], room), path);
    return 0;
}

/* Open what tells the error of the body chosen. Fixed at other interfaces than frames hang on it has nothing of the kind. */
static Answer open_shadow(Instance *x, char *why) {
    const Program *p = description(x);
    char name[TEXT_SIZE / 2];
    int told = 0, fixed = 0;
    for (int64_t i = 0; i < p->variables; i++) told |= p->variable_role[i] == ROLE_ERROR;
    for (int64_t i = 0; i < x->fixable; i++) fixed |= x->parameter[P_FIXED + i] != 0.0;
    if (!told) return ANSWER_OK;
    program_name(x, SHADOW, name, sizeof name);
    x->shadow = open_named(x, name, why);
    if (x->shadow && is_shadow(x->shadow, x->body)) return ANSWER_OK;
    if (!x->shadow && fixed) return ANSWER_OK;
    if (x->shadow) snprintf(why, TEXT_SIZE, "%s is of another body; build the FMU again", name);
    instance_forget_body(x);
    return ANSWER_FAILED;
}

/* Body of the parameters chosen. */
static Answer choose(Instance *x, char *why) {
    if (x->body) return ANSWER_OK;
    if (check_parameters(x, why) != ANSWER_OK) return ANSWER_FAILED;
    char name[TEXT_SIZE / 2];
    chosen_name(x, name, sizeof name);
    Body *body = open_chosen(x, name, why);
    if (!body) return ANSWER_FAILED;
    const Program *p = body->p, *d = description(x);
    if (p->modes > d->modes || p->loads != d->loads || p->interfaces != d->interfaces || p->stress_sets != d->stress_sets ||
        strcmp(p->guid, d->guid) != 0) {
        snprintf(why, TEXT_SIZE, "%s is of another body; build the FMU again", name);
        if (body != x->described) body_close(body);
        return ANSWER_FAILED;
    }
    x->scale = scale_of(x->parameter[P_STIFFNESS_SCALE], x->parameter[P_DENSITY_SCALE]);
    const StepLimits limits = {x->scale.pace * x->parameter[P_STEP_LIMIT], x->parameter[P_STEP_TOLERANCE], x->parameter[P_STEP_MOST]};
    if (body_options(body, x->parameter[P_DAMPING_SCALE], &limits) != FLEX_OK) {
        snprintf(why, TEXT_SIZE, "a parameter of the steps is out of range: damping.scale %g, internal_step.limit %g, tolerance %g, most %g",
                 x->parameter[P_DAMPING_SCALE], x->parameter[P_STEP_LIMIT], limits.tolerance, x->parameter[P_STEP_MOST]);
        if (body != x->described) body_close(body);
        return ANSWER_FAILED;
    }
    x->body = body;
    find_softening(body);
    if (open_shadow(x, why) != ANSWER_OK) return ANSWER_FAILED;
    if (prepare_looks(x)) return ANSWER_OK;
    instance_forget_body(x);
    snprintf(why, TEXT_SIZE, "there is not enough memory");
    return ANSWER_FAILED;
}

/* Tell of an input that is not finite. */
static Answer wrong_input(const Instance *x, int64_t input, const char *before, char *why) {
    const Program *p = description(x);
    char room[TEXT_SIZE / 4];
    int64_t variable = 0;
    while (variable < p->variables - 1 && !(p->variable_role[variable] == ROLE_INPUT && p->variable_index[variable] == input)) variable++;
    const int rated = isfinite(x->input[input]);
    snprintf(why, TEXT_SIZE, SAY_WRONG_INPUT, before, variable_text(x, variable, 0, room),
             rated ? ": its derivative" : "", rated ? x->input_rate[input] : x->input[input]);
    return ANSWER_FAILED;
}

Answer instance_begin(Instance *x, char *why) {
    if (choose(x, why) != ANSWER_OK) return ANSWER_FAILED;
    if (x->single[S_KNOWN] != 0.0) return ANSWER_OK;
    const int64_t m = x->body->p->modes;
    memset(x->q, 0, (size_t)x->modes * sizeof(double));
    memset(x->v, 0, (size_t)x->modes * sizeof(double));
    if (x->parameter[P_INITIALIZATION] == START_STATIC) {
        for (int64_t i = 0; i < x->loads; i++)
            if (!isfinite(x->input[i])) return wrong_input(x, i, "static initialisation: ", why);
        double share;
        int64_t rounds;
        scale_inputs(&x->scale, description(x), x->input, x->over->start_inputs);
        const int answer = body_static(x->body, x->over->start_inputs, x->over->q1, &share, &rounds);
        if (answer != FLEX_OK) {
            char words[TEXT_SIZE];
            body_static_refusal(x->body, answer, share, words, TEXT_SIZE);
            snprintf(why, TEXT_SIZE, "static initialisation: %.900s", words);
            return ANSWER_FAILED;
        }
        memcpy(x->q, x->over->q1, (size_t)m * sizeof(double));
    }
    x->single[S_MODES] = (double)m;
    x->single[S_KNOWN] = 1.0;
    x->cached = 0;
    return ANSWER_OK;
}

void instance_end(Instance *x) {
    char why[TEXT_SIZE];
    if (instance_begin(x, why) == ANSWER_OK) inspect_rest(x);
}

Answer instance_start(Instance *x, char *why) {
    if (instance_begin(x, why) != ANSWER_OK) return instance_failed(x, ANSWER_FAILED);
    for (int64_t i = 0; i < x->loads; i++) x->previous[i] = isfinite(x->input[i]) ? x->input[i] : 0.0;
    scale_inputs(&x->scale, description(x), x->previous, x->over->start_inputs);
    if (x->parameter[P_INITIALIZATION] == START_STATIC && inspect(x, x->q, x->v, 0.0, x->over->start_inputs, 0, why) != ANSWER_OK) {
        char text[TEXT_SIZE];
        memcpy(text, why, TEXT_SIZE);
        snprintf(why, TEXT_SIZE, "static initialisation: %.900s", text);
        return instance_failed(x, ANSWER_FAILED);
    }
    x->single[S_RUNNING] = 1.0;
    return ANSWER_OK;
}

/* Inputs at a step's start, and at its end where these are others: whether they are. As the master means them. */
static int over_step(Instance *x, double step) {
    const int64_t kind = (int64_t)x->parameter[P_INTERPOLATION];
    int differ = 0;
    if (kind == INTERPOLATION_CONSTANT && !x->rated) {
        memcpy(x->over->start_inputs, x->input, (size_t)x->loads * sizeof(double));
        return 0;
    }
    for (int64_t i = 0; i < x->loads; i++) {
        const double now = x->input[i], before = x->previous[i], rate = x->input_rate[i];
        double start = now, end = now;
        if (kind == INTERPOLATION_RAMP)
            start = before;
        else if (kind == INTERPOLATION_LINEAR && x->single[S_LAST_STEP] > 0.0)
            end = now + (now - before) * (step / x->single[S_LAST_STEP]);
        /* A derivative that the master sets says more than what was before. */
        if (rate != 0.0) {
            start = now;
            end = now + rate * step;
        }
        x->over->start_inputs[i] = start;
        x->over->end_inputs[i] = end;
        differ |= start != end;
    }
    return differ;
}

/* What follows from internal steps half as long is found before they are needed: such a step takes long enough. */
static const double SOON = 1.5;

static Answer whole_step(Instance *x, double time, double step, char *why) {
    if (!isfinite(time) || !isfinite(step) || step < 0.0 || !isfinite(time + step)) {
        snprintf(why, TEXT_SIZE, SAY_BAD_TIME, step, time);
        return instance_failed(x, ANSWER_REFUSED);
    }
    for (int64_t i = 0; (!all_finite(x->input, x->loads) || (x->rated && !all_finite(x->input_rate, x->loads))) && i < x->loads; i++) {
        if (isfinite(x->input[i]) && isfinite(x->input_rate[i])) continue;
        wrong_input(x, i, "", why);
        return instance_failed(x, ANSWER_REFUSED);
    }
    if (instance_begin(x, why) != ANSWER_OK) return instance_failed(x, ANSWER_FAILED);
    if (step == 0.0) return ANSWER_OK;
    const int64_t m = x->body->p->modes;
    const int ramps = over_step(x, step);
    if (!all_finite(x->over->start_inputs, x->loads) || (ramps && !all_finite(x->over->end_inputs, x->loads))) {
        snprintf(why, TEXT_SIZE, SAY_GROWS, step);
        return instance_failed(x, ANSWER_REFUSED);
    }
    const double fewest = x->parameter[P_STEP_FEWEST], within = x->scale.pace * step;
    if (!(fewest >= 1.0 && fewest < 1e15)) {
        snprintf(why, TEXT_SIZE, SAY_FEWEST, fewest);
        return instance_failed(x, ANSWER_REFUSED);
    }
    scale_inputs(&x->scale, description(x), x->over->start_inputs, x->over->start_inputs);
    if (ramps) scale_inputs(&x->scale, description(x), x->over->end_inputs, x->over->end_inputs);
    int64_t hint = (int64_t)fmax(x->single[S_HINT], ceil(fewest));
    const int exact = steps_are_exact(x->body);
    Work work = {0, 0, 0.0, exact ? 0 : x->over->astray, finer_by(x, 1.0)};
    if (!exact && finer_by(x, SOON) > work.finer) foresee_steps(x->body, within / (double)(hint * finer_by(x, SOON)));
    const double usual = (double)hint;
    if (!exact) memcpy(x->over->astray, x->astray, (size_t)(3 * m) * sizeof(double));
    memcpy(x->over->q1, x->q, (size_t)m * sizeof(double));
    memcpy(x->over->v1, x->v, (size_t)m * sizeof(double));
    const int answer = body_step(x->body, x->over->start_inputs, ramps ? x->over->end_inputs : 0, within, x->over->q1, x->over->v1, &hint, &work);
    if (answer != FLEX_OK) {
        body_refusal(x->body, answer, step, &work, why, TEXT_SIZE);
        return instance_failed(x, step_refused(x));
    }
    leave_to_looks(x, (double)work.iterations, usual);
    const Answer verdict = inspect(x, x->over->q1, x->over->v1, within, ramps ? x->over->end_inputs : x->over->start_inputs, 0, why);
    if (verdict != ANSWER_OK) return instance_failed(x, verdict);
    memcpy(x->q, x->over->q1, (size_t)m * sizeof(double));
    memcpy(x->v, x->over->v1, (size_t)m * sizeof(double));
    if (!exact) memcpy(x->astray, x->over->astray, (size_t)(3 * m) * sizeof(double));
    /* A derivative holds for one step, at whose end the input stays where it has grown to. */
    for (int64_t i = 0; x->rated && i < x->loads; i++) {
        if (x->input_rate[i] != 0.0) x->input[i] += x->input_rate[i] * step;
        x->input_rate[i] = 0.0;
    }
    memcpy(x->previous, x->input, (size_t)x->loads * sizeof(double));
    x->changed = x->rated = 0;
    if (ramps || x->single[S_HINT] != (double)hint) x->cached &= ~CACHED_REST;
    x->single[S_LAST_STEP] = step;
    x->single[S_TIME] = time + step;
    x->single[S_HINT] = (double)hint;
    x->single[S_SUBSTEPS] = (double)work.substeps;
    x->single[S_ITERATIONS] = (double)work.iterations;
    x->single[S_ERROR] = work.error;
    return ANSWER_OK;
}

/* Whether a step is as the one before, in which nothing moved. */
static int goes_on_resting(const Instance *x, double time, double step) {
    const int rests = CACHED_REST | CACHED_MOTION;
    return (x->cached & rests) == rests && step == x->single[S_LAST_STEP] && isfinite(time + step) &&
           (!x->changed || memcmp(x->input, x->previous, (size_t)x->loads * sizeof(double)) == 0) &&
           (!x->rated || all_zero(x->input_rate, x->loads));
}

/* Only time goes on, and looks. */
static Answer step_at_rest(Instance *x, double time, double step, char *why) {
    const int as_given = x->scale.force == 1.0 && x->scale.acceleration == 1.0;
    if (!as_given) scale_inputs(&x->scale, description(x), x->previous, x->over->start_inputs);
    const double *inputs = as_given ? x->previous : x->over->start_inputs;
    const Answer verdict = inspect(x, x->q, x->v, x->scale.pace * step, inputs, 1, why);
    if (verdict != ANSWER_OK) return instance_failed(x, verdict);
    x->single[S_TIME] = time + step;
    return ANSWER_OK;
}

/* Numbers that steps overwrite which may lie on the stack: of many instances in turn they stay in the processor's cache there. */
enum { ON_THE_STACK = 2048 };

static Answer step_on_the_stack(Instance *x, double time, double step, char *why) {
    double room[ON_THE_STACK];
    fetch_step(x);
    Arena arena = {room, 0, ON_THE_STACK, 0};
    Overwritten over = take_overwritten(x, &arena);
    if (!arena.refused) x->over = &over;
    const Answer answer = whole_step(x, time, step, why);
    x->over = &x->own;
    return answer;
}

Answer instance_step(Instance *x, double time, double step, int *halvings, char *why) {
    const double status = x->single[S_STATUS];
    for (;; --*halvings, step *= 0.5, x->single[S_STATUS] = status) {
        const Answer answer = goes_on_resting(x, time, step) ? step_at_rest(x, time, step, why) : step_on_the_stack(x, time, step, why);
        if (answer != ANSWER_REFUSED || *halvings <= 0) return answer;
    }
}
