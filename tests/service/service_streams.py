"""Small recordings by the contract, and real service processes to replay them into."""

from __future__ import annotations

import itertools
import json
import os
import random
import signal
import time
import urllib.error
import urllib.request
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import numpy as np
from forked_processes import ForkedProcess, is_alive
from one_partition import Fleets, takes_frames

from service.fleet.databases import front_tables
from service.fleet.layout import Layout
from service.results.data_folder import DATABASE
from service.results.sql_store import SqlStore
from service.runtime.demo import free_port as first_free
from service.stream.frames import NS, EncoderFrame, SampleFrame
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode
from service.stream.wire.topics import PREFIX, Channel

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RATE, SPEED, PER_REV = 2000.0, 10.0, 64
FRAME_S, WINDOW_S, PAUSE_S = 0.25, 2.0, 60.0
RIG = ROOT / "recordings" / "rigs" / "unsw.toml"


def write_recording(
    path: Path,
    windows: int = 8,
    asset: str = "unsw",
    rig: Path | None = RIG,
    *,
    later: float = 0.0,
    seed: int = 7,
    changed: tuple[bytes, bytes] | None = None,
    prefix: str = PREFIX,
) -> Path:
    """A campaign of short windows, minutes apart, whose level differs from window to window.

    later    how much later than others it was recorded [s]; its revolutions begin at 0 all the same
    changed  what the rig file says instead of something else
    prefix   first part of its topics
    """
    rng = np.random.default_rng(seed)
    text = rig.read_bytes() if rig else None
    for stated in (b"pinion_edges_per_rev = 1024", b"gear_edges_per_rev = 2048"):
        text = text and text.replace(stated, stated.partition(b"=")[0] + b"= %d" % PER_REV)
    if changed is not None:
        assert text and changed[0] in text
        text = text.replace(*changed)
    with RecordingWriter(path, rig_text=text, metadata={"asset": asset}, prefix=prefix) as writer:
        for w in range(windows):
            start = 1_700_000_000 * NS + round((later + w * PAUSE_S) * NS)
            for f in range(round(WINDOW_S / FRAME_S)):
                at = start + round(f * FRAME_S * NS)
                number = w * round(WINDOW_S / FRAME_S) + f
                for frame in _frames(asset, at, number, 10 + w, rng, w):
                    writer.write(frame.channel, at + round(FRAME_S * NS), encode(frame))
    return path


def _frames(asset, at, number, level, rng, window):
    n = round(RATE * FRAME_S)
    for kind, name, values in (
        ("accel", "y6", level * rng.standard_normal(n)),
        ("torque", "pinion", 10 + 0.01 * rng.standard_normal(n)),
    ):
        yield SampleFrame(
            channel=Channel(asset, kind, name), start_time_ns=at, sequence=number, sample_rate=RATE,
            values=values.astype(np.float32),
        )  # fmt: skip
    for shaft, speed in (("pinion", SPEED), ("gear", SPEED * 19 / 52)):
        since = window * PAUSE_S + (number % round(WINDOW_S / FRAME_S)) * FRAME_S
        first = int(np.ceil(since * speed * PER_REV - 1e-9))
        last = int(np.ceil((since + FRAME_S) * speed * PER_REV - 1e-9))
        times = np.arange(first, last) / (speed * PER_REV) - since
        yield EncoderFrame(
            channel=Channel(asset, "encoder", shaft), start_time_ns=at, sequence=number,
            edges_per_rev=PER_REV, first_edge_index=first, edge_offsets_ns=np.maximum(times, 0) * NS,
        )  # fmt: skip


_WORKER = int("".join(filter(str.isdigit, os.environ.get("PYTEST_XDIST_WORKER", ""))) or 0)
_OWN_PORTS = range(20000 + 1000 * (_WORKER % 10), 21000 + 1000 * (_WORKER % 10))
_PORTS = itertools.islice(itertools.cycle(_OWN_PORTS), random.randrange(1000), None)


def free_port() -> int:
    """A loopback port that stays free until a service takes it: no other worker of the tests gives it out."""
    return first_free(_PORTS)


class Sink:
    """Where a pipeline's outcomes are listed; windows that start at a time in `known` are there already."""

    def __init__(self, outcomes: list, published: list | None = None, known: tuple = ()) -> None:
        self.outcomes, self.published, self.known = outcomes, [] if published is None else published, known

    def commit(self, outcome) -> bool:
        if outcome.window.start_time_ns in self.known:
            return False
        self.outcomes.append(outcome)
        return True

    def publish(self, outcome) -> None:
        self.published.append(outcome)


def go_on(pipeline, last, assembly: dict) -> None:
    """A pipeline goes on after the last outcome of another one, whose stream ended at `Assembler.to_dict()`."""
    pipeline.resume(last.asset, assembly, {})
    pipeline.assemblies[last.asset] = assembly
    place = pipeline.place(last.asset)
    place.index, place.state, place.report = last.index + 1, last.state, last.report
    place.make_from(last.making)


class Service:
    """A service process with the fake twin, and its addresses."""

    program = HERE / "fake_twin.py"
    fleets: Fleets | None = None  # in place of `gear-twin serve` (see one_partition.py)

    def __init__(self, data: Path, slow: float = 0.0, most: int | None = None, **settings: str) -> None:
        """
        slow  what a window costs [s]
        most  windows of an asset that are processed, until `process_windows` says more
        """
        self.http, self.endpoint = f"127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{free_port()}"
        self.given = {
            "LISTEN": json.dumps([self.endpoint]), "HTTP": self.http, "DATA": str(data), "IDLE_TIMEOUT": "0.7",
        } | settings  # fmt: skip
        self.slow, self.process = slow, None
        data.mkdir(parents=True, exist_ok=True)
        self.out, self.err, self._most = data / "said.txt", data / "complained.txt", data / "most.txt"
        if most is not None:
            self.process_windows(most)

    def process_windows(self, most: int) -> None:
        """So many windows of an asset are processed from now on, and no more."""
        beside = self._most.with_suffix(".new")
        beside.write_text(str(most))
        beside.rename(self._most)

    def start(self) -> Service:
        environment = os.environ | {f"GEAR_TWIN_{k}": v for k, v in self.given.items()}
        environment |= {"PYTHONPATH": str(ROOT), "FAKE_TWIN_SECONDS": str(self.slow), "FAKE_TWIN_MOST": str(self._most)}
        if Service.fleets is not None:
            environment |= Service.fleets.environment(self.given)
        with self.out.open("w") as out, self.err.open("w") as err:
            self.process = ForkedProcess(self.program, environment, out, err)
        wait_until(lambda: self.process.poll() is not None or self.get("/readyz") is not None)
        assert self.process.poll() is None, f"the service did not start: {self.said()}"
        return self

    def end(self, how: int = signal.SIGTERM) -> tuple[int, str, str]:
        """The exit status and what was said; all that the service has started has ended by then."""
        started = [] if self.process.poll() is not None else self.process.all
        if started:
            self.process.send_signal(how)
        status = self.process.wait(20)
        wait_until(lambda: not any(map(is_alive, started)), 10.0)
        return status, *self.said()

    def said(self) -> tuple[str, str]:
        """What the process has said so far, to output and error."""
        return self.out.read_text(), self.err.read_text()

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return Path(self.given["DATA"])

    def store(self) -> AbstractContextManager[SqlStore]:
        """What it has stored, for who looks at it from outside, or writes to it."""
        fleet = None if Service.fleets is None else Service.fleets.database(self.given)
        return SqlStore(self.folder / DATABASE) if fleet is None else SqlStore(front_tables(fleet, Layout(1)))

    def ready(self) -> bool:
        """Whether it says that it takes frames, now."""
        fleet = None if Service.fleets is None else Service.fleets.database(self.given)
        return self.get("/readyz") is not None and (fleet is None or takes_frames(fleet))

    def get(self, path: str):
        """The JSON at a path; None where it is not answered."""
        try:
            with urllib.request.urlopen(f"http://{self.http}{path}", timeout=10) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            error.close()
        except OSError:
            pass
        return None

    def text(self, path: str) -> str:
        """What is answered at a path, as text."""
        with urllib.request.urlopen(f"http://{self.http}{path}", timeout=10) as answer:
            return answer.read().decode()

    def windows(self, asset: str = "unsw") -> list[dict]:
        return self.get(f"/v1/assets/{asset}/windows?limit=10000") or []

    def wait_for_windows(self, count: int, asset: str = "unsw", seconds: float = 60) -> list[dict]:
        wait_until(lambda: len(self.windows(asset)) >= count, seconds)
        return self.windows(asset)


class SqliteFile:
    """The store of a data folder, for a service in this process, which opens it at each start."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def open(self) -> SqlStore:
        return SqlStore(self.path / DATABASE)


@contextmanager
def service(data: Path, **given):
    running = Service(data, **given).start()
    try:
        yield running
    finally:
        print(*running.end(signal.SIGKILL), sep="\n")  # shown where the test failed


def wait_until(condition, seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"not within {seconds:g} s"
        time.sleep(0.05)
