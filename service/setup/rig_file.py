"""A rig file from a few answers: what was given, what follows from it, and a generic structure with its spread."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, exp, pi
from typing import Any

from service.errors import InputError
from service.files.rig import checked_rig
from service.setup.answers import Answers
from service.toml_text import DIGITS, value_text
from twin.errors import ParameterError
from twin.generic_structure import SPREADS, KnownGears, gear_tables, generic_structure
from twin.quantiles import Z95
from twin.rig import Rig
from twin.rig_estimated import part_of
from twin.rig_schema import SCHEMA, checked

BY = "gear-twin init"
WORN_SHARE = 0.1  # of the tooth's thickness on the pitch circle: the usual limit of maintenance rules for closed gears
MATERIALS: Mapping[str, Mapping[str, float]] = {  # E [Pa], ν, ρ [kg/m³]
    "steel": {"youngs_modulus": 206e9, "poisson_ratio": 0.3, "density": 7850.0},
    "cast iron": {"youngs_modulus": 160e9, "poisson_ratio": 0.27, "density": 7200.0},
    "bronze": {"youngs_modulus": 110e9, "poisson_ratio": 0.34, "density": 8800.0},
}
NODES = {  # nodes of the model's bearings by the gear of their shaft (driving, driven) and side
    ("driving", "drive side"): 4,
    ("driving", "free side"): 6,
    ("driven", "drive side"): 11,
    ("driven", "free side"): 9,
}
AXES = {"across": "y", "along": "x"}
ABOUT = {
    "gears.addendum": "standard basic rack (ISO 53): 1 module",
    "gears.dedendum": "standard basic rack (ISO 53): 1.25 modules",
    "gears.backlash": "module/20",
    "gears.pinion.bore_radius": "half of its shaft's diameter",
    "gears.gear.bore_radius": "half of its shaft's diameter",
    "wear.pinion_share": "z2/(z1 + z2)",
    "end_of_life.max_depth": "10 % of the tooth's thickness on the pitch circle, a usual limit of maintenance rules; "
    "state your own",
    "wear.dwell_time": "2·b/(ω1·r_b1), b half-width by Hertz: goes with wear.K",
    "wear.K": "specific wear rate usual for the lubrication",
    "wear.contact_half_width": "five times the half-width by Hertz: worn-in flanks",
    "sensors.band_hz": "ten mesh harmonics, at least 2 kHz, within the sampling rate",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class RigDraft:
    """Values of a rig file by dotted key, with the origin of each, and why there is no model where there is none."""

    values: Mapping[str, Any]
    origin: Mapping[str, str]
    without_model: tuple[str, ...]  # reasons; empty where the file holds a model
    accelerometers: tuple[str, ...]  # names of the channels, in the order of the answers

    @property
    def mapping(self) -> dict[str, Any]:
        """As a TOML reader would give it."""
        return tomllib.loads(rig_text(self))

    @property
    def rig(self) -> Rig:
        return checked_rig(self.mapping, BY)


def draft_of(answers: Answers) -> RigDraft:
    """The rig file of a machine; InputError where what is known contradicts itself."""
    given: dict[str, Any] = {"schema": "gear-rig/1", "name": answers.asset}
    given |= _operating(answers) | _sensors(answers)
    values, origin = dict(given), dict.fromkeys(given, "given")
    values["gears.age"], origin["gears.age"] = answers.age, "given: when a counter of the revolutions is at 0"
    reasons = why_no_model(answers)
    if not reasons:
        _with_model(answers, values, origin)
    else:
        z1, z2 = answers.teeth
        gears: dict[str, Any] = {"gears.pinion.teeth": z1, "gears.gear.teeth": z2}
        if answers.module is not None:
            gears["gears.module"] = answers.module
        values |= gears
        origin |= dict.fromkeys(gears, "given")
    _limit(answers, values, origin)
    _check_known(answers.known)
    for key, value in answers.known.items():
        values[key], origin[key] = value, "given"
    values |= _estimated(origin)
    if "sensors.band_hz" not in answers.known:
        origin["sensors.band_hz"] = f"derived: {ABOUT['sensors.band_hz']}"
    draft = RigDraft(
        values=values, origin=origin, without_model=reasons, accelerometers=tuple(accelerometer_names(answers))
    )
    draft.rig  # noqa: B018 - refuses what contradicts itself
    return draft


def _check_known(known: Mapping[str, Any]) -> None:
    """That known values are keys of a rig file and within their ranges."""
    for key, value in known.items():
        nested: Any = value
        for name in reversed(key.split(".")):
            nested = {name: nested}
        try:
            checked(nested, SCHEMA)
        except ParameterError as error:
            raise InputError(f"known: {error}") from None


def why_no_model(answers: Answers) -> tuple[str, ...]:
    """Why no model of the machine can be made; empty where one can."""
    reasons = []
    if answers.module is None:
        reasons.append("the module is not known, nor a centre distance or outside diameter that gives it")
    if answers.face_width is None:
        reasons.append("the face width is not known")
    if answers.torque is None:
        reasons.append("neither torque nor power is known")
    if answers.helix_angle != 0:
        reasons.append(f"the gears are helical ({degrees(answers.helix_angle):g}°), and the model is of spur gears")
    if answers.profile_shift != 0:
        reasons.append(f"the profile shift is {answers.profile_shift:g}, and the model is of gears without one")
    return tuple(reasons)


def known_gears(answers: Answers) -> KnownGears:
    """What the generic structure is made from; only where `why_no_model` is empty."""
    assert answers.module is not None and answers.face_width is not None and answers.torque is not None
    return KnownGears(
        teeth=answers.teeth,
        module=answers.module,
        pressure_angle=answers.pressure_angle,
        face_width=answers.face_width,
        speed_hz=answers.speed,
        torque=answers.torque,
        lubrication=answers.lubrication,
        material=MATERIALS[answers.material],
        shaft_diameter=answers.shaft_diameters,
        bearing_span=answers.bearing_span,
    )


def _with_model(answers: Answers, values: dict[str, Any], origin: dict[str, str]) -> None:
    known = known_gears(answers)
    try:
        generic = generic_structure(known)
    except ParameterError as error:
        raise InputError(f"{BY}: {error}") from None
    for key, value in gear_tables(known).items():
        values.setdefault(key, value)
        origin.setdefault(key, "given")
    if answers.module_from:
        origin["gears.module"] = f"derived: {answers.module_from}"
    for key in ("youngs_modulus", "poisson_ratio", "density"):
        origin[f"gears.{key}"] = f"derived: {answers.material}"
    for key, value in generic.derived.items():
        values[key], origin[key] = value, f"derived: {ABOUT[key]}"
    for key, value in generic.assumed.items():
        values[key], origin[key] = value, f"assumed: {_assumption(key)}"


def _assumption(key: str) -> str:
    part = part_of(key)
    about = ABOUT.get(key, "generic")
    return about if part is None else f"{about}; right within a factor of {exp(Z95 * SPREADS[part]):.2g}"


def _operating(answers: Answers) -> dict[str, Any]:
    out: dict[str, Any] = {"operating.pinion_speed_hz": answers.speed}
    return out if answers.torque is None else out | {"operating.input_torque": answers.torque}


def accelerometer_names(answers: Answers) -> list[str]:
    """Channel names of the accelerometers: the model's coordinate where each sits, with a number where two share it."""
    names: list[str] = []
    for sensor in answers.accelerometers:
        gear, _, side = sensor.place.partition(" ")
        role = "driving" if gear == answers.driving[0] else "driven"
        name = f"{AXES[sensor.direction]}{NODES[role, side]}"
        count = sum(other.partition("-")[0] == name for other in names)
        names.append(name if count == 0 else f"{name}-{count + 1}")
    return names


def _sensors(answers: Answers) -> dict[str, Any]:
    out: dict[str, Any] = {}
    if answers.accelerometers:
        out["sensors.accelerometer"] = accelerometer_names(answers)[0]
        out["sensors.band_hz"] = [0.0, _band_end(answers)]
    if answers.torque_meter:
        out["sensors.torque"] = "measured"
    for shaft, edges in zip(("pinion", "gear"), answers.edges, strict=True):
        if edges:
            out[f"encoders.{shaft}_edges_per_rev"] = edges
    return out


def _band_end(answers: Answers) -> float:
    """Upper end of the level's band [Hz]: ten mesh harmonics, 2 kHz at least, and what the sampling rate allows."""
    wanted = max(2000.0, 10 * answers.teeth[0] * answers.speed)
    return wanted if answers.sample_rate is None else min(wanted, 0.4 * answers.sample_rate)


def _limit(answers: Answers, values: dict[str, Any], origin: dict[str, str]) -> None:
    key = "end_of_life.max_depth"
    if answers.wear_limit is not None:
        values[key], origin[key] = answers.wear_limit, "given"
    elif answers.module is not None:
        values[key], origin[key] = WORN_SHARE * pi * answers.module / 2, f"assumed: {ABOUT[key]}"
    else:
        return
    values["end_of_life.criterion"], origin["end_of_life.criterion"] = "max_depth", "given"
    if answers.life_horizon_days is not None:
        values["end_of_life.horizon_days"], origin["end_of_life.horizon_days"] = answers.life_horizon_days, "given"


def _estimated(origin: Mapping[str, str]) -> dict[str, Any]:
    """The table [estimated]: the keys that are derived or assumed by their origins."""
    derived, assumed = ([k for k, said in origin.items() if said.startswith(how)] for how in ("derived", "assumed"))
    if not derived and not assumed:
        return {}
    used = {part_of(key) for key in assumed}
    parts = [part for part in SPREADS if part in used]
    return {
        "estimated.by": BY,
        "estimated.parts": parts,
        **{f"estimated.spread.{part}": SPREADS[part] for part in parts},
        "estimated.derived": derived,
        "estimated.assumed": assumed,
    }


def rig_text(draft: RigDraft) -> str:
    """The rig file, with the origin of every value."""
    lines = [
        f"# Rig file of {draft.values['name']}, written by gear-twin init. SI units.",
        "# given: from your answers; derived: follows from them; assumed: generic, and listed in [estimated].",
        "# Where you measure or look up an assumed value, replace it and delete its key from estimated.assumed.",
        *(f"# No model: {reason}." for reason in draft.without_model),
        *_table_lines(draft, SCHEMA, ""),
    ]
    return "\n".join(lines)


def _table_lines(draft: RigDraft, schema: Mapping[str, Any], path: str) -> list[str]:
    keys = [k for k, rule in schema.items() if not isinstance(rule, Mapping) and f"{path}{k}" in draft.values]
    lines = []
    if keys and path:
        lines += ["", f"[{path[:-1]}]"]
    for key in keys:
        name = f"{path}{key}"
        origin = draft.origin.get(name, "")
        comment = f"  # {origin}" if origin and name not in ("schema", "name") else ""
        lines.append(f"{key} = {value_text(draft.values[name], DIGITS)}{comment}")
    for key, rule in schema.items():
        if isinstance(rule, Mapping):
            lines += _table_lines(draft, rule, f"{path}{key}.")
    return lines
