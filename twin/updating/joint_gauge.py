"""Wear depth from the encoders of a machine whose structure is an estimate.

The mesh lines of such a machine are those of the model times factors t_k that nobody knows beforehand but that hardly
change from window to window; the mean of the transmission error grows with the depth whatever the structure, from a
zero and with a compliance that are not known either. All of them are learned together:

    ln|y_k| = ln|m_k(d)| + ln|t_k| + ε_k,      y_0 = m_0(d) + c + κ·C·T + s·(m_0(d) − m_0(0)) + ε_0
    θ = (ln|t_1|, ln|t_2|, ln|t_3|, c, κ, s) ~ N(θ̄, P)

c    zero of the discs against each other, which drifts   [m]
κ    relative error of the compliance C outside the mesh, T torque
s    relative error of the mean's growth: the shape of the worn profile

For a given depth d both are linear in θ, so the probability of a depth is

    p(d) ∝ N(z(d); H(d)·θ̄, H·P·Hᵀ + R(d)),      z = (ln|y_k| − ln|m_k(d)|, y_0 − m_0(d))

and θ after the window is the mixture of what every depth would teach, by its first two moments. The lines give the
shape of wear over time, the mean its scale: neither needs the structure. At first P is the spread of the draws
(twin/structure_spread.py); unworn windows, of known depth, teach the factors as far as the deviations of unworn teeth
allow. The band of a depth are the 5 and 95 % quantiles of p(d), wider by √χ² where the window fits worse (Birge), and
by an effect's share of the depth from the window on in which mean and lines contradict each other.

Source   A. H. Jazwinski, Stochastic Processes and Filtering Theory (1970), ch. 7 (moments of a filter); the mixture is
         that of a Rao–Blackwellised filter over a grid
Holds    where speed changes little: at another speed the factors are unknown again; zero, compliance and depth are not
Ignores  phases of the lines, which the structure turns as well; that depth never falls
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.quantiles import Z95
from twin.structure_spread import Spread
from twin.thresholds import deciding
from twin.updating.depth import DEPTH, HARMONICS, DepthEstimate, Gauge, Response, best_phase

SCANNED = 241  # depths of the grid
UNIT = 1e-6  # [m], of the zero in the algebra, which is then as large as the logarithms


@dataclass(frozen=True, slots=True, kw_only=True)
class JointScatter:
    """What the lines and the mean of a machine with an estimated structure scatter by."""

    unworn_teeth: float = deciding(
        0.5,
        of="line of unworn transmission error",
        meaning="standard deviation of the logarithm of a line of real unworn teeth, effects on the mesh included",
        source="reference campaigns with misalignment: lines of unworn teeth are doubled to trebled",
    )
    profile_shape: float = deciding(
        0.02,
        of="mesh line, times its harmonic",
        meaning="change of a line's factor from one window to the next, one standard deviation",
        source="not derived: as far as the worn profile of another structure departs from the model's while it wears",
    )
    wear_between: float = deciding(
        0.5,
        of="wear expected between two windows",
        meaning="its standard deviation where the speed has changed",
        source="not derived: another condition may halve or double the wear rate",
    )
    mean_growth: float = deciding(
        0.05,
        of="growth of the mean transmission error with depth",
        meaning="standard deviation of the growth by the shape of the worn profile",
        source="D00: 0.66 of the depth where the model of the generic structure gives 0.67 to 0.70",
    )
    unknown_effect: float = deciding(
        0.2,
        of="depth",
        meaning="standard deviation of a depth by an effect that is not in the model, where the mean and the lines "
        "contradict each other",
        source="D02 and D07 with their own rig files, wear alone: 19 to 20 % off",
    )
    least_edge: float = deciding(
        4.0,
        of="5–95 % half-width of a zero",
        meaning="edge of a disc, at its base radius, from which a lost count shows as a whole number of edges",
        source="derivation: another jump then passes for whole edges by chance in half of the cases at most",
    )
    at_limit: float = deciding(
        0.05,
        of="largest probability density",
        meaning="density at the end of the range searched from which the search goes on deeper",
        source="not derived: the upper end of the band then lies within the range",
    )


JOINT = JointScatter()
ZERO, COMPLIANCE, GROWTH = HARMONICS, HARMONICS + 1, HARMONICS + 2  # places in θ after the lines' factors
SIZE = HARMONICS + 3
UNKNOWN_ZERO = 0.1  # [m], standard deviation of a zero of which nothing is known: beyond any disc's radius
SCALE = np.array([1.0] * HARMONICS + [1 / UNIT, 1.0, 1.0])  # from θ in SI to numbers of like size


@dataclass(frozen=True, slots=True, kw_only=True)
class LineFactors:
    """What is known of θ, with the speed at which the lines' factors hold."""

    speed_hz: float
    mean: tuple[float, ...]  # θ̄ (SIZE,)
    covariance: tuple[tuple[float, ...], ...]  # P (SIZE, SIZE)
    has_zero: bool = False  # whether a window has taught the zero
    depth: float = 0.0  # of the latest window [m]
    depth_std: float = 0.0  # its standard deviation [m]
    fresh: bool = False  # whether the lines' factors are unknown again since that window
    contradicted: bool = False  # whether mean and lines have contradicted each other, by no whole count of edges

    @classmethod
    def of_spread(cls, lines: Spread, compliance: Spread, speed_hz: float) -> LineFactors:
        """Before any window: the spread of the draws, and a zero of which nothing is known.

        lines       ln|t| of the channel that is read
        compliance  κ, (1,)
        """
        P = np.zeros((SIZE, SIZE))
        P[:HARMONICS, :HARMONICS] = lines.covariance[:HARMONICS, :HARMONICS]
        P[ZERO, ZERO] = UNKNOWN_ZERO**2
        P[COMPLIANCE, COMPLIANCE] = compliance.covariance[0, 0]
        P[GROWTH, GROWTH] = JOINT.mean_growth**2
        mean = (*lines.mean[:HARMONICS].tolist(), 0.0, float(compliance.mean[0]), 0.0)
        return cls(speed_hz=speed_hz, mean=mean, covariance=_rows(P))

    def at_speed(self, lines: Spread, speed_hz: float) -> LineFactors:
        """At another speed: the lines' factors are unknown again, the rest is not."""
        θ, P = np.array(self.mean), np.array(self.covariance)
        θ[:HARMONICS] = lines.mean[:HARMONICS]
        P[:HARMONICS, :] = 0.0
        P[:, :HARMONICS] = 0.0
        P[:HARMONICS, :HARMONICS] = lines.covariance[:HARMONICS, :HARMONICS]
        return replace(self, speed_hz=speed_hz, mean=tuple(θ.tolist()), covariance=_rows(P), fresh=True)

    def later(self, drift: float) -> LineFactors:
        """A window later: the zero has drifted [m], and the worn profile has another shape."""
        P = np.array(self.covariance)
        P[ZERO, ZERO] += drift**2
        for k in range(HARMONICS):
            P[k, k] += (JOINT.profile_shape * (k + 1)) ** 2
        return replace(self, covariance=_rows(P))

    def without_zero(self) -> LineFactors:
        """After a disc has moved: nothing is known of the zero."""
        P = np.array(self.covariance)
        P[ZERO, :] = 0.0
        P[:, ZERO] = 0.0
        P[ZERO, ZERO] = UNKNOWN_ZERO**2
        return replace(self, covariance=_rows(P), has_zero=False)


def _rows(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JointDepth:
    """A depth, and what the window taught of the factors and of the zero."""

    estimate: DepthEstimate
    factors: LineFactors
    chi_square: float  # rᵀ(P + R)⁻¹r at the most probable depth


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Own:
    """What the model says of a window."""

    response: Response
    unworn: np.ndarray  # |m_k| of unworn teeth (HARMONICS,) [m]
    load: float  # what the compliance outside the mesh makes of the mean, C·T [m]
    projected: float  # depth expected by the windows before [m]


def estimate_jointly(gauge: Gauge, own: Own, factors: LineFactors, depths: np.ndarray) -> JointDepth:
    """The depth among those of a grid [m], from the lines and the mean of a gauge.

    gauge.mean  the mean as measured, with its zero [m]; None where it is not known
    depths      (n,) rising; one alone where the depth is known
    """
    z, H, R = _observed(gauge, own, depths)
    used = np.arange(HARMONICS + (gauge.mean is not None))
    z, H, R = z[:, used], H[:, used], R[:, used]
    θ, P = np.array(factors.mean) * SCALE, np.array(factors.covariance) * np.outer(SCALE, SCALE)
    PH = np.einsum("ij,nkj->nik", P, H)
    C = np.einsum("nij,njk->nik", H, PH) + R[:, :, None] * np.eye(used.size)
    inverse = np.linalg.inv(C)
    off = z - H @ θ
    chi2 = np.einsum("ni,nij,nj->n", off, inverse, off)
    log_p = -0.5 * (chi2 + np.linalg.slogdet(C)[1] + _jump(factors, own.projected, depths))
    p = np.exp(log_p - log_p.max()) * (np.gradient(depths) if depths.size > 1 else 1.0)
    p /= p.sum()
    gain = PH @ inverse
    means = θ + np.einsum("nik,nk->ni", gain, off)
    mean = p @ means
    apart = means - mean
    after = P - np.einsum("n,nik,njk->ij", p, gain, PH) + np.einsum("n,ni,nj->ij", p, apart, apart)
    after = 0.5 * (after + after.T)
    best = float(chi2[int(np.argmax(p))])
    estimate = _summary(gauge, own.response, depths, p, best / used.size)
    if factors.contradicted:
        estimate = _with_unknown_effect(estimate)
    return JointDepth(
        estimate=estimate,
        factors=replace(
            factors,
            mean=tuple((mean / SCALE).tolist()),
            covariance=_rows(after / np.outer(SCALE, SCALE)),
            has_zero=factors.has_zero or gauge.mean is not None,
            depth=estimate.depth,
            depth_std=estimate.std,
            fresh=False,
        ),
        chi_square=best,
    )


def _jump(factors: LineFactors, projected: float, depths: np.ndarray) -> np.ndarray:
    """What a depth far from the projected one adds to 2·J where the speed has just changed; the depth has not (n,).

    Otherwise nothing: the factors hold already what earlier windows say, and must not hear it twice.
    """
    if not factors.fresh:
        return np.zeros_like(depths)
    std = np.hypot(np.hypot(factors.depth_std, DEPTH.floor), JOINT.wear_between * abs(projected - factors.depth))
    return ((depths - projected) / std) ** 2


def _observed(gauge: Gauge, own: Own, depths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z (n, HARMONICS + 1), H (n, HARMONICS + 1, SIZE) and the diagonal of R at every depth, scaled.

    Lines from which those of unworn teeth are not subtracted hold the deviations of unworn teeth.
    """
    n = depths.size
    z, H, R = np.zeros((n, HARMONICS + 1)), np.zeros((n, HARMONICS + 1, SIZE)), np.empty((n, HARMONICS + 1))
    H[:, :HARMONICS, :HARMONICS] = np.eye(HARMONICS)
    H[:, -1, ZERO], H[:, -1, COMPLIANCE] = 1.0, own.load / UNIT
    size, noise = np.hypot(np.abs(gauge.lines), DEPTH.floor), np.hypot(gauge.lines_std, DEPTH.floor)
    deviations = 0.0 if gauge.from_unworn else JOINT.unworn_teeth * own.unworn
    models, means = own.response(depths)
    m = np.hypot(np.abs(models), DEPTH.floor)  # a line below the floor says nothing of its size
    z[:, :-1] = np.log(size / m)
    R[:, :-1] = (noise**2 + deviations**2) / m**2 + gauge.scatter**2
    if gauge.mean is not None:
        z[:, -1] = (gauge.mean - means) / UNIT
    H[:, -1, GROWTH] = (means - means[0]) / UNIT
    R[:, -1] = (gauge.mean_std / UNIT) ** 2
    return z, H, R


def _summary(gauge: Gauge, response: Response, depths: np.ndarray, p: np.ndarray, misfit: float) -> DepthEstimate:
    """Median, band and standard deviation of a depth."""
    low, median, high = (_quantile(depths, p, q) for q in (0.05, 0.5, 0.95))
    wider = float(np.sqrt(max(misfit, 1.0)))
    low, high = median - wider * (median - low), median + wider * (high - median)
    (model,), _ = response(np.array([median]))
    std = float(np.hypot(max(high - median, median - low) / Z95, DEPTH.floor))
    shape = DEPTH.shape_scatter * median**2
    density = p / np.gradient(depths) if depths.size > 1 else p
    σ2 = (gauge.scatter * np.abs(model)) ** 2 + gauge.lines_std**2 + DEPTH.floor**2
    return DepthEstimate(
        depth=median,
        std=float(np.hypot(std, shape)),
        noise_std=std,
        phase=best_phase(model, gauge, 1 / σ2),
        from_lines=median,
        misfit=misfit,
        at_limit=bool(depths.size > 1 and density[-1] > JOINT.at_limit * density.max()),
        band=_band(low, median, high, float(np.hypot(shape, DEPTH.floor))),
    )  # fmt: skip


def _with_unknown_effect(estimate: DepthEstimate) -> DepthEstimate:
    """The depth with a wider band: by as much as an effect that is not in the model has been seen to shift one."""
    more = JOINT.unknown_effect * estimate.depth
    assert estimate.band is not None
    low, high = estimate.band
    return replace(estimate, std=float(np.hypot(estimate.std, more)), band=_band(low, estimate.depth, high, more))


def _band(low: float, median: float, high: float, more: float) -> tuple[float, float]:
    """5 and 95 % of a depth [m], wider by a scatter that knows no side."""
    below, above = np.hypot(median - low, Z95 * more), np.hypot(high - median, Z95 * more)
    return max(median - float(below), 0.0), median + float(above)


def _quantile(depths: np.ndarray, p: np.ndarray, q: float) -> float:
    if depths.size == 1:
        return float(depths[0])
    reached = np.cumsum(p) - 0.5 * p
    return float(np.interp(q, reached, depths))
