"""Edges of a shaft from sampled columns: levels of a quadrature encoder, a counter, pulses of a tachometer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from service.errors import InputError
from service.files.import_channel import COUNTS, PULSES, QUADRATURE, ChannelMapping
from service.files.import_columns import DataFile, Measured
from twin.encoder_pair.motion import forward_edges, quadrature
from twin.errors import WindowError
from twin.features.pulses import pulses_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counted:
    """What a quadrature encoder's levels, or a tachometer's pulses, came to."""

    times: np.ndarray  # of the edges passed forward (m,) [s]; NaN of one that was missed and not interpolated
    length: float  # of the record [s]
    figures: dict[str, float]
    first_index: int = 0  # number of the first edge within its turn, where a gap of the wheel marks the turn


def counted_edges(data: DataFile) -> dict[str, Counted]:
    """The edges of quadrature encoders and tachometers by channel label; InputError where one does not turn on."""
    out = {}
    for channel in data.mapping.channels:
        measured = data.channels[channel.label]
        try:
            if channel.unit == QUADRATURE:
                levels = quadrature(*np.asarray(measured.values))
                out[channel.label] = _of_counts(
                    levels.counts, measured.rate, levels.illegal, levels.filled, levels.reversals
                )
            elif channel.unit == COUNTS:
                out[channel.label] = _of_counts(np.asarray(measured.values).astype(np.int64), measured.rate)
            elif channel.unit == PULSES:
                out[channel.label] = _of_pulses(measured, channel)
        except WindowError as error:
            raise InputError(f"{data.mapping.where}: {channel.key}: {error}") from None
    return out


def _of_counts(
    counts: np.ndarray, rate: float, illegal: int = 0, filled: int = 0, reversals: int | None = None
) -> Counted:
    """The edges of counts at every sample; `illegal` and `filled` transitions are those of the levels behind them."""
    forward = forward_edges(counts, rate)
    turned = np.sign(np.diff(counts)[np.diff(counts) != 0])
    figures: dict[str, float] = {
        "edges": forward.times.size,
        "sense": forward.sense,
        "reversals": int(np.count_nonzero(np.diff(turned))) if reversals is None else reversals,
        "counts_taken_back": forward.reversed_counts,
        "illegal_transitions": illegal,
        "illegal_counted_as_two": filled,
    }
    return Counted(times=forward.times, length=counts.size / rate, figures=figures)


def _of_pulses(measured: Measured, channel: ChannelMapping) -> Counted:
    assert channel.pulses is not None
    found = pulses_of(np.asarray(measured.values), measured.rate, channel.pulses)
    figures = {
        "edges": found.times.size,
        "missed": found.missed,
        "interpolated": found.filled,
        "doubled": found.doubled,
        "threshold": found.threshold,
        "hysteresis": found.hysteresis,
        "speed_hz": found.speed,
    }
    length = measured.values.size / measured.rate
    return Counted(times=found.times, length=length, figures=figures, first_index=found.first_index)
