"""Wear histories of a stochastic process of their own, with measured depths: thousands in seconds, without vibration.

The process knows nothing of the twin's tracker. Work grows by gamma increments (J. M. van Noortwijk, Reliab. Eng. Syst.
Saf. 94 (2009) 2–21) whose mean follows the class of the history:

    constant       one coefficient
    running-in     1.4 to 2.5 times as fast at first, decaying over 2 to 12 % of the life
    step           faster or slower by a factor of 1.25 to 2 after 15 to 40 % of the life: seen at half-life
    step ahead     the same after 55 to 85 %, which nothing has shown at half-life
    drift          ln of the coefficient is a Wiener process of 0.1 to 0.5 over the life, or a trend of that size
    changing       blocks of two conditions, in each of which the twin's work is off by 3 % (standard deviation)
    power          depth as a power of 0.6 to 1.7 of the revolutions, from the first to the last
    with effects   an effect that sets in shifts all later depths by 1.5 % (standard deviation)

Depth follows from work by the reference machine's wear curve, bent by a random shape. A measured depth is off by a
common error that changes slowly with depth, by scatter and by a floor, as large as campaigns show (COMMON, SCATTER,
FLOOR: campaigns J). What is stated of them is what the twin states.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from time import process_time

import numpy as np
from scipy.special import ndtri

from benchmarks.bench_dynamics import CONDITION, reference_model
from benchmarks.reliability_scores import Scored, scored
from twin.updating.measurement import SCATTER as SCATTER_STATED
from twin.updating.remaining_life import RemainingLife, remaining_life
from twin.updating.tracker import WearTrack
from twin.updating.wear_forecast import forecast_of
from twin.updating.wear_points import WearPoint, with_point
from twin.wear.curve import MasterCurve

CLASSES = ("constant", "running-in", "step", "step ahead", "drift", "changing", "with effects", "power")
STEPS = 2000  # of the process, over twice the mean life
COMMON, SCATTER, FLOOR = 0.009, 0.0015, 0.06e-6  # standard deviations of measured depths: relative, relative, [m]
ALONG = 3.0  # distance in ln depth over which the common error changes
SHAPE = 0.015 / 100e-6  # relative bend of the wear curve by depth, one standard deviation [1/m]
NOISE = 0.003, 0.02  # relative standard deviation of the wear of a whole life by the gamma process
STATED_OWN = SCATTER_STATED.relative, SCATTER_STATED.floor  # what the twin states from window to window
STATED_SHARED = 0.008, 0.06e-6  # and of all depths together, in the median of campaigns of the sets wide and clean
EXPECTED = 1.5  # wear rate of the rig file over the true one
MARKS = {"half-life": 0.5, "end": 0.9}  # share of the life that is behind the machine
LEAST_WINDOWS = 3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class History:
    """One machine; n windows."""

    kind: str
    seed: int
    counts: np.ndarray  # revolutions of the windows (n,)
    depths: np.ndarray  # true depth at them (n,) [m]
    measured: np.ndarray  # (n,) [m]
    end: float  # depth at the end of life [m]
    life: float  # revolutions at the end of life


@cache
def curve() -> MasterCurve:
    """The reference machine's wear curve."""
    model = reference_model(1024)
    return MasterCurve.build(model, CONDITION, model.unworn, 320e-6)


@cache
def _table() -> tuple[np.ndarray, np.ndarray]:
    depths = np.linspace(curve().start_depth, 320e-6, 1600)
    return depths, np.array([curve().work_at(d) for d in depths])


def rate_of(kind: str, t: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Wear rate over time, 1 at the mean; t = 1 is the life at a constant rate."""
    sign = random.choice([-1.0, 1.0])
    match kind:
        case "running-in":
            return 1 + random.uniform(0.4, 1.5) * np.exp(-t / random.uniform(0.02, 0.12))
        case "step" | "step ahead":
            at = random.uniform(0.15, 0.4) if kind == "step" else random.uniform(0.55, 0.85)
            return np.where(t > at, np.exp(sign * random.uniform(np.log(1.25), np.log(2.0))), 1.0)
        case "drift":
            size = random.uniform(0.1, 0.5)
            if random.random() < 0.5:
                return np.exp(sign * size * np.minimum(t, 2.0))
            return np.exp(np.cumsum(random.normal(0, size * np.sqrt(t[1] - t[0]), t.size)))
        case "power":
            q = random.choice([random.uniform(0.6, 0.85), random.uniform(1.2, 1.7)])
            return q * t ** (q - 1)
        case "changing":
            errors = random.normal(0, 0.03, 2)
            block = (t / random.uniform(0.05, 0.25)).astype(int) % 2
            return np.exp(errors[block])
    return np.ones_like(t)


def drawn(kind: str, seed: int) -> History:
    """A history of a class."""
    random = np.random.default_rng([CLASSES.index(kind), seed, 16])
    depths, work = _table()
    end = random.uniform(40e-6, 250e-6)
    bend = random.normal(0, SHAPE)
    bent = work * (1 + bend * (depths - depths[0]))
    x_end = float(np.interp(end, depths, bent))
    life = 10 ** random.uniform(3.7, 5.3)
    t = np.linspace(0, 2.5, STEPS + 1)
    mean = rate_of(kind, 0.5 * (t[1:] + t[:-1]), random) * np.diff(t)
    shape = mean * STEPS / 2.5 / (STEPS / 2.5 * random.uniform(*NOISE) ** 2)
    x = x_end * np.concatenate([[0.0], np.cumsum(random.gamma(shape) * mean / shape)])
    true = np.interp(x, bent, depths)
    true_life = float(np.interp(x_end, x, t))
    n = int(random.integers(8, 40))
    at = np.sort(random.uniform(0.3, 1.0, n)).cumsum()
    at = at / at[-1] * 0.97 * true_life
    here = np.interp(at, t, true)
    return History(
        kind=kind, seed=seed, counts=at * life, depths=here, measured=_measured(kind, here, random), end=end,
        life=true_life * life,
    )  # fmt: skip


def _measured(kind: str, depths: np.ndarray, random: np.random.Generator) -> np.ndarray:
    y = np.log(np.maximum(depths, 1e-7))
    K = np.exp(-np.abs(y[:, None] - y[None]) / ALONG) + 1e-9 * np.eye(y.size)
    common = COMMON * np.linalg.cholesky(K) @ random.normal(size=y.size)
    if kind == "with effects":
        common = common + random.normal(0, 0.015) * (np.arange(y.size) > random.uniform(0.1, 0.8) * y.size)
    scatter = SCATTER * np.exp(random.normal(0, 0.7))
    noise = depths * (common + scatter * random.normal(size=y.size)) + FLOOR * random.normal(size=y.size)
    return np.maximum(depths + noise, 1e-8)


def wear_points(history: History) -> tuple[WearPoint, ...]:
    """What the twin keeps of the measured depths."""
    made = curve()
    out = []
    for count, measured in zip(history.counts.tolist(), history.measured.tolist(), strict=True):
        depth = max(measured, made.start_depth)
        slope = made.work_per_depth(depth)
        shared, own = (float(np.hypot(r * depth, floor)) for r, floor in (STATED_SHARED, STATED_OWN))
        out.append(
            WearPoint(
                revolutions=count,
                depth=depth,
                work=made.work_at(depth),
                shared_std=shared * slope,
                own_std=own * slope,
            )
        )
    return tuple(out)


def _quantile(life: RemainingLife, probability: float) -> float:
    return float(life.at(ndtri([probability]))[0])


def followed(history: History) -> Iterator[Scored]:
    """The life that the twin states at half-life and near the end, against the truth."""
    points = wear_points(history)
    track = WearTrack.unworn(EXPECTED * points[-1].work / points[-1].revolutions)
    kept: tuple[WearPoint, ...] = ()
    for point, after in zip(points, [*history.counts[1:], np.inf], strict=True):
        track = track.followed(point.revolutions, point.work, point.own_std)
        kept = with_point(kept, point)
        for what, share in MARKS.items():
            if point.revolutions <= share * history.life < after and len(kept) >= LEAST_WINDOWS:
                begun = process_time()
                life = remaining_life(
                    track, curve(), 0.0, history.end, forecast=forecast_of(kept, track.revolutions)
                )  # fmt: skip
                left = history.life - point.revolutions
                beyond = life.beyond(left)
                yield scored(
                    partial(_quantile, life), left, 0.0 if beyond is None else 1 - beyond, group="drawn",
                    kind=history.kind,
                    what=what, campaign=f"{history.kind}-{history.seed}", by="gear-twin",
                    seconds=process_time() - begun,
                )  # fmt: skip
