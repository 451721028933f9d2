/* What inputs the FMUs' outputs ask for: tables, connections and springs, and how the answer to inputs is known.
 *
 * All outputs that a coupling needs make one vector of signals, all inputs that it drives another: FMU by FMU. Springs
 * read and write places in them; -1 stands for a variable that an FMU does not have. */
#ifndef FLEX_EXCHANGE_H
#define FLEX_EXCHANGE_H

#include "acceleration.h"
#include "joints.h"

typedef struct {
    int64_t inputs, signals, participants, tables, links, responses;
    double step;                                /* s, between communication points */
    const double *base;                         /* (inputs): what they have apart from tables, connections and springs */
    const int64_t *coupled;                     /* (inputs): whether connections or springs feed them */
    const int64_t *kind;                        /* (inputs): those of one number are compared when changes are judged */
    const int64_t *input_role, *signal_role;    /* whose they are */
    const double *nominal;                      /* (signals) */
    const int64_t *table_rows, *table_columns;  /* (tables) */
    const double *table_times, *table_values;   /* one table after the other, values row by row */
    const int64_t *table_inputs;                /* inputs of the columns, one table after the other */
    const int64_t *link_to, *link_from;         /* (links): input and signal of a connection */
    const double *link_factor;
    Joints joints;
    const int64_t *end_motion, *end_rates, *end_loads; /* (ends, 6): signals, signals, inputs */
    /* Compliance that FMUs offer of their interfaces: whose, the end that it is of where it answers its own loads (else
     * -1), signals of motion and of rates and inputs of loads. */
    const int64_t *response_role, *response_end, *response_places; /* (responses), (responses), (responses, 3, 6) */
} Wiring;

/* What dampers go by: the ends' velocities where they are offered, else the change since the last communication point;
 * that change (of a force held over the step the power is never positive); or they are left out. */
typedef enum { DAMPERS_NOW, DAMPERS_MEAN, DAMPERS_NONE } Dampers;

/* Work arrays for what follows, and what a call leaves in them. */
typedef struct {
    int64_t damped; /* whether there is any damper */
    double *motion, *before, *rates, *loads;         /* (ends, 6) */
    double *by_motion, *sizes, *tangent, *by_inputs; /* (ends), (signals + 1), (6 ends, 6 ends), (signals + 1, inputs) */
    int64_t *told, *marks, *kept;                    /* (signals + 1, inputs), (signals + 1), (springs) */
} Exchange;

void take_exchange(Arena *arena, const Wiring *wiring, Exchange *exchange);
/* inputs: what they have at a time (s) apart from the coupling; at a jump of a table the value before it, or after. */
void base_inputs(const Wiring *wiring, double time, int before, double *inputs);
/* inputs: what connections and springs ask them to be in addition, by signals now and a step ago. */
void coupled_inputs(const Wiring *wiring, Exchange *exchange, const double *signals, const double *before, Dampers dampers, double *inputs);
/* Derivative of the coupled inputs with respect to themselves, held over a step, from blocks (responses, 6, 6): motion at the
 * step's end by loads held over it; those not finite are not known. share: part that the step's end has in what is held.
 * Of springs only one of whose ends offers its compliance nothing is known. 0 where nothing is known at all. */
int interface_response(const Wiring *wiring, Exchange *exchange, const double *signals, const double *blocks, double share, Dampers dampers,
                       KnownResponse *response);
/* out (inputs): residuals that round-off of the signals explains. An FMU may find a small value as the difference of large
 * ones: `nominal` takes no signal for smaller than its nominal value. */
void round_off(const Wiring *wiring, Exchange *exchange, const double *signals, int nominal, double *out);

/* Energies of springs and dampers, J. What the loads did to the bodies, what the springs took up and what the dampers lost
 * would be nothing together if the loads followed the motion. Held over steps they do not. */
typedef struct {
    double created, stored, exchanged, now; /* by holding the loads; in springs at most; by all loads, any sign; in springs */
} EnergyCount;

/* Add a step with coupled inputs held over it; connections to inputs that springs load count as loads of springs. */
void count_energies(const Wiring *wiring, Exchange *exchange, const double *signals, const double *before, const double *held,
                    EnergyCount *count);

#endif
