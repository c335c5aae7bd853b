/* The noise floor of a spectrum between its lines; twin/features/noise_floor.py states it. */

#include "kernels.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ANCHOR 64 /* bins after which the exponential is computed again rather than multiplied on */
#define LINES_FILL_ALL 1
#define LN2 0.693147180559945309417232121458

/* Puts value number k (from 0) in order into its place, none before it greater and none behind it less; returns it. */
static double selected(double *restrict a, size_t n, size_t k)
{
    size_t low = 0, high = n;
    while (high - low > 1) {
        double x = a[low], y = a[low + (high - low) / 2], z = a[high - 1];
        double least = x < y ? x : y, most = x < y ? y : x, pivot = z < least ? least : z > most ? most : z;
        size_t at = pivot == x ? low : pivot == y ? low + (high - low) / 2 : high - 1, s = low;
        a[at] = a[high - 1];
        for (size_t i = low; i + 1 < high; i++) {
            double v = a[i];
            a[i] = a[s];
            a[s] = v;
            s += v < pivot;
        }
        a[high - 1] = a[s];
        a[s] = pivot;
        if (k == s)
            break;
        if (k < s)
            high = s;
        else
            low = s + 1;
    }
    return a[k];
}

/* Quantile of the finite values of one block that no line takes, at least `least` of them; their number. */
static size_t level_of(const double *power, const unsigned char *out, size_t block, size_t least, double quantile,
                       double *restrict kept, double *level)
{
    size_t count = 0;
    for (size_t i = 0; i < block; i++) {
        kept[count] = power[i];
        count += !out[i] && isfinite(power[i]);
    }
    if (count < least || count == 0)
        return count;
    double at = quantile * (double)(count - 1);
    size_t low = (size_t)at;
    double below = selected(kept, count, low), above = low + 1 < count ? kept[low + 1] : below;
    for (size_t i = low + 2; i < count; i++)
        above = kept[i] < above ? kept[i] : above;
    *level = below + (at - (double)low) * (above - below);
    return count;
}

/* Straight lines in the logarithm between the centres (blocks, rising), level on either side of them. */
FOR_EVERY_CPU static void between(size_t n, size_t blocks, const double *centre, const double *log_level,
                                  double *restrict floor)
{
    size_t i = 0;
    double first = exp(log_level[0]), last = exp(log_level[blocks - 1]);
    while (i < n && (double)i <= centre[0])
        floor[i++] = first;
    for (size_t b = 1; b < blocks; b++) {
        double slope = (log_level[b] - log_level[b - 1]) / (centre[b] - centre[b - 1]), ratio = exp(slope), value = 0.0;
        for (size_t k = 0; i < n && (double)i <= centre[b]; i++, k++) {
            value = k % ANCHOR ? value * ratio : exp(log_level[b - 1] + slope * ((double)i - centre[b - 1]));
            floor[i] = value;
        }
    }
    while (i < n)
        floor[i++] = last;
}

/* Which bins stand out of the floor, or lie beside one that does, or are known to be a line's. `high` has room for n. */
FOR_EVERY_CPU static void lines_of(size_t n, const double *power, const double *floor, double over,
                                   const unsigned char *known, unsigned char *restrict high, unsigned char *restrict out)
{
    INDEPENDENT
    for (size_t i = 0; i < n; i++)
        high[i] = power[i] > over * floor[i];
    for (size_t i = 0; i < n; i++)
        out[i] = (unsigned char)(known[i] | high[i] | (i ? high[i - 1] : 0) | (i + 1 < n ? high[i + 1] : 0));
}

/* Median of the counts (blocks), each at most `most`; `seen` has room for most + 1. */
static double median_of(size_t blocks, const size_t *count, size_t most, size_t *restrict seen)
{
    memset(seen, 0, (most + 1) * sizeof *seen);
    for (size_t b = 0; b < blocks; b++)
        seen[count[b]]++;
    size_t below = 0, low = most + 1;
    for (size_t c = 0; c <= most; c++) {
        below += seen[c];
        if (low > most && below > (blocks - 1) / 2)
            low = c;
        if (below > blocks / 2)
            return 0.5 * (double)(low + c);
    }
    return (double)most;
}

typedef struct {
    size_t block, count;  /* bins of a block, and how many blocks there are */
    size_t *start, *kept; /* of every block: first bin, and bins that are no line's */
    double *level;        /* quantile of these */
    size_t *good, *seen;  /* numbers of kept bins of the blocks that have enough; room for `median_of` */
    double *centre, *log_level, *sorted;
    unsigned char *out, *before, *high; /* bins of lines, those of the pass before, and room */
} work;

static void *taken(char **next, size_t bytes)
{
    void *here = *next;
    *next += (bytes + 7) / 8 * 8;
    return here;
}

/* All room in one piece, for the caller to free; NULL without memory. */
static void *new_work(work *w, size_t n, size_t block)
{
    size_t half = block / 2 > 1 ? block / 2 : 1, regular = (n - block) / half + 1;
    w->block = block;
    w->count = regular + ((n - block) % half ? 1 : 0);
    char *room = malloc(w->count * (3 * sizeof(size_t) + 3 * sizeof(double)) + (block + 1) * sizeof(size_t) +
                        (block + 1) * sizeof(double) + 3 * (n + 8)), *next = room;
    if (!room)
        return NULL;
    w->start = taken(&next, w->count * sizeof(size_t));
    w->kept = taken(&next, w->count * sizeof(size_t));
    w->good = taken(&next, w->count * sizeof(size_t));
    w->level = taken(&next, w->count * sizeof(double));
    w->centre = taken(&next, w->count * sizeof(double));
    w->log_level = taken(&next, w->count * sizeof(double));
    w->seen = taken(&next, (block + 1) * sizeof(size_t));
    w->sorted = taken(&next, (block + 1) * sizeof(double));
    w->out = taken(&next, n);
    w->before = taken(&next, n);
    w->high = taken(&next, n);
    for (size_t b = 0; b < w->count; b++)
        w->start[b] = b < regular ? b * half : n - block;
    return room;
}

/* Floor (n) of the power (n), n >= block, and the degrees of freedom of the typical block.

   known        (n) not 0 where a bin is known to be a line's
   least        bins that a block needs
   bias         of the median of so many values (block + 1); `first_bias` of the quantile `first`, of the first pass
   clipped      probability at which a bin is taken for a line's
   correlation  of neighbouring bins

   Blocks whose bins have not changed since the pass before keep their level. Returns 0, LINES_FILL_ALL, or -1. */
int noise_floor(int64_t bins, const double *power, const unsigned char *known, int64_t block, int64_t least,
                const double *bias, double first, double first_bias, double clipped, double correlation, int64_t passes,
                double *floor, double *freedom)
{
    size_t n = (size_t)bins;
    work w;
    void *room = new_work(&w, n, (size_t)block);
    if (!room)
        return -1;
    memcpy(w.out, known, n);
    int status = 0;
    for (int64_t pass = 0; pass < passes; pass++) {
        size_t good = 0, changed = 0;
        for (size_t b = 0; b < w.count; b++) {
            const unsigned char *out = w.out + w.start[b];
            if (pass < 2 || memcmp(out, w.before + w.start[b], w.block)) {
                w.kept[b] = level_of(power + w.start[b], out, w.block, (size_t)least, pass ? 0.5 : first, w.sorted,
                                     w.level + b);
                changed++;
            }
            if (w.kept[b] < (size_t)least)
                continue;
            double level = w.level[b] / (pass ? bias[w.kept[b]] : first_bias);
            w.good[good] = w.kept[b];
            w.centre[good] = (double)w.start[b] + 0.5 * (double)(w.block - 1);
            w.log_level[good++] = log(level > DBL_MIN ? level : DBL_MIN);
        }
        if (!good) {
            status = LINES_FILL_ALL;
            break;
        }
        if (!changed)
            break;
        between(n, good, w.centre, w.log_level, floor);
        *freedom = LN2 * LN2 * median_of(good, w.good, w.block, w.seen) / correlation;
        memcpy(w.before, w.out, n);
        lines_of(n, power, floor, *freedom * expm1(-log(clipped) / *freedom), known, w.high, w.out);
    }
    free(room);
    return status;
}
