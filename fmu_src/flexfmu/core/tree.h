/* Where the nodes of the tree of frames are, docs/theory.md sections 4 and 4a. */
#ifndef FLEX_TREE_H
#define FLEX_TREE_H

#include "data.h"

void take_configuration(const Body *body, Arena *arena, Configuration *at);
void configure(const Body *body, const double *q, Configuration *at);
/* What calls overwrite, with so many numbers of work. */
void take_scratch(const Body *body, Arena *arena, int64_t work_size, Scratch *scratch);
/* Numbers of it that may lie on the stack: of many bodies in turn they stay in the processor's cache there. */
enum { ON_STACK = 8192 };
/* Let it lie in `room` (ON_STACK) if a step needs no more; where it was, to be put back. */
Scratch onto_stack(Body *body, double *room);
/* The same, or where bodies of one program lend it to each other, unless another thread has it: until it is put back. */
Scratch elsewhere(Body *body, double *room);
void put_back(Body *body, const Scratch *own);
/* Numbers that it takes. */
int64_t scratch_size(const Body *body, int64_t work_size);
/* Cost of that, in multiplications. */
double configuration_cost(const Body *body);
/* All that is linear in q, what places are made of; null `need`: all. */
void configure_linear(const Body *body, const Need *need, const double *q, Configuration *at);
void configure_places(const Body *body, const Need *need, Configuration *at);
/* Halfway between the q of two others: all that comes before places is linear in q. */
void configure_halfway(const Body *body, const Need *need, const Configuration *a, const Configuration *b, Configuration *at);

/* What of each node steps under some loads need, in body->need: frames carry others, ties hold others. */
void find_need(Body *body, const double *inputs, const double *inputs_end);
/* Keep the configuration of a q, of which what `need` says is known. */
void remember(Body *body, const Need *need, const Configuration *at);
/* The configuration of q where what is needed is known already: 1. */
int recall(const Body *body, const Need *need, const double *q, Configuration *at);
/* The configuration of q, all of it, kept for the next call; it may not be written to. */
const Configuration *whole_configuration(Body *body, const double *q);

/* Position and rotation (I, 12) of the interfaces. */
void places_in(const Program *p, const Configuration *at, double *out);
/* Distance and angle (I, 2) between places; the largest distance is returned. */
double apart(const double *a, const double *b, int64_t interfaces, double *out);
/* Rows that move: seen from its frame no lump turns, and those rows come last. */
int64_t moving_rows(const Program *p);
/* Basis (r, m) of the coordinates that bend a part; null where q itself does: without any, or where there are m of them. */
const double *part_basis(const Program *p, int64_t part);
/* Coordinates that bend each part at q, (bending, m) with r of them in each row. */
void part_coordinates(const Program *p, const double *q, Slice *slice, double *x);
/* Whether a row of the operator is needed. */
int wanted(const Program *p, const Need *need, int64_t row);
/* Curvature times the coordinates, of rows that are needed, by the LANES of them. */
void turn_rows(const Body *body, const Need *need, const double *bent, double *to);
/* Of LANES packed matrices (r, r): rows (LANES, r) = matrices times x (r), and out (r, r) += their sum times factors; by pieces. */
void four_rows(const Body *body, const double *packed, const double *x, double *rows, int64_t r);
void add_four(const Body *body, const double *factors, const double *packed, double *out, int64_t r, double cost);
/* Cost of a piece of the latter, of which there are as many as groups. */
double added_cost(int64_t r);

#endif
