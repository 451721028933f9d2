#include "exchange.h"

#include <math.h>
#include <string.h>

/* Of a step: on which side of a jump in a table its ends lie does not hang on round-off. */
static const double NEAR = 1e-9;
/* A load held over a step changes the velocity at its end twice as much as the motion suggests. */
static const double RATE_BY_MOTION = 2.0;
/* Multiples of round-off that outputs are trusted to, and the change of any input that never counts. */
static const double ROUND_OFF = 1e3 * 2.220446049250313e-16, NOTHING = 1e-12;

void take_exchange(Arena *arena, const Wiring *w, Exchange *e) {
    const int64_t six = 6 * w->joints.ends, signals = w->signals + 1;
    double **const sixes[] = {&e->motion, &e->before, &e->rates, &e->loads, &e->by_motion};
    for (int i = 0; i < 5; i++) *sixes[i] = take(arena, six);
    e->sizes = take(arena, signals);
    e->tangent = take(arena, six * six);
    e->by_inputs = take(arena, signals * w->inputs);
    e->told = (int64_t *)take(arena, signals * w->inputs);
    e->marks = (int64_t *)take(arena, signals);
    e->kept = (int64_t *)take(arena, w->joints.count);
    e->damped = 0;
    for (int64_t i = 0; i < 6 * w->joints.count; i++) e->damped |= w->joints.damping[i] != 0.0;
}

/* Row of the first time after a moment. */
static int64_t after(const double *times, int64_t rows, double moment) {
    int64_t low = 0, high = rows;
    while (low < high) {
        const int64_t middle = (low + high) / 2;
        if (times[middle] <= moment)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

void base_inputs(const Wiring *w, double time, int before, double *inputs) {
    const double moment = time + (before ? -NEAR : NEAR) * w->step;
    const double *times = w->table_times, *values = w->table_values;
    const int64_t *places = w->table_inputs;
    memcpy(inputs, w->base, (size_t)w->inputs * sizeof *inputs);
    for (int64_t table = 0; table < w->tables; table++) {
        const int64_t rows = w->table_rows[table], columns = w->table_columns[table], row = after(times, rows, moment);
        const int64_t upper = row < rows ? row : rows - 1, lower = row > 0 && row < rows ? row - 1 : upper;
        const double part = upper > lower ? (moment - times[lower]) / (times[upper] - times[lower]) : 0.0;
        for (int64_t k = 0; k < columns; k++) {
            const double begin = values[lower * columns + k];
            inputs[places[k]] = begin + part * (values[upper * columns + k] - begin);
        }
        times += rows;
        values += rows * columns;
        places += columns;
    }
}

/* out (ends, 6): signals of places, zero where there is none. */
static void gather(const Wiring *w, const int64_t *places, const double *signals, double *out) {
    for (int64_t i = 0; i < 6 * w->joints.ends; i++) out[i] = places[i] < 0 ? 0.0 : signals[places[i]];
}

void coupled_inputs(const Wiring *w, Exchange *e, const double *signals, const double *before, Dampers dampers, double *inputs) {
    const int64_t six = 6 * w->joints.ends;
    memset(inputs, 0, (size_t)w->inputs * sizeof *inputs);
    for (int64_t k = 0; k < w->links; k++) inputs[w->link_to[k]] += w->link_factor[k] * signals[w->link_from[k]];
    if (!w->joints.count) return;
    gather(w, w->end_motion, signals, e->motion);
    memset(e->rates, 0, (size_t)six * sizeof *e->rates);
    if (e->damped && dampers != DAMPERS_NONE) {
        gather(w, w->end_motion, before, e->before);
        backward_rates(e->motion, e->before, w->step, e->rates, w->joints.ends);
        for (int64_t i = 0; i < six && dampers == DAMPERS_NOW; i++)
            if (w->end_rates[i] >= 0) e->rates[i] = signals[w->end_rates[i]];
    }
    joint_loads(&w->joints, e->motion, e->rates, e->loads);
    for (int64_t i = 0; i < six; i++)
        if (w->end_loads[i] >= 0) inputs[w->end_loads[i]] += e->loads[i];
}

/* Derivatives (signals + 1, inputs) of the signals by the driven inputs, and which are told; the last signal is none. How many
 * blocks are known; the springs both of whose ends offer their compliance are marked. */
static int64_t signals_by_inputs(const Wiring *w, Exchange *e, const double *blocks) {
    const int64_t n = w->inputs, all = (w->signals + 1) * n;
    const double factors[2] = {1.0, RATE_BY_MOTION / w->step};
    int64_t found = 0;
    memset(e->by_inputs, 0, (size_t)all * sizeof *e->by_inputs);
    memset(e->told, 0, (size_t)all * sizeof *e->told);
    memset(e->by_motion, 0, (size_t)w->joints.ends * sizeof *e->by_motion);
    for (int64_t r = 0; r < w->responses; r++, blocks += 36) {
        const int64_t *places = w->response_places + 18 * r, *loads = places + 12;
        int sound = 1;
        for (int i = 0; i < 36; i++) sound &= isfinite(blocks[i]) != 0;
        if (!sound) continue;
        found++;
        for (int i = 0; i < 12; i++)
            for (int j = 0; j < 6; j++)
                if (places[i] >= 0 && loads[j] >= 0) {
                    e->by_inputs[places[i] * n + loads[j]] = factors[i / 6] * blocks[6 * (i % 6) + j];
                    e->told[places[i] * n + loads[j]] = 1;
                }
        if (w->response_end[r] >= 0) e->by_motion[w->response_end[r]] = 1.0;
    }
    for (int64_t k = 0; k < w->joints.count; k++) {
        const int64_t a = w->joints.a[k], b = w->joints.b[k];
        /* The ground does not give way. */
        e->kept[k] = e->by_motion[a] != 0.0 && (b == w->joints.ends || e->by_motion[b] != 0.0);
    }
    return found;
}

/* Add what the springs marked make of the derivatives; their inputs are known. */
static void add_springs(const Wiring *w, Exchange *e, const double *signals, double share, Dampers dampers, KnownResponse *response) {
    const int64_t six = 6 * w->joints.ends, n = w->inputs;
    gather(w, w->end_motion, signals, e->motion);
    for (int64_t end = 0; end < w->joints.ends; end++) {
        /* The part of the mean motion in what is held is one, whatever that of the springs. */
        const double factor = w->end_rates[6 * end] >= 0 ? RATE_BY_MOTION : 1.0;
        e->by_motion[end] = (dampers == DAMPERS_MEAN ? 1.0 / share : factor) / w->step;
    }
    joint_tangent(&w->joints, e->kept, e->motion, e->by_motion, e->tangent);
    for (int64_t i = 0; i < six; i++) {
        if (w->end_loads[i] < 0) continue;
        double *row = response->slope + w->end_loads[i] * n;
        for (int64_t j = 0; j < six; j++) {
            const double factor = e->tangent[i * six + j];
            const double *derivative = e->by_inputs + w->end_motion[j] * n;
            for (int64_t k = 0; k < n && factor != 0.0 && w->end_motion[j] >= 0; k++) row[k] += factor * derivative[k];
        }
    }
    for (int64_t k = 0; k < w->joints.count; k++)
        for (int side = 0; side < 2 && e->kept[k]; side++) {
            const int64_t end = side ? w->joints.b[k] : w->joints.a[k];
            for (int i = 0; i < 6 && end < w->joints.ends; i++)
                if (w->end_loads[6 * end + i] >= 0) response->known[w->end_loads[6 * end + i]] = 1;
        }
}

/* Whether an input could move a signal: a coupled one of the same FMU. */
static int movable(const Wiring *w, int64_t signal, int64_t input) {
    return w->coupled[input] && w->input_role[input] == w->signal_role[signal];
}

int interface_response(const Wiring *w, Exchange *e, const double *signals, const double *blocks, double share, Dampers dampers,
                       KnownResponse *response) {
    const int64_t n = w->inputs;
    if (!signals_by_inputs(w, e, blocks)) return 0;
    memset(response->slope, 0, (size_t)(n * n) * sizeof *response->slope);
    memset(response->known, 0, (size_t)n * sizeof *response->known);
    for (int64_t k = 0; k < w->links; k++) {
        response->known[w->link_to[k]] = 1;
        for (int64_t i = 0; i < n; i++)
            response->slope[w->link_to[k] * n + i] += w->link_factor[k] * e->by_inputs[w->link_from[k] * n + i];
    }
    /* Signals that no coupled input of their FMU can move are known, too: marked 1 is what moves by nothing that is told,
     * 2 what moves by something that is not. */
    for (int64_t signal = 0; signal < w->signals; signal++) {
        int any = 0, moves = 0, missing = 0;
        for (int64_t i = 0; i < n; i++) {
            const int64_t told = e->told[signal * n + i];
            any |= told != 0;
            moves |= movable(w, signal, i);
            missing |= movable(w, signal, i) && !told;
        }
        e->marks[signal] = (moves && !any ? 1 : 0) | (missing ? 2 : 0);
    }
    response->whole = 1;
    for (int64_t k = 0; k < w->links; k++) {
        const int64_t mark = e->marks[w->link_from[k]];
        if (mark & 1) response->known[w->link_to[k]] = 0;
        if (mark & 2) response->whole = 0;
    }
    for (int64_t i = 0; i < 6 * w->joints.ends; i++)
        if (w->end_motion[i] >= 0 && e->marks[w->end_motion[i]] & 2) response->whole = 0;
    add_springs(w, e, signals, share, dampers, response);
    for (int64_t i = 0; i < n * n; i++) response->slope[i] *= share;
    return 1;
}

void round_off(const Wiring *w, Exchange *e, const double *signals, int nominal, double *out) {
    const int64_t six = 6 * w->joints.ends;
    memset(out, 0, (size_t)w->inputs * sizeof *out);
    for (int64_t i = 0; i < w->signals; i++) e->sizes[i] = nominal ? fmax(fabs(signals[i]), w->nominal[i]) : fabs(signals[i]);
    for (int64_t k = 0; k < w->links; k++) out[w->link_to[k]] += fabs(w->link_factor[k]) * e->sizes[w->link_from[k]];
    if (w->joints.count) {
        gather(w, w->end_motion, signals, e->motion);
        gather(w, w->end_motion, e->sizes, e->rates);
        for (int64_t end = 0; end < w->joints.ends; end++) {
            double largest = 0.0;
            for (int i = 0; i < 6; i++) largest = fmax(largest, e->rates[6 * end + i]);
            for (int i = 0; i < 6; i++) e->rates[6 * end + i] = largest;
            e->by_motion[end] = 2.0 / w->step;
        }
        joint_tangent(&w->joints, 0, e->motion, e->by_motion, e->tangent);
        for (int64_t i = 0; i < six; i++)
            for (int64_t j = 0; j < six && w->end_loads[i] >= 0; j++) out[w->end_loads[i]] += fabs(e->tangent[i * six + j]) * e->rates[j];
    }
    for (int64_t i = 0; i < w->inputs; i++) out[i] = ROUND_OFF * out[i] + NOTHING;
}

void count_energies(const Wiring *w, Exchange *e, const double *signals, const double *before, const double *held, EnergyCount *count) {
    if (!w->joints.count) return;
    gather(w, w->end_motion, signals, e->motion);
    gather(w, w->end_motion, before, e->before);
    backward_rates(e->motion, e->before, w->step, e->rates, w->joints.ends);
    double sum = 0.0, size = 0.0;
    for (int64_t i = 0; i < 6 * w->joints.ends; i++) {
        const double work = w->end_loads[i] < 0 ? 0.0 : held[w->end_loads[i]] * w->step * e->rates[i];
        sum += work;
        size += fabs(work);
    }
    const double stored = joint_energy(&w->joints, e->motion), earlier = joint_energy(&w->joints, e->before);
    const double lost = e->damped ? joint_losses(&w->joints, e->motion, e->before, w->step) : 0.0;
    count->created += sum + stored - earlier + lost;
    count->exchanged += size;
    if (stored > count->stored) count->stored = stored;
    if (earlier > count->stored) count->stored = earlier;
    count->now = stored;
}
