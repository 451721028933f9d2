#include "algebra.h"

#include <math.h>
#include <string.h>

#define EPSILON 2.220446049250313e-16

double norm(const double *x, int64_t n) { return sqrt(dot(x, x, n)); }

int all_zero(const double *x, int64_t count) {
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    int64_t i = 0;
    if (!x || !count || x[0] != 0.0) return !x || !count;
    for (; i + 4 <= count; i += 4)
        for (int k = 0; k < 4; k++) sum[k] += fabs(x[i + k]);
    for (; i < count; i++) sum[0] += fabs(x[i]);
    return (sum[0] + sum[1]) + (sum[2] + sum[3]) == 0.0;
}

int all_finite(const double *x, int64_t count) {
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    int64_t i = 0;
    for (; i + 4 <= count; i += 4)
        for (int k = 0; k < 4; k++) sum[k] += 0.0 * x[i + k];
    for (; i < count; i++) sum[0] += 0.0 * x[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]) == 0.0;
}

void add_rows(const double *x, const double *matrix, double *out, int64_t n, int64_t m) {
    add_strided_rows(x, matrix, m, out, n, m);
}

void product(const double *a, const double *b, double *out, int64_t n, int64_t m, int64_t k) {
    memset(out, 0, (size_t)(n * k) * sizeof(double));
    add_product(a, m, b, out, n, m, k);
}

/* Row i finds its pivot, and takes itself off each row k after it. */
int lu_factor(double *a, int64_t *pivot, int64_t n, Slice *slice) {
    COUNT(2 * n * n * n / 3);
    Rows rows = rows_due(slice, pairs_of(n), (double)(n + 40));
    int64_t i, k;
    column_pair_of(rows.at, n, &k, &i);
    for (; rows.at < rows.end; rows.at++) {
        if (k == i) {
            int64_t best = i;
            for (int64_t row = i + 1; row < n; row++)
                if (fabs(a[row * n + i]) > fabs(a[best * n + i])) best = row;
            pivot[i] = best;
            if (!(fabs(a[best * n + i]) > 0.0) || !isfinite(a[best * n + i])) return fails(slice);
            for (int64_t j = 0; best != i && j < n; j++) {
                const double kept = a[i * n + j];
                a[i * n + j] = a[best * n + j];
                a[best * n + j] = kept;
            }
        } else {
            const double factor = -(a[k * n + i] /= a[i * n + i]);
            add_rows(&factor, a + i * n + i + 1, a + k * n + i + 1, 1, n - i - 1);
        }
        if (++k == n) k = ++i;
    }
    return !failed(slice);
}

void lu_solve(const double *a, const int64_t *pivot, double *b, int64_t n, int64_t columns, Slice *slice) {
    COUNT(2 * n * n * columns);
    Rows rows = rows_due(slice, n, (double)columns);
    for (int64_t i = rows.at; i < rows.end; i++)
        for (int64_t j = 0; pivot[i] != i && j < columns; j++) {
            const double kept = b[i * columns + j];
            b[i * columns + j] = b[pivot[i] * columns + j];
            b[pivot[i] * columns + j] = kept;
        }
    rows = rows_due(slice, n, (double)(n * columns));
    for (int64_t i = rows.at; i < rows.end; i++)
        for (int64_t k = 0; k < i; k++) {
            const double factor = a[i * n + k];
            for (int64_t j = 0; j < columns; j++) b[i * columns + j] -= factor * b[k * columns + j];
        }
    rows = rows_due(slice, n, (double)(n * columns));
    for (int64_t i = n - 1 - rows.at; i > n - 1 - rows.end; i--) {
        for (int64_t k = i + 1; k < n; k++) {
            const double factor = a[i * n + k];
            for (int64_t j = 0; j < columns; j++) b[i * columns + j] -= factor * b[k * columns + j];
        }
        for (int64_t j = 0; j < columns; j++) b[i * columns + j] /= a[i * n + i];
    }
}

void lu_solve_one(const double *a, const int64_t *pivot, double *b, int64_t n, Slice *slice) {
    for (int64_t i = 0, all = due(slice, (double)(4 * n)); all && i < n; i++) {
        const double kept = b[i];
        b[i] = b[pivot[i]];
        b[pivot[i]] = kept;
    }
    Rows rows = rows_due(slice, n, (double)(n + 40));
    for (int64_t i = rows.at; i < rows.end; i++) b[i] -= dot(a + i * n, b, i);
    rows = rows_due(slice, n, (double)(n + 40));
    for (int64_t i = n - 1 - rows.at; i > n - 1 - rows.end; i--) b[i] = (b[i] - dot(a + i * n + i + 1, b + i + 1, n - 1 - i)) / a[i * n + i];
}

/* Rows find their parts of a few columns while they are near, one column after the other: no row waits for another. */
enum { COLUMNS = 8 };

int cholesky(double *a, int64_t n, Slice *slice) {
    for (int64_t first = 0; first < n; first += COLUMNS) {
        const Fours now = fours_due(slice, n - first, (double)(4 * COLUMNS * (first + 60)));
        const int64_t at = first + now.at, end = at + now.count;
        for (int64_t j = first; j < end && j < first + COLUMNS; j++)
            for (int64_t i = j > at ? j : at; i < end; i++) {
                const double rest = a[i * n + j] - dot(a + i * n, a + j * n, j);
                const int positive = i > j || (rest > 0.0 && isfinite(rest));
                if (!positive && !slice) return 0;
                /* In pieces the last row tells. */
                a[i * n + j] = i > j ? rest / a[j * n + j] : positive ? sqrt(rest) : NAN;
            }
    }
    return !slice || !caught_up(slice) || isfinite(a[n * n - 1]);
}

void cholesky_solve(const double *lower, double *b, int64_t n) {
    for (int64_t i = 0; i < n; i++) b[i] = (b[i] - dot(lower + i * n, b, i)) / lower[i * n + i];
    for (int64_t i = n - 1; i >= 0; i--) {
        b[i] /= lower[i * n + i];
        for (int64_t k = 0; k < i; k++) b[k] -= lower[i * n + k] * b[i];
    }
}

void congruent(const double *lower, double *a, int64_t n, Slice *slice) {
    COUNT(2 * n * n * n);
    for (int turn = 0; turn < 2; turn++) {
        Rows rows = rows_due(slice, pairs_of(n), (double)(2 * n));
        int64_t i, k;
        pair_of(rows.at, &i, &k);
        for (; rows.at < rows.end; rows.at++) {
            const double factor = lower[i * n + k];
            for (int64_t j = 0; k < i && j < n; j++) a[i * n + j] -= factor * a[k * n + j];
            for (int64_t j = 0; k == i && j < n; j++) a[i * n + j] /= factor;
            if (++k > i) i++, k = 0;
        }
        rows = rows_due(slice, n, (double)(4 * n));
        for (i = rows.at; i < rows.end; i++)
            for (int64_t j = 0; j < i; j++) {
                const double kept = a[i * n + j];
                a[i * n + j] = a[j * n + i];
                a[j * n + i] = kept;
            }
    }
}

/* Cyclic Jacobi rotations: slow for large n, simple, and accurate to the last digit. */
void symmetric_eigen(double *a, double *values, double *v, int64_t n) {
    enum { SWEEPS = 40 };
    for (int64_t i = 0; v && i < n * n; i++) v[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        double off = 0.0, whole = 0.0;
        for (int64_t i = 0; i < n; i++)
            for (int64_t j = 0; j < n; j++) {
                whole += a[i * n + j] * a[i * n + j];
                if (i != j) off += a[i * n + j] * a[i * n + j];
            }
        if (!(off > EPSILON * EPSILON * whole)) break;
        const double negligible = EPSILON * EPSILON * sqrt(whole);
        for (int64_t p = 0; p < n; p++)
            for (int64_t q = p + 1; q < n; q++) {
                const double apq = a[p * n + q];
                if (fabs(apq) <= negligible) continue;
                const double theta = (a[q * n + q] - a[p * n + p]) / (2.0 * apq);
                const double t = (theta < 0.0 ? -1.0 : 1.0) / (fabs(theta) + sqrt(theta * theta + 1.0));
                const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
                for (int64_t k = 0; k < n; k++) {
                    const double x = a[k * n + p], y = a[k * n + q];
                    a[k * n + p] = c * x - s * y;
                    a[k * n + q] = s * x + c * y;
                }
                for (int64_t k = 0; k < n; k++) {
                    const double x = a[p * n + k], y = a[q * n + k];
                    a[p * n + k] = c * x - s * y;
                    a[q * n + k] = s * x + c * y;
                }
                for (int64_t k = 0; v && k < n; k++) {
                    const double x = v[k * n + p], y = v[k * n + q];
                    v[k * n + p] = c * x - s * y;
                    v[k * n + q] = s * x + c * y;
                }
            }
    }
    for (int64_t i = 0; i < n; i++) values[i] = a[i * n + i];
    for (int64_t i = 0; i < n; i++) {
        int64_t least = i;
        for (int64_t k = i + 1; k < n; k++)
            if (values[k] < values[least]) least = k;
        if (least == i) continue;
        const double kept = values[i];
        values[i] = values[least];
        values[least] = kept;
        for (int64_t k = 0; v && k < n; k++) {
            const double x = v[k * n + i];
            v[k * n + i] = v[k * n + least];
            v[k * n + least] = x;
        }
    }
}

/* Tridiagonal form by Householder's reflections (e.g. G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., 8.3): vector k lies
 * in row k right of the diagonal, its factor in scale[k]. */
static void reduce_to_tridiagonal(double *a, double *off, double *scale, double *work, int64_t n, Slice *slice) {
    COUNT(4 * n * n * n / 3);
    if (passed(slice, (n - 1) * (n + 2))) return;
    for (int64_t k = rows_passed(slice, n); k + 1 < n; k++) {
        const int64_t left = n - k - 1;
        if (over(slice)) return;
        if (dealt_with(slice, 2 * left + 2, (double)(left * (5 * left + 46) + 80) / (double)(2 * left + 2))) continue;
        double *v = a + k * n + k + 1, *rest = a + (k + 1) * (n + 1);
        if (due(slice, (double)(3 * left + 40))) {
            const double size = norm(v, left), sign = v[0] < 0.0 ? -1.0 : 1.0;
            off[k] = -sign * size;
            v[0] += sign * size;
            const double square = dot(v, v, left);
            scale[k] = square > 0.0 ? 2.0 / square : 0.0;
        }
        Rows rows = rows_due(slice, left, (double)(left + 20));
        for (int64_t i = rows.at; i < rows.end; i++) work[i] = scale[k] * dot(rest + i * n, v, left);
        if (due(slice, (double)(3 * left + 40))) {
            const double half = 0.5 * scale[k] * dot(work, v, left);
            for (int64_t i = 0; i < left; i++) work[i] -= half * v[i];
        }
        rows = rows_due(slice, left, (double)(4 * left + 20));
        for (int64_t i = rows.at; i < rows.end; i++)
            for (int64_t j = 0; j < left; j++) rest[i * n + j] -= v[i] * work[j] + work[i] * v[j];
    }
}

/* Pivots (n) of a tridiagonal matrix less x from one end, steps of `way` = 1 or -1 on; whether all of them are positive. */
static int pivots(const double *a, const double *off, double x, int way, double *pivot, int64_t n) {
    int positive = 1;
    for (int64_t k = 0, i = way > 0 ? 0 : n - 1; k < n; k++, i += way) {
        const double by = k ? off[way > 0 ? i - 1 : i] : 0.0;
        pivot[i] = a[i * (n + 1)] - x - (k ? by / pivot[i - way] * by : 0.0);
        if (pivot[i] == 0.0) pivot[i] = -EPSILON * EPSILON;
        positive &= pivot[i] > 0.0;
    }
    return positive;
}

/* By bisection, and the vector by pivots from both ends (I. S. Dhillon, B. N. Parlett, Linear Algebra Appl. 387 (2004) 1). */
void smallest_eigen(double *a, double *work, double *value, double *vector, int64_t n, Slice *slice) {
    enum { BISECTIONS = 100 };
    double *off = work, *scale = work + n, *down = work + 2 * n, *up = work + 3 * n, *bounds = work + 4 * n;
    reduce_to_tridiagonal(a, off, scale, down, n, slice);
    if (due(slice, (double)(10 * n))) {
        double size = 0.0;
        for (int64_t i = 0; i < n; i++) size = fmax(size, fabs(a[i * (n + 1)]) + (i ? fabs(off[i - 1]) : 0.0) + (i + 1 < n ? fabs(off[i]) : 0.0));
        bounds[0] = -size;
        bounds[1] = size;
    }
    Rows rows = rows_due(slice, BISECTIONS, (double)(60 * n));
    for (; rows.at < rows.end; rows.at++) {
        const double middle = 0.5 * (bounds[0] + bounds[1]);
        bounds[!pivots(a, off, middle, 1, down, n)] = middle;
    }
    if (due(slice, (double)(60 * n))) pivots(a, off, *value = 0.5 * (bounds[0] + bounds[1]), 1, down, n);
    if (due(slice, (double)(90 * n))) {
        int64_t best = 0;
        pivots(a, off, *value, -1, up, n);
        double least = HUGE_VAL;
        for (int64_t i = 0; i < n; i++) {
            const double both = fabs(down[i] + up[i] - a[i * (n + 1)] + *value);
            if (both < least) {
                least = both;
                best = i;
            }
        }
        vector[best] = 1.0;
        for (int64_t i = best; i > 0; i--) vector[i - 1] = -off[i - 1] * vector[i] / down[i - 1];
        for (int64_t i = best; i + 1 < n; i++) vector[i + 1] = -off[i] * vector[i] / up[i + 1];
    }
    rows = rows_due(slice, n - 1, (double)(2 * n));
    for (int64_t k = n - 2 - rows.at; k > n - 2 - rows.end; k--) {
        const double *v = a + k * n + k + 1, by = -scale[k] * dot(v, vector + k + 1, n - k - 1);
        for (int64_t i = 0; i < n - k - 1; i++) vector[k + 1 + i] += by * v[i];
    }
    if (!due(slice, (double)(8 * n))) return;
    const double size = norm(vector, n);
    for (int64_t i = 0; i < n; i++) vector[i] /= size;
}

/* Hessenberg form in place, by elimination with exchanges (e.g. G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed.,
 * 7.4). */
static void reduce_to_hessenberg(double *a, int64_t n) {
    for (int64_t k = 1; k + 1 < n; k++) {
        int64_t best = k;
        for (int64_t i = k + 1; i < n; i++)
            if (fabs(a[i * n + k - 1]) > fabs(a[best * n + k - 1])) best = i;
        if (a[best * n + k - 1] == 0.0) continue;
        for (int64_t j = 0; best != k && j < n; j++) {
            const double kept = a[best * n + j];
            a[best * n + j] = a[k * n + j];
            a[k * n + j] = kept;
        }
        for (int64_t i = 0; best != k && i < n; i++) {
            const double kept = a[i * n + best];
            a[i * n + best] = a[i * n + k];
            a[i * n + k] = kept;
        }
        for (int64_t i = k + 1; i < n; i++) {
            const double factor = a[i * n + k - 1] / a[k * n + k - 1];
            if (factor == 0.0) continue;
            for (int64_t j = k - 1; j < n; j++) a[i * n + j] -= factor * a[k * n + j];
            for (int64_t j = 0; j < n; j++) a[j * n + k] += factor * a[j * n + i];
        }
    }
}

/* One of Francis' double steps on the rows and columns from `low` to `top`, whose first column begins with x, y, z. */
static void double_step(double *a, int64_t n, int64_t low, int64_t top, double x, double y, double z) {
    for (int64_t k = low; k < top; k++) {
        const int64_t rows = k + 2 <= top ? 3 : 2;
        double u[3] = {x, y, rows == 3 ? z : 0.0};
        const double length = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
        if (length > 0.0) {
            u[0] += u[0] < 0.0 ? -length : length;
            const double scale = 2.0 / (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
            for (int64_t j = k > low ? k - 1 : low; j < n; j++) {
                double sum = 0.0;
                for (int64_t i = 0; i < rows; i++) sum += u[i] * a[(k + i) * n + j];
                sum *= scale;
                for (int64_t i = 0; i < rows; i++) a[(k + i) * n + j] -= sum * u[i];
            }
            const int64_t last = k + 3 < top ? k + 3 : top;
            for (int64_t j = 0; j <= last; j++) {
                double sum = 0.0;
                for (int64_t i = 0; i < rows; i++) sum += u[i] * a[j * n + k + i];
                sum *= scale;
                for (int64_t i = 0; i < rows; i++) a[j * n + k + i] -= sum * u[i];
            }
        }
        if (k + 1 < top) {
            x = a[(k + 1) * n + k];
            y = a[(k + 2) * n + k];
            z = k + 3 <= top ? a[(k + 3) * n + k] : 0.0;
        }
    }
}

/* Francis' double step with the two eigenvalues of the lowest block as shifts, or an odd one now and then. By differences from
 * the first diagonal element: of eigenvalues that lie close together nothing else is left. */
static void shifted_step(double *a, int64_t n, int64_t low, int64_t top, int odd_one) {
    const double p = a[(top - 1) * n + top - 1], q = a[(top - 1) * n + top], r = a[top * n + top - 1], s = a[top * n + top];
    const double *h = a + low * n + low;
    double first = p - h[0], second = s - h[0], product = first * second - q * r;
    if (odd_one) {
        const double odd = fabs(r) + fabs(a[(top - 1) * n + top - 2]);
        first = second = s - h[0] + 0.75 * odd;
        product = first * second + 0.4375 * odd * odd;
    }
    double x = product / h[n] + h[1], y = h[n + 1] - h[0] - first - second, z = low + 2 <= top ? h[2 * n + 1] : 0.0;
    double_step(a, n, low, top, x, y, z);
}

/* Shifted QR steps with deflation (ibid., 7.5), on the complex numbers written as pairs where a 2 x 2 block is left. */
double smallest_real_part(double *a, int64_t n) {
    enum { ROUNDS = 60 };
    reduce_to_hessenberg(a, n);
    double least = HUGE_VAL, size = 0.0;
    for (int64_t i = 0; i < n * n; i++) size += fabs(a[i]);
    int64_t top = n - 1;
    int round = 0;
    while (top >= 0) {
        int64_t low = top;
        while (low > 0) {
            double near = fabs(a[(low - 1) * n + low - 1]) + fabs(a[low * n + low]);
            if (near == 0.0) near = size;
            if (fabs(a[low * n + low - 1]) <= EPSILON * near) break;
            low--;
        }
        if (low == top) {
            least = fmin(least, a[top * n + top]);
            top--;
            round = 0;
            continue;
        }
        const double p = a[(top - 1) * n + top - 1], q = a[(top - 1) * n + top], r = a[top * n + top - 1];
        const double s = a[top * n + top], mean = 0.5 * (p + s), half = 0.5 * (p - s), square = half * half + q * r;
        if (low == top - 1) {
            least = fmin(least, mean - (square > 0.0 ? sqrt(square) : 0.0));
            top -= 2;
            round = 0;
            continue;
        }
        if (++round > ROUNDS) return NAN;
        shifted_step(a, n, low, top, round % 10 == 0);
    }
    return least;
}

void apply_rows(const double *m, const double *x, double *restrict out, int64_t n) {
    COUNT(15 * n);
    for (int i = 0; i < 3; i++)
        for (int64_t j = 0; j < n; j++)
            out[i * n + j] = m[3 * i] * x[j] + m[3 * i + 1] * x[n + j] + m[3 * i + 2] * x[2 * n + j];
}

void apply_back_rows(const double *m, const double *x, double *restrict out, int64_t n) {
    COUNT(15 * n);
    for (int i = 0; i < 3; i++)
        for (int64_t j = 0; j < n; j++) out[i * n + j] = m[i] * x[j] + m[3 + i] * x[n + j] + m[6 + i] * x[2 * n + j];
}

/* alpha = sin|p|/|p|, beta = (1 - cos|p|)/|p|², gamma = (|p| - sin|p|)/|p|³ and the slopes of the latter two over |p|. */
static void coefficients(double square, double *beta, double *gamma, double *beta_slope, double *gamma_slope) {
    const double x = square;
    if (x < 0.05) {
        /* Series where the closed forms cancel, exact to round-off. */
        *beta = 0.5 - x / 24.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0 * (1.0 - x / 90.0)));
        *gamma = (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0 * (1.0 - x / 110.0)))) / 6.0;
        *beta_slope = -(1.0 - x / 15.0 * (1.0 - x * 3.0 / 112.0 * (1.0 - x * 2.0 / 135.0 * (1.0 - x / 105.6)))) / 12.0;
        *gamma_slope = -(1.0 - x / 21.0 * (1.0 - x / 48.0 * (1.0 - x * 2.0 / 165.0 * (1.0 - x / 124.8)))) / 60.0;
        return;
    }
    const double angle = sqrt(x), alpha = sin(angle) / angle, half = sin(0.5 * angle);
    *beta = 2.0 * half * half / x;
    *gamma = (1.0 - alpha) / x;
    *beta_slope = (alpha - 2.0 * *beta) / x;
    *gamma_slope = (*beta - 3.0 * *gamma) / x;
}

void exponential(const double *phi, double *rotation, double *jacobian) {
    COUNT(60);
    /* The closed forms lose digits of beta and gamma near zero, but there they meet phi^ and its square, as small. */
    const double square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2], angle = sqrt(square + 1e-20);
    const double twice = 2.0 * sin(0.5 * angle) / angle;
    const double alpha = twice * cos(0.5 * angle), beta = 0.5 * twice * twice, gamma = (1.0 - alpha) / (angle * angle);
    double hat[9];
    skew(phi, hat);
    /* hat squared. */
    const double xx = phi[0] * phi[0], yy = phi[1] * phi[1], zz = phi[2] * phi[2];
    const double xy = phi[0] * phi[1], yz = phi[1] * phi[2], zx = phi[2] * phi[0];
    const double twofold[9] = {-zz - yy, xy, zx, xy, -zz - xx, yz, zx, yz, -yy - xx};
    for (int i = 0; i < 9; i++) {
        const double one = i % 4 == 0 ? 1.0 : 0.0;
        rotation[i] = one + alpha * hat[i] + beta * twofold[i];
        jacobian[i] = one + beta * hat[i] + gamma * twofold[i];
    }
}

void transposed_jacobian_derivative(const double *phi, const double *moment, double *out) {
    double beta, gamma, beta_slope, gamma_slope, once[3], twice[3], hat[9], hat_moment[9], hat_once[9], both[9];
    coefficients(dot(phi, phi, 3), &beta, &gamma, &beta_slope, &gamma_slope);
    cross(phi, moment, once);
    cross(phi, once, twice);
    skew(phi, hat);
    skew(moment, hat_moment);
    skew(once, hat_once);
    multiply(hat, hat_moment, both);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = beta * hat_moment[3 * i + j] - gamma * (hat_once[3 * i + j] + both[3 * i + j]) +
                             (gamma_slope * twice[i] - beta_slope * once[i]) * phi[j];
}

void jacobian_rate(const double *phi, const double *rate, double *out) {
    double beta, gamma, beta_slope, gamma_slope, hat[9], hat_rate[9], one[9], other[9], square[9];
    coefficients(dot(phi, phi, 3), &beta, &gamma, &beta_slope, &gamma_slope);
    const double along = dot(phi, rate, 3);
    skew(phi, hat);
    skew(rate, hat_rate);
    multiply(hat_rate, hat, one);
    multiply(hat, hat_rate, other);
    multiply(hat, hat, square);
    for (int i = 0; i < 9; i++)
        out[i] = beta * hat_rate[i] + gamma * (one[i] + other[i]) + along * (beta_slope * hat[i] + gamma_slope * square[i]);
}

void rotation_vector(const double *r, double *out) {
    const double trace = r[0] + r[4] + r[8];
    const double axial[3] = {r[7] - r[5], r[2] - r[6], r[3] - r[1]};
    const double diagonal[4] = {r[0], r[4], r[8], trace};
    double quaternion[4];
    int best = 0;
    /* The column of the quaternion's dyad with the largest diagonal is the safest to divide by. */
    for (int i = 1; i < 4; i++)
        if (diagonal[i] > diagonal[best]) best = i;
    if (best == 3) {
        memcpy(quaternion, axial, sizeof axial);
        quaternion[3] = 1.0 + trace;
    } else {
        for (int i = 0; i < 3; i++) quaternion[i] = r[3 * i + best] + r[3 * best + i];
        quaternion[best] = 1.0 + 2.0 * r[4 * best] - trace;
        quaternion[3] = axial[best];
    }
    double length = 1.0 / sqrt(dot(quaternion, quaternion, 4));
    if (quaternion[3] < 0.0) length = -length;
    for (int i = 0; i < 4; i++) quaternion[i] *= length;
    const double sine = sqrt(dot(quaternion, quaternion, 3));
    const double scale = sine > 0.0 ? 2.0 * atan2(sine, quaternion[3]) / sine : 2.0;
    for (int i = 0; i < 3; i++) out[i] = scale * quaternion[i];
}
