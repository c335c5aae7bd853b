/* Mean and moments about it of the finite ones among n values. */

#include "kernels.h"

#include <float.h>
#include <math.h>

static inline int is_finite(double x) { return fabs(x) <= DBL_MAX; } /* not of NaN */

/* Mean, second moment, largest distance from the mean, and mean of (distance^2/second moment)^2 where that is not zero;
   the number of finite values. */
FOR_EVERY_CPU int64_t moments(int64_t n, const double *values, double *out)
{
    double sum = 0.0, square = 0.0, rest = 0.0, most = 0.0, fourth = 0.0;
    int64_t finite = 0;
    for (int64_t i = 0; i < n; i++) {
        finite += is_finite(values[i]);
        sum += is_finite(values[i]) ? values[i] : 0.0;
    }
    double count = finite ? (double)finite : 1.0, mean = sum / count;
    for (int64_t i = 0; i < n; i++) {
        double d = is_finite(values[i]) ? values[i] - mean : 0.0;
        rest += d;
    }
    mean += rest / count;
    for (int64_t i = 0; i < n; i++) {
        double d = is_finite(values[i]) ? fabs(values[i] - mean) : 0.0;
        square += d * d;
        most = d > most ? d : most;
    }
    square /= count;
    double inverse = square > 0.0 ? 1.0 / square : 0.0;
    for (int64_t i = 0; i < n; i++) {
        double d = is_finite(values[i]) ? values[i] - mean : 0.0, share = d * d * inverse;
        fourth += share * share;
    }
    out[0] = mean;
    out[1] = square;
    out[2] = most;
    out[3] = fourth / count;
    return finite;
}
