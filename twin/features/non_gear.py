"""Non-gear features of a window: what its acceleration holds apart from the lines of its own shafts.

    tones       of fixed frequency (tones.py)
    lines       peaks at orders that are no multiple of either shaft's turn, by frequency and order
    impacts     kurtosis of the most impulsive band, and the rates at which the envelope repeats there (envelope.py)
    modulation  how deep the turn of either shaft modulates the noise between the lines: what rubs does so

The angle is as good as the pulses that it comes from: a timing error σ_t of a turn is a phase error φ = 2π·f·σ_t of a
line at f, so a line of the shaft's own is blurred over angle and may look steadier over time. A tone at an order of
either shaft is left out where φ times its amplitude is above its own uncertainty, and lines near a mesh line are its
skirt up to the share φ. σ_t follows from third differences of the pulses' times, which a smooth change of speed leaves
at zero.

Lines near a strong mesh line are its own skirt, where the speed wanders; they are left out. What cannot be computed of
a window (gaps, a record that is too short) is not available, with the reason; it is never taken for absent.

Source   J. Antoni, Mech. Syst. Signal Process. 20 (2006) 282–307 (spectral kurtosis); R. B. Randall, J. Antoni,
         Mech. Syst. Signal Process. 25 (2011) 485–520 (envelope)
Limits   up to the rig's analysis band; impacts that fill a band of 1 kHz and more
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import pi
from typing import Any

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter1d

from twin.errors import TwinError
from twin.features.channel_lines import ChannelRecord, LineReading, Wanted, read_channels
from twin.features.despike import without_spikes
from twin.features.envelope import Carrier, kurtogram, modulations, without_shaft_lines
from twin.features.extract import WindowSignals, reference
from twin.features.resample import AngleSignal, on_angle
from twin.features.tones import CLOSE, Tone, window_tones
from twin.features.transforms import hann, power_of
from twin.rig import Rig
from twin.serial import from_plain, to_plain
from twin.thresholds import deciding
from twin.windows import Samples, Window

TUNED = "tuned on D00–D13 and T01–T58; not derived"
MOST_LINES = 12
RINGING_WIDTH = 60.0  # of the bands among which the frequency that impacts ring at is sought [Hz]
MOST_READ = 16  # lines of no shaft that are read from every channel of a window
HIGHEST_OTHER = 60.0  # order of the pinion up to which transmission error and torque are searched
LINE_REACH = 4  # bins to either side that a line is the highest of
AROUND = 61  # bins that the noise near a line is taken from
MESH_HARMONICS = range(1, 99)
FEWEST_PULSES = 16  # from which a scatter is computed
SCATTER = 20.0  # of a third difference over that of a pulse: 1² + 3² + 3² + 1²


@dataclass(frozen=True, slots=True, kw_only=True)
class NonGearFeatureThresholds:
    """Which peaks of one window's spectrum and envelope are kept."""

    from_shaft: float = deciding(
        2.2,
        unit="resolution steps",
        meaning="distance from any order of a shaft",
        source="Hann's main lobe is two steps to either side",
    )
    from_mesh: float = deciding(
        6.0, unit="resolution steps", meaning="distance from a mesh line, whose skirt the speed widens", source=TUNED
    )
    stands_out: float = deciding(40.0, of="median power around", meaning="power of a line that is kept", source=TUNED)
    least_amplitude: float = deciding(
        15.0, of="acceleration noise floor", meaning="amplitude of a line that is kept", source=TUNED
    )
    of_mesh: float = deciding(
        0.03, of="strongest mesh line near", meaning="amplitude of a line that is not a mesh line's skirt", source=TUNED
    )
    near_mesh: float = deciding(3.0, unit="order", meaning="distance of the mesh lines meant", source=TUNED)
    most_speed_variation: float = deciding(
        0.02,
        of="mean speed of the window",
        meaning="standard deviation of the speed within a window above which lines at orders of no shaft are not read",
        source="derivation: a mesh line then passes a resonance of 2 % damping, and its skirt is no longer narrow",
    )
    impulsive: float = deciding(
        1.5, meaning="kurtosis from which the envelope of a band is examined", source="not derived: chosen"
    )
    rings: float = deciding(
        10.0, meaning="kurtosis from which the frequency that impacts ring at is read", source="not derived: chosen"
    )
    least_width: float = deciding(
        0.5,
        of="upper limit of the analysis band",
        meaning="width of a band that impacts fill",
        source="not derived: blows of less than a millisecond fill 1 kHz and more",
    )
    noise_from: float = deciding(
        0.4,
        of="upper limit of the analysis band",
        meaning="frequency above which noise is examined for modulation by a shaft",
        source="not derived: above the mesh lines that carry the load",
    )
    least_error: float = deciding(
        0.05,
        of="gear graduation error",
        meaning="amplitude of a line of no shaft that is read from the transmission error",
        source="not derived: chosen; 0.08 µm on the reference rig",
    )
    least_torque: float = deciding(
        4.0,
        of="torque noise floor",
        meaning="amplitude of a line of no shaft that is read from the torque",
        source="not derived: chosen; 20 mN·m on the reference rig",
    )
    same_rate: float = deciding(
        0.02,
        meaning="relative difference of a rate to a shaft's order",
        source="not derived: chosen",
    )


THRESHOLDS = NonGearFeatureThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class NonGearFeatures:
    """Of one window; plain data."""

    duration: float  # [s]
    speed_hz: float
    tones: tuple[tuple[float, float, float, float, float], ...]  # Hz, its std, amplitude, its std, evidence
    lines: tuple[tuple[float, float], ...]  # order of pinion rotation, amplitude [m/s²]
    kurtosis: float | None  # of the most impulsive band; None where it is not available
    rates: tuple[tuple[float, float], ...]  # order of pinion rotation, depth, of impacts that no shaft makes
    swelling: tuple[tuple[str, float], ...] = ()  # shafts whose turn modulates the noise, and how deep
    fault: str = ""  # why impacts and modulation, or part of them, are not available
    ringing: float | None = None  # frequency at which impacts ring [Hz]; None where there are none
    readings: tuple[LineReading, ...] = ()  # of tones and lines, the strongest of each channel, in every channel

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        return {**asdict(replace(self, readings=())), "readings": to_plain(self.readings)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> NonGearFeatures:
        return cls(
            duration=data["duration"],
            speed_hz=data["speed_hz"],
            tones=tuple(tuple(t) for t in data["tones"]),
            lines=tuple(tuple(line) for line in data["lines"]),
            kurtosis=data["kurtosis"],
            rates=tuple(tuple(r) for r in data["rates"]),
            swelling=tuple((name, depth) for name, depth in data["swelling"]),
            fault=data.get("fault", ""),
            ringing=data.get("ringing"),
            readings=from_plain(tuple[LineReading, ...], data.get("readings", ())),
        )

    def as_tones(self) -> tuple[Tone, ...]:
        return tuple(
            Tone(frequency=f, frequency_std=s, amplitude=a, std=n, evidence=e, false_alarm=0.0)
            for f, s, a, n, e in self.tones
        )


def _around(power: np.ndarray, bins: np.ndarray) -> np.ndarray:
    """Mean power of noise near bins, from the median of AROUND; beyond the ends as at them; (n,), (m,) → (m,)."""
    near = np.clip(bins[:, None] + np.arange(-(AROUND // 2), AROUND // 2 + 1), 0, power.size - 1)
    return np.sort(power[near], axis=1)[:, AROUND // 2] / np.log(2)


def off_order_lines(
    signal: AngleSignal,
    teeth: tuple[int, int],
    speed_hz: float,
    top: float,
    noise_floor: float,
    limits: NonGearFeatureThresholds = THRESHOLDS,
    timing_error: float = 0.0,
) -> list[tuple[float, float]]:
    """Peaks at orders of neither shaft: (order, amplitude), the strongest first.

    top           upper limit of the analysis band [Hz]
    noise_floor   amplitude of an acceleration line below which nothing is read [m/s²]
    timing_error  of a turn, by the pulses that the angle comes from [s]
    """
    v = signal.values
    weight = hann(v.size)
    length = fft.next_fast_len(2 * v.size, real=True)
    spectrum = fft.rfft(weight * (v - (weight @ v) / weight.sum()), length) * (2 / weight.sum())
    step = 2 * pi / (length * signal.step)
    turns = v.size * signal.step / (2 * pi)
    amplitude = np.sqrt(power_of(spectrum[: min(spectrum.size, int(top / speed_hz / step))]))
    order = step * np.arange(amplitude.size)
    z1, gear = teeth[0], teeth[0] / teeth[1]
    from_shaft = np.minimum(np.abs(order - np.rint(order)), np.abs(order - gear * np.rint(order / gear)))
    from_mesh = np.abs(order - z1 * np.rint(order / z1))
    free = (from_shaft > limits.from_shaft / turns) & (from_mesh > limits.from_mesh / turns) & (order > 0.5)
    index = np.flatnonzero(free)
    if index.size < 64:
        return []
    power = amplitude[index] ** 2
    at = np.array(MESH_HARMONICS) * z1
    mesh = np.array(
        [amplitude[max(0, round(o / step) - 3) : round(o / step) + 4].max(initial=0.0) for o in at.tolist()]
    )
    highest = power >= maximum_filter1d(power, 2 * LINE_REACH + 1, mode="nearest")
    peaks = 1 + np.flatnonzero((highest & (np.sqrt(power) >= limits.least_amplitude * noise_floor))[1:-1])
    peaks = peaks[power[peaks] >= limits.stands_out * _around(power, peaks)]
    out = []
    for i in peaks.tolist():
        a = float(np.sqrt(power[i]))
        near = np.abs(at - order[index[i]]) < limits.near_mesh
        skirt = np.maximum(limits.of_mesh, 2 * pi * at[near] * speed_hz * timing_error) * mesh[near]
        if a > skirt.max(initial=0.0):
            out.append((float(order[index[i]]), a))
    return sorted(out, key=lambda line: -line[1])[:MOST_LINES]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Impacts:
    """What the envelope of one window says."""

    kurtosis: float | None = None
    rates: tuple[tuple[float, float], ...] = ()
    modulation: tuple[tuple[str, float], ...] = ()
    ringing: float | None = None
    fault: str = ""


def non_gear_features(
    rig: Rig,
    window: Window,
    limits: NonGearFeatureThresholds = THRESHOLDS,
    signals: WindowSignals | None = None,
) -> NonGearFeatures | None:
    """Non-gear features of the reference accelerometer; None where there is none, or no speed.

    signals  of this window, where other features are computed from them, too
    """
    signals = signals or WindowSignals(rig, window)
    try:
        name, samples = reference(rig, window)
        track = signals.track
        signal, _ = signals.on_angle(name)
        error = timing_error(window, track.source)
        tones = [
            tone
            for tone in window_tones(samples, track, rig.teeth, signal=signal)
            if not _may_be_of_a_shaft(tone, rig.teeth, track.speed, 1 / window.duration, error)
        ]
        lines = off_order_lines(
            signal, rig.teeth, track.speed, rig.band[1], rig.tolerances.acceleration_floor, limits, error
        )
        changing = track.speed_variation > limits.most_speed_variation
        lines = [] if changing else lines
        readings = () if changing else _readings(signals, samples, signal, tones, lines, limits)
    except TwinError:
        return None
    impacts = _impacts(rig, signal, track.speed, limits)
    return NonGearFeatures(
        duration=window.duration,
        speed_hz=float(track.speed),
        tones=tuple(
            (float(t.frequency), float(t.frequency_std), float(abs(t.amplitude)), float(t.std), float(t.evidence))
            for t in tones
        ),
        lines=tuple(lines),
        readings=readings,
        kurtosis=impacts.kurtosis,
        rates=impacts.rates,
        swelling=impacts.modulation,
        ringing=impacts.ringing,
        fault=impacts.fault,
    )


def _readings(
    signals: WindowSignals,
    samples: Samples,
    signal: AngleSignal,
    tones: Sequence[Tone],
    lines: Sequence[tuple[float, float]],
    limits: NonGearFeatureThresholds,
) -> tuple[LineReading, ...]:
    """Lines of no shaft in every channel: those of the acceleration, then those that only others show."""
    rig, track = signals.rig, signals.track
    speed, duration = track.speed, signals.window.duration
    wanted = [
        Wanted(frequency=t.frequency, channel="acceleration", tone=True)
        for t in sorted(tones, key=lambda t: -abs(t.amplitude))
    ]
    wanted += [Wanted(frequency=o * speed, channel="acceleration") for o, _ in lines]
    others = {}
    top = HIGHEST_OTHER * speed
    try:
        error = signals.transmission_error
    except TwinError:
        pass
    else:
        if error.unit == "m":
            floor = limits.least_error * rig.tolerances.gear_graduation / limits.least_amplitude
            seen = off_order_lines(error.signal, rig.teeth, speed, top, floor, limits)
            wanted += [Wanted(frequency=o * speed, channel="encoder") for o, _ in seen]
            others["encoder"] = error.signal
    torque = signals.window.torques.get("pinion")
    if torque is not None and np.isfinite(torque.values).any():
        torque = replace(torque, values=without_spikes(torque.values))
        floor = limits.least_torque * rig.tolerances.torque_floor / limits.least_amplitude
        on, per_turn = on_angle(torque, track)
        seen = off_order_lines(on, rig.teeth, speed, min(top, 0.45 * per_turn * speed), floor, limits)
        wanted += [Wanted(frequency=o * speed, channel="torque") for o, _ in seen]
        others["torque"] = on
    if not wanted:
        return ()
    angle = np.linspace(track.start, track.stop, max(64, int(64 * track.turns)))
    time = track.time(angle)
    channels = {
        name: ChannelRecord.of(on.values, on.start, on.step, time, angle, True)
        for name, on in (("acceleration", signal), *others.items())
    }
    return read_channels(channels, wanted, rig.teeth, speed, duration, MOST_READ)


def timing_error(window: Window, source: str) -> float:
    """Standard deviation σ_t of the time of a turn by the pulses of an encoder [s]; 0 for an angle of no encoder."""
    kind, _, name = source.partition("/")
    if kind != "encoder" or name not in window.encoders:
        return 0.0
    edges = window.encoders[name]
    third = np.diff(edges.times, 3)
    third = third[np.isfinite(third)]
    if third.size < FEWEST_PULSES:
        return 0.0
    usual = np.abs(third) <= np.quantile(np.abs(third), 0.98)  # a lost or doubled pulse is not the scatter of the rest
    return float(np.sqrt(np.mean(third[usual] ** 2) / SCATTER / edges.per_rev))


def _may_be_of_a_shaft(tone: Tone, teeth: tuple[int, int], speed_hz: float, step: float, error: float) -> bool:
    """Whether a tone lies at an order of a shaft, and the angle is too uncertain to tell the two apart."""
    order, tolerance = tone.frequency / speed_hz, CLOSE * step / speed_hz
    gear = teeth[0] / teeth[1]
    apart = min(abs(order - round(order)), abs(order - gear * round(order / gear)))
    return apart < tolerance and 2 * pi * tone.frequency * error * abs(tone.amplitude) > tone.std


def _impacts(rig: Rig, signal: AngleSignal, speed_hz: float, limits: NonGearFeatureThresholds) -> _Impacts:
    """Impulsiveness and envelope of a window; each part that cannot be computed is not available, with the reason."""
    if not signal.usable.all():
        return _Impacts(fault="impacts are not searched for: the acceleration has gaps")
    shafts = (("pinion", 1.0), ("gear", rig.teeth[0] / rig.teeth[1]))
    top, per_turn = rig.band[1], 2 * pi / signal.step
    try:
        rest = without_shaft_lines(signal, rig.teeth).values
        wide = kurtogram(rest, per_turn, wider_than=limits.least_width * top / speed_hz)
    except TwinError as reason:
        return _Impacts(fault=f"impacts are not searched for: {reason}")
    if not wide:
        return _Impacts(fault="impacts are not searched for: no band of the acceleration is wide enough")
    band, carrier = max(wide, key=lambda b: b.kurtosis), Carrier(rest, per_turn)
    rates: tuple[tuple[float, float], ...] = ()
    modulation: tuple[tuple[str, float], ...] = ()
    ringing = _ringing(rest, per_turn * speed_hz, top) if band.kurtosis > limits.rings else None
    try:
        noise = (limits.noise_from * top / speed_hz, 0.45 * per_turn)
        modulation = tuple(_by_shaft(carrier, noise, shafts, limits.same_rate))
        if band.kurtosis > limits.impulsive:
            seen = modulations(carrier, (band.low, band.high), shafts, 1e-3)
            rates = tuple((float(m.rate), float(m.depth)) for m in seen if m.shaft is None)
    except TwinError as reason:
        fault = f"the envelope is not examined: {reason}"
        return _Impacts(kurtosis=float(band.kurtosis), modulation=modulation, ringing=ringing, fault=fault)
    return _Impacts(kurtosis=float(band.kurtosis), rates=rates, modulation=modulation, ringing=ringing)


def _ringing(values: np.ndarray, rate: float, top: float) -> float:
    """Frequency [Hz] up to `top` about which the power of values is highest, in bands of RINGING_WIDTH."""
    power = power_of(fft.rfft(values))
    step = rate / values.size
    width = max(1, round(RINGING_WIDTH / step))
    smooth = np.convolve(power[: max(int(top / step), width + 1)], np.ones(width), "same")
    return float(np.argmax(smooth) * step)


def _by_shaft(
    carrier: Carrier,
    band: tuple[float, float],
    shafts: Sequence[tuple[str, float]],
    same_rate: float,
) -> list[tuple[str, float]]:
    """Shafts whose own order modulates the noise of a band of orders, and how deep: by one, it varies once a turn."""
    seen = modulations(carrier, band, shafts, 1e-3)
    out = []
    for name, order in shafts:
        depths = [float(m.depth) for m in seen if abs(m.rate / order - 1) < same_rate]
        if depths:
            out.append((name, max(depths)))
    return out
