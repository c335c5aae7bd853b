"""How the twin is updated by a window, and when what it finds calls for attention."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from twin.attention import STATUS_LIMITS, StatusLimits
from twin.errors import ParameterError

if TYPE_CHECKING:  # options are made by programs that compute nothing
    from twin.baseline.learned import Baseline
    from twin.levels.relation import Relation
    from twin.updating.history import UpdateOptions

UPDATES = ("fused", "rms")


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How the twin is updated and judged."""

    update: str = "fused"  # what sets the wear depth: the encoders ("fused") or the RMS ("rms")
    error_threshold: float = 0.05  # relative RMS error above which a window updates the twin (paper 4.2)
    update_until: float = inf  # pinion revolutions after which the twin only predicts
    trace: bool = True  # whether effects that the model lacks are sought and added
    baseline: Baseline | None = None  # a healthy baseline, for machines without a model
    relation: Relation | None = None  # of level and wear depth, for machines without a model
    status_limits: StatusLimits = STATUS_LIMITS  # when a depth or a life calls for attention

    def __post_init__(self) -> None:
        if self.update not in UPDATES:
            raise ParameterError(f"update = {self.update!r} must be one of {', '.join(UPDATES)}")
        if not 0 < self.error_threshold < 1:
            raise ParameterError(f"error_threshold = {self.error_threshold} is outside (0, 1); percent?")
        if not self.update_until >= 0:
            raise ParameterError(f"update_until = {self.update_until} revolutions must not be negative")

    @property
    def updating(self) -> UpdateOptions:
        """The part of the options that the update of the model reads."""
        from twin.updating.history import UpdateOptions

        return UpdateOptions(
            threshold=self.error_threshold, update=self.update, update_until=self.update_until
        )  # fmt: skip
