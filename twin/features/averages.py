"""Synchronous averages of several channels, straight from their samples.

    x̄(θ) = (1/M)·Σ_m x(t(θ + m·P)),   x(t) the quintic spline through the samples (resample.py)

P   period: one turn of a gear
t   time at which the pinion is at an angle (angle.py)

Channels with one clock are taken four at once: they are read at the same places, and the filters that give their
coefficients wait for themselves, not for each other. The spline over time is read where the averages want it; nothing
is interpolated twice, so that a line of f cycles per sample keeps H(f) of its amplitude.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin import compiled
from twin.errors import WindowError
from twin.features.angle import AngleTrack
from twin.features.gaps import filled
from twin.features.orders import averaged_angles, mean_of_whole
from twin.features.resample import LONGEST_GAP, AngleGrid, at
from twin.windows import Samples

AT_ONCE = 4  # channels

Average = tuple[np.ndarray, int]  # over one period (points,), and of how many periods


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Splines:
    """Up to four channels with one clock as splines over time."""

    coefficients: np.ndarray  # (n, 4)
    usable: tuple[np.ndarray, ...]  # of each channel, (n,) bool: false where samples were lost

    @classmethod
    def of(cls, channels: Sequence[Samples]) -> Splines:
        """Of channels each of which has a valid sample."""
        whole, usable = zip(*(filled(samples.values, LONGEST_GAP) for samples in channels), strict=True)
        return cls(coefficients=compiled.quintic_coefficients_of_four(whole), usable=usable)

    def one(self, place: int) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (n,) of one channel, and which of its samples may be used (n,)."""
        return np.ascontiguousarray(self.coefficients[:, place]), self.usable[place]


def average_places(
    samples: Samples, track: AngleTrack, grid: AngleGrid, periods: Sequence[float]
) -> list[np.ndarray | WindowError]:
    """Where the values of the averages over some periods [pinion turns] lie in a channel, in samples.

    grid     of the channel
    returns  (periods, points) for each, with about as many points a turn as the channel has samples
    """
    out: list[np.ndarray | WindowError] = []
    for period in periods:
        try:
            angles = averaged_angles(grid.start, grid.step, grid.position.size, period, int(grid.per_turn * period))
        except WindowError as error:
            out.append(error)
        else:
            out.append((track.time(angles) - samples.start) * samples.rate)
    return out


def synchronous_averages(
    splines: Splines, places: Sequence[np.ndarray | WindowError], periods: Sequence[float]
) -> list[list[Average | WindowError]]:
    """The averages over some periods [pinion turns] of each channel, by channel.

    places  as `average_places` gives them
    """
    whole = [bool(usable.all()) for usable in splines.usable]
    out: list[list[Average | WindowError]] = [[] for _ in whole]
    for position, period in zip(places, periods, strict=True):
        means = None
        for place, found in enumerate(out):
            if isinstance(position, WindowError):
                found.append(position)
            elif whole[place]:
                means = compiled.quintic_means_of_four(splines.coefficients, position) if means is None else means
                found.append((means[place], len(position)))
            else:
                found.append(_of_whole_periods(splines, place, position, period))
    return out


def _of_whole_periods(splines: Splines, place: int, position: np.ndarray, period: float) -> Average | WindowError:
    """The average of one channel that has gaps."""
    coefficients, usable = splines.one(place)
    values = at(coefficients, position.ravel()).reshape(position.shape)
    try:
        return mean_of_whole(values, position, usable, period)
    except WindowError as error:
        return error
