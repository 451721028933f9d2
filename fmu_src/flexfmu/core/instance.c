#include "instance.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "files.h"
#include "messages.h"

/* The program of the method that the FMU starts with describes its variables, too. */
static const char DESCRIPTION[] = "body.prog";
static const char MARK[] = "flexstat";

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
enum { CACHED_MOTION = 1, CACHED_STRESS = 2, CACHED_COMPLIANCE = 4 };

struct Instance {
    char *folder;
    Body *described; /* of the method at the start */
    Body *body;      /* of the method chosen, once it is known */
    uint64_t owner;  /* what states are known by */
    Teller teller;
    void *told;
    int64_t modes, loads, parameters, fixable;
    double *arena;
    /* All that the future depends on, one run of numbers from here on. */
    double *numbers;
    int64_t number_count;
    double *parameter, *input, *input_rate, *previous, *single, *q, *v, *seen;
    Memory memory;
    /* What is found when it is asked for. */
    int cached;
    double *motion, *rates, *stress, *compliance, *start_inputs, *end_inputs, *q1, *v1, *room, *shape, *kept;
};

/* Single numbers of the state. */
enum {
    S_LAST_STEP, S_TIME, S_KNOWN, S_RUNNING, S_STATUS, S_HINT, S_MODES, S_SUBSTEPS, S_ITERATIONS, S_ERROR, S_LARGEST,
    S_WARNED, S_MOMENTUM = S_WARNED + WATCHES, S_KINETIC = S_MOMENTUM + sizeof(Momentum) / sizeof(double), S_INERTIA, S_COUNT
};

static const Program *description(const Instance *x) { return &x->described->p; }

const Program *instance_description(const Instance *x) { return description(x); }

const char *variable_text(const Instance *x, int64_t variable, int64_t index, char *room) {
    const Program *p = description(x);
    const char *at = text_at(p->variable_texts, p->variable_bytes, variable);
    for (;;) {
        const char *end = strchr(at, '\n');
        if (!end) return "";
        if (index-- == 0) {
            const size_t length = (size_t)(end - at) < TEXT_SIZE / 4 - 1 ? (size_t)(end - at) : TEXT_SIZE / 4 - 1;
            memcpy(room, at, length);
            room[length] = 0;
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
    int64_t size = 0;
    const char *wrong = "";
    void *image = read_whole(x->folder, name, &size);
    if (!image) {
        snprintf(why, TEXT_SIZE, "%s is not in the FMU's resources (%.600s)", name, x->folder);
        return 0;
    }
    Body *body = body_open(image, size, &wrong);
    free(image);
    if (!body) snprintf(why, TEXT_SIZE, "%s cannot be used: %s; build the FMU again", name, wrong);
    return body;
}

/* Whether the variables of a description are consistent with its body. */
static int variables_fit(const Program *p) {
    const int64_t most[] = {
#define ROLE(symbol, count) count,
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

static void lay_out(Instance *x, Arena *arena) {
    const Program *p = description(x);
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
    x->number_count = arena->used - before;
    x->motion = take(arena, 6 * p->interfaces);
    x->rates = take(arena, 6 * p->interfaces);
    x->stress = take(arena, p->stress_sets);
    x->compliance = take(arena, 36 * p->compliances * p->compliances);
    x->start_inputs = take(arena, x->loads);
    x->end_inputs = take(arena, x->loads);
    x->q1 = take(arena, x->modes);
    x->v1 = take(arena, x->modes);
    x->room = take(arena, x->loads + S_COUNT);
    x->shape = take(arena, x->modes);
    x->kept = take(arena, x->number_count);
}

void instance_reset(Instance *x) {
    const Program *p = description(x);
    if (x->body != x->described) body_close(x->body);
    x->body = 0;
    memset(x->numbers, 0, (size_t)x->number_count * sizeof(double));
    for (int64_t i = 0; i < p->variables; i++)
        if (p->variable_role[i] == ROLE_PARAMETER) x->parameter[p->variable_index[i]] = p->variable_start[i];
    x->single[S_HINT] = 1.0;
    x->single[S_MODES] = (double)x->modes;
    x->cached = 0;
}

Instance *instance_open(const char *location, const char *guid, char *why) {
    Instance *x = calloc(1, sizeof *x);
    snprintf(why, TEXT_SIZE, "there is not enough memory");
    if (!x) return 0;
    x->folder = path_of_location(location);
    if (!x->folder || !(x->described = open_named(x, DESCRIPTION, why))) {
        instance_close(x);
        return 0;
    }
    const Program *p = description(x);
    if (!guid || strcmp(guid, p->guid) != 0) {
        snprintf(why, TEXT_SIZE, "the guid %.80s is not that of this FMU's body, %.80s: modelDescription.xml and resources belong to different FMUs",
                 guid ? guid : "(none)", p->guid);
        instance_close(x);
        return 0;
    }
    if (!p->variables || !variables_fit(p)) {
        snprintf(why, TEXT_SIZE, "%s describes no variables; build the FMU again", DESCRIPTION);
        instance_close(x);
        return 0;
    }
    x->owner = checksum(x->described->image, x->described->image_size / 8);
    x->modes = p->modes;
    x->loads = p->loads;
    x->fixable = p->interfaces;
    x->parameters = P_FIXED + p->interfaces;
    Arena arena = {0};
    lay_out(x, &arena);
    x->arena = calloc((size_t)arena.used, sizeof(double));
    if (!x->arena) {
        instance_close(x);
        return 0;
    }
    arena = (Arena){x->arena, 0, arena.used, 0};
    lay_out(x, &arena);
    x->memory.inputs = x->seen;
    instance_reset(x);
    return x;
}

void instance_close(Instance *x) {
    if (!x) return;
    if (x->body != x->described) body_close(x->body);
    body_close(x->described);
    free(x->folder);
    free(x->arena);
    free(x);
}

void instance_tell(Instance *x, Teller teller, void *to) {
    x->teller = teller;
    x->told = to;
}

static int runs(const Instance *x) { return x->single[S_RUNNING] != 0.0; }

double instance_time(const Instance *x) { return x->single[S_TIME]; }

void instance_begin_at(Instance *x, double time) { x->single[S_TIME] = time; }

void set_parameter(Instance *x, int64_t index, double value) {
    x->parameter[index] = value;
    if (parameter_is_tunable(index) && runs(x)) return;
    if (x->body != x->described) body_close(x->body);
    x->body = 0;
}

int parameter_is_tunable(int64_t index) { return index < P_FIXED && PARAMETERS[index].variability == TUNABLE; }

void set_input(Instance *x, int64_t index, double value) {
    x->input[index] = value;
    x->input_rate[index] = 0.0;
}

void set_input_rate(Instance *x, int64_t index, double value) { x->input_rate[index] = value; }

void start_changed(Instance *x) {
    if (runs(x)) return;
    x->single[S_KNOWN] = 0.0;
    x->cached = 0;
}

/* The file of the method chosen, with the interfaces that are fixed. */
static void program_name(const Instance *x, char *name, size_t size) {
    char room[TEXT_SIZE / 4];
    const int64_t variable = parameter_variable(x, P_METHOD);
    const int64_t chosen = (int64_t)x->parameter[P_METHOD];
    int fixed = 0;
    for (int64_t i = 0; i < x->fixable; i++) fixed |= x->parameter[P_FIXED + i] != 0.0;
    if (!fixed && (variable < 0 || chosen == (int64_t)description(x)->variable_start[variable])) {
        snprintf(name, size, "%s", DESCRIPTION);
        return;
    }
    size_t n = (size_t)snprintf(name, size, "%s", variable < 0 ? "body" : variable_text(x, variable, 1 + chosen, room));
    for (int64_t i = 0; i < x->fixable && n < size; i++)
        if (x->parameter[P_FIXED + i] != 0.0) n += (size_t)snprintf(name + n, size - n, "-%lld", (long long)i);
    if (n < size) snprintf(name + n, size - n, ".prog");
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

/* Body of the parameters chosen. */
static Answer choose(Instance *x, char *why) {
    if (x->body) return ANSWER_OK;
    if (check_parameters(x, why) != ANSWER_OK) return ANSWER_FAILED;
    char name[TEXT_SIZE / 2];
    program_name(x, name, sizeof name);
    Body *body = open_chosen(x, name, why);
    if (!body) return ANSWER_FAILED;
    const Program *p = &body->p, *d = description(x);
    if (p->modes > d->modes || p->loads != d->loads || p->interfaces != d->interfaces || p->stress_sets != d->stress_sets ||
        strcmp(p->guid, d->guid) != 0) {
        snprintf(why, TEXT_SIZE, "%s is of another body; build the FMU again", name);
        if (body != x->described) body_close(body);
        return ANSWER_FAILED;
    }
    const StepLimits limits = {x->parameter[P_STEP_LIMIT], x->parameter[P_STEP_TOLERANCE], x->parameter[P_STEP_MOST]};
    if (body_options(body, x->parameter[P_DAMPING_SCALE], &limits) != FLEX_OK) {
        snprintf(why, TEXT_SIZE, "a parameter of the steps is out of range: damping.scale %g, internal_step.limit %g, tolerance %g, most %g",
                 x->parameter[P_DAMPING_SCALE], limits.longest, limits.tolerance, x->parameter[P_STEP_MOST]);
        if (body != x->described) body_close(body);
        return ANSWER_FAILED;
    }
    x->body = body;
    return ANSWER_OK;
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

/* Body and state, found from parameters and inputs when first asked for. */
static Answer begin(Instance *x, char *why) {
    if (choose(x, why) != ANSWER_OK) return ANSWER_FAILED;
    if (x->single[S_KNOWN] != 0.0) return ANSWER_OK;
    const int64_t m = x->body->p.modes;
    memset(x->q, 0, (size_t)x->modes * sizeof(double));
    memset(x->v, 0, (size_t)x->modes * sizeof(double));
    if (x->parameter[P_INITIALIZATION] == START_STATIC) {
        for (int64_t i = 0; i < x->loads; i++)
            if (!isfinite(x->input[i])) {
                return wrong_input(x, i, "static initialisation: ", why);
            }
        double share;
        int64_t rounds;
        const int answer = body_static(x->body, x->input, x->q1, &share, &rounds);
        if (answer != FLEX_OK) {
            char words[TEXT_SIZE];
            body_static_refusal(x->body, answer, share, words, TEXT_SIZE);
            snprintf(why, TEXT_SIZE, "static initialisation: %.900s", words);
            return ANSWER_FAILED;
        }
        memcpy(x->q, x->q1, (size_t)m * sizeof(double));
    }
    x->single[S_MODES] = (double)m;
    x->single[S_KNOWN] = 1.0;
    x->cached = 0;
    return ANSWER_OK;
}

/* Limits and what happens beyond them, which follow each other in turn. */
static void watches(const Instance *x, Watch *watch) {
    const double *limit = x->parameter + P_ROTATION_LIMIT;
    for (int i = 0; i < WATCHES; i++, limit += 2) watch[i] = (Watch){limit[0], (OnLimit)limit[1]};
}

/* Look at a place under loads; ANSWER_OK where only warnings were found, which are told. */
static Answer inspect(Instance *x, const double *q, const double *v, int stepped, const double *inputs, char *why) {
    Watch watch[WATCHES];
    Findings found;
    Answer answer = ANSWER_OK;
    watches(x, watch);
    double *kept = x->room + x->loads;
    memcpy(kept, x->single, S_COUNT * sizeof(double));
    memcpy(x->kept, x->seen, (size_t)x->loads * sizeof(double));
    x->memory.largest = x->single[S_LARGEST];
    memcpy(x->memory.warned, x->single + S_WARNED, sizeof x->memory.warned);
    memcpy(&x->memory.momentum, x->single + S_MOMENTUM, sizeof x->memory.momentum);
    x->memory.inertia.kinetic = x->single[S_KINETIC];
    x->memory.inertia.missed = x->single[S_INERTIA];
    look(x->body, watch, q, v, stepped, inputs, &x->memory, x->room, x->shape, &found);
    x->single[S_LARGEST] = x->memory.largest;
    memcpy(x->single + S_MOMENTUM, &x->memory.momentum, sizeof x->memory.momentum);
    x->single[S_KINETIC] = x->memory.inertia.kinetic;
    x->single[S_INERTIA] = x->memory.inertia.missed;
    memcpy(x->single + S_WARNED, x->memory.warned, sizeof x->memory.warned);
    for (int i = 0; i < found.count; i++) {
        if (found.action[i] == ON_WARN) continue;
        snprintf(why, TEXT_SIZE, "%s", found.text[i]);
        if (found.action[i] == ON_TERMINATE) answer = ANSWER_FAILED;
        if (answer == ANSWER_OK) answer = ANSWER_REFUSED;
    }
    if (answer != ANSWER_OK) {
        memcpy(x->single, kept, S_COUNT * sizeof(double));
        memcpy(x->seen, x->kept, (size_t)x->loads * sizeof(double));
        return answer;
    }
    for (int i = 0; i < found.count; i++) {
        if (x->single[S_STATUS] == STATE_SOUND) x->single[S_STATUS] = STATE_PASSED;
        if (x->teller) x->teller(x->told, 1, found.text[i]);
    }
    return ANSWER_OK;
}

static Answer failed(Instance *x, Answer answer) {
    x->single[S_STATUS] = STATE_REFUSED;
    return answer;
}

static Answer no_room(Instance *x, char *why) {
    snprintf(why, TEXT_SIZE, SAY_NO_ROOM);
    return failed(x, ANSWER_FAILED);
}

Answer instance_start(Instance *x, char *why) {
    if (begin(x, why) != ANSWER_OK) return failed(x, ANSWER_FAILED);
    for (int64_t i = 0; i < x->loads; i++) x->previous[i] = isfinite(x->input[i]) ? x->input[i] : 0.0;
    if (x->parameter[P_INITIALIZATION] == START_STATIC && inspect(x, x->q, x->v, 0, x->previous, why) != ANSWER_OK) {
        char text[TEXT_SIZE];
        memcpy(text, why, TEXT_SIZE);
        snprintf(why, TEXT_SIZE, "static initialisation: %.900s", text);
        return failed(x, ANSWER_FAILED);
    }
    x->single[S_RUNNING] = 1.0;
    return ANSWER_OK;
}

/* Inputs at a step's start and end; whether the latter are others. */
static int over_step(Instance *x, double step) {
    const int64_t kind = (int64_t)x->parameter[P_INTERPOLATION];
    int differ = 0;
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
        x->start_inputs[i] = start;
        x->end_inputs[i] = end;
        differ |= start != end;
    }
    return differ;
}

Answer instance_step(Instance *x, double time, double step, char *why) {
    if (!isfinite(time) || !isfinite(step) || step < 0.0 || !isfinite(time + step)) {
        snprintf(why, TEXT_SIZE, SAY_BAD_TIME, step, time);
        return failed(x, ANSWER_REFUSED);
    }
    for (int64_t i = 0; i < x->loads; i++) {
        if (isfinite(x->input[i]) && isfinite(x->input_rate[i])) continue;
        wrong_input(x, i, "", why);
        return failed(x, ANSWER_REFUSED);
    }
    if (begin(x, why) != ANSWER_OK) return failed(x, ANSWER_FAILED);
    if (step == 0.0) return ANSWER_OK;
    const int64_t m = x->body->p.modes;
    const int ramps = over_step(x, step);
    for (int64_t i = 0; i < x->loads; i++) {
        if (isfinite(x->start_inputs[i]) && isfinite(x->end_inputs[i])) continue;
        snprintf(why, TEXT_SIZE, SAY_GROWS, step);
        return failed(x, ANSWER_REFUSED);
    }
    const double fewest = x->parameter[P_STEP_FEWEST];
    if (!(fewest >= 1.0 && fewest < 1e15)) {
        snprintf(why, TEXT_SIZE, SAY_FEWEST, fewest);
        return failed(x, ANSWER_REFUSED);
    }
    int64_t hint = (int64_t)fmax(x->single[S_HINT], ceil(fewest));
    Work work = {0, 0, 0.0};
    memcpy(x->q1, x->q, (size_t)m * sizeof(double));
    memcpy(x->v1, x->v, (size_t)m * sizeof(double));
    const int answer = body_step(x->body, x->start_inputs, ramps ? x->end_inputs : 0, step, x->q1, x->v1, &hint, &work);
    if (answer != FLEX_OK) {
        body_refusal(x->body, answer, step, &work, why, TEXT_SIZE);
        return failed(x, x->parameter[P_ON_STEP] == ON_REFUSAL_TERMINATE ? ANSWER_FAILED : ANSWER_REFUSED);
    }
    const Answer verdict = inspect(x, x->q1, x->v1, 1, ramps ? x->end_inputs : x->start_inputs, why);
    if (verdict != ANSWER_OK) return failed(x, verdict);
    memcpy(x->q, x->q1, (size_t)m * sizeof(double));
    memcpy(x->v, x->v1, (size_t)m * sizeof(double));
    /* An input with a derivative goes on growing until it is set again. */
    for (int64_t i = 0; i < x->loads; i++) {
        if (x->input_rate[i] != 0.0) x->input[i] = x->end_inputs[i];
        x->previous[i] = x->input[i];
    }
    x->single[S_LAST_STEP] = step;
    x->single[S_TIME] = time + step;
    x->single[S_HINT] = (double)hint;
    x->single[S_SUBSTEPS] = (double)work.substeps;
    x->single[S_ITERATIONS] = (double)work.iterations;
    x->single[S_ERROR] = work.error;
    x->cached = 0;
    return ANSWER_OK;
}

static double usual_step(const Instance *x) {
    return x->single[S_LAST_STEP] > 0.0 ? x->single[S_LAST_STEP] : description(x)->suggested_step[0];
}

/* Diagnostics: `diagnose_symbol` of each in interface.def. Of the state alone. */
static double diagnose_rotation(Instance *x) { return body_rotations(x->body, x->q, 0); }

/* Inputs set since the last step have not acted yet, and need not be finite. */
static double diagnose_stability(Instance *x) { return body_stability(x->body, x->previous, x->q, 0); }
static double diagnose_missed(Instance *x) { return body_missed(x->body, x->previous, 0); }

static double diagnose_spin(Instance *x) { return body_spin(x->body, x->q, x->v); }

static double diagnose_momentum(Instance *x) { return x->single[S_MOMENTUM + sizeof(Momentum) / sizeof(double) - 1]; }

static double diagnose_inertia(Instance *x) {
    return x->single[S_KINETIC] > 0.0 ? x->single[S_INERTIA] / x->single[S_KINETIC] : 0.0;
}

static double diagnose_step_error(Instance *x) { return x->single[S_ERROR]; }

static double diagnose_strain_energy(Instance *x) {
    double strain, kinetic;
    body_energies(x->body, x->q, x->v, &strain, &kinetic);
    return strain;
}

static double diagnose_kinetic_energy(Instance *x) {
    double strain, kinetic;
    body_energies(x->body, x->q, x->v, &strain, &kinetic);
    return kinetic;
}

static double diagnose_iterations(Instance *x) { return x->single[S_ITERATIONS]; }
static double diagnose_substeps(Instance *x) { return x->single[S_SUBSTEPS]; }

/* One that the table has and this file has not is an error of the compiler. */
static double (*const DIAGNOSE[])(Instance *) = {
#define DIAGNOSTIC(symbol, ...) diagnose_##symbol,
#include "interface.def"
};

Answer get_number(Instance *x, int64_t variable, double *value, char *why) {
    const Program *p = description(x);
    const int64_t role = p->variable_role[variable], index = p->variable_index[variable];
    switch (role) {
    case ROLE_INPUT: *value = x->input[index]; return ANSWER_OK;
    case ROLE_PARAMETER: *value = x->parameter[index]; return ANSWER_OK;
    case ROLE_STATUS: *value = x->single[S_STATUS]; return ANSWER_OK;
    default: break;
    }
    if (begin(x, why) != ANSWER_OK) return failed(x, ANSWER_FAILED);
    switch (role) {
    case ROLE_MOTION:
    case ROLE_RATE:
        if (!(x->cached & CACHED_MOTION) && body_motion(x->body, x->q, x->v, x->motion, x->rates) != FLEX_OK) return no_room(x, why);
        x->cached |= CACHED_MOTION;
        *value = role == ROLE_MOTION ? x->motion[index] : x->rates[index];
        break;
    case ROLE_STRESS:
        if (!(x->cached & CACHED_STRESS)) body_stress(x->body, x->q, x->stress);
        x->cached |= CACHED_STRESS;
        *value = x->stress[index];
        break;
    case ROLE_COMPLIANCE: {
        const int64_t n = p->compliances;
        if (!(x->cached & CACHED_COMPLIANCE) &&
            body_compliance(x->body, x->previous, usual_step(x), x->q, p->compliance_interface, n, x->compliance) != FLEX_OK)
            return no_room(x, why);
        x->cached |= CACHED_COMPLIANCE;
        /* By pairs of interfaces: of the first by loads on the second, row by row. */
        const int64_t pair = index / 36, row = index % 36 / 6, column = index % 6;
        *value = x->compliance[(6 * (pair / n) + row) * 6 * n + 6 * (pair % n) + column];
        break;
    }
    default: *value = DIAGNOSE[index](x);
    }
    return ANSWER_OK;
}

Answer instance_derivative(Instance *x, const int64_t *outputs, int64_t output_count, const int64_t *inputs,
                           int64_t input_count, const double *direction, double *result, char *why) {
    const Program *p = description(x);
    char room[TEXT_SIZE / 4];
    for (int64_t i = 0; i < output_count; i++)
        if (p->variable_role[outputs[i]] != ROLE_MOTION) {
            snprintf(why, TEXT_SIZE, "derivatives are offered of displacements and rotations, not of %s", variable_text(x, outputs[i], 0, room));
            return ANSWER_REFUSED;
        }
    for (int64_t i = 0; i < input_count; i++)
        if (p->variable_role[inputs[i]] != ROLE_INPUT) {
            snprintf(why, TEXT_SIZE, "derivatives are offered by inputs, not by %s", variable_text(x, inputs[i], 0, room));
            return ANSWER_REFUSED;
        }
    if (begin(x, why) != ANSWER_OK) return failed(x, ANSWER_FAILED);
    memset(x->start_inputs, 0, (size_t)x->loads * sizeof(double));
    for (int64_t i = 0; i < input_count; i++) x->start_inputs[p->variable_index[inputs[i]]] += direction[i];
    if (body_derivative(x->body, x->previous, usual_step(x), x->q, x->start_inputs, x->rates) != FLEX_OK) return no_room(x, why);
    x->cached &= ~CACHED_MOTION;
    for (int64_t i = 0; i < output_count; i++) {
        result[i] = x->rates[p->variable_index[outputs[i]]];
        if (isfinite(result[i])) continue;
        snprintf(why, TEXT_SIZE, "the derivative of %s is not finite: the loads, the direction or the step are too large for the arithmetic", variable_text(x, outputs[i], 0, room));
        return ANSWER_REFUSED;
    }
    return ANSWER_OK;
}

typedef struct {
    char mark[8];
    uint64_t owner, checksum;
    int64_t count;
} Head;

int64_t instance_state_size(const Instance *x) { return (int64_t)sizeof(Head) + x->number_count * (int64_t)sizeof(double); }

void instance_save(const Instance *x, void *block) {
    Head head;
    memcpy(head.mark, MARK, sizeof head.mark);
    head.owner = x->owner;
    head.count = x->number_count;
    head.checksum = checksum(x->numbers, x->number_count);
    memcpy(block, &head, sizeof head);
    memcpy((char *)block + sizeof head, x->numbers, (size_t)x->number_count * sizeof(double));
}

/* Whether numbers with a right checksum can be a state at all. */
static int sensible(const Instance *x, const double *numbers) {
    const Program *p = description(x);
    const double *single = numbers + (x->single - x->numbers);
    for (int64_t i = 0; i < p->variables; i++) {
        if (p->variable_role[i] != ROLE_PARAMETER || p->variable_type[i] == TYPE_REAL) continue;
        char room[TEXT_SIZE / 4];
        const double value = numbers[p->variable_index[i]];
        if (!(value >= 0.0 && value < 1e6) || value != floor(value)) return 0;
        if (p->variable_type[i] == TYPE_BOOLEAN ? value > 1.0 : !*variable_text(x, i, 1 + (int64_t)value, room)) return 0;
    }
    for (int i = S_KNOWN; i <= S_ITERATIONS; i++)
        if (!(single[i] >= 0.0 && single[i] <= 1e15)) return 0;
    for (int i = 0; i < S_COUNT; i++)
        if (!isfinite(single[i])) return 0;
    for (int64_t i = 0; i < 2 * x->modes; i++)
        if (!isfinite(numbers[x->q - x->numbers + i])) return 0;
    for (int64_t i = 0; i < x->loads; i++)
        if (!isfinite(numbers[x->previous - x->numbers + i]) || !isfinite(numbers[x->seen - x->numbers + i])) return 0;
    return single[S_MODES] <= (double)x->modes && single[S_HINT] >= 1.0 && single[S_STATUS] <= STATE_PASSED &&
           isfinite(single[S_LAST_STEP]) && single[S_LAST_STEP] >= 0.0;
}

const char *instance_restore(Instance *x, const void *block, int64_t size) {
    Head head;
    if (size < (int64_t)sizeof head) return "the FMU state is none of flexfmu's";
    memcpy(&head, block, sizeof head);
    if (memcmp(head.mark, MARK, sizeof head.mark) != 0) return "the FMU state is none of flexfmu's";
    if (head.owner != x->owner) return "the FMU state is of another FMU: states go between instances of the same FMU only";
    if (head.count != x->number_count || size != instance_state_size(x)) return "the FMU state is damaged: its size is wrong";
    memcpy(x->kept, (const char *)block + sizeof head, (size_t)x->number_count * sizeof(double));
    if (head.checksum != checksum(x->kept, x->number_count) || !sensible(x, x->kept)) return "the FMU state is damaged";
    /* Before a run a tunable parameter is looked at when the body is chosen, in a run by each step. */
    const int running = x->kept[x->single - x->numbers + S_RUNNING] != 0.0;
    int same = running || !runs(x);
    for (int64_t i = 0; i < x->parameters; i++)
        same &= (running && parameter_is_tunable(i)) || x->kept[i] == x->parameter[i];
    memcpy(x->numbers, x->kept, (size_t)x->number_count * sizeof(double));
    if (!same) {
        if (x->body != x->described) body_close(x->body);
        x->body = 0;
    }
    x->cached = 0;
    return 0;
}
