#include "doubts.h"

#include <math.h>

/* Energy created or taken by the coupling, of the most that the springs held, beyond which a run is warned of. */
static const double SHARE = 0.1;
/* Of the work of all loads: less is round-off. */
static const double NOTHING = 1e-6;
/* Of the most that the springs held: when they have given back so much, the motion has turned once. */
static const double TURNED = 0.5;
/* Growth of the springs' energy since the warning, tenfold motion, at which a run is stopped. */
static const double RUNAWAY = 100.0;
/* Growth of the springs' energy a step that nothing but a coupling that diverges has for several steps in a row. */
static const double DIVERGING = 4.0;
/* Steps in a row that must agree, and of such growth. */
enum { STEPS = 5, IN_A_ROW = 6 };
/* Phase, rad, by which the motion may lag: an error of some 8 % of it, rms, until then. */
static const double PHASE = 0.2;
/* Steps before anything is said: what a start makes jump has to be small against what follows. */
enum { FEWEST = 24 };

int feeds(const EnergyCount *count) {
    const double small = fmax(SHARE * count->stored, NOTHING * count->exchanged);
    /* What is no number any more has grown, too. */
    return !(count->created <= small) ? 1 : count->created < -small ? -1 : 0;
}

void begin_growth(Growth *growth) { *growth = (Growth){0, {0, 0}, 0, {-1.0, -1.0}, 0.0}; }

int look_at_growth(Growth *g, const EnergyCount *count, Notice *notices, int *runaway) {
    const int found = feeds(count), grew = found > 0;
    int said = 0;
    g->turned |= count->now < TURNED * count->stored;
    g->diverging = grew && g->last > 0.0 && count->now > DIVERGING * g->last ? g->diverging + 1 : 0;
    g->last = count->now;
    for (int kind = 0; kind < 2; kind++) {
        g->row[kind] = found == (kind ? -1 : 1) && g->turned ? g->row[kind] + 1 : 0;
        if (g->row[kind] < STEPS || g->warned[kind] >= 0.0) continue;
        g->warned[kind] = count->stored;
        notices[said++] = (Notice){FED + kind, 0, 0, {count->created, count->stored}};
    }
    const int beyond = g->warned[0] >= 0.0 && count->stored > RUNAWAY * g->warned[0];
    *runaway = (grew && beyond) || g->diverging >= IN_A_ROW || !(count->stored < INFINITY);
    return said;
}

void take_resolution(Arena *arena, const Wiring *w, Resolution *r) {
    double **const sixes[] = {&r->now, &r->last, &r->earlier, &r->sum};
    double **const pairs[] = {&r->square, &r->sharp, &r->moved, &r->largest};
    for (int i = 0; i < 4; i++) *sixes[i] = take(arena, 6 * w->joints.ends);
    for (int i = 0; i < 4; i++) *pairs[i] = take(arena, 2 * w->joints.ends);
    r->count = r->said = 0;
}

/* Add a step to the sums of a displacement or rotation (3); its part about the mean, and the largest so far. */
static void add_up(Resolution *r, int64_t place) {
    double mean_square = 0.0, off = 0.0;
    for (int64_t i = 3 * place; i < 3 * place + 3; i++) {
        const double turn = r->now[i] - 2.0 * r->last[i] + r->earlier[i];
        r->sum[i] += r->now[i];
        r->square[place] += r->now[i] * r->now[i];
        if (r->count > 2) r->sharp[place] += turn * turn;
        /* About its mean: where the body hangs still under a load says nothing of how it vibrates. */
        const double mean = r->sum[i] / (double)r->count;
        mean_square += mean * mean;
        off += (r->now[i] - mean) * (r->now[i] - mean);
        r->earlier[i] = r->last[i];
        r->last[i] = r->now[i];
    }
    r->moved[place] = r->square[place] - (double)r->count * mean_square;
    if (r->count >= FEWEST) r->largest[place] = fmax(r->largest[place], off);
}

int look_at_resolution(Resolution *r, const Wiring *w, const double *signals, Notice *notice) {
    const int64_t ends = w->joints.ends;
    double moved[2] = {0.0, 0.0}, largest[2] = {0.0, 0.0}, worst = 0.0;
    if (r->said || !w->joints.count) return 0;
    r->count++;
    for (int64_t place = 0; place < 2 * ends; place++) {
        for (int64_t i = 3 * place; i < 3 * place + 3; i++) r->now[i] = w->end_motion[i] < 0 ? 0.0 : signals[w->end_motion[i]];
        add_up(r, place);
        moved[place % 2] = fmax(moved[place % 2], r->moved[place]);
        largest[place % 2] = fmax(largest[place % 2], r->largest[place]);
    }
    for (int64_t place = 0; place < 2 * ends && r->count >= FEWEST; place++) {
        /* Next to the end that moves farthest what others do is no matter. */
        const double most = moved[place % 2], angle = most > 0.0 ? sqrt(sqrt(r->sharp[place] / most)) : 0.0;
        /* Steps at full amplitude: what has died away lags no more. */
        const double full = largest[place % 2] > 0.0 ? fmin(2.0 * most / largest[place % 2], (double)r->count) : 0.0;
        const double phase = full * angle * angle * angle / 12.0;
        if (phase <= worst) continue;
        worst = phase;
        *notice = (Notice){COARSE, 0, place / 2, {2.0 * 3.14159265358979323846 / angle, phase}};
    }
    return r->said = worst > PHASE;
}
