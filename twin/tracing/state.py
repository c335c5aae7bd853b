"""What the attribution remembers of one machine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from twin.assessment import EffectEvent, HeldOutErrors, HeldOutResidual, MovedLines, ParameterValue, SpectralLine
from twin.effects.addition import Addition
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.updating.history import WindowInput
from twin.updating.memory import Memory


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchStart:
    """When effects are sought for the first time."""

    least_windows: int = deciding(
        3,
        unit="windows",
        meaning="measurement windows before the first search",
        source="not derived: chosen; with fewer, no effect is seen in more than two fitted windows",
    )


LEAST_WINDOWS = SearchStart().least_windows


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinStage:
    """The twin with the first few effects, or with none."""

    memory: Memory
    depth: float = 0.0  # at the latest measurement window [m]
    depths: Mapping[int, float] = field(default_factory=dict)  # by window [m]
    life: float | None = None  # left at the latest measurement window [revolutions of the pinion]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceSummary:
    """The latest trace that could be made, and why the latest attempt failed where it did."""

    reason: str | None = None  # why the latest attempt failed; None where it did not
    candidates: tuple[tuple[str, float], ...] = ()  # on the mesh, with their gain in evidence [nat]
    other_structure: bool = False
    misfit_before: float | None = None
    misfit_after: float | None = None
    held_out: tuple[int, ...] = ()
    fitted: tuple[int, ...] = ()
    skipped: tuple[tuple[int, str], ...] = ()  # windows that could not be read: index, and why


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelChange:
    """The error of one channel on held-out windows without an effect and with it."""

    channel: str
    before: float  # relative error without it, over the windows
    after: float
    fall: float  # mean over the windows of the error without it less that with it
    std: float  # its standard error, paired; 0 of a single window
    healthy: float  # that a healthy machine has at most; 0 where nothing is known of it
    claimed: bool  # whether the effect moves lines of the channel beyond their scatter
    shown: tuple[float, float] = (1.0, 0.0)  # share of that move which the channel itself shows, and its std
    windows: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why an effect was refused, and by which windows."""

    reason: str
    windows: tuple[int, ...] = ()  # indices of the held-out windows that judged it; none where its size did
    onset: float = 0.0  # of the effect as it was refused [revolutions]
    measured: int = 0  # measurement windows until then


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectErrors:
    """Errors on held-out windows of the twin in use without one effect and with it, on the same windows."""

    before: HeldOutErrors
    after: HeldOutErrors
    moved: tuple[MovedLines, ...] = ()  # the same comparison, by channel, on the lines that the effect moves
    changes: tuple[ChannelChange, ...] = ()  # the same comparison, window by window
    windows: tuple[int, ...] = ()  # that judge the effect


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracing:
    """What the attribution remembers of one machine; plain serialisable data."""

    history: tuple[WindowInput, ...] = ()  # windows since the machine was last changed
    start: Memory | None = None  # of the twin in use before the first of them; None: the rig file alone
    started: int = 0  # measurement windows before the first of them
    widened: tuple[int, ...] = ()  # windows from which on the wear rate may be another
    measured: int = 0  # measurement windows so far
    next_search: int = LEAST_WINDOWS
    next_trace: int = LEAST_WINDOWS
    phase: float | None = None  # of the mesh against the encoder's zero, on the first mounting of the discs [rad]
    turns: tuple[tuple[int, float], ...] = ()  # of the pinion's disc that are believed: since [Unix ns], by [rad]
    signs: Mapping[str, float] = field(default_factory=dict)  # the largest traced so far (change_detection.py)
    found: tuple[AttributedEffect, ...] = ()  # what is in the twin, in the order found
    stages: tuple[TwinStage, ...] = ()  # with 0, 1, … of the effects that change a depth; the last is in use
    decisions: Mapping[str, str] = field(default_factory=dict)  # name → accepted, rejected or pinned
    refuted: Mapping[str, Refusal] = field(default_factory=dict)  # by the name of the effect
    errors: tuple[EffectErrors, ...] = ()  # one for each of `found`
    error: HeldOutErrors | None = None  # of the twin in use
    residual: HeldOutResidual | None = None  # of one held-out window
    unattributed: tuple[SpectralLine, ...] = ()  # lines that no gear makes
    unknown: str = ""  # what has no name, in words
    struck: str = ""  # shaft whose turn impacts of no name repeat with: "pinion" or "gear"
    latest: TraceSummary = field(default_factory=TraceSummary)
    log: tuple[EffectEvent, ...] = ()

    @property
    def rejected(self) -> tuple[str, ...]:
        """Names that an engineer has ruled out."""
        return tuple(name for name, verdict in self.decisions.items() if verdict == "rejected")

    @property
    def fixed(self) -> tuple[str, ...]:
        """Effects that an engineer has accepted or pinned: they stay, whatever they add."""
        return tuple(name for name, verdict in self.decisions.items() if verdict in ("accepted", "pinned"))

    @property
    def memory(self) -> Memory:
        """The memory of the twin in use."""
        return self.stages[-1].memory if self.stages else self.start or Memory()

    @property
    def few_windows(self) -> bool:
        """Whether fewer measurement windows than a search needs have come since the machine was last changed."""
        return self.measured - self.started < LEAST_WINDOWS


def relevant(found: Iterable[AttributedEffect]) -> tuple[Addition, ...]:
    """The effects that change the mesh orders or the path: no others change a depth."""
    return tuple(f.addition for f in found if f.addition.effect.facts.changes_mesh_lines)


def parameters_of(item: AttributedEffect) -> dict[str, ParameterValue]:
    """The parameters of an effect with their units."""
    return {
        name: ParameterValue(value=value, unit=unit, std=std) for name, (value, unit, std) in item.parameters.items()
    }
