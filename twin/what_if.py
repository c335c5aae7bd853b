"""What if the machine ran under another duty: its remaining life, and the probability of reaching a time.

    dd/dt = κ·Σ_i u_i·f_i/x_i'(d)/λ,      ln λ = s(z) widened by N(0, s_x²)

d     largest combined depth  [m]           t    running time  [s]
u_i   share of the running time, of condition i with pinion speed f_i  [Hz]
x_i'  work per depth of the wear curve under condition i  [rad/(N·m)]
κ     wear rate now  [rad/N per revolution], such that the present duty gives the stated life
s(z)  ln of the stated life over its median at a standard normal score z: what is known of depth, rate and curve
s_x   what is added where a load or speed lies outside those that wear has been seen under

A duty may change with time, in phases. λ is common to all of them: a machine that wears more slowly than expected
does so under every load. Archard's law makes the wear of a passage proportional to force and sliding distance; the
wear curve of a condition has the dynamic forces of its speed as well.

Source   as twin/wear/archard.py and twin/updating/remaining_life.py
Holds    mild wear; loads and speeds near those seen
Ignores  how a profile worn under one load wears under another: each curve is that of flanks worn under its own
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, hypot, inf, log, sqrt
from statistics import NormalDist

import numpy as np

from twin.assessment import Interval, Life, Preliminary, Unavailable, Wear
from twin.errors import NotAvailable, NotConverged, ParameterError
from twin.features.plausible import torque_contradiction
from twin.model import Condition
from twin.quantiles import Z95
from twin.rig import Rig
from twin.state import State
from twin.thresholds import deciding
from twin.updating.life import PROBABILITIES
from twin.updating.memory import Memory
from twin.updating.model_cache import curve_of, curve_under
from twin.updating.remaining_life import remaining_life, through_contact_loss
from twin.updating.segments import near_segment
from twin.updating.wear_forecast import forecast_of
from twin.wear.curve import MasterCurve

NORMAL = NormalDist()
STEPS = 200  # depths from the present one to the end of life
SCORES = np.linspace(-3.0, 3.0, 61)  # of the curve of survival


@dataclass(frozen=True, slots=True, kw_only=True)
class DutyLimits:
    """How far a duty may lie from what has been seen."""

    outside: float = deciding(
        0.3,
        of="ln of the ratio to the nearest load or speed seen",
        meaning="standard deviation that a life gains outside the loads and speeds that wear has been seen under",
        source="not derived: at twice the load, a fifth; Archard's law is linear in load only while wear stays mild",
    )
    speed_ratio: float = deciding(
        4.0,
        of="fastest speed seen or stated in [operating]",
        meaning="speed beyond which no life is stated",
        source="not derived: as the torque's (OperatingThresholds.torque_ratio)",
    )


DUTY = DutyLimits()


@dataclass(frozen=True, slots=True, kw_only=True)
class DutyPoint:
    """One operating condition and its share of the running time."""

    speed: float  # of the pinion [Hz]
    torque: float  # on the pinion's shaft [N·m]
    share: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.speed < 2000:
            raise ParameterError(f"speed = {self.speed:g} Hz of a duty is outside (0, 2000) Hz; rev/min?")
        if not 0 < self.torque < 1e6:
            raise ParameterError(f"torque = {self.torque:g} N·m of a duty is outside (0, 1e6) N·m")
        if not 0 < self.share <= 1:
            raise ParameterError(f"share = {self.share:g} of a duty is outside (0, 1]; percent?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase:
    """A duty for some running time."""

    points: tuple[DutyPoint, ...]
    duration: float = inf  # running time [s]; infinite: from then on

    def __post_init__(self) -> None:
        total = sum(p.share for p in self.points)
        if not self.points or abs(total - 1) > 0.01:
            raise ParameterError(f"the shares of a duty add up to {total:g}, not to 1")
        if not self.duration > 0:
            raise ParameterError(f"duration = {self.duration:g} s of a duty must be above 0")

    @property
    def speed(self) -> float:
        """Mean speed of the pinion [Hz]."""
        return sum(p.share * p.speed for p in self.points)


@dataclass(frozen=True, slots=True, kw_only=True)
class DutyLife:
    """The remaining life under a duty; running times in seconds, revolutions of the pinion."""

    quantiles: tuple[tuple[float, float | None, float | None], ...]  # probability, time, revolutions; None: no bound
    survival: tuple[tuple[float, float], ...]  # running time, probability that the life is longer
    probability: float | None  # that the life is longer than the time asked for; None: not asked, or not known
    at_least: bool = False  # whether the probability is a lower bound
    reached: bool = False
    notes: tuple[str, ...] = ()  # where the duty leaves what has been seen
    preliminary: Preliminary | None = None
    reason: str | None = None  # why only a lower bound is known

    def quantile(self, probability: float) -> float | None:
        """The stated running time of a probability [s]."""
        return next(time for p, time, _ in self.quantiles if p == probability)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Wear:
    """How fast depth grows: running time per depth of every phase, between depths, for λ = 1."""

    phases: tuple[Phase, ...]
    times: tuple[np.ndarray, ...]  # running time from the present depth on, phase by phase, (STEPS + 1,) [s]

    def end(self, factor: float) -> tuple[float, float]:
        """Running time [s] and revolutions to the end of life where wear takes `factor` times as long."""
        at, elapsed, turned = 0.0, 0.0, 0.0  # at: depth as an index into the table
        index = np.arange(STEPS + 1.0)
        for phase, times in zip(self.phases, self.times, strict=True):
            start = float(np.interp(at, index, times))
            needed = factor * float(times[-1] - start)
            if needed <= phase.duration:
                return elapsed + needed, turned + needed * phase.speed
            elapsed, turned = elapsed + phase.duration, turned + phase.duration * phase.speed
            at = float(np.interp(start + phase.duration / factor, times, index))
        return inf, inf


def what_if(
    rig: Rig, state: State, phases: Sequence[Phase], until: float | None = None, limit: float | None = None
) -> DutyLife:
    """The life of a machine under a duty, from its latest answer.

    until  running time whose probability of being reached is asked for [s]
    limit  a depth instead of the rig file's end of life, and below it [m]
    Raises NotAvailable where the machine has no life, or none can be stated under this duty; ParameterError where the
    duty cannot be.
    """
    life, wear = state.latest.life, state.latest.wear
    if isinstance(life, Unavailable) or not isinstance(wear, Wear) or life is None:
        why = life.reason if isinstance(life, Unavailable) else "no window has given a wear depth by the model yet"
        raise NotAvailable(f"a life under another duty is not available: {why}")
    if not phases or phases[-1].duration != inf or any(p.duration == inf for p in phases[:-1]):
        raise ParameterError("the last phase of a duty goes on without end, and the others have a duration")
    notes = _checked(rig, state.memory, phases)
    depth = wear.depth["combined"].median
    assert depth is not None
    if life.reached or depth >= life.limit:
        return _reached(life, phases[0], until, notes)
    added = DUTY.outside * _outside(state.memory, phases)
    if limit is not None and not depth < limit <= life.limit:
        raise ParameterError(
            f"limit = {limit * 1e6:.4g} µm is outside ({depth * 1e6:.4g}, {life.limit * 1e6:.4g}] µm, from the present "
            "depth to the end of life"
        )
    growth = _growth(rig, state.memory, life, depth, phases, limit or life.limit)
    if life.revolutions.median is None:
        return _lower_bound(life, growth, added, until, notes)
    own = _spread(rig, state.memory, life, wear.depth["combined"], limit or life.limit)
    return _distribution(life, growth, own.widened(added), until, notes)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Spread:
    """ln of a life over its median, by the standard normal score of its quantile."""

    scores: np.ndarray  # rising (m,)
    logs: np.ndarray  # (m,)

    def factor(self, score: float) -> float:
        """The life over its median; beyond the scores along a straight line through the outermost and the median."""
        held = min(max(score, self.scores[0]), self.scores[-1])
        return exp(float(np.interp(held, self.scores, self.logs)) * (score / held if held else 1.0))

    def widened(self, std: float) -> _Spread:
        """With an independent factor whose logarithm has a standard deviation."""
        return replace(self, logs=np.sign(self.scores) * np.hypot(self.logs, std * self.scores))


def _spread(rig: Rig, memory: Memory, life: Life, depth: Interval, limit: float) -> _Spread:
    """Spread of the life to a depth: that of the stated life, or, of a nearer depth, that of a life to it, wider by
    what the stated life has beyond the one to its own end.

    What all depths are off by together counts more to a nearer depth; wander of the rate and the shape of the curve
    count less.
    """
    median = life.revolutions.median
    known = [(NORMAL.inv_cdf(p), log(n / median)) for p, n in life.distribution if n and median]
    own = _spread_of(median, life.revolutions.p05)
    if own == 0 or not known:
        return _Spread(scores=SCORES, logs=np.zeros(SCORES.size))
    stated = _Spread(scores=np.array([z for z, _ in known]), logs=np.array([s for _, s in known]))
    if limit == life.limit or not depth.median or depth.p95 is None:
        return stated
    curve, base = curve_of(rig, memory), memory.segments[-1].start_work
    forecast = forecast_of(memory.points, memory.track.revolutions)
    ε = (depth.p95 - depth.p05) / (2 * Z95 * depth.median)
    if forecast is not None:  # which has what the windows state of it
        last = memory.points[-1]
        ε = sqrt(max(ε**2 - (last.shared_std / last.work) ** 2, 0.0))
    near, end = (
        remaining_life(memory.track, curve, base, to, ε, forecast=forecast) for to in (limit, life.limit)
    )  # fmt: skip
    to_near = _spread_of(near.median, near.p05)
    if to_near == 0:
        return stated
    beyond = sqrt(max(own**2 - _spread_of(end.median, end.p05) ** 2, 0.0))
    logs = np.log(near.at(SCORES) / near.median)
    return _Spread(scores=SCORES, logs=logs).widened(beyond)


def _spread_of(median: float | None, p05: float) -> float:
    """Standard deviation of ln N by two quantiles; 0 where there is none."""
    return log(median / p05) / Z95 if median and median < inf and 0 < p05 < median else 0.0


def _distribution(life: Life, growth: _Wear, spread: _Spread, until: float | None, notes: tuple[str, ...]) -> DutyLife:
    """The life's distribution carried over to another duty."""
    ends = {p: growth.end(spread.factor(NORMAL.inv_cdf(p))) for p in PROBABILITIES}
    return DutyLife(
        quantiles=tuple((p, *end) for p, end in ends.items()),
        survival=tuple((growth.end(spread.factor(z))[0], 1 - NORMAL.cdf(z)) for z in SCORES.tolist()),
        probability=None if until is None else _longer(growth, spread, until),
        notes=notes,
        preliminary=life.preliminary,
    )


def _longer(growth: _Wear, spread: _Spread, until: float) -> float:
    """The probability that the life is longer than a running time [s]."""
    if until <= 0:
        return 1.0
    low, high = -9.0, 9.0
    if not spread.logs.any():
        return float(growth.end(1.0)[0] > until)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if growth.end(spread.factor(middle))[0] < until else (low, middle)
    return 1 - NORMAL.cdf(0.5 * (low + high))


def _lower_bound(life: Life, growth: _Wear, added: float, until: float | None, notes: tuple[str, ...]) -> DutyLife:
    """Only the 5 % quantile is known: the growth is that of the life at it."""
    time, revolutions = growth.end(exp(-Z95 * added))
    known = until is not None and until <= time
    return DutyLife(
        quantiles=tuple((p, time, revolutions) if p == 0.05 else (p, None, None) for p in PROBABILITIES),
        survival=((0.0, 1.0), (time, 0.95)),
        probability=0.95 if known else None,
        at_least=known,
        notes=notes,
        preliminary=life.preliminary,
        reason=life.reason,
    )


def _reached(life: Life, phase: Phase, until: float | None, notes: tuple[str, ...]) -> DutyLife:
    """The end is reached: what is left is the chance that it is not, under the present duty."""
    left = [(p, n) for p, n in life.distribution]
    beyond = None
    if until is not None:
        turned = until * phase.speed
        known = [1 - p for p, n in left if n is not None and n <= turned]
        beyond = min(known, default=1.0)
    return DutyLife(
        quantiles=tuple((p, None if n is None else n / phase.speed, n) for p, n in left),
        survival=tuple((n / phase.speed, 1 - p) for p, n in left if n is not None),
        probability=beyond,
        reached=True,
        notes=notes,
        preliminary=life.preliminary,
    )


def _checked(rig: Rig, memory: Memory, phases: Sequence[Phase]) -> tuple[str, ...]:
    """What a duty leaves; NotAvailable where it leaves too much."""
    seen = [*memory.segments]
    fastest = max([rig.get("operating.pinion_speed_hz", 0.0), *(s.speed_hz for s in seen)])
    notes: dict[str, None] = {}
    for point in (p for phase in phases for p in phase.points):
        contradiction = torque_contradiction(rig, point.torque)
        if contradiction is not None:
            raise NotAvailable(f"a life under this duty is not available: {contradiction}")
        if point.speed > DUTY.speed_ratio * fastest:
            raise NotAvailable(
                f"a life under this duty is not available: {point.speed:.4g} Hz is more than {DUTY.speed_ratio:g} "
                f"times the fastest speed seen or stated ({fastest:.4g} Hz)"
            )
        for what, unit, value, known in (
            ("torque", "N·m", point.torque, [s.torque for s in seen]),
            ("speed", "Hz", point.speed, [s.speed_hz for s in seen]),
        ):
            if _beyond(value, known) > 0:
                notes[
                    f"a {what} of {value:.4g} {unit} lies outside those that wear has been seen under "
                    f"({min(known):.4g} to {max(known):.4g} {unit}): the band is widened"
                ] = None
    return tuple(notes)


def _beyond(value: float, seen: Sequence[float]) -> float:
    """How far a value lies outside those seen, as the logarithm of the ratio; a segment's tolerance is no distance."""
    nearest = min(max(value, min(seen)), max(seen))
    distance = abs(log(value / nearest))
    return distance if distance > 0.05 else 0.0


def _outside(memory: Memory, phases: Sequence[Phase]) -> float:
    """How far a duty lies outside the loads and speeds seen: the worst of each point, weighted by its share of wear."""
    worst = 0.0
    for phase in phases:
        load = sum(p.share * p.speed * p.torque for p in phase.points)
        worst = max(
            worst,
            sum(
                p.share * p.speed * p.torque / load
                * hypot(
                    _beyond(p.torque, [s.torque for s in memory.segments]),
                    _beyond(p.speed, [s.speed_hz for s in memory.segments]),
                )
                for p in phase.points
            ),
        )  # fmt: skip
    return worst


def _growth(rig: Rig, memory: Memory, life: Life, depth: float, phases: Sequence[Phase], limit: float) -> _Wear:
    """Running times between depths to a limit, such that the present condition gives the stated life."""
    whole = _work(curve_of(rig, memory), np.linspace(depth, life.limit, STEPS + 1))
    revolutions = life.revolutions.p05 if life.revolutions.median is None else life.revolutions.median
    rate = whole[-1] / revolutions  # κ of the stated life
    grid = np.linspace(depth, limit, STEPS + 1)
    now = whole if limit == life.limit else _work(curve_of(rig, memory), grid)
    works: dict[tuple[float, float], np.ndarray] = {}
    for point in (p for phase in phases for p in phase.points):
        condition = Condition(speed_hz=point.speed, torque=point.torque)
        key = (point.speed, point.torque)
        if key not in works:
            works[key] = now if near_segment(memory.segments[-1], condition) else _under(rig, memory, condition, grid)
    times = []
    for phase in phases:
        per_step = sum(p.share * p.speed / np.diff(works[p.speed, p.torque]) for p in phase.points)
        times.append(np.concatenate([[0.0], np.cumsum(1 / (rate * per_step))]))
    return _Wear(phases=tuple(phases), times=tuple(times))


def _under(rig: Rig, memory: Memory, condition: Condition, grid: np.ndarray) -> np.ndarray:
    try:
        return _work(curve_under(rig, memory, condition), grid)
    except NotConverged as reason:
        raise NotAvailable(f"a life under this duty is not available: {reason}") from None


def _work(curve: MasterCurve, grid: np.ndarray) -> np.ndarray:
    """Work from the first depth on (STEPS + 1,) [rad/N], with what contact loss adds spread beyond its onset."""
    depths = np.maximum(grid, curve.start_depth)
    work = np.array([curve.work_at(d) for d in depths])
    work = work - work[0]
    added, _ = through_contact_loss(curve, float(depths[0]), float(depths[-1]))
    if added and curve.loss_from is not None:
        onset = max(curve.loss_from, float(depths[0]))
        work += added * np.clip((depths - onset) / (depths[-1] - onset), 0.0, 1.0)
    steps = np.maximum(np.diff(work), 1e-12 * max(work[-1], 1e-300))
    return np.concatenate([[0.0], np.cumsum(steps)])
