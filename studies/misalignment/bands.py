"""Lines, mesh bands and sidebands of a signal over whole turns.

    x(θ) = X_0 + Re Σ_o X_o·e^{i·o·θ}          RMS of a band = sqrt(Σ |X_o|²/2),  o = n·z − 2 … n·z + 2

A signal of a steady run repeats with the turn, so that its lines are those of one turn, and there is nothing between
them. The bands are read by what reads them from measured signals (features/orders), from the turn repeated.

Source   D. Dąbrowski et al., Diagnostyka 2(62) (2012), chapter 3 and eq. (4)
Holds    whole turns without transients
"""

from __future__ import annotations

from math import pi

import numpy as np

from twin.errors import ParameterError
from twin.features.orders import mesh_bands
from twin.features.resample import AngleSignal

HARMONICS, SIDEBANDS = 5, 2
_TURNS = 8  # the turn is repeated so often for the bands: its window then keeps lines two orders off out of them


def whole_turn(signal: np.ndarray, teeth: int, mesh_periods: int) -> np.ndarray:
    """One turn of a signal (n,) that was kept over a turn, or over one mesh period that repeats."""
    if mesh_periods == 1:
        return np.tile(signal, teeth)
    if mesh_periods == teeth:
        return signal
    raise ParameterError(f"{mesh_periods} mesh periods are neither one nor the {teeth} of a turn")


def shaft_lines(turn: np.ndarray) -> np.ndarray:
    """Complex peak amplitude X_o of every order of rotation of a turn (n,); → (n//2 + 1,), the mean first."""
    lines = 2 * np.fft.rfft(turn) / turn.size
    lines[0] /= 2
    return lines


def band_rms(turn: np.ndarray, teeth: int) -> np.ndarray:
    """RMS of mesh harmonics 1 … 5, each with its sidebands up to ± 2 orders of rotation; (n,) → (5,)."""
    values = np.tile(turn, _TURNS)
    signal = AngleSignal(start=0.0, step=2 * pi / turn.size, values=values, usable=np.ones(values.size, dtype=bool))
    return mesh_bands(signal, teeth, HARMONICS, SIDEBANDS)


def sideband_ratio(turn: np.ndarray, teeth: int, order: int) -> np.ndarray:
    """Larger of the two sidebands ± `order` of each mesh harmonic over that harmonic; (n,) → (5,)."""
    size = np.abs(shaft_lines(turn))
    mesh = teeth * np.arange(1, HARMONICS + 1)
    return np.maximum(size[mesh - order], size[mesh + order]) / size[mesh]


def derivative(turn: np.ndarray, omega: float, times: int) -> np.ndarray:
    """Of a turn (n,) with respect to time, `times` times, at a speed of rotation [rad/s]."""
    n = turn.size
    lines = np.fft.rfft(turn) * (1j * omega * np.arange(n // 2 + 1)) ** times
    return np.fft.irfft(lines, n)
