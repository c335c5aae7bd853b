"""Impacts once a turn as named changes: the effects of the table that are local on that shaft.

Impacts of one shaft leave something on the lines of the others, so that the shaft with the largest deviation is named
alone. Sensors that have changed take no part. Where the measured lines are less of a pulse than the healthy ones, an
impact has gone, and no effect of the table does that.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from twin.assessment import ParameterValue
from twin.baseline.findings import BaselineComparison
from twin.baseline.learned import Baseline
from twin.baseline.named import Named, majority
from twin.baseline.repeats import IMPACTS
from twin.baseline.shaft_names import LOCAL_ALTERNATIVES, names_of, shaft_name
from twin.baseline.turn_impacts import DEFAULT, TurnImpact, TurnImpactThresholds, turn_impacts

Impacts = Sequence[TurnImpact]


def impacts_of(
    baseline: Baseline, compared: Sequence[BaselineComparison], known: Iterable[Named]
) -> list[tuple[TurnImpact, ...]]:
    """Impacts once a turn in every window, the largest deviation first.

    known  what sensors and lines have shown
    """
    if not all(c.same_teeth for c in compared):
        return [() for _ in compared]
    changed = {
        channel
        for effect in known
        if "shaft_order" not in effect.parameters and effect.name != "unknown_effect"
        for channel in effect.channels
    }
    return [turn_impacts(baseline, c.reading, c.expected, changed) for c in compared]


def impacts_named(
    baseline: Baseline,
    compared: Sequence[BaselineComparison],
    found: Sequence[Impacts],
    known: Iterable[Named],
    limits: TurnImpactThresholds = DEFAULT,
) -> list[Named]:
    """Impacts once a turn in most windows; none where lines have shown a local fault of that shaft."""
    least = limits.changed * baseline.repeats.factor(IMPACTS)
    at = {i: window[0] for i, window in enumerate(found) if window and window[0].deviation > least}
    if not majority(list(at), len(found)):
        return []
    first, one = max(at.items(), key=lambda item: item[1].deviation)
    local = [e.parameters["shaft_order"].value for e in known if {"shaft_order", "angle"} <= set(e.parameters)]
    if float(one.shaft) in local:
        return []
    where = shaft_name(one.shaft, baseline)
    names = names_of("local", where)
    named, others = (names[0], names[1:]) if names and one.rises else ("unknown_effect", () if one.rises else names)
    return [
        Named(
            name=named,
            channels=tuple(one.peak) or tuple(compared[first].expected.lines),
            parameters=_parameters(one),
            log_evidence=one.evidence - one.healthy,
            indistinguishable_from=(*others, *LOCAL_ALTERNATIVES),
            detail=f"an impact once a turn of the {where}, at one angle{'' if one.rises else ', has gone'}: "
            + _said(one, compared[first].reading.speed_hz),
            windows=tuple(at),
        )
    ]


def nearly_impacts(
    baseline: Baseline,
    compared: Sequence[BaselineComparison],
    found: Sequence[Impacts],
    limits: TurnImpactThresholds = DEFAULT,
) -> str:
    """That impacts once a turn are near what would be named; empty where none are."""
    changed = limits.changed * baseline.repeats.factor(IMPACTS)
    least = limits.suspected * changed
    near = {i: window[0] for i, window in enumerate(found) if window and window[0].deviation > least}
    if not majority(list(near), len(found)):
        return ""
    first, one = max(near.items(), key=lambda item: item[1].deviation)
    said, where = _said(one, compared[first].reading.speed_hz), shaft_name(one.shaft, baseline)
    return f"impacts once a turn of the {where}: {said}, where {changed:.3g} are a change"


def _parameters(one: TurnImpact) -> dict[str, ParameterValue]:
    """Order, place and size of impacts."""
    width = 1 / (float(one.orders[1] - one.orders[0]) / float(one.shaft))
    out = {
        "shaft_order": ParameterValue(value=float(one.shaft), unit="", std=0.0),
        "angle": ParameterValue(value=one.angle, unit="turn", std=width / 4),
        "deviation": ParameterValue(value=one.deviation, unit="", std=1.0),
    }
    if one.peak:
        peak, std = max(one.peak.values())
        out["peak"] = ParameterValue(value=peak, unit="m/s²", std=std)
    return out


def _said(one: TurnImpact, speed_hz: float) -> str:
    low, high = (order * speed_hz for order in one.orders)
    return (
        f"{one.evidence:.0f} nat for one pulse from {low:.0f} to {high:.0f} Hz, where healthy recordings have "
        f"{one.healthy:.0f} ({one.deviation:.1f} standard deviations)"
    )
