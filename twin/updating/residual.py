"""What the twin leaves of the measured vibration, window by window and over the latest windows.

    rest_k = Y_k − X_k·e^{ikφ}        mesh harmonic k: measured, and predicted at the mesh phase φ
    rest_o = Y_o                      any other line: the twin without effects predicts none
    waveform error = sqrt(Σ|rest|²/Σ|Y|²)

Units    Y, X in m/s², peak; errors and shares are fractions of one
Limits   lines up to mesh harmonic LINES and to the upper end of the band of the RMS
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.assessment import HarmonicBand, Residual, SpectralLine, Unavailable
from twin.features.window_features import WindowFeatures
from twin.updating.update import UpdateOutcome
from twin.wear.curve import LINES

BANDS = 5  # mesh harmonics that are shown by band
STRONGEST = 8  # lines that are shown


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowResidual:
    """The residual of one window."""

    rms_error: float  # relative, after the update
    measured: float  # energies of the lines: Σ|Y|² [(m/s²)²]
    left: float
    noise: float
    phase_known: bool  # whether the mesh phase was known: without it nothing is predicted line by line
    bands: tuple[HarmonicBand, ...]
    lines: tuple[SpectralLine, ...]  # strongest first
    between: float = 0.0  # 2·b², of the vibration between the lines


def residual_of_window(
    features: WindowFeatures, outcome: UpdateOutcome, teeth: tuple[int, int]
) -> WindowResidual | None:
    """One window's residual, line by line; None without acceleration lines."""
    lines, rms = features.acceleration, outcome.rms_measured
    if lines is None or rms is None:
        return None
    phase, speed = outcome.memory.phase, outcome.condition.speed_hz
    top = np.inf if features.band is None else features.band[1]
    measured = left = noise = 0.0
    rests = []
    for key, order, y, std in zip(lines.keys, lines.orders, lines.amplitudes, lines.std, strict=True):
        frequency = order * speed
        if not 0 < frequency <= top or key[0] > LINES:
            continue
        rest = y
        if key[1] == key[2] == 0 and key[0] > 0 and phase is not None:
            rest = y - outcome.lines[key[0] - 1] * np.exp(1j * key[0] * phase)
        measured += abs(y) ** 2
        left += abs(rest) ** 2
        noise += 2 * std**2
        rests.append((abs(rest) ** 2, order, frequency))
    rests.sort(reverse=True)
    return WindowResidual(
        rms_error=float(outcome.rms_after / rms - 1),
        measured=float(measured),
        left=float(left),
        noise=float(noise),
        between=2 * (features.noise_rms or 0.0) ** 2,
        phase_known=phase is not None,
        bands=_bands(features, outcome, teeth[0] * speed),
        lines=tuple(
            SpectralLine(order=float(o), frequency=float(f), share=float(e / measured))
            for e, o, f in rests[:STRONGEST]
        ),
    )  # fmt: skip


def _bands(features: WindowFeatures, outcome: UpdateOutcome, mesh_frequency: float) -> tuple[HarmonicBand, ...]:
    measured = features.mesh_bands or ()
    return tuple(
        HarmonicBand(
            harmonic=k,
            frequency=float(k * mesh_frequency),
            measured=rms,
            predicted=float(abs(outcome.lines[k - 1]) / np.sqrt(2)),
        )
        for k, rms in enumerate(measured[:BANDS], 1)
    )


def residual_over(recent: Sequence[WindowResidual]) -> Residual | Unavailable:
    """The residual over the latest windows, newest last."""
    if not recent:
        return Unavailable(reason="the residual is not available: no measurement window has been compared yet")
    measured, left = sum(r.measured for r in recent), sum(r.left for r in recent)
    return Residual(
        rms_error=float(np.sqrt(np.mean([r.rms_error**2 for r in recent]))),
        waveform_error=float(np.sqrt(left / measured)) if recent[-1].phase_known else None,
        windows=len(recent),
        bands=recent[-1].bands,
        lines=recent[-1].lines,
    )
