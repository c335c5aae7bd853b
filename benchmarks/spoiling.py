"""Ways to spoil a healthy recording: faults of a sensor, and impacts that a machine makes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfilt

from twin.features.angle import AngleTrack
from twin.windows import Samples, Window

RING_HZ, DECAY = 3500.0, 900.0  # of an impact [Hz], [1/s]
OTHERS = 1 / 3  # of the impacts' height that the other sensors have
BEARING = 3.57  # order of impacts of no shaft
SLIP = 0.01  # of their period, from one to the next

Values = dict[str, np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One way to spoil a recording."""

    spoil: Callable[[Values, str, Window, AngleTrack, np.random.Generator], Values]
    right: frozenset[str]  # names that say what it is; `unknown_effect` is admitted for all
    gears: bool = False  # whether it is a fault of the machine, not of a sensor


def _one(change: Callable[[np.ndarray, float, np.random.Generator], np.ndarray]):
    """A change of one sensor's values, sampled at a rate."""

    def spoil(values: Values, sensor: str, window: Window, track: AngleTrack, rng: np.random.Generator) -> Values:
        return values | {sensor: change(values[sensor], window.accelerations[sensor].rate, rng)}

    return spoil


def _delayed(x: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    shift = round(rng.uniform(0.3e-3, 3e-3) * rate)
    return np.concatenate([x[:shift], x[:-shift]])


def _high_passed(x: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    return np.asarray(sosfilt(butter(2, rng.uniform(30, 200), "high", fs=rate, output="sos"), x))


def _hum(x: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    t = np.arange(x.size) / rate
    return x + x.std() * rng.uniform(0.1, 0.4) * np.sqrt(2) * np.cos(2 * np.pi * 50 * t + rng.uniform(0, 6))


def _noisy(x: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    return x + rng.uniform(0.3, 1.0) * x.std() * rng.normal(size=x.size)


def _clipped(x: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    return np.clip(x, *(x.mean() + rng.uniform(1.2, 2.2) * x.std() * np.array([-1, 1])))


def _dead(x: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    return 1e-3 * x.std() * rng.normal(size=x.size)


def _interrupted(x: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    start, length = int(rng.uniform(0.1, 0.7) * x.size), int(rng.uniform(0.03, 0.15) * x.size)
    return np.concatenate([x[:start], np.full(length, x[start]), x[start + length :]])


def _exchanged(values: Values, sensor: str, window: Window, track: AngleTrack, rng: np.random.Generator) -> Values:
    other = str(rng.choice([s for s in values if s != sensor]))
    return values | {sensor: values[other], other: values[sensor]}


def ringing(order: float, slip: float, samples: Samples, track: AngleTrack, rng: np.random.Generator) -> np.ndarray:
    """Impacts of height 1 at an order of the pinion that ring, at every sample."""
    first, last = (order * θ / (2 * np.pi) for θ in (track.start, track.stop))
    turns = np.arange(float(np.ceil(first)), float(np.floor(last)))  # of what strikes
    if slip:
        turns = turns + slip * np.cumsum(rng.normal(size=turns.size))
        turns = turns[(turns > first) & (turns < last)]
    pulses = np.zeros(samples.values.size)
    places = np.rint((track.time(2 * np.pi * turns / order) - samples.start) * samples.rate).astype(int)
    pulses[places[(places >= 0) & (places < pulses.size)]] = 1
    t = np.arange(int(0.01 * samples.rate)) / samples.rate
    return np.convolve(pulses, np.exp(-DECAY * t) * np.sin(2 * np.pi * RING_HZ * t))[: pulses.size]


def _struck(order: float, strength: float, slip: float):
    """Impacts that ring; peak over the sensor's RMS, the other sensors `OTHERS` of it."""

    def spoil(values: Values, sensor: str, window: Window, track: AngleTrack, rng: np.random.Generator) -> Values:
        out = {}
        for name, x in values.items():
            peak = strength * x.std() * (1 if name == sensor else OTHERS)
            out[name] = x + peak * ringing(order, slip, window.accelerations[name], track, rng)
        return out

    return spoil


def _kinds() -> dict[str, Kind]:
    out = {
        "reversed polarity": Kind(spoil=_one(lambda x, rate, rng: -x), right=frozenset({"sensor_polarity"})),
        "delay 0.3 to 3 ms": Kind(spoil=_one(_delayed), right=frozenset({"sensor_delay"})),
        "gain 0.4 to 0.7": Kind(
            spoil=_one(lambda x, rate, rng: rng.uniform(0.4, 0.7) * x), right=frozenset({"sensor_gain"})
        ),
        "high-pass 30 to 200 Hz": Kind(spoil=_one(_high_passed), right=frozenset({"sensor_resonance", "sensor_delay"})),
        "hum of 50 Hz": Kind(spoil=_one(_hum), right=frozenset({"hum"})),
        "noise": Kind(spoil=_one(_noisy), right=frozenset({"sensor_noise"})),
        "clipping": Kind(spoil=_one(_clipped), right=frozenset({"sensor_clipping"})),
        "exchanged sensors": Kind(spoil=_exchanged, right=frozenset({"exchanged"})),
        "dead sensor": Kind(spoil=_one(_dead), right=frozenset({"sensor_dead"})),
        "interrupted sensor": Kind(spoil=_one(_interrupted), right=frozenset({"sensor_dead_time"})),
    }
    crack = frozenset({"tooth_crack"})
    for strength in (2.0, 5.0, 10.0):
        out[f"impacts, pinion, {strength:g} x RMS"] = Kind(spoil=_struck(1, strength, 0), right=crack, gears=True)
        out[f"impacts, gear, {strength:g} x RMS"] = Kind(spoil=_struck(0.4, strength, 0), right=crack, gears=True)
        out[f"impacts, bearing, {strength:g} x RMS"] = Kind(
            spoil=_struck(BEARING, strength, SLIP), right=frozenset({"bearing_defect"}), gears=True
        )
    return out


KINDS = _kinds()
