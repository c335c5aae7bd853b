"""How much evidence an effect must have before it joins the twin, at a stated rate of false alarms.

    least = max(own threshold + ln(r₀/r), what healthy machines reach at the rate r)

r    campaigns of healthy machines in which any effect may be reported
r₀   the rate that the thresholds of the detectors are stated for

On a healthy machine a Bayes factor above B has a probability of 1/B at most, so that a rate a tenth as large asks for
ln 10 nat more. Where healthy machines of the very rig have been simulated (twin/detectability), what they reach counts
as well. For an effect that k of n simulated campaigns report, with u nat in the least of them, the rate of more is

    P(E > x) = (k/n)·exp(−(x − u)/β),      β = max(mean of E − u, 1 nat)

All effects together may be reported in a share r of the campaigns; each of m effects has r/m of it.

Source   I. J. Good, Probability and the Weighing of Evidence, 1950 (the bound 1/B is Turing's)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, log

from twin.errors import ParameterError
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedRate:
    """What the evidence thresholds of the detectors are stated for."""

    rate: float = deciding(
        0.01,
        meaning="campaigns of healthy machines in which an effect is reported",
        source="the default of the tracing: on 14 to 93 healthy or single-effect campaigns none was false at the "
        "default thresholds, which bounds the rate at some 3 %",
    )


STATED = StatedRate()


@dataclass(frozen=True, slots=True, kw_only=True)
class RequiredEvidence:
    """What an effect needs at a chosen rate of false alarms."""

    rate: float = STATED.rate  # of campaigns
    by_effect: Mapping[str, float] = field(default_factory=dict)  # that healthy machines of the rig reach [nat]

    def __post_init__(self) -> None:
        if not 0 < self.rate < 1:
            raise ParameterError(
                f"false_alarm_rate = {self.rate:g} must lie between 0 and 1: 0.01 is one campaign in 100"
            )

    def least(self, name: str, own: float) -> float:
        """Evidence that an effect needs [nat], of which its detector asks `own` at the stated rate."""
        return max(own + log(STATED.rate / self.rate), self.by_effect.get(name, -inf))

    def accepts(self, name: str, evidence: float) -> bool:
        """Whether an effect that its detector reports has as much as healthy machines of the rig ask for [nat]."""
        return evidence >= self.by_effect.get(name, -inf)


DEFAULT = RequiredEvidence()


@dataclass(frozen=True, slots=True, kw_only=True)
class NullTail:
    """The tail of the evidence that healthy machines give to what they do not have."""

    least_slope: float = deciding(
        1.0, unit="nat", meaning="mean excess of the tail", source="Turing's bound: a Bayes factor's tail is no longer"
    )


TAIL = NullTail()


@dataclass(frozen=True, slots=True, kw_only=True)
class NullEvidence:
    """Evidence of what simulated healthy machines of one rig do not have."""

    campaigns: int  # that were simulated
    found: Mapping[str, tuple[float, ...]]  # by effect: evidence in the campaigns that report it, falling [nat]

    def required(self, rate: float, effects: int, limits: NullTail = TAIL) -> RequiredEvidence:
        """The evidence that effects need, so that healthy machines show any of so many at this rate of campaigns."""
        least = {}
        for name, evidence in self.found.items():
            lowest = min(evidence)
            slope = max(sum(evidence) / len(evidence) - lowest, limits.least_slope)
            share = len(evidence) / self.campaigns
            least[name] = lowest + slope * max(log(share * effects / rate), 0.0)
        return RequiredEvidence(rate=rate, by_effect=least)
