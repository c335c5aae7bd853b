"""The whole assessment with its events."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from twin.assessment.attribution import Attribution, CalibrationAssessment, EffectEvent
from twin.assessment.baseline import BaselineAssessment, UnattributedLines, UnattributedSearch
from twin.assessment.detectable import Detectable
from twin.assessment.effects import EffectAssessment, Residual, Unexplained
from twin.assessment.encoder_pair import EncoderPair
from twin.assessment.key import GIVEN, HIDDEN, Key
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


_given = partial(Key, shown=GIVEN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Assessment:
    """The twin's present answer about one machine.

    Parts that the latest window says nothing about are those of the latest window that did.
    """

    window: Annotated[WindowAssessment | None, HIDDEN]  # None after a decision
    wear: Wear | LevelWear | Unavailable
    life: Annotated[Life | Unavailable, Key("rul")]
    residual: Residual | Unavailable
    effects: tuple[EffectAssessment, ...]
    unexplained: Unexplained
    calibration: CalibrationAssessment | Unavailable
    detectable: Annotated[
        Detectable | None,
        _given(meaning="what could have been found; where nothing was, or the verdict is `explained`"),
    ] = None
    attribution: Annotated[Attribution | None, _given("tracing")] = None
    baseline: Annotated[BaselineAssessment | None, _given()] = None
    encoder_pair: Annotated[
        EncoderPair | Unavailable | None,
        _given("pair", meaning="absent where a model is known, or an encoder is not there"),
    ] = None
    unattributed_lines: Annotated[tuple[UnattributedLines, ...] | None, _given()] = None
    unattributed_search: Annotated[
        UnattributedSearch | None, _given(meaning="search of the latest window for lines of no known shaft")
    ] = None
    modulation: Annotated[
        tuple[Modulation, ...] | None,
        _given(meaning="sidebands of the mesh lines, of a machine without a model; the deepest first"),
    ] = None
    events: Annotated[tuple[Event, ...], HIDDEN] = ()
    revolutions: Annotated[float | None, HIDDEN] = None  # of the pinion so far, where no window is in the answer
    level_excess: Annotated[LevelExcess | None, HIDDEN] = None  # of the latest window
    verdict: Annotated[VerdictWindow | None, HIDDEN] = None  # the verdict rests on; None before the first window
