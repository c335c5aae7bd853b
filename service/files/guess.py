"""What the columns of a data file may be: time, acceleration, tachometer, torque, encoder levels, temperature.

A column is named by its header and its unit first, and by its values where these say nothing:

    time          rises evenly, and does not count the rows
    tachometer    two levels, between which it goes at regular intervals
    levels        0 and 1 only, a pair of them with a and b in their names: a quadrature encoder
    acceleration  alternates about its mean

Every guess says why, so that a person can check it; what has no channel is left out, with the reason.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from service.errors import InputError
from service.files.import_mapping import COUNTS, unwrapped
from service.files.import_rate import AGREEMENT, TIME_UNITS, TimeAxis, axis_of, counts_rows, is_time, time_axes
from service.files.readers import Column, Table
from service.files.readers.stored import beginning
from service.files.readers.table import split_unit
from service.files.units import ACCEL, OTHER_UNITS, TEMPERATURE, TORQUE, UNIT_NAMES, UNITS
from service.stream.channels import SHAFTS
from twin.errors import WindowError
from twin.features.pulses import Pulses, PulseSettings, pulses_of

TACHO = "tachometer"
TIME, LEFT_OUT = "time", "left out"
NO_CHANNEL = (
    (re.compile(r"speed|rpm|drehzahl|velocity|geschw|vitesse|^n$", re.I), OTHER_UNITS["rpm"]),
    (
        re.compile(r"\bload|last\b|lastfall|power|leistung|current|strom|voltage|spannung", re.I),
        'a load is a slow channel: kind = "load" in the mapping',
    ),
    (
        re.compile(r"class|label|\bfault|state|status|\bflag|klasse|target|condition|\bid\b|severity|zustand", re.I),
        "a class or a state has no channel",
    ),
    (re.compile(r"clock|count|index|zähler|\bno\b|\bnr\b|sample|row", re.I), "a count has no channel"),
    (re.compile(r"pressure|druck|humid|flow|level|position|angle|winkel|displace", re.I), "it has no channel"),
)  # names of quantities that no channel carries, and why a column of such a name is none
NAMES = (
    (
        TACHO,
        re.compile(
            r"tach|keyphas|\bkp\b|trig|puls|once|per.?rev|\bttl\b|lichtschranke|drehzahl|zündung|rpm|speed", re.I
        ),
    ),
    (TORQUE, re.compile(r"torque|drehmoment|moment|couple|\btq\b|\btrq\b|\bmd\b", re.I)),
    (TEMPERATURE, re.compile(r"temp|\boil\b|öl|thermo", re.I)),
    (ACCEL, re.compile(r"acc|beschl|vib|^a\d*$|^a[_ ]?[xyz]\d*$|^[xyz]$|^ch\d+$|imepe|icp|housing|_DE_|_FE_", re.I)),
)
OF_GEAR = {"gear", "wheel", "out", "output", "abtrieb", "slow", "brake", "driven", "rad", "lss"}
OF_PINION = {"pinion", "ritzel", "in", "input", "motor", "antrieb", "fast", "drive", "driving", "hss"}
LEVELS_AB = re.compile(r"^(?P<stem>.*?)[ _.-]?(?P<level>[abAB])$")
SELDOM, CLASSES = 0.05, 20  # share of samples at which a class changes, and how many classes there may be
RAW_UNITS = {"v", "mv", "µv", "count", "counts", "-", ""}  # that say nothing of the quantity
COUNTED = 0.9  # share of the steps of a counter that go one way
TWO_LEVELS = 0.9  # share of the values of a tachometer that lie near one of its levels
SAID_UNCERTAINTY = 1e-5  # relative, of a rate, from which it is said
SPEEDS = (0.05, 2000.0)  # turns/s of a shaft


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """What one column, or the two of a quadrature encoder, may be."""

    columns: tuple[str, ...]
    kind: str  # time, a kind of a mapping, or "left out"
    why: str
    name: str = ""  # of the channel
    unit: str = ""
    scale: float = 1.0
    falling: bool = False  # of a tachometer: its pulses go down
    speed: float | None = None  # of a tachometer [pulses/s]
    remark: str = ""  # what a person should add

    @property
    def becomes(self) -> str:
        """The channel's label; what it is where it becomes none."""
        return f"{self.kind}/{self.name}" if self.name else self.kind


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """All guesses about a file, with its rate."""

    guesses: tuple[Guess, ...]
    rate: float | None  # [Hz]; None where the channels have rates of their own, or none is known
    rate_from: str
    duration: float | None  # [s]
    axes: tuple[TimeAxis, ...]


@np.errstate(all="ignore")  # of values that are none: what is wrong with them is said
def proposal_of(table: Table, file: str, rate: float | None = None, shaft: str | None = None) -> Proposal:
    """What the columns of a file may be; InputError where no rate is known or two statements of it contradict.

    rate   sample rate that a person states [Hz]
    shaft  that the tachometer is on; found by its name, else the pinion, where None
    """
    axes = _axes(table, file)
    used = {axis.name: axis for axis in axes}
    longest = max(c.values.size for c in table.columns)
    guesses: list[Guess] = []
    taken: set[str] = set()
    pairs = _level_pairs([c for c in table.columns if c.name not in used])
    paired = {name for pair in pairs for name in pair}
    rates: dict[str, float | None] = {}
    for column in table.columns:
        if column.name in used:
            missing = used[column.name].missing
            gaps = f", {missing} samples missing" if missing else ""
            guesses.append(Guess(columns=(column.name,), kind=TIME, why=f"rises evenly{gaps}"))
            continue
        rates[column.name] = _rate_of(column, table, axes, rate)
        if column.name not in paired:
            guesses.append(_guess(column, rates[column.name], longest))
    guesses += [_levels(pair) for pair in pairs]
    named = [_named(g, taken, shaft) for g in _surest_first(guesses)]
    order = {name: i for i, name in enumerate(c.name for c in table.columns)}
    named.sort(key=lambda g: order[g.columns[0]])
    named += [Guess(columns=(name,), kind=LEFT_OUT, why=why) for name, why in table.left_out.items()]
    same = set(rates.values())
    single = next(iter(same)) if len(same) == 1 else None
    length = longest / single if single else None
    return Proposal(
        guesses=tuple(named), rate=single, rate_from=_rate_from(table, axes, rate, same), duration=length, axes=axes
    )


def _axes(table: Table, file: str) -> tuple[TimeAxis, ...]:
    """The time columns: by name and type, else the first column that rises evenly, of a file that states no rate."""
    axes = time_axes("the file", table, file, None, set())
    first = table.columns[0]
    if axes or len(table.columns) < 2 or table.rate or first.rate or first.times is not None or counts_rows(first):
        return tuple(axes)
    steps = np.diff(beginning(first.values).astype(float))
    if not np.all(steps > 0) or is_time(first) or split_unit(first.name)[1].lower() not in TIME_UNITS:
        return ()
    try:
        return tuple(time_axes("the file", table, file, first.name, set()))
    except InputError:
        return ()


def _rate_of(column: Column, table: Table, axes: Sequence[TimeAxis], rate: float | None) -> float | None:
    if column.rate is not None:
        return column.rate
    if column.times is not None and column.times.size > 1:
        return float((column.times.size - 1) / (column.times[-1] - column.times[0]))
    axis = axis_of(axes, column)
    return table.rate or rate or (axis.rate if axis else None)


def _rate_from(table: Table, axes: Sequence[TimeAxis], rate: float | None, rates: set[float | None]) -> str:
    others = rates | {axis.rate for axis in axes}
    if rate is not None and (wrong := [r for r in others if r is not None and abs(r / rate - 1) > AGREEMENT]):
        return f"the file gives {', '.join(f'{r:.9g}' for r in sorted(wrong))} Hz, which contradicts --rate {rate:.9g}"
    if any(c.rate is not None or c.times is not None for c in table.columns):
        return "stated by the file" if len(rates) == 1 else "stated by the file, different by channel"
    times = ", ".join(repr(axis.name) for axis in axes)
    if rate is not None:
        return f"as given, and by the times of {times}" if times else "as given"
    if not times:
        return "stated in the file" if table.rate else "not known"
    doubt = max(axis.uncertainty for axis in axes)
    less_sure = f", ± {100 * doubt:.1g} %" if doubt > SAID_UNCERTAINTY else ""
    return f"from the times of {times}{less_sure}" + (", as stated above the numbers" if table.rate else "")


def _level_pairs(columns: Sequence[Column]) -> list[tuple[str, str]]:
    """Columns of 0 and 1 whose names differ in a and b."""
    stems: dict[str, dict[str, str]] = {}
    for column in columns:
        found = LEVELS_AB.match(split_unit(column.name)[0])
        if found and np.isin(np.unique(column.values[:100000]), (0, 1)).all():
            stems.setdefault(found["stem"], {})[found["level"].lower()] = column.name
    return [(pair["a"], pair["b"]) for pair in stems.values() if len(pair) == 2]


def _levels(pair: tuple[str, str]) -> Guess:
    return Guess(
        columns=pair, kind="encoder", unit="quadrature", why="two levels, 0 and 1",
        remark="edges_per_rev is not in the file: give the fourfold counts a turn",
    )  # fmt: skip


def _guess(column: Column, rate: float | None, longest: int) -> Guess:
    """One column, by unit, name and values."""
    name, unit = split_unit(column.name)
    unit = (column.unit or unit).strip()
    values = beginning(column.values).astype(float)
    good = values[np.isfinite(values)]
    base = Guess(columns=(column.name,), kind=LEFT_OUT, why="")
    if good.size < values.size / 2 or good.size < 2:
        return replace(base, why=f"{values.size - good.size} of {values.size} values are empty")
    if np.ptp(good) == 0:
        return replace(base, why=f"constant, {good[0]:g}")
    if counts_rows(column):
        return replace(base, why="counts the rows: no time; give the sample rate (--rate)")
    known = UNITS.get(unit.lower())
    if (known is None or known[0] != TEMPERATURE) and _one_way(good) >= (COUNTED if _are_counts(good, unit) else 1.0):
        return _rising(base, good, column.values.size < longest)
    if unit.lower() in OTHER_UNITS or (known is None and unit.lower() in UNIT_NAMES - RAW_UNITS):
        return replace(base, why=OTHER_UNITS.get(unit.lower(), f"a quantity in {unit} has no channel"))
    kind = known[0] if known else next((k for k, pattern in NAMES if pattern.search(name)), "")
    pulses = _pulses(good, rate) if kind in ("", TACHO) else None
    if pulses is not None and (kind == TACHO or _two_levels(good, pulses)):
        how = "named so, " if kind == TACHO else ""
        return replace(
            base, kind=TACHO, unit=unit, falling=pulses.high < pulses.low, speed=pulses.speed,
            why=f"{how}{pulses.times.size} regular pulses, {pulses.speed:.5g} a second",
        )  # fmt: skip
    named_otherwise = "" if known else next((why for pattern, why in NO_CHANNEL if pattern.search(name)), "")
    if named_otherwise and kind in ("", TACHO):
        return replace(base, why=named_otherwise)
    if kind == TACHO:
        return replace(base, why="named like a tachometer, but no regular pulses stand out")
    if not kind and _are_classes(good):
        return replace(base, why=f"{np.unique(good).size} whole numbers that seldom change: a class or a state")
    if known:
        remark = "a sound pressure is checked and left out" if known[1] == "Pa" else ""
        return replace(base, kind=known[0], unit=known[1], scale=known[2], why=f"unit {unit}", remark=remark)
    return _without_unit(base, kind or ACCEL, unit, bool(kind))


def _without_unit(base: Guess, kind: str, unit: str, named: bool) -> Guess:
    """A column whose unit says nothing of its quantity."""
    if kind == TEMPERATURE:
        return replace(base, kind=kind, unit="degC", why="named so", remark="unit assumed")
    why = "named so" if named else "alternates about its mean"
    volts = unit.lower() in ("v", "mv")
    per = "N·m" if kind == TORQUE else "m/s²"
    remark = f'in {unit}: with unit = "V" and the sensitivity it becomes {per}' if volts else "the file states no unit"
    return replace(base, kind=kind, unit="unknown", why=why, remark=remark)


def _are_classes(good: np.ndarray) -> bool:
    """Whether values are few whole numbers that stay the same from sample to sample."""
    return bool(
        np.all(good == np.rint(good)) and np.mean(np.diff(good) != 0) < SELDOM and np.unique(good).size <= CLASSES
    )


def _one_way(good: np.ndarray) -> float:
    """The share of the steps other than 0 that go the way that most go."""
    going = np.sign(np.diff(unwrapped(good)))
    return float(max(np.mean(going[going != 0] > 0), np.mean(going[going != 0] < 0)))


def _are_counts(good: np.ndarray, unit: str) -> bool:
    """Whether values may be a sampled counter's, which may go back a little, or to 0 at each turn."""
    return unit.lower() in RAW_UNITS and bool(np.all(good == np.rint(good))) and np.unique(good).size > CLASSES


def _rising(base: Guess, values: np.ndarray, shorter: bool) -> Guess:
    """A column that goes one way: times of edges where it is shorter than the signals, else a counter or a time."""
    if shorter and np.all(np.diff(values) > 0):
        return replace(
            base, kind="encoder", unit="s", why="rises, and is shorter than the signals: times of edges",
            remark="edges_per_rev is not in the file: give the edges a turn",
        )  # fmt: skip
    if _are_counts(values, ""):
        return replace(
            base, kind="encoder", unit=COUNTS, why="whole numbers that go one way: a counter that is sampled",
            remark="edges_per_rev is not in the file: give the counts a turn (--pulses-per-rev)",
        )  # fmt: skip
    return replace(base, why="goes one way: a counter or another time")


def _pulses(values: np.ndarray, rate: float | None) -> Pulses | None:
    """The pulses of a column, whichever way they go; None where there are none."""
    if rate is None:
        return None
    middle = 0.5 * (values.min() + values.max())
    falling = bool(np.median(values) > middle)  # pulses are shorter than the pauses between them
    try:
        found = pulses_of(values, rate, PulseSettings(falling=falling))
    except WindowError:
        return None
    return replace(found, low=found.high, high=found.low) if falling else found


def _two_levels(values: np.ndarray, pulses: Pulses) -> bool:
    """Whether the values lie near one of two levels, as those of a tachometer do and those of a vibration do not."""
    near = 0.2 * abs(pulses.high - pulses.low)
    share = np.mean((np.abs(values - pulses.low) < near) | (np.abs(values - pulses.high) < near))
    return bool(share > TWO_LEVELS and SPEEDS[0] < pulses.speed and pulses.missed + pulses.doubled <= 2)


def _surest_first(guesses: Sequence[Guess]) -> list[Guess]:
    """Those that say which shaft they are on, then tachometers, of which the faster is the pinion's."""
    return sorted(guesses, key=lambda g: (not _shaft(split_unit(g.columns[0])[0]), -(g.speed or 0.0)))


def _named(guess: Guess, taken: set[str], shaft: str | None) -> Guess:
    """The guess with a name for its channel, which no other has."""
    if guess.kind in (TIME, LEFT_OUT):
        return guess
    label = split_unit(guess.columns[0])[0]
    if guess.kind in (TACHO, TORQUE, "encoder"):
        group = "encoder" if guess.kind == TACHO else guess.kind
        said = _shaft(label)
        wanted = shaft if guess.kind == TACHO and shaft else said or "pinion"
        free = [s for s in (wanted, *SHAFTS) if f"{group}/{s}" not in taken]
        if not free:
            return replace(guess, kind=LEFT_OUT, why="both shafts have such a channel already", remark="")
        taken.add(f"{group}/{free[0]}")
        sure = free[0] in (shaft, said)
        remark = "; ".join(t for t in (guess.remark, "" if sure else f"assumed to be on the {free[0]}") if t)
        return replace(guess, name=free[0], remark=remark)
    base = plain_name(label)
    name, number = base, 2
    while f"{guess.kind}/{name}" in taken:
        name, number = f"{base}-{number}", number + 1
    taken.add(f"{guess.kind}/{name}")
    return replace(guess, name=name)


def _shaft(label: str) -> str:
    """The shaft that a name says as a word of it; empty where it says none, or both."""
    said = {word.lower() for word in re.findall(r"[A-Z]?[a-zäöüß]+|[A-Z]+(?![a-z])", label)}
    gear, pinion = bool(said & OF_GEAR), bool(said & OF_PINION)
    return "" if gear == pinion else "gear" if gear else "pinion"


def plain_name(text: str) -> str:
    """A text as the name of an asset or a sensor: letters, digits, `_`, `-`, `.`, at most 64."""
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", ascii_text).strip("_.")[:64] or "channel"
