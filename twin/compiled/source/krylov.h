/* GMRES for the balance in one precision: REAL is double or float, NAME(x) the name of x in it. See balance.c. */

typedef struct {
    const plan *plan;
    size_t n, m, actions, low;
    const float *low_inverse;
    const REAL *weight, *ratios;             /* (2m), (a, 2m) */
    const REAL *varying, *action_tangents;   /* (n), (a, n) */
    REAL *lines, *motion, *work;             /* (2m), (n), (n) */
    REAL *basis;                             /* (LONGEST + 1, 2m) */
} NAME(operator);

FOR_EVERY_CPU static REAL NAME(dot)(const REAL *restrict a, const REAL *restrict b, size_t count)
{
    REAL total = 0;
    for (size_t i = 0; i < count; i++)
        total += a[i] * b[i];
    return total;
}

FOR_EVERY_CPU static void NAME(add)(REAL *restrict to, REAL factor, const REAL *restrict what, size_t count)
{
    for (size_t i = 0; i < count; i++)
        to[i] += factor * what[i];
}

/* out = a*b of complex lines */
FOR_EVERY_CPU static void NAME(multiply)(const REAL *restrict a, const REAL *restrict b, REAL *restrict out, size_t m)
{
    for (size_t k = 0; k < m; k++) {
        out[k] = a[k] * b[k] - a[m + k] * b[m + k];
        out[m + k] = a[k] * b[m + k] + a[m + k] * b[k];
    }
}

FOR_EVERY_CPU static void NAME(add_product)(REAL *restrict to, const REAL *restrict a, const REAL *restrict b, size_t m)
{
    for (size_t k = 0; k < m; k++) {
        to[k] += a[k] * b[k] - a[m + k] * b[m + k];
        to[m + k] += a[k] * b[m + k] + a[m + k] * b[k];
    }
}

FOR_EVERY_CPU static void NAME(times)(const REAL *restrict a, const REAL *restrict b, REAL *restrict out, size_t n)
{
    for (size_t i = 0; i < n; i++)
        out[i] = a[i] * b[i];
}

/* Sum of squares, piece by piece. */
static double NAME(square)(const REAL *values, size_t count)
{
    double total = 0.0;
    for (size_t start = 0; start < count; start += PIECE) {
        size_t length = count - start < PIECE ? count - start : PIECE;
        total += NAME(dot)(values + start, values + start, length);
    }
    return total;
}

/* out = P u */
static void NAME(precondition)(const NAME(operator) *s, const REAL *u, REAL *out)
{
    size_t m = s->m, low = s->low;
    memcpy(out, u, 2 * m * sizeof(REAL));
    if (!low)
        return;
    float *given = (float *)s->work; /* 2*low <= n/2 singles */
    for (size_t k = 0; k < low; k++) {
        given[k] = (float)u[k];
        given[low + k] = (float)u[m + k];
    }
    for (size_t k = 0; k < low; k++) {
        out[k] = dot_low(s->low_inverse + k * 2 * low, given, 2 * low);
        out[m + k] = dot_low(s->low_inverse + (low + k) * 2 * low, given, 2 * low);
    }
}

/* out = A u */
static void NAME(product)(const NAME(operator) *s, const REAL *u, REAL *out)
{
    size_t n = s->n, m = s->m;
    NAME(precondition)(s, u, out);
    NAME(multiply)(s->weight, out, s->lines, m);
    NAME(fft_to_samples)(s->plan, s->lines, s->motion);
    NAME(times)(s->varying, s->motion, s->work, n);
    NAME(fft_to_lines)(s->plan, s->work, s->lines);
    NAME(add)(out, 1, s->lines, 2 * m);
    for (size_t c = 0; c < s->actions; c++) {
        NAME(times)(s->action_tangents + c * n, s->motion, s->work, n);
        NAME(fft_to_lines)(s->plan, s->work, s->lines);
        NAME(add_product)(out, s->ratios + 2 * c * m, s->lines, m);
    }
}

/* Takes from w (all) its parts h (count) along orthogonal vectors of length 1, piece by piece, so that w is read once for
   all of them; adds the parts to `column` and returns the length that is left. */
FOR_EVERY_CPU static double NAME(orthogonalise)(const REAL *restrict basis, int count, REAL *restrict w, size_t all,
                                                double *restrict column)
{
    double h[LONGEST] = {0.0}, left = 0.0;
    for (size_t start = 0; start < all; start += PIECE) {
        size_t length = all - start < PIECE ? all - start : PIECE;
        for (int i = 0; i < count; i++)
            h[i] += NAME(dot)(basis + (size_t)i * all + start, w + start, length);
    }
    for (size_t start = 0; start < all; start += PIECE) {
        size_t length = all - start < PIECE ? all - start : PIECE;
        for (int i = 0; i < count; i++)
            NAME(add)(w + start, (REAL)-h[i], basis + (size_t)i * all + start, length);
        left += NAME(dot)(w + start, w + start, length);
    }
    for (int i = 0; i < count; i++)
        column[i] += h[i];
    return sqrt(left);
}

/* out with |A out - right| <= tolerance |right|, or as near as LONGEST steps come; returns the number of products. */
static int64_t NAME(krylov)(const NAME(operator) *s, const REAL *right, double tolerance, REAL *out)
{
    size_t all = 2 * s->m;
    double R[LONGEST][LONGEST], cosine[LONGEST], sine[LONGEST], remaining[LONGEST + 1], column[LONGEST + 1];
    double size = sqrt(NAME(square)(right, all));
    memset(out, 0, all * sizeof(REAL));
    if (size == 0.0)
        return 0;
    for (size_t k = 0; k < all; k++)
        s->basis[k] = right[k] / (REAL)size;
    remaining[0] = size;
    int steps = 0;
    int64_t products = 0;
    for (int j = 0; j < LONGEST; j++) {
        REAL *w = s->basis + (size_t)(j + 1) * all;
        NAME(product)(s, s->basis + (size_t)j * all, w);
        products++;
        double before = sqrt(NAME(square)(w, all)), length = before;
        memset(column, 0, sizeof column);
        for (int turn = 0; turn < 2; turn++) { /* once more where one pass has lost orthogonality */
            length = NAME(orthogonalise)(s->basis, j + 1, w, all, column);
            if (length > 0.1 * before)
                break;
        }
        for (int i = 0; i < j; i++) {
            double a = column[i], b = column[i + 1];
            column[i] = cosine[i] * a + sine[i] * b;
            column[i + 1] = cosine[i] * b - sine[i] * a;
        }
        double diagonal = hypot(column[j], length);
        if (diagonal == 0.0) /* the operator is singular in this direction: nothing more to gain */
            break;
        cosine[j] = column[j] / diagonal;
        sine[j] = length / diagonal;
        column[j] = diagonal;
        for (int i = 0; i <= j; i++)
            R[i][j] = column[i];
        remaining[j + 1] = -sine[j] * remaining[j];
        remaining[j] *= cosine[j];
        steps = j + 1;
        if (fabs(remaining[j + 1]) <= tolerance * size || length == 0.0)
            break;
        for (size_t k = 0; k < all; k++)
            w[k] /= (REAL)length;
    }
    for (int i = steps - 1; i >= 0; i--) {
        for (int k = i + 1; k < steps; k++)
            remaining[i] -= R[i][k] * remaining[k];
        remaining[i] /= R[i][i];
    }
    for (int i = 0; i < steps; i++)
        NAME(add)(out, (REAL)remaining[i], s->basis + (size_t)i * all, all);
    return products;
}
