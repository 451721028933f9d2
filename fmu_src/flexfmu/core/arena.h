/* Work arrays: taken from one run of numbers front to back, and never beyond its end. */
#ifndef FLEX_ARENA_H
#define FLEX_ARENA_H

#include <stdint.h>

/* Without a start the same calls count what they need: how long a run has to be. */
typedef struct {
    double *start;
    int64_t used, size;
    int refused; /* 1 once a take went beyond the end: none of the arrays may be used then */
} Arena;

/* The next `count` numbers; null where they are only counted, or refused. */
static inline double *take(Arena *arena, int64_t count) {
    const int64_t at = arena->used;
    if (!arena->start) {
        arena->used += count;
        return 0;
    }
    if (arena->refused || count > arena->size - at) {
        arena->refused = 1;
        return 0;
    }
    arena->used += count;
    return arena->start + at;
}

/* Ask for memory that is about to be used, all of it at once: where it is far away, each line would be waited for by itself. */
static inline void fetch(const void *from, const void *end) {
#if defined(__GNUC__)
    for (const char *at = from; at < (const char *)end; at += 64) __builtin_prefetch(at);
#else
    (void)from, (void)end;
#endif
}

#endif
