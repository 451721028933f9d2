/* Modal forces of loads, geometric stiffness and ties, their potential and derivative: docs/theory.md sections 4, 4b, 10. */
#ifndef FLEX_FORCES_H
#define FLEX_FORCES_H

#include "membrane.h"
#include "pass_back.h"

/* Loads on the nodes, with what follows from them alone; `f_`: without moments, which have no potential. */
typedef struct {
    double *force, *moment;           /* (K, 3), fixed in direction */
    double *follow;                   /* (I, 6): force and moment in the axes of an interface that they turn with */
    double *constant, *f_constant;    /* (m): modal force on the undeformed body */
    double *geometric, *f_geometric;  /* (m, m): geometric stiffness */
    int active, has_moments;          /* whether the modal force depends on q; whether loads have no potential */
    int following;                    /* whether any load turns with its interface */
} Loads;

/* (T, 4, 3), forces and moments on the nodes (2, K, 3), (m, m). */
typedef struct {
    double *tense, *loads, *square;
    Back back;
} ForceRoom;

typedef struct {
    Jacobians of;
    double *gaps; /* (T, 4, 3, m) */
} Foreseen;

typedef struct {
    Jacobians of;
    LoadSlope slope;
    Stretch stretch;
    double *loads, *turned, *tense, *gaps, *row, *square;
} TangentRoom;

/* Whether the modal forces of this method depend on q under any loads. */
int forces_depend(const Body *body);
void take_loads(const Body *body, Arena *arena, Loads *loads);
/* Put loads (L) on the nodes. */
void spread(const Body *body, const double *inputs, Loads *loads);
/* Add loads that turn with their interfaces to (K, 3) each. */
void add_followers(const Body *body, const Loads *loads, const Configuration *at, double *force, double *moment);

void take_force_room(const Body *body, Arena *arena, ForceRoom *room);
/* Q(q), of ties -dE/dq without Hq; `tense` null where their tension is that at q. */
void modal_force(const Body *body, const Loads *loads, int with_moments, const Configuration *at, const double *tense,
                 ForceRoom *room, double *out);
/* J(q) of the forces, without ties and moments. */
double force_work(const Body *body, const Loads *loads, const Configuration *at);
int has_potential(const Body *body);
/* What the round-off of places can make of the work of forces (n, 3) on them, over epsilon: their norms by the size of the
 * body, since frames turn places, so that each coordinate has the round-off of all three. */
double work_reach(const Body *body, const double *force, int64_t n);

void take_tangent_room(const Body *body, Arena *arena, TangentRoom *room);
/* Lambda - dQ/dq (m, m). */
void tangent_stiffness(const Body *body, const Loads *loads, int with_moments, const Configuration *at,
                       const double *tense, TangentRoom *room, double *out);
/* out += (J'SJ - H) direction: joints where they were in the last tangent, without tension. */
void add_turned_joints(const Body *body, const TangentRoom *room, const double *direction, double *out);

/* Forces (T, 4, 3) in the ties' springs, and their energy E of (16). */
double tie_tension(const Body *body, const Configuration *at, double *tense);
/* Levers R l_c of a tie's end at a node, c by c. */
void tie_levers(const Body *body, const Configuration *at, int64_t tie, int64_t node, double *out);
/* Derivative (T, 4, 3, m) of the springs' stretch. */
void gap_derivative(const Body *body, const Configuration *at, const Jacobians *of, double *out);
void take_foreseen(const Body *body, Arena *arena, Foreseen *room);
/* Tension (T, 4, 3) that springs will have once q has changed by `change`. */
void foreseen_tension(const Body *body, const Configuration *at, const double *change, Foreseen *room, double *tense);

#endif
