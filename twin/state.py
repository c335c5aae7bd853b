"""What the twin remembers of one machine between windows: plain serialisable data with a schema version.

    state.to_dict()["schema_version"] == SCHEMA_VERSION;   State.from_dict(state.to_dict()) == state

A state of another version is refused with a sentence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from twin.assessment import (
    BaselineAssessment,
    CalibrationAssessment,
    Detectable,
    EffectAssessment,
    EncoderPair,
    LevelReading,
    LevelWear,
    Life,
    Residual,
    UnattributedLines,
    Unavailable,
    Unexplained,
    Wear,
)
from twin.errors import ParameterError
from twin.established import History
from twin.features.indicator_record import Records
from twin.held_level import HeldLevel
from twin.level_record import Levels
from twin.revolution_count import CountOffset
from twin.serial import from_plain, to_plain
from twin.tracing.state import Tracing
from twin.updating.inspections import Inspection
from twin.updating.memory import Memory
from twin.updating.residual import WindowResidual
from twin.updating.running_time import Marks
from twin.verdict_window import Rhythm

SCHEMA_VERSION = 2
VERSION = "schema_version"


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineParts:
    """The latest comparison with a healthy baseline."""

    residual: Residual
    effects: tuple[EffectAssessment, ...]
    unexplained: Unexplained
    baseline: BaselineAssessment | None
    unattributed_lines: tuple[UnattributedLines, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LatestParts:
    """The parts of the latest answer, for windows that say nothing about them; None before the first that did."""

    wear: Wear | LevelWear | Unavailable | None = None
    life: Life | Unavailable | None = None
    residual: Residual | Unavailable | None = None
    unexplained: Unexplained | None = None
    calibration: CalibrationAssessment | Unavailable | None = None
    baseline: BaselineParts | None = None
    encoder_pair: EncoderPair | None = None
    detectable: Detectable | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FallenCount:
    """A revolution count far below what was seen before: other gears, a counter that was reset, or another machine."""

    revolutions: float  # of the pinion, by the latest window that was refused for it
    time_ns: int  # its start [Unix ns]
    refusals: int  # windows in a row
    ignored: bool = False  # whether people have said that windows of this count are not to be used


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """What the twin remembers of a machine; plain serialisable data."""

    windows_seen: int = 0
    recent: tuple[WindowResidual, ...] = ()  # the latest windows' residuals, newest last
    latest: LatestParts = field(default_factory=LatestParts)
    levels: Mapping[str, LevelReading] = field(default_factory=dict)  # the latest under each operating condition
    residual_records: Records = ()  # variances of the gears' residuals, which NA4 compares with
    tracing: Tracing = field(default_factory=Tracing)  # the twin with 0, 1, … of its effects, and its history
    fallen: FallenCount | None = None  # while windows of a lower count are refused
    inspections: tuple[Inspection, ...] = ()  # measured depths, in the order of their revolutions
    running: Marks = ()  # running time and clock at some of the windows
    count: CountOffset = field(default_factory=CountOffset)  # from the encoder's count to revolutions
    counted: float = 0.0  # revolutions of the present gears by the latest window
    outdated: Mapping[str, str] = field(default_factory=dict)  # baselines that no longer hold (machine_changes.py)
    history: History = field(default_factory=History)  # windows of these gears with an established depth
    rhythm: Rhythm = field(default_factory=Rhythm)  # which windows were assessed
    learned_levels: Levels = ()  # vibration levels of the first windows, by operating condition
    held: HeldLevel = field(default_factory=HeldLevel)  # level of the status

    @property
    def memory(self) -> Memory:
        """The memory of the twin in use."""
        return self.tracing.memory

    def to_dict(self) -> dict[str, Any]:
        """The state as JSON-safe data."""
        return {VERSION: SCHEMA_VERSION, **to_plain(self)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> State:
        """The state from what `to_dict` gave, in this version; ParameterError for another, Misfit for damaged data."""
        if not isinstance(data, Mapping):
            raise ParameterError(f"a state of the twin is a mapping with a schema_version, not {data!r:.60}")
        version = data.get(VERSION)
        if version != SCHEMA_VERSION:
            raise ParameterError(
                f"the state has schema version {version!r}, this program reads {SCHEMA_VERSION}: "
                "it was written by another gear-twin, or is not a state of the twin"
            )
        return from_plain(cls, {name: item for name, item in data.items() if name != VERSION})
