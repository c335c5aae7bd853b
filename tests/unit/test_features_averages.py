"""Synchronous averages straight from the samples: against closed forms, and against one channel at a time."""

from __future__ import annotations

import numpy as np
import pytest

from twin import compiled
from twin.errors import WindowError
from twin.features.angle import angle_track
from twin.features.averages import Splines, average_places, synchronous_averages
from twin.features.resample import angle_grid, spline_response
from twin.windows import Edges, Samples

RATE, SECONDS, SPEED = 12800.0, 6.0, 10.03
RNG = np.random.default_rng(5)


def angle_at(t, change):
    """Pinion angle [rad] at speeds that swing by a share of the mean."""
    return 2 * np.pi * SPEED * (t + change * np.sin(0.9 * t) / 0.9)


def machine(signals, change=0.0, start=0.0):
    """Channels that are functions of the pinion angle, and the track of a pinion encoder."""
    fine = np.linspace(0, SECONDS, 400_001)
    count = int(angle_at(SECONDS, change) * 256 / (2 * np.pi))
    edges = np.interp(2 * np.pi * np.arange(1, count) / 256, angle_at(fine, change), fine)
    t = start + np.arange(int((SECONDS - start) * RATE)) / RATE
    channels = [Samples(rate=RATE, start=start, values=signal(angle_at(t, change))) for signal in signals]
    return channels, angle_track(Edges(per_rev=256, first_index=1, times=edges))


def averages_of(channels, track, periods):
    places = average_places(channels[0], track, angle_grid(channels[0], track), periods)
    return synchronous_averages(Splines.of(channels), places, periods)


@pytest.mark.parametrize("change", [0.0, 0.05])
@pytest.mark.parametrize("start", [0.0, 0.013])
def test_the_average_of_a_pattern_is_the_pattern(change, start):
    def pattern(angle):
        return 3 + np.cos(19 * angle + 0.3) + 0.5 * np.sin(40 * angle)

    def slower(angle):
        return np.cos(7 * 19 / 52 * angle)

    channels, track = machine([pattern, slower, lambda angle: -pattern(angle)], change, start)
    first, second, third = averages_of(channels, track, (1.0, 52 / 19))
    average, turns = first[0]
    assert turns in (58, 59, 60)
    angle = 2 * np.pi * np.arange(average.size) / average.size
    assert average == pytest.approx(pattern(angle), abs=2e-4)
    assert third[0][0] == pytest.approx(-average, abs=1e-12)
    average, turns = second[1]
    assert turns in (20, 21)
    assert average == pytest.approx(np.cos(7 * 2 * np.pi * np.arange(average.size) / average.size), abs=2e-4)


def test_a_line_is_attenuated_once():
    order = 380  # 0.3 cycles per sample
    (channel,), track = machine([lambda angle: np.cos(order * angle)])
    response = float(spline_response(order * track.speed / RATE))
    average, _ = averages_of([channel], track, (1.0,))[0][0]
    lines = np.abs(np.fft.rfft(average)) * 2 / average.size
    assert response < 0.997
    assert lines[order] == pytest.approx(response, abs=2e-4)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_channels_taken_together_are_those_of_each_alone_also_with_gaps(count):
    signals = [
        lambda angle, k=k: np.cos((19 + k) * angle) + 0.1 * RNG.standard_normal(angle.size) for k in range(count)
    ]
    channels, track = machine(signals, 0.03)
    channels[-1].values[20_000:20_400] = np.nan
    channels[0].values[500] = np.nan  # bridged
    together = averages_of(channels, track, (1.0, 52 / 19))
    grid = angle_grid(channels[0], track)
    for channel, found in zip(channels, together, strict=True):
        whole, usable = Splines.of([channel]).one(0)
        for (average, turns), place in zip(found, average_places(channel, track, grid, (1.0, 52 / 19)), strict=True):
            values = compiled.quintic_at(whole, place.ravel()).reshape(place.shape)
            kept = usable[np.clip(np.rint(place).astype(int), 0, usable.size - 1)].all(axis=1)
            assert turns == kept.sum()
            assert average == pytest.approx(values[kept].mean(axis=0), abs=1e-13)
    turns = [found[0][1] for found in together]
    assert turns[-1] < len(average_places(channels[0], track, grid, (1.0,))[0])


def test_a_period_that_is_too_long_or_never_whole_is_said():
    (channel,), track = machine([np.cos])
    too_long = averages_of([channel], track, (1.0, 1000.0))[0]
    assert isinstance(too_long[1], WindowError) and "needs more than" in str(too_long[1])
    channel.values[::700] = channel.values[1::700] = channel.values[2::700] = np.nan
    lost = averages_of([channel], track, (1.0,))[0][0]
    assert isinstance(lost, WindowError) and str(lost) == "no period of 1 turns is without a gap"
