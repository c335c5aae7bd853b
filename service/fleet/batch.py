"""Many stored recordings assessed side by side; what an earlier run has done is not done again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from typing import Any

from service import __version__
from service.fleet.assess_task import Outcome, Work, assess_one, found_outcome
from service.json_text import json_text
from service.results.object_store import ObjectStore
from service.results.stored_recordings import StoredRecording

SUMMARY = "summary.json"  # of the latest run that came to its end


@dataclass(slots=True, kw_only=True)
class Summary:
    """What came of each recording of a run."""

    outcomes: dict[str, Outcome] = field(default_factory=dict)  # by recording
    counted: Counter[str] = field(default_factory=Counter)

    def add(self, recording: StoredRecording, outcome: Outcome) -> None:
        """Notes what came of one recording."""
        self.outcomes[recording.where] = outcome
        self.counted[outcome.state] += 1

    @property
    def refused(self) -> list[str]:
        """Why recordings were refused."""
        return [o.reason or f"{where}: refused" for where, o in self.outcomes.items() if o.state == "refused"]

    @property
    def counts(self) -> dict[str, int]:
        return {state: self.counted[state] for state in ("assessed", "found", "refused")}

    def as_json(self, work: Work) -> dict[str, Any]:
        listed = [{"recording": where, **asdict(outcome)} for where, outcome in self.outcomes.items()]
        return {"program": __version__, "options": work.given, **self.counts, "recordings": listed}


Progress = Callable[[Summary, int], None]  # so far, and how many recordings there are


def assess_all(
    recordings: Sequence[StoredRecording],
    work: Work,
    progress: Progress = lambda summary, total: None,
    *,
    workers: int | None = None,
    address: str | None = None,
) -> Summary:
    """Assesses what has no result yet, with Ray, and writes a summary to the results.

    workers, address  as `ray_tasks.carried_out` has them
    """
    results = ObjectStore(work.results, make=True)
    known = {entry.name for entry in results.entries() if entry.size}
    summary, missing = Summary(), []
    for recording in recordings:
        found = found_outcome(results, work.name_of(recording), known)
        if found is None:
            missing.append(recording)
        else:
            summary.add(recording, found)
    progress(summary, len(recordings))
    if missing:
        from service.fleet.ray_tasks import ProcessEnded, carried_out

        with closing(carried_out(assess_one, work, missing, workers=workers, address=address)) as done:
            for recording, outcome in done:
                if isinstance(outcome, ProcessEnded):
                    outcome = Outcome(state="refused", result=None, reason=f"{recording.where}: {outcome}")
                summary.add(recording, outcome)
                progress(summary, len(recordings))
    summary.outcomes = {r.where: summary.outcomes[r.where] for r in recordings}
    results.put(SUMMARY, (json_text(summary.as_json(work)) + "\n").encode())
    return summary
