"""Many stored recordings assessed side by side, as tasks of Ray; what an earlier run has done is not done again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from typing import Any

from service import __version__
from service.errors import InputError
from service.fleet.assess_task import Outcome, Work, assess_one, found_outcome
from service.fleet.ray_session import is_started, ray_session
from service.json_text import json_text
from service.results.object_store import ObjectStore
from service.results.stored_recordings import StoredRecording

SUMMARY = "summary.json"  # of the latest run that came to its end
AHEAD = 2  # recordings that are handed over for each core, so that none waits for the next
RETRIES = 4  # how often a recording is begun again whose process has ended: it was killed, or the memory was short


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
    """Assesses what has no result yet, and writes a summary to the results.

    workers  recordings at a time; None for the cores of this machine or of the cluster
    address  of a cluster; None for a Ray of this machine alone
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
        with closing(_assessed(missing, work, workers, address)) as done:
            for recording, outcome in done:
                summary.add(recording, outcome)
                progress(summary, len(recordings))
    summary.outcomes = {r.where: summary.outcomes[r.where] for r in recordings}
    results.put(SUMMARY, (json_text(summary.as_json(work)) + "\n").encode())
    return summary


def _assessed(
    recordings: Sequence[StoredRecording], work: Work, workers: int | None, address: str | None
) -> Generator[tuple[StoredRecording, Outcome], None, None]:
    """Recordings as they are done; an error of the program ends the others."""
    goes_on = is_started()
    with ray_session(address, workers) as ray:
        cores = max(int(ray.cluster_resources().get("CPU", 1)), 1)
        most = workers if workers is not None and address is not None else AHEAD * cores
        task = ray.remote(num_cpus=1, max_retries=RETRIES)(assess_one)
        shared, coming = ray.put(work), iter(recordings)
        running: dict[Any, StoredRecording] = {}
        try:
            while True:
                while len(running) < most and (recording := next(coming, None)) is not None:
                    running[task.remote(shared, recording)] = recording
                if not running:
                    return
                for done in ray.wait(list(running), num_returns=1)[0]:
                    recording = running.pop(done)
                    yield recording, _outcome(ray, done, recording)
        finally:
            # what runs ends with this process's connection; called off at the same time, Ray may end in an abort
            for left in running if goes_on else ():
                ray.cancel(left, force=True)


def _outcome(ray: Any, done: Any, recording: StoredRecording) -> Outcome:
    try:
        outcome: Outcome = ray.get(done)
        return outcome
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, (ray.exceptions.RaySystemError, ImportError)):
            said = str(error.cause).partition("\n")[0]
            raise InputError(f"a Ray node cannot run gear-twin: {said}: install the same version on each") from error
        raise error.cause from None
    except (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError) as error:
        why = f"its process ended {RETRIES + 1} times ({type(error).__name__}): is there enough memory?"
        return Outcome(state="refused", result=None, reason=f"{recording.where}: {why}")
