"""A service whose twin answers every window with one recorded answer: what the service itself costs.

    python -m benchmarks.long_run.stand_in        `gear-twin serve` with that twin, set by GEAR_TWIN_… as always

ANSWER names the file with that answer, which `write_template` writes: that of the bundled campaign's last window, in
its full size. Revolutions and depth go on with each window, so that the histories look like a machine's.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from math import sin
from pathlib import Path
from typing import Any

from service.__main__ import leave
from service.contract.estimate import Estimate
from service.files.rig import rig_of
from service.json_text import json_text
from service.results.jobs import Job
from service.runtime.outcomes import Outcome
from service.runtime.pipeline import Pipeline
from service.runtime.serve import run
from service.runtime.twin_port import Twin, gear_twin
from service.settings import Settings
from service.stream.sources.mcap import Recording
from twin.options import Options
from twin.rig import Rig
from twin.windows import Window

ANSWER = "LONG_RUN_ANSWER"  # environment variable: file with the recorded answer
CAMPAIGN = Path(__file__).parents[2] / "recordings" / "short-campaign.mcap"
DEPTH_A_REVOLUTION = 1e-4  # [µm]
UPDATE_EVERY = 50  # windows
SWAY = 0.05  # of the level, from window to window


class _Outcomes:
    """Keeps what a campaign led to."""

    def __init__(self) -> None:
        self.newest: Outcome | None = None

    def commit(self, outcome: Outcome, job: Job | None = None) -> bool:
        self.newest = outcome
        return True

    def publish(self, outcome: Outcome) -> None:
        pass


def write_template(path: Path) -> None:
    """Writes record and report of the bundled campaign's last window to a file, for this process and its children."""
    outcomes = _Outcomes()
    with Recording(CAMPAIGN) as recording:
        rig = rig_of(recording, None)
        pipeline = Pipeline(lambda asset: rig, gear_twin(Options(trace=False)), outcomes)
        for frame in recording.frames(lambda channel, error: None):
            pipeline.feed(frame)
        pipeline.flush()
    assert outcomes.newest is not None
    path.write_text(json_text({"record": outcomes.newest.record, "report": outcomes.newest.report}), encoding="utf-8")
    os.environ[ANSWER] = str(path)


@cache
def template() -> Mapping[str, Any]:
    """`record` and `report` of the bundled campaign's last window."""
    return json.loads(Path(os.environ[ANSWER]).read_text(encoding="utf-8"))


@dataclass(frozen=True, slots=True, kw_only=True)
class StandInState:
    """What the stand-in remembers."""

    windows: int = 0

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> StandInState:
        return cls(**data)


def record_of(number: int, revolutions: float) -> dict[str, Any]:
    """The template's record as that of another window; its level sways, so that every part of a history has a peak."""
    record = template()["record"]
    return {
        **record,
        "rms_measured": record["rms_measured"] * (1 + SWAY * sin(number)),
        "index": number,
        "revolutions": revolutions,
        "wear_depth_um": DEPTH_A_REVOLUTION * revolutions,
        "updated": number % UPDATE_EVERY == 0,
        "quality": "good",
        "faults": [],
    }


def step(rig: Rig, state: StandInState, window: Window, options: object) -> tuple[StandInState, Estimate]:
    """The recorded answer, with this window's revolutions."""
    edges = window.encoders["pinion"]
    record = record_of(state.windows, (edges.first_index + edges.times.size / 2) / edges.per_rev)
    estimate = Estimate(record=record, report=dict(template()["report"]), events=(("window", record),))
    return replace(state, windows=state.windows + 1), estimate


TWIN = Twin(step=step, new_state=StandInState, load_state=StandInState.from_dict)

if __name__ == "__main__":
    leave(run(Settings(), twin=TWIN))
