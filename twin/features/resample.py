"""Band-limited interpolation of evenly spaced values by quintic splines.

    x(u) = Σ c_n β⁵(u − n),   H(f) = sinc⁶ f / Σ_k sinc⁶(f + k)

c   B-spline coefficients: the spline passes through every value
u   position in samples
f   frequency in cycles per sample
H   what the spline passes on of a line at f: 1 − 4e-5 at 0.16, 0.9986 at 0.25, 0.98 at 0.35; known, so
    lines read from interpolated values are divided by it

Source   M. Unser, Splines: a perfect fit, IEEE Signal Processing Magazine 16(6) (1999) 22–38
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft

from twin import compiled
from twin.errors import WindowError
from twin.features.gaps import filled
from twin.features.transforms import hann

DEGREE = 5
LONGEST_GAP = 2  # samples that a straight line may bridge


@dataclass(frozen=True, eq=False, kw_only=True)
class AngleSignal:
    """Values on an even grid of pinion angle; what several features take from them is computed once, when asked for."""

    start: float  # absolute pinion angle of the first value [rad]
    step: float  # [rad]
    values: np.ndarray  # (n,) float64, no NaN
    usable: np.ndarray  # (n,) bool, false where the values were lost

    @property
    def angles(self) -> np.ndarray:
        """Absolute pinion angle of each value [rad], (n,)."""
        return self.start + self.step * np.arange(self.values.size)

    @property
    def turns(self) -> float:
        """Pinion turns covered."""
        return self.values.size * self.step / (2 * np.pi)

    @cached_property
    def coefficients(self) -> np.ndarray:
        """B-spline coefficients of the values (n,)."""
        return coefficients(self.values)

    @cached_property
    def length(self) -> int:
        """Values that a transform is of, with zeros behind these where that is quicker."""
        return int(fft.next_fast_len(self.values.size, real=True))

    def order_of_bin(self, k: int) -> float:
        """Order of pinion rotation of bin k of a transform."""
        return k * 2 * np.pi / (self.length * self.step)

    def spectrum_under(self, weight) -> np.ndarray:
        """Transform of the values without their mean under a weight (n,); complex (length//2 + 1,)."""
        return fft.rfft(weight * (self.values - (weight @ self.values) / weight.sum()), self.length)

    @cached_property
    def spectrum(self) -> np.ndarray:
        """The transform under the Hann window; complex (length//2 + 1,)."""
        return self.spectrum_under(hann(self.values.size))


def spline_response(frequency) -> np.ndarray:
    """H(f), what the quintic spline passes on of a line; f [cycles per sample], (n,) → (n,)."""
    f = np.asarray(frequency, dtype=float)
    with np.errstate(divide="ignore"):  # nothing is left of a line at the sampling rate
        folded = [f / (f + k) for k in (-3, -2, -1, 1, 2, 3)]  # sinc(f + k) over sinc f, but for the sign
        return 1 / (1 + sum(np.power(share * share, (DEGREE + 1) // 2) for share in folded))


def coefficients(values) -> np.ndarray:
    """B-spline coefficients of evenly spaced values without NaN; (n,) → (n,)."""
    return compiled.quintic_coefficients(values)


def at(spline_coefficients, position) -> np.ndarray:
    """The spline at each position [samples]; (m,) → (m,)."""
    return compiled.quintic_at(spline_coefficients, position)


def splined(values, longest_gap: int) -> tuple[np.ndarray, np.ndarray]:
    """B-spline coefficients of values with gaps, and which values may be used; (n,) → (n,), (n,) bool."""
    whole, usable = filled(values, longest_gap)
    return coefficients(whole), usable


def interpolate(spline: tuple[np.ndarray, np.ndarray], position) -> tuple[np.ndarray, np.ndarray]:
    """The values of `splined` at each position [samples] (m,), and where they may be used (m,)."""
    whole, usable = spline
    out = at(whole, position)
    if usable.all():
        return out, np.ones(position.size, dtype=bool)
    near = np.clip(np.rint(position).astype(int), 0, usable.size - 1)
    return out, usable[near]


@dataclass(frozen=True, eq=False, kw_only=True)
class AngleGrid:
    """An even grid of pinion angle, as fine as the samples of a channel, and where these are to be read for it."""

    start: float  # absolute pinion angle of the first value [rad]
    step: float  # [rad]
    per_turn: float  # samples per pinion turn, mean
    position: np.ndarray  # of each value, in samples (n,)


def angle_grid(samples, track) -> AngleGrid:
    """The grid of a channel; of every channel with the same rate, start and number of samples.

    samples  Samples of one channel
    track    AngleTrack of the same window
    """
    per_turn = samples.rate / track.speed
    step = 2 * np.pi / per_turn
    first, last = samples.start, samples.start + (samples.values.size - 1) / samples.rate
    begin, end = track.ends
    low = track.start if begin >= first else track.angle_at(first)
    high = track.stop if end <= last else track.angle_at(last)
    if not high - low > 2 * np.pi:
        raise WindowError(f"the channel and the angle have {max(high - low, 0) / (2 * np.pi):.2f} turns in common")
    grid = low + step * np.arange(int((high - low) / step))
    position = (track.time(grid) - samples.start) * samples.rate
    return AngleGrid(start=low, step=step, per_turn=per_turn, position=position)


def on_angle(
    samples,
    track,
    longest_gap: int = LONGEST_GAP,
    grid: AngleGrid | None = None,
    spline: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[AngleSignal, float]:
    """A time signal on an even grid of the smoothed pinion angle, as fine as its own samples.

    samples      Samples of one channel
    track        AngleTrack of the same window
    longest_gap  samples that a straight line may bridge
    grid         of the channel, where it is known
    spline       of the channel, as `splined` gives it, where it is known
    returns the signal, and its mean number of samples per pinion turn: spline_response(order/that) is what
    interpolation left of a line
    """
    if not np.isfinite(samples.values).any():
        raise WindowError("not one of the channel's samples is valid")
    grid = grid or angle_grid(samples, track)
    values, usable = interpolate(spline or splined(samples.values, longest_gap), grid.position)
    return AngleSignal(start=grid.start, step=grid.step, values=values, usable=usable), grid.per_turn


def by_angle_error(samples, track, spline: tuple[np.ndarray, np.ndarray]) -> list[np.ndarray]:
    """What the timing of the track's edges adds to each value of `on_angle`, in each of its errors; (n,) each.

    spline  of the channel, as `splined` gives it
    """
    grid = angle_grid(samples, track)
    angles = grid.start + grid.step * np.arange(grid.position.size)
    right = interpolate(spline, grid.position)[0]
    return [
        interpolate(spline, (wrong.time(angles) - samples.start) * samples.rate)[0] - right for wrong in track.in_error
    ]
