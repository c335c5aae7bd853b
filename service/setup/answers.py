"""The answers of `gear-twin init`, checked, in SI: from an answers file or from the prompts.

    schema = "gear-answers/1"
    asset = "pump-drive"
    pinion_teeth = 19
    gear_teeth = 52
    speed = "600 rpm"                  # every quantity with its unit
    torque = "10 Nm"
    module = "2 mm"
    face_width = "20 mm"
    encoder_pinion = 1024
    age = "new"                        # of the gears now: also "5000 rev", "1200 h" or "unknown"

    [[accelerometers]]                 # the first is the reference
    column = "Acc1 (g)"
    unit = "g"
    place = "pinion free side"
    direction = "across"

    [known]                            # keys of a rig file whose values are known, in SI
    "inertias.J1" = 0.0135

Every fault is one line that names the key, its value and what would be right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import isfinite, pi, radians
from pathlib import Path
from typing import Any, TypeVar

from service.errors import InputError
from service.files.documents import Part, load_document
from service.files.rig import age_of
from service.setup.questions import OF_SENSOR, QUESTIONS, Question, quantity

T = TypeVar("T")
SCHEMA = "gear-answers/1"
AGREE = 0.02  # relative difference up to which two statements of one dimension count as one
TEETH = (6, 1000)
MODULE = (0.2e-3, 60e-3)  # [m]; ISO 54 lists 0.5 to 50 mm
WIDTH_MODULES = (2.0, 40.0)  # face width over module


@dataclass(frozen=True, slots=True, kw_only=True)
class Accelerometer:
    """One accelerometer."""

    column: str | None
    unit: str
    sensitivity: float | None  # [V/(m/s²)]
    place: str
    direction: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """What a person knows of a machine; None where it is not known."""

    asset: str
    pinion_teeth: int
    gear_teeth: int
    driver: str
    speed: float  # of the driving shaft [Hz]
    torque: float | None  # on the driving shaft [N·m]
    module: float | None  # [m]
    face_width: float | None  # [m]
    pressure_angle: float  # [rad]
    helix_angle: float  # [rad]
    profile_shift: float
    age: str | float  # of the gears now: new, unknown, or revolutions of the pinion
    material: str
    lubrication: str
    wear_limit: float | None  # [m]
    life_horizon_days: float | None
    encoder_pinion: int  # edges a turn, 0 for none
    encoder_gear: int
    encoder_signal: str
    encoder_pinion_column: str | None
    encoder_gear_column: str | None
    torque_meter: bool
    torque_column: str | None
    shaft_diameter_pinion: float | None  # [m]
    shaft_diameter_gear: float | None  # [m]
    bearing_span: float | None  # [m]
    data_file: str | None
    sample_rate: float | None  # [Hz]
    accelerometers: tuple[Accelerometer, ...]
    known: Mapping[str, float]  # keys of a rig file [SI]
    module_from: str = ""  # how the module follows from another dimension; empty where it was given

    @property
    def driving(self) -> tuple[str, str]:
        """The machine's names of the driving and of the driven gear."""
        return self._of_shafts("pinion", "gear")

    @property
    def teeth(self) -> tuple[int, int]:
        """Of the driving and of the driven gear."""
        return self._of_shafts(self.pinion_teeth, self.gear_teeth)

    @property
    def edges(self) -> tuple[int, int]:
        """Edges a turn on the driving and on the driven shaft: of a quadrature encoder four a line."""
        each = 4 if self.encoder_signal == "quadrature" else 1
        return self._of_shafts(each * self.encoder_pinion, each * self.encoder_gear)

    @property
    def encoder_columns(self) -> tuple[str | None, str | None]:
        """Of the encoders of the driving and of the driven shaft."""
        return self._of_shafts(self.encoder_pinion_column, self.encoder_gear_column)

    @property
    def shaft_diameters(self) -> tuple[float | None, float | None]:
        """Of the driving and of the driven shaft [m]."""
        return self._of_shafts(self.shaft_diameter_pinion, self.shaft_diameter_gear)

    def _of_shafts(self, pinion: T, gear: T) -> tuple[T, T]:
        """What belongs to the driving and what to the driven shaft."""
        return (pinion, gear) if self.driver == "pinion" else (gear, pinion)


def load_answers(path: str | Path) -> Answers:
    """The answers of an answers file."""
    data = Part(str(path), load_document(path, "answers file")).of_schema(SCHEMA).values
    return checked_answers({key: value for key, value in data.items() if key != "schema"}, str(path))


def checked_answers(data: Mapping[str, Any], where: str) -> Answers:
    """The answers of a mapping of keys; InputError at the first that cannot be."""
    known_keys = {q.key for q in QUESTIONS} | {"accelerometers", "known"}
    for key in data:
        if key not in known_keys:
            raise InputError(f"{where}: {key} is not a question of init; known: {', '.join(sorted(known_keys))}")
    read = {q.key: read_answer(f"{where}: {q.key}", q, data.get(q.key)) for q in QUESTIONS}
    Part(where, read).asset()
    read["age"] = age_of(f"{where}: age", read["age"], read["speed"])
    accelerometers = data.get("accelerometers", [])
    if not isinstance(accelerometers, list) or not all(isinstance(a, dict) for a in accelerometers):
        raise InputError(f"{where}: accelerometers must be tables: [[accelerometers]]")
    read["accelerometers"] = tuple(
        _accelerometer(f"{where}: accelerometers[{i}]", table) for i, table in enumerate(accelerometers)
    )
    read["known"] = _known(where, data.get("known", {}))
    _teeth(where, read)
    _shaft_load(where, read)
    read["module_from"] = _module(where, read)
    _plausible(where, read)
    names = {f.name for f in fields(Answers)}
    return Answers(**{key: value for key, value in read.items() if key in names})


def read_answer(where: str, question: Question, given: Any) -> Any:
    """The value of one answer; its default, or None, where there is none."""
    if given is None or given == "":
        given = question.default
    if given is None:
        if question.needed:
            raise InputError(f"{where} is missing: {question.text.lower()}, such as {question.example}")
        return None
    if question.kind == "text":
        return str(given)
    if question.kind == "yes":
        return _yes(where, given)
    if question.kind == "age":
        age_of(where, given, speed_hz=1.0)  # refuses what is none; the speed comes with the other answers
        return given
    if question.kind == "choice":
        if given not in question.choices:
            raise InputError(f"{where} = {given!r} must be one of {', '.join(question.choices)}")
        return given
    if question.kind in ("count", "number"):
        return _number(where, question, given)
    return quantity(where, given, question.kind, question.example)


def _yes(where: str, given: Any) -> bool:
    known = {True: True, False: False, "yes": True, "no": False, "y": True, "n": False}
    if isinstance(given, (list, dict)) or given not in known:
        raise InputError(f"{where} = {given!r} must be yes or no")
    return known[given]


def _number(where: str, question: Question, given: Any) -> float | int:
    try:
        value = float(given)
    except (TypeError, ValueError):
        value = float("nan")
    if isinstance(given, bool) or not isfinite(value):
        raise InputError(f"{where} = {given!r} must be a number, such as {question.example}")
    if question.kind == "number":
        return value
    if value != int(value) or value < 0:
        raise InputError(f"{where} = {given!r} must be a whole number, such as {question.example}")
    return int(value)


def _accelerometer(where: str, table: Mapping[str, Any]) -> Accelerometer:
    Part(where, table).only(*(q.key for q in OF_SENSOR))
    found = Accelerometer(**{q.key: read_answer(f"{where}.{q.key}", q, table.get(q.key)) for q in OF_SENSOR})
    if (found.unit == "V") != (found.sensitivity is not None):
        raise InputError(f"{where}: unit 'V' and sensitivity (V per m/s²) go together")
    return found


def _known(where: str, given: Any) -> dict[str, float]:
    if not isinstance(given, dict):
        raise InputError(f'{where}: known must be a table of rig file keys, such as "inertias.J1" = 0.0135')
    out: dict[str, float] = {}
    for key, value in given.items():
        if isinstance(value, dict):  # [known.inertias] J1 = … is the same as "inertias.J1" = …
            out |= {f"{key}.{inner}": number for inner, number in _known(f"{where}: known.{key}", value).items()}
        else:
            out[key] = value
    return out


def _teeth(where: str, read: Mapping[str, Any]) -> None:
    for key in ("pinion_teeth", "gear_teeth"):
        if not TEETH[0] <= read[key] <= TEETH[1]:
            raise InputError(f"{where}: {key} = {read[key]} is outside [{TEETH[0]}, {TEETH[1]}]")
    if read["pinion_teeth"] > read["gear_teeth"]:
        raise InputError(
            f"{where}: pinion_teeth = {read['pinion_teeth']} is more than gear_teeth = {read['gear_teeth']}: swapped? "
            "The pinion is the smaller gear; where the larger one drives, set driver = 'gear'"
        )


def _shaft_load(where: str, read: dict[str, Any]) -> None:
    """Torque on the driving shaft, from the power where that is what is known."""
    speed, torque, power = read["speed"], read["torque"], read["power"]
    if not 0 < speed <= 500:
        raise InputError(f"{where}: speed = {speed * 60:g} rpm = {speed:g} Hz is outside (0, 500] Hz: rpm or Hz?")
    if power is None:
        return
    from_power = power / (2 * pi * speed)
    if torque is None:
        read["torque"] = from_power
    elif abs(torque / from_power - 1) > AGREE:
        raise InputError(
            f"{where}: torque = {torque:g} N·m contradicts power = {power:g} W at {speed:g} Hz, which makes "
            f"{from_power:.4g} N·m on the driving shaft: torque of the other shaft, or rpm for Hz?"
        )


def _module(where: str, read: dict[str, Any]) -> str:
    """The module, from another dimension where that is what is known; how it follows."""
    z1, z2, given = read["pinion_teeth"], read["gear_teeth"], read["module"]
    others = {
        "centre_distance": ((z1 + z2) / 2, "2·a/(z1 + z2)"),
        "outside_diameter": (z2 + 2.0, "d_a/(z2 + 2)"),
    }
    how = ""
    for key, (modules, formula) in others.items():
        value = read[key]
        if value is None:
            continue
        module = value / modules
        if read["module"] is None:
            read["module"], how = module, f"{formula} of {key} = {value * 1e3:g} mm"
        elif abs(module / read["module"] - 1) > AGREE:
            stated = f"module = {given * 1e3:g} mm" if given is not None else how
            raise InputError(
                f"{where}: {key} = {value * 1e3:g} mm makes a module of {module * 1e3:.4g} mm and contradicts {stated} "
                f"({read['module'] * 1e3:.4g} mm): profile shift, a helix angle, or another tooth count?"
            )
    return how


def _plausible(where: str, read: Mapping[str, Any]) -> None:
    """What no gearbox has, with a likely cause."""
    m, W, α = read["module"], read["face_width"], read["pressure_angle"]
    if m is not None and not MODULE[0] <= m <= MODULE[1]:
        raise InputError(
            f"{where}: module = {m * 1e3:g} mm is outside [{MODULE[0] * 1e3:g}, {MODULE[1] * 1e3:g}] mm: another unit, "
            "or a diametral pitch (module = 25.4 mm / diametral pitch)?"
        )
    if m is not None and W is not None and not WIDTH_MODULES[0] <= W / m <= WIDTH_MODULES[1]:
        raise InputError(
            f"{where}: face_width = {W * 1e3:g} mm is {W / m:.3g} modules of {m * 1e3:g} mm; usual are 6 to 20, "
            f"{WIDTH_MODULES[0]:g} to {WIDTH_MODULES[1]:g} are accepted: another unit?"
        )
    days = read["life_horizon_days"]
    if days is not None and not 0 < days <= 36_500:
        raise InputError(f"{where}: life_horizon_days = {days:g} is outside (0, 36500]: hours?")
    if not radians(10) <= α <= radians(35):
        raise InputError(f"{where}: pressure_angle = {α * 180 / pi:g}° is outside [10, 35]°: radians for degrees?")
    if m is not None and read["wear_limit"] is not None and read["wear_limit"] > 1.5 * m:
        raise InputError(
            f"{where}: wear_limit = {read['wear_limit'] * 1e3:g} mm is more than a tooth of module {m * 1e3:g} mm is "
            "thick: another unit?"
        )
    if m is not None:
        _shafts_fit(where, read, m)


def _shafts_fit(where: str, read: Mapping[str, Any], module: float) -> None:
    for wheel in ("pinion", "gear"):
        d, root = read[f"shaft_diameter_{wheel}"], module * (read[f"{wheel}_teeth"] - 2.5)
        if d is not None and not 0 < d < root:
            raise InputError(
                f"{where}: shaft_diameter_{wheel} = {d * 1e3:g} mm must be below the root diameter of the {wheel}, "
                f"{root * 1e3:.4g} mm"
            )
