"""How the twin is updated by a window, and when what it finds calls for attention."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING

from twin.attention import STATUS_LIMITS, StatusLimits
from twin.errors import ParameterError
from twin.required_evidence import DEFAULT, NullEvidence, RequiredEvidence

if TYPE_CHECKING:  # options are made by programs that compute nothing
    from twin.baseline.learned import Baseline
    from twin.levels.relation import Relation
    from twin.rig import Rig
    from twin.updating.history import UpdateOptions

UPDATES = ("fused", "rms")


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How the twin is updated and judged."""

    update: str = "fused"  # what sets the wear depth: the encoders ("fused") or the RMS ("rms")
    error_threshold: float = 0.05  # relative RMS error above which a window updates the twin (paper 4.2)
    update_until: float = inf  # pinion revolutions after which the twin only predicts
    trace: bool = True  # whether effects that the model lacks are sought and added
    false_alarm_rate: float = DEFAULT.rate  # campaigns of healthy machines in which an effect may be reported
    nulls: Mapping[str, NullEvidence] = field(default_factory=dict)  # of simulated healthy machines, by `Rig.digest`
    baseline: Baseline | None = None  # a healthy baseline, for machines without a model
    relation: Relation | None = None  # of level and wear depth, for machines without a model
    status_limits: StatusLimits = STATUS_LIMITS  # when a depth or a life calls for attention

    def __post_init__(self) -> None:
        if self.update not in UPDATES:
            raise ParameterError(f"update = {self.update!r} must be one of {', '.join(UPDATES)}")
        if not 0 < self.error_threshold < 1:
            raise ParameterError(f"error_threshold = {self.error_threshold} is outside (0, 1); percent?")
        RequiredEvidence(rate=self.false_alarm_rate)  # raises where it is no rate
        if not self.update_until >= 0:
            raise ParameterError(f"update_until = {self.update_until} revolutions must not be negative")

    def required(self, rig: Rig) -> RequiredEvidence:
        """The evidence that an effect of a machine must have before it is added."""
        nulls = self.nulls.get(rig.digest) if self.nulls else None
        if nulls is None:
            return RequiredEvidence(rate=self.false_alarm_rate)
        from twin.effects import EFFECTS

        sought = sum(1 for kind in EFFECTS.values() if kind.facts.detector)
        return nulls.required(self.false_alarm_rate, sought)

    def updating(self, rig: Rig) -> UpdateOptions:
        """The part of the options that the update of a machine's model reads."""
        from twin.updating.history import UpdateOptions

        return UpdateOptions(
            threshold=self.error_threshold,
            update=self.update,
            update_until=self.update_until,
            required=self.required(rig),
        )
