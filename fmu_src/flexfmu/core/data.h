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
    double *bent;     /* (bending, m): coordinates that bend each part */
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

/* What calls overwrite. */
typedef struct {
    double *end_q, *end_v; /* (m): where a step that is not accepted yet ends */
    double *four;          /* (m, 4): four rows of Configuration.turned in the making */
    double *work;          /* arrays of one call */
    int64_t work_size;
} Scratch;

/* What all internal steps of one length have in common: the exact propagation of the modes, docs/theory.md section 6. */
typedef struct {
    double step;
    double *p11, *p12, *p21, *p22, *gq, *gv, *ramp, *ramp_rate, *lag; /* (m) */
    double *response; /* (m, m), of a body with ties or dampers: B / g_q of (17a) */
} Rule;

enum { RULES = 16, TIED_RULES = 8, RULE_ROWS = 9 }; /* whose numbers lie in one run, from p11 on */

typedef struct {
    double longest;   /* internal step, s; 0 for none */
    double tolerance; /* error accepted in an internal step, relative, in the energy norm */
    double most;      /* work that one call may take, discarded tries included, in internal steps of ordinary cost */
} StepLimits;

/* What a step took, and its error; how far steps have led the motion astray (3, m), coordinates, rates and how fast the force changes,
 * which goes on; null where nobody asks. Internal steps are divided by `finer` once more, where that is more than one. */
typedef struct {
    int64_t substeps, iterations;
    double error, *astray;
    int64_t finer;
} Work;

/* Where deformation was last looked at: the undeformed body at first. Memory of a body, which no result depends on. */
typedef struct {
    double *q; /* (m) */
    double rotation, strain;
} Deformed;

/* A program that is open, and what follows from it once. Only opened.c changes the list, its counts, `softens` and rules. */
typedef struct Opened {
    Program p;
    Image image;         /* of a file, or a copy of its own */
    void *copy;
    FileMark mark;       /* of that file */
    struct Opened *base; /* what it takes arrays from; null for none */
    struct Opened *next;
    int64_t users;
    double *stiffness;     /* (m); `softens` lies behind it */
    double *columns;       /* (m, 6K): of operator_, one after the other */
    Bend *bends;           /* (bending) */
    int64_t *bent_row;     /* of all parts in turn */
    int64_t bend_rows;     /* numbers of Configuration.turned */
    int64_t *turned_start; /* (6K): where those of each row begin */
    Need *lumped;          /* (K): what inertia needs */
    int64_t *alike;        /* of variables: how many from each one on are of one role and type, numbers side by side */
    int keeps_shapes;                    /* whether shapes of second order stay coordinates: some l of (18b) is not zero */
    double rotation_reach, strain_reach; /* how fast deformation can grow with the coordinates */
    double *softens;       /* (L / 3): bounds of what unit forces and moments take off the stability */
    int softens_known;
    double *lent;          /* work arrays for one body at a time, as long as those of each */
    char lent_out;
    int rule_count;
    double *rule_numbers, rule_damping[RULES]; /* (RULES, 9, m): of all bodies that damp alike; their factor */
    Rule rules[RULES];
} Opened;

/* First what every step takes: of many bodies in turn few lines of memory are touched. */
typedef struct Body {
    const Program *p;
    Opened *opened;
    Slice *slice;         /* of what is done in pieces; null: all at once */
    StepLimits limits;
    Deformed deformed;
    int64_t step_size;    /* of Scratch.work in a step */
    Scratch scratch;
    int memo_known, rule_count;
    const Rule *known[RULES]; /* rules by the order in which they were asked for: those of `opened`, or below */
    Need *need;           /* (K): of the step at hand */
    Configuration memo;   /* of the q last seen: a step begins, and outputs are read, where the step before it ended */
    Need *memo_need;
    double *coupled;      /* (m, m): damping between modes of a body with ties, of dampers of any other */
    double *square;       /* (m, m) of both: in the making of the former, and of a rule */
    double *zeta;         /* (m), scaled */
    double *rate;         /* (m): damping of each mode, 1/s */
    double damping_scale;
    int rule_next, rule_limit;
    int64_t *pivot;       /* (2m) */
    int64_t arena_size;   /* numbers that lie behind */
    Rule rules[RULES];
} Body;

/* Numbers at the start of an arena whose work is done in pieces: where its arrays lie, laid out by the call that counts. */
enum { LAID_OUT = 112 };

/* Arrays of one call: all of the workspace. */
static inline Arena work_arena(const Body *body) {
    const Arena arena = {body->scratch.work, 0, body->scratch.work_size, 0};
    return arena;
}

/* 1 where modes damp each other. */
static inline int64_t crossed(const Program *p) { return p->tied || p->dampers; }

static inline int64_t larger(int64_t a, int64_t b) { return a > b ? a : b; }

#endif
