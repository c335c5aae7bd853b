/* Fourier transforms of real records of even length: a complex transform of half the length by Stockham's algorithm of
   mixed radix, then the split into the lines of a real record.

   Source: C. Van Loan, Computational Frameworks for the Fast Fourier Transform, SIAM 1992, ch. 1.7, 2.1, 4.3 */

#include "kernels.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#define MOST_FACTORS 64
#define KEPT_PLANS 8
#define TURN 6.283185307179586476925286766559

static size_t radix_of(size_t n)
{
    if (n % 4 == 0)
        return 4;
    for (size_t r = 2; r * r <= n; r++)
        if (n % r == 0)
            return r;
    return n;
}

#define LANES 4
#define REAL double
#define NAME(x) x
#include "fft_passes.h"
#undef LANES
#undef REAL
#undef NAME

#define LANES 8
#define REAL float
#define NAME(x) x##_single
#include "fft_passes.h"

struct plan {
    tables exact;
    tables_single single;
    unsigned long used;
};

static void free_plan(plan *p)
{
    if (p) {
        free(p->exact.table);
        free(p->single.table);
    }
    free(p);
}

static plan *new_plan(size_t n)
{
    plan *p = calloc(1, sizeof *p);
    if (p && prepare(&p->exact, n) && prepare_single(&p->single, n))
        return p;
    free_plan(p);
    return NULL;
}

/* The plans of a thread, freed when it ends: a service may compute every window in a thread of its own. */

typedef struct {
    plan *plan[KEPT_PLANS];
    unsigned long calls;
} plans;

static pthread_key_t key;
static pthread_once_t once = PTHREAD_ONCE_INIT;
static int has_key;

static void free_plans(void *kept)
{
    for (size_t i = 0; i < KEPT_PLANS; i++)
        free_plan(((plans *)kept)->plan[i]);
    free(kept);
}

static void make_key(void) { has_key = pthread_key_create(&key, free_plans) == 0; }

static plans *of_thread(void)
{
    pthread_once(&once, make_key);
    plans *kept = has_key ? pthread_getspecific(key) : NULL;
    if (kept || !has_key)
        return kept;
    kept = calloc(1, sizeof *kept);
    if (kept && pthread_setspecific(key, kept)) {
        free(kept);
        return NULL;
    }
    return kept;
}

const plan *fft_plan(size_t n)
{
    plans *own = of_thread();
    if (!own)
        return NULL;
    plan **kept = own->plan;
    size_t oldest = 0;
    own->calls++;
    for (size_t i = 0; i < KEPT_PLANS; i++) {
        if (kept[i] && kept[i]->exact.samples == n) {
            kept[i]->used = own->calls;
            return kept[i];
        }
        if (!kept[i] || (kept[oldest] && kept[i]->used < kept[oldest]->used))
            oldest = i;
    }
    plan *made = new_plan(n);
    if (!made)
        return NULL;
    free_plan(kept[oldest]);
    made->used = own->calls;
    kept[oldest] = made;
    return made;
}

void fft_to_lines(const plan *p, const double *samples, double *lines) { lines_of(&p->exact, samples, lines); }

void fft_to_samples(const plan *p, const double *lines, double *samples) { samples_of(&p->exact, lines, samples); }

void fft_to_lines_single(const plan *p, const float *samples, float *lines)
{
    lines_of_single(&p->single, samples, lines);
}

void fft_to_samples_single(const plan *p, const float *lines, float *samples)
{
    samples_of_single(&p->single, lines, samples);
}

/* The same for callers without a plan; -1 where there is no memory. */
int to_lines(int64_t n, const double *samples, double *lines)
{
    const plan *p = fft_plan((size_t)n);
    if (!p)
        return -1;
    fft_to_lines(p, samples, lines);
    return 0;
}

int to_samples(int64_t n, const double *lines, double *samples)
{
    const plan *p = fft_plan((size_t)n);
    if (!p)
        return -1;
    fft_to_samples(p, lines, samples);
    return 0;
}
