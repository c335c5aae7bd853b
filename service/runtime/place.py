"""Where the jobs of one asset have come to: what the next one goes on from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from service.results.jobs import Job
from service.runtime.computing import Ask, Made
from service.runtime.outcomes import Outcome
from service.runtime.twin_port import Twin
from service.stream.edge_counts import EncoderCounts
from service.stream.quality import Counts
from twin.rig import Rig


@dataclass(slots=True, kw_only=True)
class Place:
    """What is known of an asset after its newest job."""

    asset: str
    rig: Rig
    twin: Twin
    state: Any
    index: int = 0  # of the next window
    report: Mapping[str, Any] | None = None
    encoders: EncoderCounts = field(default_factory=EncoderCounts)  # by the end of the last window that was made
    counts: Counts = field(default_factory=Counts)  # of its windows
    question: Mapping[str, Any] | None = None  # that is open
    begun: bool = False  # whether any window has been processed

    @property
    def making(self) -> dict[str, Any]:
        """What the making of the next window goes on from, and what is counted, JSON-safe."""
        return {**self.encoders.to_dict(), **self.counts.to_dict()}

    def accept(self, outcome: Outcome) -> None:
        """Goes on from what a job has led to, once it has been committed."""
        self.state = self.state if outcome.state is None else outcome.state
        self.report = self.report if outcome.report is None else outcome.report
        self.question = outcome.changed.get("question", self.question)
        if outcome.window is not None:
            self.index, self.begun = self.index + 1, True
            self.make_from(outcome.making or {})

    def make_from(self, making: Mapping[str, Any]) -> None:
        """Goes on from what `making` was."""
        self.encoders, self.counts = EncoderCounts.from_dict(making), Counts.from_dict(making)


def nothing(place: Place, job: Job) -> Ask | None:
    """Nothing is asked of the twin."""
    return None


class JobKind(NamedTuple):
    """How a kind of job is carried out. TwinError or InputError refuses the job.

    then     what it leads to, with what the twin has made; None where that is nothing
    ask      what is asked of the twin; None where nothing is
    refused  the outcome of a job that cannot be carried out, by the reason
    begins   whether it can be carried out before the asset's first window
    """

    then: Callable[[Place, Job, Made], Outcome | None]
    ask: Callable[[Place, Job], Ask | None] = nothing
    refused: Callable[[Job, str], Mapping[str, Any] | None] = lambda job, reason: None
    begins: bool = False
