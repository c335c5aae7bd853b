"""The order in which effects that were found together join the twin: one in which no held-out error rises, if there is.

    rise(order) = Σ max(0, ln(e_after/e_before))      over the steps and over waveform and transmission error

Where two causes shape the same lines, the smaller one alone may make the twin worse, and be needed all the same once
the larger one is in. Errors of the twins with some of the effects are computed at the depths of the twin with all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations
from math import log

from twin.errors import TwinError
from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.confirmation import learned_factors, windows_to_compare
from twin.tracing.held_out_error import compare, errors_of
from twin.tracing.state import EffectErrors, Tracing


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderLimits:
    """When an order is looked for."""

    least_rise: float = deciding(
        0.005,
        of="error without the effect",
        meaning="rise of a held-out error from which effects found together are put into another order",
        source="not derived: chosen; smaller rises do not show in the figures that are stated",
    )
    most_effects: int = deciding(
        4, unit="effects", meaning="effects found together whose orders are compared", source="not derived: cost"
    )


ORDER_LIMITS = OrderLimits()
Errors = tuple[float | None, float | None]  # waveform and transmission error, relative


def falling_order(
    rig: Rig, tracing: Tracing, known: Collection[str], limits: OrderLimits = ORDER_LIMITS
) -> tuple[AttributedEffect, ...]:
    """The effects in the twin, those that are new in the order in which held-out errors rise least.

    known  names of the effects that were in the twin before: they keep their places, before the new ones
    """
    old = [f for f in tracing.found if f.name in known or not f.addition.effect.facts.synchronous]
    new = [f for f in tracing.found if f not in old]
    if not 1 < len(new) <= limits.most_effects or not _rises(tracing.errors, limits):
        return tracing.found
    errors: dict[frozenset[str], Errors] = {}

    def rise(order: Sequence[AttributedEffect]) -> float:
        steps = [frozenset(f.name for f in order[:count]) for count in range(len(order) + 1)]
        for names in steps:
            if names not in errors:
                errors[names] = _errors_with(rig, tracing, [*old, *(f for f in new if f.name in names)])
        return sum(_rise(errors[a], errors[b]) for a, b in pairwise(steps))

    best = min(permutations(new), key=rise)  # of equals the first, which is the order found
    rank = {f.name: i for i, f in enumerate(best)}
    places = iter(sorted(new, key=lambda f: rank[f.name]))
    return tuple(f if f in old else next(places) for f in tracing.found)


def _rises(errors: Sequence[EffectErrors], limits: OrderLimits) -> bool:
    return any(_rise(*both) > log(1 + limits.least_rise) for both in _pairs(errors))


def _pairs(errors: Sequence[EffectErrors]) -> Iterator[tuple[Errors, Errors]]:
    for one in errors:
        yield (
            (one.before.waveform, one.before.transmission_error),
            (one.after.waveform, one.after.transmission_error),
        )


def _rise(before: Errors, after: Errors) -> float:
    return sum(max(0.0, log(a / b)) for b, a in zip(before, after, strict=True) if a and b)


def _errors_with(rig: Rig, tracing: Tracing, effects: Sequence[AttributedEffect]) -> Errors:
    """Of the held-out windows that the twin with some of the effects can predict."""
    windows, indices = windows_to_compare(rig, tracing)
    learned, stage = learned_factors(tracing, indices), tracing.stages[-1]
    compared = []
    for window in windows:
        try:
            depth = stage.depths.get(window.index, stage.depth)
            compared.append(compare(rig, stage.memory, [f.addition for f in effects], learned, window, depth))
        except TwinError:
            continue
    errors = errors_of(compared)
    return errors.waveform, errors.transmission_error
