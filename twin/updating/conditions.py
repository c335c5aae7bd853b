"""The operating condition of a window, and whether it is a calibration test."""

from __future__ import annotations

from dataclasses import dataclass

from twin.errors import NotAvailable, WindowError
from twin.features.non_gear import NonGearFeatures
from twin.features.plausible import torque_contradiction
from twin.features.window_features import WindowFeatures
from twin.gear_age import unworn
from twin.model import Condition
from twin.rig import Rig
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionMatch:
    """Which windows are calibration tests."""

    calibration_point: float = deciding(
        0.15,
        of="speed and torque of a calibration point",
        meaning="relative difference up to which a window is a test at that point",
        source="not derived: chosen so that a drive which holds its set point within some per cent is recognised",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RevolutionCount:
    """When a falling revolution count is no longer the same machine's."""

    most_fall: float = deciding(
        150.0,
        unit="turns of the pinion",
        meaning="fall of the revolution count below that of an earlier window, from which the window is refused",
        source="not derived: chosen so that overlapping windows and windows that arrive late (10 s at 10 Hz are 100 "
        "turns) are used",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelComparison:
    """Whether a window's level can be compared with that of its mean speed."""

    most_uncertain: float = deciding(
        0.05,
        of="level",
        meaning="uncertainty of the level, for the change of speed within the window, above which it is not compared",
        source="derivation: the difference of levels by which a window updates the twin (Feng et al.)",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyTorque:
    """Whether a window's mean torque stands for its load."""

    largest_swing: float = deciding(
        0.1,
        of="mean torque",
        meaning="amplitude of a torque at an order of no shaft from which a window calibrates nothing",
        source="not derived: chosen; the mean transmission error then moves by a tenth of the mesh's deflection, about "
        "what unworn gears are off (CalibrationFit.line_scatter)",
    )


MATCH, COUNT, LEVEL, TORQUE = ConditionMatch(), RevolutionCount(), LevelComparison(), SteadyTorque()


def swing_of(beside: NonGearFeatures | None, torque: float | None, limits: SteadyTorque = TORQUE) -> str | None:
    """Why the mean torque [N·m] does not stand for the load: it swings at an order of no shaft; None where it does.

    beside  what the window shows beside the gears; None where it was not looked for
    """
    swings = [
        (abs(y), r.order)
        for r in (() if beside is None else beside.readings)
        if (y := r.amplitude("torque")) is not None
    ]
    if not swings or not torque:
        return None
    size, order = max(swings)
    if size < limits.largest_swing * abs(torque):
        return None
    return f"it swings by {size:.3g} N·m at order {order:.3g} of the pinion, which is of no shaft"


def condition_of(features: WindowFeatures, rig: Rig) -> Condition:
    """The window's own speed and torque; torque from the rig's nominal condition where no meter is there."""
    if features.speed_hz is None:
        raise NotAvailable("the twin is not available: " + features.unavailable.get("speed_hz", "no speed"))
    torque = features.torque_nm
    if torque is None:
        (torque,) = rig.require("the torque", "operating.input_torque")
    if not torque > 0:
        raise NotAvailable(f"the twin is not available: torque = {torque:.3g} N·m does not drive the pinion forward")
    contradiction = torque_contradiction(rig, torque)
    if contradiction is not None:
        raise NotAvailable(f"the twin is not available: {contradiction}")
    return Condition(speed_hz=features.speed_hz, torque=torque)


def kind_of(features: WindowFeatures, rig: Rig) -> str:
    """`calibration` where speed and torque are those of a calibration point of the rig, else `measurement`."""
    nominal = rig.get("operating.pinion_speed_hz")
    if features.speed_hz is None or nominal is None:
        return "measurement"
    for speed, torque in rig.get("operating.calibration_points", ()):
        near = abs(features.speed_hz / speed - 1) < MATCH.calibration_point
        loaded = features.torque_nm is None or abs(features.torque_nm / torque - 1) < MATCH.calibration_point
        if near and loaded and abs(speed / nominal - 1) > MATCH.calibration_point:
            return "calibration"
    return "measurement"


def refuse_falling_count(revolutions: float, seen: float, most_fall: float = COUNT.most_fall) -> None:
    """Raises WindowError where the revolution count has fallen far below what was seen of the machine before.

    revolutions  of the pinion since new, of the window
    seen         of the latest window that updated the twin
    """
    if revolutions < seen - most_fall:
        raise WindowError(
            f"the pinion has made {revolutions:.0f} revolutions since new by this window, {seen:.0f} by an earlier one "
            "of this asset: have the gears been replaced, has the encoder's count been reset, or is this another "
            "machine? The window is not used; record another machine, or new gears, under another asset name"
        )


def _moved_by_speed(features: WindowFeatures, limits: LevelComparison = LEVEL) -> str | None:
    """Why a level cannot be compared with that of the mean speed; None where it can."""
    off = features.level_uncertainty
    if off is None or off <= limits.most_uncertain:
        return None
    return (
        f"the speed changes within the window (standard deviation {100 * (features.speed_variation or 0.0):.2g} %), "
        f"which moves the level by {100 * off:.2g} % of that at the mean speed"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A window that has all that the twin needs of it."""

    features: WindowFeatures
    condition: Condition
    kind: str  # `measurement` or `calibration`
    revolutions: float  # of the pinion since new; since the count began where the gears' age is not known
    rms: float | None  # in the rig's band [m/s²]; None without a usable accelerometer
    noise: float  # the part of it that lies between the orders [m/s²]
    level_fault: str | None  # why the level may not be compared (a clipped sensor), None where it may
    torque_fault: str | None  # why the torque is doubtful, None where it is not

    @property
    def unworn(self) -> bool:
        """Whether the flanks are known to be new."""
        return unworn(self.revolutions, self.features.age_known)

    @classmethod
    def of(
        cls, features: WindowFeatures, rig: Rig, level_fault: str | None = None, torque_fault: str | None = None
    ) -> Measured:
        """Checks a window's features; NotAvailable says which are missing."""
        condition = condition_of(features, rig)
        if features.revolutions is None:
            raise NotAvailable("wear is not available: the window has no absolute revolution count (no encoder)")
        rms = features.rms
        if rms is None:
            level_fault = features.unavailable.get("rms", "no acceleration")
        elif not rms > 0:
            rms, level_fault = None, f"{features.sensor} reads nothing (0 m/s²): cable, supply?"
        elif level_fault is None:
            level_fault = _moved_by_speed(features)
        if rms is None and features.transmission_error is None and features.pinion_motion is None:
            raise NotAvailable(f"the twin is not available: {level_fault}, and no encoder measures the depth either")
        return cls(
            features=features,
            condition=condition,
            kind=kind_of(features, rig),
            revolutions=features.revolutions,
            rms=rms,
            noise=features.noise_rms or 0.0,
            level_fault=level_fault,
            torque_fault=None if features.torque_nm is None else torque_fault,
        )
