"""All features of one window.

Orders refer to the smoothed pinion angle: from the pinion's encoder, else from the gear's (its angle times
z2/z1, zero at that encoder's edge 0), else from the mesh lines of the accelerometers, whose zero is
arbitrary.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import fft

from twin.errors import NotAvailable, TwinError
from twin.features.angle import AngleTrack, angle_track
from twin.features.gaps import runs
from twin.features.level import band_level
from twin.features.mesh_speed import mesh_track
from twin.features.orders import hann, mesh_bands, order_lines
from twin.features.resample import AngleSignal, on_angle, spline_response
from twin.features.transmission_error import transmission_error
from twin.features.window_features import Key, Lines, WindowFeatures
from twin.rig import Rig
from twin.windows import Samples, Window

HIGHEST_LINE = 2200.0  # acceleration lines are read up to here [Hz]
MOST_HARMONICS = 64
SHAFT_ORDERS = 15  # shaft orders of transmission error are read below this order of the pinion
TE_HARMONICS = 10
SIDEBAND_HARMONICS = 5  # mesh harmonics whose sidebands are read
USABLE_RATE = 0.45  # lines are read up to this share of the sampling rate


def order_of(key: Key, teeth: tuple[int, int]) -> float:
    """Order of pinion rotation of the line (k, p, g): k·z1 + p + g·z1/z2."""
    (k, p, g), (z1, z2) = key, teeth
    return k * z1 + p + g * z1 / z2


def mesh_keys(harmonics: int, sidebands: int) -> list[Key]:
    """Mesh harmonics 1 … n, then ± 1 and ± 2 pinion and gear sidebands of the first of them."""
    keys: list[Key] = [(k, 0, 0) for k in range(1, harmonics + 1)]
    for k in range(1, min(harmonics, sidebands) + 1):
        keys += [(k, s, 0) for s in (-1, 1, -2, 2)] + [(k, 0, s) for s in (-1, 1, -2, 2)]
    return keys


def shaft_keys(teeth: tuple[int, int], below: float) -> list[Key]:
    """Pinion orders, then gear orders, that lie below an order of the pinion and below its mesh order."""
    z1, z2 = teeth
    limit = min(below, z1 - 3)
    keys: list[Key] = [(0, p, 0) for p in range(1, int(limit) + 1)]
    return keys + [(0, 0, g) for g in range(1, int(limit * z2 / z1) + 1)]


def read_lines(signal: AngleSignal, keys: list[Key], teeth: tuple[int, int], unit: str, parts=None) -> Lines:
    """Lines of a signal on even angle at the orders of the keys, most wanted first."""
    orders = np.array([order_of(key, teeth) for key in keys])
    found = order_lines(signal, orders, parts(orders) if parts else None)
    good = np.isfinite(found.std)
    return Lines(
        unit=unit,
        keys=tuple(k for k, ok in zip(keys, good, strict=True) if ok),
        orders=tuple(float(o) for o in orders[good]),
        amplitudes=tuple(complex(a) for a in found.amplitudes[good]),
        std=tuple(float(s) for s in found.std[good]),
        unresolved=tuple(k for k, ok in zip(keys, good, strict=True) if not ok),
    )


def noise_rms(signal: AngleSignal, speed: float, band: tuple[float, float]) -> float:
    """RMS in the band [Hz] of what lies between the orders: a low quantile of the spectrum, block by block.

    In a block of 64 bins the power of noise is exponentially distributed: its 10 % quantile is 0.105 of its
    mean, and lines, which do not fill all bins, hardly move it. Taken from the longest stretch without a gap.
    Where every tooth differs (pitch errors), lines fill the bins between the orders: then an upper bound.
    """
    start, stop = max(runs(signal.usable), key=lambda r: r[1] - r[0])
    values = signal.values[start:stop]
    weight = hann(values.size)
    length = fft.next_fast_len(values.size, real=True)
    spectrum = fft.rfft(weight * (values - (weight @ values) / weight.sum()), length)
    frequency = np.arange(spectrum.size) * 2 * np.pi / (length * signal.step) * speed
    inside = spectrum[(frequency >= band[0]) & (frequency <= band[1])][3:]
    power = 2 * np.abs(inside) ** 2 / (length * (weight @ weight))
    blocks = power[: power.size // 64 * 64].reshape(-1, 64)
    if blocks.size == 0:
        raise NotAvailable(
            f"the noise floor is not available: {power.size} spectral bins in the band are too few"
        )
    floor = np.quantile(blocks, 0.1, axis=1) / -np.log(0.9)
    return float(np.sqrt(floor.mean() * power.size))


def _channel_share(values) -> float:
    return float(np.isfinite(values).mean()) if len(values) else 0.0


class _Collector:
    """Gathers features by name; what raises NotAvailable or WindowError is left out with its reason."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}
        self.unavailable: dict[str, str] = {}

    def add(self, names: str, compute) -> Any:
        try:
            results = compute()
        except TwinError as error:
            for name in names.split():
                self.unavailable[name] = str(error)
            return None
        listed = names.split()
        self.values.update(zip(listed, results if len(listed) > 1 else (results,), strict=True))
        return results


def pinion_angle(rig: Rig, window: Window, accelerations: dict[str, Samples]) -> AngleTrack:
    """The smoothed pinion angle from the best channel there is; an error that says why where none serves."""
    if "pinion" in window.encoders:
        return angle_track(window.encoders["pinion"])
    if "gear" in window.encoders:
        z1, z2 = rig.teeth
        return angle_track(window.encoders["gear"], z2 / z1, "encoder/gear")
    return mesh_track(rig, accelerations)


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


def _acceleration(out: _Collector, rig: Rig, samples: Samples, track: AngleTrack) -> None:
    signal, per_turn = on_angle(samples, track)

    def lines() -> Lines:
        highest = min(HIGHEST_LINE, USABLE_RATE * samples.rate)
        keys = mesh_keys(_harmonics(track, rig.teeth, highest, MOST_HARMONICS), SIDEBAND_HARMONICS)
        keys += [(0, p, 0) for p in (1, 2, 3)]
        return read_lines(signal, keys, rig.teeth, "m/s²", _attenuated(signal, per_turn))

    def bands() -> tuple[float | None, ...]:
        return tuple(None if np.isnan(b) else float(b) for b in mesh_bands(signal, rig.teeth[0]))

    out.add("acceleration", lines)
    out.add("mesh_bands", bands)
    out.add("noise_rms", lambda: noise_rms(signal, track.speed, rig.band))


def _torque(out: _Collector, rig: Rig, samples: Samples, track: AngleTrack) -> None:
    def lines() -> Lines:
        signal, per_turn = on_angle(samples, track)
        keys = [(0, 0, 0)]
        keys += mesh_keys(_harmonics(track, rig.teeth, USABLE_RATE * samples.rate, TE_HARMONICS), 1)
        keys += [(0, p, 0) for p in range(1, 11) if p < USABLE_RATE * per_turn] + [(0, 0, 1), (0, 0, 2)]
        return read_lines(signal, keys, rig.teeth, "N·m", _attenuated(signal, per_turn))

    out.add("torque", lines)


def _transmission_error(out: _Collector, rig: Rig, window: Window, track: AngleTrack) -> None:
    def compute() -> Lines:
        missing = [s for s in ("pinion", "gear") if s not in window.encoders]
        if missing:
            raise NotAvailable(
                f"transmission error is not available: no encoder on the {' and the '.join(missing)}"
            )
        teeth = rig.teeth
        te = transmission_error(
            window.encoders["pinion"], window.encoders["gear"], teeth, _base_radius(rig), track
        )
        harmonics = min(TE_HARMONICS, int(USABLE_RATE * min(te.edges_per_turn) / teeth[0]))
        keys = [(0, 0, 0), *mesh_keys(harmonics, 4), *shaft_keys(teeth, SHAFT_ORDERS)]

        def attenuated(orders):
            h1, h2 = te.responses(orders)
            return [(te.pinion.values, h1), (-te.gear.values, h2)]

        return read_lines(te.signal, keys, teeth, te.unit, attenuated)

    out.add("transmission_error", compute)


def extract(rig: Rig, window: Window) -> WindowFeatures:
    """Features of one window; what its channels or the rig do not allow is None with a reason."""
    out = _Collector()
    share = {f"accel/{k}": _channel_share(s.values) for k, s in window.accelerations.items()}
    share |= {f"torque/{k}": _channel_share(s.values) for k, s in window.torques.items()}
    share |= {f"encoder/{k}": _channel_share(e.times) for k, e in window.encoders.items()}

    def level(samples: Samples) -> float:
        measured = band_level(samples, rig.band)
        share[f"accel/{name}"] = measured.valid_share
        return measured.rms

    chosen = out.add("sensor _samples", lambda: reference(rig, window))
    name, samples = chosen if chosen else (None, None)
    if samples is None:
        reason = out.unavailable.pop("_samples")
        out.unavailable |= dict.fromkeys(("rms", "noise_rms", "mesh_bands", "acceleration"), reason)
    else:
        out.add("rms", lambda: level(samples))
        out.values["band"] = rig.band

    accelerations = {name: samples} if samples is not None else {}
    accelerations |= {k: s for k, s in window.accelerations.items() if k != name}
    track = out.add("_track", lambda: pinion_angle(rig, window, accelerations))

    torque = window.torques.get("pinion")
    if torque is None:
        reason = "no torque channel of the pinion is in this window"
        out.unavailable |= dict.fromkeys(("torque_nm", "torque_std_nm", "torque"), reason)
    elif not np.isfinite(torque.values).any():
        reason = "torque/pinion: not one of the channel's samples is valid"
        out.unavailable |= dict.fromkeys(("torque_nm", "torque_std_nm", "torque"), reason)
    else:
        out.values["torque_nm"] = float(np.nanmean(torque.values))
        out.values["torque_std_nm"] = float(np.nanstd(torque.values))

    if track is None:
        reason = out.unavailable.pop("_track")
        names = (
            "speed_hz",
            "revolutions",
            "noise_rms",
            "mesh_bands",
            "acceleration",
            "transmission_error",
            "torque",
        )
        for missing in names:
            out.unavailable.setdefault(missing, reason)
    else:
        absolute = track.source.startswith("encoder/")
        out.values |= {
            "angle_from": track.source,
            "speed_hz": track.speed,
            "speed_std_hz": track.speed_std,
            "speed_variation": track.speed_variation,
            "turns": track.turns,
        }
        if absolute:
            out.values["revolutions"] = track.revolutions
        else:
            out.unavailable["revolutions"] = "no encoder counts the revolutions"
        if samples is not None:
            _acceleration(out, rig, samples, track)
        if "torque_nm" in out.values:
            _torque(out, rig, torque, track)
        _transmission_error(out, rig, window, track)

    kept = {k: v for k, v in out.values.items() if not k.startswith("_")}
    return WindowFeatures(
        start_time_ns=window.start_time_ns,
        duration=window.duration,
        quality=window.quality,
        valid_share=share,
        unavailable=out.unavailable,
        **kept,
    )
