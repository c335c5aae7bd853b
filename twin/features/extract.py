"""All features of one window.

Orders refer to the smoothed pinion angle: from the pinion's encoder, else from the gear's (its angle times
z2/z1, zero at that encoder's edge 0), else from the mesh lines of the accelerometers, whose zero is
arbitrary.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from twin.assessment import SensorIndicators
from twin.errors import NotAvailable, TwinError, WindowError
from twin.features.angle import AngleTrack, angle_track
from twin.features.averages import AT_ONCE, Average, Splines, average_places, synchronous_averages
from twin.features.despike import without_spikes
from twin.features.edge_timing import rates_of
from twin.features.indicators import periods_of, sensor_indicators
from twin.features.level import band_level
from twin.features.lines import mesh_keys, noise_rms, read_lines, shaft_keys
from twin.features.mesh_speed import mesh_track
from twin.features.orders import mesh_bands
from twin.features.resample import AngleGrid, AngleSignal, angle_grid, on_angle, spline_response
from twin.features.transmission_error import TransmissionError, pinion_motion, transmission_error
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.rig import Rig
from twin.windows import Samples, Window

BEYOND_BAND = 1.1  # acceleration lines are read up to so many times the upper end of the rig's band
MOST_HARMONICS = 64
SHAFT_ORDERS = 15  # shaft orders of transmission error are read below this order of the pinion
TE_HARMONICS = 10
SIDEBAND_HARMONICS = 5  # mesh harmonics whose sidebands are read
USABLE_RATE = 0.45  # lines are read up to this share of the sampling rate


_Clock = tuple[float, float, int]  # rate [Hz], time of the first sample [s] and number of samples


def _clock_of(samples: Samples) -> _Clock:
    return samples.rate, samples.start, samples.values.size


def _valid_share(values) -> float:
    return np.count_nonzero(np.isfinite(values)) / len(values) if len(values) else 0.0


class _Collector:
    """Gathers features by name; what raises NotAvailable or WindowError is left out with its reason."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}
        self.unavailable: dict[str, str] = {}

    def missing(self, names: str, reason: str) -> None:
        """Says why features are not there; the first reason is kept."""
        for name in names.split():
            self.unavailable.setdefault(name, reason)

    def add(self, name: str, compute: Callable[[], Any]) -> None:
        try:
            self.values[name] = compute()
        except TwinError as error:
            self.missing(name, str(error))


def pinion_angle(rig: Rig, window: Window, accelerations: Mapping[str, Samples]) -> AngleTrack:
    """The smoothed pinion angle from the best channel that serves; an error that says why none does."""

    def from_gear() -> AngleTrack:
        z1, z2 = rig.teeth
        return angle_track(window.encoders["gear"], z2 / z1, "encoder/gear", rates_of(window))

    sources: list[Callable[[], AngleTrack]] = []
    if "pinion" in window.encoders:
        sources.append(lambda: angle_track(window.encoders["pinion"], rates=rates_of(window)))
    if "gear" in window.encoders:
        sources.append(from_gear)
    sources.append(lambda: mesh_track(rig, accelerations))
    first: TwinError | None = None
    for source in sources:
        try:
            return source()
        except TwinError as error:
            first = first or error
    assert first is not None
    raise first


def reference(rig: Rig, window: Window) -> tuple[str, Samples]:
    """The reference accelerometer: the rig's, or the first by name where the rig names none."""
    if not window.accelerations:
        raise NotAvailable("no accelerometer is in this window")
    name = rig.accelerometer
    if name is None:
        name = min(window.accelerations)
    elif name not in window.accelerations:
        raise NotAvailable(
            f"the rig's reference accelerometer {name} is not in this window, which has "
            f"{', '.join(sorted(window.accelerations))}"
        )
    return name, window.accelerations[name]


class WindowSignals:
    """What several features of one window are computed from; each part is computed once, when it is first asked for."""

    def __init__(self, rig: Rig, window: Window) -> None:
        self.rig, self.window = rig, window
        self._grids: dict[_Clock, AngleGrid] = {}
        self._kept: tuple[tuple[str, ...], Splines] | None = None
        self._averages: dict[_Clock, dict[str, list[Average | WindowError]]] = {}

    @cached_property
    def _track(self) -> AngleTrack | TwinError:
        try:
            return pinion_angle(self.rig, self.window, self.window.accelerations)
        except TwinError as error:
            return error

    @property
    def track(self) -> AngleTrack:
        """The smoothed pinion angle; an error that says why it is not known."""
        if isinstance(self._track, TwinError):
            raise self._track
        return self._track

    def _grid(self, samples: Samples) -> AngleGrid:
        clock = _clock_of(samples)
        if clock not in self._grids:
            self._grids[clock] = angle_grid(samples, self.track)
        return self._grids[clock]

    @cached_property
    def _reference(self) -> str | None:
        """The reference accelerometer, None where there is none."""
        try:
            return reference(self.rig, self.window)[0]
        except NotAvailable:
            return None

    def _together(self, clock: _Clock) -> list[tuple[str, ...]]:
        """The accelerometers with some clock and a valid sample, as many at once as splines are made of."""
        names = [
            name
            for name, samples in self.window.accelerations.items()
            if _clock_of(samples) == clock and np.isfinite(samples.values).any()
        ]
        return [tuple(names[k : k + AT_ONCE]) for k in range(0, len(names), AT_ONCE)]

    def _splines(self, names: tuple[str, ...]) -> Splines:
        """Of accelerometers that belong together; those with the reference one are kept."""
        if self._kept is not None and self._kept[0] == names:
            return self._kept[1]
        splines = Splines.of([self.window.accelerations[name] for name in names])
        if self._reference in names:
            self._kept = names, splines
        return splines

    def _on_angle(self, name: str) -> tuple[AngleSignal, float]:
        samples = self.window.accelerations[name]
        names = next((names for names in self._together(_clock_of(samples)) if name in names), None)
        if names is None:
            raise WindowError("not one of the channel's samples is valid")
        return on_angle(
            samples, self.track, grid=self._grid(samples), spline=self._splines(names).one(names.index(name))
        )

    @cached_property
    def _reference_on_angle(self) -> tuple[AngleSignal, float]:
        assert self._reference is not None
        return self._on_angle(self._reference)

    def on_angle(self, name: str) -> tuple[AngleSignal, float]:
        """An accelerometer on an even grid of pinion angle, and its samples per turn; the reference one's is kept."""
        return self._reference_on_angle if name == self._reference else self._on_angle(name)

    @cached_property
    def _error(self) -> TransmissionError | TwinError:
        rig, window, track = self.rig, self.window, self.track
        try:
            missing = [s for s in ("pinion", "gear") if s not in window.encoders]
            if missing:
                where = " and the ".join(missing)
                raise NotAvailable(f"transmission error is not available: no encoder on the {where}")
            if track.source != "encoder/pinion":
                angle_track(window.encoders["pinion"])  # says what is wrong with it
            pinion, gear = window.encoders["pinion"], window.encoders["gear"]
            return transmission_error(pinion, gear, rig.teeth, _base_radius(rig), track)
        except TwinError as error:
            return error

    @property
    def transmission_error(self) -> TransmissionError:
        """The transmission error over the window; an error that says why it is not available."""
        if isinstance(self._error, TwinError):
            raise self._error
        return self._error

    def gear_averages(self, name: str) -> list[Average | WindowError]:
        """Synchronous averages of an accelerometer with a valid sample over a turn of each gear."""
        samples = self.window.accelerations[name]
        clock, periods = _clock_of(samples), periods_of(self.rig.teeth)
        if clock not in self._averages:
            places = average_places(samples, self.track, self._grid(samples), periods)
            self._averages[clock] = {
                each: found
                for names in self._together(clock)
                for each, found in zip(names, synchronous_averages(self._splines(names), places, periods), strict=True)
            }
        return self._averages[clock][name]


def _base_radius(rig: Rig) -> float | None:
    radius = rig.get("gears.pinion.base_radius")
    if radius is None and rig.has("gears.module", "gears.pressure_angle_deg", "gears.pinion.teeth"):
        module, degrees = rig.get("gears.module"), rig.get("gears.pressure_angle_deg")
        radius = module * rig.get("gears.pinion.teeth") / 2 * np.cos(np.radians(degrees))
    return None if radius is None else float(radius)


def _harmonics(track: AngleTrack, teeth: tuple[int, int], highest: float, most: int) -> int:
    """How many mesh harmonics lie below a frequency [Hz], at most so many."""
    return min(most, int(highest / (teeth[0] * track.speed)))


def _attenuated(signal: AngleSignal, per_turn: float):
    """What `order_lines` takes: the signal and what interpolation left of each order."""
    return lambda orders: [(signal.values, spline_response(orders / per_turn))]


def _acceleration(out: _Collector, signals: WindowSignals, name: str) -> None:
    rig, samples, track = signals.rig, signals.window.accelerations[name], signals.track
    try:
        signal, per_turn = signals.on_angle(name)
    except WindowError as error:
        out.missing("acceleration mesh_bands noise_rms", str(error))
        return

    def lines() -> MeasuredLines:
        highest = min(BEYOND_BAND * rig.band[1], USABLE_RATE * samples.rate)
        keys = mesh_keys(_harmonics(track, rig.teeth, highest, MOST_HARMONICS), SIDEBAND_HARMONICS)
        keys += [(0, p, 0) for p in (1, 2, 3)]
        return read_lines(signal, keys, rig.teeth, "m/s²", _attenuated(signal, per_turn))

    def bands() -> tuple[float | None, ...]:
        return tuple(None if np.isnan(b) else float(b) for b in mesh_bands(signal, rig.teeth[0]))

    out.add("acceleration", lines)
    out.add("mesh_bands", bands)
    out.add("noise_rms", lambda: noise_rms(signal, track.speed, rig.band))


def _torque(out: _Collector, rig: Rig, samples: Samples, track: AngleTrack) -> None:
    def lines() -> MeasuredLines:
        signal, per_turn = on_angle(samples, track)
        keys = [(0, 0, 0)]
        keys += mesh_keys(_harmonics(track, rig.teeth, USABLE_RATE * samples.rate, TE_HARMONICS), 1)
        keys += [(0, p, 0) for p in range(1, 11) if p < USABLE_RATE * per_turn] + [(0, 0, 1), (0, 0, 2)]
        return read_lines(signal, keys, rig.teeth, "N·m", _attenuated(signal, per_turn))

    out.add("torque", lines)


def _transmission_error(out: _Collector, signals: WindowSignals) -> None:
    rig, window, track = signals.rig, signals.window, signals.track

    def compute() -> MeasuredLines:
        te, teeth = signals.transmission_error, rig.teeth
        harmonics = min(TE_HARMONICS, int(USABLE_RATE * min(te.edges_per_turn) / teeth[0]))
        keys = [(0, 0, 0), *mesh_keys(harmonics, 4), *shaft_keys(teeth, SHAFT_ORDERS)]

        def attenuated(orders):
            h1, h2 = te.responses(orders)
            return [(te.pinion.values, h1), (-te.gear.values, h2)]

        return read_lines(te.signal, keys, teeth, te.unit, attenuated)

    out.add("transmission_error", compute)
    if "pinion" not in window.encoders or "gear" in window.encoders:
        return

    def alone() -> MeasuredLines:
        edges, teeth = window.encoders["pinion"], rig.teeth
        signal, unit = pinion_motion(edges, _base_radius(rig), track)
        harmonics = min(TE_HARMONICS, int(USABLE_RATE * edges.per_rev / teeth[0]))
        return read_lines(signal, mesh_keys(harmonics, 1), teeth, unit, _attenuated(signal, edges.per_rev))

    out.add("pinion_motion", alone)


def _level(out: _Collector, rig: Rig, window: Window, share: dict[str, float]) -> str | None:
    """RMS of the reference accelerometer; its name, None where there is none."""
    try:
        name, samples = reference(rig, window)
    except NotAvailable as error:
        out.missing("rms noise_rms mesh_bands acceleration", str(error))
        return None
    out.values |= {"sensor": name, "band": rig.band}
    try:
        level = band_level(samples, rig.band)
    except TwinError as error:
        out.missing("rms", str(error))
    else:
        out.values["rms"] = level.rms
        share[f"accel/{name}"] = level.valid_share
    return name


def _mean_torque(out: _Collector, rig: Rig, window: Window) -> Samples | None:
    """Mean of the pinion's torque without single spikes; its samples, None where there are none."""
    samples = window.torques.get("pinion")
    if samples is None or not np.isfinite(samples.values).any():
        why = "is in this window" if samples is None else "has a valid sample"
        out.missing("torque_nm torque", f"no torque channel of the pinion {why}")
        return None
    if not rig.calibrated("torque/pinion"):
        out.missing("torque_nm torque", "the unit of the torque channel is not known")
        return None
    samples = replace(samples, values=without_spikes(samples.values))
    out.values["torque_nm"] = float(np.nanmean(samples.values))
    return samples


def _indicators(out: _Collector, signals: WindowSignals, angle: bool) -> None:
    """Condition indicators of every accelerometer; of its gears only where the angle is known."""
    rig = signals.rig
    teeth = rig.teeth if rig.has("gears.pinion.teeth", "gears.gear.teeth") else None
    found: dict[str, SensorIndicators] = {}
    for name, samples in signals.window.accelerations.items():
        try:
            averages = partial(signals.gear_averages, name) if angle else None
            found[name] = sensor_indicators(samples, averages, teeth)
            if not rig.calibrated(f"accel/{name}"):
                found[name] = replace(found[name], calibrated=False)
            if angle and signals.track.doubt:
                found[name] = replace(found[name], doubt=signals.track.doubt)
        except WindowError as error:
            out.missing(f"indicators/{name}", str(error))
    out.values["indicators"] = found


def _motion(out: _Collector, track: AngleTrack) -> None:
    """Speed and revolutions."""
    out.values |= {
        "angle_from": track.source,
        "speed_hz": track.speed,
        "speed_std_hz": track.speed_std,
        "speed_variation": track.speed_variation,
        "turns": track.turns,
    }
    if track.source.startswith("encoder/"):
        out.values["revolutions"] = track.revolutions
    else:
        out.missing("revolutions", "no encoder counts the revolutions")


def extract(rig: Rig, window: Window, signals: WindowSignals | None = None) -> WindowFeatures:
    """Features of one window; what its channels or the rig do not allow is None with a reason.

    signals  of this window, where other features are computed from them, too
    """
    signals = signals or WindowSignals(rig, window)
    out = _Collector()
    share = {f"accel/{k}": _valid_share(s.values) for k, s in window.accelerations.items()}
    share |= {f"torque/{k}": _valid_share(s.values) for k, s in window.torques.items()}
    share |= {f"encoder/{k}": _valid_share(e.times) for k, e in window.encoders.items()}
    name = _level(out, rig, window, share)
    torque = _mean_torque(out, rig, window)
    try:
        track = signals.track
    except TwinError as error:
        names = "speed_hz revolutions noise_rms mesh_bands acceleration transmission_error torque"
        out.missing(names, str(error))
        _indicators(out, signals, angle=False)
    else:
        _motion(out, track)
        _indicators(out, signals, angle=True)
        if name is not None:
            _acceleration(out, signals, name)
        if torque is not None:
            _torque(out, rig, torque, track)
        _transmission_error(out, signals)
    return WindowFeatures(
        start_time_ns=window.start_time_ns,
        duration=window.duration,
        quality=window.quality,
        valid_share=share,
        unavailable=out.unavailable,
        **out.values,
    )
