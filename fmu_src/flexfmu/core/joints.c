#include "joints.h"

#include <string.h>

#include "algebra.h"

static const double GROUND[6] = {0.0};

/* Six values of an end; the ground's are zero. */
static const double *six_of(const Joints *joints, const double *values, int64_t end) {
    return end < joints->ends ? values + 6 * end : GROUND;
}

/* out (3, 3) = A inverse transposed: cross products of its columns over the determinant. */
static void inverse_transposed(const double *a, double *out) {
    cross(a + 3, a + 6, out);
    cross(a + 6, a, out + 3);
    cross(a, a + 3, out + 6);
    const double determinant = dot(a, out, 3);
    for (int i = 0; i < 9; i++) out[i] /= determinant;
}

void relative_motion(const double *a, const double *b, double *relative, double *matrix) {
    double turn_a[9], turn_b[9], between[9], unused[9], jacobian[9], back[9], moment[9], distance[3], hat[9], arm[9];
    exponential(a + 3, turn_a, unused);
    exponential(b + 3, turn_b, unused);
    for (int i = 0; i < 3; i++) distance[i] = a[i] - b[i];
    apply_back(turn_b, distance, relative);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) back[3 * i + j] = turn_b[3 * j + i];
    multiply(back, turn_a, between);
    rotation_vector(between, relative + 3);
    exponential(relative + 3, unused, jacobian);
    inverse_transposed(jacobian, back);
    multiply(turn_b, back, moment);
    skew(distance, hat);
    multiply(hat, turn_b, arm);
    memset(matrix, 0, 72 * sizeof *matrix);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double turn = turn_b[3 * i + j], part = moment[3 * i + j];
            matrix[6 * i + j] = turn;
            matrix[6 * (3 + i) + 3 + j] = part;
            matrix[6 * (6 + i) + j] = -turn;
            matrix[6 * (9 + i) + j] = -arm[3 * i + j];
            matrix[6 * (9 + i) + 3 + j] = -part;
        }
}

/* e (6) and B (12, 6) of a spring by the motion of all ends. */
static void joint_motion(const Joints *joints, int64_t k, const double *motion, double *relative, double *matrix) {
    const double *axes = joints->axes + 9 * k;
    double whole[78];
    relative_motion(six_of(joints, motion, joints->a[k]), six_of(joints, motion, joints->b[k]), whole, whole + 6);
    for (int i = 0; i < 26; i++) apply(axes, whole + 3 * i, i < 2 ? relative + 3 * i : matrix + 3 * (i - 2));
}

void backward_rates(const double *motion, const double *before, double step, double *rates, int64_t ends) {
    for (int64_t end = 0; end < ends; end++, motion += 6, before += 6, rates += 6) {
        double now[9], then[9], back[9], turn[9], unused[9];
        exponential(motion + 3, now, unused);
        exponential(before + 3, then, unused);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) back[3 * i + j] = then[3 * j + i];
        multiply(now, back, turn);
        rotation_vector(turn, rates + 3);
        for (int i = 0; i < 3; i++) rates[i] = motion[i] - before[i];
        for (int i = 0; i < 6; i++) rates[i] /= step;
    }
}

void joint_loads(const Joints *joints, const double *motion, const double *rates, double *loads) {
    memset(loads, 0, (size_t)(6 * joints->ends) * sizeof *loads);
    for (int64_t k = 0; k < joints->count; k++) {
        const int64_t ends[2] = {joints->a[k], joints->b[k]};
        double relative[6], matrix[72], stress[6];
        joint_motion(joints, k, motion, relative, matrix);
        const double *rate_a = six_of(joints, rates, ends[0]), *rate_b = six_of(joints, rates, ends[1]);
        for (int j = 0; j < 6; j++) {
            double speed = 0.0;
            for (int i = 0; i < 6; i++) speed += matrix[6 * i + j] * rate_a[i];
            for (int i = 0; i < 6; i++) speed += matrix[36 + 6 * i + j] * rate_b[i];
            stress[j] = joints->stiffness[6 * k + j] * relative[j] + joints->damping[6 * k + j] * speed;
        }
        for (int side = 0; side < 2; side++)
            for (int i = 0; i < 6 && ends[side] < joints->ends; i++) loads[6 * ends[side] + i] -= dot(matrix + 36 * side + 6 * i, stress, 6);
    }
}

void joint_tangent(const Joints *joints, const int64_t *kept, const double *motion, const double *by_motion, double *tangent) {
    const int64_t size = 6 * joints->ends;
    memset(tangent, 0, (size_t)(size * size) * sizeof *tangent);
    for (int64_t k = 0; k < joints->count; k++) {
        if (kept && !kept[k]) continue;
        const int64_t ends[2] = {joints->a[k], joints->b[k]};
        double relative[6], matrix[72];
        joint_motion(joints, k, motion, relative, matrix);
        for (int column = 0; column < 12; column++) {
            const int64_t mover = ends[column / 6];
            if (mover == joints->ends) continue;
            double inner[6];
            for (int j = 0; j < 6; j++)
                inner[j] = (joints->stiffness[6 * k + j] + joints->damping[6 * k + j] * by_motion[mover]) * matrix[6 * column + j];
            for (int row = 0; row < 12; row++)
                if (ends[row / 6] < joints->ends)
                    tangent[(6 * ends[row / 6] + row % 6) * size + 6 * mover + column % 6] -= dot(matrix + 6 * row, inner, 6);
        }
    }
}

double joint_energy(const Joints *joints, const double *motion) {
    double sum = 0.0, relative[6], matrix[72];
    for (int64_t k = 0; k < joints->count; k++) {
        joint_motion(joints, k, motion, relative, matrix);
        for (int j = 0; j < 6; j++) sum += joints->stiffness[6 * k + j] * relative[j] * relative[j];
    }
    return 0.5 * sum;
}

double joint_losses(const Joints *joints, const double *motion, const double *before, double step) {
    double sum = 0.0, now[6], then[6], matrix[72];
    for (int64_t k = 0; k < joints->count; k++) {
        joint_motion(joints, k, motion, now, matrix);
        joint_motion(joints, k, before, then, matrix);
        for (int j = 0; j < 6; j++) sum += joints->damping[6 * k + j] * (now[j] - then[j]) * (now[j] - then[j]);
    }
    return sum / step;
}
