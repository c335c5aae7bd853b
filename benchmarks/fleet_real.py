"""A real fleet under a stated load, for comparison with the model: the tests' twin, which sleeps for a stated time.

Windows of an asset come at a stated period, those of different assets one after the other. When results are committed
is the database's own account (`track_commit_timestamp`).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from benchmarks.fleet_model import Array
from benchmarks.fleet_plant import (
    SETTLED_WITHIN,
    TESTS,
    Plant,
    Spent,
    killed,
    postgresql,
    program,
    router,
    tree,
    wait_until,
)
from service.fleet.layout import partition_of
from service.stream.frames import NS
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode

STEP = 0.02  # of the twin [s]
PARTITIONS, NODES = 4, 2
IDLE_TIMEOUT = 0.7  # [s]
COMMITS = 100  # that are timed
SPUN, SPIN_EVERY = 0.05, 2.0  # processor time that is timed by the wall clock, and how often [s]
BEGIN_NS = 1_700_000_000 * NS
APART_NS = 86_400 * NS  # between the windows of two runs

PUBLISHER = """
import json, os, sys, time
from service.runtime.delivery import Delivery
from service.runtime.replay import paced
from service.stream.sources.mcap import Recording
from service.transport.zenoh import open_publisher
path, endpoint, prefix, out = sys.argv[1:]
sent = {}
with Recording(path, "gearbox") as recording, open_publisher([endpoint], prefix, 60.0) as publisher:
    for name in recording.assets:
        publisher.offer_rig(name, recording.rig_text)
    publisher.declare(sorted(set(recording.channels.values())))
    delivery = Delivery(publisher, wait=150.0)
    delivery.begin(recording.assets)
    for frame in paced(recording.messages(), 1.0):
        sent.setdefault(frame.channel.asset, {})[frame.log_time_ns] = time.time()
        delivery.send(frame)
    delivery.finish()
    with open(out + ".part", "w") as file:
        json.dump(sent, file)
    os.rename(out + ".part", out)
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """What is asked of the fleet."""

    assets: int
    period: float  # [s]
    windows: int  # of each asset
    lose_at: float | None = None  # when a node is killed [s]

    @property
    def seconds(self) -> float:
        return self.period * self.windows


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What a run has shown."""

    lags: Array  # of results behind windows, before any loss [s]
    windows: int  # and what follows, before any loss
    seconds: float
    spent: dict[str, float]  # processor time by group [s]
    written: dict[str, float]  # by the database: transactions, bytes of its log
    slower: float  # than a processor of its own
    served: float = 0.0  # after a loss, until the last partition is served [s]
    drained: float = 0.0  # after a loss, until nothing waits that came before it was served [s]


class Slower(threading.Thread):
    """How many times longer processor time takes by the wall clock: others use the machine as well."""

    def __init__(self) -> None:
        super().__init__(name="slower", daemon=True)
        self._stopping, self._wall, self._processor = threading.Event(), 0.0, 0.0
        self.start()

    def run(self) -> None:
        """Spins now and then."""
        while not self._stopping.wait(SPIN_EVERY):
            begun, processor = time.monotonic(), time.thread_time()
            while time.thread_time() - processor < SPUN:
                sum(range(1000))
            self._wall += time.monotonic() - begun
            self._processor += time.thread_time() - processor

    def end(self) -> float:
        """Ends the thread; the mean ratio."""
        self._stopping.set()
        self.join()
        return max(1.0, self._wall / self._processor) if self._processor else 1.0


@contextmanager
def fleet(folder: Path, step: float = STEP) -> Iterator[RealFleet]:
    """A fleet with its database, whose commits reach the disk."""
    os.environ["FAKE_TWIN_SECONDS"] = str(step)
    with (
        router(folder) as (endpoint, _),
        postgresql(durable=True) as (url, _, _),
        Plant(
            folder / "fleet", url, endpoint, PARTITIONS, NODES, fake=True, WORKERS="0", IDLE_TIMEOUT=str(IDLE_TIMEOUT)
        ) as plant,
    ):
        yield RealFleet(plant, folder)


class RealFleet:
    """A fleet that runs, and loads one after the other."""

    def __init__(self, plant: Plant, folder: Path) -> None:
        self.plant, self._folder, self._runs, self._windows = plant, folder, 0, 0

    def idle(self, seconds: float) -> tuple[dict[str, float], dict[str, float]]:
        """Processor times and what is written in a second without frames."""
        spent, written = self.plant.spent(), self.plant.written()
        time.sleep(seconds)
        return (
            {name: value / seconds for name, value in self.plant.spent().since(spent).items()},
            {name: value / seconds for name, value in _since(self.plant.written(), written).items()},
        )

    def restart(self) -> tuple[float, float]:
        """Kills the worker of a partition: time until another one has it, and the processor time that this took [s]."""
        rows = self.plant.census().partitions
        tokens = [row["token"] for row in rows]
        begun = time.time()
        psutil.Process(_process_of(rows[0]["worker"])).kill()
        seconds = self._served({0}, tokens) - begun
        times = psutil.Process(_process_of(self.plant.census().partitions[0]["worker"])).cpu_times()
        return seconds, times.user + times.system

    def commit(self) -> float:
        """What the least transaction that writes takes, by the wall clock, the median [s]."""
        taken = []
        with self.plant.tables.connect() as db:
            db.exec_driver_sql("CREATE TABLE IF NOT EXISTS timed (number bigint)")
            db.commit()
            for number in range(COMMITS):
                begun = time.monotonic()
                db.exec_driver_sql(f"INSERT INTO timed VALUES ({number})")
                db.commit()
                taken.append(time.monotonic() - begun)
        return float(np.median(taken))

    def run(self, load: Load) -> Found:
        """Puts a load on the fleet until all its windows are committed."""
        self._runs += 1
        start_ns = BEGIN_NS + self._runs * APART_NS
        paths = {p: self._folder / f"run{self._runs}-{p}.mcap" for p in range(PARTITIONS)}
        for p, path in paths.items():
            self._write(path, load, p, start_ns)
        said = {p: self._folder / f"publisher{self._runs}-{p}.txt" for p in paths}
        sent = {p: self._folder / f"sent{self._runs}-{p}.json" for p in paths}
        watch, had = Slower(), self._windows
        spent, written, begun = self.plant.spent(), self.plant.written(), time.monotonic()
        before_loss, lost_at = None, None
        with ExitStack() as stack:
            running = []
            for p, path in paths.items():
                given = ("-c", PUBLISHER, str(path), self.plant.endpoint, self.plant.layout.prefix_of(p), str(sent[p]))
                running.append(program(*given, said=said[p]))
                stack.callback(killed, running[-1])
            if load.lose_at is not None:
                time.sleep(load.lose_at)
                before_loss = self._so_far(begun)
                tokens = [row["token"] for row in self.plant.census().partitions]
                lost_at = time.time()
                gone = self._kill_node()
                served = self._served(gone, tokens) - lost_at
            wait_until(lambda: _all_sent(running, sent.values()), SETTLED_WITHIN, "the publishers")
            self._windows += load.assets * load.windows
            self.plant.await_windows(self._windows)
        count, seconds, used, wrote = before_loss or self._so_far(begun)
        ended, committed = self._times(start_ns, {p: json.loads(path.read_text()) for p, path in sent.items()})
        before = np.ones(ended.size, bool) if lost_at is None else committed < lost_at
        recovery = {}
        if lost_at is not None:
            late = ended < lost_at + served
            recovery = {"served": served, "drained": float(np.max(committed[late])) - lost_at}
        return Found(
            lags=(committed - ended)[before], windows=count - had, seconds=seconds,
            spent=used.since(spent), written=_since(wrote, written), slower=watch.end(), **recovery,
        )  # fmt: skip

    def _so_far(self, begun: float) -> tuple[int, float, Spent, dict[str, float]]:
        """Windows that are committed, the time since the begin [s], what is spent and written."""
        return self.plant.windows(), time.monotonic() - begun, self.plant.spent(), self.plant.written()

    def _write(self, path: Path, load: Load, partition: int, start_ns: int) -> None:
        """The recording of a partition's assets, in the order of time."""
        sys.path.insert(0, str(TESTS))
        from service_streams import FRAME_S, RIG, WINDOW_S, _frames

        text = RIG.read_bytes()
        for stated in (b"pinion_edges_per_rev = 1024", b"gear_edges_per_rev = 2048"):
            text = text.replace(stated, stated.partition(b"=")[0] + b"= 64")
        frames = round(WINDOW_S / FRAME_S)
        due = []
        for number in range(load.assets):
            asset = f"run{self._runs}-{number}"
            if partition_of(asset, PARTITIONS) == partition:
                for window in range(load.windows):
                    at = load.period * (window + number / load.assets)
                    due += [(at + f * FRAME_S, asset, window, window * frames + f) for f in range(frames)]
        due.sort()
        rng = np.random.default_rng(partition)
        with RecordingWriter(path, rig_text=text) as writer:
            for at, asset, window, number in due:
                begin = start_ns + round(at * NS)
                for frame in _frames(asset, begin, number, 10 + window % 50, rng, window):
                    writer.write(frame.channel, begin + round(FRAME_S * NS), encode(frame))

    def _times(self, start_ns: int, sent: dict[int, dict[str, dict[str, float]]]) -> tuple[Array, Array]:
        """When the last frame of each window was sent, and when its results were committed, by the wall clock [s].

        Without the first window of each asset, which is held open for channels that nobody knows of.

        sent  by partition, asset, and the end of a frame by the recording's clock
        """
        from service_streams import FRAME_S, WINDOW_S

        ended, committed = [], []
        with self.plant.tables.connect() as db:
            for partition, assets in sent.items():
                rows = db.exec_driver_sql(
                    "SELECT asset, start_ns, extract(epoch FROM pg_xact_commit_timestamp(windows.xmin)) "
                    f"FROM windows JOIN assets USING (asset) WHERE share = {partition} "
                    f"AND number > 0 AND start_ns BETWEEN {start_ns} AND {start_ns + APART_NS // 2}"
                )
                for asset, start, at in rows:
                    until = start + round((WINDOW_S + FRAME_S / 2) * NS)
                    ended.append(max(when for end, when in assets[asset].items() if start < int(end) <= until))
                    committed.append(float(at))
        return np.array(ended), np.array(committed)

    def _kill_node(self) -> set[int]:
        """Kills a node with all that runs on it; the partitions that it served."""
        lost = {process.pid for process in tree(self.plant.nodes.processes["node-1"].pid)}
        rows = self.plant.census().partitions
        gone = {row["partition"] for row in rows if _process_of(row["worker"]) in lost}
        assert gone, f"no partition was on the node that was killed: {rows}"
        self.plant.nodes.kill("node-1")
        return gone

    def _served(self, gone: set[int], tokens: list[int]) -> float:
        """When the last of some partitions has been taken by another worker, by the wall clock [s]."""
        from service.fleet.census import partitions

        def taken() -> list[int]:
            found = [p for p in partitions(self.plant.roles) if p.number in gone and p.token > tokens[p.number]]
            return [partition.ingest.began_ns for partition in found if partition.ingest is not None]

        wait_until(lambda: len(taken()) == len(gone), SETTLED_WITHIN, "the partitions of the node")
        return max(taken()) / NS


def _all_sent(publishers: Iterable[subprocess.Popen[bytes]], files: Iterable[Path]) -> bool:
    if any(process.poll() not in (None, 0) for process in publishers):
        raise RuntimeError("a publisher has ended")
    return all(path.exists() for path in files)


def _process_of(worker: str | None) -> int:
    """The number of a worker's process, by what the partition's row says."""
    return int((worker or ":0").rpartition(":")[2])


def _since(now: dict[str, float], before: dict[str, float]) -> dict[str, float]:
    return {name: value - before[name] for name, value in now.items()}
