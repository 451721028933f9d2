/* Whether a coupling feeds the motion or takes from it, and whether its steps resolve the motion of what springs join:
 * iteration makes it stable, not right. Told while it runs, and stopped before it is absurd. */
#ifndef FLEX_DOUBTS_H
#define FLEX_DOUBTS_H

#include "exchange.h"

/* What a run is told of, once each. */
typedef enum { ODD_STATUS, FED, TAKEN, COARSE } NoticeKind;
typedef struct {
    int64_t kind, step, who; /* who: the FMU, or the end that the step does not resolve */
    double figures[2];       /* the status; energy created and stored, J; steps a period and lag, rad */
} Notice;

typedef struct {
    int64_t turned, row[2], diverging;
    double warned[2], last; /* energy stored when FED and TAKEN were told, J, or -1; energy at the last step */
} Growth;

/* Sums of how far the ends of springs move and how sharply they turn from step to step. Of a vibration the second
 * difference is the square of wh times its amplitude: its rms over that of the motion tells wh of what the motion is made
 * of, however fast a stiff spring may ring beside it. With the mean of its force held over each step, a spring's
 * vibration lags by the cube of wh over 12 a step. */
typedef struct {
    int64_t count, said;
    double *now, *last, *earlier, *sum;       /* (ends, 6): of displacement and rotation */
    double *square, *sharp, *moved, *largest; /* (ends, 2) */
} Resolution;

/* Whether the coupling fed the motion (1) or damped it (-1) beyond what round-off explains. */
int feeds(const EnergyCount *count);
void begin_growth(Growth *growth);
/* Look at a step's end. Notices (at most two) are written one after the other; their number. Whether the motion grows
 * without bound comes out in `runaway`. */
int look_at_growth(Growth *growth, const EnergyCount *count, Notice *notices, int *runaway);
void take_resolution(Arena *arena, const Wiring *wiring, Resolution *resolution);
/* The same: number of notices, at most one. */
int look_at_resolution(Resolution *resolution, const Wiring *wiring, const double *signals, Notice *notice);

#endif
