"""`gear-twin calibrate` as text: the values, and what they say of the fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.cli.show import number

UNITS = {"damping_time": "s", "contact_half_width": "m"}
LABELS = {
    "stiffness_scale": "mesh stiffness, of the computed",
    "modal_damping": "modal damping ratio",
    "damping_time": "mesh damping over mesh stiffness",
    "contact_half_width": "half-width of the contact",
}


def calibration_text(found: Mapping[str, Any]) -> str:
    """The calibration as a table, with the misfit and the doubts that it leaves."""
    calibration = found["calibration"]
    if "values" not in calibration:
        return f"Calibration of {found['asset']}: not available: {calibration.get('reason')}"
    spread = calibration.get("std_percent") or {}
    lines = [f"Calibration of {found['asset']} from windows {', '.join(map(str, found['windows']))}", ""]
    for name, value in calibration["values"].items():
        std = "" if spread.get(name) is None else f" ± {number(spread[name], 2)} %"
        shown = f"{number(value)} {UNITS.get(name, '')}".rstrip()
        lines.append(f"  {LABELS.get(name, name.replace('_', ' ')):<34}{shown}{std}")
    lines += ["", *_fit(calibration)]
    return "\n".join(lines)


def _fit(calibration: Mapping[str, Any]) -> list[str]:
    """How well the calibrated model fits the windows it was calibrated with."""
    if calibration["from"] != "windows":
        return ["No window could be used: these are the values that the rig file states or implies."]
    misfit, doubts = calibration.get("misfit"), calibration.get("doubts") or []
    meaning = "mean squared residual over its expected spread; about 1 or less where the model fits"
    lines = [f"Misfit: {number(misfit, 3)} ({meaning})."]
    lines += [f"Doubt: {doubt}." for doubt in doubts]
    if not doubts:
        lines.append("No doubt: the calibrated values are within the spreads of the rig file.")
    return lines
