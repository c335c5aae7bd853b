/* Interpolation of evenly spaced values by quintic B-splines and by straight lines, and piecewise cubics at many places.

       x(u) = sum_k c_k B5(u - k),   c = x convolved with the inverse of B5: four one-pole filters, two each way

   The record is mirrored about its first and its last value. Positions are counted in samples from the first value;
   NaN and infinite ones give NaN.

   Source: M. Unser, Splines: a perfect fit, IEEE Signal Processing Magazine 16(6) (1999) 22-38, box 2 */

#include "kernels.h"

#include <math.h>

#define SETTLED 64 /* samples after which the slower filter has forgotten its start: 0.43^64 = 4e-24 */
#define BLOCK 128  /* positions whose weights are computed side by side */

/* Four records side by side. */
typedef double four __attribute__((vector_size(32), aligned(8)));

static int64_t mirrored(int64_t i, int64_t n)
{
    if (n == 1)
        return 0;
    int64_t period = 2 * (n - 1), at = i % period;
    at = at < 0 ? at + period : at;
    return at < n ? at : period - at;
}

/* B-spline coefficients c (n) of values (n), n > 0. */
FOR_EVERY_CPU void quintic_coefficients(int64_t n, const double *values, double *c)
{
    const double p = sqrt(67.5 - sqrt(4436.25)) + sqrt(26.25) - 6.5, q = sqrt(67.5 + sqrt(4436.25)) - sqrt(26.25) - 6.5;
    const double gain = (1.0 - p) * (1.0 - 1.0 / p) * (1.0 - q) * (1.0 - 1.0 / q);
    double beyond[SETTLED], x = gain * values[mirrored(-SETTLED, n)], a = x / (1.0 - p), b = a / (1.0 - q);
    for (int64_t i = 1 - SETTLED; i < 0; i++) {
        a = gain * values[mirrored(i, n)] + p * a;
        b = a + q * b;
    }
    for (int64_t i = 0; i < n; i++) {
        a = gain * values[i] + p * a;
        b = a + q * b;
        c[i] = b;
    }
    for (int64_t i = 0; i < SETTLED; i++) {
        a = gain * values[mirrored(n + i, n)] + p * a;
        b = a + q * b;
        beyond[i] = b;
    }
    a = -p / (1.0 - p) * b;
    b = -q / (1.0 - q) * a;
    for (int64_t i = SETTLED - 1; i >= 0; i--) {
        a = p * (a - beyond[i]);
        b = q * (b - a);
    }
    for (int64_t i = n - 1; i >= 0; i--) {
        a = p * (a - c[i]);
        b = q * (b - a);
        c[i] = b;
    }
}

/* B-spline coefficients c (n, 4) of four records of values (n), n > 0: as fast as of one, since one filter waits for
   itself from value to value. */
FOR_EVERY_CPU void quintic_coefficients_of_four(int64_t n, const double *first, const double *second,
                                                const double *third, const double *fourth, double *c)
{
    const double p = sqrt(67.5 - sqrt(4436.25)) + sqrt(26.25) - 6.5, q = sqrt(67.5 + sqrt(4436.25)) - sqrt(26.25) - 6.5;
    const double gain = (1.0 - p) * (1.0 - 1.0 / p) * (1.0 - q) * (1.0 - 1.0 / q);
    four beyond[SETTLED], a = {0.0, 0.0, 0.0, 0.0}, b = a, *out = (four *)c;
    for (int64_t i = -SETTLED; i < n + SETTLED; i++) {
        int64_t j = i >= 0 && i < n ? i : mirrored(i, n);
        four x = {first[j], second[j], third[j], fourth[j]};
        a = i == -SETTLED ? gain / (1.0 - p) * x : gain * x + p * a;
        b = i == -SETTLED ? a / (1.0 - q) : a + q * b;
        if (i >= 0)
            *(i < n ? out + i : beyond + (i - n)) = b;
    }
    a = -p / (1.0 - p) * b;
    b = -q / (1.0 - q) * a;
    for (int64_t i = n + SETTLED - 1; i >= 0; i--) {
        a = p * (a - (i < n ? out[i] : beyond[i - n]));
        b = q * (b - a);
        if (i < n)
            out[i] = b;
    }
}

/* Near the ends, and beyond them; of one of some records side by side. */
static double near_an_end(int64_t n, const double *c, int64_t records, double x)
{
    if (!isfinite(x))
        return NAN;
    double period = 2.0 * (double)(n - 1), sum = 0.0;
    x = n == 1 ? 0.0 : fabs(fmod(x, period));
    x = x > (double)(n - 1) ? period - x : x;
    int64_t whole = (int64_t)x;
    for (int64_t k = -2; k < 4; k++) {
        double d = fabs(x - (double)(whole + k)), u = 3.0 - d, v = 2.0 - d, w = 1.0 - d;
        double weight = u > 0.0 ? u * u * u * u * u : 0.0;
        weight -= v > 0.0 ? 6.0 * v * v * v * v * v : 0.0;
        weight += w > 0.0 ? 15.0 * w * w * w * w * w : 0.0;
        sum += weight / 120.0 * c[mirrored(whole + k, n) * records];
    }
    return sum;
}

/* Number of the value before each of m positions, and what the six coefficients around each weigh. */
static inline __attribute__((always_inline)) void weigh(int64_t m, const double *at, double *whole,
                                                        double weight[6][BLOCK])
{
    INDEPENDENT
    for (int64_t j = 0; j < m; j++) {
        double x = at[j], t, u, t2, u2;
        whole[j] = floor(x);
        t = x - whole[j];
        u = 1.0 - t;
        t2 = t * t;
        u2 = u * u;
        weight[0][j] = u2 * u2 * u * (1.0 / 120.0);
        weight[1][j] = (26.0 + t * (-50.0 + t * (20.0 + t * (20.0 + t * (-20.0 + 5.0 * t))))) * (1.0 / 120.0);
        weight[2][j] = (66.0 + t2 * (-60.0 + t2 * (30.0 - 10.0 * t))) * (1.0 / 120.0);
        weight[3][j] = (66.0 + u2 * (-60.0 + u2 * (30.0 - 10.0 * u))) * (1.0 / 120.0);
        weight[4][j] = (26.0 + u * (-50.0 + u * (20.0 + u * (20.0 + u * (-20.0 + 5.0 * u))))) * (1.0 / 120.0);
        weight[5][j] = t2 * t2 * t * (1.0 / 120.0);
    }
}

/* The spline of coefficients c (n) at each position (count). */
FOR_EVERY_CPU void quintic_at(int64_t n, const double *c, int64_t count, const double *at, double *out)
{
    double weight[6][BLOCK], whole[BLOCK];
    for (int64_t first = 0; first < count; first += BLOCK) {
        int64_t m = count - first < BLOCK ? count - first : BLOCK;
        weigh(m, at + first, whole, weight);
        for (int64_t j = 0; j < m; j++) {
            if (whole[j] >= 2.0 && whole[j] <= (double)(n - 4)) { /* not of NaN */
                const double *d = c + (int64_t)whole[j] - 2;
                out[first + j] = weight[0][j] * d[0] + weight[1][j] * d[1] + weight[2][j] * d[2] + weight[3][j] * d[3] +
                                 weight[4][j] * d[4] + weight[5][j] * d[5];
            } else
                out[first + j] = near_an_end(n, c, 1, at[first + j]);
        }
    }
}

/* Means (points, 4) over the periods of four splines, of coefficients c (n, 4), at positions (periods, points). */
FOR_EVERY_CPU void quintic_means_of_four(int64_t n, const double *c, int64_t periods, int64_t points, const double *at,
                                         double *means)
{
    double weight[6][BLOCK], whole[BLOCK], share = 1.0 / (double)periods;
    four *out = (four *)means;
    for (int64_t j = 0; j < points; j++)
        out[j] = (four){0.0, 0.0, 0.0, 0.0};
    for (int64_t first = 0, point = 0; first < periods * points; first += BLOCK) {
        int64_t m = periods * points - first < BLOCK ? periods * points - first : BLOCK;
        weigh(m, at + first, whole, weight);
        for (int64_t j = 0; j < m; j++) {
            if (whole[j] >= 2.0 && whole[j] <= (double)(n - 4)) { /* not of NaN */
                const four *d = (const four *)c + (int64_t)whole[j] - 2;
                out[point] += weight[0][j] * d[0] + weight[1][j] * d[1] + weight[2][j] * d[2] + weight[3][j] * d[3] +
                              weight[4][j] * d[4] + weight[5][j] * d[5];
            } else
                for (int64_t k = 0; k < 4; k++)
                    means[4 * point + k] += near_an_end(n, c + k, 4, at[first + j]);
            point = point + 1 < points ? point + 1 : 0;
        }
    }
    for (int64_t j = 0; j < points; j++)
        out[j] *= share;
}

/* Values (n) at each position (count) on straight lines; beyond the ends the outermost values. */
FOR_EVERY_CPU void linear_at(int64_t n, const double *values, int64_t count, const double *at, double *out)
{
    double last = (double)(n - 1);
    for (int64_t j = 0; j < count; j++) {
        double x = at[j];
        if (x >= 0.0 && x < last) {
            int64_t i = (int64_t)x;
            out[j] = values[i] + (x - (double)i) * (values[i + 1] - values[i]);
        } else
            out[j] = x < 0.0 ? values[0] : x >= last ? values[n - 1] : NAN;
    }
}

/* Piecewise cubics sum_j c[j][i] (x - knots[i])^(3 - j) of m pieces: value and slope, unless it is NULL, at each place (count). Beyond the
   knots (m + 1, not falling) the outermost piece goes on. Places that follow each other are found quickly. */
FOR_EVERY_CPU void cubics_at(int64_t m, const double *knots, const double *c, int64_t count, const double *at,
                             double *value, double *slope)
{
    int64_t i = 0;
    for (int64_t j = 0, behind; j < count; j = behind) {
        while (i + 1 < m && at[j] >= knots[i + 1])
            i++;
        while (i > 0 && at[j] < knots[i])
            i--;
        double from = i > 0 ? knots[i] : -INFINITY, to = i + 1 < m ? knots[i + 1] : INFINITY;
        for (behind = j + 1; behind < count && at[behind] >= from && at[behind] < to;)
            behind++;
        double knot = knots[i], a = c[i], b = c[m + i], d = c[2 * m + i], e = c[3 * m + i];
        INDEPENDENT
        for (int64_t k = j; k < behind; k++) { /* of one piece */
            double u = at[k] - knot, u2 = u * u;
            value[k] = e + d * u + b * u2 + a * (u2 * u);
        }
        INDEPENDENT
        for (int64_t k = slope ? j : behind; k < behind; k++) {
            double u = at[k] - knot;
            slope[k] = d + 2.0 * b * u + 3.0 * a * (u * u);
        }
    }
}
