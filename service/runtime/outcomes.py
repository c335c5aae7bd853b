"""What passes between the loop and its collaborators: outcomes of windows and decisions, and who takes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from service.operation.journey import Journey
from service.runtime.twin_port import Events
from twin.windows import Window

Raw = Literal["same", "other faults", "nothing"]
"""What the file in which a window was kept holds of its signals: the same window, one with other faults, or nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedWindow:
    """A window whose frames are complete, or will not be completed any more."""

    asset: str
    window: Window
    assembly: Mapping[str, Any]  # Assembler.to_dict() as of this window
    journey: Journey = field(default_factory=Journey)


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowOutcome:
    """What one window led to; all but `window` and `state` is JSON-safe."""

    asset: str
    index: int  # of the window, from 0, counting refused ones
    window: Window  # as it was used; without its signals where it was kept in a file
    record: Mapping[str, Any]  # the contract's `windows[]`, with `quality` and `faults`
    state: Any  # twin.step.State after the window
    report: Mapping[str, Any] | None  # the twin's newest answer; None before its first window
    events: Events
    assembly: Mapping[str, Any]  # Assembler.to_dict() as of this window
    quality: Mapping[str, Any]  # the section `data_quality`
    waited: int | None = None  # number of the window among those that were kept until their turn; None where it was not
    raw: Raw = "same"
    question: Mapping[str, Any] | None = None  # open after the window


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldWindow:
    """A window that cannot be used until people have answered a question."""

    asset: str
    state: Any  # twin.step.State, which remembers that the window came; None where it has not changed
    question: Mapping[str, Any]
    waiting: int  # windows that wait for the answer, with this one
    events: Events


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoint:
    """Where an asset's windows ended: the newest outcome, as a store gives it back."""

    index: int
    state: Any  # twin.step.State
    report: Mapping[str, Any] | None
    assembly: Mapping[str, Any]
    quality: Mapping[str, Any]
    question: Mapping[str, Any] | None = None
    shed: int = 0  # windows that were left out because too much waited


@dataclass(frozen=True, slots=True, kw_only=True)
class DecisionOutcome:
    """What a decision on an effect, an inspection, or a change of the machine, led to."""

    asset: str
    state: Any  # twin.step.State after it
    report: Mapping[str, Any]
    events: Events


class WaitingPlace(Protocol):
    """Where windows wait until people have answered a question."""

    def hold(self, held: HeldWindow) -> Mapping[str, Any]:
        """Keeps that a window waits for an answer; the question as it is shown then."""
        ...

    def ask(self, asset: str, question: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
        """Keeps and shows a question for which no window waits, or that it is over."""
        ...


class ResultSink(Protocol):
    """Where outcomes go."""

    def commit(self, outcome: WindowOutcome) -> bool:
        """Keeps a window, whole; False, with nothing changed, where it has been committed before."""
        ...

    def publish(self, outcome: WindowOutcome) -> None:
        """Shows a committed window."""
        ...
