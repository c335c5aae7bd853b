"""What passes between the loop and its collaborators: windows that have closed, and what each job has led to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from service.alarms.keeper import AlarmKeeper
from service.operation.journey import Journey
from service.results.window_jobs import WaitingWindow
from service.runtime.twin_port import Events
from service.stream.segment import Segment
from twin.windows import Window

Judge = Callable[[AlarmKeeper, Mapping[str, Any]], Events]
"""Judges the alarms of an asset, and the quality of its data as it is shown; answers the events of alarms."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedWindow:
    """A window whose frames are complete, or will not be completed any more."""

    asset: str
    segment: Segment
    assembly: Mapping[str, Any]  # Assembler.to_dict() as of this window
    journey: Journey = field(default_factory=Journey)


def _no_alarms(alarms: AlarmKeeper, data: Mapping[str, Any]) -> Events:
    return ()


def _nothing() -> None:
    pass


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What one job led to: all that is committed in one transaction. All but `window` and `state` is JSON-safe.

    Of what is not given, nothing changes. `index` to `signals` are of a window that was used or refused.

    judge  which alarms are raised or end, where no window was used; within the transaction
    also   what else changes; within the transaction. InputError refuses the job
    after  what follows once it is committed and shown; what it reads of the storage comes first, since it may fail
    """

    asset: str
    index: int = -1  # from 0, counting refused ones
    window: Window | None = None  # as it was used; without its signals where its frames were kept in a file
    record: Mapping[str, Any] = field(default_factory=dict)  # the contract's `windows[]`, with `quality` and `faults`
    waited: WaitingWindow | None = None  # the job that the window was; None where it has none
    before: Mapping[str, Any] | None = None  # what its making took from the window before
    stages: Mapping[str, Any] = field(default_factory=dict)  # when its stages ended: see `journey`
    making: Mapping[str, Any] | None = None  # what the making of the next window goes on from, and what is counted
    signals: bool = True  # whether it has any
    held: bool = False  # whether a window waits from now on until people have answered
    state: Any = None  # twin.step.State
    report: Mapping[str, Any] | None = None  # the twin's newest answer
    changed: Mapping[str, Any] = field(default_factory=dict)  # other parts of the asset's snapshot
    events: Events = ()
    led_to: Mapping[str, Any] | None = None  # the outcome of a person's job
    refuse: str | None = None  # why windows that waited for the answer of a question that ends are not used
    judge: Judge = _no_alarms
    also: Callable[[], None] = _nothing
    after: Callable[[], None] = _nothing


class ResultSink(Protocol):
    """Where outcomes go."""

    def commit(self, outcome: Outcome) -> bool:
        """Keeps an outcome, whole; False, with nothing changed, where its window has been committed before."""
        ...

    def publish(self, outcome: Outcome) -> None:
        """Shows a committed outcome."""
        ...
