"""The whole assessment with its events."""

from __future__ import annotations

from dataclasses import dataclass

from twin.assessment.attribution import Attribution, CalibrationAssessment, EffectEvent
from twin.assessment.baseline import BaselineAssessment, UnattributedLines, UnattributedSearch
from twin.assessment.detectable import Detectable
from twin.assessment.effects import EffectAssessment, Residual, Unexplained
from twin.assessment.encoder_pair import EncoderPair
from twin.assessment.modulation import Modulation
from twin.assessment.values import Unavailable
from twin.assessment.verdict import LevelExcess, VerdictWindow
from twin.assessment.wear import LevelWear, Life, Wear
from twin.assessment.window import WindowAssessment


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowEvent:
    """A window was assessed."""

    window: WindowAssessment


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateEvent:
    """The window's error passed the threshold, and the twin was updated."""

    window: WindowAssessment


@dataclass(frozen=True, slots=True, kw_only=True)
class LifeEvent:
    """The remaining life was computed anew."""

    life: Life


@dataclass(frozen=True, slots=True, kw_only=True)
class CountEvent:
    """The revolution count of the same gears had begun again, and was followed."""

    window: int
    seen: float  # revolutions of the pinion by the latest window before
    count: float  # that the encoder gives [turns of the pinion]
    revolutions: float  # of the pinion by the window
    reason: str  # by what it is known that the gears are the same


Event = WindowEvent | UpdateEvent | LifeEvent | EffectEvent | CountEvent


@dataclass(frozen=True, slots=True, kw_only=True)
class Assessment:
    """The twin's present answer about one machine.

    Parts that the latest window says nothing about are those of the latest window that did.
    """

    window: WindowAssessment | None  # None after a decision
    wear: Wear | LevelWear | Unavailable
    life: Life | Unavailable
    residual: Residual | Unavailable
    effects: tuple[EffectAssessment, ...]
    unexplained: Unexplained
    calibration: CalibrationAssessment | Unavailable
    attribution: Attribution | None = None
    detectable: Detectable | None = None  # where nothing was found, or what is there is explained
    baseline: BaselineAssessment | None = None
    encoder_pair: EncoderPair | Unavailable | None = None  # None where the machine has a model, or no two encoders
    unattributed_lines: tuple[UnattributedLines, ...] | None = None
    unattributed_search: UnattributedSearch | None = None  # of the latest window; None where they were not sought
    modulation: tuple[Modulation, ...] | None = None  # of the latest window; None where it was not examined
    events: tuple[Event, ...] = ()
    revolutions: float | None = None  # of the pinion so far, where no window is in the answer
    level_excess: LevelExcess | None = None  # of the latest window
    verdict: VerdictWindow | None = None  # the window that the verdict rests on; None before the first window
