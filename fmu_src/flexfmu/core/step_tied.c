#include "step_tied.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "forces.h"
#include "learning.h"
#include "ties.h"

/* Change of q over a round relative to q and to the way of a step. */
static const double TOLERANCE = 1e-11;
/* A round that leaves more than this of the change before it has the ties pull anew in its own middle. */
static const double FAST = 0.1;
/* Rounds in which the ties alone answer; then the whole tangent does, from the step's first guess on. */
enum { TIES_ALONE = 12 };
typedef struct {
    Step step;
    Pull pull;
    double *free, *force, *bare, *mean, *speed, *off, *change, *held, *lost, *first;
    double *linear, *end_linear; /* H q at both ends */
    double *tense, *start_tense; /* (T, 4, 3) */
    double *foreseen, *matrix;   /* mean tension as the last round foresees it; (m, m) */
    TangentRoom tangents;
    Foreseen ends;
    Learning learning;
    int64_t resolved;            /* modes */
    double noise;                /* round-off of the springs' strain, as a change of q */
    double quiet;                /* root of the energy that is round-off of that strain and of the rates that follow from it */
    double borne;                /* twice the energy that the straight body would hold at rest under the loads */
    double start_energy, load_work, start_work, reach, speed_before, change_before;
    int stale, rough, whole;     /* whether the ties have to pull anew; the membrane's force is of first order; the whole tangent answers */
} Tied;

static void take_tied(const Body *body, Arena *arena, Tied *x) {
    double **each[] = {&x->free, &x->force, &x->bare, &x->mean, &x->speed, &x->off, &x->change, &x->held, &x->lost, &x->first,
                       &x->linear, &x->end_linear};
    take_step(body, arena, &x->step);
    take_pull(body, arena, &x->pull);
    for (size_t i = 0; i < sizeof each / sizeof *each; i++) *each[i] = take(arena, body->p->modes);
    x->tense = take(arena, 12 * body->p->ties);
    x->start_tense = take(arena, 12 * body->p->ties);
    x->foreseen = take(arena, 12 * body->p->ties);
    x->matrix = take(arena, body->p->modes * body->p->modes);
    take_tangent_room(body, arena, &x->tangents);
    take_foreseen(body, arena, &x->ends);
    take_learning(body->p->modes, TIES_ALONE, arena, &x->learning);
}

/* Square of the way, mass being its measure, of vibrations that the step does not resolve, for an acceleration and rates at
 * its start. With K the stiffness, an acceleration a is that of a vibration about K^-1 a, rates v go as far as K^-1/2 v;
 * (D + K)^-1 takes out what is slow, D being 4/h^2. */
static double ringing(const Body *body, const Rule *rule, Pull *pull, const double *acceleration, const double *rates,
                      double *x, double *answer) {
    const int64_t m = body->p->modes;
    double square = 0.0;
    for (int moving = 0; moving < 2; moving++) {
        const double *start = moving ? rates : acceleration;
        for (int64_t j = 0; j < m; j++) x[j] = 0.5 * rule->gq[j] * start[j];
        respond(body, rule, pull, x, 0, answer);
        for (int64_t j = 0; j < m; j++) {
            if (rule->ramp[j] != 0.0) continue;
            const double slow = (2.0 / rule->gq[j] - body->opened->stiffness[j]) * answer[j];
            square += answer[j] * (moving ? start[j] - slow : answer[j]);
        }
    }
    return square;
}

/* Twice the energy at an end: strain of the modes and of springs that hold `held`, `linear` being Hq, motion and membrane. */
static double energy_of(const Body *body, const double *q, double held, const double *linear, const double *v,
                        const Stretch *stretch) {
    double strain = 2.0 * held;
    for (int64_t j = 0; j < body->p->modes; j++) strain += q[j] * (body->opened->stiffness[j] * q[j] - linear[j]);
    return fabs(strain) + dot(v, v, body->p->modes) + 2.0 * stretch_energy(body, stretch);
}

/* Twice the energy that the straight body would hold at rest under the loads. */
static double energy_borne(Tied *x) {
    Step *s = &x->step;
    Body *body = s->body;
    double energy = 0.0;
    memset(x->tense, 0, (size_t)(12 * body->p->ties) * sizeof(double));
    modal_force(body, &s->loads, 1, s->here, x->tense, &s->scratch, x->bare);
    for (int64_t j = 0; j < body->p->modes; j++) energy += x->bare[j] * x->bare[j] / body->opened->stiffness[j];
    return energy;
}

static void enter(Step *s, const double *q, const double *v) {
    Tied *x = (Tied *)s;
    Body *body = s->body;
    const int64_t m = body->p->modes;
    const double fastest = body->p->omega[m - 1];
    x->noise = body->p->tie_noise[0] / fastest;
    x->quiet = x->noise * (fastest + 2.0 / s->all->step);
    x->resolved = 0;
    while (x->resolved < m && s->rule->ramp[x->resolved] != 0.0) x->resolved++;
    enter_state(s, q, v);
    stretch_from(body, q, s->from);
    spread(body, s->all->inputs, &s->loads);
    rows_times(body->p->tie_initial, q, x->linear, m, m);
    x->borne = energy_borne(x);
    x->start_energy = energy_of(body, q, tie_tension(body, s->here, x->tense), x->linear, s->v0, s->from);
}

/* The first guess of a step's end, from which rounds begin. */
static void guess(Tied *x) {
    Step *s = &x->step;
    for (int64_t j = 0; j < s->body->p->modes; j++) s->q1[j] = s->here->q[j] + s->all->step * s->v0[j];
    s->change = x->change_before = HUGE_VAL;
    x->stale = 1;
}

static int begin(Step *s) {
    Tied *x = (Tied *)s;
    Body *body = s->body;
    const int64_t m = body->p->modes;
    const Rule *rule = s->rule;
    const double *q = s->here->q, *v = s->v0;
    if (s->number) stretch_from(body, q, s->from);
    if (x->resolved < m) {
        if (s->all->inputs_end) spread_at(s, (double)s->number);
        modal_force(body, &s->loads, 1, s->here, 0, &s->scratch, x->first);
        for (int64_t j = 0; j < m; j++)
            x->first[j] += x->linear[j] - body->opened->stiffness[j] * q[j] - body->rate[j] * v[j] - dot(body->coupled + j * m, v, m);
        subtract_stretch_force(body, s->from, s->from, x->first);
    }
    if (s->all->inputs_end) spread_at(s, (double)s->number + 0.5);
    x->load_work = force_work(body, &s->loads, s->here);
    x->start_work = x->load_work - tie_tension(body, s->here, x->start_tense);
    x->speed_before = norm(v, m);
    x->reach = work_reach(body, s->loads.force, body->p->nodes) + fabs(x->start_work);
    for (int64_t j = 0; j < m; j++) x->free[j] = rule->p11[j] * q[j] + rule->p12[j] * v[j];
    guess(x);
    x->whole = 0;
    return 1;
}

/* Configurations at the end and in the middle for the q there. */
static void configure_end(Step *s) {
    Body *body = s->body;
    configure_linear(body, body->need, s->q1, s->there);
    configure_places(body, body->need, s->there);
    configure_halfway(body, body->need, s->here, s->there, &s->middle);
}

/* Tension of the ties, the mean of both ends': places half way between strain stiff ties by what turns, by which they would
 * ring. Their energy at the end is returned, and how far its round-off reaches. */
static double mean_tension(Tied *x, double *reach) {
    const Step *s = &x->step;
    const int64_t numbers = 12 * s->body->p->ties;
    const double held = tie_tension(s->body, s->there, x->tense);
    *reach = work_reach(s->body, x->tense, numbers / 3);
    for (int64_t i = 0; i < numbers; i++) x->tense[i] = 0.5 * (x->tense[i] + x->start_tense[i]);
    return held;
}

static int residual(Step *s) {
    Tied *x = (Tied *)s;
    Body *body = s->body;
    const int64_t m = body->p->modes;
    const double *conservative = x->force;
    double reach;
    configure_end(s);
    const double held = mean_tension(x, &reach);
    if (x->stale && !x->whole && !pull_at(body, s->rule, &s->middle, s->there, body->pivot, &x->pull)) return 0;
    for (int64_t j = 0; j < m; j++) s->way[j] = s->q1[j] - s->here->q[j];
    modal_force(body, &s->loads, 1, &s->middle, x->tense, &s->scratch, x->force);
    const double square = dot(s->way, s->way, m);
    if (has_potential(body)) {
        const double end_work = force_work(body, &s->loads, s->there) - held;
        if (s->loads.has_moments) {
            modal_force(body, &s->loads, 0, &s->middle, x->tense, &s->scratch, x->bare);
            conservative = x->bare;
        }
        /* The springs' strain is a difference of places. */
        close_bracket(s, end_work - x->start_work - dot(conservative, s->way, m), x->reach + fabs(end_work) + reach, square);
    }
    /* What the mean holds beside Hq at the start and what is linear in the way, of which `respond` knows. */
    for (int64_t j = 0; j < m; j++) x->mean[j] = x->force[j] + s->factor * s->way[j];
    x->rough = !stretch_towards(body, s->from, s->q1, s->round == 1, s->to);
    subtract_stretch_force(body, s->from, s->to, x->mean);
    return 1;
}

/* The change of q by the whole tangent: what is strained is the end, what pulls is the middle. Tension of stiff ties is far off
 * until the rounds settle, so what turns feels that which the last round foresaw. */
static int answer_whole(Tied *x) {
    Step *s = &x->step;
    Body *body = s->body;
    const Program *p = body->p;
    const int64_t m = p->modes;
    double *tangent = x->matrix, *gaps = x->ends.gaps;
    const double cost = (double)(m * m) * ((double)m / 3.0 + 24.0 * (double)p->ties + 30.0 * (double)p->nodes);
    /* It takes as long as many rounds of ties alone. */
    s->all->rounds += (int64_t)(cost / round_cost(p));
    tangent_stiffness(body, &s->loads, 1, &s->middle, x->foreseen, &x->tangents, tangent);
    jacobians_at(body, s->there, &x->ends.of);
    gap_derivative(body, s->there, &x->ends.of, gaps);
    for (int64_t i = 0; i < 12 * p->ties; i++) {
        double *row = x->tangents.row, *middle = x->tangents.gaps + i * m;
        for (int64_t j = 0; j < m; j++) row[j] = p->tie_stiffness[3 * (i / 12) + i % 3] * (gaps[i * m + j] - middle[j]);
        add_transposed_product(middle, row, tangent, 1, m, m);
    }
    for (int64_t i = 0; i < m; i++) {
        const double gain = s->rule->gq[i];
        tangent[i * m + i] -= body->opened->stiffness[i];
        x->change[i] = x->off[i] + s->way[i];
        for (int64_t j = 0; j < m; j++) {
            const double lost = body->coupled[i * m + j] / s->all->step;
            x->change[i] += gain * (lost - 0.5 * p->tie_initial[i * m + j]) * s->way[j];
            tangent[i * m + j] = gain * (0.5 * tangent[i * m + j] + lost) + (i == j ? 1.0 : 0.0);
        }
    }
    if (!lu_factor(tangent, body->pivot, m, 0)) return 0;
    lu_solve(tangent, body->pivot, x->change, m, 1, 0);
    for (int64_t i = 0; i < 12 * p->ties; i++)
        x->foreseen[i] = x->tense[i] - 0.5 * p->tie_stiffness[3 * (i / 12) + i % 3] * dot(gaps + i * m, x->change, m);
    return 1;
}

static Progress correct(Step *s) {
    Tied *x = (Tied *)s;
    Body *body = s->body;
    const int64_t m = body->p->modes;
    const double *gq = s->rule->gq;
    double blurred = 0.0;
    for (int64_t j = 0; j < m; j++) {
        x->off[j] = s->here->q[j] - x->free[j] - gq[j] * (x->mean[j] + x->linear[j]);
        blurred += gq[j] * s->way[j] * gq[j] * s->way[j];
    }
    if (!x->whole)
        respond(body, s->rule, &x->pull, x->off, s->way, x->change);
    else if (!answer_whole(x))
        return LOST;
    const double size = norm(x->change, m), last = s->change;
    if (!x->whole) learn(&x->learning, body->opened->stiffness, s->q1, x->stale ? 1 : s->round, x->change);
    for (int64_t j = 0; j < m; j++) s->q1[j] -= x->change[j];
    const double enough = TOLERANCE * (norm(s->q1, m) + s->all->step * x->speed_before);
    if (size <= fmax(fmax(enough, x->noise), s->blur * sqrt(blurred)) && !x->rough) return SETTLED;
    if (!x->whole && !(size <= 0.5 * x->change_before && s->round < TIES_ALONE)) {
        guess(x);
        memcpy(x->foreseen, x->start_tense, (size_t)(12 * body->p->ties) * sizeof(double));
        x->whole = 1;
        s->round = 0;
        return GOING_ON;
    }
    if (!(size <= 0.5 * fmax(x->change_before, last))) return LOST;
    x->stale = size > FAST * last;
    x->change_before = last;
    s->change = size;
    return GOING_ON;
}

/* Square of the leading error: what the force's change over the step makes of the modes that it resolves. */
static double force_error(Tied *x) {
    Step *s = &x->step;
    Body *body = s->body;
    const int64_t m = body->p->modes;
    const Rule *rule = s->rule;
    double error = 0.0;
    /* Stiff springs that vibrate faster than the step can tell are strained by it at its ends as they never are in truth: their
     * tension is taken as the mean, and how it changes from how the body gives way. */
    double reach;
    mean_tension(x, &reach);
    modal_force(body, &s->loads, 1, s->there, x->tense, &s->scratch, x->force);
    modal_force(body, &s->loads, 1, s->here, x->tense, &s->scratch, x->bare);
    subtract_stretch_force(body, s->to, s->to, x->force);
    subtract_stretch_force(body, s->from, s->from, x->bare);
    for (int64_t j = 0; j < m; j++) {
        x->speed[j] = body->opened->stiffness[j] * s->way[j];
        x->off[j] = rule->gq[j] * (x->force[j] - x->bare[j] + x->end_linear[j] - x->linear[j] - x->speed[j]);
    }
    respond(body, rule, &x->pull, x->off, 0, x->change);
    for (int64_t j = 0; j < m; j++) {
        /* A mode of the straight body that the turned one only follows, at hardly any acceleration of its own, asks for no
         * shorter step, however its force changes. */
        const double moved = rule->lag[j] * x->change[j], followed = moved + rule->ramp[j] * x->speed[j];
        const double missed = body->p->omega[j] * fmin(fabs(moved), fabs(followed));
        error += missed * missed;
    }
    return error;
}

/* Work of the loads: of forces by their potential, of moments by their value in the middle. */
static double work_of_loads(Tied *x) {
    Step *s = &x->step;
    Body *body = s->body;
    const int potential = has_potential(body);
    double work = potential ? force_work(body, &s->loads, s->there) - x->load_work : 0.0;
    memset(x->tense, 0, (size_t)(12 * body->p->ties) * sizeof(double));
    if (!potential || s->loads.has_moments) {
        modal_force(body, &s->loads, 1, &s->middle, x->tense, &s->scratch, x->force);
        work += dot(x->force, s->way, body->p->modes);
    }
    if (potential && s->loads.has_moments) {
        modal_force(body, &s->loads, 0, &s->middle, x->tense, &s->scratch, x->force);
        work -= dot(x->force, s->way, body->p->modes);
    }
    return work;
}

static int accept(Step *s, double *found) {
    Tied *x = (Tied *)s;
    Body *body = s->body;
    const int64_t m = body->p->modes;
    const Rule *rule = s->rule;
    const double *q = s->here->q, quiet = x->quiet;
    if (x->whole && !pull_at(body, rule, &s->middle, s->there, body->pivot, &x->pull)) return 0;
    for (int64_t j = 0; j < m; j++) x->speed[j] = s->way[j] / s->all->step;
    rows_times(body->p->tie_initial, s->middle.q, x->held, m, m);
    rows_times(body->coupled, x->speed, x->lost, m, m);
    for (int64_t j = 0; j < m; j++) x->mean[j] += x->held[j] - x->lost[j];
    configure_end(s);
    stretch_towards(body, s->from, s->q1, 0, s->to);
    const double lost_way = x->resolved < m ? ringing(body, rule, &x->pull, x->first, s->v0, x->off, x->change) : 0.0;
    for (int64_t j = 0; j < m; j++) {
        s->way[j] = s->q1[j] - q[j];
        s->v0[j] = rule->p21[j] * q[j] + rule->p22[j] * s->v0[j] + rule->gv[j] * x->mean[j];
    }
    rows_times(body->p->tie_initial, s->q1, x->end_linear, m, m);
    double error = force_error(x);
    const double work = work_of_loads(x);
    /* Energy that neither was there at the start nor came from the loads is error as well, and what blows up may not be
     * measured by itself. */
    const double energy = energy_of(body, s->q1, tie_tension(body, s->there, x->tense), x->end_linear, s->v0, s->to);
    const double bound = x->start_energy + 2.0 * fabs(work) + quiet * quiet + 2.0 * ROUND_OFF * (x->reach + energy);
    error = sqrt(error) + (!(energy <= bound) ? sqrt(energy) - sqrt(bound) : 0.0);
    /* Of a body that a load has just begun to move, the motion to come is the measure. */
    const double whole = fmax(x->borne, fmin(energy, bound));
    error = !(error <= quiet) ? error / sqrt(whole) : 0.0;
    /* The phase of what the step does not resolve is lost: it may be anywhere on its way. */
    const double slowest = body->p->omega[0], lost = slowest * slowest * lost_way;
    const double blind = lost > quiet * quiet ? sqrt(lost / fmax(x->start_energy, whole)) : 0.0;
    *found = !(blind <= error) ? blind : error;
    x->start_energy = energy;
    return 1;
}

static void pass(Step *s) {
    Tied *x = (Tied *)s;
    double *kept = x->linear;
    x->linear = x->end_linear;
    x->end_linear = kept;
    pass_on(s);
}

void tied_demand(const Body *body, Arena *arena) {
    Tied x;
    take_tied(body, arena, &x);
}

int tied_steps(Body *body, Substeps *all, double *q, double *v) {
    static const Stepper stepper = {enter, begin, residual, correct, accept, pass, leave_state};
    Arena arena = work_arena(body);
    Tied x;
    take_tied(body, &arena, &x);
    if (arena.refused) return NO_ROOM;
    return internal_steps(&stepper, &x.step, body, all, q, v);
}
