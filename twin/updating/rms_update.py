"""The paper's update of the wear coefficient, from the RMS of one accelerometer.

    D = RMS_sim/RMS_meas,      K ← K/D     until |RMS_sim/RMS_meas − 1| < 5 %

The depth since the last window follows from K; the level at a depth from the calibrated twin.

Source   paper, section 4.2
Holds    where the level rises with depth and the calibrated level is right; in trials the depth came out a quarter
         too small, because the level depends on damping and contact width more than on depth
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

MAX_ITERATIONS = 30  # each at most a factor LARGEST_STEP on K: far more than any coefficient is wrong by
LARGEST_STEP = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RmsTrack:
    """Wear so far and its rate by the RMS alone."""

    revolutions: float = 0.0
    work: float = 0.0  # x [rad/N]
    rate: float = 0.0  # κ = K·τ·ω1 [rad/N per revolution], 0 before the first window
    updates: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class RmsResult:
    """One window by the RMS alone."""

    track: RmsTrack
    rms_predicted: float
    rms_after: float
    updated: bool
    converged: bool
    iterations: int


def update(
    track: RmsTrack,
    revolutions: float,
    measured: float,
    level: Callable[[float], float],
    threshold: float,
    *,
    allowed: bool = True,
) -> RmsResult:
    """Updates the track by one window's RMS [m/s²]; level gives the twin's RMS at a work x [rad/N]."""
    n = revolutions - track.revolutions
    rate = track.rate
    rms = predicted = level(track.work + rate * n)
    iterations = 0
    updated = allowed and n > 0 and abs(predicted / measured - 1) > threshold
    if updated:
        while abs(rms / measured - 1) >= threshold and iterations < MAX_ITERATIONS:
            rate *= min(max(measured / rms, 1 / LARGEST_STEP), LARGEST_STEP)
            rms = level(track.work + rate * n)
            iterations += 1
    converged = abs(rms / measured - 1) < threshold
    return RmsResult(
        track=RmsTrack(
            revolutions=revolutions,
            work=track.work + rate * n,
            rate=rate,
            updates=track.updates + updated,
        ),
        rms_predicted=predicted,
        rms_after=rms,
        updated=updated,
        converged=converged,
        iterations=iterations,
    )
