"""The mesh lines of every channel of one window, with their noise, as tracing uses them.

A channel's lines are complex amplitudes at k·z1, k = 1 … n, of the pinion's rotation; what was not read is NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.errors import NotAvailable
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.gear_age import unworn
from twin.model import Condition
from twin.rig import Rig
from twin.updating.conditions import condition_of, kind_of

CHANNELS = ("encoder", "torque", "acceleration")
HARMONICS = {"encoder": 5, "torque": 3, "acceleration": 10}
HIGHEST = max(HARMONICS.values())
HARMONIC = np.concatenate([np.arange(1, HARMONICS[c] + 1) for c in CHANNELS])  # of each line of all channels (L,)
_ENDS = np.cumsum([HARMONICS[c] for c in CHANNELS]).tolist()
PLACES = {c: slice(end - HARMONICS[c], end) for c, end in zip(CHANNELS, _ENDS, strict=True)}  # of a channel among them


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Observed:
    """The mesh lines of one window."""

    index: int
    condition: Condition
    revolutions: float
    worn: bool  # whether the flanks may have worn when it was recorded
    pinion_only: bool  # whether `encoder` is the pinion's own motion, for want of the gear's encoder
    lines: dict[str, np.ndarray]  # by channel (n,), complex [m], [N·m], [m/s²]
    std: dict[str, np.ndarray]  # of the real and of the imaginary part (n,)
    mean: float | None  # of the transmission error [m], its zero unknown
    torque_known: bool
    mounting: int = 0  # counts up where the discs' zeros have jumped: means are compared within one

    @property
    def loaded(self) -> float:
        """Torque [N·m]."""
        return self.condition.torque


def _read(lines: MeasuredLines | None, count: int) -> tuple[np.ndarray, np.ndarray]:
    y, std = np.full(count, np.nan, dtype=complex), np.full(count, np.nan)
    if lines is not None:
        k, values, σ = lines.mesh()
        wanted = k <= count
        y[k[wanted] - 1], std[k[wanted] - 1] = values[wanted], σ[wanted]
    return y, std


def observed(rig: Rig, features: WindowFeatures, index: int, level_fault: str | None = None) -> Observed:
    """One window; NotAvailable where it has no speed or no count of revolutions."""
    condition = condition_of(features, rig)
    if features.revolutions is None:
        raise NotAvailable("no absolute count of revolutions: the window cannot be compared with others")
    te = features.transmission_error
    pinion_only = te is None
    encoder = features.pinion_motion if pinion_only else te
    if encoder is not None and encoder.unit != "m":
        encoder = None
    heard = features.acceleration if level_fault is None else None
    found = {
        name: _read(lines, HARMONICS[name])
        for name, lines in (("encoder", encoder), ("torque", features.torque), ("acceleration", heard))
    }
    mean = None if te is None or te.get(0) is None or te.unit != "m" else te.at(0).real
    return Observed(
        index=index,
        condition=condition,
        revolutions=features.revolutions,
        worn=kind_of(features, rig) == "measurement" and not unworn(features.revolutions, features.age_known),
        pinion_only=pinion_only,
        lines={name: y for name, (y, _) in found.items()},
        std={name: σ for name, (_, σ) in found.items()},
        mean=mean,
        torque_known=features.torque_nm is not None,
    )


def chosen(windows: Sequence[Observed], most: int) -> list[Observed]:
    """At most so many windows: those of new flanks first, then the worn ones, evenly over the campaign."""
    fresh = [w for w in windows if not w.worn][: max(2, most // 2)]
    worn = [w for w in windows if w.worn]
    room = most - len(fresh)
    if len(worn) > room:
        worn = [worn[i] for i in np.unique(np.linspace(0, len(worn) - 1, room).round().astype(int))]
    return [*fresh, *worn]
