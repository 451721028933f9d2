/* How places change with q, and what that makes of loads on the nodes: docs/theory.md (8) and its derivative. */
#ifndef FLEX_PASS_BACK_H
#define FLEX_PASS_BACK_H

#include "data.h"

/* Rows (6K) of loads on b and phi; (bending, m). */
typedef struct {
    double *rows, *bent;
} Back;

/* Derivatives by q of b and phi, (6K, m), and of places and spins, (K, 3, m). */
typedef struct {
    double *operator_, *translation, *spin;
} Jacobians;

typedef struct {
    double *rows, *total, *about, *change, *one, *other, *square;
} LoadSlope;

static inline int no_load(const double *x) { return x[0] == 0.0 && x[1] == 0.0 && x[2] == 0.0; }

/* Loads (K, 3) gathered from the tips to the roots, in place; rows (6K): their components on the parents' axes, T included. */
void gather(const Body *body, const Configuration *at, double *force, double *moment, double *rows);
/* out (count, m) += factors (count, 6K) times the derivatives of b and phi; `scratch` holds (count, bending, m). */
void add_times_derivative(const Body *body, const Configuration *at, const double *factors, int64_t count, double *scratch,
                          double *out);
/* The same of what is bent alone, (r) of each row that is curved. */
void add_times_bent(const Body *body, const double *turned, const double *factors, int64_t count, double *scratch,
                    double *out);

void take_back(const Body *body, Arena *arena, Back *back);
/* The pass back, (8): out (m) += generalised force of loads (K, 3), which are gathered in place. */
void pass_back(const Body *body, const Configuration *at, double *force, double *moment, Back *back, double *out);

void take_jacobians(const Body *body, Arena *arena, Jacobians *of);
void jacobians_at(const Body *body, const Configuration *at, Jacobians *of);
/* Derivatives (count) of one row of b or phi by the first coordinates. */
void row_derivative(const Body *body, const Configuration *at, int64_t row, int64_t count, double *out);

void take_load_slope(const Body *body, Arena *arena, LoadSlope *slope);
/* out (m, m) += dQ/dq under loads (K, 3) at fixed forces and moments. */
void add_load_stiffness(const Body *body, const Configuration *at, const double *force, const double *moment,
                        const Jacobians *of, LoadSlope *room, double *out);

#endif
