"""Wear depth from what the encoders see.

Worn flanks let the gear lag: the mesh lines of the transmission error grow almost linearly with depth (0.38 µm a µm
at the first harmonic of the reference rig) and hardly depend on damping, stiffness or contact width, and its mean
grows by about two thirds of the depth. The depth is the one that explains both best,

    J(d, ψ) = Σ_k |e^{ikψ}·(m_k(d) − m_k(0)) − (y_k − y_k⁰)|²/σ_k² + (m_0(d) + c − y_0)²/σ_0² + (ψ − ψ̄)²/σ_ψ²

y_k   measured line of mesh harmonic k                           [m]
m_k   the twin's line at a depth                                 [m]
y_k⁰  the same line when the teeth were unworn, under the same condition: what graduation, pitch and friction
      make of it from the start drops out; where no such window is there, y_k⁰ and m_k(0) are left out  [m]
y_0   measured mean, absolute because edge counts are            [m]
c     offset of the two discs' zeros, learned from windows       [m]
ψ     mesh phase against the pinion encoder's zero, ψ̄ from earlier windows  [rad]
σ_k   what a structure that differs from the rig file's by its tolerance does to line k, plus noise

Where the lines fit worse than their scatter says (misfit above one), the standard deviation that weighs the depth is
widened by the square root of the misfit (Birge's ratio). The band is not that: σ_k holds for the structure of any
machine, and weighs the lines against each other, whereas what this machine's lines may be off by follows from its rig
file and its speed (line_scatter.py); its parts are those of depth_band.py. Of deep wear the profile's own shape is not
sure, either: dynamic forces leave waves on the flanks that static ones would not. Flanks worn by static forces,
measured with a curve made by dynamic ones, come out 0.9, 2.7 and 5.9 % off at 100, 200 and 400 µm (reference rig,
10 Hz, 10 N·m; more at 12 Hz).

Source   P. Sweeney, R. Randall, Proc. IMechE C 210 (1996) 201–213 (phase demodulation of encoders);
         R. T. Birge, Phys. Rev. 40 (1932) 207–227 (external consistency)
Holds    where wear is the only thing that grows; the mean also where nothing moves the discs
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twin.compiled import best_phases
from twin.roots import rising_roots
from twin.thresholds import deciding
from twin.updating.depth_band import DepthParts, structure_std


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthModel:
    """How well the twin's mesh lines are known, and from when a depth is at the end of its search."""

    model_scatter: tuple[float, float, float] = deciding(
        (0.02, 0.05, 0.12),
        of="line of mesh harmonic 1, 2, 3",
        meaning="standard deviation of the transmission error's lines by the structure's tolerance",
        source="structures drawn within ±3 % of the stiffnesses of the reference rig",
    )
    pinion_scatter: tuple[float, float, float] = deciding(
        (0.06, 0.08, 0.14),
        of="line of mesh harmonic 1, 2, 3",
        meaning="the same of the pinion's own motion",
        source="as model_scatter, with 4–6 % for the pinion's inertias and shaft, which join in",
    )
    shape_scatter: float = deciding(
        0.015 / 100e-6,
        unit="1/m",
        meaning="relative standard deviation of a depth by the shape of the profile, per depth",
        source="flanks worn by static forces and measured with a curve of dynamic ones: 0.9, 2.7 and 5.9 % at 100, 200 "
        "and 400 µm (reference rig, 10 Hz, 10 N·m)",
    )
    shape_stated: float = deciding(
        0.0085 / 100e-6,
        unit="1/m",
        meaning="the same as a depth's band and a life state it",
        source="derivation: flanks wear by forces anywhere between static and wholly dynamic ones; the root mean "
        "square of a uniform share of the differences above, their largest over √3",
    )
    floor: float = deciding(
        0.05e-6,
        unit="m",
        meaning="deviation of real unworn teeth, at one mesh line, that the twin does not know",
        source="not derived: deviations of real unworn teeth, a few hundredths of a micrometre",
    )
    at_limit: float = deciding(
        0.995,
        of="the range searched",
        meaning="share of the range from which a depth is said to be at its end",
        source="not derived: half of the last step of the scan",
    )


DEPTH = DepthModel()
HARMONICS = 3  # mesh harmonics that carry the depth
GRADED = np.linspace(0, 1, 41) ** 1.5  # depths of the first scan, of the range searched
CLOSE = 3e-10  # [m]: a thousandth of what the least depth is uncertain by
STENCIL = np.array([[-1.0], [0.0], [1.0]])
ACCURACY = 1e-9  # of a step of the search [m]
PHASES = np.linspace(-np.pi, np.pi, 120, endpoint=False)  # of the mesh, where the scan looks first [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class Gauge:
    """What the encoders of one window measure of the depth."""

    lines: np.ndarray  # y_k, less y_k⁰ where `from_unworn`, complex (HARMONICS,) [m]
    from_unworn: bool  # whether lines are what wear changed
    lines_std: np.ndarray  # noise of the real and imaginary part (HARMONICS,) [m]
    mean: float | None  # y_0 − c [m], None where it is not known
    mean_std: float  # [m]
    phase: float | None  # ψ̄ [rad], None at first
    phase_std: float  # [rad]
    pinion_only: bool = False  # whether the lines are the pinion's motion, without the gear's
    structure: np.ndarray | None = None  # ln of the lines by each value of the rig file (values, HARMONICS), complex

    @property
    def scatter(self) -> np.ndarray:
        """σ_k/|m_k| (HARMONICS,)."""
        return np.array(DEPTH.pinion_scatter if self.pinion_only else DEPTH.model_scatter)

    @property
    def sources(self) -> np.ndarray:
        """What the lines may be off by, a row for each independent cause; σ_k where no rig file says better."""
        return np.diag(self.scatter) if self.structure is None else self.structure


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthEstimate:
    """A depth with its uncertainty and the mesh phase."""

    depth: float  # [m]
    std: float  # of this window alone, model scatter included [m]
    noise_std: float  # the part of it that is independent from window to window [m]
    phase: float  # ψ [rad]
    from_lines: float  # depth that the lines alone would give [m]
    misfit: float  # 2·J at the minimum, without Σ ln σ_k², over its degrees of freedom
    at_limit: bool  # whether the deeper bound of the search stopped it
    by_mean: float = 0.0  # by how much that 2·J is above the one of the lines alone
    band: tuple[float, float] | None = None  # 5 and 95 % [m] where they do not follow from the standard deviation
    stated: float = 1.0  # standard deviation that the band states, over `std`

    @property
    def stated_std(self) -> float:
        """What the band states: ± Z95 of it hold 90 % [m]."""
        return self.stated * self.std


Response = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Depths (m,) → m_k, less m_k(0) if from unworn (m, HARMONICS), and m_0 (m,)."""


def freedom(gauge: Gauge) -> int:
    """Degrees of freedom of a fit of depth and phase."""
    return 2 * HARMONICS + (gauge.mean is not None) - 2


def best_phase(model: np.ndarray, gauge: Gauge, weight: np.ndarray) -> float:
    """ψ that fits the lines at a given depth, prior included; model and weight (HARMONICS,)."""
    return float(_best_phases(model[None], gauge, weight[None])[0])


def _best_phases(models: np.ndarray, gauge: Gauge, weights: np.ndarray) -> np.ndarray:
    """ψ that fits the lines at each of m depths: a scan, then Newton steps; both (m, HARMONICS) → (m,)."""
    prior, spread = (0.0, np.inf) if gauge.phase is None else (gauge.phase, gauge.phase_std)
    return best_phases(np.conj(models) * gauge.lines * weights, PHASES, prior, spread)


def _wrap(angle):
    """Angle into (−π, π]."""
    return -(((-np.asarray(angle)) + np.pi) % (2 * np.pi) - np.pi)


class _Costs(NamedTuple):
    """The parts of 2·J at some depths, and the phase there, (m,) each."""

    lines: np.ndarray  # with what the phase was before
    size: np.ndarray  # Σ ln σ_k², which grows with the lines
    mean: np.ndarray
    phase: np.ndarray  # ψ [rad]

    def total(self, mean_weight: np.ndarray | float) -> np.ndarray:
        return self.lines + self.size + mean_weight * self.mean


def _costs(depths: np.ndarray, gauge: Gauge, response: Response) -> _Costs:
    """What explaining a gauge by depths (…) [m] costs; (…) each."""
    models, means = response(depths.ravel())
    σ2 = (gauge.scatter * np.abs(models)) ** 2 + gauge.lines_std**2 + DEPTH.floor**2
    ψ = _best_phases(models, gauge, 1 / σ2)
    k = np.arange(1, models.shape[1] + 1)
    lines = (np.abs(np.exp(1j * k * ψ[:, None]) * models - gauge.lines) ** 2 / σ2).sum(axis=1)
    if gauge.phase is not None:
        lines += (_wrap(ψ - gauge.phase) / gauge.phase_std) ** 2
    mean = np.zeros_like(means) if gauge.mean is None else ((means - gauge.mean) / gauge.mean_std) ** 2
    return _Costs(*(part.reshape(depths.shape) for part in (lines, np.log(σ2).sum(axis=1), mean, ψ)))


def explained_at(depth: float, gauge: Gauge, response: Response) -> tuple[float, float]:
    """2·J of a gauge at a depth [m], without Σ ln σ_k², and the mesh phase ψ there [rad]."""
    costs = _costs(np.array([depth]), gauge, response)
    return float(costs.lines[0] + costs.mean[0]), float(costs.phase[0])


def estimate_depth(gauge: Gauge, response: Response, shallowest: float, deepest: float) -> DepthEstimate:
    """The depth between two bounds [m] that explains the gauge best, and that of its lines alone.

    A scan finds where either cost is lowest; there its slope, by depths CLOSE together, is brought to zero. The cost
    has kinks at the points of the wear curve, where its slope changes sign at once.
    """
    grid = shallowest + (deepest - shallowest) * GRADED
    weights = np.array([1.0]) if gauge.mean is None else np.array([1.0, 0.0])  # of the mean
    i = _costs(grid, gauge, response).total(weights[:, None]).argmin(axis=1)

    def slopes(depths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        near = np.clip(depths + CLOSE * STENCIL, shallowest, deepest)
        less, same, more = _costs(near, gauge, response).total(weights)
        return (more - less) / (2 * CLOSE), (more - 2 * same + less) / CLOSE**2

    depths = rising_roots(slopes, grid[i], grid[np.maximum(i - 1, 0)], grid[np.minimum(i + 1, grid.size - 1)], ACCURACY)
    costs = _costs(depths, gauge, response)
    depth, cost = float(depths[0]), float(costs.lines[0] + costs.mean[0])
    misfit = cost / freedom(gauge)
    spread = _uncertainty(gauge, response, depth, misfit, (shallowest, deepest))
    return DepthEstimate(
        depth=depth,
        std=spread.std,
        noise_std=spread.noise,
        phase=float(costs.phase[0]),
        from_lines=float(depths[-1]),
        misfit=misfit,
        by_mean=cost - float(costs.lines[-1]),
        at_limit=depth > shallowest + DEPTH.at_limit * (deepest - shallowest),
        stated=spread.stated / spread.std if np.isfinite(spread.std) else 1.0,
    )


class _Spread(NamedTuple):
    """Standard deviations of a depth [m]."""

    std: float  # that weighs it
    stated: float  # of its band
    noise: float  # independent from window to window


def _uncertainty(gauge: Gauge, response: Response, depth: float, misfit: float, bounds: tuple[float, float]) -> _Spread:
    """Uncertainty of the depth found between two bounds [m], to first order about it."""
    step = max(0.02 * depth, 0.3e-6)
    low, high = max(depth - step, bounds[0]), min(depth + step, bounds[1])
    (up, down, model), (mean_up, mean_down, _) = response(np.array([high, low, depth]))
    slope, mean_slope = (up - down) / (high - low), float(mean_up - mean_down) / (high - low)
    noise2 = gauge.lines_std**2
    σ2 = (gauge.scatter * np.abs(model)) ** 2 + noise2 + DEPTH.floor**2
    by_mean = 0.0 if gauge.mean is None else mean_slope**2 / gauge.mean_std**2
    information = float((np.abs(slope) ** 2 / σ2).sum()) + by_mean
    if information <= 0:
        return _Spread(float("inf"), float("inf"), float("inf"))
    lines_std = float(1 / np.sqrt(information))
    noise = float(np.sqrt((np.abs(slope) ** 2 * noise2 / σ2**2).sum())) / information
    parts = DepthParts(
        structure=structure_std(np.conj(slope) / σ2 / information, model, gauge.sources),
        fit=lines_std * float(np.sqrt(max(misfit, 0.0))),
        mean=0.0 if gauge.mean is None else float(np.sqrt(by_mean)) / information,
        noise=noise,
        shape=DEPTH.shape_stated * depth**2,
        alike=float(gauge.scatter[0] / DEPTH.model_scatter[0]),
    )
    std = float(np.hypot(lines_std * np.sqrt(max(misfit, 1.0)), DEPTH.shape_scatter * depth**2))
    return _Spread(std=std, stated=parts.std(depth), noise=noise)
