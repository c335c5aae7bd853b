"""What the healthy recordings of a baseline repeat, by leaving each out in turn: how far every limit must be raised.

    r_i       what recording i shows against a baseline of the others, over the limit from which it would be a change
    factor    1                                                  where no r_i exceeds 1
              r_max·exp(s·√6/π·max(ln 1/(α·(n + 1)), 0))         where some do
              ∞                                                  where more than half do: it is not compared

s   standard deviation of ln r_i: the largest of n values has an exponential tail (Gumbel), which is carried on from the
    1/(n + 1) of the largest to the false alarms α that are meant

The pattern of the teeth is compared where every recording left out shows it as a new one would have to.

Source   E. J. Gumbel, Statistics of Extremes (1958); leaving out and exchangeable recordings: V. Vovk, A. Gammerman,
         G. Shafer, Algorithmic Learning in a Random World (2005)
Holds    new recordings of the healthy machine that differ as those of the baseline do among themselves
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf

import numpy as np

from twin.thresholds import deciding

PATTERN = "tooth pattern"
LINES, PATHS, MISFIT, IMPACTS = "lines of shafts", "transfer path", "misfit of all lines", "impacts once a turn"
OFF_LINES, NOISE, SPACINGS, MODULATION = "measures off the lines", "white noise", "lines of no shaft", "modulation"
EXCHANGED, RAW = "names of channels", "raw RMS, kurtosis"
BY_PATTERN = (LINES, PATHS, MISFIT, IMPACTS, EXCHANGED, MODULATION)  # what goes with the pattern of the teeth
KINDS = (PATTERN, *BY_PATTERN, OFF_LINES, NOISE, SPACINGS)  # that share the false alarms of a comparison


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatThresholds:
    """False alarms that are meant, and when the healthy recordings repeat something."""

    false_alarms: float = deciding(
        0.01, of="healthy recordings", meaning="false alarms of a verdict, half by raw levels, half by all else",
        source="convention: one in a hundred",
    )  # fmt: skip
    most_beyond: float = deciding(
        0.5, of="recordings left out", meaning="share beyond a limit from which a measure is not compared",
        source="convention: half; a measure that is new in most healthy recordings tells nothing",
    )  # fmt: skip
    least_recordings: int = deciding(
        3, meaning="healthy recordings from which one is left out, and a raw limit is given", unit="recordings",
        source="derivation: with one left out two others still show a scatter",
    )  # fmt: skip
    most_folds: int = deciding(
        8, meaning="parts of the recordings that are left out in turn", unit="parts",
        source="not derived: 36 baselines are learned for it, some seconds",
    )  # fmt: skip

    @property
    def half(self) -> float:
        """False alarms of the raw limit, and of all else that is compared."""
        return self.false_alarms / 2


DEFAULT = RepeatThresholds()
LEAST = 0.1  # of a limit, below which a recording shows nothing

Key = tuple[str, str]  # kind of what is compared, and channel; "" for all channels together


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeats:
    """What leaving out has shown."""

    factors: Mapping[Key, float] = field(default_factory=dict)  # of limits; 1 where a key is missing
    pattern: tuple[float, ...] = ()  # correlation of every window left out with the others' tooth pattern
    unlike: str = ""  # the window whose pattern is least that of the others
    pattern_compared: bool = True
    left_out: int = 0  # recordings; 0: too few to leave one out
    false_alarms: int = 0  # of these, with limits that the others alone gave
    raw_false_alarms: int = 0  # the same of the limit on raw RMS and kurtosis

    def factor(self, kind: str, channel: str = "") -> float:
        """By how much a limit is raised; inf where the healthy recordings do not repeat what is compared."""
        if kind in BY_PATTERN and not self.pattern_compared:
            return inf
        return self.factors.get((kind, channel), 1.0)


NOTHING_LEFT_OUT = Repeats()


def share_of(measures: int, limits: RepeatThresholds = DEFAULT) -> float:
    """False alarms of one measure among so many of its kind; the raw measures have half of all for themselves."""
    return limits.half / (len(KINDS) * max(measures, 1))


def factors_of(scores: Sequence[Mapping[Key, float]], limits: RepeatThresholds = DEFAULT) -> dict[Key, float]:
    """Factor of every limit, from what every recording left out shows over it."""
    keys = {key for one in scores for key in one}
    of_kind = Counter(kind for kind, _ in keys)
    return {
        (kind, channel): factor_of(
            [one[kind, channel] for one in scores if (kind, channel) in one],
            limits.half if kind == RAW else share_of(of_kind[kind], limits),
            limits,
        )
        for kind, channel in sorted(keys)
    }


def factor_of(over: Sequence[float], false_alarms: float, limits: RepeatThresholds = DEFAULT) -> float:
    """Factor of one limit, from r of every recording left out, for false alarms of this limit."""
    r = np.maximum(np.array(over, dtype=float), LEAST)
    if r.max(initial=0.0) <= 1:
        return 1.0
    if np.mean(r > 1) > limits.most_beyond:
        return inf
    rarer = max(float(-np.log(false_alarms * (r.size + 1))), 0.0)
    return float(r.max() * np.exp(np.log(r).std(ddof=1) * np.sqrt(6) / np.pi * rarer))
