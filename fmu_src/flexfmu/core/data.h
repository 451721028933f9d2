/* What a body consists of: its program, what is made of it once, and room for the work of a call.
 *
 * A program and what follows from it are constant, and common to all its bodies. A `Body` holds only workspaces and what
 * follows from its options, so that results depend on nothing but arguments. One call at a time may use a Body; different ones
 * are independent. */
#ifndef FLEX_DATA_H
#define FLEX_DATA_H

#include <stdint.h>

#include "arena.h"
#include "files.h"
#include "program.h"
#include "slice.h"

/* How a call ended. */
enum {
#define ANSWER(symbol, ...) FLEX_##symbol,
#include "interface.def"
};

/* Where all nodes are for one q. Pointers go into a workspace. */
typedef struct {
    double *q;        /* (m) */
    double *straight; /* (6K): the part of b and phi that is linear in q */
    double *bent;     /* (parts, m): coordinates that bend each part */
    double *turned;   /* curvature times these, (r) of each row that is curved: its share of the derivatives */
    double *local;    /* (6K): b of all nodes, then phi */
    double *position; /* (K, 3) */
    double *rotation, *parent, *jacobian; /* (K, 3, 3): R, R of the parent, T(phi) */
} Configuration;

/* Which of a node's offset and rotation a call needs. */
typedef struct {
    unsigned char offset, turn;
} Need;

/* Rows of the operator that one part's coordinates bend, and their curvature, packed. */
typedef struct {
    int64_t count, start; /* of rows; where their numbers begin in Configuration.turned */
    const int64_t *row;
    const double *curvature;
} Bend;

/* What all internal steps of one length have in common: the exact propagation of the modes, docs/theory.md section 6. */
typedef struct {
    double step;
    double *p11, *p12, *p21, *p22, *gq, *gv, *ramp, *ramp_rate, *lag; /* (m) */
    double *response; /* (m, m), of a body with ties or dampers: B / g_q of (17a) */
} Rule;

enum { RULES = 16, TIED_RULES = 8 };

typedef struct {
    double longest;   /* internal step, s; 0 for none */
    double tolerance; /* error accepted in an internal step, relative, in the energy norm */
    double most;      /* work that one call may take, discarded tries included, in internal steps of ordinary cost */
} StepLimits;

typedef struct {
    int64_t substeps, iterations;
    double error;
} Work;

/* Where deformation was last looked at: the undeformed body at first. Memory of a body, which no result depends on. */
typedef struct {
    double *q; /* (m) */
    double rotation, strain;
} Deformed;

/* A program that is open, and what follows from it once. Only opened.c changes the list, its counts and `softens`. */
typedef struct Opened {
    Program p;
    Image image;         /* of a file, or a copy of its own */
    void *copy;
    FileMark mark;       /* of that file */
    struct Opened *base; /* what it takes arrays from; null for none */
    struct Opened *next;
    int64_t users;
    double *stiffness;     /* (m); `softens` lies behind it */
    Bend *bends;           /* (parts) */
    int64_t *bent_row;     /* of all parts in turn */
    int64_t bend_rows;     /* numbers of Configuration.turned */
    int64_t *turned_start; /* (6K): where those of each row begin */
    Need *lumped;          /* (K): what inertia needs */
    double rotation_reach, strain_reach; /* how fast deformation can grow with the coordinates */
    double *softens;       /* (L / 3): bounds of what unit forces and moments take off the stability */
    int softens_known;
} Opened;

typedef struct Body {
    const Program *p;
    Opened *opened;
    Slice *slice;         /* of what is done in pieces; null: all at once */
    double damping_scale;
    StepLimits limits;
    double *zeta;         /* (m), scaled */
    double *four;         /* (m, 4): four rows of Configuration.turned in the making */
    Need *need;           /* (K): of the step at hand */
    Configuration memo;   /* of the q last seen: a step begins, and outputs are read, where the step before it ended */
    Need *memo_need;
    int memo_known;
    double *coupled;      /* (m, m): damping between modes of a body with ties, of dampers of any other */
    double *square;       /* (m, m) of both: in the making of the former, and of a rule */
    double *rate;         /* (m): damping of each mode, 1/s */
    int rule_count, rule_next, rule_limit;
    Deformed deformed;
    double *end_q, *end_v; /* (m): where a step that is not accepted yet ends */
    double *work;         /* arrays of one call */
    int64_t *pivot;       /* (2m) */
    int64_t work_size, step_size; /* of any call, and of a step */
    double *arena;
    int64_t arena_size;   /* numbers */
    Rule rules[RULES];
} Body;

/* Arrays of one call: all of the workspace. */
static inline Arena work_arena(const Body *body) {
    const Arena arena = {body->work, 0, body->work_size, 0};
    return arena;
}

/* 1 where modes damp each other. */
static inline int64_t crossed(const Program *p) { return p->tied || p->dampers; }

static inline int64_t larger(int64_t a, int64_t b) { return a > b ? a : b; }

#endif
