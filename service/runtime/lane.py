"""One asset's place in the processing: its twin's state, the windows that wait for their turn, what is to be done."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from service.contract.status import with_status_since
from service.operation.journey import Journey
from service.runtime.computing import Ask, Made
from service.runtime.outcomes import DecisionOutcome
from service.runtime.questions import ALL_WAIT
from service.runtime.twin_port import Twin
from twin.rig import Rig
from twin.windows import Window


@dataclass(slots=True, eq=False, kw_only=True)
class Entry:
    """A closed window that has not been committed yet."""

    start_ns: int
    number: int | None = None  # among the windows that are kept until their turn; None where it is in memory alone
    file: Path | None = None  # that it is kept in
    bytes: int = 0  # of that file
    window: Window | None = None  # where it is in memory
    refuse: str | None = None  # why it is not to be used; None where it is
    again: bool = False  # whether it has waited for an answer before
    journey: Journey = field(default_factory=Journey)


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """Something to be done between two windows of an asset.

    ask     what is asked of the twin; None where nothing is. TwinError or InputError refuses it
    then    what follows, with what was made of it; TwinError or InputError refuses it
    refuse  what follows where it cannot be done, with the reason
    """

    ask: Callable[[Lane], Ask | None]
    then: Callable[[Lane, Made], None]
    refuse: Callable[[str], None]


@dataclass(slots=True, eq=False, kw_only=True)
class Lane:
    """How far the windows of one asset have been processed. Of them, the first `held` wait for an answer by people."""

    asset: str
    rig: Rig
    twin: Twin
    state: Any
    index: int = 0  # of the next window
    report: Mapping[str, Any] | None = None
    assembly: Mapping[str, Any] = field(default_factory=dict)  # Assembler.to_dict() as of the newest window here
    question: Mapping[str, Any] | None = None  # that is open
    entries: deque[Entry] = field(default_factory=deque)
    held: int = 0
    jobs: deque[Turn] = field(default_factory=deque)
    current: Entry | None = None  # that is being computed, or committed
    busy: bool = False  # whether something is being computed, or waits for the storage
    turning: bool = False
    shed: int = 0  # windows that were left out because too much waited
    stopped: str | None = None  # why nothing can be processed; None where it can

    @property
    def all_wait(self) -> bool:
        """Whether no window can be used until people have answered."""
        return self.question is not None and self.question["kind"] in ALL_WAIT

    @property
    def bytes(self) -> int:
        """What the windows that wait take on disk."""
        return sum(entry.bytes for entry in self.entries.copy())

    @property
    def lag(self) -> float:
        """How long the oldest window that has not been processed has waited; 0 where none waits [s]."""
        entries, held = self.entries.copy(), self.held
        return entries[held].journey.waited if held < len(entries) else 0.0

    def next_entry(self) -> Entry | None:
        """The window whose turn it is."""
        return self.entries[self.held] if self.held < len(self.entries) else None

    def remove(self, entry: Entry) -> None:
        """Ends the wait of a window that has been committed."""
        place = self.entries.index(entry)
        del self.entries[place]
        self.held -= place < self.held

    def release(self, refuse: str | None = None) -> None:
        """Lets the windows go on that wait for an answer; or refuses them, for a reason."""
        for _ in range(self.held):
            entry = self.entries[0]
            entry.again, entry.refuse = True, refuse or entry.refuse
            self.entries.rotate(-1)
        self.entries.rotate(self.held)
        self.held = 0

    # -- what decisions, inspections and changes lead to ---------------------------------------------

    def decided(self, made: Made, ended_ns: int) -> DecisionOutcome:
        """What a decision on an effect, or a change of the machine, leads to; the asset's windows end at `ended_ns`."""
        assert made.answer is not None
        report = with_status_since(self.report, made.answer.report, ended_ns, None)
        return DecisionOutcome(asset=self.asset, state=made.state, report=report, events=made.answer.events)

    def inspected(self, made: Made, ended_ns: int) -> DecisionOutcome:
        """What a measured wear depth leads to; the asset's windows end at `ended_ns`."""
        assert made.answer is not None
        report = with_status_since(self.report, {**(self.report or {}), **made.answer.report}, ended_ns, None)
        return DecisionOutcome(asset=self.asset, state=made.state, report=report, events=made.answer.events)

    def accept(self, outcome: DecisionOutcome) -> None:
        """Goes on from a decision, an inspection or a change, once it has been committed."""
        self.state, self.report = outcome.state, outcome.report
