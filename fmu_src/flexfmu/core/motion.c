#include "motion.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "forces.h"
#include "free_body.h"
#include "inertia.h"
#include "membrane.h"
#include "rates.h"
#include "tree.h"

typedef struct {
    Configuration at;
    Rates rates;
    Flow flow;
    Stretch stretch;
    Turning turning;
    End end;
    double *tense, *momentum, *excess; /* (T, 4, 3), (m) and (r, r) */
    double *unit;                      /* (m, 3 + n): of a body that turns with a polynomial, rates of unit modal ones */
} Motion;

/* Whether mass is a polynomial in the axes of a root that turns freely. */
static int turns_by_polynomial(const Program *p) { return p->turns && p->inertial && !p->lumped; }

/* The first of what is taken for motion. */
static void take_seen(const Body *body, Arena *arena, Configuration *at, Rates *rates) {
    take_rates(body, arena, rates);
    take_configuration(body, arena, at);
}

void seen_demand(const Body *body, Arena *arena) {
    Configuration at;
    Rates rates;
    take_seen(body, arena, &at, &rates);
}

static void take_motion(const Body *body, Arena *arena, Motion *room) {
    take_seen(body, arena, &room->at, &room->rates);
    take_flow(body, arena, &room->flow);
    take_stretch(body, arena, &room->stretch);
    if (turns_by_polynomial(body->p)) {
        take_turning(body, arena, &room->turning);
        take_end(body, arena, &room->end);
        room->end.at = &room->at;
        room->unit = take(arena, body->p->modes * (3 + coordinates(body->p)));
    }
    room->tense = take(arena, 12 * body->p->ties);
    room->momentum = take(arena, body->p->modes);
    room->excess = take(arena, body->p->inertial_modes * body->p->inertial_modes);
}

void motion_demand(const Body *body, Arena *arena) {
    Motion room;
    take_motion(body, arena, &room);
}

typedef struct {
    Configuration at;
    Loads loads;
    ForceRoom scratch;
    TangentRoom tangent;
    Stretch stretch;
} Pushes;

static void take_pushes(const Body *body, Arena *arena, Pushes *room) {
    take_configuration(body, arena, &room->at);
    take_loads(body, arena, &room->loads);
    take_force_room(body, arena, &room->scratch);
    take_tangent_room(body, arena, &room->tangent);
    take_stretch(body, arena, &room->stretch);
}

void pushes_demand(const Body *body, Arena *arena) {
    Pushes room;
    take_pushes(body, arena, &room);
}

void body_nodes(Body *body, const double *q, double *position, double *rotation) {
    const Configuration *at = whole_configuration(body, q);
    memcpy(position, at->position, (size_t)(3 * body->p->nodes) * sizeof(double));
    memcpy(rotation, at->rotation, (size_t)(9 * body->p->nodes) * sizeof(double));
}

static int motion_in_scratch(Body *body, const double *q, const double *v, double *motion, double *rates) {
    const Program *p = body->p;
    Arena arena = work_arena(body);
    Configuration seen;
    Rates of;
    take_seen(body, &arena, &seen, &of);
    if (arena.refused) return FLEX_NO_ROOM;
    /* Where no step keeps where it ends, nothing is kept here. */
    if (!body->memo_known) configure(body, q, &seen);
    const Configuration *at = body->memo_known ? whole_configuration(body, q) : &seen;
    for (int64_t i = 0; i < p->interfaces; i++) {
        const int64_t k = p->frames + i;
        for (int c = 0; c < 3; c++) motion[6 * i + c] = at->position[3 * k + c] - p->point[3 * k + c];
        rotation_vector(at->rotation + 9 * k, motion + 6 * i + 3);
    }
    if (!rates) return FLEX_OK;
    node_rates(body, 0, at, v, &of);
    for (int64_t i = 0; i < p->interfaces; i++) {
        memcpy(rates + 6 * i, of.velocity + 3 * (p->frames + i), 3 * sizeof(double));
        memcpy(rates + 6 * i + 3, of.spin + 3 * (p->frames + i), 3 * sizeof(double));
    }
    return FLEX_OK;
}

int body_motion(Body *body, const double *q, const double *v, double *motion, double *rates) {
    double room[ON_STACK];
    const Scratch own = elsewhere(body, room);
    const int answer = motion_in_scratch(body, q, v, motion, rates);
    put_back(body, &own);
    return answer;
}

void body_stress(Body *body, const double *q, double *largest) {
    const Program *p = body->p;
    for (int64_t s = 0; s < p->stress_sets; s++) {
        double most = 0.0;
        for (int64_t i = p->stress_start[s]; i < p->stress_start[s + 1]; i++) {
            double t[6];
            rows_times(p->stress + i * 6 * p->modes, q, t, 6, p->modes);
            const double a = t[0] - t[1], b = t[1] - t[2], c = t[2] - t[0];
            const double square = 0.5 * (a * a + b * b + c * c) + 3.0 * (t[3] * t[3] + t[4] * t[4] + t[5] * t[5]);
            if (!(square <= most)) most = square;
        }
        largest[s] = sqrt(most);
    }
}

int body_energies(Body *body, const double *q, const double *v, double *strain, double *kinetic) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Arena arena = work_arena(body);
    Motion room;
    take_motion(body, &arena, &room);
    if (arena.refused) return FLEX_NO_ROOM;
    *strain = 0.0;
    for (int64_t j = 0; j < m; j++) *strain += 0.5 * body->opened->stiffness[j] * q[j] * q[j];
    *kinetic = 0.5 * dot(v, v, m);
    if (p->stretches) {
        stretch_at(body, q, &room.stretch);
        *strain += stretch_energy(body, &room.stretch);
    }
    if (!p->tied && !p->inertial) return FLEX_OK;
    if (turns_by_polynomial(p)) {
        const End *end = &room.end;
        enter_end(body, q, v, &room.end, &room.turning);
        momentum_of(p, &end->mass, end->z, 0, room.momentum);
        *kinetic = 0.5 * (total_mass(p) * dot(end->velocity, end->velocity, 3) + dot(end->z, room.momentum, coordinates(p)));
        return FLEX_OK;
    }
    configure(body, q, &room.at);
    if (p->tied) {
        *strain += tie_tension(body, &room.at, room.tense);
        for (int64_t j = 0; j < m; j++) *strain -= 0.5 * q[j] * dot(p->tie_initial + j * m, q, m);
    }
    if (p->inertial) {
        excess_momentum(body, &room.at, v, &room.flow, room.momentum);
        *kinetic += 0.5 * dot(v, room.momentum, m);
    }
    return FLEX_OK;
}

/* M of rates v by that of the centre of mass and of the root's own axes. */
static void turning_mass(Body *body, const double *q, Motion *room, double *out) {
    const Program *p = body->p;
    const int64_t m = p->modes, n = coordinates(p);
    const double mass = total_mass(p);
    End *end = &room->end;
    memset(out, 0, (size_t)(m * m) * sizeof(double));
    enter_end(body, q, out, end, &room->turning);
    for (int64_t j = 0; j < m; j++) {
        double *unit = room->unit + j * (3 + n), momentum[3];
        out[j * m + j] = 1.0;
        end_rates(body, out + j * m, end);
        memcpy(unit, end->velocity, sizeof end->velocity);
        memcpy(unit + 3, end->z, (size_t)n * sizeof(double));
        for (int i = 0; i < 3; i++) momentum[i] = mass * end->velocity[i];
        momentum_of(p, &end->mass, end->z, 0, room->momentum);
        for (int64_t i = 0; i <= j; i++) {
            const double *other = room->unit + i * (3 + n);
            out[i * m + j] = dot(other, momentum, 3) + dot(other + 3, room->momentum, n);
        }
    }
    for (int64_t i = 0; i < m; i++)
        for (int64_t j = 0; j < i; j++) out[i * m + j] = out[j * m + i];
}

int body_mass(Body *body, const double *q, double *mass) {
    const int64_t m = body->p->modes, r = body->p->inertial_modes;
    Arena arena = work_arena(body);
    Motion room;
    take_motion(body, &arena, &room);
    if (arena.refused) return FLEX_NO_ROOM;
    if (turns_by_polynomial(body->p)) {
        turning_mass(body, q, &room, mass);
        return FLEX_OK;
    }
    for (int64_t i = 0; i < m * m; i++) mass[i] = i % (m + 1) == 0 ? 1.0 : 0.0;
    if (!body->p->inertial) return FLEX_OK;
    configure(body, q, &room.at);
    excess_mass(body, &room.at, &room.flow, room.excess);
    for (int64_t i = 0; i < r; i++)
        for (int64_t j = 0; j < r; j++) mass[i * m + j] += room.excess[i * r + j];
    return FLEX_OK;
}

int body_forces(Body *body, const double *inputs, const double *q, double *force, double *tangent) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    Arena arena = work_arena(body);
    Pushes room;
    take_pushes(body, &arena, &room);
    if (arena.refused) return FLEX_NO_ROOM;
    /* Constant forces act wherever the body is. */
    if (tangent || p->placement != PLACE_REFERENCE || p->tied || p->by_load_given || p->by_mode_given) configure(body, q, &room.at);
    spread(body, inputs, &room.loads);
    if (force) {
        modal_force(body, &room.loads, 1, &room.at, 0, &room.scratch, force);
        for (int64_t j = 0; p->tied && j < m; j++) force[j] += dot(p->tie_initial + j * m, q, m);
        stretch_at(body, q, &room.stretch);
        subtract_stretch_force(body, &room.stretch, &room.stretch, force);
    }
    if (tangent) tangent_stiffness(body, &room.loads, 1, &room.at, 0, &room.tangent, tangent);
    return FLEX_OK;
}
