/* Worn profiles: cubic splines through evenly spaced points, and averages along the path of contact. */

#include "kernels.h"

#include <math.h>
#include <stdlib.h>

enum { LANES = 4 }; /* curves whose second derivatives are found side by side */

/* The second derivatives M (m, lanes) of the splines through so many curves y (lanes, m). */
static inline __attribute__((always_inline)) void second_derivatives(const size_t lanes, size_t m, const double *restrict y,
                                                                     const double *restrict pivot, double *restrict M)
{
    for (size_t l = 0; l < lanes; l++) {
        const double *x = y + l * m;
        M[lanes + l] = x[0] - 2.0 * x[1] + x[2];
        M[(m - 2) * lanes + l] = x[m - 3] - 2.0 * x[m - 2] + x[m - 1];
    }
    for (size_t i = 2; i + 2 < m; i++)
        for (size_t l = 0; l < lanes; l++) {
            const double *x = y + l * m + i;
            M[i * lanes + l] = (6.0 * (x[-1] - 2.0 * x[0] + x[1]) - M[(i - 1) * lanes + l]) * pivot[i];
        }
    for (size_t i = m - 3; i > 1; i--)
        for (size_t l = 0; l < lanes; l++)
            M[i * lanes + l] -= pivot[i] * M[(i + 1) * lanes + l];
    for (size_t l = 0; l < lanes; l++) {
        M[l] = 2.0 * M[lanes + l] - M[2 * lanes + l];
        M[(m - 1) * lanes + l] = 2.0 * M[(m - 2) * lanes + l] - M[(m - 3) * lanes + l];
    }
}

/* Value and slope of every curve at positions `at` (k); (curves, k) each. With the spacing as unit, the second
   derivatives M of the spline through y (m >= 5 points) obey

       M[i-1] + 4 M[i] + M[i+1] = 6 (y[i-1] - 2 y[i] + y[i+1]),   not-a-knot: M[0] = 2 M[1] - M[2], so that M[1] = its right side / 6

   Beyond the points the outermost piece goes on. Returns 0, or -1 without memory.
   Source: C. de Boor, A Practical Guide to Splines, Springer 1978, ch. IV */
FOR_EVERY_CPU int spline(int64_t curves, int64_t points, double first, double spacing, const double *values, int64_t count,
                         const double *at, double *out, double *slopes)
{
    size_t m = (size_t)points, k = (size_t)count, all = (size_t)curves;
    double *restrict pivot = malloc(((1 + LANES) * m + 2 * k) * sizeof(double));
    if (!pivot)
        return -1;
    double *restrict M = pivot + m, *restrict piece = M + LANES * m, *restrict within = piece + k;
    pivot[1] = 0.0;
    for (size_t i = 2; i + 2 < m; i++)
        pivot[i] = 1.0 / (4.0 - pivot[i - 1]);
    for (size_t j = 0; j < k; j++) {
        double x = (at[j] - first) / spacing, whole = floor(x);
        piece[j] = whole > 0.0 ? fmin(whole, (double)(m - 2)) : 0.0; /* of NaN, too, which gives NaN */
        within[j] = x - piece[j];
    }
    for (size_t c = 0, lanes; c < all; c += lanes) {
        lanes = all - c < LANES ? 1 : LANES;
        if (lanes == 1)
            second_derivatives(1, m, values + c * m, pivot, M);
        else
            second_derivatives(LANES, m, values + c * m, pivot, M);
        for (size_t l = 0; l < lanes; l++) {
            const double *restrict y = values + (c + l) * m;
            double *restrict value = out + (c + l) * k, *restrict slope = slopes + (c + l) * k;
            for (size_t j = 0; j < k; j++) {
                size_t i = (size_t)piece[j];
                double u = within[j], v = 1.0 - u, a = M[i * lanes + l] / 6.0, b = M[(i + 1) * lanes + l] / 6.0;
                value[j] = v * y[i] + u * y[i + 1] + (v * v - 1.0) * v * a + (u * u - 1.0) * u * b;
                slope[j] = (y[i + 1] - y[i] + (3.0 * u * u - 1.0) * b - (3.0 * v * v - 1.0) * a) / spacing;
            }
        }
    }
    free(pivot);
    return 0;
}

/* Of every row of n values, weighted averages around every `stride`-th, the weights centred on it; n/stride + 1 a row. */
FOR_EVERY_CPU void averages(int64_t rows, int64_t n, const double *values, int64_t reach, const double *weights,
                            int64_t stride, double *out)
{
    for (int64_t row = 0; row < rows; row++, values += n)
        for (int64_t k = 0; k <= n / stride; k++) {
            int64_t at = k * stride, low = at < reach ? 0 : at - reach, high = at + reach < n ? at + reach + 1 : n;
            const double *restrict w = weights + (low - at + reach), *restrict x = values + low;
            double total = 0.0;
            for (int64_t j = 0; j < high - low; j++)
                total += w[j] * x[j];
            *out++ = total;
        }
}
