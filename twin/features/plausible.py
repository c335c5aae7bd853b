"""Whether a window's mean torque can be this machine's: its rig file says at which torques it runs."""

from __future__ import annotations

from dataclasses import dataclass

from twin.rig import Rig
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatingThresholds:
    """How far from the operating points of the rig file a window may lie."""

    torque_ratio: float = deciding(
        4.0,
        of="largest torque that the rig file states in [operating]",
        meaning="largest mean torque at which a window is compared with the twin",
        source="not derived: chosen above 1.2, the largest ratio in the campaigns D00–D13, and below 8.9, the smallest "
        "factor that a wrong unit of torque gives (pound-force inches)",
    )


DEFAULT = OperatingThresholds()


def torque_contradiction(rig: Rig, torque: float, thresholds: OperatingThresholds = DEFAULT) -> str | None:
    """Why a mean torque [N·m] is not the machine's; None where it may be, or where the rig file states no torque."""
    stated = [abs(t) for t in (rig.get("operating.input_torque"), *_calibrations(rig)) if t]
    if not stated or abs(torque) <= thresholds.torque_ratio * max(stated):
        return None
    ratio = abs(torque) / max(stated)
    return (
        f"the mean torque {torque:.4g} N·m is {ratio:.3g} times the largest that the rig file states in [operating] "
        f"({max(stated):g} N·m): gain or unit of the torque meter, or another rig file?"
    )


def _calibrations(rig: Rig) -> list[float]:
    return [torque for _, torque in rig.get("operating.calibration_points", ())]
