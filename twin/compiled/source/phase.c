/* The phase of the mesh that turns the lines of a model onto measured ones. */

#include "kernels.h"

#include <math.h>

static const double PI = 3.14159265358979323846;
static const double ENOUGH = 1e-9; /* the next step would be of its square */
enum { NEWTON = 6 };

/* An angle into (-pi, pi]. */
static double wrapped(double angle) { return angle - 2.0 * PI * ceil((angle - PI) / (2.0 * PI)); }

/* For each of `count` sets of products p_k = conj(model_k)*line_k/variance_k the phase psi that is lowest in

       -sum_k Re(p_k exp(-i k psi)) + ((psi - prior)/spread)^2/2,   k = 1 ... harmonics

   the lowest of a scan of phases, then Newton steps of at most 0.05, as long as the curvature is positive.

   real, imaginary  of the products (count, harmonics)
   phases           that are scanned (scanned); cosines, sines: of their multiples (harmonics, scanned)
   spread           infinite where nothing is known before
   cost             room (2*scanned)
   out              (-pi, pi] (count) */
FOR_EVERY_CPU void best_phases(int64_t count, int64_t harmonics, const double *restrict real,
                               const double *restrict imaginary, int64_t scanned, const double *restrict phases,
                               const double *restrict cosines, const double *restrict sines, double prior, double spread,
                               double *restrict cost, double *restrict out)
{
    double stiffness = 1.0 / (spread * spread), *restrict before = cost + scanned;
    for (int64_t j = 0; j < scanned; j++) {
        double off = wrapped(phases[j] - prior);
        before[j] = 0.5 * stiffness * off * off;
    }
    for (int64_t i = 0; i < count; i++) {
        const double *a = real + i * harmonics, *b = imaginary + i * harmonics;
        for (int64_t j = 0; j < scanned; j++)
            cost[j] = before[j];
        for (int64_t k = 0; k < harmonics; k++) {
            const double *c = cosines + k * scanned, *s = sines + k * scanned;
            for (int64_t j = 0; j < scanned; j++)
                cost[j] -= a[k] * c[j] + b[k] * s[j];
        }
        int64_t lowest = 0;
        for (int64_t j = 1; j < scanned; j++)
            lowest = cost[j] < cost[lowest] ? j : lowest;
        double psi = phases[lowest];
        for (int step = 0; step < NEWTON; step++) {
            double slope = stiffness * wrapped(psi - prior), curvature = stiffness;
            double first = cos(psi), second = sin(psi), c = 1.0, s = 0.0;
            for (int64_t k = 0; k < harmonics; k++) {
                double order = (double)(k + 1), turned = c * first - s * second;
                s = s * first + c * second;
                c = turned;
                slope -= order * (b[k] * c - a[k] * s);
                curvature += order * order * (a[k] * c + b[k] * s);
            }
            if (!(curvature > 0.0))
                break;
            double by = fmin(fmax(slope / curvature, -0.05), 0.05);
            psi -= by;
            if (fabs(by) < ENOUGH)
                break;
        }
        out[i] = wrapped(psi);
    }
}
