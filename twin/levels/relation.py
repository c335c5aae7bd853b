"""A relation between wear depth and vibration level, calibrated on cases whose depth was measured.

    level² = exp(2·a)·(background² + (gain·E(depth))²)

E           level that the twin predicts at a depth, one curve for each operating condition         [m/s²]
gain        from the twin's accelerometer to the machine's, one for each condition or one for all
background  level of the machine that does not come from the mesh, one for each condition        [m/s²]
a           difference of this assembly from the others: a number of standard deviation σ_a for all conditions at once

The residual in ln(level) is normal: a, common to the conditions of one case, and a rest of its own in each. Both are
estimated from the cases: σ_a² is the covariance of their residuals, the variance of the rest what remains.

The depth that belongs to levels is the posterior on an even grid of depths with a uniform prior. Where depths are not
ruled out that the level does not distinguish from the deepest, only a lower bound results; where the levels may be
those of unworn gears, the lower bound is zero.

Source   the level and its gain: paper, section 3.3; posterior by quadrature: A. Gelman et al., Bayesian Data Analysis,
         3rd ed., ch. 3
Holds    within the depths of the cases; for the sensor, the speeds and the load that they were measured with
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtri

from twin.closed_forms import ranks
from twin.errors import ParameterError
from twin.levels.curve import LevelCurve
from twin.model import Condition
from twin.quantiles import Z95
from twin.thresholds import deciding

GRID = 401  # depths of the posterior
LEAST_VARIANCE = 1e-6  # of the residual in ln(level): keeps a covariance invertible
DRAWS = 2000  # of a rising level
INDICATOR = "1"  # unit of a number without one
MODEL, CASES = "model", "monotone cubic"  # what gives the level by depth: the twin, or the cases alone (monotone.py)


@dataclass(frozen=True, slots=True, kw_only=True)
class RelationLimits:
    """When a relation exists, holds for a window, and still rises with depth."""

    least_cases: int = deciding(
        3, unit="cases", meaning="cases that a relation needs", source="derivation: gain, background and a scatter"
    )
    same_speed: float = deciding(
        0.02,
        of="speed of the condition",
        meaning="difference within which a window is of the condition",
        source="not derived: levels change fast with speed near a resonance",
    )
    same_torque: float = deciding(
        0.1,
        of="torque of the condition",
        meaning="difference within which a window is of the condition",
        source="not derived: the wander of a brake's torque",
    )
    least_falling: int = deciding(
        4,
        unit="cases",
        meaning="deepest cases that are called a region",
        source="not derived: fewer have no rank order",
    )
    unworn: float = deciding(
        0.05,
        meaning="chance of levels as far from those of unworn assemblies, down to which unworn gears are not ruled out",
        source="the lower end of the 5–95 % band",
    )
    chance: float = deciding(
        0.05,
        meaning="share of drawn rising levels that show as long a region, up to which the region is reported",
        source="the usual level of significance",
    )


LIMITS = RelationLimits()


@dataclass(frozen=True, eq=False, kw_only=True)
class Cases:
    """Levels at known depths: one entry an assembly of the machine."""

    name: tuple[str, ...]  # (n,)
    depth: np.ndarray  # largest depth (n,) [m]
    level: Mapping[str, np.ndarray]  # of every condition (n,) [m/s²]
    scatter: Mapping[str, np.ndarray]  # standard deviation within the case (n,) [m/s²], NaN where of one record

    def __post_init__(self) -> None:
        for label, level in self.level.items():
            if level.shape != self.depth.shape or not np.all(level > 0):
                raise ParameterError(f"{label}: one positive level a case is needed, {self.depth.size} in all")

    def only(self, which: np.ndarray) -> Cases:
        """Some of the cases; which (n,) bool."""
        return Cases(
            name=tuple(n for n, w in zip(self.name, which, strict=True) if w),
            depth=self.depth[which],
            level={k: v[which] for k, v in self.level.items()},
            scatter={k: v[which] for k, v in self.scatter.items()},
        )

    def under(self, labels: Collection[str]) -> Cases:
        """The cases with their levels under some of the conditions."""
        return replace(
            self,
            level={k: v for k, v in self.level.items() if k in labels},
            scatter={k: v for k, v in self.scatter.items() if k in labels},
        )

    @property
    def worn(self) -> np.ndarray:
        """Which are worn (n,) bool."""
        return self.depth > 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """What a table of levels states of one operating condition."""

    column: str
    unit: str  # g or m/s2 of a vibration level, INDICATOR of a number that the model does not predict

    @property
    def modelled(self) -> bool:
        """Whether the twin predicts it."""
        return self.unit != INDICATOR


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """Which terms the relation has."""

    background: bool = True
    one_gain: bool = False  # for all conditions
    run_in: bool = False  # assemblies with unworn gears have a background of their own


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthFound:
    """Depth from levels."""

    median: float  # [m]
    p05: float
    p95: float
    bounded: bool  # False where depths of one level with the deepest are not ruled out: only p05 says something
    unworn: bool = False  # whether unworn gears are not ruled out: then p05 is 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Unworn:
    """Levels of assemblies with unworn gears, conditions in the order of the relation's."""

    assemblies: int
    log_level: np.ndarray  # mean of ln(level) (m,)
    covariance: np.ndarray  # of ln(level) among them (m, m); zeros of a single one


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Machine, sensor and band that a relation belongs to; None where that was not stated."""

    asset: str | None = None
    curve: str = MODEL  # what gives the level by depth: MODEL or CASES
    causes: tuple[str, ...] = ()  # changes of its curves against the twin as its rig file describes it
    sensor: str | None = None  # accelerometer of the levels
    band: tuple[float, float] | None = None  # of the levels [Hz]


@dataclass(frozen=True, slots=True, kw_only=True)
class NotRising:
    """Deepest cases over which the level does not rise with depth."""

    start: float  # depth of the first of them [m]
    spearman: float  # ρ of depth and level
    p: float  # share of series that rise, with as much scatter, which show as many such cases


@dataclass(frozen=True, eq=False, kw_only=True)
class Relation:
    """Level against depth of every condition."""

    curves: Mapping[str, LevelCurve]
    background: Mapping[str, float]  # [m/s²]
    gain: Mapping[str, float]
    assembly_std: float  # σ_a
    rest_std: Mapping[str, float]
    deepest: float  # of the cases [m]
    unworn: Unworn | None = None  # None where no unworn assembly was measured
    correlation: np.ndarray | None = None  # of the rests, in the order of the curves (m, m); None: independent
    quantities: Mapping[str, Quantity] = field(default_factory=dict)  # of each condition; none where not stated
    origin: Origin = Origin()

    @property
    def teeth(self) -> tuple[int, int]:
        """Tooth counts of the pair that it is of."""
        return next(iter(self.curves.values())).teeth

    def level(self, label: str, depth) -> np.ndarray:
        """Level [m/s²] at depths [m]."""
        return np.hypot(self.background[label], self.gain[label] * self.curves[label].at(depth))

    def std(self, label: str) -> float:
        """Of ln(level) of a new assembly."""
        return float(np.hypot(self.assembly_std, self.rest_std[label]))

    def covariance(self, labels: Sequence[str]) -> np.ndarray:
        """S of ln(level) of a new assembly under several conditions (m, m)."""
        rest = np.diag([self.rest_std[k] for k in labels])
        if self.correlation is None:
            return rest**2 + self.assembly_std**2
        at = [list(self.curves).index(k) for k in labels]
        return rest @ self.correlation[np.ix_(at, at)] @ rest + self.assembly_std**2

    def depth(self, levels: Mapping[str, float]) -> DepthFound:
        """Depth from the levels [m/s²] of one assembly under some of the conditions."""
        labels = list(levels)
        grid, log = self._likelihood(levels)
        mass = np.cumsum(np.exp(log - log.max()))
        p05, median, p95 = np.interp([0.05, 0.5, 0.95], mass / mass[-1], grid)
        flat = grid >= self._told_to(labels)
        unworn = self._may_be_unworn(levels)
        return DepthFound(
            median=float(median),
            p05=0.0 if unworn else float(p05),
            p95=float(p95),
            bounded=bool(log[flat].max() - log.max() < -0.5 * Z95**2),
            unworn=unworn,
        )

    def _likelihood(self, levels: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Depths [m] and the logarithm of their likelihood, (GRID,) each."""
        unknown = set(levels) - set(self.curves)
        if unknown or not levels:
            raise ParameterError(f"no curve for {', '.join(map(repr, sorted(unknown)))}; {', '.join(self.curves)}")
        grid, labels = np.linspace(0, self.deepest, GRID), list(levels)
        off = np.array([np.log(levels[k]) - np.log(self.level(k, grid)) for k in labels])
        return grid, -0.5 * np.sum(off * np.linalg.solve(self.covariance(labels), off), axis=0)

    def log_density(self, levels: Mapping[str, float], depth: float) -> float:
        """Logarithm of the posterior density of a depth [m] within the relation, of an even one's [nat]."""
        grid, log = self._likelihood(levels)
        return float(np.interp(depth, grid, log) - np.log(np.mean(np.exp(log - log.max()))) - log.max())

    def _may_be_unworn(self, levels: Mapping[str, float]) -> bool:
        """Whether the levels [m/s²] are within what unworn assemblies have: their own scatter and a new assembly's."""
        if self.unworn is None:
            return False
        every, labels = list(self.curves), list(levels)
        at = [every.index(k) for k in labels]
        off = np.log([levels[k] for k in labels]) - self.unworn.log_level[at]
        S = self.covariance(labels) + self.unworn.covariance[np.ix_(at, at)]
        distance = off @ np.linalg.solve(S * (1 + 1 / self.unworn.assemblies), off)
        return bool(distance < chdtri(len(labels), LIMITS.unworn))

    def condition_of(self, speed_hz: float, torque: float | None) -> str | None:
        """The condition of a window by its speed [Hz] and torque [N·m], None where it is another."""
        for label, curve in self.curves.items():
            if label in self.quantities and not self.quantities[label].modelled:
                continue
            c = curve.condition
            near = abs(speed_hz / c.speed_hz - 1) <= LIMITS.same_speed
            if near and (torque is None or abs(torque / c.torque - 1) <= LIMITS.same_torque):
                return label
        return None

    def to_dict(self) -> dict[str, Any]:
        """The relation as JSON-safe data; of its curves depth and level alone."""
        unworn = self.unworn
        return {
            "of": {
                "asset": self.origin.asset,
                "curve": self.origin.curve,
                "causes": list(self.origin.causes),
                "sensor": self.origin.sensor,
                "band_hz": None if self.origin.band is None else list(self.origin.band),
            },
            "teeth": list(self.teeth),
            "conditions": {
                k: {
                    "speed_hz": c.condition.speed_hz,
                    "torque": c.condition.torque,
                    "depth": c.depth.tolist(),
                    "level": c.level.tolist(),
                    "background": self.background[k],
                    "gain": self.gain[k],
                    "rest_std": self.rest_std[k],
                    "column": self.quantities[k].column if k in self.quantities else None,
                    "unit": self.quantities[k].unit if k in self.quantities else None,
                }
                for k, c in self.curves.items()
            },
            "assembly_std": self.assembly_std,
            "deepest": self.deepest,
            "correlation": None if self.correlation is None else self.correlation.tolist(),
            "unworn": None
            if unworn is None
            else {
                "assemblies": unworn.assemblies,
                "log_level": unworn.log_level.tolist(),
                "covariance": unworn.covariance.tolist(),
            },
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Relation:
        conditions = data["conditions"]
        curves = {}
        for k, v in conditions.items():
            depth, level = np.array(v["depth"], float), np.array(v["level"], float)
            zero = np.zeros_like(depth)
            curves[k] = LevelCurve(
                teeth=(int(data["teeth"][0]), int(data["teeth"][1])),
                condition=Condition(speed_hz=v["speed_hz"], torque=v["torque"]),
                depth=depth,
                level=level,
                scatter=zero,
                apart=zero,
            )

        def each(name: str) -> dict[str, float]:
            return {k: float(v[name]) for k, v in conditions.items()}

        of, unworn, correlation = data["of"], data["unworn"], data["correlation"]
        band = of["band_hz"]

        return cls(
            curves=curves,
            background=each("background"),
            gain=each("gain"),
            rest_std=each("rest_std"),
            assembly_std=float(data["assembly_std"]),
            deepest=float(data["deepest"]),
            correlation=None if correlation is None else np.array(correlation, float),
            unworn=None
            if unworn is None
            else Unworn(
                assemblies=int(unworn["assemblies"]),
                log_level=np.array(unworn["log_level"], float),
                covariance=np.array(unworn["covariance"], float),
            ),
            quantities={k: Quantity(column=v["column"], unit=v["unit"]) for k, v in conditions.items() if v["column"]},
            origin=Origin(
                asset=of["asset"],
                curve=of["curve"],
                causes=tuple(of["causes"]),
                sensor=of["sensor"],
                band=None if band is None else (float(band[0]), float(band[1])),
            ),
        )

    def told_to(self, label: str) -> float:
        """Depth [m] from which on the level does not distinguish a depth from the deepest.

        Distinguished are depths where, of two new assemblies, one at each, the levels are in the curve's order 19 times
        of 20: their difference scatters by √2·std, so that the curve must differ by Z95·√2·std. That the 5–95 % bands
        of both do not overlap would ask for Z95·2·std, and the order is then right 99 times of 100.
        """
        return self._told_to([label])

    def _told_to(self, labels: Sequence[str]) -> float:
        """The same of several conditions together: the distance of their levels in units of what they scatter by."""
        grid = np.linspace(0, self.deepest, GRID)
        rise = np.log([self.level(k, grid[-1]) / self.level(k, grid) for k in labels])
        distance = np.sum(rise * np.linalg.solve(self.covariance(labels), rise), axis=0)
        apart = np.flatnonzero(distance > 2 * Z95**2)
        return float(grid[apart[-1] + 1]) if apart.size else 0.0


def common_variance(covariance: np.ndarray) -> float:
    """σ_a² of residuals in ln(level) with a covariance (m, m): the mean covariance of two conditions."""
    m = len(covariance)
    common = float(np.mean(covariance[~np.eye(m, dtype=bool)])) if m > 1 else 0.0
    return float(np.clip(common, 0.0, np.diag(covariance).min()))


def unworn_of(relation: Relation, cases: Cases) -> Relation:
    """The relation with the levels of the unworn assemblies among the cases."""
    count = int(np.sum(~cases.worn))
    if not count:
        return relation
    levels = np.log([cases.level[k][~cases.worn] for k in relation.curves])
    off = levels - levels.mean(axis=1, keepdims=True)
    return replace(
        relation,
        unworn=Unworn(assemblies=count, log_level=levels.mean(axis=1), covariance=off @ off.T / max(count - 1, 1)),
    )


def fit(cases: Cases, curves: Mapping[str, LevelCurve], form: Form | None = None) -> Relation:
    """The relation with the smallest residual of the cases in ln(level)."""
    form = form or Form()
    labels = list(curves)
    if cases.depth.size < LIMITS.least_cases:
        raise ParameterError(f"{cases.depth.size} cases are too few for a relation: at least {LIMITS.least_cases}")
    measured = {k: np.log(cases.level[k]) for k in labels}
    twin = {k: curves[k].at(cases.depth) for k in labels}

    m, worn = len(labels), cases.worn
    unworn_apart = form.background and form.run_in and not worn.all()

    def unpacked(p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gains, backgrounds of worn and of unworn assemblies, (m,) each."""
        p = np.exp(p)
        gain, p = (np.full(m, p[0]), p[1:]) if form.one_gain else (p[:m], p[m:])
        background = p[:m] if form.background else np.zeros(m)
        return gain, background, p[m:] if unworn_apart else background

    def off(p: np.ndarray) -> np.ndarray:
        gain, own, unworn = unpacked(p)
        return np.array(
            [
                measured[k] - np.log(np.hypot(np.where(worn, own[i], unworn[i]), gain[i] * twin[k]))
                for i, k in enumerate(labels)
            ]
        )

    start = [float(np.mean(measured[k] - np.log(twin[k]))) for k in labels]
    start = [float(np.mean(start))] if form.one_gain else start
    if form.background:
        start += [float(measured[k].min()) - 0.2 for k in labels] * (2 if unworn_apart else 1)
    p = least_squares(lambda p: off(p).ravel(), start, method="lm").x
    gain, background, _ = unpacked(p)
    residual = off(p)
    free = len(p) / m
    covariance = residual @ residual.T / max(residual.shape[1] - free, 1)
    variance = dict(zip(labels, np.diag(covariance), strict=True))
    common = common_variance(covariance)
    relation = Relation(
        curves=curves,
        background=dict(zip(labels, background.tolist(), strict=True)),
        gain=dict(zip(labels, gain.tolist(), strict=True)),
        assembly_std=float(np.sqrt(common)),
        rest_std={k: float(np.sqrt(max(v - common, LEAST_VARIANCE))) for k, v in variance.items()},
        deepest=float(cases.depth.max()),
    )
    return unworn_of(relation, cases)


def falling_region(depth: np.ndarray, level: np.ndarray, *, draws: int = DRAWS) -> NotRising | None:
    """The longest run of deepest cases over which the level does not rise with depth (Spearman's ρ ≤ 0).

    Many runs are looked at and each may not rise by chance. So the rising level b + g·depth^q that fits best in
    ln(level) is drawn again with its residual as scatter, and p is the share of draws with a run as long. None where
    every run of `least_falling` and more cases rises or p > `chance`.

    depth  (n,) [m], all above 0
    level  (n,) [m/s²]
    """
    order = np.argsort(depth)
    d, r = depth[order], level[order]
    (length,), (ρ,) = _not_rising(d, r[None])
    if not length:
        return None
    rising, std = _rising(d, r)
    drawn = rising * np.exp(std * np.random.default_rng(1).standard_normal((draws, d.size)))
    p = float(1 + np.sum(_not_rising(d, drawn)[0] >= length)) / (1 + draws)
    return None if p > LIMITS.chance else NotRising(start=float(d[-length]), spearman=float(ρ), p=p)


def _not_rising(depth: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cases of the longest run at the end with ρ ≤ 0, and ρ; depth (n,) sorted, level (draws, n) → (draws,) each."""
    length, spearman = np.zeros(len(level), dtype=int), np.zeros(len(level))
    for count in range(LIMITS.least_falling, depth.size + 1):
        a, b = ranks(depth[-count:]), ranks(level[:, -count:])
        a, b = a - a.mean(), b - b.mean(axis=1, keepdims=True)
        ρ = b @ a / np.sqrt(np.maximum(a @ a * (b**2).sum(axis=1), 1.0))  # ranks: 0 only where none differ
        length, spearman = np.where(ρ <= 0, count, length), np.where(ρ <= 0, ρ, spearman)
    return length, spearman


def _rising(depth: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, float]:
    """Levels of b + g·depth^q with all three above 0 (n,), and standard deviation of their residual in ln(level)."""
    x, y = np.log(depth / depth.max()), np.log(level)

    def off(p: np.ndarray) -> np.ndarray:
        return np.logaddexp(p[0], p[1] + np.exp(p[2]) * x) - y

    starts = ([float(y.min()) - 0.5, float(y.max()), log_power] for log_power in (-0.7, 0.0, 0.7))
    found = min((least_squares(off, start) for start in starts), key=lambda f: f.cost)
    return np.exp(y + found.fun), float(np.sqrt(2 * found.cost / max(x.size - 3, 1)))
