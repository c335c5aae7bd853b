"""The operating condition of a window, and whether it is a calibration test."""

from __future__ import annotations

from dataclasses import dataclass

from twin.errors import NotAvailable
from twin.features.window_features import WindowFeatures
from twin.model import Condition
from twin.rig import Rig

CALIBRATION_MATCH = 0.15  # relative, of speed and torque, of a calibration point


def condition_of(features: WindowFeatures, rig: Rig) -> Condition:
    """The window's own speed and torque; torque from the rig's nominal condition where no meter is there."""
    if features.speed_hz is None:
        raise NotAvailable("the twin is not available: " + features.unavailable.get("speed_hz", "no speed"))
    torque = features.torque_nm
    if torque is None:
        (torque,) = rig.require("the torque", "operating.input_torque")
    if not torque > 0:
        raise NotAvailable(f"the twin is not available: torque = {torque:.3g} N·m does not drive the pinion forward")
    return Condition(speed_hz=features.speed_hz, torque=torque)


def kind_of(features: WindowFeatures, rig: Rig) -> str:
    """`calibration` where speed and torque are those of a calibration point of the rig, else `measurement`."""
    nominal = rig.get("operating.pinion_speed_hz")
    if features.speed_hz is None or nominal is None:
        return "measurement"
    for speed, torque in rig.get("operating.calibration_points", ()):
        near = abs(features.speed_hz / speed - 1) < CALIBRATION_MATCH
        loaded = features.torque_nm is None or abs(features.torque_nm / torque - 1) < CALIBRATION_MATCH
        if near and loaded and abs(speed / nominal - 1) > CALIBRATION_MATCH:
            return "calibration"
    return "measurement"


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A window that has all that the twin needs of it."""

    features: WindowFeatures
    condition: Condition
    kind: str  # `measurement` or `calibration`
    revolutions: float  # of the pinion since new
    rms: float | None  # in the rig's band [m/s²]; None without a usable accelerometer
    noise: float  # the part of it that lies between the orders [m/s²]
    level_fault: str | None  # why the level may not be compared (a clipped sensor), None where it may

    @classmethod
    def of(cls, features: WindowFeatures, rig: Rig, level_fault: str | None = None) -> Measured:
        """Checks a window's features; NotAvailable says which are missing."""
        condition = condition_of(features, rig)
        if features.revolutions is None:
            raise NotAvailable("wear is not available: the window has no absolute revolution count (no encoder)")
        rms = features.rms
        if rms is None:
            level_fault = features.unavailable.get("rms", "no acceleration")
        elif not rms > 0:
            rms, level_fault = None, f"{features.sensor} reads nothing (0 m/s²): cable, supply?"
        if rms is None and features.transmission_error is None and features.pinion_motion is None:
            raise NotAvailable(f"the twin is not available: {level_fault}, and no encoder tells the depth either")
        return cls(
            features=features,
            condition=condition,
            kind=kind_of(features, rig),
            revolutions=features.revolutions,
            rms=rms,
            noise=features.noise_rms or 0.0,
            level_fault=level_fault,
        )
