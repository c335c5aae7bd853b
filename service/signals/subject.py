"""One window with all that is known of its machine, computed once however many views are asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from service.signals.view import UnknownChannel
from twin.errors import NotAvailable, TwinError
from twin.features.angle import AngleTrack, angle_track
from twin.features.extract import WindowSignals, extract
from twin.features.resample import AngleSignal, on_angle
from twin.features.transmission_error import TransmissionError, pinion_motion, transmission_error
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.windows import Samples, Window

if TYPE_CHECKING:  # views of what is measured need no twin
    from twin.state import State
    from twin.tracing.modelled_lines import ModelledLines

TRANSMISSION_ERROR = "transmission-error"
UNITS = {"accel": "m/s²", "torque": "N·m", "encoder": "rad", TRANSMISSION_ERROR: "µm"}
MICROMETRE = 1e-6

Modelling = Callable[[WindowFeatures], "ModelledLines"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Subject:
    """A window to look at."""

    asset: str
    index: int
    window: Window
    rig: Rig
    model: Modelling | None = None  # the twin's lines of the window; None where they are not there, or not asked for
    no_model: str = ""  # why they are not there

    @property
    def started(self) -> datetime:
        return datetime.fromtimestamp(self.window.start_time_ns / 1e9, UTC)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Labels of all channels, the reference accelerometer first."""
        w = self.window
        accelerations = sorted(w.accelerations, key=lambda name: (name != self.rig.accelerometer, name))
        found = [f"accel/{name}" for name in accelerations]
        found += [f"torque/{name}" for name in sorted(w.torques)] + [f"encoder/{name}" for name in sorted(w.encoders)]
        both = "pinion" in w.encoders and "gear" in w.encoders
        return (*found, *([TRANSMISSION_ERROR] if both else []))

    def channel(self, label: str | None) -> str:
        """A channel by its label, the first where none is named; UnknownChannel."""
        if label is None and self.channels:
            return self.channels[0]
        if label not in self.channels:
            raise UnknownChannel(label or "", self.channels)
        return label

    def unit(self, label: str) -> str:
        if label == TRANSMISSION_ERROR and self._radius is None:
            return "mrad"
        return UNITS[label.partition("/")[0]]

    def samples(self, label: str) -> Samples:
        """The evenly sampled values of a channel; NotAvailable where it has edges."""
        kind, _, name = label.partition("/")
        if kind == "accel":
            return self.window.accelerations[name]
        if kind == "torque":
            return self.window.torques[name]
        raise NotAvailable(f"{label} is known at the encoders' edges, not evenly in time: choose its order spectrum")

    @cached_property
    def _signals(self) -> WindowSignals:
        return WindowSignals(self.rig, self.window)

    @property
    def track(self) -> AngleTrack:
        """The smoothed pinion angle; NotAvailable where no channel gives it."""
        try:
            return self._signals.track
        except TwinError as error:
            raise NotAvailable(f"the shaft angle is not known: {error}") from None

    @property
    def speed(self) -> tuple[float | None, str]:
        """The pinion's speed [Hz], None where it is not known, and where it is from."""
        try:
            return self.track.speed, self.track.source
        except NotAvailable:
            pass
        return self.rig.get("operating.pinion_speed_hz"), "the rig file's nominal speed"

    @cached_property
    def teeth(self) -> tuple[int, int] | None:
        return self.rig.teeth if self.rig.has("gears.pinion.teeth", "gears.gear.teeth") else None

    @cached_property
    def _radius(self) -> float | None:
        radius = self.rig.value("gears.pinion.base_radius")
        return None if radius is None else float(radius)

    @cached_property
    def error(self) -> TransmissionError:
        """Transmission error from both encoders; NotAvailable, WindowError."""
        encoders = self.window.encoders
        if self.teeth is None:
            raise NotAvailable("transmission error is not available: the rig file does not give both numbers of teeth")
        missing = [shaft for shaft in ("pinion", "gear") if shaft not in encoders]
        if missing:
            raise NotAvailable(f"transmission error is not available: no encoder on the {' and the '.join(missing)}")
        track = self.track if self.track.source == "encoder/pinion" else None
        return transmission_error(encoders["pinion"], encoders["gear"], self.teeth, self._radius, track)

    def on_angle(self, label: str) -> tuple[AngleSignal, float]:
        """A channel on an even grid of pinion angle, in its unit, and its own values per pinion turn."""
        if label == TRANSMISSION_ERROR:
            te = self.error
            scale = 1e-3 if te.unit == "rad" else MICROMETRE
            signal = te.signal
            shown = AngleSignal(
                start=signal.start, step=signal.step, usable=signal.usable,
                values=(signal.values - np.mean(signal.values[signal.usable])) / scale,
            )  # fmt: skip
            return shown, min(te.edges_per_turn)
        if label.startswith("encoder/"):
            return self._encoder_motion(label.partition("/")[2])
        return on_angle(self.samples(label), self.track)

    def _encoder_motion(self, shaft: str) -> tuple[AngleSignal, float]:
        """What an encoder's angle departs from its smoothed rotation [rad], over pinion angle."""
        edges = self.window.encoders[shaft]
        signal, _ = pinion_motion(edges, None, angle_track(edges, source=f"encoder/{shaft}"))
        if shaft == "pinion":
            return signal, float(edges.per_rev)
        if self.teeth is None:
            raise NotAvailable(
                "orders of the gear's encoder are not available: the rig file does not give both numbers of teeth"
            )
        z1, z2 = self.teeth
        signal = AngleSignal(
            start=signal.start * z2 / z1, step=signal.step * z2 / z1, values=signal.values, usable=signal.usable
        )
        return signal, edges.per_rev * z1 / z2

    @cached_property
    def _modelled(self) -> ModelledLines | str:
        if self.model is None:
            return self.no_model
        try:
            return self.model(extract(self.rig, self.window, self._signals))
        except TwinError as error:
            return str(error)

    @property
    def modelled(self) -> ModelledLines | None:
        """The twin's lines of this window; None where there are none, for the reason of `why_not_modelled`."""
        return None if isinstance(self._modelled, str) else self._modelled

    @property
    def why_not_modelled(self) -> str:
        return self._modelled if isinstance(self._modelled, str) else ""

    def modelled_channel(self, label: str) -> np.ndarray | None:
        """Complex lines of a channel in its unit; None where the model does not have it."""
        m = self.modelled
        if m is None:
            return None
        if label == TRANSMISSION_ERROR and self._radius is not None:
            return m.transmission_error / MICROMETRE
        if label == "torque/pinion":
            return m.torque
        return m.acceleration if label == f"accel/{m.sensor}" else None

    def require_shaft(self, shaft: str) -> tuple[float, int]:
        """Pinion turns in a turn of a shaft, and its number of teeth (0 where not known)."""
        if shaft == "pinion":
            return 1.0, 0 if self.teeth is None else self.teeth[0]
        if self.teeth is None:
            raise NotAvailable("the gear's turns are not known: the rig file does not give both numbers of teeth")
        return self.teeth[1] / self.teeth[0], self.teeth[1]

    @property
    def notes(self) -> tuple[str, ...]:
        """What is wrong with the window's data."""
        found = dict.fromkeys(
            f"{f.kind} in {f.channel or 'the window'}: {f.detail or f.count}"
            for f in self.window.faults
            if f.action != "none"
        )
        return (f"the window is {self.window.quality}: {'; '.join(found)}",) if found else ()


def modelling(rig: Rig, state: State, recorded_um: Callable[[], float | None]) -> Modelling:
    """How the twin's lines of a window are made, by its present state.

    recorded_um  depth in the window's record [µm], for a window that the twin's history no longer holds
    """
    from twin.tracing.modelled_lines import depth_at, modelled_lines  # loads the twin

    def lines(features: WindowFeatures) -> ModelledLines:
        depth = depth_at(state, features.start_time_ns)
        if depth is None:
            micrometres = recorded_um()
            if micrometres is None:
                raise NotAvailable("this window has no wear depth")
            depth = micrometres * MICROMETRE
        return modelled_lines(rig, state, features, depth)

    return lines
