/* A master's loop over communication steps: how FMUs take a step together, what is recorded and told. */
#ifndef FLEX_COUPLING_H
#define FLEX_COUPLING_H

#include "doubts.h"
#include "participant.h"

typedef enum { JACOBI, GAUSS_SEIDEL, ITERATED } Scheme;

typedef struct {
    Wiring wiring;
    Participant *participants;
    const unsigned *response_references;                /* (responses, 36) */
    int64_t scheme, every, columns;                     /* communication points a row; columns of a row */
    int64_t kinds, most_iterations, reuse, mean_inputs; /* whether tables count by the mean of the step's ends */
    double tolerance, relaxation, share;                /* share: part of the step's end in the inputs held over it */
    double *times, *rows;                               /* results: time (s), and the row: FMUs, iterations, energy created */
    int64_t most_rows;
    Notice *notices; /* (participants + 3) */
} Setup;

/* Why a call came back: all steps asked for are done, or the run has to end: the first four are replies of an FMU. */
typedef enum { DONE, UNSETTLED = NOT_FINITE + 1, FAILURE_TOLD, GROWS, NO_ROOM_FOR_ROWS } Ending;

typedef struct {
    int64_t ending, who, what, status; /* FMU, or input that does not settle; Asked, signal, or status.code; FMI's status */
    double figure;                     /* of a signal; change of an input, of its size */
    int64_t steps, rows, rounds, notices, feeds; /* so far; `feeds` of the energies */
    EnergyCount energies;
} Outcome;

typedef struct Coupling Coupling;

/* Null where memory is too little. The setup's arrays stay the caller's and have to live as long. */
Coupling *coupling_open(const Setup *setup);
/* Hand outputs on along the connections, in the order listed, end the initialisation and record. */
void coupling_begin(Coupling *coupling, Outcome *outcome);
/* Go on until so many steps are taken, or the run has to end; the last point of all is recorded whatever its number. */
void coupling_run(Coupling *coupling, int64_t steps, int64_t last, Outcome *outcome);
/* Record the point reached, unless it is. */
void coupling_record(Coupling *coupling, Outcome *outcome);
/* slope (inputs, inputs) of the coupled inputs by themselves, of the step just taken; 0 where nothing is known. */
int coupling_slope(Coupling *coupling, double *slope, Outcome *outcome);
/* Drop the states kept, but of an FMU (else -1) that must not be called any more. */
void coupling_close(Coupling *coupling, int64_t broken);

#endif
