/* Load sharing of teeth that differ from one another: what every flank carries where, on average of its passages. */

#include "kernels.h"

#include <math.h>
#include <string.h>

static inline double least(double a, double b) { return a < b ? a : b; }

/* Pair q joins tooth q mod z1 of the pinion with tooth q mod z2 of the gear. Over one mesh period the pairs q+1, q, q-1
   stand at points a, a + n, a + 2n (n = `pitch` points, a < n) of the path, and share the load at rest,

       sum k_p max(0, d - g_p) = F,    k_p = k(s_p) c1 c2,    g_p = gap(s_p) + missing1 + missing2

   The load is convex in the approach d, so that d is the least of what every group of pairs would ask for alone.
   `missing1` (z1, 3n) and `missing2` (z2, 3n) [m], positive where material is missing; `share1` (z1), `share2` (z2) of
   the pair's stiffness that a tooth keeps. Adds the force to `load1` and `load2` as often as a tooth passes. */
FOR_EVERY_CPU void share_load(int64_t periods, int64_t pitch, int64_t z1, int64_t z2, const double *stiffness,
                              const double *gap, const double *missing1, const double *missing2, const double *share1,
                              const double *share2, double force, double *load1, double *load2)
{
    const size_t n = (size_t)pitch, row = 3 * n;
    memset(load1, 0, (size_t)z1 * row * sizeof(double));
    memset(load2, 0, (size_t)z2 * row * sizeof(double));
    for (int64_t j = 0; j < periods; j++) {
        const double *k[3], *g[3], *m1[3], *m2[3];
        double *l1[3], *l2[3], c[3];
        for (int64_t p = 0; p < 3; p++) {
            int64_t q = j + 1 - p + z1 * z2;
            size_t i1 = (size_t)(q % z1), i2 = (size_t)(q % z2), at = (size_t)p * n;
            k[p] = stiffness + at, g[p] = gap + at, c[p] = share1[i1] * share2[i2];
            m1[p] = missing1 + i1 * row + at, m2[p] = missing2 + i2 * row + at;
            l1[p] = load1 + i1 * row + at, l2[p] = load2 + i2 * row + at;
        }
        INDEPENDENT
        for (size_t a = 0; a < n; a++) {
            double k0 = c[0] * k[0][a], k1 = c[1] * k[1][a], k2 = c[2] * k[2][a];
            double g0 = g[0][a] + m1[0][a] + m2[0][a], g1 = g[1][a] + m1[1][a] + m2[1][a],
                   g2 = g[2][a] + m1[2][a] + m2[2][a];
            double f0 = k0 * g0, f1 = k1 * g1, f2 = k2 * g2;
            double d = least(least((force + f0) / k0, (force + f1) / k1), (force + f2) / k2);
            d = least(d, least((force + f0 + f1) / (k0 + k1), (force + f1 + f2) / (k1 + k2)));
            d = least(d, least((force + f0 + f2) / (k0 + k2), (force + f0 + f1 + f2) / (k0 + k1 + k2)));
            double x0 = d - g0, x1 = d - g1, x2 = d - g2;
            f0 = x0 > 0.0 ? k0 * x0 : 0.0, f1 = x1 > 0.0 ? k1 * x1 : 0.0, f2 = x2 > 0.0 ? k2 * x2 : 0.0;
            l1[0][a] += f0, l1[1][a] += f1, l1[2][a] += f2;
            l2[0][a] += f0, l2[1][a] += f1, l2[2][a] += f2;
        }
    }
}
