"""Faults and attacks by kind, each drawn from a seed.

    python -m tests.chaos frames      malformed frames into a whole service
    python -m tests.chaos recordings  damaged recordings
    python -m tests.chaos rigs        damaged rig files
    python -m tests.chaos measurements damaged measurement files of all formats
    python -m tests.chaos http        requests made up from the OpenAPI description, by callers with each credential
    python -m tests.chaos guided      malformed input found by coverage (seconds; needs atheris)
    python -m tests.chaos kills       kills of the service while windows are received and processed
    python -m tests.chaos schedules   processes killed, stopped and stalled, disks full, databases locked
    python -m tests.chaos fleet       workers, nodes, head, database and router of a fleet killed, workers suspended

Prints what became of them as JSON, and ends with 1 where something must not have happened.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "service"))  # the fakes of the service's tests

from postgresql_server import PostgresqlServer

from tests.chaos import api, fleet, guided, kills, schedules
from tests.chaos.files import attack
from tests.chaos.frames import Attack

COUNTS = {
    "frames": 1_000_000,
    "recordings": 10_000,
    "rigs": 10_000,
    "measurements": 2_000,
    "http": 50,
    "guided": 600,
    "kills": 300,
    "schedules": 300,
    "fleet": 50,
}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.chaos", description="Faults and attacks.")
    parser.add_argument("kind", choices=COUNTS)
    parser.add_argument(
        "--count", type=int, help="how many; default: " + ", ".join(f"{k} {n}" for k, n in COUNTS.items())
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first schedule")
    parser.add_argument(
        "--only", nargs="*", default=[], help="kinds of faults of schedules, or targets of guided; default: all"
    )
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--assets", type=int, default=200, help="of the fleet")
    parser.add_argument("--postgresql", action="store_true", help="kills: results in a server that is restarted, too")
    chosen = parser.parse_args()
    count = chosen.count or COUNTS[chosen.kind]
    with tempfile.TemporaryDirectory() as folder:
        if chosen.kind == "frames":
            return _frames(chosen.seed, count, Path(folder))
        if chosen.kind == "kills":
            with PostgresqlServer() if chosen.postgresql else nullcontext() as server:
                outcome = kills.attack(count, chosen.seed, Path(folder), _say, server)
            held = not outcome.faults
        elif chosen.kind == "fleet":
            kinds = tuple(chosen.only) or fleet.KINDS
            outcome = fleet.attack(count, chosen.seed, Path(folder), _say, kinds=kinds, assets=chosen.assets)
            held = not outcome.faults
        elif chosen.kind == "http":
            outcome = api.attack(count, chosen.seed, Path(folder), _say)
            held = not outcome.faults
        elif chosen.kind == "guided":
            outcome = guided.attack(count, chosen.seed, Path(folder), _say, chosen.only)
            held = not outcome.faults
        elif chosen.kind == "schedules":
            return _schedules(chosen, count, Path(folder))
        else:
            outcome = attack(chosen.kind, count, chosen.seed, Path(folder), _say, chosen.processes)
            held = not outcome.faults
    print(json.dumps(asdict(outcome), indent=1))
    return 0 if held else 1


def _frames(seed: int, count: int, folder: Path) -> int:
    """Half of the frames where people are asked about unknown assets, half where each new name is one."""
    held = True
    for ask in (True, False):
        outcome = Attack(seed + (not ask), folder).run(count // 2, _say, ask=ask)
        print(json.dumps({"ask": ask, **asdict(outcome)}, indent=1), flush=True)
        held &= outcome.sound and outcome.failure is None
    return 0 if held else 1


def _schedules(chosen: argparse.Namespace, count: int, folder: Path) -> int:
    numbers = range(chosen.first, chosen.first + count)
    done = schedules.attack(numbers, chosen.seed, folder, _say, chosen.processes, chosen.only)
    wrong = [outcome for outcome in done if outcome.wrong]
    faults = Counter(fault.kind for outcome in done for fault in outcome.schedule.faults)
    survived = sum(outcome.schedule.survives for outcome in done)
    summary = {
        "schedules": len(done), "publisher_survived": survived, "wrong": len(wrong), "faults": dict(faults),
        "restarts": sum(outcome.restarts for outcome in done),
    }  # fmt: skip
    print(json.dumps(summary | {"outcomes": [asdict(outcome) for outcome in wrong]}, indent=1))
    return 1 if wrong else 0


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
