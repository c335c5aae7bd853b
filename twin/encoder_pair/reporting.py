"""What the two encoders of a pair tell of one window: the section `pair` of the answer, JSON-safe data.

    run-out in µm = amplitude as an angle of its own wheel · base radius of that wheel

Encoders alone give angles: micrometres stand only where base radii are known, or are given as assumed. A wheel that
runs out and a disc that sits beside its centre do the same to them, so that no effect is named by this.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, pi, radians
from typing import Any

import numpy as np

from twin.encoder_pair.motion import PairMotion, pair_motion, ratio_moved
from twin.errors import WindowError
from twin.report import MICRO, not_available
from twin.rig import Rig
from twin.windows import SHAFTS, Edges, Window

CURVE_POINTS = 480
SPEED_POINTS = 200
CONTRADICTED = 3.0  # deviations of the measured ratio from which a stated one is contradicted
DISC = "its encoder's disc"


def pair_of(rig: Rig, window: Window) -> dict[str, Any] | None:
    """`pair` of one window, or why it is not available; None where the window has no two encoders."""
    if any(shaft not in window.encoders for shaft in SHAFTS):
        return None
    edges = window.encoders["pinion"], window.encoders["gear"]
    try:
        motion = pair_motion(*edges)
    except WindowError as error:
        return not_available(f"the pair's motion is not available: {error}")
    section = _section(motion, edges, window.duration)
    if rig.has("gears.pinion.teeth", "gears.gear.teeth"):
        z1, z2 = rig.teeth
        section["stated"] = _stated(z2 / z1, f"{z2}/{z1} teeth", motion.ratio, motion.ratio_std)
    radii = base_radii(rig)
    return section if radii is None else in_micrometres(section, radii, assumed=False)


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


def in_micrometres(section: Mapping[str, Any], radii: tuple[float, float], *, assumed: bool) -> dict[str, Any]:
    """The section with run-out in µm on these base radii [m] of pinion and gear.

    assumed  whether the rig file does not give them; their ratio is then held beside the measured one
    """
    ratio = section["ratio"]
    run_out = []
    for term in section["run_out"]:
        gear = term["shaft"] == "gear"
        scale = radii[1] / ratio["value"] if gear else radii[0]  # 1 µrad · 1 m = 1 µm
        run_out.append(term | {"amplitude_um": term["amplitude_urad"] * scale, "std_um": term["std_urad"] * scale})
    stated = section["stated"]
    if stated is None:
        kind = "assumed base radii" if assumed else "base radii"
        said = f"{kind} {radii[1] * 1e3:g}/{radii[0] * 1e3:g} mm"
        stated = _stated(radii[1] / radii[0], said, ratio["value"], ratio["std"])
    known = {"pinion_mm": radii[0] * 1e3, "gear_mm": radii[1] * 1e3, "assumed": assumed}
    return {**section, "run_out": run_out, "base_radii": known, "stated": stated}


def _stated(value: float, said: str, ratio: float, std: float) -> dict[str, Any]:
    """A stated ratio beside the measured one."""
    off = abs(value - ratio) / std
    return {"ratio": value, "from": said, "deviations": off, "contradicted": off > CONTRADICTED}


def _section(motion: PairMotion, edges: tuple[Edges, Edges], duration: float) -> dict[str, Any]:
    per_count = 2 * pi / edges[0].per_rev
    speed, turned = _speeds(edges, duration), motion.angle / (2 * pi)
    return {
        "ratio": {"value": motion.ratio, "unit": "", "std": motion.ratio_std},
        "teeth_that_fit": [f"{q.numerator}/{q.denominator}" for q in motion.teeth],
        "stated": None,
        "turns": dict(zip(SHAFTS, motion.turns, strict=True)),
        "speed_hz": {"mean": _mean_speed(edges[0]), "highest": max(speed["pinion_hz"])},
        "run_out": [
            {
                "shaft": SHAFTS[r.wheel - 1],
                "multiple": r.multiple,
                "amplitude_urad": r.amplitude * MICRO,
                "std_urad": r.std * MICRO,
                "amplitude_um": None,
                "std_um": None,
                "not_told_from": [DISC, *(f"{k}× a turn of the {SHAFTS[w - 1]}" for w, k in r.alike)],
            }
            for r in motion.run_out
        ],
        "base_radii": None,
        "rest_urad": {"before": float(motion.before.std()) * MICRO, "after": float(motion.after.std()) * MICRO},
        "missed_counts": [
            {"time_s": t, "pinion_turns": float(np.interp(t, motion.time, turned)), "counts": s / per_count}
            for t, s in motion.steps
        ],
        "sharp_steps": [
            {
                "time_s": float(motion.time[j.index]),
                "pinion_turns": float(turned[j.index]),
                "counts": j.size / per_count,
                "shaft": None if j.wheel is None else SHAFTS[j.wheel - 1],
                "turn": j.turn,
                "times": j.seen,
                "ratio_if_missed": None if j.wheel is None else motion.ratio + ratio_moved(motion.ratio, j),
            }
            for j in motion.jumps
        ],
        "transmission_error": _curve(motion),
        "speed": speed,
    }


def _mean_speed(edges: Edges) -> float:
    """From the first edge to the last [Hz]."""
    good = np.flatnonzero(np.isfinite(edges.times))
    first, last = edges.times[good[[0, -1]]]
    return float((good[-1] - good[0]) / edges.per_rev / (last - first))


def _curve(motion: PairMotion) -> dict[str, list[float]]:
    """The rest before and after over the pinion's turns, means of neighbours."""
    size = -(-motion.angle.size // CURVE_POINTS)
    n = motion.angle.size // size * size

    def means(values: np.ndarray, scale: float, digits: int) -> list[float]:
        return np.round(values[:n].reshape(-1, size).mean(axis=1) * scale, digits).tolist()

    return {
        "pinion_turns": means(motion.angle, 1 / (2 * pi), 4),
        "before_urad": means(motion.before, MICRO, 1),
        "after_urad": means(motion.after, MICRO, 1),
    }


def _speeds(edges: tuple[Edges, Edges], duration: float) -> dict[str, list[float]]:
    """Speed of either shaft against time, means over even steps; 0 where no edge passes."""
    grid = np.linspace(0.0, duration, SPEED_POINTS + 1)
    out = {"time_s": np.round((grid[1:] + grid[:-1]) / 2, 4).tolist()}
    for shaft, e in zip(SHAFTS, edges, strict=True):
        good = np.flatnonzero(np.isfinite(e.times))
        turned = np.interp(grid, e.times[good], good / e.per_rev)
        out[f"{shaft}_hz"] = np.round(np.diff(turned) / np.diff(grid), 5).tolist()
    return out
