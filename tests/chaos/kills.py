"""Kills of a whole service at moments drawn from a seed: no acknowledged window is lost, and none is counted twice.

Each schedule sends the recordings of some assets to a service with worker processes, and kills it (SIGKILL, or SIGTERM)
at drawn moments while windows are received, wait, and are processed; people's decisions are submitted meanwhile. The
service is started again each time. In half of the schedules the publisher goes on through the kills; in the others it
is killed as well, and what was acknowledged by then must be there in the end without being sent again. After that all
is sent once more, and the end must be that of a service that nobody disturbed. With a server of PostgreSQL each
schedule has a database of its own there, and the server is restarted at once (`immediate`, as after a crash) at drawn
moments.
"""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fake_twin
import sqlalchemy as sa
from postgresql_server import PostgresqlServer
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
    server_restarts: int = 0
    windows: int = 0
    decisions: int = 0
    faults: list[str] = field(default_factory=list)


def attack(
    count: int, seed: int, folder: Path, say: Callable[[str], None], server: PostgresqlServer | None = None
) -> Outcome:
    """So many schedules, each from its own seed.

    server  where results are kept; None for a file of SQLite
    """
    outcome = Outcome()
    recordings = {a: write_recording(folder / f"{a}.mcap", WINDOWS, asset=a, seed=i) for i, a in enumerate(ASSETS)}
    expected = {a: plain(assess(path, twin=fake_twin.TWIN))["windows"] for a, path in recordings.items()}
    for number in range(seed, seed + count):
        data = folder / f"schedule {number}"
        try:
            _schedule(random.Random(number), data, recordings, expected, outcome, server)
        except AssertionError as error:
            outcome.faults.append(f"seed {number}: {error}")
        outcome.schedules += 1
        say(f"seed {number}: {outcome.kills} kills, {outcome.windows} windows, faults: {outcome.faults or 'none'}")
    return outcome


def _schedule(
    draw: random.Random, data: Path, recordings: dict[str, Path], expected: dict[str, Any], outcome: Outcome,
    server: PostgresqlServer | None,
) -> None:  # fmt: skip
    slow, workers = draw.choice((0.0, 0.05, 0.2)), draw.choice((0, 1, 2))
    with _database(data, server) as (given, db):
        running = Workers(data, slow=slow, WORKERS=str(workers), IDLE_TIMEOUT=SILENCE, **given)
        running.start()
        _killed(draw, running, db, recordings, expected, outcome, server)


@contextmanager
def _database(data: Path, server: PostgresqlServer | None) -> Iterator[tuple[dict[str, str], sa.Engine]]:
    """Settings of an empty database, and what reads it."""
    if server is None:
        yield {}, sa.create_engine(f"sqlite:///{data / DATABASE}", poolclass=sa.NullPool)
        return
    with server.new_database() as url:
        driver = url.replace("postgresql:", "postgresql+psycopg:")
        yield {"DATABASE": url}, sa.create_engine(driver, poolclass=sa.NullPool)


def _killed(
    draw: random.Random, running: Workers, db: sa.Engine, recordings: dict[str, Path], expected: dict[str, Any],
    outcome: Outcome, server: PostgresqlServer | None,
) -> None:  # fmt: skip
    survives = draw.random() < 0.5
    publishers = [_publisher(path, running) for path in recordings.values()]
    submitted = 0
    try:
        for _ in range(draw.randint(1, 4)):
            if decides := draw.random() < 0.5:  # on what a window has shown
                wait_until(lambda: running.windows("a") or publishers[0].poll() is not None, 60.0)
            time.sleep(draw.uniform(0.0, 2.5))
            if decides:
                submitted += _decided(running)
            if server is not None and draw.random() < 0.5:
                server.stop("immediate")
                time.sleep(draw.choice((0.0, 0.0, 1.0)))
                server.start()
                outcome.server_restarts += 1
                time.sleep(draw.uniform(0.0, 1.5))
            running.end(draw.choice((signal.SIGKILL, signal.SIGKILL, signal.SIGTERM)))
            outcome.kills += 1
            if not survives:
                for publisher in publishers:
                    publisher.kill()
            before = _acknowledged(db)
            assert "Traceback" not in running.said()[1], running.said()[1]
            running.start()
            after = {a: {w["start_time"]: w for w in running.windows(a)} for a in ASSETS}
            wait_until(lambda: _waiting(db) == 0 or survives, 60.0)
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
        wait_until(lambda: _decisions(db)[1] == 0, 60.0)
        done, _, noted = _decisions(db)
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


def _acknowledged(db: sa.Engine) -> dict[str, set[int]]:
    """Start of every window that is committed or waits, by asset [ns]; of a service that has ended."""
    found: dict[str, set[int]] = {asset: set() for asset in ASSETS}
    for rows in ("windows", "jobs WHERE kind = 'window'"):
        for asset, start in _rows(db, f"SELECT asset, start_ns FROM {rows}"):
            found[asset].add(start)
    return found


def _waiting(db: sa.Engine) -> int:
    ((count,),) = _rows(db, "SELECT COUNT(*) FROM jobs WHERE kind = 'window'")
    return int(count)


def _decisions(db: sa.Engine) -> tuple[int, int, int]:
    """Decisions that are done, those that wait, and the events that tell of them."""
    rows = _rows(db, "SELECT done, COUNT(*) FROM jobs WHERE kind = 'decision' AND refused IS NULL GROUP BY done")
    counts = {bool(done): count for done, count in rows}
    ((noted,),) = _rows(db, "SELECT COUNT(*) FROM events WHERE kind = 'effect'")
    return counts.get(True, 0), counts.get(False, 0), noted


def _rows(db: sa.Engine, query: str) -> list[Any]:
    with db.connect() as connection:
        return list(connection.exec_driver_sql(query).all())


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
