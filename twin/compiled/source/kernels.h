/* Compiled kernels of the twin. Arrays are row-major doubles unless said otherwise; a spectrum of n real samples (n even)
   is its m = n/2 + 1 lines k >= 0, two-sided Fourier coefficients, real parts first, then imaginary parts: 2m doubles. */
#ifndef GEAR_TWIN_KERNELS_H
#define GEAR_TWIN_KERNELS_H

#include <stddef.h>
#include <stdint.h>

#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(GEAR_TWIN_BASELINE)
#define FOR_EVERY_CPU __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define FOR_EVERY_CPU
#endif

/* Before a loop whose reads and writes do not overlap. */
#ifdef __clang__
#define INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#else
#define INDEPENDENT _Pragma("GCC ivdep")
#endif

/* -- fft.c -- */

typedef struct plan plan;

/* The plan of n samples, kept for the next call of this thread; NULL where there is no memory. */
const plan *fft_plan(size_t n);
/* Samples (n) to lines (2m), and lines to samples. */
void fft_to_lines(const plan *p, const double *samples, double *lines);
void fft_to_samples(const plan *p, const double *lines, double *samples);
/* The same in single precision. */
void fft_to_lines_single(const plan *p, const float *samples, float *lines);
void fft_to_samples_single(const plan *p, const float *lines, float *samples);

/* -- balance.c -- */

typedef struct {
    int64_t contacts, samples, actions, low; /* p, n, a, lines of the given inverse (0: none) */
    const double *stiffness, *open_by;       /* k_p, e_p + tau*e_p' (p, n) */
    const double *side;                      /* (p) +1 or -1 */
    const double *weights;                   /* of every action and contact (a, p, n) */
    const double *closing, *inverse;         /* 1 + i*omega*tau, 1/G (2m) */
    const double *ratios;                    /* G_c/G of every action (a, 2m) */
    const double *driven;                    /* lines of d under the loads alone (2m) */
    const float *low_inverse;                /* (2*low, 2*low) over real parts, then imaginary parts */
    double mean_force, rounding;
} balance;

typedef struct {
    int64_t iterations, products, stalled;
    double residual; /* largest, of the mean force */
} progress;

typedef struct {
    double *forces;                   /* k_p*max(0, x) (p, n) */
    double *force_lines;              /* of the mesh force (2m) */
    double *action_lines;             /* of every action (a, 2m) */
    double *tangent, *action_tangents; /* slopes against d, (n) and (a, n) */
} answer;

#endif
