"""Signs of a window that something is new: cheap figures that stay put as long as nothing is.

    misfit     of the encoders' mesh lines, as the depth's estimate leaves it
    waveform   energy of the acceleration's lines that the twin with its learned factors misses, over that measured
    pinion     rms of the transmission error's lines at orders 3 … 15 of the pinion, and of the gear: teeth  [m]
    between    acceleration between the orders, over the whole
    strange    amplitude of tones and of lines at orders of no shaft [m/s²]
    kurtosis   of the most impulsive band

A window is new where a sign is MORE times the largest that has been traced before, and over its floor.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.report import comparison
from twin.rig import Rig
from twin.updating.history import WindowInput
from twin.updating.update import UpdateOutcome

MORE = 1.5
FLOORS = {
    "misfit": 1.0,
    "waveform": 0.01,
    "pinion": 0.15e-6,
    "gear": 0.15e-6,
    "between": 0.05,
    "strange": 0.1,
    "kurtosis": 8.0,
}
TEETH_ORDERS = range(3, 16)


def change_indicators(rig: Rig, taken: WindowInput, outcome: UpdateOutcome) -> dict[str, float]:
    """The figures of one measurement window, by name; what cannot be read is left out."""
    out: dict[str, float] = {}
    features, te = taken.features, taken.features.transmission_error
    if outcome.estimate is not None:
        out["misfit"] = outcome.estimate.misfit
    compared = comparison(features, outcome, rig.teeth)
    if compared is not None and compared["measured"] > 0 and compared["phase_known"]:
        out["waveform"] = compared["left"] / compared["measured"]
    if te is not None and te.unit == "m":
        for name, keys in (
            ("pinion", [(0, p, 0) for p in TEETH_ORDERS]),
            ("gear", [(0, 0, g) for g in TEETH_ORDERS]),
        ):
            lines = [te.get(*key) for key in keys]
            seen = [abs(y) for y in lines if y is not None]
            if seen:
                out[name] = float(np.sqrt(0.5 * np.sum(np.square(seen))))
    if features.rms and features.noise_rms is not None:
        out["between"] = features.noise_rms / features.rms
    if taken.non_gear is not None:
        tones = [amplitude for _, _, amplitude, _, _ in taken.non_gear.tones]
        out["strange"] = float(sum(tones) + sum(a for _, a in taken.non_gear.lines))
        if taken.non_gear.kurtosis is not None:
            out["kurtosis"] = taken.non_gear.kurtosis
    return out


def is_new(found: Mapping[str, float], traced: Mapping[str, float]) -> bool:
    """Whether any sign stands out from what has been traced before."""
    return any(value > max(MORE * traced.get(name, 0.0), FLOORS[name]) for name, value in found.items())


def widened(traced: Mapping[str, float], found: Mapping[str, float]) -> dict[str, float]:
    """The largest signs traced, with one window more."""
    return {name: max(traced.get(name, 0.0), found.get(name, 0.0)) for name in {**traced, **found}}
