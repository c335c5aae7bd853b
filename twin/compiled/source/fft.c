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

typedef struct {
    size_t radix, length, stride; /* of this pass: transforms of `length` points, `stride` of them side by side */
    const double *cosine, *sine;  /* of the twiddles e^{-2 pi i p k/length}, k = 1 ... radix - 1, p < length/radix */
    const double *root;           /* e^{-2 pi i k/radix}: cosines, then sines */
} pass;

struct plan {
    size_t samples, half, passes;
    unsigned long used;
    pass pass[MOST_FACTORS];
    double *table;      /* all twiddles */
    const double *turn; /* of the split: cos and sin of pi k/half, k <= half/2 */
    double *scratch;    /* two complex records of half the length, and the pairs of an odd radix */
};

static void angles(double *cosine, double *sine, size_t count, size_t step, size_t length)
{
    for (size_t p = 0; p < count; p++) {
        double angle = TURN * (double)((p * step) % length) / (double)length;
        cosine[p] = cos(angle);
        sine[p] = -sin(angle);
    }
}

static size_t radix_of(size_t n)
{
    if (n % 4 == 0)
        return 4;
    for (size_t r = 2; r * r <= n; r++)
        if (n % r == 0)
            return r;
    return n;
}

static plan *new_plan(size_t n)
{
    plan *p = calloc(1, sizeof *p);
    if (!p)
        return NULL;
    size_t half = n / 2, room = 2 * (half / 2 + 1), left = half;
    while (left > 1) {
        size_t r = radix_of(left);
        room += 2 * (r - 1) * (left / r) + 2 * r;
        left /= r;
    }
    p->samples = n;
    p->half = half;
    p->table = malloc((room + 6 * half) * sizeof(double));
    if (!p->table) {
        free(p);
        return NULL;
    }
    double *next = p->table;
    size_t stride = 1;
    for (left = half; left > 1;) {
        size_t r = radix_of(left), m = left / r;
        pass *q = &p->pass[p->passes++];
        q->radix = r;
        q->length = left;
        q->stride = stride;
        q->cosine = next;
        q->sine = next + (r - 1) * m;
        for (size_t k = 1; k < r; k++)
            angles(next + (k - 1) * m, next + (r - 1 + k - 1) * m, m, k, left);
        next += 2 * (r - 1) * m;
        angles(next, next + r, r, 1, r);
        q->root = next;
        next += 2 * r;
        stride *= r;
        left = m;
    }
    p->turn = next;
    angles(next, next + half / 2 + 1, half / 2 + 1, 1, n);
    next += 2 * (half / 2 + 1);
    p->scratch = next;
    return p;
}

/* The plans of a thread, freed when it ends: a service may compute every window in a thread of its own. */

typedef struct {
    plan *plan[KEPT_PLANS];
    unsigned long calls;
} plans;

static pthread_key_t key;
static pthread_once_t once = PTHREAD_ONCE_INIT;
static int has_key;

static void free_plan(plan *p)
{
    if (p)
        free(p->table);
    free(p);
}

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
        if (kept[i] && kept[i]->samples == n) {
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

/* One pass over split records: y[q + s(rp + k)] = w^(pk) * sum_j x[q + s(p + jm)] e^{-2 pi i jk/r} */

FOR_EVERY_CPU static void pass4(const pass *f, const double *restrict xr, const double *restrict xi,
                                double *restrict yr, double *restrict yi)
{
    size_t s = f->stride, m = f->length / 4, ms = m * s;
    for (size_t p = 0; p < m; p++) {
        double c1 = f->cosine[p], s1 = f->sine[p], c2 = f->cosine[m + p], s2 = f->sine[m + p];
        double c3 = f->cosine[2 * m + p], s3 = f->sine[2 * m + p];
        const double *restrict ar = xr + s * p, *restrict ai = xi + s * p;
        double *restrict br = yr + 4 * s * p, *restrict bi = yi + 4 * s * p;
        INDEPENDENT
        for (size_t q = 0; q < s; q++) {
            double er = ar[q] + ar[q + 2 * ms], ei = ai[q] + ai[q + 2 * ms];
            double fr = ar[q] - ar[q + 2 * ms], fi = ai[q] - ai[q + 2 * ms];
            double gr = ar[q + ms] + ar[q + 3 * ms], gi = ai[q + ms] + ai[q + 3 * ms];
            double hr = ai[q + ms] - ai[q + 3 * ms], hi = ar[q + 3 * ms] - ar[q + ms]; /* -i times the difference */
            double ur = fr + hr, ui = fi + hi, vr = er - gr, vi = ei - gi, wr = fr - hr, wi = fi - hi;
            br[q] = er + gr;
            bi[q] = ei + gi;
            br[q + s] = c1 * ur - s1 * ui;
            bi[q + s] = c1 * ui + s1 * ur;
            br[q + 2 * s] = c2 * vr - s2 * vi;
            bi[q + 2 * s] = c2 * vi + s2 * vr;
            br[q + 3 * s] = c3 * wr - s3 * wi;
            bi[q + 3 * s] = c3 * wi + s3 * wr;
        }
    }
}

/* The same where the stride is 1: side by side over p. */
FOR_EVERY_CPU static void pass4_first(const pass *f, const double *restrict xr, const double *restrict xi,
                                      double *restrict yr, double *restrict yi)
{
    size_t m = f->length / 4;
    const double *restrict c1 = f->cosine, *restrict c2 = c1 + m, *restrict c3 = c2 + m;
    const double *restrict s1 = f->sine, *restrict s2 = s1 + m, *restrict s3 = s2 + m;
    INDEPENDENT
    for (size_t p = 0; p < m; p++) {
        double er = xr[p] + xr[p + 2 * m], ei = xi[p] + xi[p + 2 * m];
        double fr = xr[p] - xr[p + 2 * m], fi = xi[p] - xi[p + 2 * m];
        double gr = xr[p + m] + xr[p + 3 * m], gi = xi[p + m] + xi[p + 3 * m];
        double hr = xi[p + m] - xi[p + 3 * m], hi = xr[p + 3 * m] - xr[p + m];
        double ur = fr + hr, ui = fi + hi, vr = er - gr, vi = ei - gi, wr = fr - hr, wi = fi - hi;
        yr[4 * p] = er + gr;
        yr[4 * p + 1] = c1[p] * ur - s1[p] * ui;
        yr[4 * p + 2] = c2[p] * vr - s2[p] * vi;
        yr[4 * p + 3] = c3[p] * wr - s3[p] * wi;
        yi[4 * p] = ei + gi;
        yi[4 * p + 1] = c1[p] * ui + s1[p] * ur;
        yi[4 * p + 2] = c2[p] * vi + s2[p] * vr;
        yi[4 * p + 3] = c3[p] * wi + s3[p] * wr;
    }
}

FOR_EVERY_CPU static void pass2(const pass *f, const double *restrict xr, const double *restrict xi,
                                double *restrict yr, double *restrict yi)
{
    size_t s = f->stride, m = f->length / 2, ms = m * s;
    for (size_t p = 0; p < m; p++) {
        double c = f->cosine[p], w = f->sine[p];
        INDEPENDENT
        for (size_t q = 0; q < s; q++) {
            double ar = xr[q + s * p], ai = xi[q + s * p], br = xr[q + s * p + ms], bi = xi[q + s * p + ms];
            double dr = ar - br, di = ai - bi;
            yr[q + 2 * s * p] = ar + br;
            yi[q + 2 * s * p] = ai + bi;
            yr[q + 2 * s * p + s] = c * dr - w * di;
            yi[q + 2 * s * p + s] = c * di + w * dr;
        }
    }
}

/* Odd radices: points j and r - j, and results k and r - k, in pairs. `pairs` has room for 2(r - 1) stride doubles. */
FOR_EVERY_CPU static void pass_odd(const pass *f, const double *restrict xr, const double *restrict xi,
                                   double *restrict yr, double *restrict yi, double *restrict pairs)
{
    size_t r = f->radix, s = f->stride, m = f->length / r, ms = m * s, h = (r - 1) / 2;
    double *restrict sr = pairs, *restrict si = sr + h * s, *restrict dr = si + h * s, *restrict di = dr + h * s;
    for (size_t p = 0; p < m; p++) {
        const double *restrict ar = xr + s * p, *restrict ai = xi + s * p;
        double *restrict br = yr + s * r * p, *restrict bi = yi + s * r * p;
        memcpy(br, ar, s * sizeof(double));
        memcpy(bi, ai, s * sizeof(double));
        for (size_t j = 1; j <= h; j++) {
            size_t one = j * ms, other = (r - j) * ms, at = (j - 1) * s;
            INDEPENDENT
            for (size_t q = 0; q < s; q++) {
                sr[at + q] = ar[one + q] + ar[other + q];
                si[at + q] = ai[one + q] + ai[other + q];
                dr[at + q] = ar[one + q] - ar[other + q];
                di[at + q] = ai[one + q] - ai[other + q];
                br[q] += sr[at + q];
                bi[q] += si[at + q];
            }
        }
        for (size_t k = 1; k <= h; k++) {
            double c1 = f->cosine[(k - 1) * m + p], s1 = f->sine[(k - 1) * m + p];
            double c2 = f->cosine[(r - k - 1) * m + p], s2 = f->sine[(r - k - 1) * m + p];
            double *restrict ur = br + k * s, *restrict ui = bi + k * s;
            double *restrict vr = br + (r - k) * s, *restrict vi = bi + (r - k) * s;
            memcpy(ur, ar, s * sizeof(double));
            memcpy(ui, ai, s * sizeof(double));
            memset(vr, 0, s * sizeof(double));
            memset(vi, 0, s * sizeof(double));
            for (size_t j = 1; j <= h; j++) {
                double c = f->root[(j * k) % r], w = f->root[r + (j * k) % r];
                size_t at = (j - 1) * s;
                INDEPENDENT
                for (size_t q = 0; q < s; q++) {
                    ur[q] += c * sr[at + q];
                    ui[q] += c * si[at + q];
                    vr[q] -= w * di[at + q];
                    vi[q] += w * dr[at + q];
                }
            }
            INDEPENDENT
            for (size_t q = 0; q < s; q++) {
                double er = ur[q] + vr[q], ei = ui[q] + vi[q], gr = ur[q] - vr[q], gi = ui[q] - vi[q];
                ur[q] = c1 * er - s1 * ei;
                ui[q] = c1 * ei + s1 * er;
                vr[q] = c2 * gr - s2 * gi;
                vi[q] = c2 * gi + s2 * gr;
            }
        }
    }
}

/* The complex transform of the record in x; returns whether the result is in y rather than in x. */
static int transform(const plan *p, double *xr, double *xi, double *yr, double *yi)
{
    int swapped = 0;
    for (size_t i = 0; i < p->passes; i++) {
        const pass *f = &p->pass[i];
        double *ar = swapped ? yr : xr, *ai = swapped ? yi : xi, *br = swapped ? xr : yr, *bi = swapped ? xi : yi;
        if (f->radix == 4 && f->stride == 1)
            pass4_first(f, ar, ai, br, bi);
        else if (f->radix == 4)
            pass4(f, ar, ai, br, bi);
        else if (f->radix == 2)
            pass2(f, ar, ai, br, bi);
        else
            pass_odd(f, ar, ai, br, bi, p->scratch + 4 * p->half);
        swapped = !swapped;
    }
    return swapped;
}

FOR_EVERY_CPU void fft_to_lines(const plan *p, const double *samples, double *lines)
{
    size_t h = p->half, m = h + 1;
    double *xr = p->scratch, *xi = xr + h, *yr = xr + 2 * h, *yi = xr + 3 * h;
    INDEPENDENT
    for (size_t k = 0; k < h; k++) {
        xr[k] = samples[2 * k];
        xi[k] = samples[2 * k + 1];
    }
    int swapped = transform(p, xr, xi, yr, yi);
    const double *zr = swapped ? yr : xr, *zi = swapped ? yi : xi;
    const double *cosine = p->turn, *sine = p->turn + h / 2 + 1; /* e^{-pi i k/h} */
    double scale = 0.5 / (double)p->samples;
    double *restrict real = lines, *restrict imag = lines + m;
    real[0] = 2 * scale * (zr[0] + zi[0]);
    real[h] = 2 * scale * (zr[0] - zi[0]);
    imag[0] = imag[h] = 0.0;
    INDEPENDENT
    for (size_t k = 1; k <= h / 2; k++) {
        double er = zr[k] + zr[h - k], ei = zi[k] - zi[h - k];                 /* of the even samples */
        double or = zi[k] + zi[h - k], oi = zr[h - k] - zr[k];                 /* of the odd samples */
        double tr = cosine[k] * or - sine[k] * oi, ti = cosine[k] * oi + sine[k] * or;
        real[k] = scale * (er + tr);
        imag[k] = scale * (ei + ti);
        real[h - k] = scale * (er - tr);
        imag[h - k] = scale * (ti - ei);
    }
}

FOR_EVERY_CPU void fft_to_samples(const plan *p, const double *lines, double *samples)
{
    size_t h = p->half, m = h + 1;
    double *xr = p->scratch, *xi = xr + h, *yr = xr + 2 * h, *yi = xr + 3 * h;
    const double *restrict real = lines, *restrict imag = lines + m;
    const double *cosine = p->turn, *sine = p->turn + h / 2 + 1;
    xr[0] = real[0] + real[h];
    xi[0] = -(real[0] - real[h]); /* conjugated: the inverse is the conjugate of the transform of the conjugate */
    INDEPENDENT
    for (size_t k = 1; k <= h / 2; k++) {
        double er = real[k] + real[h - k], ei = imag[k] - imag[h - k];
        double dr = real[k] - real[h - k], di = imag[k] + imag[h - k];
        double or = cosine[k] * dr + sine[k] * di, oi = cosine[k] * di - sine[k] * dr; /* times e^{+pi i k/h} */
        xr[k] = er - oi;
        xi[k] = -(ei + or);
        xr[h - k] = er + oi;
        xi[h - k] = -(or - ei);
    }
    int swapped = transform(p, xr, xi, yr, yi);
    const double *zr = swapped ? yr : xr, *zi = swapped ? yi : xi;
    INDEPENDENT
    for (size_t k = 0; k < h; k++) {
        samples[2 * k] = zr[k];
        samples[2 * k + 1] = -zi[k];
    }
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
