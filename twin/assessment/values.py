"""Values that every part of an assessment is made of."""

from __future__ import annotations

from dataclasses import dataclass

FLANKS = ("combined", "pinion", "gear")


@dataclass(frozen=True, slots=True, kw_only=True)
class Unavailable:
    """A quantity that cannot be given."""

    reason: str  # one sentence, for people


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """Median and 5–95 % interval."""

    median: float | None  # None where only a lower bound is known
    p05: float
    p95: float | None  # None where no upper bound is known

    def scaled(self, factor: float) -> Interval:
        """The interval of `factor` times the quantity."""
        median, p95 = (None if value is None else value * factor for value in (self.median, self.p95))
        return Interval(median=median, p05=self.p05 * factor, p95=p95)


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterValue:
    """One parameter of an effect."""

    value: float
    unit: str  # SI, "" for a pure number
    std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectralLine:
    """One line that is left."""

    order: float  # of pinion rotation
    frequency: float  # [Hz]
    share: float | None  # of the measured energy; None where it was not measured
    kind: str = ""  # what repeats it, where that is known
