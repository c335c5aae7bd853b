"""Motion of the pair on its shafts, integrated in time by an implicit method of order two.

    M·q'' + D·q' + S·q = T − Σ_i F_i·g_i + Σ_i Φ_i·h_i
    δ_i = ±(r_b1·θ1 − r_b2·θ2 − (y1 − y2)·cos α) + (x1 − x2)·sin α + e_i(t) − gap(s) [− j],   F_i = impact(δ_i, δ_i')/m
    u_i' = h_i·(q' + nominal rotation),   Φ_i = −μ(u_i')·F_i,   g_i = ∂δ_i/∂q
    h_i·q' = (x1' − x2')·cos α ± ((y1' − y2')·sin α − (ρ1 + σ1)·θ1' + (ρ2 − σ2)·θ2') [− D'·t_i where the tilt turns]

i       slice of the face, tooth pair, and flank: + drive flanks, − back flanks, which are j apart
x, y    of the tooth at the slice, tilts included
e_i     separation by the tilt of the driven gear: the lead gap of effects/misalignment about the place of tilting
gap     corner contact outside the path
m       slices
t_i     direction along the flank, (cos α, ±sin α)
σ1, σ2  shifts of the contact on the flanks where the gear's tooth is displaced by D against the pinion's: with
        τ = ½·cos α·(D_x/tan α ± D_y), σ1 = τ and σ2 = τ − D_x/sin α; corner contact begins at s + σ2, ends at s + σ1

The driver's joint turns at constant speed, a constant torque T acts on the driven. Because C·S(x) is large, the
equations are stiff: backward differences of order two, solved by Newton's method with the exact Jacobian.

    v_n+1 − (4v_n − v_n−1)/3 = (2h/3)·M⁻¹·f(q_n+1, v_n+1, t_n+1),    q_n+1 = (4q_n − q_n−1)/3 + (2h/3)·v_n+1

With elastic teeth each slice of a tooth is a spring k_t/m behind its contact, k_t·u = F(δ − u, δ' − u'): the energy
method's bending, shear, axial and foundation compliance (mesh/stiffness), without inertia.

The slip and the generalised forces of friction come from one and the same h_i, at the place where the tilted flanks
touch: the forces' power is Φ_i·u_i', which is never positive.

Source   E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., ch. III.1 and V.1 (BDF2, L-stable);
         Dąbrowski et al., Diagnostyka 2(62) (2012): the system and its impact law
Holds    steps that resolve the passage of a mesh: a few hundred a base pitch; tilts of a degree or so
Ignores  shifts of the contact by what vibrates; the axial sway of a crooked gear; contact off the line of action
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numba import njit

from studies.misalignment import impact_law
from studies.misalignment.system import System, Tilt
from twin.effects.misalignment import face_separation
from twin.errors import NotConverged, ParameterError
from twin.geometry import GearPair
from twin.mesh.corner_contact import corner_gap
from twin.mesh.stiffness import pair_compliance

SLICES = 15
STEPS = 512  # a mesh period
_NEWTON = 60
_TOLERANCE = 1e-10  # of velocities [m/s], turns and tilts at the base radius
_GRID = 4e-6  # of the corner gap's table [m]

_impact = njit(cache=True)(impact_law.impact)
_friction = njit(cache=True)(impact_law.friction)
_face_separation = njit(cache=True)(face_separation)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Motion:
    """What happens over whole turns, at every step."""

    time: np.ndarray  # (n,) [s], from the start of the integration
    mesh_force: np.ndarray  # Σ F of the drive flanks (n,) [N]
    back_force: np.ndarray  # Σ F of the back flanks (n,) [N]
    friction_power: np.ndarray  # Σ Φ·u', never positive (n,) [W]
    deflection: np.ndarray  # δ of the middle of the face inside the path, without separation (n,) [m]
    position: np.ndarray  # q (n, 10), along FREEDOMS [m, rad]
    velocity: np.ndarray  # (n, 10) [m/s, rad/s]
    contact: np.ndarray  # generalised forces of all contacts (n, 10) [N, N·m]
    shaft: np.ndarray  # of each gear on its shaft: (n, 2 gears, 2), along x and y [N]


@njit(cache=True)
def _table(values, start, step, s):
    """Value and slope of a table by straight lines; held beyond its ends."""
    u = (s - start) / step
    n = values.size
    if u <= 0.0:
        return values[0], 0.0
    if u >= n - 1:
        return values[n - 1], 0.0
    i = int(u)
    slope = values[i + 1] - values[i]
    return values[i] + (u - i) * slope, slope / step


@njit(cache=True)
def _through_tooth(x, x_rate, k, bent_from, c_new, K, e, C, d):
    """Force [N] of a contact behind a tooth of stiffness k, its bending u [m], and dF over dδ' with δ following.

    k·u = impact(x − u, x' − u'),   u' = (u − bent_from)/c_new

    The force falls as u grows, so that there is one root between 0 and x.
    """
    low, high, u = 0.0, x, min(max(bent_from, 0.0), x)
    F = F_x = F_v = 0.0
    for _ in range(80):
        F, F_x, F_v = _impact(x - u, x_rate - (u - bent_from) / c_new, K, e, C, d)
        over = k * u - F
        if over > 0.0:
            high = u
        else:
            low = u
        new = u - over / (k + F_x + F_v / c_new)
        if not low < new < high:
            new = 0.5 * (low + high)
        moved, u = abs(new - u), new
        if moved < 1e-14:
            break
    slope = F_x * c_new + F_v
    return k * u, u, k * slope / (k + slope / c_new)


@njit(cache=True)
def _contacts(q, v, t, geometry, tilt, law, rub, gap0, gap, places, c_new, want, force, jacobian, sums,  # noqa: C901, PLR0915 - one compiled loop
              bent_from, bent):  # fmt: skip
    """Adds the contacts' generalised forces (10,) and, where wanted, their −∂/∂v with q following (10, 10).

    gap        tables over s: gap before and behind the path [m], stiffness of the teeth [N/m]; their step in [3, 0]
    bent_from  what the bending's rate is reckoned from (2, 8, slices) [m]; bent receives the bending itself
    """
    bent[:] = 0.0
    elastic = gap[2, 0] > 0.0 and c_new > 0.0
    rb, α, pb, back_phase, j, width, ω = geometry
    tan_tilt, ψ0, turning, pivot = tilt
    K, e, C, d = law
    s_α, c_α, t_α = np.sin(α), np.cos(α), np.tan(α)
    m = places.size
    ψ = ψ0 + turning * ω * t
    ψ_rate = turning * ω
    farthest = 2.0 * abs(tan_tilt) * width * (0.5 + abs(pivot)) / s_α  # more than any shift of a contact
    λ = width * tan_tilt * np.cos(ψ - α)
    λ_back = width * tan_tilt * np.cos(ψ + α - np.pi)
    g, h = np.empty((2, 10)), np.empty((2, 10))
    for side in (1.0, -1.0):
        if side > 0.0:
            s0, s_rate, gap_face, λ_s = rb * ω * t, rb * ω, 0.0, λ
            λ_slope = -width * tan_tilt * np.sin(ψ - α)
        else:
            s0, s_rate, gap_face, λ_s = back_phase - rb * ω * t, -rb * ω, j, λ_back
            λ_slope = -width * tan_tilt * np.sin(ψ + α - np.pi)
        # δ = g0·q + z·g1·q, u = h0·q + z·h1·q (without the arms, which follow the pair)
        g[:] = 0.0
        g[0, 0], g[0, 1], g[0, 4] = s_α, -side * c_α, side * rb
        g[0, 5], g[0, 6], g[0, 9] = -s_α, side * c_α, -side * rb
        g[1, 2], g[1, 3], g[1, 7], g[1, 8] = side * c_α * width, s_α * width, -side * c_α * width, -s_α * width
        g[0, 9] -= pivot * turning * λ_slope  # the tilt turns with the gear: contacts do work on it
        g[1, 9] += turning * λ_slope
        δ0, δ1, δ0_rate, δ1_rate = 0.0, 0.0, 0.0, 0.0
        for a in range(10):
            δ0 += g[0, a] * q[a]
            δ1 += g[1, a] * q[a]
            δ0_rate += g[0, a] * v[a]
            δ1_rate += g[1, a] * v[a]
        about_pivot = 0.5 * abs(λ_s) - λ_s * pivot  # the teeth tilt about it, not about the end that touches
        if side > 0.0:
            sums[3] = δ0
        # where flanks touch is shifted by the tilt, in proportion to z − pivot: D = (−sin ψ, cos ψ)·arm
        arm = width * tan_tilt
        across_x, across_y = -arm * np.sin(ψ), arm * np.cos(ψ)
        turn = 0.5 * c_α * (across_x / t_α + side * across_y)
        σ1, σ2 = turn, turn - across_x / s_α
        # slip = (h0 + z·h1)·whole motion: of the crooked gear the tilt turns, too
        crooked = turning * arm * (np.cos(ψ) * c_α + side * np.sin(ψ) * s_α)
        h[1] = 0.0
        h[1, 2], h[1, 3], h[1, 7], h[1, 8] = -side * s_α * width, c_α * width, side * s_α * width, -c_α * width
        h[1, 4], h[1, 9] = -side * σ1, crooked - side * σ2
        closest = δ0 + 0.5 * abs(δ1) + about_pivot - gap_face  # of any slice, before the corner gap
        if closest <= 0.0:
            continue
        first = np.floor((gap0 - s0) / pb) + 1.0  # five pairs cover the table of the corner gap
        for k in range(5):
            s = s0 + (first + k) * pb
            slot = int(first + k) % 8
            flank = 0 if side > 0.0 else 1
            if _table(gap[0], gap0, gap[3, 0], s + farthest)[0] > closest:
                continue
            if _table(gap[1], gap0, gap[3, 0], s - farthest)[0] > closest:
                continue
            k_tooth = _table(gap[2], gap0, gap[3, 0], s)[0]
            A0 = A1 = A2 = B0 = B1 = B2 = D0 = D1 = D2 = N0 = N1 = P0 = P1 = 0.0
            touched = False
            ρ1, ρ2 = rb * t_α + s, rb * t_α - s
            h[0] = 0.0
            h[0, 0], h[0, 1], h[0, 4] = c_α, side * s_α, -side * ρ1 - pivot * h[1, 4]
            h[0, 5], h[0, 6], h[0, 9] = -c_α, -side * s_α, side * ρ2 - pivot * h[1, 9]
            slip0, slip1 = (h[0, 4] + h[0, 9]) * ω, (h[1, 4] + h[1, 9]) * ω
            for a in range(10):
                slip0 += h[0, a] * v[a]
                slip1 += h[1, a] * v[a]
            for i in range(m):
                z = places[i]
                before, before_slope = _table(gap[0], gap0, gap[3, 0], s + (z - pivot) * σ2)
                behind, behind_slope = _table(gap[1], gap0, gap[3, 0], s + (z - pivot) * σ1)
                corner = before + behind
                x = δ0 + z * δ1 + _face_separation(λ_s, z) + about_pivot - corner - gap_face
                if x <= 0.0:
                    continue
                x_rate = δ0_rate + z * δ1_rate + λ_slope * ψ_rate * (z - pivot) - (before_slope + behind_slope) * s_rate
                if elastic:
                    F, u, slope = _through_tooth(x, x_rate, k_tooth, bent_from[flank, slot, i], c_new, K, e, C, d)
                    bent[flank, slot, i] = u
                else:
                    F, F_x, F_v = _impact(x, x_rate, K, e, C, d)
                    slope = F_x * c_new + F_v
                if F <= 0.0:
                    continue
                touched = True
                F, slope = F / m, slope / m
                slip = slip0 + z * slip1
                μ, dμ = _friction(slip, rub[0], rub[1], rub[2], rub[3])
                N0 += F
                N1 += F * z
                P0 += μ * F
                P1 += μ * F * z
                sums[2] -= μ * F * slip
                if want:
                    A0 += slope
                    A1 += slope * z
                    A2 += slope * z * z
                    B0 += μ * slope
                    B1 += μ * slope * z
                    B2 += μ * slope * z * z
                    D0 += F * dμ
                    D1 += F * dμ * z
                    D2 += F * dμ * z * z
            if not touched:
                continue
            sums[0 if side > 0.0 else 1] += N0
            for a in range(10):
                force[a] -= g[0, a] * N0 + g[1, a] * N1 + h[0, a] * P0 + h[1, a] * P1
            if want:
                for a in range(10):
                    for b in range(10):
                        jacobian[a, b] += (
                            g[0, a] * (A0 * g[0, b] + A1 * g[1, b])
                            + g[1, a] * (A1 * g[0, b] + A2 * g[1, b])
                            + h[0, a] * (B0 * g[0, b] + B1 * g[1, b] + D0 * h[0, b] + D1 * h[1, b])
                            + h[1, a] * (B1 * g[0, b] + B2 * g[1, b] + D1 * h[0, b] + D2 * h[1, b])
                        )


@njit(cache=True)
def _solve(A, b, n):
    """x of A·x = b in place (Gauss, with pivots)."""
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[p, k]):
                p = i
        if p != k:
            for c in range(n):
                A[k, c], A[p, c] = A[p, c], A[k, c]
            b[k], b[p] = b[p], b[k]
        for i in range(k + 1, n):
            factor = A[i, k] / A[k, k]
            if factor != 0.0:
                for c in range(k, n):
                    A[i, c] -= factor * A[k, c]
                b[i] -= factor * b[k]
    for k in range(n - 1, -1, -1):
        for c in range(k + 1, n):
            b[k] -= A[k, c] * b[c]
        b[k] /= A[k, k]


@njit(cache=True)
def _run(q, v, free, mass, damping, stiffness, load, scale, geometry, tilt, law, rub, gap0, gap, places,  # noqa: C901, PLR0915 - one compiled loop
         t0, h, steps, skip, out_q, out_v, out_f, out_sums):  # fmt: skip
    """Integrates from rest at (q, v); the number of steps that Newton did not solve."""
    n = free.size
    q1, v1 = q.copy(), v.copy()  # at n − 1
    qn, vn = q.copy(), v.copy()
    force, jacobian, sums = np.empty(10), np.empty((10, 10)), np.empty(4)
    residual, trial_v, trial_q, A = np.empty(10), np.empty(10), np.empty(10), np.empty((10, 10))
    b, saved = np.empty(10), np.empty(10)
    bent, bent1, bent_from = np.zeros((2, 8, places.size)), np.zeros((2, 8, places.size)), np.zeros((2, 8, places.size))
    bent_new = np.zeros((2, 8, places.size))
    failed = 0
    for step in range(1, steps + 1):
        t = t0 + step * h
        if step == 1:
            c_new, c_now, c_old = h, 1.0, 0.0
        else:
            c_new, c_now, c_old = 2.0 * h / 3.0, 4.0 / 3.0, -1.0 / 3.0
        bent_from[:] = c_now * bent + c_old * bent1
        trial_v[:] = vn
        best = np.inf
        shrink = 1.0
        done = False
        for newton in range(_NEWTON):
            for a in range(10):
                trial_q[a] = c_now * qn[a] + c_old * q1[a] + c_new * trial_v[a]
            force[:] = 0.0
            jacobian[:] = 0.0
            sums[:] = 0.0
            _contacts(trial_q, trial_v, t, geometry, tilt, law, rub, gap0, gap, places, c_new, True,
                      force, jacobian, sums, bent_from, bent_new)  # fmt: skip
            size = 0.0
            for i in range(n):
                a = free[i]
                r = mass[a] * (trial_v[a] - c_now * vn[a] - c_old * v1[a])
                f = load[a] + force[a]
                for c in range(10):
                    f -= damping[a, c] * trial_v[c] + stiffness[a, c] * trial_q[c]
                r -= c_new * f
                residual[i] = r
                size += (r / (mass[a] * scale[a])) ** 2 * scale[a] ** 4
            if size > best and newton > 0 and shrink > 1e-3:  # back along the step
                shrink *= 0.5
                for i in range(n):
                    trial_v[free[i]] = saved[i] + shrink * b[i]
                continue
            best = size
            shrink = 1.0
            for i in range(n):
                b[i] = -residual[i]
                for c in range(n):
                    A[i, c] = c_new * (jacobian[free[i], free[c]] + damping[free[i], free[c]]
                                       + c_new * stiffness[free[i], free[c]])  # fmt: skip
                A[i, i] += mass[free[i]]
            _solve(A, b, n)
            largest = 0.0
            for i in range(n):
                saved[i] = trial_v[free[i]]
                trial_v[free[i]] += b[i]
                largest = max(largest, abs(b[i]) * scale[free[i]])
            if largest < _TOLERANCE:
                done = True
                break
        if not done:
            failed += 1
        bent1[:] = bent
        bent[:] = bent_new
        for a in range(10):
            q_new = c_now * qn[a] + c_old * q1[a] + c_new * trial_v[a]
            q1[a], v1[a] = qn[a], vn[a]
            qn[a], vn[a] = q_new, trial_v[a]
        if step > skip:
            out_q[step - skip - 1], out_v[step - skip - 1] = qn, vn
            out_f[step - skip - 1], out_sums[step - skip - 1] = force, sums
    return failed


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One run: the system, its speed and torque, and how the driven gear is tilted."""

    system: System
    speed_rpm: float
    torque: float  # on the driven [N·m]
    tilt: Tilt

    @property
    def omega(self) -> float:
        """Ω of both shafts [rad/s]."""
        return 2 * pi * self.speed_rpm / 60

    @property
    def mesh_period(self) -> float:
        """[s]."""
        return 2 * pi / self.omega / self.system.pair.teeth[0]


def _arguments(case: Case, slices: int) -> tuple:
    system, tilt = case.system, case.tilt
    pair = system.pair
    rb, pb = pair.base_radius[0], pair.base_pitch
    reach = 1.6 * pb  # five base pitches hold the path and this on either side
    s = np.arange(pair.path_start - reach, pair.path_end + reach, _GRID)
    gap = np.zeros((4, s.size))
    whole = np.nan_to_num(corner_gap(pair, s), nan=1.0, posinf=1.0)
    gap[0], gap[1], gap[3, 0] = np.where(s < 0, whole, 0.0), np.where(s > 0, whole, 0.0), _GRID
    if system.teeth_give:
        gap[2] = tooth_stiffness(pair, s)
    geometry = (
        rb, pair.pressure_angle, pb, pair.tooth_thickness * cos(pair.pressure_angle), pair.backlash, pair.face_width,
        case.omega,
    )  # fmt: skip
    tilted = (float(np.tan(tilt.angle)), tilt.phase, 1.0 if tilt.turning else 0.0, tilt.pivot)
    places = (np.arange(slices) + 0.5) / slices - 0.5
    return geometry, tilted, system.law.normal, system.law.tangential, s[0], gap, places


def tooth_stiffness(pair: GearPair, s: np.ndarray) -> np.ndarray:
    """k_t [N/m] of a pair of teeth at path positions s (n,): all compliances but the contact itself."""
    levels = np.linspace(pair.path_start, pair.path_end, 201)
    parts = pair_compliance(pair, levels)
    compliance = np.sum([value for name, value in parts.items() if name != "hertz"], axis=0)
    return 1 / np.interp(s, levels, compliance)


def contact_forces(case: Case, q: np.ndarray, v: np.ndarray, time: float, slices: int = SLICES) -> tuple:
    """Generalised forces (10,) of all contacts at q, v (10,) and a time [s]; then Σ F of drive and of back flanks [N],
    the power of friction [W] and the deflection [m] as (4,)."""
    force, sums = np.zeros(10), np.zeros(4)
    arguments = (
        np.asarray(q, float), np.asarray(v, float), float(time), *_arguments(case, slices), 0.0, False,
        force, np.zeros((1, 1)), sums, np.zeros((2, 8, slices)), np.zeros((2, 8, slices)),
    )  # fmt: skip
    _contacts(*arguments)
    return force, sums


def loads(case: Case) -> np.ndarray:
    """What acts from outside (10,): the torque against the driven's rotation."""
    out = np.zeros(10)
    out[9] = -case.torque
    return out


def start(case: Case, slices: int = SLICES) -> np.ndarray:
    """q (10,) near the balance at time 0: one tooth pair carries, friction and damping left out."""
    system, pair = case.system, case.system.pair
    F, rb, α = system.static_force(case.torque), pair.base_radius[0], pair.pressure_angle
    z = (np.arange(slices) + 0.5) / slices - 0.5
    λ = case.tilt.lead_gap(pair)
    e = face_separation(λ, z) + abs(λ) / 2 - λ * case.tilt.pivot
    K, n = system.law.stiffness, system.law.exponent
    low, high = -e.max(), system.law.penetration(F) - e.min()
    bent = F / float(tooth_stiffness(pair, np.zeros(1))[0]) if system.teeth_give else 0.0
    for _ in range(60):
        δ = (low + high) / 2
        carried = K * np.mean(np.maximum(δ + e, 0.0) ** n)
        low, high = (low, δ) if carried > F else (δ, high)
    q = np.zeros(10)
    give = system.support_compliance
    q[0], q[1], q[5], q[6] = (F * give[0, 0] * c for c in (-sin(α), cos(α), sin(α), -cos(α)))
    if system.shafts_give:
        q[4] = -F * rb / system.torsional_stiffness
    q[9] = q[4] + ((q[0] - q[5]) * sin(α) - (q[1] - q[6]) * cos(α) - δ - bent) / rb
    return q


def integrate(case: Case, *, settle: int, keep: int, steps: int = STEPS, slices: int = SLICES) -> Motion:
    """Runs over `settle` mesh periods, then keeps `keep` of them.

    steps   of the integration a mesh period
    slices  across the face
    Raises NotConverged where Newton's method does not solve a step.
    """
    if min(settle, keep - 1) < 0 or steps < 32 or slices < 1:
        raise ParameterError(
            f"settle = {settle} ≥ 0, keep = {keep} ≥ 1, steps = {steps} ≥ 32 and slices = {slices} ≥ 1 are asked for"
        )
    system, rb = case.system, case.system.pair.base_radius[0]
    h, n = case.mesh_period / steps, keep * steps
    scale = np.array([1.0, 1.0, rb, rb, rb] * 2)
    M, D, S = system.mass, system.damping, system.stiffness
    q, v, f, sums = np.empty((n, 10)), np.empty((n, 10)), np.empty((n, 10)), np.empty((n, 4))
    arguments = (
        start(case, slices), np.zeros(10), system.free, M, D, S, loads(case), scale, *_arguments(case, slices),
        0.0, h, (settle + keep) * steps, settle * steps, q, v, f, sums,
    )  # fmt: skip
    failed = _run(*arguments)
    if failed > 0:
        raise NotConverged(
            f"Newton's method left {failed} of {(settle + keep) * steps} steps unsolved at {case.speed_rpm:g} rpm and "
            f"{case.torque:g} N·m: more steps a mesh period than {steps}?"
        )
    held = q @ S.T + v @ D.T
    on_shaft = np.where(S.any(axis=1), held, f)
    return Motion(
        time=(settle * steps + 1 + np.arange(n)) * h, mesh_force=sums[:, 0], back_force=sums[:, 1],
        friction_power=sums[:, 2], deflection=sums[:, 3], position=q, velocity=v, contact=f,
        shaft=np.stack((on_shaft[:, 0:2], on_shaft[:, 5:7]), axis=1),
    )  # fmt: skip
