#include "shares.h"

#include <math.h>

#include "algebra.h"

/* Errors that are none but round-off, over the deflection and over the size of the body. */
static const double OF_DEFLECTION = 1e-9, OF_SIZE = 1e-13;

/* Where interfaces turn about themselves their deflection is that at an arm, of so much of the body's size. */
static const double ARM = 0.01;
/* What an error of rotation counts: 2 % of one are as bad as 1 % of a displacement. */
static const double HALF = 0.5;

/* How far interfaces are from where the body hangs. */
static double span_of(const Program *p) {
    double size = 0.0;
    for (int64_t i = 0; i < p->interfaces; i++) {
        double from[3];
        for (int c = 0; c < 3; c++) from[c] = p->point[3 * (p->frames + i) + c] - p->point[c];
        size = fmax(size, norm(from, 3));
    }
    return size;
}

double largest_turn(const Program *p, const double *by) {
    double angle = 0.0;
    for (int64_t i = 0; i < p->interfaces; i++) angle = fmax(angle, by[2 * i + 1]);
    return angle;
}

double reach_of(const Program *p, const double *by, double largest) {
    return fmax(largest, ARM * span_of(p) * largest_turn(p, by));
}

double as_moved(const Program *p, double error, double deflection, double angle) {
    const double span = span_of(p), wide = span > 0.0 ? fmax(angle, deflection / span) : 0.0;
    return wide > 0.0 ? HALF * error / wide * deflection : 0.0;
}

double share_of(const Program *p, const double *error, double deflection, double angle) {
    double size = 0.0, largest = 0.0;
    /* An interface at the origin is known exactly, what carries it is not. */
    for (int64_t i = 0; i < p->frames + p->interfaces; i++) size = fmax(size, norm(p->point + 3 * i, 3));
    for (int64_t i = 0; i < p->interfaces; i++) largest = fmax(largest, error[2 * i]);
    largest = fmax(reach_of(p, error, largest), as_moved(p, largest_turn(p, error), deflection, angle));
    return largest > fmax(OF_DEFLECTION * deflection, OF_SIZE * size) ? largest / fmax(deflection, OF_SIZE * size) : 0.0;
}
