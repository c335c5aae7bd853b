"""What a fleet costs beside one process: processor times a window, memory and start-up.

    python -m benchmarks.bench_fleet [--assets 3] [--rounds 2]

The same windows of the twin itself, wear alone, go through three systems in turn: a plain loop in one process, without
a store and with SQLite; `gear-twin serve` over SQLite; and `gear-twin fleet` over PostgreSQL, on a cluster of its own.
Service and fleet are given theirs by the same publishers through the same router. One asset of each partition has
passed the whole campaign before, so that all curves are at hand. Ray's processes, the database's server, and
publishers with the router are counted apart. Processor times are of whole trees of processes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from benchmarks.bench_pipeline import Figure
from benchmarks.fleet_plant import (
    ROOT,
    SETTLED_WITHIN,
    WINDOWS,
    Plant,
    campaign,
    ended,
    many,
    memory_by,
    names_of,
    postgresql,
    program,
    publisher,
    router,
    spent_by,
    wait_until,
)
from service.fleet.layout import prefix_of
from service.runtime.demo import free_port
from service.stream.wire.topics import PREFIX

PARTITIONS, NODES = 2, 1
AIM, LIMIT = 0.10, 0.25  # of the overhead
SETTLE = 3.0  # after the last window [s]
IDLE = 20.0  # without a frame [s]

LOOP = """
import sys
from benchmarks.bench_fleet import loop
loop(sys.argv[1], sys.argv[2:])
"""


class _Sink:
    """Where the plain loop's windows go: into SQLite, or nowhere."""

    def __init__(self, store: Any) -> None:
        self._store, self.count = store, 0

    def commit(self, outcome: Any) -> bool:
        self.count += 1
        if self._store is not None:
            self._store.commit(
                outcome.asset, outcome.window.start_time_ns, record=outcome.record, state=outcome.state.to_dict(),
                report=outcome.report, assembly=outcome.assembly, quality=outcome.quality, received_ns=time.time_ns(),
                events=outcome.events,
            )  # fmt: skip
        return True

    def publish(self, outcome: Any) -> None:
        """Nobody watches."""


def loop(database: str, recordings: list[str]) -> None:
    """Takes recordings through the pipeline, the first one to warm up; prints what each of the others took [s]."""
    from service.results.sql_store import SqlStore
    from service.runtime.assess import rig_of
    from service.runtime.pipeline import Pipeline
    from service.runtime.twin_port import gear_twin
    from service.stream.sources.mcap import Recording
    from twin.options import Options

    store = SqlStore(Path(database)) if database else None
    with Recording(recordings[0]) as recording:
        rig = rig_of(recording, None)
    sink = _Sink(store)
    pipeline = Pipeline(lambda asset: rig, gear_twin(Options(trace=False)), sink)
    found = []
    for path in recordings:
        begun, before = time.process_time(), sink.count
        with Recording(path) as recording:
            for frame in recording.frames(lambda channel, error: None):
                pipeline.feed(frame)
        pipeline.flush()
        found.append((time.process_time() - begun, sink.count - before))
    if store is not None:
        store.close()
    print(json.dumps(found[1:]))


class _Service:
    """`gear-twin serve` over SQLite."""

    def __init__(self, folder: Path, endpoint: str) -> None:
        folder.mkdir()
        self._folder, self._endpoint = folder, endpoint
        self._said = folder / "serve.txt"
        self._process = program(
            "-m", "service", "serve", said=self._said, DATA=str(folder / "data"), CONNECT=json.dumps([endpoint]),
            HTTP=f"127.0.0.1:{free_port(range(22000, 23000))}", NEW_ASSETS="adopt", TRACE="false", WORKERS="1",
            IDLE_TIMEOUT="2",
        )  # fmt: skip

    def await_start(self) -> None:
        wait_until(lambda: "http" in self._said.read_text(), 60, "the service")

    @property
    def pid(self) -> int:
        return self._process.pid

    def end(self) -> None:
        ended(self._process)

    def spent(self) -> dict[str, float]:
        """Processor time by group of processes."""
        return spent_by(self.pid, _group)

    def windows(self) -> int:
        """How many are committed."""
        import sqlite3

        path = next((self._folder / "data").glob("gear-twin.sqlite"))
        db = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
        try:
            return int(db.execute("SELECT count(*) FROM windows").fetchone()[0])
        finally:
            db.close()


def _group(process: Any, top: int) -> str:
    return "service" if process.pid == top else "computing"


def _publish(recordings: Mapping[int, Path], endpoint: str, prefix: Callable[[int], str], folder: Path) -> float:
    """Publishes until all is stored; the processor time of the publishers [s]."""
    running = [
        publisher(path, endpoint, prefix(partition), folder / f"publisher-{partition}.txt")
        for partition, path in recordings.items()
    ]
    used = 0.0
    for process in running:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise RuntimeError(f"a publisher failed: see {folder}")
        used += usage.ru_utime + usage.ru_stime
    return used


def _since(now: Mapping[str, float], before: Mapping[str, float]) -> Counter[str]:
    return Counter({name: value - before.get(name, 0.0) for name, value in now.items()})


class Run:
    """All systems side by side, and what each has spent."""

    def __init__(self, folder: Path, assets: int, rounds: int) -> None:
        self.folder, self._assets, self._rounds = folder, assets, rounds
        source = campaign()
        self.recordings: list[dict[int, Path]] = []  # by round, the first to warm up
        for number in range(rounds + 1):
            count, begin = (1, "warm") if number == 0 else (assets, f"round{number}")
            self.recordings.append(
                {
                    p: many(source, folder / f"{begin}-{p}.mcap", names_of(p, PARTITIONS, count, begin))
                    for p in range(PARTITIONS)
                }
            )
        self.windows = rounds * assets * PARTITIONS * WINDOWS
        self.loop: dict[str, float] = {}
        self.service: Counter[str] = Counter()
        self.fleet: Counter[str] = Counter()
        self.idle: dict[str, float] = {}  # of a second
        self.memory: dict[str, tuple[int, int, int]] = {}
        self.service_memory: dict[str, tuple[int, int, int]] = {}
        self.started: dict[str, float] = {}
        self.rate = 0.0  # windows a second of the fleet

    def loops(self) -> None:
        """The plain loop, without and with a store."""
        for name, database in (("no store", ""), ("SQLite", str(self.folder / "loop.sqlite"))):
            paths = [str(path) for each in self.recordings for path in each.values()]
            paths = [paths[0], *paths[PARTITIONS:]]
            said = subprocess.check_output([sys.executable, "-c", LOOP, database, *paths], cwd=ROOT)
            found = json.loads(said)
            assert sum(count for _, count in found) == self.windows, found
            self.loop[name] = sum(taken for taken, _ in found)

    def all(self) -> None:
        """Everything."""
        self.loops()
        with ExitStack() as stack:
            endpoint, router_pid = stack.enter_context(router(self.folder))
            url, server, _ = stack.enter_context(postgresql())
            service = _Service(self.folder / "serve", endpoint)
            stack.callback(service.end)
            service.await_start()
            plant = stack.enter_context(Plant(self.folder / "fleet", url, endpoint, PARTITIONS, NODES))
            self.started = plant.started
            count = 0
            for number, recordings in enumerate(self.recordings):
                count += WINDOWS * PARTITIONS * (1 if number == 0 else self._assets)
                with self._counted(self.service, number, service.spent, router_pid) as used:
                    used["publishers"] = _publish(recordings, endpoint, lambda p: PREFIX, self.folder)
                    wait_until(lambda c=count: service.windows() >= c, SETTLED_WITHIN, "the service's windows")

                def fleet_spent() -> dict[str, float]:
                    return {**plant.spent().groups, "server": server()}

                begun = time.monotonic()
                with self._counted(self.fleet, number, fleet_spent, router_pid) as used:
                    used["publishers"] = _publish(recordings, endpoint, prefix_of, self.folder)
                    plant.await_windows(count)
                    taken = time.monotonic() - begun
                self.rate = PARTITIONS * self._assets * WINDOWS / taken
            before = fleet_spent() | {"service": service.spent()["service"]}
            time.sleep(IDLE)
            now = fleet_spent() | {"service": service.spent()["service"]}
            self.idle = {name: value / IDLE for name, value in _since(now, before).items()}
            from benchmarks.fleet_plant import group_of

            self.memory = memory_by(plant.pid, group_of)
            self.service_memory = memory_by(service.pid, _group)

    @contextmanager
    def _counted(
        self, into: Counter[str], number: int, spent: Callable[[], dict[str, float]], router_pid: int
    ) -> Iterator[dict[str, float]]:
        """Counts what is spent inside, but in the round that warms up."""
        own = {"publishers": 0.0}
        before, before_router = spent(), spent_by(router_pid, lambda process, top: "router")
        yield own
        time.sleep(SETTLE)
        used = _since(spent(), before) + _since(spent_by(router_pid, lambda p, top: "router"), before_router)
        if number:
            for name, value in (*used.items(), *own.items()):
                into[name] += value


def main(assets: int = 3, rounds: int = 2) -> list[Figure]:
    """Prints all figures; answers them."""
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(prefix="gear-twin-bench-") as made:
        run = Run(Path(made), assets, rounds)
        run.all()
    for name in ("loop", "service", "fleet", "idle", "memory", "service_memory", "started", "rate", "windows"):
        print(name, getattr(run, name))
    ms = 1e3 / run.windows
    print({k: ms * v for k, v in run.loop.items()}, {k: ms * v for k, v in run.service.items()}, {k: ms * v for k, v in run.fleet.items()}, load)
    return []


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_fleet", description=__doc__)
    parser.add_argument("--assets", type=int, default=3, help="assets of each partition in a round")
    parser.add_argument("--rounds", type=int, default=2, help="rounds that are measured")
    chosen = parser.parse_args()
    main(chosen.assets, chosen.rounds)
