#include "step_free.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "free_body.h"
#include "learning.h"

static const double TOLERANCE = 1e-12;
/* Turn of the root frame in one internal step, rad, beyond which it is divided. */
static const double LONGEST_TURN = 1.0;
/* Change of that turn which is round-off. */
static const double SAME_TURN = 2e-16;
enum { MOST_TURNS = 60 };

typedef struct {
    Step step;
    Turning room;
    End ends[2], *start, *end;
    Learning learning;
    double *before, *after; /* accelerations (t + e) at both ends */
    double *momentum, *reached, *half, *z, *shift; /* (t + e), the last (3, t + e) */
    double *by_momentum;                           /* (t + e, 1 + t): rates at the end without and per unit of turning momentum */
    double *free_q, *free_v, *mean_force, *off, *sizes, *push, *bare; /* (e) */
    double *gradient;                                                 /* (m) */
    const double *inputs;
    double whole_mass;
    double turning[3], spin[3], moment[3]; /* in the root's axes */
    double total[3], followed[3], growth[3];
    double mean[9], inverse[9], middle[9];
} Free;

static void take_free(const Body *body, Arena *arena, Free *x) {
    const int64_t m = body->p->modes, e = m - body->p->rigid, n = coordinates(body->p);
    double **of_all[] = {&x->before, &x->after, &x->momentum, &x->reached, &x->half, &x->z};
    double **of_elastic[] = {&x->free_q, &x->free_v, &x->mean_force, &x->off, &x->sizes, &x->push, &x->bare};
    take_step(body, arena, &x->step);
    take_turning(body, arena, &x->room);
    take_learning(e, MOST_ROUNDS, arena, &x->learning);
    for (int i = 0; i < 2; i++) take_end(body, arena, &x->ends[i]);
    for (size_t i = 0; i < sizeof of_all / sizeof *of_all; i++) *of_all[i] = take(arena, n);
    for (size_t i = 0; i < sizeof of_elastic / sizeof *of_elastic; i++) *of_elastic[i] = take(arena, e);
    x->gradient = take(arena, m);
    x->shift = take(arena, 3 * n);
    x->by_momentum = take(arena, n * (1 + body->p->turn_axes));
}

static void enter(Step *s, const double *q, const double *v) {
    Free *x = (Free *)s;
    const Program *p = s->body->p;
    const int64_t r = p->rigid;
    const double *gq = s->rule->gq + r, *gv = s->rule->gv + r;
    x->whole_mass = total_mass(p);
    x->start = &x->ends[0];
    x->end = &x->ends[1];
    x->start->at = s->here;
    x->end->at = s->there;
    x->room.loads = &s->loads;
    x->room.scratch = &s->scratch;
    enter_end(s->body, q, v, x->start, &x->room);
    stretch_at(s->body, s->here->q, s->from);
    for (int64_t j = 0; j < p->modes - r; j++) {
        const double reached = p->weight[r + j] * gq[j];
        x->sizes[j] = reached * reached + gv[j] * gv[j];
    }
    memset(s->q1, 0, (size_t)r * sizeof(double));
    memset(x->gradient, 0, (size_t)p->modes * sizeof(double));
}

/* What loads that grow over a step do beyond their mean, on the undeformed body; and that mean. */
static void grow(Free *x) {
    Step *s = &x->step;
    const Program *p = s->body->p;
    const Substeps *all = s->all;
    const Rule *rule = s->rule;
    const int64_t r = p->rigid;
    double *between = s->between;
    for (int64_t i = 0; i < p->loads; i++) between[i] = (all->inputs_end[i] - all->inputs[i]) / (double)all->count;
    total_force(p, between, x->growth);
    spread_turned(s->body, between, x->start->rotation, x->start->rotation, &x->room);
    for (int64_t j = 0; j < p->modes - r; j++) {
        x->free_q[j] += rule->ramp[r + j] * s->loads.constant[r + j];
        x->free_v[j] += rule->ramp_rate[r + j] * s->loads.constant[r + j];
    }
    const double share = ((double)s->number + 0.5) / (double)all->count;
    for (int64_t i = 0; i < p->loads; i++) between[i] = all->inputs[i] + share * (all->inputs_end[i] - all->inputs[i]);
}

static int begin(Step *s) {
    Free *x = (Free *)s;
    const Program *p = s->body->p;
    const Rule *rule = s->rule;
    const int64_t r = p->rigid, t = p->turn_axes, e = p->modes - r, n = t + e;
    const double h = s->all->step, *gq = rule->gq + r, *gv = rule->gv + r;
    End *start = x->start, *end = x->end;
    memset(x->growth, 0, sizeof x->growth);
    for (int64_t j = 0; j < e; j++) {
        const double at = start->at->q[r + j], rate = start->z[t + j];
        x->free_q[j] = rule->p11[r + j] * at + rule->p12[r + j] * rate;
        x->free_v[j] = rule->p21[r + j] * at + rule->p22[r + j] * rate;
    }
    if (s->all->inputs_end) grow(x);
    x->inputs = s->all->inputs_end ? s->between : s->all->inputs;
    x->room.stretch = s->to;
    if (s->all->inputs_end || s->number == 0) accelerations(s->body, x->inputs, start, &x->room, x->before);
    momentum_of(p, &start->mass, start->z, 1, x->momentum);
    along_axes(p, x->momentum, x->turning);
    for (int64_t a = 0; a < t; a++) end->z[a] = start->z[a] + h * x->before[a];
    for (int64_t j = 0; j < e; j++) {
        x->mean_force[j] = x->before[t + j];
        s->q1[r + j] = x->free_q[j] + gq[j] * x->before[t + j];
        end->z[t + j] = x->free_v[j] + gv[j] * x->before[t + j];
    }
    for (int64_t i = 0; i < n; i++) x->half[i] = 0.5 * (start->z[i] + end->z[i]);
    along_axes(p, x->half, x->spin);
    if (!p->inertial) end->mass = start->mass;
    return norm(x->spin, 3) * h <= LONGEST_TURN;
}

/* Work of the loads of fixed direction between both ends, without that on the centre of mass; forces and moments on the whole,
 * and on elastic coordinates. `reach`: what the round-off of places can make of the work. */
static double loads_between(Free *x, double stretch, double *reach) {
    Step *s = &x->step;
    const Program *p = s->body->p;
    const Loads *loads = &s->loads;
    const End *start = x->start, *end = x->end;
    double work = 0.0, lever[3], about[3], centre[3], everything[3];
    spread_turned(s->body, x->inputs, x->mean, x->inverse, &x->room);
    *reach = work_reach(s->body, loads->force, p->nodes);
    sum_loads(p, loads->force, x->total);
    sum_loads(p, loads->moment, x->moment);
    for (int64_t k = 0; k < p->nodes; k++) {
        const double *force = loads->force + 3 * k;
        for (int i = 0; i < 3; i++) {
            const double from = start->at->position[3 * k + i], to = end->at->position[3 * k + i];
            lever[i] = 0.5 * (from + to - start->mass.centre[i] - end->mass.centre[i]) - p->point[i];
            work += force[i] * (to - from);
        }
        cross(lever, force, about);
        for (int i = 0; i < 3; i++) x->moment[i] += stretch * about[i];
    }
    for (int i = 0; i < 3; i++) {
        work -= x->total[i] * (end->mass.centre[i] - start->mass.centre[i]);
        centre[i] = 0.5 * (start->mass.centre[i] + end->mass.centre[i]);
        x->followed[i] = 0.0;
    }
    push_of_followers(s->body, loads, &s->middle, centre, &x->room, x->followed, x->moment);
    for (int i = 0; i < 3; i++) everything[i] = x->total[i] + x->followed[i];
    for (int64_t i = 0; i < 3 * coordinates(p); i++) x->shift[i] = 0.5 * (start->mass.shift[i] + end->mass.shift[i]);
    elastic_force(s->body, loads, 1, &s->middle, x->shift, everything, &x->room, x->push);
    if (loads->has_moments) elastic_force(s->body, loads, 0, &s->middle, x->shift, x->total, &x->room, x->bare);
    return work;
}

/* What the deformed body's mass adds to the bracket of (15), by differences of the mass, in which what turns as a whole has
 * cancelled. */
static void add_inertia(Free *x, double *bracket, double *reach) {
    Step *s = &x->step;
    const Program *p = s->body->p;
    const int64_t t = p->turn_axes, e = p->modes - p->rigid, n = t + e;
    const End *start = x->start, *end = x->end;
    double slip[3], *half = x->half;
    for (int64_t i = 0; i < n; i++) half[i] = 0.5 * (start->z[i] + end->z[i]);
    for (int i = 0; i < 3; i++) slip[i] = -dot(x->shift + i * n, half, n);
    modal_rates(p, half, slip, x->room.rates);
    kinetic_gradient(s->body, &s->middle, x->room.rates, &x->room.flow, x->gradient);
    momentum_of(p, &end->mass, end->z, 1, x->reached);
    momentum_of(p, &start->mass, end->z, 1, x->z);
    const double gained = dot(start->z, x->reached, n), had = dot(start->z, x->z, n);
    *bracket += 0.5 * (gained - had) - dot(x->gradient + p->rigid, s->way, e);
    *reach += fabs(gained) + fabs(had);
    for (int64_t j = 0; j < e; j++)
        *bracket += (x->reached[t + j] - x->momentum[t + j]) * (s->way[j] / s->all->step - half[t + j]);
}

static int residual(Step *s) {
    Free *x = (Free *)s;
    Body *body = s->body;
    const Program *p = body->p;
    const int64_t r = p->rigid, t = p->turn_axes, e = p->modes - r, n = t + e, solved = p->inertial ? n : t;
    const double h = s->all->step, *gv = s->rule->gv + r;
    End *start = x->start, *end = x->end;
    const double stretch = mean_rotation(start->rotation, x->spin, h, end->rotation, x->mean, x->inverse, x->middle);
    configure(body, s->q1, end->at);
    configure_halfway(body, 0, start->at, end->at, &s->middle);
    if (p->inertial) inertia_at(body, end->at, &x->room, &end->mass);
    double reach, bracket = loads_between(x, stretch, &reach);
    for (int64_t j = 0; j < e; j++) s->way[j] = s->q1[r + j] - start->at->q[r + j];
    bracket -= dot(s->loads.has_moments ? x->bare : x->push, s->way, e);
    if (p->inertial) add_inertia(x, &bracket, &reach);
    close_bracket(s, bracket, reach, dot(s->way, s->way, e));
    for (int64_t j = 0; j < e; j++) x->push[j] += x->gradient[r + j] + s->factor * s->way[j];
    stretch_at(body, s->q1, s->to);
    resist(body, s->from, s->to, &x->room, x->push);
    /* Spin and elastic rates at the end from the momenta there. */
    for (int64_t i = 0; i < solved; i++)
        for (int64_t j = 0; j < solved; j++) {
            const double one = i == j ? 1.0 : 0.0, of = end->mass.whole[i * n + j];
            x->room.matrix[i * solved + j] = i < t ? of : one + gv[i - t] / h * (of - one);
        }
    return lu_factor(x->room.matrix, body->pivot, solved, 0);
}

/* Spin and rates z at the end from the momenta there, in turns, since these hang on the rotation; 0 where it turns too far. */
static int turn(Free *x) {
    Step *s = &x->step;
    const Program *p = s->body->p;
    const int64_t r = p->rigid, t = p->turn_axes, e = p->modes - r, solved = p->inertial ? t + e : t;
    const double h = s->all->step, *gv = s->rule->gv + r;
    End *start = x->start, *end = x->end;
    double off = HUGE_VAL, momentum[3] = {0}, *by = x->by_momentum;
    memset(by, 0, (size_t)((t + e) * (1 + t)) * sizeof(double));
    for (int64_t a = 0; a < t; a++) by[a * (1 + t) + 1 + a] = 1.0;
    for (int64_t j = 0; j < e; j++) by[(t + j) * (1 + t)] = x->free_v[j] + gv[j] * (x->push[j] + x->momentum[t + j] / h);
    lu_solve(x->room.matrix, s->body->pivot, by, solved, 1 + t, 0);
    for (int number = 0; number < MOST_TURNS && off > SAME_TURN; number++) {
        double now[3];
        if (number) mean_rotation(start->rotation, x->spin, h, end->rotation, x->mean, x->inverse, x->middle);
        end_momentum(p, end->rotation, start->rotation, x->mean, x->turning, x->moment, h, momentum);
        for (int64_t i = 0; i < t; i++) x->z[i] = by[i * (1 + t)] + dot(by + i * (1 + t) + 1, momentum, t);
        for (int64_t a = 0; a < t; a++) x->half[a] = 0.5 * (start->z[a] + x->z[a]);
        along_axes(p, x->half, now);
        off = 0.0;
        for (int i = 0; i < 3; i++) {
            off = fmax(off, h * fabs(now[i] - x->spin[i]));
            x->spin[i] = now[i];
        }
        if (!(norm(x->spin, 3) * h <= LONGEST_TURN)) return 0;
        if (t == 1) break;
    }
    for (int64_t j = 0; j < e; j++) {
        const double *row = by + (t + j) * (1 + t);
        x->z[t + j] = row[0] + dot(row + 1, momentum, t);
    }
    return 1;
}

static Progress correct(Step *s) {
    Free *x = (Free *)s;
    const Program *p = s->body->p;
    const int64_t r = p->rigid, t = p->turn_axes, e = p->modes - r, n = t + e;
    const double h = s->all->step, *gq = s->rule->gq + r, *gv = s->rule->gv + r;
    End *end = x->end;
    double *off = x->off, *z = x->z, turn_by[3] = {0}, moved = 0.0, sized = 0.0, blurred = 0.0;
    if (!turn(x)) return LOST;
    momentum_of(p, &end->mass, z, 1, x->reached);
    for (int64_t j = 0; j < e; j++) off[j] = x->mean_force[j] - x->push[j] + (x->reached[t + j] - x->momentum[t + j]) / h;
    const double left = learn(&x->learning, x->sizes, x->mean_force, s->round, off);
    for (int64_t j = 0; j < e; j++) {
        const double blur = s->blur * s->way[j];
        x->mean_force[j] -= off[j];
        s->q1[r + j] = x->free_q[j] + gq[j] * x->mean_force[j];
        const double rate = x->free_v[j] + gv[j] * x->mean_force[j], far = p->weight[r + j] * s->q1[r + j];
        /* What turns with it by the momentum that it leaves. */
        for (int64_t a = 0; p->inertial && a < t; a++) turn_by[a] += end->mass.whole[a * n + t + j] * (z[t + j] - rate);
        end->z[t + j] = rate;
        moved += x->sizes[j] * off[j] * off[j];
        sized += far * far + rate * rate;
        blurred += x->sizes[j] * blur * blur;
    }
    for (int64_t i = 0; i < t; i++) memcpy(x->room.matrix + i * t, end->mass.whole + i * n, (size_t)t * sizeof(double));
    if (!lu_factor(x->room.matrix, s->body->pivot, t, 0)) return LOST;
    lu_solve(x->room.matrix, s->body->pivot, turn_by, t, 1, 0);
    for (int64_t a = 0; a < t; a++) {
        const double unit = end->mass.whole[a * n + a], now = z[a] + turn_by[a], by = now - end->z[a];
        moved += unit * by * by;
        sized += unit * now * now;
        end->z[a] = now;
    }
    return progress_of(s, fmax(moved, left), sqrt(sized), blurred, TOLERANCE);
}

/* Turn and rates at the end, by momenta that are what they ought to be, whatever is left of the iteration's error. */
static int keep_momenta(Free *x) {
    Step *s = &x->step;
    const Program *p = s->body->p;
    const int64_t t = p->turn_axes, e = p->modes - p->rigid, n = t + e;
    const double h = s->all->step, mass = x->whole_mass;
    End *start = x->start, *end = x->end;
    double everything[3];
    end_momentum(p, end->rotation, start->rotation, x->mean, x->turning, x->moment, h, end->z);
    for (int64_t a = 0; a < t; a++) {
        end->z[a] -= dot(end->mass.whole + a * n + t, end->z + t, e);
        memcpy(x->room.matrix + a * t, end->mass.whole + a * n, (size_t)t * sizeof(double));
    }
    if (!lu_factor(x->room.matrix, s->body->pivot, t, 0)) return 0;
    lu_solve(x->room.matrix, s->body->pivot, end->z, t, 1, 0);
    total_force(p, x->inputs, x->total);
    apply(x->middle, x->followed, everything);
    for (int i = 0; i < 3; i++) {
        const double pushed = p->turn_slides ? h * (x->total[i] + everything[i]) / mass : 0.0;
        end->angle[i] = start->angle[i] + h * x->spin[i];
        end->velocity[i] = start->velocity[i] + pushed;
        end->place[i] = start->place[i] + h * (start->velocity[i] + 0.5 * pushed);
        if (p->turn_slides) end->place[i] -= h * h / 12.0 * x->growth[i] / mass;
    }
    return 1;
}

static int accept(Step *s, double *found) {
    Free *x = (Free *)s;
    const Program *p = s->body->p;
    const int64_t r = p->rigid, t = p->turn_axes, n = coordinates(p), e = n - t;
    const double h = s->all->step, *ramp = s->rule->ramp;
    End *start = x->start, *end = x->end;
    mean_rotation(start->rotation, x->spin, h, end->rotation, x->mean, x->inverse, x->middle);
    configure(s->body, s->q1, end->at);
    if (p->inertial) inertia_at(s->body, end->at, &x->room, &end->mass);
    if (!keep_momenta(x)) return 0;
    for (int64_t a = 0; a < t; a++) s->all->massless |= !(end->mass.whole[a * (n + 1)] > 0.0);
    if (p->inertial && !p->lumped) {
        for (int64_t j = 0; j < e; j++) memcpy(x->room.matrix + j * e, end->mass.whole + (t + j) * n + t, (size_t)e * sizeof(double));
        s->all->massless |= !factor_mass(x->room.matrix, e);
    }
    if (s->all->massless) return 0;
    accelerations(s->body, x->inputs, end, &x->room, x->after);
    double error = 0.0, energy = x->whole_mass * dot(end->velocity, end->velocity, 3);
    for (int64_t i = 0; i < n; i++) {
        const int64_t mode = i < t ? 0 : r + i - t;
        const double unit = i < t ? sqrt(end->mass.whole[i * n + i]) : 1.0, rate = unit * end->z[i];
        const double lost = unit * (i < t ? fmin(p->weight[0], 1.0 / h) : p->weight[mode]) * ramp[mode] * (x->after[i] - x->before[i]);
        const double strained = p->omega[mode] * s->q1[mode];
        error += (i < t ? 1.0 : felt(p->omega[mode] * h)) * lost * lost;
        energy += strained * strained + rate * rate;
    }
    *found = energy > 0.0 ? sqrt(error / energy) : 0.0;
    return 1;
}

static void pass(Step *s) {
    Free *x = (Free *)s;
    double *kept = x->before;
    End *passed = x->start;
    x->before = x->after;
    x->after = kept;
    x->start = x->end;
    x->end = passed;
    pass_on(s);
}

static void leave(Step *s, double *q, double *v) {
    leave_end(s->body, ((Free *)s)->start, q, v);
}

void free_demand(const Body *body, Arena *arena) {
    Free x;
    take_free(body, arena, &x);
}

int free_steps(Body *body, Substeps *all, double *q, double *v) {
    static const Stepper stepper = {enter, begin, residual, correct, accept, pass, leave};
    Arena arena = work_arena(body);
    Free x;
    take_free(body, &arena, &x);
    if (arena.refused) return NO_ROOM;
    return internal_steps(&stepper, &x.step, body, all, q, v);
}
