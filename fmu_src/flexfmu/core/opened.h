/* Programs that are open in this process. Bodies of one file share one, with all that follows from it. */
#ifndef FLEX_OPENED_H
#define FLEX_OPENED_H

#include "data.h"

/* What is open of a file whose program takes arrays from `base` or from none, with one user more; null where nothing is. */
Opened *find_opened(const FileMark *mark, const Opened *base);
/* A program that was made comes to have one user, its base one more, and others may find it. */
void share_opened(Opened *opened);
/* One user less; after the last one all of it is freed. Null is none. */
void leave_opened(Opened *opened);
/* Whether `softens` is known; what it is, for all users, unless it has become known meanwhile. */
int softens_known(const Opened *opened);
void keep_softens(Opened *opened, const double *softens);
/* The rule of a step and a factor on all damping, as any user has made it; null where nobody has. */
const Rule *find_rule(const Opened *opened, double step, double damping_scale);
/* Let others find a rule: where it is from now on; null where there is no room, or nothing is shared. */
const Rule *keep_rule(Opened *opened, const Rule *rule, double damping_scale);

/* Make work arrays of so many numbers, for all bodies, where there are none yet; 0 without memory. */
int make_lent(Opened *opened, int64_t size);
/* These, until they are given back; null where another thread has them. */
double *borrow(Opened *opened);
void give_back(Opened *opened);

#endif
