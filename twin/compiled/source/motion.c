/* Motions in the coordinates of the structure's modes: time integration and the monodromy matrix of a steady state.

   Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., ch. II.1 (Runge-Kutta,
   order 4); G. Strang, SIAM J. Numer. Anal. 5 (1968) 506-517 (splitting) */

#include "kernels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    int64_t modes, contacts, samples, actions, responses;
    const double *omega2, *damping, *mesh, *load; /* of every mode */
    const double *directions;                     /* of every action (a, modes) */
    const double *seen;                           /* directions to report (r, modes) */
    const double *stiffness, *separation, *separation_rate; /* (p, n) */
    const double *side, *weights;                 /* (p), (a, p, n) */
    double damping_time;
    double first, speed, speed_rate; /* phase in samples, and how it runs */
    double step;                     /* [s] */
} motion;

/* Mesh force and actions at a phase; `d` and `rate` of the deflection. */
FOR_EVERY_CPU static double force_at(const motion *q, double at, double d, double rate, double *actions)
{
    size_t n = (size_t)q->samples, p = (size_t)q->contacts;
    double u = q->first + q->speed * at + 0.5 * q->speed_rate * at * at;
    double ratio = q->speed > 0.0 ? (q->speed + q->speed_rate * at) / q->speed : 0.0;
    double whole = floor(u + 1e-7), part = u - whole;
    if (part < 1e-6)
        part = 0.0;
    double wrapped = fmod(whole, (double)n);
    wrapped = wrapped < 0.0 ? wrapped + (double)n : wrapped;
    size_t i = wrapped > 0.0 ? (size_t)wrapped : 0, j = (i + 1) % n; /* of NaN 0: the motion is NaN then */
    double force = 0.0;
    for (size_t c = 0; c < (size_t)q->actions; c++)
        actions[c] = 0.0;
    for (size_t r = 0; r < p; r++) {
        const double *e = q->separation + r * n, *v = q->separation_rate + r * n, *k = q->stiffness + r * n;
        /* a row that jumps between two samples hands over to the next pair: hold it */
        double w = fabs(e[j] - e[i]) < 1e-5 ? part : 0.0;
        double gap = e[i] + w * (e[j] - e[i]), gap_rate = (v[i] + w * (v[j] - v[i])) * ratio;
        double x = q->side[r] * (d + q->damping_time * rate) + gap + q->damping_time * gap_rate;
        if (x > 0.0) {
            double f = q->side[r] * (k[i] + w * (k[j] - k[i])) * x;
            force += f;
            for (size_t c = 0; c < (size_t)q->actions; c++)
                actions[c] += q->weights[(c * p + r) * n + i] * f;
        }
    }
    return force;
}

FOR_EVERY_CPU static double accelerate(const motion *q, double at, const double *restrict x, const double *restrict v,
                                       double *restrict acceleration, double *restrict actions, double *deflection)
{
    size_t m = (size_t)q->modes;
    double d = 0.0, rate = 0.0;
    for (size_t r = 0; r < m; r++) {
        d += q->mesh[r] * x[r];
        rate += q->mesh[r] * v[r];
    }
    double force = force_at(q, at, d, rate, actions);
    for (size_t r = 0; r < m; r++)
        acceleration[r] = q->load[r] - q->mesh[r] * force - q->damping[r] * v[r] - q->omega2[r] * x[r];
    for (size_t c = 0; c < (size_t)q->actions; c++)
        for (size_t r = 0; r < m; r++)
            acceleration[r] -= q->directions[c * m + r] * actions[c];
    *deflection = d;
    return force;
}

/* Integrates from x, v (modes), which end at the last step, and reports every `keep`-th step: displacement and
   acceleration of every response (kept, r), deflection and mesh force (kept). Returns 0, or -1 without memory. */
FOR_EVERY_CPU int integrate(const motion *q, int64_t steps, int64_t keep, double *restrict x, double *restrict v,
                            double *out_x, double *out_a, double *out_d, double *out_f)
{
    size_t m = (size_t)q->modes, responses = (size_t)q->responses;
    double *room = malloc((10 * m + (size_t)q->actions + 1) * sizeof(double));
    if (!room)
        return -1;
    double *restrict sx = room, *restrict sv = room + m, *restrict kx = room + 2 * m, *restrict kv = room + 6 * m;
    double *actions = room + 10 * m;
    const double offset[] = {0.0, 0.5, 0.5, 1.0};
    size_t kept = 0;
    for (int64_t step = 0; step <= steps; step++) {
        double t = (double)step * q->step;
        for (int stage = 0; stage < 4; stage++) {
            double c = offset[stage] * q->step, d;
            for (size_t r = 0; r < m; r++) {
                sx[r] = stage ? x[r] + c * kx[(size_t)(stage - 1) * m + r] : x[r];
                sv[r] = stage ? v[r] + c * kv[(size_t)(stage - 1) * m + r] : v[r];
            }
            double force = accelerate(q, t + c, sx, sv, kv + (size_t)stage * m, actions, &d);
            memcpy(kx + (size_t)stage * m, sv, m * sizeof(double));
            if (stage == 0 && step % keep == 0) {
                out_d[kept] = d;
                out_f[kept] = force;
                for (size_t i = 0; i < responses; i++) {
                    double seen = 0.0, accelerated = 0.0;
                    for (size_t r = 0; r < m; r++) {
                        seen += q->seen[i * m + r] * sx[r];
                        accelerated += q->seen[i * m + r] * kv[r];
                    }
                    out_x[kept * responses + i] = seen;
                    out_a[kept * responses + i] = accelerated;
                }
                kept++;
            }
            if (step == steps)
                break;
        }
        if (step == steps)
            break;
        for (size_t r = 0; r < m; r++) {
            x[r] += q->step / 6 * (kx[r] + 2 * kx[m + r] + 2 * kx[2 * m + r] + kx[3 * m + r]);
            v[r] += q->step / 6 * (kv[r] + 2 * kv[m + r] + 2 * kv[2 * m + r] + kv[3 * m + r]);
        }
    }
    free(room);
    return 0;
}

/* The matrix (2m, 2m) by which a small departure, displacements and rates of m modes, is multiplied over a period.

   modes       exact step of every mode (m, 2, 2)
   directions  of the mesh force, then of every action, over the modes (1 + a, m)
   impulses    slopes of the contacts times the step (1 + a, n)

   Within the step of the contacts d stays and d + tau*d' decays by a = tau * (mesh . impulse), which is taken exactly. */
FOR_EVERY_CPU int monodromy(int64_t m_, int64_t n_, int64_t forces, const double *modes, const double *directions,
                            const double *impulses, double damping_time, double *out)
{
    size_t m = (size_t)m_, n = (size_t)n_, all = 2 * m;
    double *restrict seen = malloc((all + m) * sizeof(double));
    if (!seen)
        return -1;
    double *restrict impulse = seen + all;
    memset(out, 0, all * all * sizeof(double));
    for (size_t r = 0; r < all; r++)
        out[r * all + r] = 1.0;
    for (size_t i = 0; i < n; i++) {
        memset(seen, 0, all * sizeof(double));
        for (size_t r = 0; r < m; r++) {
            const double *restrict x = out + r * all, *restrict v = out + (m + r) * all;
            for (size_t j = 0; j < all; j++)
                seen[j] += directions[r] * (x[j] + damping_time * v[j]);
        }
        double decay = 0.0;
        for (size_t r = 0; r < m; r++) {
            impulse[r] = 0.0;
            for (size_t c = 0; c < (size_t)forces; c++)
                impulse[r] += directions[c * m + r] * impulses[c * n + i];
            decay += damping_time * directions[r] * impulse[r];
        }
        double share = fabs(decay) > 1e-12 ? -expm1(-decay) / decay : 1.0;
        for (size_t r = 0; r < m; r++) {
            double *restrict x = out + r * all, *restrict v = out + (m + r) * all;
            double a = modes[4 * r], b = modes[4 * r + 1], c = modes[4 * r + 2], d = modes[4 * r + 3];
            for (size_t j = 0; j < all; j++) {
                double before = x[j], rate = v[j] - share * impulse[r] * seen[j];
                x[j] = a * before + b * rate;
                v[j] = c * before + d * rate;
            }
        }
    }
    free(seen);
    return 0;
}
