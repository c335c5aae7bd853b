"""The spec of a campaign: read from a mapping, checked key by key, frozen.

Units stand in the names, as an engineer writes them (`_um`, `_hz`, `_nm`); what is used inside is SI.
An unknown key, a missing one, or a value outside its range is one clear SpecError.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from math import inf
from typing import Any

from recordings.generator.effects import EFFECTS
from recordings.generator.errors import SpecError
from recordings.generator.faults import FAULTS
from recordings.generator.schema import REQUIRED, Choices, Flag, Named, Number, Numbers, Rows, Text, checked

_SPEED = Number("Hz", 0.1, 100)
_TORQUE = Number("N·m", 0.01, 1000)
_SECONDS = Number("s", 0.25, 600)
_REVOLUTIONS = Number("rev", 0, 1e9)

SCHEMA: dict[str, Any] = {
    "schema": Text(),
    "rig": Text("../rigs/unsw.toml"),
    "asset": Text(),
    "description": Text("wear campaign, measurement windows"),
    "started": Text("2026-01-05T08:00:00+00:00"),
    "seed": Number("", 0, 2**32, integer=True),
    "wear": {
        "k_m2_per_n": Number("m²/N", 0, 1e-9),
        "from_revolutions": Number("rev", 0, 1e9, 0.0),
        "contact_half_width_um": Number("µm", 20, 1000, 200.0),
        "step_um": Number("µm", 0.05, 2, 1.0),
        "tooth_scatter": Number("", 0, 0.6, 0.01),
        "pinion_factor": Number("", 0, 20, 1.0),
        "gear_factor": Number("", 0, 20, 1.0),
        "face_gradient": Number("", -1, 1, 0.0),
        "dynamic_forces": Flag(False),
        "running_in_factor": Number("", 0.1, 10, 1.0),
        "running_in_revolutions": Number("rev", 1, 1e9, 2000.0),
    },
    "machine": {
        "stiffness_spread": Number("", 0, 0.3, 0.03),
        "mass_spread": Number("", 0, 0.3, 0.01),
        "damping_spread": Number("", 0, 0.9, 0.2),
        "mesh_stiffness_scale": Number("", 0.2, 5, 1.0),
        "mesh_damping_scale": Number("", 0, 10, 1.0),
        "slices": Number("", 1, 41, 9, integer=True),
    },
    "drive": {
        "speed_spread": Number("", 0, 0.1, 0.005),
        "torque_spread": Number("", 0, 0.2, 0.01),
        "speed_wander": Number("", 0, 0.1, 0.001),
        "torque_wander": Number("", 0, 0.2, 0.004),
        "wander_seconds": Number("s", 0.05, 100, 1.5),
    },
    "solver": {"step_rate_hz": Number("Hz", 40e3, 2e6, 102400.0)},
    "calibration": Rows({"speed_hz": _SPEED, "torque_nm": _TORQUE, "seconds": _SECONDS}),
    "conditions": Rows(
        {"speed_hz": _SPEED, "torque_nm": _TORQUE, "until_revolutions": Number("rev", 0, inf, inf)},
        REQUIRED,
    ),
    "windows": {
        "seconds": Number("s", 0.25, 600, 2.5),
        "at_revolutions": Numbers(_REVOLUTIONS),
        "speed_rise": Numbers(Number("", -0.8, 0.8), ()),
        "torque_rise": Numbers(Number("", -0.8, 0.8), ()),
    },
    "sensors": {
        "acceleration_rate_hz": Number("Hz", 1000, 102400, 12800.0),
        "torque_rate_hz": Number("Hz", 400, 102400, 1600.0),
        "frame_seconds": Number("s", 0.01, 10, 0.25),
        "acceleration_noise": Number("m/s²", 0, 100, 0.1),
        "acceleration_range": Number("m/s²", 1, 1e5, 1000.0),
        "torque_noise_nm": Number("N·m", 0, 10, 0.05),
        "torque_range_nm": Number("N·m", 0.1, 1e4, 50.0),
        "bits": Number("", 8, 24, 16, integer=True),
        "encoder_jitter_ns": Number("ns", 0, 1e5, 60.0),
        "encoder_clock_ns": Number("ns", 0.1, 1e4, 10.0),
        "pinion_graduation_um": Numbers(Number("µm", 0, 100), (0.5, 0.2, 0.1)),
        "encoder_drift_um": Number("µm", -1000, 1000, 0.0),
        "torque_drift_nm": Number("N·m", -100, 100, 0.0),
        "drift_revolutions": Number("rev", 1, 1e9, 5000.0),
        "missing": Choices(("torque/pinion", "encoder/pinion", "encoder/gear")),
        "gear_graduation_um": Numbers(Number("µm", 0, 100), (1.4, 0.5, 0.2)),
    },
    "effects": Named(
        "name",
        {"onset_revolutions": Number("rev", 0, 1e9, 0.0), "full_revolutions": Number("rev", 0, 1e9, 0.0)},
        EFFECTS,
    ),
    "faults": Named("kind", {"window": Number("", 0, 10000, integer=True), "channel": Text("accel/y6")}, FAULTS),
    "truth": {
        "to_end_of_life": Flag(False),
        "life_step_um": Number("µm", 0.05, 20, None),
        "life_share": Number("", 0.05, 1, None),
    },
}


def read(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """The checked spec, nested as in the file."""
    spec = checked(mapping, SCHEMA)
    if spec["schema"] != "gear-campaign/1":
        raise SpecError(f"schema = {spec['schema']!r} must be 'gear-campaign/1'")
    _moment(spec["started"])
    windows = spec["windows"]["at_revolutions"]
    if list(windows) != sorted(windows):
        raise SpecError("windows.at_revolutions must rise")
    if not windows and not spec["calibration"]:
        raise SpecError("windows.at_revolutions is empty and there is no calibration: nothing to record")
    for key in ("speed_rise", "torque_rise"):
        if spec["windows"][key] and len(spec["windows"][key]) != len(windows):
            raise SpecError(f"windows.{key} must have one value for each of the {len(windows)} windows, or none")
    ends = [c["until_revolutions"] for c in spec["conditions"]]
    if not ends or ends != sorted(ends) or (windows and windows[-1] > ends[-1]):
        raise SpecError("conditions must be in rising order of until_revolutions and reach the last window")
    step, rate = spec["solver"]["step_rate_hz"], spec["sensors"]
    for key in ("acceleration_rate_hz", "torque_rate_hz"):
        if step % rate[key]:
            raise SpecError(f"sensors.{key} = {rate[key]:g} Hz must divide solver.step_rate_hz = {step:g} Hz")
    count = len(windows) + len(spec["calibration"])
    for i, fault in enumerate(spec["faults"]):
        if fault["window"] >= count:
            raise SpecError(f"faults[{i}].window = {fault['window']} but there are {count} windows, from 0")
    return spec


def _moment(started: str) -> None:
    try:
        known = datetime.fromisoformat(started).tzinfo is not None
    except ValueError:
        known = False
    if not known:
        raise SpecError(f"started = {started!r} must be ISO 8601 with a time zone, as 2026-01-05T08:00:00+00:00")
