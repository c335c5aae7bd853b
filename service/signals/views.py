"""The views of a window's signals: what is measured, and where there is a model, what it expects.

`VIEWS` is the table: a view is added by one function from a subject and its options, and one line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi

import numpy as np

from service.signals.flank import flank
from service.signals.markers import markers_of
from service.signals.subject import TRANSMISSION_ERROR, Subject
from service.signals.view import Axis, Series, View, ViewOptions
from twin.errors import NotAvailable, WindowError
from twin.features.envelope import envelope_spectrum, kurtogram, without_shaft_lines
from twin.features.gaps import filled
from twin.features.indicators import PER_TOOTH, gear_signals
from twin.features.orders import synchronous_average
from twin.features.spectra import Spectrum, amplitude_spectrum, order_spectrum

SEGMENTS = 15  # of an averaged spectrum
LEAST_LINE = 1e-4  # of the largest modelled line: smaller ones are not drawn
PER_TURN = 4096  # points of a synchronous average at most
MODELLED = (
    "Modelled: the twin as it is now, with all it has learned, at this window's speed and torque and a wear depth of"
)


def waveform(subject: Subject, options: ViewOptions) -> View:
    """A channel over time; of an encoder, its shaft's speed from edge to edge."""
    label = subject.channel(options.channel)
    if label == TRANSMISSION_ERROR:
        return error_over_angle(subject, options)
    kind, _, name = label.partition("/")
    if kind == "encoder":
        edges = subject.window.encoders[name]
        times = edges.times[np.isfinite(edges.times)]
        if times.size < 3:
            raise WindowError(f"{label} has {times.size} valid edges")
        index = np.flatnonzero(np.isfinite(edges.times))
        t = 0.5 * (times[1:] + times[:-1])
        values, unit = np.diff(index) / np.diff(times) / edges.per_rev, "Hz"
        notes: tuple[str, ...] = (
            f"Speed of the {name}'s shaft from one edge to the next, {edges.per_rev} edges a turn",
        )
    else:
        samples = subject.samples(label)
        t, values, unit, notes = samples.times, samples.values, subject.unit(label), ()
    return View(
        view="waveform",
        channel=label,
        title=f"Waveform of {label}",
        x=Axis(label="time", unit="s", values=t),
        series=(Series(name="measured", unit=unit, values=values),),
        notes=(*subject.notes, *notes),
        figures=_level(values),
    )


def spectrum(subject: Subject, options: ViewOptions) -> View:
    """Amplitudes over frequency."""
    label = subject.channel(options.channel)
    samples = subject.samples(label)
    found = amplitude_spectrum(samples.values, samples.rate, SEGMENTS if options.averaged else 1)
    speed, source = subject.speed
    said = "No shaft speed is known: nothing is marked" if speed is None else f"Marked at {speed:.5g} Hz, {source}"
    figures = {} if speed is None else {"speed_hz": speed}
    return _of_amplitudes(subject, label, options, found, speed, said, figures)


def orders(subject: Subject, options: ViewOptions) -> View:
    """Amplitudes over orders of the pinion's rotation, from a signal sampled anew evenly in its angle."""
    label = subject.channel(options.channel)
    signal, per_turn = subject.on_angle(label)
    found = order_spectrum(signal, per_turn, SEGMENTS if options.averaged else 1)
    angle = label if label.startswith("encoder/") else subject.track.source
    said = f"Angle from {angle}, {signal.turns:.1f} pinion turns"
    return _of_amplitudes(subject, label, options, found, 1.0, said, {"turns": signal.turns}, in_orders=True)


def _of_amplitudes(
    subject: Subject,
    label: str,
    options: ViewOptions,
    found: Spectrum,
    pinion: float | None,
    said: str,
    figures: Mapping[str, float],
    in_orders: bool = False,
) -> View:
    """A spectrum with the modelled lines; `pinion` is where its rotation lies, None where that is not known."""
    highest, unit = float(found.x[-1]), subject.unit(label)
    modelled, lines = subject.modelled_channel(label), subject.modelled
    series = [Series(name="measured", unit=unit, values=_scaled(found.amplitude, options))]
    if modelled is not None and lines is not None:
        x, size = lines.orders if in_orders else lines.frequencies, _scaled(np.abs(modelled), options)
        use = (x <= highest) & (size > LEAST_LINE * size.max())
        series += [Series(name="modelled", unit=unit, x=x[use], values=size[use], kind="lines")] if use.any() else []
    return View(
        view="order-spectrum" if in_orders else "spectrum",
        channel=label,
        title=f"{'Order spectrum' if in_orders else 'Spectrum'} of {label}",
        x=Axis(
            label="order of pinion rotation" if in_orders else "frequency",
            unit="" if in_orders else "Hz",
            values=found.x,
        ),
        series=tuple(series),
        markers=() if pinion is None else markers_of(subject.rig, pinion, highest),
        notes=(
            *subject.notes,
            _scaling(found, "orders" if in_orders else "Hz", options),
            said,
            *_about_model(subject, tuple(series[1:])),
        ),
        figures={"rms": found.rms, "resolution": found.resolution, **figures},
        thinned="peaks",
    )


def envelope(subject: Subject, options: ViewOptions) -> View:
    """Modulation rates of the most impulsive band, or of a given one."""
    label = subject.channel(options.channel)
    e = _enveloped(subject, label, options)
    if options.band is not None:
        low, high = (edge / e.hertz for edge in options.band)
        why = "as asked for"
    else:
        best = kurtogram(e.values, e.rate)[0]
        low, high = best.low, best.high
        why = f"the band of largest spectral kurtosis ({best.kurtosis:.2g}, noise scatters by {best.std:.2g})"
    x, amplitude = envelope_spectrum(e.values, e.rate, (low, high))
    pinion = 1.0 if e.in_orders else subject.speed[0]
    return View(
        view="envelope-spectrum",
        channel=label,
        title=f"Envelope spectrum of {label}",
        x=Axis(
            label="modulation, order of pinion rotation" if e.in_orders else "modulation frequency",
            unit="" if e.in_orders else "Hz",
            values=x,
        ),
        series=(Series(name="measured", unit="", values=amplitude),),
        markers=() if pinion is None else markers_of(subject.rig, pinion, float(x[-1])),
        notes=(
            *subject.notes,
            f"Squared envelope of {low * e.hertz:.5g} … {high * e.hertz:.5g} Hz, {why}; "
            "amplitudes relative to the envelope's mean",
            *e.notes,
        ),
        figures={"band_low_hz": low * e.hertz, "band_high_hz": high * e.hertz},
        thinned="peaks",
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Carrier:
    """The signal that an envelope is taken of."""

    values: np.ndarray  # (n,) on an even grid, without gaps
    rate: float  # values per unit of the grid
    hertz: float  # per unit of the grid
    in_orders: bool  # whether the grid is one of pinion angle
    notes: tuple[str, ...] = ()


def _enveloped(subject: Subject, label: str, options: ViewOptions) -> _Carrier:
    """The signal over pinion angle where an encoder gives it, else over time.

    Over the angle a modulation by a shaft is sharp also where the speed changes.
    """
    samples = subject.samples(label)
    try:
        track = subject.track
        counted = track.source.startswith("encoder/")
    except NotAvailable:
        counted = False
    if not counted:
        if options.without_lines:
            raise NotAvailable("lines of the shafts cannot be removed: no encoder gives the shaft's angle")
        values, _ = filled(samples.values, samples.values.size)
        return _Carrier(values=values, rate=samples.rate, hertz=1.0, in_orders=False)
    signal, _ = subject.on_angle(label)
    notes: tuple[str, ...] = ()
    if options.without_lines:
        if subject.teeth is None or not signal.usable.all():
            why = "the record has gaps" if subject.teeth else "the rig file does not give both numbers of teeth"
            raise NotAvailable(f"lines of the shafts cannot be removed: {why}")
        signal = without_shaft_lines(signal, subject.teeth)
        notes = ("Lines of both shafts were removed first; the middle 70 % of the window is used",)
    return _Carrier(values=signal.values, rate=2 * pi / signal.step, hertz=track.speed, in_orders=True, notes=notes)


def average(subject: Subject, options: ViewOptions) -> View:
    """A channel averaged over whole turns of a shaft, with what remains without the mesh and its first sidebands."""
    label = subject.channel(options.channel)
    period, teeth = subject.require_shaft(options.shaft)
    signal, per_turn = subject.on_angle(label)
    points = min(PER_TURN, max(int(per_turn * period), 16))
    values, turns = synchronous_average(signal, period, points)
    unit, share = subject.unit(label), np.arange(points) / points
    series = [Series(name="measured", unit=unit, values=values)]
    modelled, lines = subject.modelled_channel(label), subject.modelled
    compared = modelled is not None and lines is not None and lines.phase_known
    if modelled is not None and lines is not None and compared:
        wave = lines.waveform(modelled, 2 * pi * period * share, period)
        series.append(Series(name="modelled", unit=unit, values=wave + values.mean()))
    if teeth and points >= PER_TOOTH * teeth:
        parts = gear_signals(values, teeth)
        series.append(Series(name="without mesh and first sidebands", unit=unit, values=parts.difference))
    return View(
        view="synchronous-average",
        channel=label,
        title=f"Synchronous average of {label} over {options.shaft} turns",
        x=Axis(label=f"angle of the {options.shaft}", unit="°", values=360.0 * share),
        series=tuple(series),
        notes=(
            *subject.notes,
            f"Average of {turns} whole turns of the {options.shaft}; 0° is edge 0 of {subject.track.source}",
            *_about_model(subject, tuple(series[1:2]) if compared else ()),
        ),
        figures={"turns": float(turns), **_level(values)},
    )


def error_over_angle(subject: Subject, options: ViewOptions) -> View:
    """Transmission error over the pinion's turns in the window, without its mean."""
    signal, _ = subject.on_angle(TRANSMISSION_ERROR)
    unit = subject.unit(TRANSMISSION_ERROR)
    turns = signal.angles / (2 * pi)
    values = np.where(signal.usable, signal.values, np.nan)
    series = [Series(name="measured", unit=unit, values=values)]
    modelled, lines = subject.modelled_channel(TRANSMISSION_ERROR), subject.modelled
    if modelled is not None and lines is not None and lines.phase_known:
        strong = np.where(np.abs(modelled) > 1e-3 * np.abs(modelled).max(), modelled, 0.0)
        series.append(Series(name="modelled", unit=unit, values=lines.waveform(strong, signal.angles)))
    return View(
        view="transmission-error",
        channel=TRANSMISSION_ERROR,
        title="Transmission error along the line of action",
        x=Axis(label="pinion turns since the window's start", unit="", values=turns - np.floor(turns[0])),
        series=tuple(series),
        notes=(
            *subject.notes,
            "Positive where the teeth are pressed together; the mean is removed",
            *_about_model(subject, tuple(series[1:])),
        ),
        figures=_level(values),
    )


Builder = Callable[[Subject, ViewOptions], View]
VIEWS: Mapping[str, Builder] = {
    "waveform": waveform,
    "spectrum": spectrum,
    "order-spectrum": orders,
    "envelope-spectrum": envelope,
    "synchronous-average": average,
    "transmission-error": error_over_angle,
    "flank": lambda subject, options: flank(subject),
}


def _level(values: np.ndarray) -> dict[str, float]:
    x = values[np.isfinite(values)]
    if not x.size:
        return {}
    return {
        "mean": float(x.mean()), "rms": float(x.std()), "peak_to_peak": float(np.ptp(x)),
        "missing_percent": 100.0 * (1 - x.size / values.size),
    }  # fmt: skip


def _scaled(amplitudes: np.ndarray, options: ViewOptions) -> np.ndarray:
    return amplitudes / np.sqrt(2) if options.rms else amplitudes


def _scaling(found: Spectrum, unit: str, options: ViewOptions) -> str:
    what = "RMS" if options.rms else "peak"
    how = f", mean power of {found.segments} segments" if found.segments > 1 else ""
    lost = f"; {100 * found.lost:.2g} % of the samples were lost and bridged" if found.lost else ""
    return f"Single-sided {what} amplitudes, Hann window, bins of {found.resolution:.4g} {unit}{how}{lost}"


def _about_model(subject: Subject, drawn: tuple) -> tuple[str, ...]:
    m = subject.modelled
    if not drawn or m is None:
        why = subject.why_not_modelled or (
            "the model's mesh phase is not known yet" if m is not None and not m.phase_known else ""
        )
        return (f"Not modelled: {why}",) if why else ()
    effects = f"; effects in it: {', '.join(m.effects).replace('_', ' ')}" if m.effects else ""
    return (f"{MODELLED} {m.depth / 1e-6:.3g} µm{effects}",)
