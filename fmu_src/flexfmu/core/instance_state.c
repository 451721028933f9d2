#include "instance_state.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

static const char MARK[] = "flexstat";

typedef struct {
    char mark[8];
    uint64_t owner, checksum;
    int64_t count;
} Head;

int64_t instance_state_size(const Instance *x) { return (int64_t)sizeof(Head) + x->number_count * (int64_t)sizeof(double); }

void instance_save(const Instance *x, void *block) {
    Head head;
    memcpy(head.mark, MARK, sizeof head.mark);
    head.owner = x->owner;
    head.count = x->number_count;
    head.checksum = checksum(x->numbers, x->number_count);
    memcpy(block, &head, sizeof head);
    memcpy((char *)block + sizeof head, x->numbers, (size_t)x->number_count * sizeof(double));
}

/* Whether numbers with a right checksum can be a state at all. */
static int sensible(const Instance *x, const double *numbers) {
    const Program *p = description(x);
    const double *single = numbers + (x->single - x->numbers);
    for (int64_t i = 0; i < p->variables; i++) {
        if (p->variable_role[i] != ROLE_PARAMETER || p->variable_type[i] == TYPE_REAL) continue;
        char room[TEXT_SIZE / 4];
        const double value = numbers[p->variable_index[i]];
        if (!(value >= 0.0 && value < 1e6) || value != floor(value)) return 0;
        if (p->variable_type[i] == TYPE_BOOLEAN ? value > 1.0 : !*variable_text(x, i, 1 + (int64_t)value, room)) return 0;
    }
    for (int i = S_KNOWN; i <= S_ITERATIONS; i++)
        if (!(single[i] >= 0.0 && single[i] <= 1e15)) return 0;
    for (int i = 0; i < S_COUNT; i++)
        if (!isfinite(single[i])) return 0;
    for (int64_t i = 0; i < 2 * x->modes; i++)
        if (!isfinite(numbers[x->q - x->numbers + i])) return 0;
    const double kind = single[S_LOOKING + 1];
    if (!(kind >= 0.0 && kind < LOOKS) || kind != floor(kind)) return 0;
    for (int64_t i = 0; i < 8 * x->modes; i++)
        if (!isfinite(numbers[x->drift - x->numbers + i])) return 0;
    for (int64_t i = 0; i < STATES * (x->modes + x->loads); i++)
        if (!isfinite(numbers[x->states - x->numbers + i])) return 0;
    for (int64_t i = 0; i < x->loads; i++)
        if (!isfinite(numbers[x->previous - x->numbers + i]) || !isfinite(numbers[x->seen - x->numbers + i])) return 0;
    return single[S_MODES] <= (double)x->modes && single[S_HINT] >= 1.0 && single[S_STATUS] <= STATE_PASSED &&
           isfinite(single[S_LAST_STEP]) && single[S_LAST_STEP] >= 0.0;
}

const char *instance_restore(Instance *x, const void *block, int64_t size) {
    Head head;
    if (size < (int64_t)sizeof head) return "the FMU state is none of flexfmu's";
    memcpy(&head, block, sizeof head);
    if (memcmp(head.mark, MARK, sizeof head.mark) != 0) return "the FMU state is none of flexfmu's";
    if (head.owner != x->owner) return "the FMU state is of another FMU: states go between instances of the same FMU only";
    if (head.count != x->number_count || size != instance_state_size(x)) return "the FMU state is damaged: its size is wrong";
    memcpy(x->kept, (const char *)block + sizeof head, (size_t)x->number_count * sizeof(double));
    if (head.checksum != checksum(x->kept, x->number_count) || !sensible(x, x->kept)) return "the FMU state is damaged";
    /* Before a run a tunable parameter is looked at when the body is chosen, in a run by each step. */
    const int running = x->kept[x->single - x->numbers + S_RUNNING] != 0.0;
    int same = running || !runs(x);
    for (int64_t i = 0; i < x->parameters; i++)
        same &= (running && parameter_is_tunable(i)) || x->kept[i] == x->parameter[i];
    /* What the slices of a look have found is of the state that it looks at. */
    const int64_t looked = (x->modes + x->loads) * (int64_t)sizeof(double);
    if (memcmp(x->kept + (x->states - x->numbers), x->states, (size_t)looked) != 0 ||
        memcmp(x->kept + (x->single - x->numbers) + S_LOOKING, x->single + S_LOOKING, offsetof(Looking, slices)) != 0)
        x->pieces.begun = 0;
    memcpy(x->numbers, x->kept, (size_t)x->number_count * sizeof(double));
    if (!same) instance_forget_body(x);
    x->cached = 0;
    x->changed = x->rated = 1;
    return 0;
}
