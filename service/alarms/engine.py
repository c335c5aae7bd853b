"""The engine: rules, what is remembered and what a window says → what is remembered then, and how alarms change.

    memory, changes = evaluate(rules, memory, readings, at)

A level holds once the quantity has been beyond its limit for the rule's number of windows in a row and its time, and
ends once it has been back by more than the hysteresis for as long. A window that does not come after the last one
evaluated changes nothing: windows are ordered by index, because the clock of a stream may be set back. No clock, no
store: the same arguments give the same answer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Literal

from service.alarms.learning import limits_at
from service.alarms.memory import LEVELS, AlarmLevel, KeyMemory, LevelMemory, Memory, key_of
from service.alarms.quantities import QUANTITIES
from service.alarms.readings import Reading, Readings
from service.alarms.rules import Rule
from service.contract.finding import SEVERITY, sentence

NS = 1_000_000_000
SWITCHED_OFF = "The rule was removed or switched off."
Verb = Literal["raised", "escalated", "lowered", "ended", "updated"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """When readings were taken."""

    time_ns: int  # Unix time: of the window's start, or of this machine [ns]
    window: int | None = None  # index; None where no window was evaluated
    learn: bool = True  # whether the window counts as healthy where limits are learned


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """How one alarm changes."""

    verb: Verb
    key: str
    rule: str
    quantity: str
    place: str
    level: AlarmLevel  # that holds now; of `ended`, that held before
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    reason: str = ""
    action: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A reading against a rule: the levels that it reaches, and those that it still holds by the hysteresis."""

    reached: AlarmLevel | None
    held: AlarmLevel | None
    limits: dict[AlarmLevel, float | None]
    origin: str = ""  # of the limits, for people


def evaluate(rules: Sequence[Rule], memory: Memory, readings: Readings, at: Moment) -> tuple[Memory, list[Change]]:
    """The memory afterwards, and the changes of alarms: first of those without a rule, then by the order of rules."""
    memory = deepcopy(memory)
    if at.window is not None:
        if memory.window is not None and at.window <= memory.window:
            return memory, []
        memory.window = at.window
    changes = list(_without_rule(rules, memory, readings))
    for rule in rules:
        if not rule.enabled or (rule.without_depth and readings.depth_known):
            continue
        for reading in _of_rule(rule, memory, readings):
            own = memory.of(rule.name, reading.quantity, reading.place)
            judged = _judged(rule, own, reading, at)
            if judged is not None:
                changes += _step(rule, own, reading, judged, at)
    return memory, changes


def learn_anew(rules: Sequence[Rule], memory: Memory, sensor: str, reason: str) -> tuple[Memory, list[Change]]:
    """The memory once limits are to be learned anew, and the ends of the alarms that were raised by learned limits.

    sensor  of which they are; all for an empty name
    """
    memory = deepcopy(memory)
    learned = {rule.name for rule in rules if rule.limits_from == "learned"}
    changes: list[Change] = []
    for key, own in memory.keys.items():
        if sensor and own.place.partition("/")[0] != sensor:
            continue
        own.learned = []
        if own.rule in learned:
            changes += _ended(key, own, reason)
            memory.forget_level(key)
    return memory, changes


def _of_rule(rule: Rule, memory: Memory, readings: Readings) -> Iterator[Reading]:
    """The readings that a rule looks at; a finding that is no longer there reads as normal."""
    numeric = rule.limits_from != "criterion"
    seen = set()
    for reading in readings.readings:
        if rule.covers(reading.quantity, reading.place) and (reading.value is not None) == numeric:
            seen.add(reading.place)
            yield reading
    if not numeric and rule.quantity in readings.judged:
        for known in list(memory.keys.values()):
            if known.rule == rule.name and known.quantity == rule.quantity and known.place not in seen:
                yield Reading(quantity=rule.quantity, place=known.place, level="normal")


def _judged(rule: Rule, own: KeyMemory, reading: Reading, at: Moment) -> Judged | None:
    """The levels that a reading reaches; None where its limits are not known yet."""
    if reading.value is None:
        level = _alarm_level(reading.level or "normal")
        return Judged(reached=level, held=level, limits={})
    if rule.limits_from == "fixed":
        limits: dict[AlarmLevel, float | None] = {"watch": rule.watch, "alarm": rule.alarm}
        origin = "set by its rule"
    else:
        found = limits_at(own, reading, rule.learn_windows, learn=at.learn and own.level is None)
        if found is None:
            return None
        limits = {"watch": found.watch, "alarm": found.alarm}
        origin = f"learned from the first {found.windows} windows under this operating condition, taken as healthy"
        if not rule.is_above:  # mirrored: as far below the median as the limit lies above it
            limits = {name: found.median**2 / limit for name, limit in limits.items() if limit}
    reached, held = (_beyond(rule, reading.value, limits, share) for share in (0.0, rule.hysteresis))
    if reading.preliminary and not reading.supported:
        reached, held = ("watch" if level == "alarm" else level for level in (reached, held))
    return Judged(reached=reached, held=held, limits=limits, origin=origin)


def _beyond(rule: Rule, value: float, limits: dict[AlarmLevel, float | None], eased: float) -> AlarmLevel | None:
    """The highest level whose limit is reached; eased: the share of it by which the limit is moved to the good side."""
    found: AlarmLevel | None = None
    for name in LEVELS:
        limit = limits.get(name)
        if limit is None:
            continue
        margin = eased * abs(limit)
        if (value >= limit - margin) if rule.is_above else (value <= limit + margin):
            found = name
    return found


def _alarm_level(level: str) -> AlarmLevel | None:
    """A level of the status as that of an alarm."""
    rank = SEVERITY.index(level)  # type: ignore[arg-type]
    if rank >= SEVERITY.index("alarm"):
        return "alarm"
    return "watch" if level == "watch" else None


def _step(rule: Rule, own: KeyMemory, reading: Reading, judged: Judged, at: Moment) -> Iterator[Change]:
    before = own.level
    for name in LEVELS:
        _count(own.levels[name], _at_least(judged.reached, name), _at_least(judged.held, name), rule, at.time_ns)
    if own.levels["alarm"].on:
        own.levels["watch"].on = True
    after = own.level
    if after is None and before is None:
        return
    if before == after and not _at_least(judged.reached, after or "alarm"):
        return  # held by the hysteresis or the duration alone: the figures of before stay
    level = after or before
    assert level is not None
    passed = level if judged.limits.get(level) is not None else "alarm"  # one level of a preliminary figure's rule
    limit = judged.limits.get(passed)
    about = QUANTITIES[rule.quantity]
    yield Change(
        verb=_verb(before, after),
        key=key_of(rule.name, reading.place),
        rule=rule.name,
        quantity=reading.quantity,
        place=reading.place,
        level=level,
        value=reading.value,
        limit=limit,
        unit=about.unit,
        reason=reading.reason or _reason(rule, reading, limit, judged.origin, None if after is None else passed),
        action=reading.action or _action(rule, reading),
    )


def _verb(before: AlarmLevel | None, after: AlarmLevel | None) -> Verb:
    if before == after:
        return "updated"
    if before is None:
        return "raised"
    if after is None:
        return "ended"
    return "escalated" if after == "alarm" else "lowered"


def _count(level: LevelMemory, reached: bool, held: bool, rule: Rule, now_ns: int) -> None:
    """One more window for one level: its counters, and whether it holds."""
    if reached:
        level.up, level.up_ns = level.up + 1, _began(level.up_ns, now_ns)
    else:
        level.up, level.up_ns = 0, None
    if held:
        level.down, level.down_ns = 0, None
    else:
        level.down, level.down_ns = level.down + 1, _began(level.down_ns, now_ns)
    if level.on and level.down and _long_enough(level.down, level.down_ns, rule, now_ns):
        level.on = False
    elif not level.on and level.up and _long_enough(level.up, level.up_ns, rule, now_ns):
        level.on = True


def _began(since_ns: int | None, now_ns: int) -> int:
    """When a row of windows began: now for the first one, and again where the clock has been set back since."""
    return now_ns if since_ns is None else min(since_ns, now_ns)


def _long_enough(count: int, since_ns: int | None, rule: Rule, now_ns: int) -> bool:
    lasted = 0 if since_ns is None else now_ns - since_ns
    return count >= rule.windows and lasted >= rule.seconds * NS


def _at_least(level: AlarmLevel | None, name: AlarmLevel) -> bool:
    return level is not None and LEVELS.index(level) >= LEVELS.index(name)


def _reason(rule: Rule, reading: Reading, limit: float | None, origin: str, level: AlarmLevel | None) -> str:
    """One sentence with the figure and its limit."""
    about = QUANTITIES[rule.quantity]
    if reading.value is None:
        what = f"{about.label} ({reading.place})" if reading.place else about.label
        return f"{what}: back to normal."
    what = f"{about.label} of {reading.place}" if reading.place else about.label
    unit = f" {about.unit}" if about.unit else ""
    value = f"{what} is {reading.value:.4g}{unit}"
    if limit is None:
        return f"{value}."
    if level is None:
        return f"{value}, back from its limit of {limit:.4g}{unit}."
    more = "; the figure is preliminary" if reading.preliminary else ""
    return f"{value}, {rule.bad_side} the limit of {limit:.4g}{unit} for {level} ({origin}){more}."


def _action(rule: Rule, reading: Reading) -> str:
    template = QUANTITIES[rule.quantity].action
    return sentence(template.format(place=reading.place or "the machine")) if template else ""


def _without_rule(rules: Sequence[Rule], memory: Memory, readings: Readings) -> Iterator[Change]:
    """Ends alarms whose rule is not there any more, and forgets what was remembered for it."""
    live = {rule.name: rule for rule in rules if rule.enabled and not (rule.without_depth and readings.depth_known)}
    for key, own in list(memory.keys.items()):
        rule = live.get(own.rule)
        if rule is not None and rule.covers(own.quantity, own.place):
            continue
        yield from _ended(key, own, SWITCHED_OFF)
        known = any(r.name == own.rule and r.quantity == own.quantity for r in rules)
        if known:
            memory.forget_level(key)  # switched off, or not asked now: what was learned stays
        else:
            del memory.keys[key]


def _ended(key: str, own: KeyMemory, reason: str) -> Iterator[Change]:
    """The end of an alarm that is on, without a reading."""
    if own.level is not None:
        yield Change(
            verb="ended", key=key, rule=own.rule, quantity=own.quantity, place=own.place, level=own.level,
            unit=QUANTITIES[own.quantity].unit, reason=reason,
        )  # fmt: skip
