"""Whether the flanks tell that a revolution count which has fallen is that of the same gears: a counter began again.

    e = |E_k| − A_k(n),  A_k(n) = |E_k,last| + g_k·n,  g_k = (|E_k,last| − |E_k,before|)/(n_last − n_before)
    n = Σ g_k·(|E_k| − |E_k,last|)/Σ g_k²            no less than the new count, no more than the time since allows
    w = |E_k,last| − |E_k,first|                     what the machine has worn
    the same   √(Σ e²) ≤ share·√(Σ w²),   and √(Σ w²) ≥ clear·σ

The lines of the transmission error at mesh orders show the worn flanks, those at shaft orders the run-out of this pair.
Another pair, or a new one, would have to repeat all of them. While the machine has not worn beyond what the encoders
resolve, nothing is told.

E   lines of the transmission error of the window, of the last, the one before and the first window at such a speed and
    torque                                                                                              [m]
n   turns of the pinion since the last window;  σ standard deviation of the lines together
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class SameFlanksThresholds:
    """When the transmission error goes on from that of the windows before."""

    share: float = deciding(
        0.1, of="change of the transmission error since the first window",
        meaning="distance from its continuation up to which it goes on",
        source="not derived: chosen; new flanks are at 1, and a pair worn half as far at 0.5",
    )  # fmt: skip
    clear: float = deciding(
        20.0, of="standard deviation of the lines by the encoders' noise",
        meaning="change since the first window from which it tells",
        source="derivation: twice the noise of both windows is then within the share",
    )  # fmt: skip
    condition: float = deciding(
        0.1, of="speed and torque", meaning="difference up to which transmission errors are compared",
        source="not derived: deflection under load moves the error by as much of itself",
    )  # fmt: skip


DEFAULT = SameFlanksThresholds()


def turns_by_flanks(
    before: Sequence[WindowFeatures],
    now: WindowFeatures,
    turns: tuple[float, float],
    limits: SameFlanksThresholds = DEFAULT,
) -> float | None:
    """Turns of the pinion since windows before, in order of time, by the growth of the transmission error.

    turns    that it can have made, from and to
    returns  None where the transmission error does not go on from theirs
    """
    alike = [w for w in before if _alike(w, now, limits)]
    if len(alike) < 2 or now.transmission_error is None:
        return None
    keys = set(now.transmission_error.keys)
    for w in (first := alike[0], earlier := alike[-2], last := alike[-1]):
        keys &= set(w.transmission_error.keys) if w.transmission_error is not None else set()
    keys.discard((0, 0, 0))  # the mean depends on where the counters began
    shown, was, at_last, at_first = (_sizes(w.transmission_error, keys) for w in (now, earlier, last, first))
    apart = (last.revolutions or 0.0) - (earlier.revolutions or 0.0)
    growth = (at_last - was) / apart if apart > 0 else np.zeros(len(keys))
    made = float(np.clip((shown - at_last) @ growth / max(float(growth @ growth), 1e-300), *turns))
    worn = float(np.linalg.norm(at_last - at_first))
    noise = float(np.linalg.norm([now.transmission_error.std_at(*key) for key in keys]))
    goes_on = float(np.linalg.norm(shown - at_last - growth * made)) <= limits.share * worn
    return made if goes_on and worn >= limits.clear * noise else None


def _sizes(lines: MeasuredLines | None, keys: set[tuple[int, int, int]]) -> np.ndarray:
    assert lines is not None
    return np.abs([lines.at(*key) for key in sorted(keys)])


def _alike(w: WindowFeatures, now: WindowFeatures, limits: SameFlanksThresholds) -> bool:
    """Whether a window with a transmission error ran at the speed and torque of another."""
    if w.transmission_error is None or not w.speed_hz or not now.speed_hz:
        return False
    same_torque = w.torque_nm is None or now.torque_nm is None or _near(w.torque_nm, now.torque_nm, limits)
    return _near(w.speed_hz, now.speed_hz, limits) and same_torque


def _near(a: float, b: float, limits: SameFlanksThresholds) -> bool:
    return abs(a - b) <= limits.condition * abs(b)
