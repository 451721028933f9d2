/* An FMU in another process: calls go there through memory that both share, a round trip for a step with all its values. */
#ifndef FLEX_CHANNEL_H
#define FLEX_CHANNEL_H

#include "participant.h"

/* What the memory begins with; then calls: what is asked, how many values, references, values. */
typedef enum { ASKED_SO_FAR, CALLS_FIRST, CALLS_FURTHER, COUNT_FURTHER, HONOURED, LAST_STATUS, LINES, LEAVING, FIRST_CALL } Place;
/* Functions of FMI, in the order of fmu/foreign_host.py. */
typedef enum { SET_REALS, GET_REALS, GET_INTEGERS, GET_BOOLEANS, END_INITIALIZATION, DO_STEP, GET_STATE, SET_STATE, FREE_STATE } Called;

/* One side of it. */
typedef struct {
    /* The C library's, of whoever opened the pipes: a byte says that there is something to do. */
    ptrdiff_t (*read)(int, void *, size_t);
    ptrdiff_t (*write)(int, const void *, size_t);
    void (*hear)(int64_t); /* so many lines were logged; also amid waiting, with 0, where a signal came */
    int64_t from, to;      /* ends of pipes */
    int64_t *shared;       /* (words) */
    int64_t words;
    /* Of the side that calls. */
    int64_t end, calls;       /* those that travel with the next one that needs an answer, and where the last of them ends */
    int64_t waiting, called;  /* whether an answer is awaited, and of which call */
    int64_t gone, failed;     /* whether the process has ended; 1 + which of those calls was not honoured */
    int64_t saved, kind;      /* whether the state was saved since the last step; of the last step: 1 where it was */
    int64_t ahead;            /* so many lists of values came with the last step: what was asked after earlier ones */
    int64_t asked[2];         /* lists of values that come with a step of each kind */
    int64_t places[32];       /* (2, 16): where they begin, and where the last one ends */
} Channel;

/* Give a participant the functions that ask the other side. */
void channel_join(Channel *channel, Participant *one);
/* Answer until the other side says that it is enough, or ends. */
void channel_serve(Channel *channel, Participant *one);
/* Say that it is enough. */
void channel_leave(Channel *channel);

#endif
