/* Worn profiles: cubic splines through evenly spaced points, and averages along the path of contact. */

#include "kernels.h"

#include <math.h>
#include <stdlib.h>

/* Value and slope of every curve at positions `at` (k); (curves, k) each. With the spacing as unit, the second
   derivatives M of the spline through y (m >= 5 points) obey

       M[i-1] + 4 M[i] + M[i+1] = 6 (y[i-1] - 2 y[i] + y[i+1]),   not-a-knot: M[0] = 2 M[1] - M[2], so that M[1] = its right side / 6

   Beyond the points the outermost piece goes on. Returns 0, or -1 without memory.
   Source: C. de Boor, A Practical Guide to Splines, Springer 1978, ch. IV */
FOR_EVERY_CPU int spline(int64_t curves, int64_t points, double first, double spacing, const double *values, int64_t count,
                         const double *at, double *out, double *slopes)
{
    size_t m = (size_t)points, k = (size_t)count;
    double *restrict pivot = malloc(2 * m * sizeof(double));
    if (!pivot)
        return -1;
    double *restrict M = pivot + m;
    pivot[1] = 0.0;
    for (size_t i = 2; i + 2 < m; i++)
        pivot[i] = 1.0 / (4.0 - pivot[i - 1]);
    for (size_t c = 0; c < (size_t)curves; c++) {
        const double *restrict y = values + c * m;
        double *restrict value = out + c * k, *restrict slope = slopes + c * k;
        M[1] = y[0] - 2.0 * y[1] + y[2];
        M[m - 2] = y[m - 3] - 2.0 * y[m - 2] + y[m - 1];
        for (size_t i = 2; i + 2 < m; i++)
            M[i] = (6.0 * (y[i - 1] - 2.0 * y[i] + y[i + 1]) - M[i - 1]) * pivot[i];
        for (size_t i = m - 3; i > 1; i--)
            M[i] -= pivot[i] * M[i + 1];
        M[0] = 2.0 * M[1] - M[2];
        M[m - 1] = 2.0 * M[m - 2] - M[m - 3];
        for (size_t j = 0; j < k; j++) {
            double x = (at[j] - first) / spacing, whole = floor(x);
            whole = whole > 0.0 ? fmin(whole, (double)(m - 2)) : 0.0; /* of NaN, too, which gives NaN */
            size_t i = (size_t)whole;
            double u = x - whole, v = 1.0 - u, a = M[i] / 6.0, b = M[i + 1] / 6.0;
            value[j] = v * y[i] + u * y[i + 1] + (v * v - 1.0) * v * a + (u * u - 1.0) * u * b;
            slope[j] = (y[i + 1] - y[i] + (3.0 * u * u - 1.0) * b - (3.0 * v * v - 1.0) * a) / spacing;
        }
    }
    free(pivot);
    return 0;
}

/* Weighted averages around every `stride`-th of n values, the weights centred on it; n/stride + 1 of them. */
FOR_EVERY_CPU void averages(int64_t n, const double *values, int64_t reach, const double *weights, int64_t stride,
                            double *out)
{
    for (int64_t k = 0; k <= n / stride; k++) {
        int64_t at = k * stride, low = at < reach ? 0 : at - reach, high = at + reach < n ? at + reach + 1 : n;
        const double *restrict w = weights + (low - at + reach), *restrict x = values + low;
        double total = 0.0;
        for (int64_t j = 0; j < high - low; j++)
            total += w[j] * x[j];
        out[k] = total;
    }
}
