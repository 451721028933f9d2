#include "arena.h"

double *take(Arena *arena, int64_t count) {
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
