"""Levels that no accelerometer or torque meter of this machine can have: wrong unit, offset, polarity.

gravity   an accelerometer that measures down to 0 Hz and is not level shows up to g = 9.80665 m/s² as its mean;
          upright exactly that. A mean of 1 m/s² is then gravity in g that was read as m/s², one of g²/(m/s²)
          gravity in m/s² that was read as g, and one of 1000·g gravity in mg that was read as g
"""

from __future__ import annotations

import numpy as np

from twin.assessment import Mistake
from twin.plausibility.context import Examined
from twin.plausibility.thresholds import LevelThresholds

G = 9.80665  # standard gravity [m/s²]
UNITS = (
    (1.0, "gravity in g that was read as m/s²?", 'the unit "g"'),
    (G * G, "gravity in m/s² that was read as g?", 'the unit "m/s2"'),
    (1000 * G, "gravity in mg that was read as g?", "scale = 0.001"),
)


def levels(seen: Examined, limits: LevelThresholds) -> list[Mistake]:
    """Accelerometers whose mean or level betrays a wrong unit, or whose offset hides the vibration."""
    found = []
    rms = {name: float(np.std(s.values)) for name, s in seen.vibrations.items()}
    for name, own in rms.items():
        mean = float(seen.window.accelerations[name].values.mean())
        others = [value for other, value in rms.items() if other != name]
        mistake = _gravity(name, mean, limits) or _level(name, own, limits) or _among(name, own, others, limits)
        found.append(mistake or _offset(name, mean, own, limits))
    return [m for m in found if m is not None]


def _gravity(name: str, mean: float, limits: LevelThresholds) -> Mistake | None:
    for value, likely, right in UNITS:
        if abs(abs(mean) / value - 1) < limits.gravity:
            return Mistake(
                kind="unit", channels=(f"accel/{name}",), evidence=f"its mean is {mean:.4g} m/s²",
                remedy=f"{likely} Then {right} would be right",
            )  # fmt: skip
    return None


def _level(name: str, rms: float, limits: LevelThresholds) -> Mistake | None:
    if limits.least <= rms <= limits.most or rms == 0:
        return None
    likely = "mV or mg that were read as V or g" if rms > limits.most else "V that were read as m/s²"
    return Mistake(
        kind="unit", channels=(f"accel/{name}",), evidence=f"its vibration is {rms:.3g} m/s² RMS ({rms / G:.3g} g)",
        remedy=f"{likely}? A gearbox has {limits.least:g} to {limits.most:g} m/s²: unit, sensitivity or scale",
    )  # fmt: skip


def _among(name: str, rms: float, others: list[float], limits: LevelThresholds) -> Mistake | None:
    """One accelerometer whose level is about a thousand times, or a thousandth of, that of the others."""
    if len(others) < limits.least_others:
        return None
    ratio = rms / float(np.median(others))
    if limits.thousandth < ratio < 1 / limits.thousandth:
        return None
    size = f"{ratio:.3g} times" if ratio > 1 else f"1/{1 / ratio:.3g} of"
    return Mistake(
        kind="unit", channels=(f"accel/{name}",), evidence=f"its level is {size} the median of the others",
        remedy="mV or mg against V or g? Check its unit, sensitivity or scale",
    )  # fmt: skip


def _offset(name: str, mean: float, rms: float, limits: LevelThresholds) -> Mistake | None:
    if abs(mean) < limits.offset * rms or abs(abs(mean) / G - 1) < limits.gravity:
        return None
    return Mistake(
        kind="offset", channels=(f"accel/{name}",),
        evidence=f"its mean is {mean:.4g} m/s², {abs(mean) / rms:.3g} times its vibration of {rms:.3g} m/s² RMS",
        remedy="the bias voltage of a supplied sensor (IEPE)? AC-couple its input, or the range is lost to it",
    )  # fmt: skip


def torque_polarity(seen: Examined, limits: LevelThresholds) -> list[Mistake]:
    """A torque at the pinion that brakes it, where the rig file states one that drives it."""
    samples, rated = seen.window.torques.get("pinion"), seen.rig.get("operating.input_torque")
    if samples is None or not rated or not np.isfinite(samples.values).any():
        return []
    mean = float(np.nanmean(samples.values))
    if mean * rated > 0 or abs(mean) < limits.least_torque * abs(rated):
        return []
    return [
        Mistake(
            kind="polarity", channels=("torque/pinion",),
            evidence=f"its mean is {mean:.4g} N·m, and the rig file states {rated:g} N·m",
            remedy="the torque meter's polarity? scale = -1 turns it: positive torque drives the pinion forward",
        )
    ]  # fmt: skip
