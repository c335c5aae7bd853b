"""The questions of `gear-twin init`: keys of the answers file, what is asked, in which unit, and what holds by default.

An empty answer to a question that may be left open means: not known. What then follows is said, not invented. A
quantity is written with its unit ("2 mm", "600 rpm", "1,5 kW"); a bare number is refused: a module of 2 could be
millimetres or metres, a speed of 10 could be hertz or turns a minute.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi, radians

from service.errors import InputError

INCH, POUND_FOOT, HORSEPOWER = 0.0254, 1.3558179483314004, 745.6998715822702
UNITS: Mapping[str, Mapping[str, float]] = {  # kind of quantity → unit → factor to SI
    "length": {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "µm": 1e-6, "um": 1e-6, "in": INCH},
    "speed": {"rpm": 1 / 60, "1/min": 1 / 60, "min-1": 1 / 60, "Hz": 1.0, "rad/s": 1 / (2 * pi)},
    "torque": {"Nm": 1.0, "N·m": 1.0, "N*m": 1.0, "kNm": 1e3, "lbf·ft": POUND_FOOT, "lbf*ft": POUND_FOOT},
    "power": {"kW": 1e3, "W": 1.0, "MW": 1e6, "hp": HORSEPOWER},
    "angle": {"deg": radians(1.0), "°": radians(1.0), "rad": 1.0},
    "rate": {"Hz": 1.0, "kHz": 1e3, "S/s": 1.0, "kS/s": 1e3},
}
WRITTEN = re.compile(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(\S.*?)?\s*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """One key of the answers file."""

    key: str
    text: str  # what is asked
    kind: str  # "text", "count", "number", "yes", "choice", "age", or a kind of UNITS
    example: str = ""
    default: str | None = None  # as a person would write it; None where there is none
    needed: bool = False  # whether there is no rig file without it
    choices: tuple[str, ...] = ()
    without: str = ""  # asked only where this key has no answer
    where: str = ""  # asked only where this key has an answer other than 0 and no
    hint: str = ""  # said in the reference


SIDES = ("pinion drive side", "pinion free side", "gear drive side", "gear free side")
DIRECTIONS = ("across", "along")
SIGNALS = ("pulses", "edge times", "quadrature")
MATERIALS = ("steel", "cast iron", "bronze")
LUBRICATION = ("oil", "grease", "dry")

QUESTIONS = (
    Question(key="asset", text="Name of the machine", kind="text", default="my-gearbox", example="pump-drive",
             hint="letters, digits, `_`, `-`, `.`; the name in every answer"),
    Question(key="pinion_teeth", text="Teeth of the pinion, the smaller gear", kind="count", example="19",
             needed=True),
    Question(key="gear_teeth", text="Teeth of the gear", kind="count", example="52", needed=True),
    Question(key="driver", text="Which of them is driven by the motor", kind="choice", default="pinion",
             choices=("pinion", "gear"), hint="`gear` for a pair that speeds up"),
    Question(key="speed", text="Nominal speed of the driving shaft", kind="speed", example="600 rpm", needed=True),
    Question(key="torque", text="Nominal torque on the driving shaft (Enter: I know the power)", kind="torque",
             example="10 Nm"),
    Question(key="power", text="Nominal power (Enter: not known)", kind="power", example="4 kW", without="torque"),
    Question(key="module", text="Module (Enter: I know another dimension)", kind="length", example="2 mm"),
    Question(key="centre_distance", text="Centre distance (Enter: not known)", kind="length", example="71 mm",
             without="module"),
    Question(key="outside_diameter", text="Outside diameter of the gear (Enter: not known)", kind="length",
             example="108 mm", without="module"),
    Question(key="face_width", text="Face width (Enter: not known)", kind="length", example="20 mm"),
    Question(key="pressure_angle", text="Pressure angle", kind="angle", default="20 deg", example="20 deg"),
    Question(key="helix_angle", text="Helix angle", kind="angle", default="0 deg", example="0 deg",
             hint="the model is of spur gears"),
    Question(key="profile_shift", text="Profile shift coefficient of the pinion", kind="number", default="0",
             example="0.3", hint="the model is of gears without profile shift"),
    Question(key="age", text="Age of the gears now: new, revolutions of the pinion, hours run, or unknown", kind="age",
             default="unknown", example="1200 h", hint="without it only what wears from here on can be known"),
    Question(key="material", text="Material of the gears", kind="choice", default="steel", choices=MATERIALS),
    Question(key="lubrication", text="Lubrication", kind="choice", default="oil", choices=LUBRICATION),
    Question(key="wear_limit", text="Wear depth of both flanks together that ends the life (Enter: 10 % of the tooth)",
             kind="length", example="0.3 mm"),
    Question(key="life_horizon_days", text="Days ahead that the end of life is looked for (Enter: 30)", kind="number",
             example="60"),
    Question(key="encoder_pinion", text="Pulses or lines a turn on the pinion's shaft (0: none, 1: tachometer)",
             kind="count", default="0", example="1024"),
    Question(key="encoder_gear", text="Pulses or lines a turn on the gear's shaft (0: none)", kind="count", default="0",
             example="2048"),
    Question(key="encoder_signal", text="How pulses are recorded", kind="choice", default="pulses", choices=SIGNALS,
             hint="`pulses`: a sampled voltage; `edge times`: a column of times; `quadrature`: two levels"),
    Question(key="encoder_pinion_column", text="Column of the pulses on the pinion's shaft (Enter: later)", kind="text",
             example="Tacho (V)", where="encoder_pinion"),
    Question(key="encoder_gear_column", text="Column of the pulses on the gear's shaft (Enter: later)", kind="text",
             example="Enc2 (V)", where="encoder_gear"),
    Question(key="torque_meter", text="Is there a torque meter on the driving shaft", kind="yes", default="no"),
    Question(key="torque_column", text="Column of the torque (Enter: later)", kind="text", example="Torque (Nm)",
             where="torque_meter"),
    Question(key="shaft_diameter_pinion", text="Diameter of the pinion's shaft next to it (Enter: not known)",
             kind="length", example="20 mm"),
    Question(key="shaft_diameter_gear", text="Diameter of the gear's shaft next to it (Enter: not known)",
             kind="length", example="20 mm"),
    Question(key="bearing_span", text="Distance between the bearings of a shaft (Enter: not known)", kind="length",
             example="155 mm"),
    Question(key="data_file", text="A data file of the machine (Enter: later)", kind="text", example="today.csv"),
    Question(key="sample_rate", text="Its sampling rate (Enter: not known)", kind="rate", example="25.6 kHz"),
)  # fmt: skip
OF_SENSOR = (
    Question(key="column", text="Name of its column in the data", kind="text", example="Acc1 (g)"),
    Question(key="unit", text="Unit of the column", kind="choice", default="m/s2", choices=("m/s2", "g", "V")),
    Question(key="sensitivity", text="Sensitivity in V per m/s²", kind="number", example="0.0102"),
    Question(key="place", text="Bearing that it sits at", kind="choice", default=SIDES[1], choices=SIDES,
             hint="drive side: towards motor or load; the first accelerometer is the reference"),
    Question(key="direction", text="Direction, against the line through both shafts' centres", kind="choice",
             default="across", choices=DIRECTIONS),
)  # fmt: skip


def quantity(where: str, given: object, kind: str, example: str) -> float:
    """A quantity in SI; InputError where the unit is missing or not one of its kind."""
    found = WRITTEN.fullmatch(given) if isinstance(given, str) else None
    if found is None or not found[2]:
        raise InputError(f"{where} = {given!r} needs a number with its unit, such as {example!r}")
    factor = UNITS[kind].get(found[2])
    if factor is None:
        raise InputError(f"{where} = {given!r}: {found[2]!r} is no unit of {kind}; known: {', '.join(UNITS[kind])}")
    try:
        return float(found[1].replace(",", ".")) * factor
    except ValueError:
        raise InputError(f"{where} = {given!r}: {found[1]!r} is not a number, as in {example!r}") from None
