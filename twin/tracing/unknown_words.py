"""The unknown in plain sentences: at which frequency, where it enters, how it moves, since when."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from twin.features.shaft_orders import fraction_of_mesh
from twin.tracing.findings import IMPACTS, AccelerometerFault
from twin.tracing.mean_step import MeanStep
from twin.tracing.shaft_remainder import ShaftLine
from twin.tracing.unknown_entry import Entry, Law
from twin.tracing.unknown_lines import FollowedLine, Modulation

CHANNEL_NAMES = {"acceleration": "acceleration", "encoder": "transmission error", "torque": "torque"}
KIND_NAMES = {
    "mesh": "as a displacement in the mesh",
    "bearing": "as a force at a bearing",
    "shaft": "as a torque of the drive or the load",
    "acceleration": "in the acceleration's own channel (sensor, cable, or a path that is not in the model)",
    "encoder": "in the encoders' own channel",
    "torque": "in the torque meter's own channel",
}
PLACE_NAMES = {
    "x4": "bearing 4, x",
    "y4": "bearing 4, y",
    "x6": "bearing 6, x",
    "y6": "bearing 6, y",
    "x9": "bearing 9, x",
    "y9": "bearing 9, y",
    "x11": "bearing 11, x",
    "y11": "bearing 11, y",
    "th1": "the motor",
    "th13": "the brake",
}
LAW_NAMES = {
    "constant": "its level stays the same",
    "torque": "its level grows in proportion to the torque",
    "speed": "its level grows with the square of the speed",
}
NTH = {"2": "second", "3": "third"}
OF_MESH = 0.02  # orders beside a half or third of the mesh order that are one
OTHER_PATH = (
    "the acceleration over the transmission error is that of another structure than the rig file's, at each mesh line "
    "by another factor, beyond its tolerances: the path from the mesh to the accelerometer (a bearing or its seat, the "
    "housing, the sensor's mount) is not the one in the model"
)
SMALL = {"m": (1e6, "µm"), "N": (1.0, "N"), "N·m": (1.0, "N·m"), "m/s²": (1.0, "m/s²")}


def of_lines(
    lines: Sequence[FollowedLine], entry: Entry, law: Law, unit: str, onset: float, teeth: int | None = None
) -> str:
    """Lines of one cause in one or two sentences.

    teeth  of the pinion, where they are known
    """
    first = lines[0]
    factor, shown = SMALL[unit]
    size = f"{factor * law.levels[0]:.3g} ± {factor * law.stds[0]:.1g} {shown}"
    return (
        f"{_what(lines, teeth)}, of unknown cause; {_where(entry, first)}, with {size} at "
        f"{_at(first)}; {_how(law)}; {_since(onset)}"
    )


def _at(line: FollowedLine) -> str:
    return f"order {line.order[0]:.3f}" if line.follows == "angle" else f"{line.frequency[0]:.2f} Hz"


def _what(lines: Sequence[FollowedLine], teeth: int | None) -> str:
    first, more = lines[0], ", ".join(_at(line) for line in lines[1:])
    if first.follows == "angle":
        fraction = "" if teeth is None else fraction_of_mesh(first.order[0], teeth, OF_MESH)
        whose = f"{fraction} of the mesh order, as of every {NTH[fraction[-1]]} tooth" if fraction else ""
        text = f"a line at order {first.order[0]:.3f} of the pinion, {whose or 'which belongs to no shaft'}"
    elif first.follows == "clock":
        text = f"a tone of {first.frequency[0]:.2f} Hz that does not follow the speed"
    else:
        text = (
            f"a tone near {first.frequency[0]:.1f} Hz that wanders by {100 * first.spread:.1f} % from window to "
            "window and follows neither speed nor clock"
        )
    return f"{text}, together with {more}" if more else text


def _where(entry: Entry, line: FollowedLine) -> str:
    if not entry.compared:
        return f"it is seen in the {CHANNEL_NAMES[line.channel]}, and no other channel tells where it enters"
    text = f"it enters {KIND_NAMES[entry.kind]}"
    if entry.place in PLACE_NAMES:
        text += f" (best: {PLACE_NAMES[entry.place]})"
    if entry.kind in CHANNEL_NAMES:
        others = " and ".join(f"the {CHANNEL_NAMES[c]}" for c in entry.compared)
        text += f", because {others} would show it otherwise"
    if entry.alike:
        text += "; as well possible: " + ", or ".join(KIND_NAMES[kind] for kind in entry.alike)
    return text


def _how(law: Law) -> str:
    text = f"{LAW_NAMES.get(law.name, of_growth('level', law.growth))} to within {100 * max(law.scatter, 0.005):.1f} %"
    if law.alike:
        others = {"constant": "stays the same", "torque": "follows the torque", "speed": "follows the speed"}
        others["growth"] = "changes steadily"
        listed = " or ".join(others[name] for name in law.alike)
        text += f" (the windows differ too little to exclude that it {listed})"
    return text


def _since(onset: float) -> str:
    return f"since {onset:,.0f} revolutions" if onset > 0 else "from the first window on"


def of_modulation(found: Modulation, steady_encoder: bool, onset: float) -> str:
    """A modulation of all mesh lines in a sentence."""
    rate = f"{found.frequency:.2f} Hz" if found.follows == "clock" else f"order {found.order:.3f} of the pinion"
    where = (
        "the encoders show none of it, so the path to the accelerometer or the sensor itself changes"
        if steady_encoder
        else "no other channel tells whether the machine or its sensor changes"
    )
    return (
        f"the level of all mesh lines rises and falls by {100 * found.depth:.0f} % at {rate}, of unknown cause; "
        f"{where}; {_since(onset)}"
    )


def of_fault(fault: AccelerometerFault) -> str:
    """A wrong polarity or a delay of the accelerometer in a sentence."""
    parts = []
    if fault.polarity < 0:
        parts.append(
            "the accelerometer's polarity is wrong: all its lines are turned by half a period against the model"
        )
    if fault.delay or fault.rate:
        text = f"the accelerometer's samples are {1e3 * abs(fault.delay):.3g} ms "
        text += "later" if fault.delay > 0 else "earlier"
        text += " than its clock says against the encoders (a time shift between the channels: the phases of its lines "
        text += "grow with frequency)"
        if fault.rate:
            text += f", drifting by {3.6e6 * fault.rate:+.3g} ms an hour"
        parts.append(text)
    return f"{' and '.join(parts)}; {_since(fault.onset)}"


def of_noise(kind: str, level: float, detail: str, onset: float, struck: str | None = None) -> str:
    """Impacts or a rub in a sentence.

    struck  the shaft that impacts repeat with, as in `NonGearContent`
    """
    what = {
        "impacts": IMPACTS[struck],
        "pinion": "broadband noise modulated by every turn of the pinion, as where something rubs",
        "gear": "broadband noise modulated by every turn of the gear, as where something rubs",
    }[kind]
    return f"{what}{detail}; {level:.3g} m/s² RMS between the lines; {_since(onset)}"


def of_light_noise(shaft: str, depth: float, onset: float) -> str:
    """Noise that a shaft's turn modulates, less deeply than a rub that is an effect, in a sentence."""
    return (
        f"the noise between the lines rises and falls by {100 * depth:.0f} % with every turn of the {shaft}, as where "
        f"something rubs lightly; {_since(onset)}"
    )


def of_growth(what: str, rate: float) -> str:
    """How a level or size changes, from its relative rate [1/revolution], as a clause."""
    growth = 1e5 * abs(rate)
    said = f"{growth:.0f}" if growth >= 10 else f"{growth:.2g}"
    return f"its {what} {'grows' if rate > 0 else 'falls'} by {said} % in 1000 revolutions"


def of_mean_step(step: MeanStep) -> str:
    """A step of the mean transmission error in a sentence."""
    return (
        f"the mean of the transmission error has stepped by {1e6 * step.size:+.1f} ± {1e6 * step.std:.1g} µm between "
        f"{step.before:,.0f} and {step.after:,.0f} revolutions, beyond what wear and torque make of it: a shaft has "
        "shifted in a bearing or its seat, or an encoder's disc on its shaft"
    )


def of_shaft(lines: Sequence[ShaftLine], entry: Entry, law: Law, first: FollowedLine, onset: float) -> str:
    """Lines of a force at orders of the pinion in a sentence, with what is known to make them."""
    orders = sorted({line.order for line in lines})
    listed = f"order {orders[0]}" if len(orders) == 1 else f"orders {', '.join(map(str, orders[:-1]))} and {orders[-1]}"
    sizes = []
    for channel, unit in (("acceleration", "m/s²"), ("torque", "N·m")):
        own = [line for line in lines if line.channel == channel]
        if own:
            top = max(own, key=lambda line: line.level)
            sizes.append(f"{top.level:.2g} {unit} at order {top.order} in the {channel}")
    return (
        f"lines at {listed} of the pinion's shaft that no displacement of the teeth makes: "
        f"a force that turns with the shaft{known_makers({line.channel for line in lines}, len(orders))}, with "
        f"{' and '.join(sizes)}; {_where(entry, first)}; {_how(law)}; {_since(onset)}"
    )


def known_makers(channels: Collection[str], orders: int) -> str:
    """What is known to make lines at whole orders of a shaft, by the channels that show them."""
    if "torque" in channels:
        return ", as that of a misaligned coupling, of a part that rubs over some of the turn, or of the drive"
    if orders > 1:
        return ", as that of a foot or a seat that is loose, or of a bent shaft: the torque shows none of it"
    return ""
