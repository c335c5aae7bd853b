"""Kills in a fleet at moments drawn from a seed: no acknowledged window is lost, and none is counted twice.

One fleet of many assets goes through all schedules. In each, every asset sends some windows more while processes that
receive or compute, hosts, nodes, the head of the engine, the database's server and the router are killed, or a process
that receives is suspended until its partition has been taken by another and then let go on; half of the publishers are
killed as well, and begin again. In the end every asset's windows are those of a plain loop over all frames, bit for
bit.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fake_twin
import numpy as np
import psutil
import sqlalchemy as sa
from fleet_up import FleetProcess
from postgresql_server import PostgresqlServer
from ray_nodes import RayNodes
from service_streams import FRAME_S, PAUSE_S, PER_REV, RIG, ROOT, WINDOW_S, _frames, free_port, wait_until

from service.files.rig import checked_rig
from service.fleet.census import Census, census
from service.fleet.databases import engine_of, front_tables
from service.fleet.layout import Layout, partition_of
from service.json_text import plain
from service.results.database import Database
from service.results.roles import Roles
from service.results.sql_store import SqlStore
from service.results.window_jobs import WindowJobs
from service.runtime.pipeline import Pipeline
from service.stream.frames import NS
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode

KINDS = ("ingest", "work", "host", "node", "head", "database", "router", "suspended")
BEGIN_NS = 1_700_000_000 * NS
SETTLED_WITHIN = 180.0  # a schedule's windows [s]
SILENCE = 5.0  # that ends a window: longer than a publisher that was killed takes to go on, on crowded cores [s]


@dataclass
class Outcome:
    """What became of the schedules."""

    schedules: int = 0
    windows: int = 0
    done: dict[str, int] = field(default_factory=dict)  # faults by kind
    recovery: dict[str, list[float]] = field(default_factory=dict)  # by kind, until all was served again [s]
    faults: list[str] = field(default_factory=list)


class _Loop:
    """The plain loop: one pipeline of all assets in this process."""

    def __init__(self) -> None:
        self.records: dict[str, list[Any]] = {}
        text = _rig_text().decode()
        import tomllib

        rig = checked_rig(tomllib.loads(text), "the rig of the tests")
        self._pipeline = Pipeline(lambda asset: rig, fake_twin.TWIN, self)

    def commit(self, outcome: Any) -> bool:
        self.records.setdefault(outcome.asset, []).append(plain(outcome.record))
        return True

    def publish(self, outcome: Any) -> None:
        """Nobody watches."""

    def take(self, recording: Path) -> None:
        with Recording(recording) as opened:
            for frame in opened.frames(lambda channel, error: None):
                self._pipeline.feed(frame)
        self._pipeline.flush()


def _rig_text() -> bytes:
    text = RIG.read_bytes()
    for stated in (b"pinion_edges_per_rev = 1024", b"gear_edges_per_rev = 2048"):
        text = text.replace(stated, stated.partition(b"=")[0] + b"= %d" % PER_REV)
    return text


def _write(path: Path, assets: list[str], first: int, windows: int, seed: int) -> Path:
    """Windows of several assets, by the number of the first one."""
    rng, frames = np.random.default_rng(seed), round(WINDOW_S / FRAME_S)
    with RecordingWriter(path, rig_text=_rig_text()) as writer:
        for window in range(first, first + windows):
            start = BEGIN_NS + round(window * PAUSE_S * NS)
            for f in range(frames):
                at = start + round(f * FRAME_S * NS)
                for asset in assets:
                    for frame in _frames(asset, at, window * frames + f, 10 + window % 50, rng, window):
                        writer.write(frame.channel, at + round(FRAME_S * NS), encode(frame))
    return path


class Plant:
    """A fleet with its database and router, all of which can be killed."""

    def __init__(self, folder: Path, server: PostgresqlServer, url: str, partitions: int, nodes: int, slow: float):
        self.folder, self.server, self.partitions = folder, server, partitions
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.url, self.layout = url, Layout(partitions)
        self._router: subprocess.Popen | None = None
        os.environ["FAKE_TWIN_SECONDS"] = str(slow)
        self.nodes, self._count = RayNodes(folder / "ray"), nodes
        os.environ.update(self.nodes.environment)
        self.fleet = FleetProcess(
            folder / "fleet", url, "worker_twins", WORKERS="2", CONNECT=f'["{self.endpoint}"]',
            FLEET_PARTITIONS=str(partitions), FLEET_ADDRESS=self.nodes.address, IDLE_TIMEOUT=str(SILENCE),
        )  # fmt: skip
        self.tables = engine_of(url, poolclass=sa.NullPool)
        self.database = Database(front_tables(url, self.layout))
        self.roles = Roles(self.database)

    def __enter__(self) -> Plant:
        self.route()
        self.start_engine()
        wait_until(lambda: not self.census().not_served, 120)
        return self

    def __exit__(self, *_: object) -> None:
        self.fleet.end()
        self.database.close()
        self.nodes.__exit__()
        self.unroute()

    def start_engine(self) -> None:
        """Starts head and nodes of the engine, and `fleet up`."""
        self.nodes.start_head()
        self.add_nodes()
        self.fleet.start()

    def add_nodes(self) -> None:
        """Starts the nodes that are not there."""
        for name in {f"node-{number}" for number in range(self._count)} - set(self.nodes.processes):
            self.nodes.add(name)

    def census(self) -> Census:
        return census(self.roles)

    def route(self) -> None:
        code = (
            "import time; from service.transport.zenoh_session import open_session\n"
            f"with open_session(listen=[{self.endpoint!r}]): print('up', flush=True); time.sleep(1e6)"
        )
        self._router = subprocess.Popen(
            [sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(ROOT)}
        )
        assert self._router.stdout is not None
        self._router.stdout.readline()

    def unroute(self) -> None:
        assert self._router is not None and self._router.stdout is not None
        self._router.kill()
        self._router.wait()
        self._router.stdout.close()

    def ingest(self, partition: int) -> psutil.Process:
        """The process that receives the frames of a partition."""
        return psutil.Process(int((self.census().partitions[partition]["worker"] or ":0").rpartition(":")[2]))


def attack(
    count: int, seed: int, folder: Path, say: Callable[[str], None], *, assets: int = 200, partitions: int = 4,
    nodes: int = 2, windows: int = 2, slow: float = 0.0, kinds: tuple[str, ...] = KINDS,
) -> Outcome:  # fmt: skip
    """So many schedules, each from its own seed."""
    outcome, loop = Outcome(), _Loop()
    names = [f"gb-{number}" for number in range(assets)]
    with (
        PostgresqlServer() as server,
        server.new_database() as url,
        Plant(folder, server, url, partitions, nodes, slow) as plant,
    ):
        for number in range(count):
            draw = random.Random(seed + number)
            try:
                _schedule(draw, plant, loop, names, number * windows, windows, outcome, kinds)
            except AssertionError as error:
                outcome.faults.append(f"seed {seed + number}: {error}")
                break
            outcome.schedules += 1
            say(f"seed {seed + number}: {outcome.done}, {outcome.windows} windows")
    return outcome


def _schedule(
    draw: random.Random, plant: Plant, loop: _Loop, names: list[str], first: int, windows: int, outcome: Outcome,
    kinds: tuple[str, ...],
) -> None:  # fmt: skip
    recordings = {}
    for partition in plant.layout.all:
        own = [name for name in names if partition_of(name, plant.partitions) == partition]
        path = plant.folder / f"partition-{partition}.mcap"
        recordings[partition] = _write(path, own, first, windows, draw.randrange(2**31))
        loop.take(path)
    with ExitStack() as stack:
        publishers = {p: _Publisher(plant, p, path) for p, path in recordings.items()}
        for publisher in publishers.values():
            stack.callback(publisher.kill)
        chosen = [draw.choice(kinds) for _ in range(draw.choice((1, 1, 2)))]
        for kind in chosen:
            time.sleep(draw.uniform(0.0, 6.0))
            if draw.random() < 0.25:
                publishers[draw.randrange(plant.partitions)].again()
            begun = time.monotonic()
            before = [row["token"] for row in plant.census().partitions]
            FAULTS[kind](draw, plant, stack)
            outcome.done[kind] = outcome.done.get(kind, 0) + 1
            if kind in ("ingest", "host", "node", "head"):
                _await_recovery(plant, before, kind)
                outcome.recovery.setdefault(kind, []).append(round(time.monotonic() - begun, 1))
        for publisher in publishers.values():
            publisher.ended()
        _compare(plant, loop, names, outcome, (first + windows) * len(names))


def _await_recovery(plant: Plant, before: list[int], kind: str) -> None:
    """Until all partitions are served and somebody new has one of them."""

    def recovered() -> bool:
        found = plant.census()
        pairs = zip(found.partitions, before, strict=True)
        return not found.not_served and any(row["token"] > was for row, was in pairs)

    wait_until(recovered, SETTLED_WITHIN)


class _Publisher:
    """`gear-twin replay` of one partition's recording."""

    def __init__(self, plant: Plant, partition: int, path: Path) -> None:
        self._plant, self._partition, self._path = plant, partition, path
        self._process = self._ready()
        self._go()

    def again(self) -> None:
        """Killed, and begun again well within the silence that ends a window: by a process that is ready before."""
        other = self._ready()
        self.kill()
        self._process = other
        self._go()

    def ended(self) -> None:
        out, err = self._process.communicate(timeout=2 * SETTLED_WITHIN)
        assert self._process.returncode == 0, f"the publisher of partition {self._partition} said: {out} {err}"

    def kill(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()

    def _ready(self) -> subprocess.Popen:
        """A process that publishes as soon as it is told to."""
        prefix = self._plant.layout.prefix_of(self._partition)
        code = (
            "import sys; from service.runtime.replay import replay\n"
            "print('ready', flush=True); sys.stdin.readline()\n"
            f"print(replay({str(self._path)!r}, [{self._plant.endpoint!r}], 8.0, max_pause=2.0, prefix={prefix!r}, "
            "recorded='gearbox', wait=150.0, on_fault=lambda line: print(line, file=sys.stderr)))"
        )
        process = subprocess.Popen(
            [sys.executable, "-c", code], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        return process

    def _go(self) -> None:
        assert self._process.stdin is not None
        print(file=self._process.stdin, flush=True)


def _records(store: SqlStore, name: str) -> list[dict[str, Any]]:
    """The records of an asset's windows, without the process that has made each."""
    return [
        {key: value for key, value in plain(window.record).items() if key != "pid"}
        for window in store.windows(name, limit=10_000)
    ]


def _differing(store: SqlStore, loop: _Loop, names: list[str], layout: Layout) -> dict[str, dict[str, Any]]:
    """What is known of the assets whose windows are not as many as those of the plain loop: for the message."""
    waiting, found = WindowJobs(store.database).all_waiting(), {}
    for name in names:
        stored, expected = store.asset(name), loop.records[name]
        records = _records(store, name)
        if len(records) == len(expected):
            continue
        begun = {record["start_time"] for record in expected}
        same = next((i for i, pair in enumerate(zip(records, expected, strict=False)) if pair[0] != pair[1]), 0)
        found[name] = {
            "partition": layout.partition_of(name), "windows": f"{len(records)} of {len(expected)}",
            "begin elsewhere": [r["start_time"] for r in records if r["start_time"] not in begun],
            "first that differs": records[same : same + 2], "as it should be": expected[same : same + 1],
            "waiting": len(waiting.get(name, ())), "question": stored.question,
            **{key: (stored.assembly or {}).get(key) for key in ("last_frames", "left_out", "counters")},
        }  # fmt: skip
    return found


def _compare(plant: Plant, loop: _Loop, names: list[str], outcome: Outcome, total: int) -> None:
    """Waits until as many windows are committed as the plain loop has, and compares all of them."""

    def committed() -> int:
        with plant.tables.connect() as db:
            return int(db.exec_driver_sql("SELECT count(*) FROM windows").scalar_one())

    end = time.monotonic() + SETTLED_WITHIN
    with SqlStore(front_tables(plant.url, plant.layout)) as store:
        while (found := committed()) < total:
            assert time.monotonic() < end, (
                f"{found} of {total} windows after {SETTLED_WITHIN:g} s: {_differing(store, loop, names, plant.layout)}"
            )
            time.sleep(0.2)
        assert found == total, f"{found} windows in place of {total}: {_differing(store, loop, names, plant.layout)}"
        for name in names:
            records = _records(store, name)
            assert records == loop.records[name], f"{name} is not as by the plain loop"
            state = store.asset(name)
            assert state.question is None, f"{name}: people are asked {state.question}"
            assert state.windows == len(records), f"{name} counts {state.windows} of {len(records)} windows"
    outcome.windows = total


# -- faults --------------------------------------------------------------------------------------------


def _kill_ingest(draw: random.Random, plant: Plant, stack: ExitStack) -> None:
    with suppress(psutil.Error):
        plant.ingest(draw.randrange(plant.partitions)).kill()


def _kill_work(draw: random.Random, plant: Plant, stack: ExitStack) -> None:
    """A process that computes, or the one that has forked it."""
    with suppress(psutil.Error):
        host = plant.ingest(draw.randrange(plant.partitions)).parent()
        every = [] if host is None else host.children(recursive=True)
        draw.choice(sorted((p for p in every if p.name() == "work"), key=lambda p: p.pid)).kill()


def _kill_host(draw: random.Random, plant: Plant, stack: ExitStack) -> None:
    """The supervisor of a host, with which all of it ends."""
    with suppress(psutil.Error):
        host = plant.ingest(draw.randrange(plant.partitions)).parent()
        if host is not None:
            host.kill()


def _kill_node(draw: random.Random, plant: Plant, stack: ExitStack) -> None:
    """A node with all that runs on it, as where a machine's power goes."""
    plant.add_nodes()
    plant.nodes.kill(draw.choice([name for name in plant.nodes.processes if name != "head"]))


def _kill_head(draw: random.Random, plant: Plant, stack: ExitStack) -> None:
    """The head, without which nodes and `fleet up` end; their supervisors start all of them again."""
    plant.nodes.kill("head")
    assert plant.fleet.process is not None and plant.fleet.process.wait(SETTLED_WITHIN)
    for name in list(plant.nodes.processes):
        plant.nodes.processes[name].wait(SETTLED_WITHIN)
        plant.nodes.kill(name)
    plant.start_engine()


def _kill_database(draw: random.Random, plant: Plant, stack: ExitStack) -> None:
    plant.server.kill()
    time.sleep(draw.uniform(0.5, 3.0))
    wait_until(lambda: _starts(plant.server), 30)


def _starts(server: PostgresqlServer) -> bool:
    try:
        server.start()
    except AssertionError:
        return False
    return True


def _kill_router(draw: random.Random, plant: Plant, stack: ExitStack) -> None:
    plant.unroute()
    time.sleep(draw.uniform(0.2, 3.0))
    plant.route()


def _suspend(draw: random.Random, plant: Plant, stack: ExitStack) -> None:
    """A process that is suspended while somebody else takes its partition, and then goes on."""
    partition = draw.randrange(plant.partitions)
    with suppress(psutil.Error):
        process = plant.ingest(partition)
        process.suspend()
        with _taken(plant, partition):
            time.sleep(draw.uniform(0.0, 2.0))
            with suppress(psutil.Error):
                process.resume()
            time.sleep(1.0)
    wait_until(lambda: not plant.census().not_served, SETTLED_WITHIN)


@contextmanager
def _taken(plant: Plant, partition: int) -> Iterator[None]:
    """Another process serves a partition for a while."""
    from fleet_partition import PartitionProcess

    settings = plant.fleet.given
    other = PartitionProcess(
        plant.folder / f"other-{time.monotonic_ns()}", plant.url, plant.endpoint, partition=partition,
        partitions=plant.partitions, **{k: v for k, v in settings.items() if k not in ("CONNECT", "DATABASE")},
    )  # fmt: skip
    with suppress(AssertionError):  # a supervisor that had started another one meanwhile has it
        other.start()
    try:
        yield
    finally:
        other.end(signal.SIGKILL)


FAULTS: dict[str, Callable[[random.Random, Plant, ExitStack], None]] = {
    "ingest": _kill_ingest,
    "work": _kill_work,
    "host": _kill_host,
    "node": _kill_node,
    "head": _kill_head,
    "database": _kill_database,
    "router": _kill_router,
    "suspended": _suspend,
}
