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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from scipy import fft

from twin.errors import TwinError
from twin.features.channel_lines import ChannelRecord, LineReading, Wanted, read_channels
from twin.features.despike import without_spikes
from twin.features.envelope import Carrier, kurtogram, modulations, without_shaft_lines
from twin.features.extract import BEYOND_BAND, WindowSignals, reference
from twin.features.impact_turns import leading_tooth, locked_lines
from twin.features.off_orders import THRESHOLDS as OFF_ORDERS
from twin.features.off_orders import OffOrders, WanderingTone, lines_of, wandering_tones
from twin.features.resample import AngleSignal, on_angle
from twin.features.shaft_orders import fractions, owner_of
from twin.features.tones import CLOSE, LOWEST, Tone, window_tones
from twin.features.transforms import power_of
from twin.rig import Rig
from twin.thresholds import deciding
from twin.windows import Window

RINGING_WIDTH = 60.0  # of the bands among which the frequency that impacts ring at is sought [Hz]
MOST_READ = 16  # lines of no shaft that are read from every channel of a window
HIGHEST_OTHER = 60.0  # order of the pinion up to which transmission error and torque are searched
BESIDE_MESH = 2.5  # orders beside a mesh line whose lines are read as its sidebands (twin/features/lines.py)
MOST_OF_SHAFTS = 6  # lines of turns that are kept
FEWEST_PULSES = 16  # from which a scatter is computed
SOUGHT = (0.3, 12.0)  # orders of the pinion among which a bearing defect is searched for
SCATTER = 20.0  # of a third difference over that of a pulse: 1² + 3² + 3² + 1²


@dataclass(frozen=True, slots=True, kw_only=True)
class NonGearFeatureThresholds:
    """Which peaks of one window's spectrum and envelope are kept."""

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
    # by shaft: P that one tooth leads in all turns by chance, None where there were too few turns, and that tooth
    turns: tuple[tuple[str, float | None, int], ...] = ()
    shafts: tuple[tuple[float, float], ...] = ()  # strongest lines of turns, away from the mesh's: order, amplitude
    locks: tuple[tuple[float, float, float], ...] = ()  # envelope at fractions of turns: order, real, imaginary

    def as_tones(self) -> tuple[Tone, ...]:
        return tuple(
            Tone(frequency=f, frequency_std=s, amplitude=a, std=n, evidence=e, false_alarm=0.0)
            for f, s, a, n, e in self.tones
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Impacts:
    """What the envelope of one window says."""

    kurtosis: float | None = None
    rates: tuple[tuple[float, float], ...] = ()
    modulation: tuple[tuple[str, float], ...] = ()
    ringing: float | None = None
    turns: tuple[tuple[str, float | None, int], ...] = ()
    locks: tuple[tuple[float, float, float], ...] = ()
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
            for tone in window_tones(samples, track, rig.teeth, (LOWEST, BEYOND_BAND * rig.band[1]), signal=signal)
            if not _may_be_of_a_shaft(tone, rig.teeth, track.speed, 1 / window.duration, error)
        ]
        seen = OffOrders.of(signal, rig.teeth, track.speed, rig.band[1], error)
        floor = rig.tolerances.acceleration_floor
        changing = track.speed_variation > limits.most_speed_variation
        wandering = [] if changing else _unless_steady(wandering_tones(seen, floor), tones, track.speed)
        tones = [t for t in tones if not _within(wandering, t.frequency / track.speed)]
        lines = [] if changing else [line for line in lines_of(seen, floor) if not _within(wandering, line[0])]
        readings = () if changing else _readings(signals, signal, tones, lines, limits)
        readings = (*(w.reading(track.speed) for w in wandering), *readings)
    except TwinError:
        return None
    impacts = impacts_of(rig, signal, track.speed, limits)
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
        turns=impacts.turns,
        shafts=seen.of_shafts(rig.teeth, BESIDE_MESH, MOST_OF_SHAFTS),
        locks=impacts.locks,
        fault=impacts.fault,
    )


def _unless_steady(wandering: Sequence[WanderingTone], tones: Sequence[Tone], speed_hz: float) -> list[WanderingTone]:
    """Wandering tones without those that a tone steady in hertz makes, whose line the shaft's speed widens over orders.

    The steady tone then holds most of the power.
    """
    return [
        w
        for w in wandering
        if sum(abs(t.amplitude) ** 2 for t in tones if w.holds(t.frequency / speed_hz)) < 0.5 * w.amplitude**2
    ]


def _within(wandering: Sequence[WanderingTone], order: float) -> bool:
    """Whether an order lies within the span of a wandering tone."""
    return any(w.holds(order) for w in wandering)


def _readings(
    signals: WindowSignals,
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
            floor = limits.least_error * rig.tolerances.gear_graduation / OFF_ORDERS.least_amplitude
            seen = lines_of(OffOrders.of(error.signal, rig.teeth, speed, top), floor)
            wanted += [Wanted(frequency=o * speed, channel="encoder") for o, _ in seen]
            others["encoder"] = error.signal
    torque = signals.window.torques.get("pinion")
    if torque is not None and np.isfinite(torque.values).any():
        torque = replace(torque, values=without_spikes(torque.values))
        floor = limits.least_torque * rig.tolerances.torque_floor / OFF_ORDERS.least_amplitude
        on, per_turn = on_angle(torque, track)
        seen = lines_of(OffOrders.of(on, rig.teeth, speed, min(top, 0.45 * per_turn * speed)), floor)
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
    return (
        owner_of(order, teeth, tolerance) is not None
        and 2 * pi * tone.frequency * error * abs(tone.amplitude) > tone.std
    )


def impacts_of(
    rig: Rig, signal: AngleSignal, speed_hz: float, limits: NonGearFeatureThresholds = THRESHOLDS
) -> Impacts:
    """Impulsiveness and envelope of a window; each part that cannot be computed is not available, with the reason."""
    if not signal.usable.all():
        return Impacts(fault="impacts are not searched for: the acceleration has gaps")
    shafts = (("pinion", 1.0), ("gear", rig.teeth[0] / rig.teeth[1]))
    top, per_turn = rig.band[1], 2 * pi / signal.step
    try:
        middle = without_shaft_lines(signal, rig.teeth)
        rest = middle.values
        wide = kurtogram(rest, per_turn, wider_than=limits.least_width * top / speed_hz)
    except TwinError as reason:
        return Impacts(fault=f"impacts are not searched for: {reason}")
    if not wide:
        return Impacts(fault="impacts are not searched for: no band of the acceleration is wide enough")
    band, carrier = max(wide, key=lambda b: b.kurtosis), Carrier(rest, per_turn)
    rates: tuple[tuple[float, float], ...] = ()
    modulation: tuple[tuple[str, float], ...] = ()
    turns: tuple[tuple[str, float | None, int], ...] = ()
    locks: tuple[tuple[float, float, float], ...] = ()
    ringing = _ringing(rest, per_turn * speed_hz, top) if band.kurtosis > limits.rings else None
    try:
        noise = (limits.noise_from * top / speed_hz, 0.45 * per_turn)
        modulation = tuple(_by_shaft(carrier, noise, shafts, limits.same_rate))
        if band.kurtosis > limits.impulsive:
            seen = modulations(carrier, (band.low, band.high), shafts, 1e-3)
            rates = tuple((float(m.rate), float(m.depth)) for m in seen if m.shaft is None)
            _, envelope = carrier.squared_envelope((band.low, band.high))
            grid = (middle.start, middle.step * rest.size / envelope.size)
            turns = _turns(envelope, *grid, rig.teeth)
            locks = locked_lines(envelope, *grid, _struck_orders(rates, rig.teeth, 2 / carrier.duration))
    except TwinError as reason:
        fault = f"the envelope is not examined: {reason}"
        return Impacts(kurtosis=float(band.kurtosis), modulation=modulation, ringing=ringing, fault=fault)
    return Impacts(
        kurtosis=float(band.kurtosis), rates=rates, modulation=modulation, ringing=ringing, turns=turns, locks=locks
    )


def _turns(
    envelope: np.ndarray, start: float, step: float, teeth: tuple[int, int]
) -> tuple[tuple[str, float | None, int], ...]:
    """Whether impacts of a squared envelope repeat with the pinion, and with the gear."""
    shafts = (("pinion", teeth[0], 1.0), ("gear", teeth[1], teeth[0] / teeth[1]))
    return tuple((name, *leading_tooth(envelope, start, step, z, ratio)) for name, z, ratio in shafts)


def _struck_orders(rates: Sequence[tuple[float, float]], teeth: tuple[int, int], width: float) -> list[float]:
    """Fractions of turns and mesh, a multiple of which is near a rate of impacts, within a width [order]."""
    tried = fractions(teeth, *SOUGHT)
    return [o for o in tried if any(abs(rate - o * max(1, round(rate / o))) < width for rate, _ in rates)]


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
