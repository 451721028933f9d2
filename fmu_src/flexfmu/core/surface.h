/* Where the points of a body's surface are, by the kinematics of its method: for pictures. */
#ifndef FLEX_SURFACE_H
#define FLEX_SURFACE_H

#include "data.h"

/* How points follow from modal coordinates, in the order of Kinematics of methods.py. */
enum { POINTS_LINEAR, POINTS_LITERAL, POINTS_SECANT, POINTS_COROTATED, POINTS_SECOND_ORDER };

void surface_demand(const Body *body, Arena *arena);
/* Places (n, 3) of a surface at q. Of its arrays `sizes` has the kind, n points, r forms, g pieces, and whether the first frame
 * floats; `on` has the frame of each point, -1 for none, then its piece where there are any; `numbers` one after the other
 *     points (n, 3), modes (n, 3, m), second order (n, 3, r), forms (r, m, m), turns of pieces (g, 3, m), their pivots (g, 3),
 *     of each frame displacement of its joint and rotation (S, 6, m), and of second order their second derivatives (S, 6, m, m).
 * `value` is room of r. */
int body_surface(Body *body, const int64_t *sizes, const int64_t *on, const double *numbers, const double *q, double *value,
                 double *places);

#endif
