/* The transforms of fft.c in one precision: REAL is double or float, NAME(x) the name of x in it. */

typedef REAL NAME(lanes) __attribute__((vector_size(LANES * sizeof(REAL)), aligned(sizeof(REAL)), may_alias));

typedef struct {
    size_t radix, length, stride; /* of this pass: transforms of `length` points, `stride` of them side by side */
    const REAL *cosine, *sine;    /* of the twiddles e^{-2 pi i p k/length}, k = 1 ... radix - 1, p < length/radix */
    const REAL *root;             /* e^{-2 pi i k/radix}: cosines, then sines */
} NAME(pass);

typedef struct {
    size_t samples, half, passes;
    NAME(pass) pass[MOST_FACTORS];
    REAL *table;      /* all twiddles */
    const REAL *turn; /* of the split: cos and sin of pi k/half, k <= half/2 */
    REAL *scratch;    /* two complex records of half the length, and the pairs of an odd radix */
} NAME(tables);

static void NAME(angles)(REAL *cosine, REAL *sine, size_t count, size_t step, size_t length)
{
    for (size_t p = 0; p < count; p++) {
        double angle = TURN * (double)((p * step) % length) / (double)length;
        cosine[p] = (REAL)cos(angle);
        sine[p] = (REAL)-sin(angle);
    }
}

/* Returns whether there was memory. */
static int NAME(prepare)(NAME(tables) *p, size_t n)
{
    size_t half = n / 2, room = 2 * (half / 2 + 1), left = half, most = 0;
    while (left > 1) {
        size_t r = radix_of(left);
        room += 2 * (r - 1) * (left / r) + 2 * r;
        most = r > most ? r : most;
        left /= r;
    }
    p->samples = n;
    p->half = half;
    p->table = malloc((room + 4 * half + 4 * most * LANES) * sizeof(REAL));
    if (!p->table)
        return 0;
    REAL *next = p->table;
    size_t stride = 1;
    for (left = half; left > 1;) {
        size_t r = radix_of(left), m = left / r;
        NAME(pass) *q = &p->pass[p->passes++];
        q->radix = r;
        q->length = left;
        q->stride = stride;
        q->cosine = next;
        q->sine = next + (r - 1) * m;
        for (size_t k = 1; k < r; k++)
            NAME(angles)(next + (k - 1) * m, next + (r - 1 + k - 1) * m, m, k, left);
        next += 2 * (r - 1) * m;
        NAME(angles)(next, next + r, r, 1, r);
        q->root = next;
        next += 2 * r;
        stride *= r;
        left = m;
    }
    p->turn = next;
    NAME(angles)(next, next + half / 2 + 1, half / 2 + 1, 1, n);
    next += 2 * (half / 2 + 1);
    p->scratch = next;
    return 1;
}

/* One pass over split records: y[q + s(rp + k)] = w^(pk) * sum_j x[q + s(p + jm)] e^{-2 pi i jk/r} */

FOR_EVERY_CPU static void NAME(pass4)(const NAME(pass) *f, const REAL *restrict xr, const REAL *restrict xi,
                                REAL *restrict yr, REAL *restrict yi)
{
    size_t s = f->stride, m = f->length / 4, ms = m * s;
    for (size_t p = 0; p < m; p++) {
        REAL c1 = f->cosine[p], s1 = f->sine[p], c2 = f->cosine[m + p], s2 = f->sine[m + p];
        REAL c3 = f->cosine[2 * m + p], s3 = f->sine[2 * m + p];
        const REAL *restrict ar = xr + s * p, *restrict ai = xi + s * p;
        REAL *restrict br = yr + 4 * s * p, *restrict bi = yi + 4 * s * p;
        INDEPENDENT
        for (size_t q = 0; q < s; q++) {
            REAL er = ar[q] + ar[q + 2 * ms], ei = ai[q] + ai[q + 2 * ms];
            REAL fr = ar[q] - ar[q + 2 * ms], fi = ai[q] - ai[q + 2 * ms];
            REAL gr = ar[q + ms] + ar[q + 3 * ms], gi = ai[q + ms] + ai[q + 3 * ms];
            REAL hr = ai[q + ms] - ai[q + 3 * ms], hi = ar[q + 3 * ms] - ar[q + ms]; /* -i times the difference */
            REAL ur = fr + hr, ui = fi + hi, vr = er - gr, vi = ei - gi, wr = fr - hr, wi = fi - hi;
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
FOR_EVERY_CPU static void NAME(pass4_first)(const NAME(pass) *f, const REAL *restrict xr, const REAL *restrict xi,
                                      REAL *restrict yr, REAL *restrict yi)
{
    size_t m = f->length / 4;
    const REAL *restrict c1 = f->cosine, *restrict c2 = c1 + m, *restrict c3 = c2 + m;
    const REAL *restrict s1 = f->sine, *restrict s2 = s1 + m, *restrict s3 = s2 + m;
    INDEPENDENT
    for (size_t p = 0; p < m; p++) {
        REAL er = xr[p] + xr[p + 2 * m], ei = xi[p] + xi[p + 2 * m];
        REAL fr = xr[p] - xr[p + 2 * m], fi = xi[p] - xi[p + 2 * m];
        REAL gr = xr[p + m] + xr[p + 3 * m], gi = xi[p + m] + xi[p + 3 * m];
        REAL hr = xi[p + m] - xi[p + 3 * m], hi = xr[p + 3 * m] - xr[p + m];
        REAL ur = fr + hr, ui = fi + hi, vr = er - gr, vi = ei - gi, wr = fr - hr, wi = fi - hi;
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

FOR_EVERY_CPU static void NAME(pass2)(const NAME(pass) *f, const REAL *restrict xr, const REAL *restrict xi,
                                REAL *restrict yr, REAL *restrict yi)
{
    size_t s = f->stride, m = f->length / 2, ms = m * s;
    for (size_t p = 0; p < m; p++) {
        REAL c = f->cosine[p], w = f->sine[p];
        INDEPENDENT
        for (size_t q = 0; q < s; q++) {
            REAL ar = xr[q + s * p], ai = xi[q + s * p], br = xr[q + s * p + ms], bi = xi[q + s * p + ms];
            REAL dr = ar - br, di = ai - bi;
            yr[q + 2 * s * p] = ar + br;
            yi[q + 2 * s * p] = ai + bi;
            yr[q + 2 * s * p + s] = c * dr - w * di;
            yi[q + 2 * s * p + s] = c * di + w * dr;
        }
    }
}

/* Of an odd radix, points j and r - j, and results k and r - k, in pairs: 2 LANES places side by side, so that their sums
   stay in registers. `pairs` has room for 4(r - 1) LANES. */
FOR_EVERY_CPU static void NAME(odd_lanes)(const NAME(pass) *f, size_t p, const REAL *restrict ar,
                                          const REAL *restrict ai, REAL *restrict br, REAL *restrict bi,
                                          REAL *restrict pairs)
{
    size_t r = f->radix, s = f->stride, m = f->length / r, ms = m * s, h = (r - 1) / 2;
    NAME(lanes) first[4], total[4];
    for (size_t i = 0; i < 4; i++)
        total[i] = first[i] = *(const NAME(lanes) *)((i < 2 ? ar : ai) + i % 2 * LANES);
    for (size_t j = 1; j <= h; j++)
        for (size_t i = 0; i < 4; i++) {
            const REAL *a = (i < 2 ? ar : ai) + i % 2 * LANES;
            NAME(lanes) one = *(const NAME(lanes) *)(a + j * ms), other = *(const NAME(lanes) *)(a + (r - j) * ms);
            *(NAME(lanes) *)(pairs + (8 * j - 8 + i) * LANES) = one + other;
            *(NAME(lanes) *)(pairs + (8 * j - 4 + i) * LANES) = one - other;
            total[i] += one + other;
        }
    for (size_t i = 0; i < 4; i++)
        *(NAME(lanes) *)((i < 2 ? br : bi) + i % 2 * LANES) = total[i];
    for (size_t k = 1; k <= h; k++) {
        REAL c1 = f->cosine[(k - 1) * m + p], s1 = f->sine[(k - 1) * m + p];
        REAL c2 = f->cosine[(r - k - 1) * m + p], s2 = f->sine[(r - k - 1) * m + p];
        NAME(lanes) a0 = first[0], a1 = first[1], b0 = first[2], b1 = first[3];
        NAME(lanes) d0 = {0}, d1 = {0}, e0 = {0}, e1 = {0};
        const NAME(lanes) *at = (const NAME(lanes) *)pairs;
        for (size_t j = 0, turned = k; j < h; j++, at += 8) {
            REAL c = f->root[turned], w = f->root[r + turned];
            a0 += c * at[0];
            a1 += c * at[1];
            b0 += c * at[2];
            b1 += c * at[3];
            e0 += w * at[4];
            e1 += w * at[5];
            d0 -= w * at[6];
            d1 -= w * at[7];
            turned = turned + k < r ? turned + k : turned + k - r;
        }
        NAME(lanes) *ur = (NAME(lanes) *)(br + k * s), *ui = (NAME(lanes) *)(bi + k * s);
        NAME(lanes) *vr = (NAME(lanes) *)(br + (r - k) * s), *vi = (NAME(lanes) *)(bi + (r - k) * s);
        ur[0] = c1 * (a0 + d0) - s1 * (b0 + e0);
        ur[1] = c1 * (a1 + d1) - s1 * (b1 + e1);
        ui[0] = c1 * (b0 + e0) + s1 * (a0 + d0);
        ui[1] = c1 * (b1 + e1) + s1 * (a1 + d1);
        vr[0] = c2 * (a0 - d0) - s2 * (b0 - e0);
        vr[1] = c2 * (a1 - d1) - s2 * (b1 - e1);
        vi[0] = c2 * (b0 - e0) + s2 * (a0 - d0);
        vi[1] = c2 * (b1 - e1) + s2 * (a1 - d1);
    }
}

/* The same of one place. */
FOR_EVERY_CPU static void NAME(odd_point)(const NAME(pass) *f, size_t p, const REAL *restrict ar,
                                          const REAL *restrict ai, REAL *restrict br, REAL *restrict bi,
                                          REAL *restrict pairs)
{
    size_t r = f->radix, s = f->stride, m = f->length / r, ms = m * s, h = (r - 1) / 2;
    REAL *restrict sr = pairs, *restrict si = sr + h, *restrict dr = si + h, *restrict di = dr + h;
    REAL real = ar[0], imag = ai[0];
    for (size_t j = 1; j <= h; j++) {
        sr[j - 1] = ar[j * ms] + ar[(r - j) * ms];
        si[j - 1] = ai[j * ms] + ai[(r - j) * ms];
        dr[j - 1] = ar[j * ms] - ar[(r - j) * ms];
        di[j - 1] = ai[j * ms] - ai[(r - j) * ms];
        real += sr[j - 1];
        imag += si[j - 1];
    }
    br[0] = real;
    bi[0] = imag;
    for (size_t k = 1; k <= h; k++) {
        REAL c1 = f->cosine[(k - 1) * m + p], s1 = f->sine[(k - 1) * m + p];
        REAL c2 = f->cosine[(r - k - 1) * m + p], s2 = f->sine[(r - k - 1) * m + p];
        REAL a = ar[0], b = ai[0], d = 0, e = 0;
        for (size_t j = 0, turned = k; j < h; j++) {
            REAL c = f->root[turned], w = f->root[r + turned];
            a += c * sr[j];
            b += c * si[j];
            d -= w * di[j];
            e += w * dr[j];
            turned = turned + k < r ? turned + k : turned + k - r;
        }
        br[k * s] = c1 * (a + d) - s1 * (b + e);
        bi[k * s] = c1 * (b + e) + s1 * (a + d);
        br[(r - k) * s] = c2 * (a - d) - s2 * (b - e);
        bi[(r - k) * s] = c2 * (b - e) + s2 * (a - d);
    }
}

FOR_EVERY_CPU static void NAME(pass_odd)(const NAME(pass) *f, const REAL *restrict xr, const REAL *restrict xi,
                                         REAL *restrict yr, REAL *restrict yi, REAL *restrict pairs)
{
    size_t r = f->radix, s = f->stride, m = f->length / r;
    for (size_t p = 0; p < m; p++)
        for (size_t q = 0; q < s;) {
            size_t at = s * p + q, to = s * r * p + q;
            if (q + 2 * LANES <= s) {
                NAME(odd_lanes)(f, p, xr + at, xi + at, yr + to, yi + to, pairs);
                q += 2 * LANES;
            } else {
                NAME(odd_point)(f, p, xr + at, xi + at, yr + to, yi + to, pairs);
                q++;
            }
        }
}

/* The complex transform of the record in x; returns whether the result is in y rather than in x. */
static int NAME(transform)(const NAME(tables) *p, REAL *xr, REAL *xi, REAL *yr, REAL *yi)
{
    int swapped = 0;
    for (size_t i = 0; i < p->passes; i++) {
        const NAME(pass) *f = &p->pass[i];
        REAL *ar = swapped ? yr : xr, *ai = swapped ? yi : xi, *br = swapped ? xr : yr, *bi = swapped ? xi : yi;
        if (f->radix == 4 && f->stride == 1)
            NAME(pass4_first)(f, ar, ai, br, bi);
        else if (f->radix == 4)
            NAME(pass4)(f, ar, ai, br, bi);
        else if (f->radix == 2)
            NAME(pass2)(f, ar, ai, br, bi);
        else
            NAME(pass_odd)(f, ar, ai, br, bi, p->scratch + 4 * p->half);
        swapped = !swapped;
    }
    return swapped;
}

FOR_EVERY_CPU static void NAME(lines_of)(const NAME(tables) *p, const REAL *samples, REAL *lines)
{
    size_t h = p->half, m = h + 1;
    REAL *xr = p->scratch, *xi = xr + h, *yr = xr + 2 * h, *yi = xr + 3 * h;
    INDEPENDENT
    for (size_t k = 0; k < h; k++) {
        xr[k] = samples[2 * k];
        xi[k] = samples[2 * k + 1];
    }
    int swapped = NAME(transform)(p, xr, xi, yr, yi);
    const REAL *zr = swapped ? yr : xr, *zi = swapped ? yi : xi;
    const REAL *cosine = p->turn, *sine = p->turn + h / 2 + 1; /* e^{-pi i k/h} */
    REAL scale = (REAL)0.5 / (REAL)p->samples;
    REAL *restrict real = lines, *restrict imag = lines + m;
    real[0] = 2 * scale * (zr[0] + zi[0]);
    real[h] = 2 * scale * (zr[0] - zi[0]);
    imag[0] = imag[h] = 0.0;
    INDEPENDENT
    for (size_t k = 1; k <= h / 2; k++) {
        REAL er = zr[k] + zr[h - k], ei = zi[k] - zi[h - k];                 /* of the even samples */
        REAL or = zi[k] + zi[h - k], oi = zr[h - k] - zr[k];                 /* of the odd samples */
        REAL tr = cosine[k] * or - sine[k] * oi, ti = cosine[k] * oi + sine[k] * or;
        real[k] = scale * (er + tr);
        imag[k] = scale * (ei + ti);
        real[h - k] = scale * (er - tr);
        imag[h - k] = scale * (ti - ei);
    }
}

FOR_EVERY_CPU static void NAME(samples_of)(const NAME(tables) *p, const REAL *lines, REAL *samples)
{
    size_t h = p->half, m = h + 1;
    REAL *xr = p->scratch, *xi = xr + h, *yr = xr + 2 * h, *yi = xr + 3 * h;
    const REAL *restrict real = lines, *restrict imag = lines + m;
    const REAL *cosine = p->turn, *sine = p->turn + h / 2 + 1;
    xr[0] = real[0] + real[h];
    xi[0] = -(real[0] - real[h]); /* conjugated: the inverse is the conjugate of the transform of the conjugate */
    INDEPENDENT
    for (size_t k = 1; k <= h / 2; k++) {
        REAL er = real[k] + real[h - k], ei = imag[k] - imag[h - k];
        REAL dr = real[k] - real[h - k], di = imag[k] + imag[h - k];
        REAL or = cosine[k] * dr + sine[k] * di, oi = cosine[k] * di - sine[k] * dr; /* times e^{+pi i k/h} */
        xr[k] = er - oi;
        xi[k] = -(ei + or);
        xr[h - k] = er + oi;
        xi[h - k] = -(or - ei);
    }
    int swapped = NAME(transform)(p, xr, xi, yr, yi);
    const REAL *zr = swapped ? yr : xr, *zi = swapped ? yi : xi;
    INDEPENDENT
    for (size_t k = 0; k < h; k++) {
        samples[2 * k] = zr[k];
        samples[2 * k + 1] = -zi[k];
    }
}
