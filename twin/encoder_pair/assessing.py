"""What the two encoders of a pair say of one window, as an assessment.

    run-out as a length = amplitude as an angle of its own wheel · base radius of that wheel

Encoders alone give angles; lengths need base radii. Eccentric teeth and an eccentric encoder disc look the same to an
encoder, so that no effect is named.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians

import numpy as np

from twin.assessment import (
    BaseRadii,
    EncoderPair,
    MissedCount,
    PairCurve,
    PairRemainder,
    PairSpeed,
    PairSpeeds,
    ParameterValue,
    RunOut,
    SharpStep,
    StatedRatio,
    Turns,
    Unavailable,
)
from twin.encoder_pair.motion import PairMotion, pair_motion, ratio_moved
from twin.encoder_pair.motion import RunOut as FittedRunOut
from twin.errors import WindowError
from twin.rig import Rig
from twin.thresholds import deciding
from twin.windows import SHAFTS, Edges, Window

CURVE_POINTS = 480
SPEED_POINTS = 200
DISC = "its encoder's disc"


@dataclass(frozen=True, slots=True, kw_only=True)
class RatioThresholds:
    """When a stated ratio is contradicted."""

    contradicted: float = deciding(
        3.0, unit="standard deviations", meaning="distance of the measured ratio from a stated one that contradicts it",
        source="convention: three standard deviations",
    )  # fmt: skip


DEFAULT = RatioThresholds()


def assess_pair(rig: Rig, window: Window, index: int) -> EncoderPair | Unavailable | None:
    """The pair's motion in one window, or why it is not available; None where the window has no two encoders."""
    if any(shaft not in window.encoders for shaft in SHAFTS):
        return None
    edges = window.encoders["pinion"], window.encoders["gear"]
    try:
        motion = pair_motion(*edges)
    except WindowError as error:
        return Unavailable(reason=f"the pair's motion is not available: {error}")
    radii = base_radii(rig)
    speed = _speeds(edges, window.duration)
    per_count = 2 * pi / edges[0].per_rev
    turned = motion.angle / (2 * pi)
    return EncoderPair(
        window=index,
        ratio=ParameterValue(value=motion.ratio, unit="", std=motion.ratio_std),
        tooth_counts=tuple(f"{q.numerator}/{q.denominator}" for q in motion.teeth),
        stated=_stated(rig, radii, motion),
        turns=Turns(pinion=motion.turns[0], gear=motion.turns[1]),
        pinion_speed=PairSpeed(mean=_mean_speed(edges[0]), highest=max(speed.pinion)),
        run_out=tuple(_run_out(r, motion.ratio, radii) for r in motion.run_out),
        base_radii=None if radii is None else BaseRadii(pinion=radii[0], gear=radii[1], assumed=False),
        rest=PairRemainder(before=float(motion.before.std()), after=float(motion.after.std())),
        missed_counts=tuple(
            MissedCount(time=t, pinion_turns=float(np.interp(t, motion.time, turned)), counts=s / per_count)
            for t, s in motion.steps
        ),
        sharp_steps=tuple(
            SharpStep(
                time=float(motion.time[j.index]),
                pinion_turns=float(turned[j.index]),
                counts=j.size / per_count,
                shaft=None if j.wheel is None else SHAFTS[j.wheel - 1],
                turn=j.turn,
                times=j.seen,
                ratio_if_missed=None if j.wheel is None else motion.ratio + ratio_moved(motion.ratio, j),
            )
            for j in motion.jumps
        ),
        transmission_error=_curve(motion),
        speed=speed,
    )


def base_radii(rig: Rig) -> tuple[float, float] | None:
    """Base radii of pinion and gear [m], given or by module, teeth and pressure angle; None where neither is."""
    out = []
    for wheel in SHAFTS:
        radius = rig.get(f"gears.{wheel}.base_radius")
        if radius is None and rig.has("gears.module", "gears.pressure_angle_deg", f"gears.{wheel}.teeth"):
            module, teeth = rig.get("gears.module"), rig.get(f"gears.{wheel}.teeth")
            radius = module * teeth / 2 * cos(radians(rig.get("gears.pressure_angle_deg")))
        if radius is None:
            return None
        out.append(float(radius))
    return out[0], out[1]


def stated_ratio(value: float, source: str, ratio: float, std: float, limits: RatioThresholds = DEFAULT) -> StatedRatio:
    """A stated ratio compared with the measured one."""
    off = abs(value - ratio) / std
    return StatedRatio(ratio=value, source=source, deviations=off, contradicted=off > limits.contradicted)


def _stated(rig: Rig, radii: tuple[float, float] | None, motion: PairMotion) -> StatedRatio | None:
    if rig.has("gears.pinion.teeth", "gears.gear.teeth"):
        z1, z2 = rig.teeth
        return stated_ratio(z2 / z1, f"{z2}/{z1} teeth", motion.ratio, motion.ratio_std)
    if radii is None:
        return None
    source = f"base radii {radii[1] * 1e3:g}/{radii[0] * 1e3:g} mm"
    return stated_ratio(radii[1] / radii[0], source, motion.ratio, motion.ratio_std)


def _run_out(fitted: FittedRunOut, ratio: float, radii: tuple[float, float] | None) -> RunOut:
    length = None
    if radii is not None:
        length = radii[0] if fitted.wheel == 1 else radii[1] / ratio  # an angle of the pinion is 1/R of the gear's
    return RunOut(
        shaft=SHAFTS[fitted.wheel - 1],
        multiple=fitted.multiple,
        amplitude=fitted.amplitude,
        std=fitted.std,
        indistinguishable_from=(DISC, *(f"{k}× a turn of the {SHAFTS[w - 1]}" for w, k in fitted.alike)),
        length=None if length is None else fitted.amplitude * length,
        length_std=None if length is None else fitted.std * length,
    )


def _mean_speed(edges: Edges) -> float:
    """From the first edge to the last [Hz]."""
    good = np.flatnonzero(np.isfinite(edges.times))
    first, last = edges.times[good[[0, -1]]]
    return float((good[-1] - good[0]) / edges.per_rev / (last - first))


def _curve(motion: PairMotion) -> PairCurve:
    """The remainder before and after over the pinion's turns, averaged over neighbouring edges."""
    size = -(-motion.angle.size // CURVE_POINTS)
    n = motion.angle.size // size * size

    def means(values: np.ndarray) -> tuple[float, ...]:
        return tuple(values[:n].reshape(-1, size).mean(axis=1).tolist())

    return PairCurve(
        pinion_turns=means(motion.angle / (2 * pi)), before=means(motion.before), after=means(motion.after)
    )


def _speeds(edges: tuple[Edges, Edges], duration: float) -> PairSpeeds:
    """Speed of either shaft against time, means over even steps; 0 where no edge passes."""
    grid = np.linspace(0.0, duration, SPEED_POINTS + 1)
    found = []
    for e in edges:
        good = np.flatnonzero(np.isfinite(e.times))
        turned = np.interp(grid, e.times[good], good / e.per_rev)
        found.append(tuple((np.diff(turned) / np.diff(grid)).tolist()))
    return PairSpeeds(time=tuple(((grid[1:] + grid[:-1]) / 2).tolist()), pinion=found[0], gear=found[1])
