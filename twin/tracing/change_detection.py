"""Signs of a window that something is new: cheap figures that stay the same as long as nothing is.

    misfit          of the encoders' mesh lines, as the depth's estimate leaves it (chi-square per line)
    waveform        energy of the acceleration's lines that the twin with its learned factors misses, over that measured
    pinion, gear    rms of the transmission error's lines at orders 3 … of the pinion, and of the gear: teeth  [m]
    between         acceleration between the orders, over the whole
    unattributed    amplitude of tones and of lines at orders of no shaft [m/s²]
    kurtosis        of the most impulsive band

A window is new where a sign has grown beyond the largest that has been traced before, and is over its floor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.features.window_features import MeasuredLines
from twin.rig import Rig
from twin.scales import Scales
from twin.thresholds import deciding
from twin.updating.history import WindowInput
from twin.updating.residual import residual_of_window
from twin.updating.update import UpdateOutcome

LOWEST_TOOTH_ORDER = 3  # below lie run-out and misalignment


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeLimits:
    """Floors below which a sign means nothing, and the growth that makes it new."""

    growth: float = deciding(
        1.5,
        of="largest sign traced before",
        meaning="sign from which a window is traced at once",
        source="not derived: chosen",
    )
    misfit: float = deciding(
        1.0,
        meaning="floor of the encoders' misfit (chi-square per line)",
        source="derivation: the lines are then as far off as their standard deviation",
    )
    waveform: float = deciding(
        0.01,
        of="energy of the measured lines",
        meaning="floor of the energy that the twin does not predict",
        source="not derived: chosen; a waveform error of a tenth",
    )
    pinion_lines: float = deciding(
        0.25,
        of="pinion graduation error",
        meaning="floor of the transmission error at tooth orders of the pinion",
        source="0.15 µm on the reference rig, just above a healthy pinion's pattern; not derived: chosen",
    )
    gear_lines: float = deciding(
        0.09375,
        of="gear graduation error",
        meaning="floor of the transmission error at tooth orders of the gear",
        source="0.15 µm on the reference rig, as for the pinion; not derived: chosen",
    )
    between: float = deciding(
        0.05,
        of="RMS of the acceleration",
        meaning="floor of the acceleration between the orders",
        source="not derived: chosen",
    )
    unattributed: float = deciding(
        50.0,
        of="acceleration noise floor",
        meaning="floor of the amplitude of unattributed lines, all together",
        source="0.1 m/s² on the reference rig; not derived: chosen",
    )
    kurtosis: float = deciding(
        8.0,
        meaning="floor of the kurtosis of the most impulsive band (3 for Gaussian noise)",
        source="not derived: chosen above the 3 of Gaussian noise",
    )
    tooth_order_share: float = deciding(
        0.8,
        of="teeth of the pinion",
        meaning="highest order of a shaft that is read as a tooth line: below the first mesh harmonic's sidebands",
        source="not derived: chosen so that orders 3 to 15 are read for 19 teeth, below the mesh",
    )


CHANGE_LIMITS = ChangeLimits()


def change_indicators(
    rig: Rig, window: WindowInput, outcome: UpdateOutcome, limits: ChangeLimits = CHANGE_LIMITS
) -> dict[str, float]:
    """The figures of one measurement window, by name; what cannot be read is left out."""
    out: dict[str, float] = {}
    features, te = window.features, window.features.transmission_error
    if outcome.estimate is not None:
        out["misfit"] = outcome.estimate.misfit
    residual = residual_of_window(features, outcome, rig.teeth)
    if residual is not None and residual.measured > 0 and residual.phase_known:
        out["waveform"] = residual.left / residual.measured
    if te is not None and te.unit == "m":
        orders = range(LOWEST_TOOTH_ORDER, int(limits.tooth_order_share * rig.teeth[0]) + 1)
        out |= _rms_of("pinion", te, [(0, p, 0) for p in orders])
        out |= _rms_of("gear", te, [(0, 0, g) for g in orders])
    if features.rms and features.noise_rms is not None:
        out["between"] = features.noise_rms / features.rms
    if window.non_gear is not None:
        tones = [amplitude for _, _, amplitude, _, _ in window.non_gear.tones]
        out["unattributed"] = float(sum(tones) + sum(a for _, a in window.non_gear.lines))
        if window.non_gear.kurtosis is not None:
            out["kurtosis"] = window.non_gear.kurtosis
    return out


def _rms_of(name: str, lines: MeasuredLines, keys: list[tuple[int, int, int]]) -> dict[str, float]:
    """The rms of some lines under a name; empty where none of them was read."""
    seen = [abs(y) for y in (lines.get(*key) for key in keys) if y is not None]
    return {name: float(np.sqrt(0.5 * np.sum(np.square(seen))))} if seen else {}


def floors(scales: Scales, limits: ChangeLimits = CHANGE_LIMITS) -> dict[str, float]:
    """The floor of every sign of a machine, by name."""
    return {
        "misfit": limits.misfit,
        "waveform": limits.waveform,
        "pinion": limits.pinion_lines * scales.graduation[0],
        "gear": limits.gear_lines * scales.graduation[1],
        "between": limits.between,
        "unattributed": limits.unattributed * scales.acceleration,
        "kurtosis": limits.kurtosis,
    }


def is_new(
    shown: Mapping[str, float], traced: Mapping[str, float], scales: Scales, limits: ChangeLimits = CHANGE_LIMITS
) -> bool:
    """Whether any sign has grown beyond what has been traced before."""
    least = floors(scales, limits)
    return any(value > max(limits.growth * traced.get(name, 0.0), least[name]) for name, value in shown.items())


def widened(traced: Mapping[str, float], shown: Mapping[str, float]) -> dict[str, float]:
    """The largest signs traced, with one window more."""
    return {name: max(traced.get(name, 0.0), shown.get(name, 0.0)) for name in {**traced, **shown}}
