/* The balance of one period: contacts in time, structure in lines; Newton's method with GMRES.

       R(d) = lines(F) + sum_c r_c lines(A_c) + (d - d_driven)/G - F_mean
       A u  = u + lines(t samples(w P u)) + sum_c r_c lines(t_c samples(w P u)),   w = (1 + i omega tau)/(k (1 + i omega tau) + 1/G)

   P is the inverse of A on the lowest lines where it is given, and the identity on the others. Lines are vectors over the
   reals: a product with a signal in time mixes lines and their conjugates. Over long periods GMRES works in single
   precision, whose error the next step of Newton's method takes away. See twin/dynamics/harmonic_balance.py.

   Source: C. T. Kelley, Solving Nonlinear Equations with Newton's Method, SIAM 2003, ch. 3; Y. Saad, M. H. Schultz, SIAM
   J. Sci. Stat. Comput. 7 (1986) 856-869 */

#include "kernels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_STALLED = 12, MAX_HALVINGS = 8, LONGEST = 120, RESTARTS = 6, BLOCK = 64, PIECE = 2048, LONG = 8192, MOST_ROUNDED = 16 };

FOR_EVERY_CPU static float dot_low(const float *restrict a, const float *restrict b, size_t count)
{
    float total = 0.0f;
    for (size_t i = 0; i < count; i++)
        total += a[i] * b[i];
    return total;
}

#define REAL double
#define NAME(x) x
#include "krylov.h"
#undef REAL
#undef NAME

#define REAL float
#define NAME(x) x##_single
#include "krylov.h"

static const double SINGLE = 1e-6; /* least relative tolerance of a linear solution in single precision */
static const double LEAST = 0.1;   /* slope of the contacts, of its mean, below which all count alike in a harmonic mean */
static const double LOOSEST = 0.05, SHARE = 0.3, LAST = 0.03; /* of a Newton step over a long period, see below */

typedef struct {
    const balance *of;
    const plan *plan;
    size_t n, m, actions;
    double *lines, *correction, *weight, *scale, *residual, *trial, *found; /* 2m each */
    double *motion, *work, *force, *varying;                              /* n each */
    double *action_forces;                                                /* (a, n) */
    double *basis;                                                        /* (LONGEST + 1, 2m) */
} space;

/* Room for a balance, and for the forces of so many actions. */
static int open_space(space *s, const balance *b, int64_t actions)
{
    size_t n = (size_t)b->samples, m = n / 2 + 1, a = (size_t)actions;
    *s = (space){.of = b, .plan = fft_plan(n), .n = n, .m = m, .actions = (size_t)b->actions};
    double *next = malloc(((LONGEST + 8) * 2 * m + (4 + a) * n) * sizeof(double));
    if (!next || !s->plan) {
        free(next);
        return 0;
    }
    double **lines[] = {&s->lines, &s->correction, &s->weight, &s->scale, &s->residual, &s->trial, &s->found};
    double **samples[] = {&s->motion, &s->work, &s->force, &s->varying};
    for (size_t i = 0; i < sizeof lines / sizeof *lines; i++, next += 2 * m)
        *lines[i] = next;
    for (size_t i = 0; i < sizeof samples / sizeof *samples; i++, next += n)
        *samples[i] = next;
    s->action_forces = next;
    s->basis = next + a * n;
    return 1;
}

static void close_space(space *s) { free(s->lines); }

FOR_EVERY_CPU static void invert(const double *restrict a, double *restrict out, size_t m)
{
    for (size_t k = 0; k < m; k++) {
        double square = a[k] * a[k] + a[m + k] * a[m + k];
        out[k] = a[k] / square;
        out[m + k] = -a[m + k] / square;
    }
}

/* Adds one contact's force and slope at the motion d + tau*d'. */
FOR_EVERY_CPU static void sharp_contact(const double *restrict motion, const double *restrict k, const double *restrict e,
                                        double side, double *restrict force, double *restrict tangent, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        double x = side * motion[i] + e[i], stiffness = x > 0.0 ? k[i] : 0.0;
        force[i] += side * stiffness * x;
        tangent[i] += stiffness;
    }
}

FOR_EVERY_CPU static void round_contact(const double *restrict motion, const double *restrict k, const double *restrict e,
                                        double side, double rounding, double *restrict force, double *restrict tangent,
                                        size_t n)
{
    for (size_t i = 0; i < n; i++) {
        double x = side * motion[i] + e[i], root = sqrt(x * x + rounding * rounding);
        force[i] += side * k[i] * 0.5 * (x + root);
        tangent[i] += k[i] * 0.5 * (1.0 + x / root);
    }
}

/* The same of an action. */
FOR_EVERY_CPU static void sharp_action(const double *restrict motion, const double *restrict k, const double *restrict e,
                                       const double *restrict weight, double side, double *restrict force,
                                       double *restrict tangent, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        double x = side * motion[i] + e[i], stiffness = x > 0.0 ? weight[i] * k[i] : 0.0;
        force[i] += side * stiffness * x;
        tangent[i] += stiffness;
    }
}

FOR_EVERY_CPU static void round_action(const double *restrict motion, const double *restrict k, const double *restrict e,
                                       const double *restrict weight, double side, double rounding,
                                       double *restrict force, double *restrict tangent, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        double x = side * motion[i] + e[i], root = sqrt(x * x + rounding * rounding);
        force[i] += weight[i] * side * k[i] * 0.5 * (x + root);
        tangent[i] += weight[i] * k[i] * 0.5 * (1.0 + x / root);
    }
}

/* Piece by piece of the record, so that what all contacts add to is read once. */
static void contacts_at(const space *s, double *tangent, double *action_tangents)
{
    const balance *b = s->of;
    size_t n = s->n, p = (size_t)b->contacts;
    memset(s->force, 0, n * sizeof(double));
    memset(tangent, 0, n * sizeof(double));
    if (s->actions) {
        memset(s->action_forces, 0, s->actions * n * sizeof(double));
        memset(action_tangents, 0, s->actions * n * sizeof(double));
    }
    for (size_t start = 0; start < n; start += PIECE) {
        size_t length = n - start < PIECE ? n - start : PIECE;
        const double *motion = s->motion + start;
        for (size_t i = 0; i < p; i++) {
            const double *k = b->stiffness + i * n + start, *e = b->open_by + i * n + start;
            double side = b->side[i], rounding = b->rounding;
            if (rounding > 0.0)
                round_contact(motion, k, e, side, rounding, s->force + start, tangent + start, length);
            else
                sharp_contact(motion, k, e, side, s->force + start, tangent + start, length);
            for (size_t c = 0; c < s->actions; c++) {
                const double *weight = b->weights + (c * p + i) * n + start;
                double *force = s->action_forces + c * n + start, *slope = action_tangents + c * n + start;
                if (rounding > 0.0)
                    round_action(motion, k, e, weight, side, rounding, force, slope, length);
                else
                    sharp_action(motion, k, e, weight, side, force, slope, length);
            }
        }
    }
}

/* Residual at the lines of d; its square over all lines, and the largest of a line. */
static double residual_at(const space *s, const double *d, double *residual, double *tangent, double *action_tangents,
                          double *largest)
{
    const balance *b = s->of;
    size_t m = s->m;
    multiply(b->closing, d, s->lines, m);
    fft_to_samples(s->plan, s->lines, s->motion);
    contacts_at(s, tangent, action_tangents);
    fft_to_lines(s->plan, s->force, residual);
    for (size_t k = 0; k < 2 * m; k++)
        s->lines[k] = d[k] - b->driven[k];
    add_product(residual, b->inverse, s->lines, m);
    for (size_t c = 0; c < s->actions; c++) {
        fft_to_lines(s->plan, s->action_forces + c * s->n, s->lines);
        add_product(residual, b->ratios + 2 * c * m, s->lines, m);
    }
    residual[0] -= b->mean_force;
    double most = 0.0;
    for (size_t k = 0; k < m; k++) {
        double square = residual[k] * residual[k] + residual[m + k] * residual[m + k];
        most = square > most ? square : most;
    }
    *largest = sqrt(most);
    return dot(residual, residual, 2 * m);
}

static double mean_of(const double *values, size_t n)
{
    double total = 0.0;
    for (size_t i = 0; i < n; i++)
        total += values[i];
    return total / (double)n;
}

/* Of values that count as no less than `least` > 0. */
static double harmonic_mean(const double *values, double least, size_t n)
{
    double total = 0.0;
    for (size_t i = 0; i < n; i++)
        total += 1.0 / (values[i] > least ? values[i] : least);
    return (double)n / total;
}

/* Scale 1/(k (1 + i omega tau) + 1/G), weight w, and the slopes' departure from k: their mean, over long periods the
   harmonic one, about which GMRES needs fewer products. */
static void linearise(const space *s, const double *tangent)
{
    const balance *b = s->of;
    double mean = mean_of(tangent, s->n);
    if (mean == 0.0)
        mean = mean_of(b->stiffness, (size_t)b->contacts * s->n);
    else if (s->n > LONG && !b->low) /* the low harmonics are those about the mean itself */
        mean = harmonic_mean(tangent, LEAST * mean, s->n);
    for (size_t i = 0; i < s->n; i++)
        s->varying[i] = tangent[i] - mean;
    for (size_t k = 0; k < 2 * s->m; k++)
        s->lines[k] = mean * b->closing[k] + b->inverse[k];
    invert(s->lines, s->scale, s->m);
    multiply(b->closing, s->scale, s->weight, s->m);
}

static operator operator_of(const space *s, const double *action_tangents)
{
    return (operator){
        .plan = s->plan, .n = s->n, .m = s->m, .actions = (size_t)s->of->actions, .low = (size_t)s->of->low,
        .low_inverse = s->of->low_inverse, .weight = s->weight, .ratios = s->of->ratios, .varying = s->varying,
        .action_tangents = action_tangents, .lines = s->lines, .motion = s->motion, .work = s->work,
        .basis = s->basis,
    };
}

/* A record in single precision, or room for one, at `*next`, which moves on by its length. */
static float *rounded(const double *values, size_t count, float **next)
{
    float *out = *next;
    for (size_t i = 0; values && i < count; i++)
        out[i] = (float)values[i];
    *next += count;
    return out;
}

/* GMRES in single precision, within the room of the basis in double precision. */
static int64_t krylov_rounded(const space *s, const double *right, double tolerance, const double *action_tangents,
                              double *out)
{
    size_t n = s->n, m = s->m, a = (size_t)s->of->actions;
    float *next = (float *)s->basis, *basis = rounded(NULL, (LONGEST + 1) * 2 * m, &next);
    operator_single q = {
        .plan = s->plan, .n = n, .m = m, .actions = a, .low = (size_t)s->of->low, .low_inverse = s->of->low_inverse,
        .basis = basis,
    };
    q.weight = rounded(s->weight, 2 * m, &next);
    q.ratios = rounded(s->of->ratios, a * 2 * m, &next);
    q.varying = rounded(s->varying, n, &next);
    q.action_tangents = rounded(action_tangents, a * n, &next);
    q.lines = rounded(NULL, 2 * m, &next);
    q.motion = rounded(NULL, n, &next);
    q.work = rounded(NULL, n, &next);
    float *found = rounded(NULL, 2 * m, &next);
    int64_t products = krylov_single(&q, rounded(right, 2 * m, &next), tolerance, found);
    for (size_t k = 0; k < 2 * m; k++)
        out[k] = found[k];
    return products;
}

/* out with |A out - right| <= tolerance |right|; returns the number of products. */
static int64_t linear_solution(const space *s, const double *right, double tolerance, const double *action_tangents,
                               double *out)
{
    if (s->n > LONG && tolerance >= SINGLE && (size_t)s->of->actions <= MOST_ROUNDED)
        return krylov_rounded(s, right, tolerance, action_tangents, out);
    operator q = operator_of(s, action_tangents);
    return krylov(&q, right, tolerance, out);
}

static double smallest(const double *values, size_t n)
{
    double least = values[0];
    for (size_t i = 1; i < n; i++)
        least = values[i] < least ? values[i] : least;
    return least;
}

/* The forces of the contacts at s->motion, and their lines; the residual's lines are overwritten. */
static void report(const space *s, const answer *a)
{
    const balance *b = s->of;
    size_t n = s->n, p = (size_t)b->contacts;
    memset(s->force, 0, n * sizeof(double));
    for (size_t i = 0; i < p; i++) {
        const double *k = b->stiffness + i * n, *e = b->open_by + i * n;
        double *out = a->forces + i * n, side = b->side[i];
        for (size_t j = 0; j < n; j++) {
            double x = side * s->motion[j] + e[j];
            double closed = b->rounding > 0.0 ? 0.5 * (x + sqrt(x * x + b->rounding * b->rounding)) : x > 0.0 ? x : 0.0;
            out[j] = k[j] * closed;
            s->force[j] += side * out[j];
        }
    }
    fft_to_lines(s->plan, s->force, a->force_lines);
    for (size_t c = 0; c < s->actions; c++) {
        memset(s->work, 0, n * sizeof(double));
        for (size_t i = 0; i < p; i++) {
            const double *weight = b->weights + (c * p + i) * n, *force = a->forces + i * n;
            for (size_t j = 0; j < n; j++)
                s->work[j] += weight[j] * b->side[i] * force[j];
        }
        fft_to_lines(s->plan, s->work, a->action_lines + 2 * c * s->m);
    }
}

/* How far a Newton step is worth solving for: over long periods as far as the step before came (Eisenstat and Walker's
   second choice), since contacts that open and close undo what is solved more closely. A step that may be the last is
   solved well within the tolerance: what is compared with another solution is left with little of its own error. */
static double linear_tolerance(size_t samples, double size, double tolerance, double came)
{
    if (samples <= LONG)
        return fmin(1e-2, fmax(0.1 * size, 0.1 * tolerance / size));
    double last = LAST * tolerance / size, wanted = SHARE * came;
    return fmin(LOOSEST, fmax(SINGLE, wanted * size < tolerance ? last : fmax(wanted, last)));
}

/* Newton steps towards the motion at which the balance holds, from `deflection` (n), which they overwrite.

   parted      share of the mean slope below which the contacts part, so that no step is taken
   most        Newton steps, products
   so_far      in: `stalled` steps without progress before these; out: all of it
   Returns 0, or -1 where there is no memory. */
int newton(const balance *b, double *deflection, double tolerance, double parted, int64_t most_steps,
           double most_products, progress *so_far, const answer *out)
{
    space s;
    if (!open_space(&s, b, b->actions))
        return -1;
    size_t all = 2 * s.m;
    double *d = malloc(all * sizeof(double));
    if (!d) {
        close_space(&s);
        return -1;
    }
    fft_to_lines(s.plan, deflection, d);
    int64_t iterations = 0, products = 0, stalled = so_far->stalled;
    double step = 0.0, before = 0.0, total = 0.0, size = 0.0;
    for (;;) {
        for (int halving = 0; halving < MAX_HALVINGS; halving++) {
            memcpy(s.trial, d, all * sizeof(double));
            if (step > 0.0)
                add(s.trial, step, s.correction, all);
            total = residual_at(&s, s.trial, s.found, out->tangent, out->action_tangents, &size);
            if (total < before || step == 0.0 || halving == MAX_HALVINGS - 1)
                break;
            step *= 0.5;
        }
        if (step > 0.0)
            stalled = total >= 0.81 * before ? stalled + 1 : 0;
        size /= b->mean_force;
        memcpy(d, s.trial, all * sizeof(double));
        if (size <= tolerance || iterations >= most_steps || (double)products >= most_products || stalled >= MAX_STALLED
            || smallest(out->tangent, s.n) < parted * mean_of(out->tangent, s.n))
            break;
        linearise(&s, out->tangent);
        for (size_t k = 0; k < all; k++)
            s.residual[k] = -s.found[k];
        double wanted = linear_tolerance(s.n, size, tolerance, before > 0.0 ? sqrt(total / before) : 1.0);
        products += linear_solution(&s, s.residual, wanted, out->action_tangents, s.found);
        operator q = operator_of(&s, NULL);
        precondition(&q, s.found, s.trial);
        multiply(s.scale, s.trial, s.correction, s.m);
        step = 1.0;
        before = total;
        iterations++;
    }
    report(&s, out);
    fft_to_samples(s.plan, d, deflection);
    so_far->iterations = iterations;
    so_far->products = products;
    so_far->stalled = stalled;
    so_far->residual = size;
    free(d);
    close_space(&s);
    return 0;
}

/* The two solutions that follow a branch of rounded contacts: J step = -R and J slope = -dR/d(ln rounding).

   d               lines (2m) of the motion
   step, slope     (2m) out
   tangent, action_tangents  (n), (a, n) out: slopes of the contacts
   Returns 0, or -1 where there is no memory. */
int branch_solutions(const balance *b, const double *d, double tolerance, double *step, double *slope, double *tangent,
                     double *action_tangents, progress *done)
{
    space s;
    if (!open_space(&s, b, b->actions))
        return -1;
    size_t n = s.n, all = 2 * s.m, p = (size_t)b->contacts;
    double size, e2 = b->rounding * b->rounding;
    residual_at(&s, d, s.residual, tangent, action_tangents, &size);
    memset(s.force, 0, n * sizeof(double));
    if (s.actions)
        memset(s.action_forces, 0, s.actions * n * sizeof(double));
    for (size_t i = 0; i < p; i++) /* of max(0, x): e^2/(2 sqrt(x^2 + e^2)) against ln e */
        for (size_t j = 0; j < n; j++) {
            double x = b->side[i] * s.motion[j] + b->open_by[i * n + j];
            double force = b->side[i] * b->stiffness[i * n + j] * 0.5 * e2 / sqrt(x * x + e2);
            s.force[j] += force;
            for (size_t c = 0; c < s.actions; c++)
                s.action_forces[c * n + j] += b->weights[(c * p + i) * n + j] * force;
        }
    fft_to_lines(s.plan, s.force, s.correction);
    for (size_t c = 0; c < s.actions; c++) {
        fft_to_lines(s.plan, s.action_forces + c * n, s.lines);
        add_product(s.correction, b->ratios + 2 * c * s.m, s.lines, s.m);
    }
    linearise(&s, tangent);
    for (size_t k = 0; k < all; k++) {
        s.residual[k] = -s.residual[k];
        s.correction[k] = -s.correction[k];
    }
    operator q = operator_of(&s, action_tangents);
    int64_t products = krylov(&q, s.residual, tolerance, s.found);
    precondition(&q, s.found, s.trial);
    multiply(s.scale, s.trial, step, s.m);
    products += krylov(&q, s.correction, tolerance, s.found);
    precondition(&q, s.found, s.trial);
    multiply(s.scale, s.trial, slope, s.m);
    *done = (progress){.products = products, .residual = size / b->mean_force};
    close_space(&s);
    return 0;
}

/* A motion carried on to a slightly other balance, to first order. At the lines d (2m), where `from` leaves a residual,

       J x = left - R(d)        deflection = samples(d + x)

   with R of `to`, and J of the contacts that `from` has closed. The structure of `to` answers what is left of second
   order many times over: the lines of the mesh force are those that it needs.

   left        residual of `from` at d (2m)
   tolerance   relative, of the linear solution
   deflection  (n) out; the rest of `out` is that of `to`, with room for the action tangents of either
   Returns 0, or -1 where there is no memory. */
int carry_on(const balance *from, const balance *to, const double *d, const double *left, double tolerance,
             double *deflection, progress *done, const answer *out)
{
    space s;
    if (!open_space(&s, from, from->actions > to->actions ? from->actions : to->actions))
        return -1;
    size_t all = 2 * s.m;
    double *x = calloc(all, sizeof(double));
    if (!x) {
        close_space(&s);
        return -1;
    }
    space other = s;
    other.of = to;
    other.actions = (size_t)to->actions;
    double largest;
    residual_at(&other, d, s.residual, out->tangent, out->action_tangents, &largest);
    for (size_t k = 0; k < all; k++)
        s.residual[k] = left[k] - s.residual[k];
    residual_at(&s, d, s.found, out->tangent, out->action_tangents, &largest);
    linearise(&s, out->tangent);
    operator q = operator_of(&s, out->action_tangents);
    double size = sqrt(dot(s.residual, s.residual, all)), rest = size;
    *done = (progress){0};
    for (int turn = 0; turn < RESTARTS && rest > tolerance * size; turn++) {
        done->products += krylov(&q, s.residual, tolerance * size / rest, s.found);
        product(&q, s.found, s.trial);
        done->products++;
        add(s.residual, -1.0, s.trial, all);
        precondition(&q, s.found, s.trial);
        multiply(s.scale, s.trial, s.correction, s.m);
        add(x, 1.0, s.correction, all);
        rest = sqrt(dot(s.residual, s.residual, all));
        done->iterations++;
    }
    add(x, 1.0, d, all);
    residual_at(&other, x, s.found, out->tangent, out->action_tangents, &largest);
    report(&other, out);
    for (size_t k = 0; k < all; k++)
        out->force_lines[k] -= s.found[k] - left[k];
    fft_to_samples(s.plan, x, deflection);
    done->residual = largest / to->mean_force;
    free(x);
    close_space(&s);
    return 0;
}

/* The same of at most BLOCK neighbouring samples, side by side. */
FOR_EVERY_CPU static void quasi_static_block(int64_t contacts, int64_t samples, int64_t n, const double *stiffness,
                                             const double *separation, const double *side, double mean_force, double *d)
{
    double largest[BLOCK], carried[BLOCK], slope[BLOCK], touching[BLOCK], touched[BLOCK];
    for (int64_t j = 0; j < n; j++) {
        largest[j] = 0.0;
        d[j] = -INFINITY;
        touched[j] = -1.0;
    }
    for (int64_t i = 0; i < contacts; i++) {
        const double *restrict k = stiffness + i * samples, *restrict e = separation + i * samples;
        if (side[i] > 0.0)
            for (int64_t j = 0; j < n; j++) {
                double needed = mean_force / k[j];
                largest[j] = needed > largest[j] ? needed : largest[j];
                d[j] = -e[j] > d[j] ? -e[j] : d[j];
            }
    }
    for (int64_t j = 0; j < n; j++)
        d[j] += largest[j];
    for (int64_t turn = 0; turn <= contacts; turn++) {
        for (int64_t j = 0; j < n; j++)
            carried[j] = slope[j] = touching[j] = 0.0;
        for (int64_t i = 0; i < contacts; i++) {
            const double *restrict k = stiffness + i * samples, *restrict e = separation + i * samples;
            if (side[i] > 0.0)
                for (int64_t j = 0; j < n; j++) {
                    double x = d[j] + e[j], closed = x > 0.0 ? 1.0 : 0.0;
                    carried[j] += closed * k[j] * x;
                    slope[j] += closed * k[j];
                    touching[j] += closed;
                }
        }
        int going = 0;
        for (int64_t j = 0; j < n; j++) {
            int changed = touching[j] != touched[j];
            d[j] -= changed ? (carried[j] - mean_force) / slope[j] : 0.0;
            touched[j] = touching[j];
            going |= changed;
        }
        if (!going)
            break;
    }
}

/* d (n) at which the drive flanks (side > 0) carry the mean force at every instant, without dynamics: Newton's method on
   a convex, piecewise linear function, exact after as many steps as there are contacts. */
void quasi_static(int64_t contacts, int64_t samples, const double *stiffness, const double *separation,
                  const double *side, double mean_force, double *out)
{
    for (int64_t first = 0; first < samples; first += BLOCK) {
        int64_t n = samples - first < BLOCK ? samples - first : BLOCK;
        quasi_static_block(contacts, samples, n, stiffness + first, separation + first, side, mean_force, out + first);
    }
}
