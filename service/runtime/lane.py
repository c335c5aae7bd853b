"""One asset's place in the processing: its twin's state, the windows that wait for their turn, what is to be done."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from service.operation.journey import Journey
from service.results.jobs import Job
from service.runtime.outcomes import Outcome
from service.runtime.place import JobKind, Place
from service.runtime.questions import ALL_WAIT
from service.stream.segment import Segment


@dataclass(slots=True, eq=False, kw_only=True)
class Entry:
    """A closed window that has not been committed yet: its frames, in a file or in memory."""

    start_ns: int
    number: int | None = None  # among the windows that are kept until their turn; None where it is in memory alone
    file: Path | None = None  # that they are kept in
    bytes: int = 0  # of that file
    segment: Segment | None = None  # where its frames are in memory
    refuse: str | None = None  # why it is not to be used; None where it is
    again: bool = False  # whether it has waited for an answer before
    journey: Journey = field(default_factory=Journey)


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """A person's job, to be done between two windows of its asset.

    refuse  keeps that it cannot be done, with the reason
    ended   called with it and its outcome once it is done
    """

    job: Job
    kind: JobKind
    refuse: Callable[[str], None]
    ended: Callable[[Job], None]


@dataclass(slots=True, eq=False, kw_only=True)
class Lane(Place):
    """How far the windows of one asset have been processed. Of them, the first `held` wait for an answer by people."""

    assembly: Mapping[str, Any] = field(default_factory=dict)  # Assembler.to_dict() as of the newest window here
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

    def accept(self, outcome: Outcome) -> None:
        """Goes on from what a job has led to, once it has been committed."""
        Place.accept(self, outcome)  # `super` does not find itself in a class with slots
        if "question" in outcome.changed and self.question is None:
            self.release(outcome.refuse)
        self.held += outcome.held
