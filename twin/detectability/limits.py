"""The smallest size at which each effect is found on a rig, with its channels and at a stated rate of false alarms.

Machines that have one effect from the start are drawn and traced as healthy ones are (nulls.py). The size is raised or
lowered by a factor until it is found and not found, then the interval is halved on a logarithmic scale. The limit of a
rig is the largest of its machines' limits.

Limits   effects that the harmonic balance solves; with few machines, the limit is known within the factor stated
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isinf, sqrt
from typing import Any

from twin.detectability.nulls import one_campaign
from twin.detectability.windows import Campaign
from twin.effects import EFFECTS
from twin.effects.parameter import Parameter
from twin.effects.pitch_error import PitchError
from twin.effects.response import Effect
from twin.required_evidence import RequiredEvidence
from twin.rig import Rig

FACTOR = 4.0  # by which the size is raised or lowered
HALVINGS = 2  # of the interval, after that: it then is a factor of 4^(1/4)
FIRST = 1.0  # size that is tried first, in units of the prior spread
SEED = 5000  # of the first machine; those of the nulls are below

NOT_SIMULATED = {
    "bearing_defect": "its blows reach the accelerometer by a path that the rig file does not describe",
    "backlash_rattle": "teeth that separate have no steady state that the harmonic balance could solve",
    "unknown_effect": "it has no size of its own: its lines may be any",
}
FIXED: dict[str, dict[str, Any]] = {"tooth_crack": {"tooth": 3, "on": "pinion"}}


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionLimit:
    """One effect's smallest size that is found, in the unit of its first parameter."""

    name: str
    parameter: str
    unit: str
    value: float | None  # None where it is found at no size that was tried, or was not simulated
    factor: float  # within which the limit is known
    largest: float | None = None  # that was tried in vain
    note: str = ""


def size_of(kind: Any) -> Parameter:
    """The parameter that gives an effect its size: the first that is no mere shape."""
    return next(p for p in kind.parameters if not p.shape)


def made(name: str, size: float, teeth: tuple[int, int], seed: int) -> tuple[Effect, float]:
    """An effect of so many prior spreads, and the value of its first parameter, within the parameter's bounds."""
    kind: Any = EFFECTS[name]
    first = size_of(kind)
    if first.teeth is not None:
        std = min(size * first.prior, first.high / 4)  # of the tallest tooth of a hundred
        return PitchError.drawn(teeth, std, std, seed), std
    if isinf(first.neutral):  # the farther away, the less it does
        value = min(max(first.prior / size, first.low), first.high)
    else:
        value = min(first.neutral + size * first.prior, first.high)
    return kind(**{first.name: value, **FIXED.get(name, {})}), value


def simulated_effects() -> Iterator[str]:
    """The effects whose limits can be found by simulation."""
    return (name for name, kind in EFFECTS.items() if kind.facts.detector and name not in NOT_SIMULATED)


Found = Callable[[float], bool | None]  # whether a size is found; None where it cannot be simulated


def smallest_found(found: Found, start: float, largest: float, least: float) -> tuple[float | None, float]:
    """The smallest size that is found, and the largest that could be tried; sizes between a least and a largest one.

    A size that cannot be simulated is too large.
    """
    size, low, high, tried = start, 0.0, 0.0, 0.0
    while not (low and high):
        seen = found(size)
        tried = tried if seen is None else max(tried, size)
        if seen or seen is None:
            if seen is None and low:
                return (high or None), tried
            high = size if seen else 0.0
            if size / FACTOR < least:
                break
            size /= FACTOR
        else:
            low = size
            if not high and size * FACTOR > largest:
                break
            size *= FACTOR if not high else 1.0
    if not (low and high):
        return (high or None), tried
    for _ in range(HALVINGS):
        middle = sqrt(low * high)
        low, high = (low, middle) if found(middle) else (middle, high)
    return high, tried


def limit_of(
    rig: Rig, campaign: Campaign, name: str, machines: Sequence[int], required: RequiredEvidence
) -> DetectionLimit:
    """The limit of one effect over some machines, by their seeds; ParameterError where there is no such effect."""
    first = size_of(EFFECTS[name])
    factor = FACTOR ** (1 / 2**HALVINGS)
    known = {"name": name, "parameter": first.name, "unit": first.unit, "factor": factor}
    worst = 0.0
    start = FIRST
    for seed in machines:

        def found(size: float, seed: int = seed) -> bool | None:
            effect, _ = made(name, size, rig.teeth, seed)
            named = one_campaign(rig, campaign, SEED + seed, (effect,), required)
            return None if named is None else any(e.name == name for e in named)

        smallest, tried = smallest_found(found, start, largest=FACTOR**4, least=FACTOR**-3)
        if smallest is None:
            largest = made(name, tried, rig.teeth, seed)[1]
            return DetectionLimit(**known, value=None, largest=largest, note="not found up to this size")
        worst = max(worst, smallest)
        start = worst
    return DetectionLimit(**known, value=made(name, worst, rig.teeth, machines[0])[1])
