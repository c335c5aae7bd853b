/* Order statistics by counting: the bits of a double, its sign turned, rise with its value.

   Source: D. E. Knuth, The Art of Computer Programming 3, 2nd ed., sec. 5.2.5 (radix sorting), 5.3.3 (selection) */

#include "kernels.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FIRST = 14, NEXT = 10, BINS = 1 << FIRST }; /* bits that the first count looks at, and each of those after it */

static inline uint64_t key_of(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits >> 63 ? ~bits : bits | (uint64_t)1 << 63;
}

static double value_of(uint64_t key)
{
    uint64_t bits = key >> 63 ? key & ~((uint64_t)1 << 63) : ~key;
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static inline int is_finite(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (bits >> 52 & 0x7ff) != 0x7ff;
}

/* The value itself, or its distance from a centre. */
static inline double seen(double x, double centre, int apart) { return apart ? fabs(x - centre) : x; }

/* How many of the finite values have each of the first digits, counted in two tables by turns; their number. */
static inline size_t counted(const double *x, size_t n, double centre, int apart, uint32_t *count)
{
    uint32_t *tables[2] = {count, count + BINS};
    size_t finite = 0;
    memset(count, 0, 2 * BINS * sizeof *count);
    for (size_t i = 0; i < n; i++) {
        uint32_t known = (uint32_t)is_finite(x[i]);
        tables[i & 1][key_of(seen(x[i], centre, apart)) >> (64 - FIRST)] += known;
        finite += known;
    }
    for (size_t digit = 0; digit < BINS; digit++)
        count[digit] += count[BINS + digit];
    return finite;
}

/* The value of a rank among n keys, which are moved. */
static double of_rank(uint64_t *keys, size_t n, size_t rank, uint32_t *count)
{
    for (int shift = 64 - FIRST; n > 1 && shift > 0;) {
        int bits = shift < NEXT ? shift : NEXT;
        uint64_t mask = ((uint64_t)1 << bits) - 1;
        shift -= bits;
        memset(count, 0, sizeof *count << bits);
        for (size_t i = 0; i < n; i++)
            count[keys[i] >> shift & mask]++;
        size_t digit = 0, kept = 0;
        while (rank >= count[digit])
            rank -= count[digit++];
        for (size_t i = 0; i < n; i++) {
            keys[kept] = keys[i];
            kept += (keys[i] >> shift & mask) == digit;
        }
        n = kept;
    }
    return value_of(keys[0]);
}

/* The finite values whose first digit is the given one, as keys from `keys` on; room for one more than there are. */
static inline void gathered(const double *x, size_t n, double centre, int apart, size_t digit, uint64_t *keys)
{
    size_t kept = 0;
    for (size_t i = 0; i < n; i++) {
        uint64_t key = key_of(seen(x[i], centre, apart));
        keys[kept] = key;
        kept += (key >> (64 - FIRST) == digit) & is_finite(x[i]);
    }
}

/* The values of two ranks next to each other, or of one twice, among the finite ones; 0 without memory. */
static inline int of_ranks(const double *x, size_t n, double centre, int apart, size_t low, size_t high, uint32_t *count,
                           double *found)
{
    uint32_t *small = count + BINS; /* the second table is free again */
    for (int both = 0, side = 0; side < 2 && !both; side++) {
        size_t rank = side ? high : low, digit = 0;
        while (rank >= count[digit])
            rank -= count[digit++];
        size_t held = count[digit], next = rank + (high - low);
        both = !side && next < held;
        uint64_t *keys = malloc((held + 1 + held) * sizeof *keys);
        if (!keys)
            return 0;
        gathered(x, n, centre, apart, digit, keys);
        memcpy(keys + held + 1, keys, held * sizeof *keys);
        found[side] = of_rank(keys, held, rank, small);
        if (both)
            found[1] = of_rank(keys + held + 1, held, next, small);
        free(keys);
    }
    return 1;
}

/* Of the finite ones among n values: their number, and the median, the mean of the two in the middle where it is even.
   −1 without memory. */
static inline int64_t median(const double *x, size_t n, double centre, int apart, uint32_t *count, double *out)
{
    size_t finite = counted(x, n, centre, apart, count);
    double found[2] = {NAN, NAN};
    if (finite && !of_ranks(x, n, centre, apart, (finite - 1) / 2, finite / 2, count, found))
        return -1;
    *out = 0.5 * (found[0] + found[1]);
    return (int64_t)finite;
}

FOR_EVERY_CPU static void extremes(const double *x, size_t n, double *low, double *high)
{
    double least = INFINITY, most = -INFINITY;
    for (size_t i = 0; i < n; i++) {
        int known = fabs(x[i]) <= DBL_MAX; /* not of NaN */
        double a = known ? x[i] : INFINITY, b = known ? x[i] : -INFINITY;
        least = a < least ? a : least;
        most = b > most ? b : most;
    }
    *low = least;
    *high = most;
}

/* Of the finite ones among n values: lowest, highest, and how many are equal to each; their number. */
FOR_EVERY_CPU int64_t at_extremes(int64_t n, const double *values, double *out)
{
    double low, high;
    int64_t finite = 0, lowest = 0, highest = 0;
    extremes(values, (size_t)n, &low, &high);
    for (int64_t i = 0; i < n; i++) {
        finite += fabs(values[i]) <= DBL_MAX; /* not of NaN */
        lowest += values[i] == low;
        highest += values[i] == high;
    }
    out[0] = low;
    out[1] = high;
    out[2] = finite ? (double)lowest : 0.0;
    out[3] = finite ? (double)highest : 0.0;
    return finite;
}

enum { LOOKED_AT = 255 }; /* values by which the median is guessed */

static int rising(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* 1 where no finite value of n can lie further than so many times the median distance from the median, which takes no
   order: 0 where it may. If the median lies between two bounds, and fewer than half of the values lie less than D beyond
   them, the median distance is D at least. */
FOR_EVERY_CPU int64_t all_near(int64_t n, const double *values, double times)
{
    double some[LOOKED_AT], low, high;
    int64_t finite = 0, below = 0, above = 0, close = 0;
    size_t seen_of = 0, stride = (size_t)n / LOOKED_AT + 1;
    for (size_t i = 0; i < (size_t)n; i += stride)
        if (is_finite(values[i]))
            some[seen_of++] = values[i];
    if (!seen_of)
        return 0;
    qsort(some, seen_of, sizeof *some, rising);
    double from = some[seen_of * 2 / 5], to = some[seen_of * 3 / 5];
    extremes(values, (size_t)n, &low, &high);
    double furthest = high - from > to - low ? high - from : to - low, least = furthest / times;
    double begin = from - least, end = to + least;
    for (int64_t i = 0; i < n; i++) {
        double x = values[i];
        finite += fabs(x) <= DBL_MAX; /* not of NaN */
        below += (x >= -DBL_MAX) & (x < from);
        above += (x <= DBL_MAX) & (x > to);
        close += (x > begin) & (x < end);
    }
    int64_t half = (finite - 1) / 2;
    return below <= half && above <= half && close <= half && furthest > 0.0;
}

/* Of the finite ones among n values: lowest, highest, median, and median distance from the median; their number, or −1. */
int64_t middle(int64_t n_, const double *values, double *out)
{
    size_t n = (size_t)n_;
    uint32_t *count = malloc(2 * BINS * sizeof *count);
    if (!count)
        return -1;
    extremes(values, n, &out[0], &out[1]);
    int64_t finite = median(values, n, 0.0, 0, count, &out[2]);
    if (finite > 0)
        finite = median(values, n, out[2], 1, count, &out[3]);
    free(count);
    return finite;
}
