#include "opened.h"

#include <stdlib.h>
#include <string.h>

/* The list, and whether a thread is at it; none holds it for longer than a walk along it. */
#if defined(__GNUC__) && __GCC_ATOMIC_CHAR_LOCK_FREE == 2
static Opened *programs;
static char busy;
static Opened **begin_list(void) {
    while (__atomic_test_and_set(&busy, __ATOMIC_ACQUIRE)) wait_a_moment();
    return &programs;
}
static void end_list(void) { __atomic_clear(&busy, __ATOMIC_RELEASE); }
double *borrow(Opened *opened) { return __atomic_test_and_set(&opened->lent_out, __ATOMIC_ACQUIRE) ? 0 : opened->lent; }
void give_back(Opened *opened) { __atomic_clear(&opened->lent_out, __ATOMIC_RELEASE); }
#else
/* Without a lock nothing is shared. */
static Opened **begin_list(void) { return 0; }
static void end_list(void) {}
double *borrow(Opened *opened) { return (void)opened, (double *)0; }
void give_back(Opened *opened) { (void)opened; }
#endif

int make_lent(Opened *opened, int64_t size) {
    begin_list();
    if (!opened->lent) opened->lent = calloc((size_t)size, sizeof(double));
    const int made = opened->lent != 0;
    end_list();
    return made;
}

Opened *find_opened(const FileMark *mark, const Opened *base) {
    Opened **list = begin_list(), *at = list ? *list : 0;
    while (at && (memcmp(&at->mark, mark, sizeof *mark) != 0 || (at->base && at->base != base))) at = at->next;
    if (at) at->users++;
    end_list();
    return at;
}

void share_opened(Opened *opened) {
    static const FileMark none;
    Opened **list = begin_list();
    opened->users = 1;
    if (opened->base) opened->base->users++;
    if (list && memcmp(&opened->mark, &none, sizeof none) != 0) {
        opened->next = *list;
        *list = opened;
    }
    end_list();
}

/* One user less; whether it was the last one, and nobody finds it any more. */
static int left(Opened *opened) {
    Opened **at = begin_list();
    const int last = --opened->users <= 0;
    while (last && at && *at && *at != opened) at = &(*at)->next;
    if (last && at && *at) *at = opened->next;
    end_list();
    return last;
}

void leave_opened(Opened *opened) {
    while (opened && left(opened)) {
        Opened *base = opened->base;
        free(opened->stiffness);
        free(opened->columns);
        free(opened->rule_numbers);
        free(opened->bends);
        free(opened->bent_row);
        free(opened->turned_start);
        free(opened->lumped);
        free(opened->alike);
        free(opened->lent);
        if (opened->image.bytes && !opened->copy) unmap_file(opened->image.bytes, opened->image.size);
        free(opened->copy);
        free(opened);
        opened = base;
    }
}

int softens_known(const Opened *opened) {
    begin_list();
    const int known = opened->softens_known;
    end_list();
    return known;
}

void keep_softens(Opened *opened, const double *softens) {
    begin_list();
    if (!opened->softens_known) memcpy(opened->softens, softens, (size_t)((opened->p.loads + 2) / 3) * sizeof(double));
    opened->softens_known = 1;
    end_list();
}

const Rule *find_rule(const Opened *opened, double step, double damping_scale) {
    const Rule *found = 0;
    begin_list();
    for (int i = 0; i < opened->rule_count && !found; i++)
        if (opened->rules[i].step == step && opened->rule_damping[i] == damping_scale) found = opened->rules + i;
    end_list();
    return found;
}

const Rule *keep_rule(Opened *opened, const Rule *rule, double damping_scale) {
    Rule *kept = 0;
    if (begin_list() && opened->rule_count < RULES) {
        kept = opened->rules + opened->rule_count;
        kept->step = rule->step;
        memcpy(kept->p11, rule->p11, (size_t)(RULE_ROWS * opened->p.modes) * sizeof(double));
        opened->rule_damping[opened->rule_count++] = damping_scale;
    }
    end_list();
    return kept;
}
