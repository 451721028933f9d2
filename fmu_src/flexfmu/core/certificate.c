#include "certificate.h"

#include <math.h>
#include <string.h>

#include "algebra.h"
#include "deformation.h"
#include "forces.h"
#include "membrane.h"
#include "motion.h"
#include "shares.h"
#include "stability.h"
#include "statics.h"
#include "tree.h"
#include "watch.h"

/* Blocks of pieces: of the body, and of a step of Newton's method. Of each `blocks` holds how many each has. */
enum { BODY, PLACES, FORCES, TANGENT, EASING, FACTORS, SOFTEST, BLOCKS };

/* Of the shadow: what its forces are made in; its coordinates, what is left of its forces, its tangent, in coordinates of unit
 * energy (e, e). Of the body: its coordinates without elastic ones, what is left of its own forces, tension (T, 4, 3) of its
 * ties. Of interfaces: position and rotation (I, 12), and distance and angle (I, 2). */
typedef struct {
    Configuration at;
    Loads loads;
    ForceRoom scratch;
    TangentRoom tangents;
    Stretch stretch;
    double *q, *start, *left, *tangent, *scaled, *factor, *rigid, *rest, *tense, *pulled, *moved, *other, *plain, *bent, *error, *found, *rates, *turned, *work;
    int64_t *pivot;
    double blocks[2 * BLOCKS];
} Room;
/* Numbers found on the way: the largest deflection, and that by inertia; how soft an interface is; by how much second order
 * within frames moves interfaces, of that what more frames do not change, flattening, and membrane energy; strain; how much softer
 * than the body the shadow is along the slow motion, and twice the energy of that; how the error is looked for again. */
enum { REACH, TURNED, INERTIA, SOFT, OWN, WITHIN, FLAT, FLAT_TURNED, STRAIN, SOFTER, SLOW, OTHERWISE, FOUND };

static void take_room(const Body *body, Arena *arena, Room *room) {
    const Program *p = body->p;
    const int64_t m = p->modes;
    if (!p->embedded) return;
    take_configuration(body, arena, &room->at);
    take_loads(body, arena, &room->loads);
    take_force_room(body, arena, &room->scratch);
    take_tangent_room(body, arena, &room->tangents);
    take_stretch(body, arena, &room->stretch);
    room->q = take(arena, m);
    room->start = take(arena, m);
    room->left = take(arena, m);
    room->tangent = take(arena, m * m);
    room->scaled = take(arena, m * m);
    room->factor = take(arena, m * m);
    room->rigid = take(arena, p->embedded);
    room->rest = take(arena, p->embedded);
    room->tense = take(arena, 12 * p->ties);
    room->pulled = take(arena, 12 * p->ties);
    room->moved = take(arena, 12 * p->interfaces);
    room->other = take(arena, 12 * p->interfaces);
    room->plain = take(arena, 12 * p->interfaces);
    room->bent = take(arena, 2 * p->interfaces);
    room->rates = take(arena, m);
    room->turned = take(arena, m);
    room->work = take(arena, m);
    room->error = take(arena, 2 * p->interfaces);
    room->found = take(arena, FOUND);
    room->pivot = (int64_t *)take(arena, m);
}

/* A room fits where it is kept. */
typedef char Fits[sizeof(Room) <= LAID_OUT * sizeof(double) ? 1 : -1];

/* What lies in the arena from call to call. */
static Room *room_in(const Body *shadow, Arena *arena, const Slice *slice) {
    Room *room = (Room *)take(arena, LAID_OUT);
    if (room && !laid_out(slice)) take_room(shadow, arena, room);
    return room;
}

void certificate_demand(const Body *body, Arena *arena) {
    Configuration at;
    Stretch stretch;
    Room room;
    take_configuration(body, arena, &at);
    take_stretch(body, arena, &stretch);
    if (body->p->embedded) take(arena, LAID_OUT);
    take_room(body, arena, &room);
}

int is_shadow(const Body *shadow, const Body *body) {
    const Program *s = shadow->p, *p = body->p;
    return s->embedded == p->modes && s->rigid == p->rigid && s->loads == p->loads && s->interfaces == p->interfaces && (!p->ties || p->ties == s->ties);
}

/* Places of the interfaces where frames turn, and nothing within them is of second order. */
static void places_by_frames(const Body *body, Configuration *at, double *out) {
    const Program *p = body->p;
    if (due(body->slice, (double)p->modes)) memset(at->bent, 0, (size_t)(p->bending * p->modes) * sizeof(double));
    configure_places(body, 0, at);
    if (due(body->slice, (double)(12 * p->interfaces))) places_in(p, at, out);
}

/* What is left of the shadow's forces at its coordinates. */
static void residual_of(Body *shadow, Room *room, const double *inputs) {
    const Program *p = shadow->p;
    const int64_t m = p->modes;
    if (due(shadow->slice, (double)(4 * p->loads * m))) spread(shadow, inputs, &room->loads);
    modal_force(shadow, &room->loads, 1, &room->at, 0, &room->scratch, room->left);
    const Rows now = rows_due(shadow->slice, p->tied * m, (double)m);
    for (int64_t j = now.at; j < now.end; j++) room->left[j] += dot(p->tie_initial + j * m, room->q, m);
    subtract_all_forces(shadow, room->q, &room->stretch, room->turned, room->work, room->left);
}

/* Forces and tangent of the shadow at its coordinates. Its joints do not quite fit there, and their own tension would lead
 * astray: the tangent has that of the body's. */
static void forces_of(Body *shadow, Room *room, const double *inputs, double *blocks) {
    Slice *slice = shadow->slice;
    int64_t began = enter_block(slice, blocks + PLACES);
    if (began >= 0) {
        configure(shadow, room->q, &room->at);
        leave_block(slice, began, blocks + PLACES);
    }
    if (over(slice)) return;
    began = enter_block(slice, blocks + FORCES);
    if (began >= 0) {
        residual_of(shadow, room, inputs);
        leave_block(slice, began, blocks + FORCES);
    }
    if (over(slice)) return;
    began = enter_block(slice, blocks + TANGENT);
    if (began < 0) return;
    tangent_stiffness(shadow, &room->loads, 1, &room->at, room->tense, &room->tangents, room->tangent);
    leave_block(slice, began, blocks + TANGENT);
}
/* Steps of inverse iteration. */
enum { ITERATIONS = 8 };

/* The stiffness that a tangent is compared with, times a direction (e) in coordinates of unit energy; twice its energy is returned:
 * that of the unloaded body, or, of one with joints, the material's and the joints' own where they are now, without tension. What
 * stretched these at rest is soft without any load where they turned. */
static double own_stiffness(const Body *shadow, const Room *room, const double *shape, double *out, int64_t e) {
    const Program *p = shadow->p;
    double *rates = room->rates;
    for (int64_t i = 0; !p->ties && i < e; i++) {
        const double share = unloaded_frequency(p, p->rigid + i) / p->omega[p->rigid + i];
        out[i] = share * share * shape[i];
    }
    if (!p->ties) return dot(out, shape, e);
    memset(rates, 0, (size_t)p->rigid * sizeof(double));
    for (int64_t i = 0; i < e; i++) rates[p->rigid + i] = shape[i] / p->omega[p->rigid + i];
    memset(room->turned, 0, (size_t)p->modes * sizeof(double));
    add_turned_stretch(shadow, &room->stretch, rates, room->turned);
    add_turned_joints(shadow, &room->tangents, rates, room->turned);
    for (int64_t i = 0; i < e; i++) out[i] = shape[i] + room->turned[p->rigid + i] / p->omega[p->rigid + i];
    return dot(out, shape, e);
}

/* The smallest eigenvalue of the shadow's tangent over its own stiffness, with its factor at hand, that the deflection has a part
 * in; 1 at the most: at rest and in what stiffens. */
static void find_softest(const Body *shadow, Room *room, double *blocks) {
    const Program *p = shadow->p;
    const int64_t e = p->modes - p->rigid, pieces = 2 * e + 3, began = enter_block(shadow->slice, blocks + SOFTEST);
    if (began < 0) return;
    const double cost = (double)((6 * p->stretches + 24 * p->ties + p->tied * p->modes) * p->modes + 10 * e);
    double *shape = room->factor, *work = room->work, *size = room->found + SOFT;
    if (due(shadow->slice, cost)) {
        for (int64_t i = 0; i < e; i++) shape[i] = p->omega[p->rigid + i] * room->q[p->rigid + i];
        *size = sqrt(fmax(own_stiffness(shadow, room, shape, work, e), 0.0));
    }
    for (int k = 0; k < ITERATIONS && !over(shadow->slice); k++) {
        if (dealt_with(shadow->slice, pieces, (cost + (double)(e * (2 * e + 85))) / (double)pieces)) continue;
        if (due(shadow->slice, (double)e))
            for (int64_t i = 0; i < e; i++) shape[i] = *size > 0.0 ? work[i] / *size : 0.0;
        lu_solve_one(room->scaled, room->pivot, shape, e, shadow->slice);
        if (due(shadow->slice, cost)) *size = sqrt(fmax(own_stiffness(shadow, room, shape, work, e), 0.0));
    }
    if (due(shadow->slice, 1.0)) *size = 1.0 / fmax(*size, 1.0);
    leave_block(shadow->slice, began, blocks + SOFTEST);
}

/* What is left of the forces, and the tangent with its factors, in coordinates of unit energy; 0 where that is not stable. */
static int factors_of(Body *shadow, Room *room, int opened) {
    const Program *p = shadow->p;
    const int64_t m = p->modes, first = p->rigid, e = m - first;
    Slice *slice = shadow->slice;
    const Rows now = rows_due(slice, e, (double)(13 * e));
    for (int64_t i = now.at; i < now.end; i++) {
        const int64_t a = first + i;
        const double held = shadow->opened->stiffness[a] * room->q[a] + dot(p->embedding + a * p->embedded, room->rest, p->embedded);
        room->left[a] = (room->left[a] - held) / p->omega[a];
        for (int64_t j = 0; j < e; j++) room->scaled[i * e + j] = room->tangent[a * m + first + j] / (p->omega[a] * p->omega[first + j]);
    }
    /* Joints of loops that are opened have no tension yet. */
    return (opened || stable_tangent(room->scaled, room->factor, e, slice)) && lu_factor(room->scaled, room->pivot, e, slice);
}

/* So small a share of a step that joints are stretched by it as by its derivative; of a deflection what inertia makes of it where
 * joints ring (nearly all of it), and of the stiffness what they may leave. */
static const double SMALL = 1e-3, RINGING = 0.05, LEFT = 0.5;

/* In pieces it is known before any is done, so that they can be counted. */
static int done_otherwise(const Slice *slice, const Room *room, int how) {
    return (slice ? slice->otherwise : (int)room->found[OTHERWISE]) & how;
}
static int done_anew(Slice *slice, Room *room, int how) {
    if (!slice) room->found[OTHERWISE] += (double)how;
    if (slice && slice->failed < FAILED_PIECEMEAL) slice->failed = how == SLACK ? FAILED_TENSE : FAILED_STEEP;
    return 1;
}

/* Whether the body is soft or not stable since its stiff joints ring, as they do in motion: all begins anew without the tension that
 * they have for a moment. */
static int rings(Slice *slice, Room *room) {
    if (done_otherwise(slice, room, SLACK) || !(room->found[INERTIA] > RINGING * room->found[REACH])) return 0;
    return done_anew(slice, room, SLACK);
}

/* One step of Newton's method from the shadow's coordinates towards its equilibrium, in place, and the softest eigenvalue of
 * its tangent in the last one; 0 where that is not stable. In motion inertia holds what is left of the body's own forces, and
 * so it does in the shadow. */
static int newton_step(Body *shadow, Room *room, const double *inputs, double *blocks, int opened, int eased, int last) {
    const Program *p = shadow->p;
    const int64_t m = p->modes, first = p->rigid, e = m - first;
    Slice *slice = shadow->slice;
    room->tangents.stretch.third = done_otherwise(slice, room, EASED) && !shadow->opened->keeps_shapes;
    forces_of(shadow, room, inputs, blocks);
    if (over(slice)) return 1;
    int64_t began = eased ? enter_block(slice, blocks + EASING) : -1;
    if (began >= 0) {
        subtract_stretch_tension(shadow, &room->tangents.stretch, room->tangent);
        leave_block(slice, began, blocks + EASING);
    }
    if (over(slice)) return 1;
    began = enter_block(slice, blocks + FACTORS);
    if (began >= 0) {
        /* Where the body's motion strains the shadow: a first step without this tension relieves it. */
        if (!factors_of(shadow, room, opened && !last)) {
            if (!rings(slice, room) && !done_otherwise(slice, room, EASED)) done_anew(slice, room, EASED);
            return 0;
        }
        leave_block(slice, began, blocks + FACTORS);
    }
    if (over(slice)) return 1;
    if (last) find_softest(shadow, room, blocks);
    lu_solve_one(room->scaled, room->pivot, room->left + first, e, slice);
    if (!due(slice, (double)(12 * e))) return 1;
    if (last && room->found[SOFT] < LEFT && rings(slice, room)) return 0;
    for (int64_t i = 0; i < e; i++) room->q[first + i] += room->left[first + i] / p->omega[first + i];
    for (int64_t i = 0; i < m; i++)
        if (!isfinite(room->q[i])) return fails(slice);
    return 1;
}

/* Cost of placing a body: of many calls, and of products that go by vectors. */
static const double CALLS = 6000.0, OF_VECTORS = 0.6;

/* Tension of joints that a step of Newton's method, already made, has found. */
static void tense_by_step(Body *shadow, Room *room) {
    const Program *p = shadow->p;
    Slice *slice = shadow->slice;
    if (!due(slice, CALLS + OF_VECTORS * configuration_cost(shadow))) return;
    shadow->slice = 0;
    tie_tension(shadow, &room->at, room->tense);
    for (int64_t i = p->rigid; i < p->modes; i++) room->turned[i] = room->q[i] - (1.0 - SMALL) * room->left[i] / p->omega[i];
    memcpy(room->turned, room->q, (size_t)p->rigid * sizeof(double));
    configure(shadow, room->turned, &room->at);
    tie_tension(shadow, &room->at, room->pulled);
    for (int64_t i = 0; i < 12 * p->ties; i++) room->tense[i] += (room->pulled[i] - room->tense[i]) / SMALL;
    shadow->slice = slice;
}

/* One step after another: of a shadow with loops opened the first one finds the joints' tension. */
static int newton_steps(Body *shadow, Room *room, const double *inputs, int opened, int again) {
    const int eased = done_otherwise(shadow->slice, room, EASED) != 0;
    if (!newton_step(shadow, room, inputs, room->blocks, opened, eased, !again && !eased)) return 0;
    if (!(again || eased) || over(shadow->slice)) return 1;
    if (opened) tense_by_step(shadow, room);
    return newton_step(shadow, room, inputs, room->blocks + BLOCKS, opened, 0, 1);
}

/* The largest linear deflection of an interface under forces on the body's coordinates, and turn; in the room of other places. */
static double deflection_by(const Body *body, const double *force, Room *room, double *turn) {
    const Program *p = body->p;
    double largest = 0.0, *moved = room->other, *turned = moved + 3 * p->interfaces;
    for (int64_t j = 0; j < p->modes; j++) room->rigid[j] = j < p->rigid ? 0.0 : force[j] / body->opened->stiffness[j];
    rows_times(p->load_operator, room->rigid, moved, 6 * p->interfaces, p->modes);
    for (int64_t i = 0; i < p->interfaces; i++) largest = fmax(largest, norm(moved + 3 * i, 3));
    for (int64_t i = 0; i < p->interfaces; i++) *turn = fmax(i ? *turn : 0.0, norm(turned + 3 * i, 3));
    return largest;
}

/* What goes onto the bound: half of the errors beyond 0.3 % are estimated below 0.6 of what they are. */
static const double MARGIN = 1.25;
/* The deflection by what flattens sections, and how far it turns interfaces. */
static double moved_by_flattening(Body *body, Room *room, const double *q) {
    const Program *p = body->p;
    Arena arena = work_arena(body);
    Stretch at;
    take_stretch(body, &arena, &at);
    if (arena.refused) return 0.0;
    stretch_at(body, q, &at);
    for (int64_t r = 0; r < p->stretches; r++)
        if (p->stretch_sign[r] > 0.0) at.bent[r] = at.whole[r] = 0.0;
    memset(room->rest, 0, (size_t)p->modes * sizeof(double));
    subtract_stretch_force(body, &at, &at, room->rest);
    return deflection_by(body, room->rest, room, room->found + FLAT_TURNED);
}

/* Bound of an error of which the shadow finds a share: near a critical load what it does not see grows as well. Of flattening,
 * `flat` of the deflection, only the first order is known: in tubes and pipe bends what is missed is 0.2 to 2 times as much.
 * Large strain it does not know: a bar that is pulled by EA (e + 3/2 e^2 + 1/2 e^3) is off by 2 e^2, and strain is larger than
 * its mean. A shadow that knows the third order has both in its share, and of strain the next order is missed; what motions lack
 * that it knows of no loads is no sum with it. Of others the next order after the second, `within` of the deflection, is that of a cosine. */
static double bound_of(double share, double soft, double within, double flat, double strain, int third) {
    if (!(share > 0.0)) return 0.0;
    const double seen = MARGIN * share / soft, unseen = 2.0 * MARGIN * flat + 4.0 * strain * strain * (third ? strain : 1.0);
    return third ? fmax(seen, unseen) : seen + unseen + MARGIN * within * within / 6.0;
}

/* The shadow's coordinates where shapes of second order stay coordinates that are none of the body's: there they have the
 * displacement of second order, in the body they do not. */
static void move_along_shapes(const Body *body, const Body *shadow, const double *q, Room *room) {
    const Program *s = shadow->p;
    const int64_t n = body->p->modes;
    Arena arena = work_arena(body);
    Stretch own;
    take_stretch(body, &arena, &own);
    if (arena.refused) return;
    stretch_at(shadow, room->q, &room->stretch);
    if (!due(shadow->slice, (double)(2 * (body->p->stretch_numbers + s->stretches * s->modes + n * s->modes)))) return;
    memset(room->rigid, 0, (size_t)n * sizeof(double));
    stretch_at(body, q, &own);
    add_along_shapes(body, &own, 1.0, room->rigid);
    add_along_shapes(shadow, &room->stretch, -1.0, room->q);
    for (int64_t i = 0; i < s->modes; i++) room->q[i] += dot(s->embedding + i * n, room->rigid, n);
}

/* What the body itself tells at q: what is left of its forces, its places, how far they are from where it began. */
static int body_at(Body *body, const Body *shadow, const double *inputs, const double *q, Room *room) {
    const Program *p = body->p;
    Slice *slice = shadow->slice;
    const int64_t n = p->modes, began = enter_block(slice, room->blocks + BODY);
    if (began < 0) return 1;
    const double cost = CALLS + OF_VECTORS * configuration_cost(body);
    Arena arena = work_arena(body);
    Configuration at;
    if (due(slice, cost)) {
        if (body_forces(body, inputs, q, room->rest, 0) != FLEX_OK) return fails(slice);
        for (int64_t j = 0; j < n; j++) room->rest[j] -= body->opened->stiffness[j] * q[j];
    }
    const Rows now = rows_due(slice, shadow->p->modes, (double)(6 * n));
    rows_times(shadow->p->embedding + now.at * n, q, room->q + now.at, now.end - now.at, n);
    if (shadow->opened->keeps_shapes) move_along_shapes(body, shadow, q, room);
    if (due(slice, (double)shadow->p->modes)) memcpy(room->start, room->q, (size_t)shadow->p->modes * sizeof(double));
    take_configuration(body, &arena, &at);
    if (arena.refused) return fails(slice);
    if (due(slice, cost)) {
        configure(body, q, &at);
        places_in(p, &at, room->moved);
        memset(room->tense, 0, (size_t)(12 * shadow->p->ties) * sizeof(double));
        if (p->ties && !done_otherwise(slice, room, SLACK)) tie_tension(body, &at, room->tense);
        room->found[OWN] = 0.0;
        if (p->curved) places_by_frames(body, &at, room->plain);
        if (p->curved) room->found[OWN] = apart(room->moved, room->plain, p->interfaces, room->bent);
    }
    if (due(slice, cost)) {
        memset(room->rigid, 0, (size_t)n * sizeof(double));
        memcpy(room->rigid, q, (size_t)p->rigid * sizeof(double));
        configure(body, room->rigid, &at);
        places_in(p, &at, room->other);
    }
    if (due(slice, 0.5 * CALLS)) {
        room->found[REACH] = reach_of(p, room->error, apart(room->moved, room->other, p->interfaces, room->error));
        room->found[TURNED] = largest_turn(p, room->error);
    }
    if (due(slice, 0.5 * CALLS)) {
        double turn, inertia = deflection_by(body, room->rest, room, &turn);
        room->found[REACH] = fmax(room->found[REACH], inertia);
        room->found[INERTIA] = p->ties ? inertia : 0.0;
    }
    leave_block(slice, began, room->blocks + BODY);
    return 1;
}

/* Whether a shadow has joints where the body has closed loops; springs to the ground are none. */
static int has_opened(const Program *s, const Program *p) {
    for (int64_t t = 0; t < s->ties && s->ties > p->ties; t++)
        if (s->parent[s->nodes - s->ties + t] >= 0) return 1;
    return 0;
}

/* How much softer the shadow is than the body along the slow motion that led to where its steps began, and twice the energy of that:
 * of what bodies that are right to second order miss, a share that grows with the energy. Forces that no motion of the body works
 * on, as of loads that it holds by static shapes not at all, have no part in it. Deflections are off as much, or more. */
static void find_softer(const Body *shadow, Room *room) {
    double along = 0.0, energy = 0.0, most = 0.0;
    for (int64_t a = shadow->p->rigid; a < shadow->p->modes; a++) {
        const double force = drifts(shadow->p, a) ? shadow->opened->stiffness[a] * room->start[a] : 0.0;
        along += force * (room->q[a] - room->start[a]);
        energy += force * room->start[a];
    }
    for (int64_t i = 0; i < shadow->p->interfaces; i++) most = fmax(most, room->error[2 * i]);
    room->found[SLOW] = energy;
    room->found[SOFTER] = energy > 0.0 && room->found[REACH] > 0.0 ? fmin(fabs(along) / energy, most / room->found[REACH]) : 0.0;
}

void pieces_of_error(Body *body, Body *shadow, const double *inputs, const double *q, Arena arena, Slice *slice) {
    const int64_t interfaces = body->p->interfaces;
    Room *room = room_in(shadow, &arena, slice);
    /* Joints of a shadow with loops opened were loops of the body, which a first step closes. Motion of first order stretches
     * the shadow so much that the first step leads back little of the way, and so may it where its shapes are others. */
    const int opened = has_opened(shadow->p, body->p), again = opened || !body->p->curved || shadow->opened->keeps_shapes;
    shadow->slice = slice;
    if (due(slice, 0.0)) {
        memset(room->found, 0, FOUND * sizeof(double));
        memset(room->error, 0, (size_t)(2 * interfaces) * sizeof(double));
    }
    int known = body_at(body, shadow, inputs, q, room) && (over(slice) || newton_steps(shadow, room, inputs, opened, again));
    for (double how = 0.0; !known && !slice && room->found[OTHERWISE] > how;) {
        how = room->found[OTHERWISE];
        known = body_at(body, shadow, inputs, q, room) && newton_steps(shadow, room, inputs, opened, again);
    }
    if (known) {
        if (over(slice)) {
            shadow->slice = 0;
            return;
        }
        configure(shadow, room->q, &room->at);
        if (due(slice, (double)(800 * interfaces))) {
            places_in(shadow->p, &room->at, room->other);
            apart(room->moved, room->other, interfaces, room->error);
            /* A step from so far may lead anywhere. */
            for (int64_t i = 0; i < 2 * interfaces && done_otherwise(slice, room, EASED); i++)
                room->error[i] = fmin(room->error[i], room->found[i % 2 ? TURNED : REACH]);
        }
        places_by_frames(shadow, &room->at, room->plain);
        if (due(slice, (double)(800 * interfaces))) {
            const double own = room->found[OWN], finer = apart(room->other, room->plain, interfaces, room->bent);
            room->found[WITHIN] = fmax(own - fabs(own - finer), 0.0);
        }
        if (due(slice, CALLS + (double)(2 * body->p->stretch_numbers))) room->found[FLAT] = moved_by_flattening(body, room, q);
        if (due(slice, CALLS + (double)(6 * body->p->strains * body->p->modes))) room->found[STRAIN] = body_strain(body, q);
        /* What a first step does to joints that are opened, or to stretches that it relieves, is no stiffness. */
        const int alike = !opened && body->p->curved && !done_otherwise(slice, room, EASED);
        if (due(slice, (double)(6 * shadow->p->modes)) && alike) find_softer(shadow, room);
    } else if (!slice || slice->failed) {
        room->found[SOFT] = 0.0;
    }
    shadow->slice = 0;
}

void error_found(const Body *body, const Body *shadow, Arena arena, double *error, double *deflection, double *share, double *bound) {
    const Program *p = body->p;
    const Room *room = room_in(shadow, &arena, 0);
    const double *found = room->found;
    const int opened = has_opened(shadow->p, p);
    /* A shadow in one piece that is held knows the third order. */
    const int third = !p->rigid && !p->ties && !shadow->p->ties;
    *deflection = fmax(*deflection, found[REACH]);
    *share = *bound = share_of(p, room->error, *deflection, found[TURNED]);
    const double flat = fmax(found[FLAT], as_moved(p, found[FLAT_TURNED], *deflection, found[TURNED]));
    /* A shadow with loops opened: its frames are others, and joints that a step closes pull. */
    if (found[SOFT] > 0.0 && *deflection > 0.0)
        *bound = bound_of(*share, opened ? 1.0 : found[SOFT], opened ? 0.0 : found[WITHIN] / *deflection, flat / *deflection,
                          found[STRAIN], third);
    for (int64_t i = 0; i < 2 * p->interfaces; i++) error[i] = *share == 0.0 ? 0.0 : room->error[i];
}

double softer_found(const Body *shadow, Arena arena, double *energy) {
    const Room *room = room_in(shadow, &arena, 0);
    *energy = room->found[SLOW];
    return room->found[SOFTER];
}

int body_error(Body *body, Body *shadow, const double *inputs, const double *q, double *error, double *deflection, double *share,
               double *bound) {
    Arena arena = work_arena(shadow), size = arena;
    room_in(shadow, &size, 0);
    if (size.refused) return FLEX_NO_ROOM;
    pieces_of_error(body, shadow, inputs, q, arena, 0);
    error_found(body, shadow, arena, error, deflection, share, bound);
    return FLEX_OK;
}
