"""What a rig file may hold: every key with its unit and range.

A value that cannot be is refused with its name, value, unit, allowed range and a likely cause; a key that is not known
is refused with the nearest one that is.
"""

from __future__ import annotations

import difflib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Any

from twin.errors import ParameterError
from twin.gear_age import NEW, UNKNOWN
from twin.rig_estimated import PARTS
from twin.wear.laws import LAWS

DEGREES_OF_FREEDOM = (
    "th1", "th2", "th3", "th5", "th7", "th8", "th10", "th12", "th13",
    "y4", "y5", "y6", "y9", "y10", "y11", "x4", "x5", "x6", "x9", "x10", "x11",
)  # fmt: skip
TORSION_CHAINS = {
    "input": (1, 2, 3, 5, 7),
    "output": (8, 10, 12, 13),
}  # nodes from motor to free end, free end to brake
TORSION_LINKS = tuple((a, b) for chain in TORSION_CHAINS.values() for a, b in pairwise(chain))


@dataclass(frozen=True, slots=True)
class _Number:
    """What one numeric key of the rig file may hold."""

    unit: str
    low: float  # exclusive unless `closed`
    high: float  # inclusive
    hint: str = ""
    closed: bool = False
    integer: bool = False

    def read(self, name: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ParameterError(f"{name} = {value!r} must be a number [{self.unit}]")
        _demand_float(name, value)
        inside = (self.low <= value if self.closed else self.low < value) and value <= self.high
        if not inside:  # NaN fails too
            bracket = "[" if self.closed else "("
            hint = f"; {self.hint}" if self.hint else ""
            unit = f" {self.unit}" if self.unit else ""
            raise ParameterError(
                f"{name} = {value:g}{unit} is outside {bracket}{self.low:g}, {self.high:g}]{unit}{hint}"
            )
        if self.integer and value != int(value):
            raise ParameterError(f"{name} = {value} must be a whole number")
        return value


def _demand_float(name: str, value: Any) -> None:
    """ParameterError for a whole number that no float can hold."""
    if isinstance(value, int) and value.bit_length() > sys.float_info.max_exp:
        raise ParameterError(f"{name} is a whole number of more than 300 digits: no machine has such a figure")


@dataclass(frozen=True, slots=True)
class _Text:
    allowed: tuple[str, ...] = ()

    def read(self, name: str, value: Any) -> str:
        if not isinstance(value, str):
            raise ParameterError(f"{name} = {value!r} must be text")
        if self.allowed and value not in self.allowed:
            raise ParameterError(f"{name} = {value!r} must be one of {', '.join(self.allowed)}")
        return value


@dataclass(frozen=True, slots=True)
class _NumberOr:
    """A number, or one of a few words."""

    number: _Number
    words: tuple[str, ...]

    def read(self, name: str, value: Any) -> float | int | str:
        if isinstance(value, str):
            if value not in self.words:
                raise ParameterError(f"{name} = {value!r} must be {', '.join(self.words)} or a number")
            return value
        return self.number.read(name, value)


@dataclass(frozen=True, slots=True)
class _Numbers:
    """A list of numbers, or of lists of numbers."""

    low: float = -inf
    high: float = inf

    def read(self, name: str, value: Any) -> tuple:
        if not isinstance(value, (list, tuple)) or not value:
            raise ParameterError(f"{name} must be a list of numbers")
        out: list[Any] = []
        for i, item in enumerate(value):
            _demand_float(f"{name}[{i}]", item)
            if isinstance(item, (list, tuple)):
                out.append(self.read(f"{name}[{i}]", item))
            elif isinstance(item, bool) or not isinstance(item, (int, float)) or not self.low <= item <= self.high:
                raise ParameterError(f"{name}[{i}] = {item!r} must be a number in [{self.low:g}, {self.high:g}]")
            else:
                out.append(float(item))
        return tuple(out)


@dataclass(frozen=True, slots=True)
class _Names:
    def read(self, name: str, value: Any) -> tuple[str, ...]:
        if not isinstance(value, (list, tuple)) or not all(isinstance(v, str) for v in value):
            raise ParameterError(f"{name} must be a list of names")
        return tuple(value)


@dataclass(frozen=True, slots=True)
class _PerChannel:
    """One number for every channel of a kind, or a table of numbers by the channel's name."""

    rule: _Number

    def read(self, name: str, value: Any) -> float | dict[str, float]:
        if isinstance(value, Mapping):
            return {channel: self.rule.read(f"{name}.{channel}", number) for channel, number in value.items()}
        return self.rule.read(name, value)


@dataclass(frozen=True, slots=True)
class _Tables:
    """A list of tables, each with the same keys."""

    columns: Mapping[str, Any]
    optional: tuple[str, ...] = ()

    def read(self, name: str, value: Any) -> tuple[dict[str, Any], ...]:
        if not isinstance(value, (list, tuple)) or not all(isinstance(item, Mapping) for item in value):
            raise ParameterError(f"{name} must be a list of tables: [[{name}]]")
        out = tuple(checked(item, self.columns, f"{name}[{i}].") for i, item in enumerate(value))
        for i, item in enumerate(out):
            missing = [key for key in self.columns if key not in item and key not in self.optional]
            if missing:
                raise ParameterError(f"{name}[{i}] lacks {', '.join(missing)}")
        return out


_TEETH = _Number("", 5, 1000, "tooth counts below 6 do not mesh", integer=True)
_LENGTH = "a length in mm?"
_WHEEL = {
    "teeth": _TEETH,
    "pitch_radius": _Number("m", 0, 5, _LENGTH),
    "base_radius": _Number("m", 0, 5, _LENGTH),
    "bore_radius": _Number("m", 0, 5, _LENGTH),
}
_STIFFNESS = _Number("N/m", 1e3, 1e12, "a stiffness in N/µm or N/mm?")
_TORSION = _Number("N·m/rad", 1e-2, 1e9, "a stiffness per degree?")
_INERTIA = _Number("kg·m²", 1e-9, 1e5, "an inertia in kg·mm² or kg·cm²?")
_MASS = _Number("kg", 1e-4, 1e5, "a mass in g?")
_DIAMETER = _Number("m", 0, 5, _LENGTH)
_RELATIVE = _Number("", 0, 0.9, "percent?", closed=True)
_GRADUATION = _Number("m", 0, 1e-3, "micrometres?")

SCHEMA: dict[str, Any] = {
    "schema": _Text(("gear-rig/1",)),
    "name": _Text(),
    "description": _Text(),
    "gears": {
        "module": _Number("m", 1e-5, 0.1, "a module in mm?"),
        "pressure_angle_deg": _Number("°", 5, 45, "radians?"),
        "face_width": _Number("m", 0, 2, _LENGTH),
        "youngs_modulus": _Number("Pa", 1e7, 2e12, "GPa?"),
        "poisson_ratio": _Number("", 0, 0.5),
        "density": _Number("kg/m³", 100, 30000, "g/cm³?"),
        "addendum": _Number("m", 0, 0.3, _LENGTH),
        "dedendum": _Number("m", 0, 0.3, _LENGTH),
        "backlash": _Number("m", 0, 0.01, _LENGTH, closed=True),
        "age": _NumberOr(_Number("rev", 0, 1e15, closed=True), (NEW, UNKNOWN)),
        "pinion": _WHEEL,
        "gear": _WHEEL,
        "path_of_contact": {
            "start": _Number("m", -1, 0),
            "end": _Number("m", 0, 1),
            "base_pitch": _Number("m", 0, 1),
            "contact_ratio": _Number("", 1, 5, "an addendum coefficient given in mm?"),
        },
    },
    "mesh": {
        "stiffness_source": _Text(("energy", "given")),
        "pair_s": _Numbers(-1, 1),
        "pair_stiffness": _Numbers(0, 1e12),
        "stiffness_scale": _Number("", 0.05, 20),
        "mean_stiffness": _Number("N/m", 1e5, 1e12, "N/(mm·µm)?"),
        "relative_damping_time": _Number("s", 0, 1e-2, "microseconds?", closed=True),
        "damping": _Number("N·s/m", 0, 1e7, closed=True),
        "corner_gap_start": _Numbers(),
        "corner_gap_end": _Numbers(),
    },
    "layout": {
        "degrees_of_freedom": _Names(),
        "torsion_chain_input": _Numbers(1, 99),
        "torsion_chain_output": _Numbers(1, 99),
    },
    "shafts": {
        "length": _DIAMETER,
        "diameter_min": _DIAMETER,
        "diameter_max": _DIAMETER,
        "torsion_segments": _Numbers(0, 10),
        "torsional_stiffness_half": _TORSION,
        "bearing_span": _DIAMETER,
        "gear_position_fraction": _Number("", 0, 0.999, "a distance instead of a fraction of the span?"),
        "bending_diameter_input": _DIAMETER,
        "bending_diameter_output": _DIAMETER,
        "bending_stiffness_input": _STIFFNESS,
        "bending_stiffness_output": _STIFFNESS,
    },
    "torsional_stiffness": {f"k_{a}_{b}": _TORSION for a, b in TORSION_LINKS},
    "inertias": {f"J{i}": _INERTIA for i in (1, 2, 3, 5, 7, 8, 10, 12, 13)},
    "masses": {f"m{i}": _MASS for i in (4, 5, 6, 9, 10, 11)},
    "bearings": {f"k{a}_{b}": _STIFFNESS for a in "xy" for b in ("input", "output")},
    "rolling_bearings": _Tables(
        {
            "name": _Text(),
            "shaft": _Text(("pinion", "gear")),
            "rolling_elements": _Number("", 3, 200, closed=True, integer=True),
            "element_diameter": _DIAMETER,
            "pitch_diameter": _DIAMETER,
            "contact_angle_deg": _Number("°", 0, 89, "radians?", closed=True),
        },
        optional=("contact_angle_deg",),
    ),
    "damping": {"modal_ratio": _Number("", 0, 0.5, "a ratio in percent?", closed=True)},
    "couplings": {"lateral_stiffness": _Number("N/m", 0, 1e12, closed=True)},
    "sensors": {
        "accelerometer": _Text(),
        "band_hz": _Numbers(0, 1e6),
        "encoder_input": _Text(),
        "encoder_output": _Text(),
        "torque": _Text(),
        "temperature": _Names(),
        "uncalibrated": _Names(),
        "ranges": {
            "accel": _PerChannel(_Number("m/s²", 0, 1e7, "a range in g?")),
            "torque": _PerChannel(_Number("N·m", 0, 1e8, "N·mm?")),
        },
    },
    "tolerances": {
        "stiffness": _RELATIVE,
        "mass": _RELATIVE,
        "damping": _RELATIVE,
        "pinion_once_per_turn": _GRADUATION,
        "gear_once_per_turn": _GRADUATION,
        "pinion_graduation": _GRADUATION,
        "gear_graduation": _GRADUATION,
        "accelerometer_gain": _Number("", 0, 3, "percent?"),
        "acceleration_floor": _Number("m/s²", 0, 1e3, "a level in g or mm/s²?"),
        "torque_floor": _Number("N·m", 0, 1e5, "N·mm?"),
    },
    "estimated": {
        "by": _Text(),
        "parts": _Names(),
        "spread": {part: _Number("", 0, 3, "percent?") for part in PARTS},
        "derived": _Names(),
        "assumed": _Names(),
    },
    "operating": {
        "pinion_speed_hz": _Number("Hz", 0, 2000, "rev/min?"),
        "input_torque": _Number("N·m", -1e6, 1e6, "N·mm?"),
        "calibration_points": _Numbers(),
        "measurement_interval_revs": _Number("rev", 0, 1e12),
        "hours_per_day": _Number("h", 0, 24),
        "end_revs": _Number("rev", 0, 1e15),
    },
    "wear": {
        "K": _Number("1/N", 0, 1, "a dimensional coefficient in m²/N?"),
        "max_depth_at_6000": _Number("m", 0, 0.1, "micrometres?"),
        "pinion_share": _Number("", 0, 1, "percent?"),
        "dwell_time": _Number("s", 0, 1),
        "contact_half_width": _Number("m", 0, 0.01, "micrometres?"),
        "law": _Text(tuple(LAWS)),
        **{
            law.name: {p.key: _Number(p.unit, p.low, p.high, p.hint) for p in law.parameters}
            for law in LAWS.values()
            if law.parameters
        },
    },
    "reference": {  # where the values come from: descriptive, not used by the model
        "natural_frequencies_hz": {
            key: _Numbers(0, 1e6) for key in ("measured", "paper_model", "this_model", "next_above")
        },
    },
    "end_of_life": {
        "criterion": _Text(("max_depth",)),
        "max_depth": _Number("m", 0, 0.1, "micrometres?"),
        "horizon_days": _Number("d", 0, 36_500, "hours?"),
    },
    "encoders": {
        "pinion_edges_per_rev": _Number("", 0, 1e7, integer=True),
        "gear_edges_per_rev": _Number("", 0, 1e7, integer=True),
    },
}


def checked(values: Mapping[str, Any], schema: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """The mapping with every key and value checked against the schema."""
    out: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{path}{key}"
        rule = schema.get(key)
        if rule is None:
            near = difflib.get_close_matches(key, schema, n=1, cutoff=0.4)
            known = f"did you mean {path}{near[0]}?" if near else f"known here: {', '.join(schema)}"
            raise ParameterError(f"{name} is not a key of a rig file; {known}")
        if isinstance(rule, Mapping):
            if not isinstance(value, Mapping):
                raise ParameterError(f"{name} must be a table, not {value!r}")
            out[key] = checked(value, rule, f"{name}.")
        else:
            out[key] = rule.read(name, value)
    return out
