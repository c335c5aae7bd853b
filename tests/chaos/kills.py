"""Kills of a whole service at moments drawn from a seed: no acknowledged window is lost, and none is counted twice.

Each schedule sends the recordings of some assets to a service with worker processes, and kills it (SIGKILL, or SIGTERM)
at drawn moments while windows are received, wait, and are processed; people's decisions are submitted meanwhile. The
service is started again each time. In half of the schedules the publisher goes on through the kills; in the others it
is killed as well, and what was acknowledged by then must be there in the end without being sent again. After that all
is sent once more, and the end must be that of a service that nobody disturbed.
"""

from __future__ import annotations

import json
import random
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fake_twin
from service_streams import HERE, ROOT, Service, wait_until, write_recording
from test_decisions import post

from service.json_text import plain
from service.results.data_folder import DATABASE
from service.runtime.assess import assess

WINDOWS = 12
SILENCE = "5"  # that ends a window: longer than it takes to send what is not stored once more [s]
ASSETS = ("a", "b", "c")
DECISION = "/v1/assets/a/effects/misalignment"


class Workers(Service):
    """A service whose twin is computed by processes."""

    program = HERE / "worker_twins.py"


@dataclass
class Outcome:
    """What became of the schedules."""

    schedules: int = 0
    kills: int = 0
    windows: int = 0
    decisions: int = 0
    faults: list[str] = field(default_factory=list)


def attack(count: int, seed: int, folder: Path, say: Callable[[str], None]) -> Outcome:
    """So many schedules, each from its own seed."""
    outcome = Outcome()
    recordings = {a: write_recording(folder / f"{a}.mcap", WINDOWS, asset=a, seed=i) for i, a in enumerate(ASSETS)}
    expected = {a: plain(assess(path, twin=fake_twin.TWIN))["windows"] for a, path in recordings.items()}
    for number in range(seed, seed + count):
        data = folder / f"schedule {number}"
        try:
            _schedule(random.Random(number), data, recordings, expected, outcome)
        except AssertionError as error:
            outcome.faults.append(f"seed {number}: {error}")
        outcome.schedules += 1
        say(f"seed {number}: {outcome.kills} kills, {outcome.windows} windows, faults: {outcome.faults or 'none'}")
    return outcome


def _schedule(
    draw: random.Random, data: Path, recordings: dict[str, Path], expected: dict[str, Any], outcome: Outcome
) -> None:
    slow, workers = draw.choice((0.0, 0.05, 0.2)), draw.choice((0, 1, 2))
    running = Workers(data, slow=slow, WORKERS=str(workers), IDLE_TIMEOUT=SILENCE)
    running.start()
    survives = draw.random() < 0.5
    publishers = [_publisher(path, running) for path in recordings.values()]
    submitted = 0
    try:
        for _ in range(draw.randint(1, 4)):
            time.sleep(draw.uniform(0.0, 2.5))
            if draw.random() < 0.3 and running.get("/v1/assets/a"):
                submitted += _decided(running)
            running.end(draw.choice((signal.SIGKILL, signal.SIGKILL, signal.SIGTERM)))
            outcome.kills += 1
            if not survives:
                for publisher in publishers:
                    publisher.kill()
            before = _acknowledged(data)
            assert "Traceback" not in running.said()[1], running.said()[1]
            running.start()
            after = {a: {w["start_time"]: w for w in running.windows(a)} for a in ASSETS}
            wait_until(lambda: _waiting(data) == 0 or survives, 60.0)
            _demand_kept(running, before, after)
        for publisher, path in zip(publishers, recordings.values(), strict=True):
            if publisher.wait(120):  # killed, or it has said that it could not deliver all: sent again
                assert _publisher(path, running).wait(120) == 0, f"{path.name} could not be delivered"
        for asset in ASSETS:
            wait_until(lambda asset=asset: len(running.windows(asset)) >= WINDOWS, 60.0)
            found = [_comparable(w) for w in running.windows(asset)]
            wanted = [_comparable(w) for w in expected[asset]]
            assert found == wanted, f"{asset} ends otherwise than undisturbed: {_difference(found, wanted)}"
            outcome.windows += len(found)
        wait_until(lambda: _decisions(data)[1] == 0, 60.0)
        done, _, noted = _decisions(data)
        assert done == submitted and noted in (0, done), f"{submitted} decisions, {done} done, {noted} noted"
        outcome.decisions += done
    finally:
        for publisher in publishers:
            publisher.kill()
        running.end(signal.SIGKILL)


def _publisher(path: Path, running: Service) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "service", "replay", str(path), "--connect", running.endpoint, "--speed", "0"]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _decided(running: Service) -> int:
    """Submits a decision; 1 where the service has taken it."""
    try:
        return int(post(running, DECISION, {"decision": "pin"})[0] in (200, 202))
    except OSError:
        return 0


def _acknowledged(data: Path) -> dict[str, set[int]]:
    """Start of every window that is committed or waits, by asset [ns]; of a service that has ended."""
    found: dict[str, set[int]] = {asset: set() for asset in ASSETS}
    with sqlite3.connect(data / DATABASE) as db:
        for rows in ("windows", "jobs WHERE kind = 'window'"):
            for asset, start in db.execute(f"SELECT asset, start_ns FROM {rows}"):
                found[asset].add(start)
    db.close()
    return found


def _waiting(data: Path) -> int:
    with sqlite3.connect(data / DATABASE) as db:
        (count,) = db.execute("SELECT COUNT(*) FROM jobs WHERE kind = 'window'").fetchone()
    db.close()
    return int(count)


def _decisions(data: Path) -> tuple[int, int, int]:
    """Decisions that are done, those that wait, and the events that tell of them."""
    with sqlite3.connect(data / DATABASE) as db:
        query = "SELECT COUNT(*) FROM jobs WHERE kind = 'decision' AND done = ? AND refused IS NULL"
        done, waits = (db.execute(query, (flag,)).fetchone()[0] for flag in (True, False))
        noted = db.execute("SELECT COUNT(*) FROM events WHERE kind = 'effect'").fetchone()[0]
    db.close()
    return done, waits, noted


def _demand_kept(running: Service, before: dict[str, set[int]], after: dict[str, dict[str, Any]]) -> None:
    """What had been acknowledged is there, in the end, and what had been shown is what it was."""
    for asset, starts in before.items():
        wait_until(lambda asset=asset, starts=starts: len(running.windows(asset)) >= len(starts), 60.0)
        found = running.windows(asset)
        windows = {w["start_time"]: w for w in found}
        assert len(windows) == len(found), f"{asset}: a window is counted twice"
        for start, window in after[asset].items():
            assert windows.get(start) == window, f"{asset}: the window of {start} has changed"


def _difference(found: list[str], wanted: list[str]) -> str:
    """The first window that differs."""
    if len(found) != len(wanted):
        return f"{len(found)} windows, not {len(wanted)}"
    place = next(i for i, pair in enumerate(zip(found, wanted, strict=True)) if pair[0] != pair[1])
    mine, other = json.loads(found[place]), json.loads(wanted[place])
    return f"window {place}: " + ", ".join(
        f"{key} = {mine.get(key)!r:.200}, not {other.get(key)!r:.200}"
        for key in mine
        if mine.get(key) != other.get(key)
    )


def _comparable(window: dict[str, Any]) -> str:
    return json.dumps({key: value for key, value in window.items() if key != "pid"}, sort_keys=True)
