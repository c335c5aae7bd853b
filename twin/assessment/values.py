"""Values that every part of an assessment is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from twin.assessment.key import FILLED, PERCENT, Key

FLANKS = ("combined", "pinion", "gear")


@dataclass(frozen=True, slots=True, kw_only=True)
class Unavailable:
    """A quantity that cannot be given."""

    reason: str  # one sentence, for people


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """Median and 5–95 % interval."""

    median: Annotated[float | None, Key(meaning="null where only a lower bound is known")]
    p05: Annotated[float, Key(null=True)]
    p95: Annotated[float | None, Key(meaning="null where no upper bound is known")]

    def scaled(self, factor: float) -> Interval:
        """The interval of `factor` times the quantity."""
        median, p95 = (None if value is None else value * factor for value in (self.median, self.p95))
        return Interval(median=median, p05=self.p05 * factor, p95=p95)


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterValue:
    """One parameter of an effect."""

    value: Annotated[float, Key(null=True)]
    unit: str  # SI, "" for a pure number
    std: Annotated[float, Key(null=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectralLine:
    """One unexplained line."""

    order: Annotated[float, Key(meaning="of pinion rotation", null=True)]
    frequency: Annotated[float, Key("frequency_hz", null=True)]
    share: Annotated[float | None, Key("share_percent", PERCENT, "of the measured energy")]
    kind: Annotated[str, Key(meaning="what repeats it, where that is known", shown=FILLED)] = ""
