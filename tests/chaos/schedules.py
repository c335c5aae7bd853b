"""Schedules of faults: real processes, real Zenoh, and the end must be that of the undisturbed run.

    python -m tests.chaos schedules [--count N] [--seed S] [--only KIND ...]

A schedule is drawn from its number: a recording whose frames may be repeated, out of order or lost; its pace; whether a
router lies between; and one to four faults at drawn moments. In half of the schedules the publisher survives, and the
recording is then sent once; in the others the publisher is killed as well, and started again from the beginning.

What must hold, whatever the faults:
- every window that was acknowledged before a fault is there afterwards;
- no window is there twice, and none is missing at the end;
- the windows are those of `assess` on the same frames: each figure, grade and fault, lost frames among them;
- no process ends with a traceback, and each ends within its time when it is asked to.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
from service_streams import ROOT, Service, free_port, write_recording

from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter
from tests.chaos.comparison import disturbed, expected_windows, same
from tests.chaos.faults import FAULTS, SQLITE_ALONE, KeptServer
from tests.chaos.processes import children_of, does, ended, own_disk

WINDOWS = 8
SPAN = 60.0 * WINDOWS  # of the recording [s]
IDLE = 15.0  # silence that ends a window [s]: longer than a publisher is away, also on a busy machine
END_WAIT = 10.0  # within which a service must end when it is asked to [s]
START_WAIT = 180.0  # for a service, on a machine that is busy with other things [s]
PATIENCE = 120.0  # for the last window [s]
ROUTER = """
import sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"router"')
config.insert_json5("listen/endpoints", '["%s"]' % sys.argv[1])
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config):
    print("ready", flush=True)
    time.sleep(3600)
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One fault of a schedule."""

    kind: str
    at: float  # after the replay's start [s]
    lasts: float = 0.0  # [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """All that is drawn for one run."""

    number: int
    seed: int
    speed: float  # of the replay; 0: as fast as it goes
    frames: str  # sound, repeated, shuffled, lost
    slow: float  # what the fake twin takes for a window [s]
    workers: int
    router: bool
    postgresql: bool  # whether results are kept in PostgreSQL
    faults: tuple[Fault, ...]

    @property
    def survives(self) -> bool:
        """Whether the publisher is left alone."""
        return not any(fault.kind == "replay_kill" for fault in self.faults)


KINDS: Mapping[str, float] = {
    "service_kill": 4, "service_term": 3, "service_stop": 2, "replay_stop": 1, "worker_kill": 2, "worker_stop": 1,
    "router_kill": 2, "database_lock": 2, "disk_full": 2, "disk_read_only": 1, "clock_jump": 1, "database_flip": 1,
    "window_flip": 1, "http_abuse": 2, "memory_pressure": 1, "database_slow": 1, "router_stop": 1, "postgresql_kill": 1,
    "postgresql_restart": 0.5,
}  # fmt: skip
"""Faults with their weights; `replay_kill` is added in half of the schedules."""


def draw(seed: int, number: int, only: Sequence[str] = ()) -> Schedule:
    """The schedule of a number, the same in any run."""
    rng = random.Random(f"schedule {seed} {number}")
    speed = rng.choice((0.0, 40.0, 80.0, 160.0))
    lasts = SPAN / speed if speed else 2.0
    kinds = list(only or KINDS)
    weights = [KINDS.get(kind, 1.0) for kind in kinds]
    faults = [
        Fault(kind=kind, at=rng.uniform(0.0, 1.1 * lasts), lasts=rng.choice((0.2, 1.0, 3.0, 8.0)))
        for kind in rng.choices(kinds, weights, k=rng.choice((1, 1, 2, 2, 3, 4)))
    ]
    postgresql = any(kind.startswith("postgresql") for kind in (fault.kind for fault in faults))
    if postgresql:
        faults = [fault for fault in faults if fault.kind not in SQLITE_ALONE]
    if number % 2 and not only:
        faults.append(Fault(kind="replay_kill", at=rng.uniform(0.0, lasts)))
    return Schedule(
        number=number,
        seed=seed,
        speed=speed,
        frames=rng.choice(("sound", "sound", "repeated", "shuffled", "lost")),
        slow=rng.choice((0.0, 0.0, 0.1, 0.5)),
        workers=rng.choice((0, 1, 2)),
        router=any(f.kind.startswith("router") for f in faults),
        postgresql=postgresql,
        faults=tuple(sorted(faults, key=lambda fault: fault.at)),
    )


@dataclass(slots=True)
class Outcome:
    """What became of a schedule."""

    schedule: Schedule
    seconds: float = 0.0
    restarts: int = 0
    repeats: int = 0  # how often the recording was sent again
    acknowledged: int = 0  # windows, the most that a position had acknowledged before a fault
    wrong: list[str] = field(default_factory=list)


class Run:
    """One schedule, carried out."""

    def __init__(self, schedule: Schedule, folder: Path) -> None:
        self.schedule, self.folder = schedule, folder
        self.outcome = Outcome(schedule)
        self.recording = recording_of(schedule, folder)
        self.data = folder / "data"
        self.data.mkdir()
        self.router: subprocess.Popen[str] | None = None
        self._router_endpoint = f"tcp/127.0.0.1:{free_port()}" if schedule.router else None
        self._clock = folder / "clock"
        self._clock.write_text("0")
        self.replay: subprocess.Popen[str] | None = None
        self.server: KeptServer | None = None
        self.damaged = 0  # files of windows that were damaged
        self.service = self._new_service()

    def __call__(self) -> Outcome:
        begun = time.monotonic()
        with ExitStack() as stack:
            if any(f.kind.startswith("disk") for f in self.schedule.faults):
                stack.enter_context(own_disk(self.data))
            if self.schedule.postgresql:
                self.server = stack.enter_context(KeptServer())
                self.server.sql("CREATE DATABASE twin")
                self.service.given["DATABASE"] = self.server.url("twin")
            stack.callback(self._end_all)
            try:
                self._carry_out()
            except Exception as error:
                self.wrong(f"{type(error).__name__}: {error}")
        self.outcome.seconds = time.monotonic() - begun
        return self.outcome

    # -- processes -----------------------------------------------------------------------------------

    def _new_service(self) -> Service:
        given = {"WORKERS": str(self.schedule.workers), "IDLE_TIMEOUT": f"{IDLE:g}"}
        if self._router_endpoint:
            given["CONNECT"] = json.dumps([self._router_endpoint])
        return Service(self.data, slow=self.schedule.slow, **given)

    def start_service(self) -> None:
        service, environment = self.service, dict(os.environ)
        environment |= {f"GEAR_TWIN_{name}": value for name, value in service.given.items()}
        environment |= {"PYTHONPATH": str(ROOT), "FAKE_TWIN_SECONDS": str(service.slow)}
        if any(fault.kind == "clock_jump" for fault in self.schedule.faults):
            environment["CHAOS_CLOCK"] = str(self._clock)
        with (self.folder / "out.txt").open("a") as out, (self.folder / "err.txt").open("a") as err:
            service.process = subprocess.Popen(
                [sys.executable, "-m", "tests.chaos.fake_service"], env=environment, stdout=out, stderr=err, cwd=ROOT
            )

    def await_ready(self, seconds: float = START_WAIT) -> None:
        self._until(lambda: self.service.get("/healthz") is not None, seconds, "the service does not answer")

    def _start_router(self) -> None:
        assert self._router_endpoint is not None
        self.router = subprocess.Popen(
            [sys.executable, "-c", ROUTER, self._router_endpoint], stdout=subprocess.PIPE, text=True
        )
        assert self.router.stdout is not None and self.router.stdout.readline().strip() == "ready"

    def _end_router(self) -> None:
        assert self.router is not None and self.router.stdout is not None
        self.router.kill()
        self.router.wait(10)
        self.router.stdout.close()

    def _start_replay(self) -> None:
        endpoint = self._router_endpoint or self.service.endpoint
        command = [
            sys.executable,
            "-m",
            "service",
            "replay",
            str(self.recording),
            "--connect",
            endpoint,
            "--wait",
            "90",
        ]
        with (self.folder / "replay.txt").open("a") as said:
            self.replay = subprocess.Popen(
                [*command, "--speed", str(self.schedule.speed)], cwd=ROOT, stdout=said, stderr=said
            )

    def _end_all(self) -> None:
        if self.router is not None and self.router.poll() is None:
            self._end_router()
        for process in (self.replay, self.service.process):
            if process is not None and process.poll() is None:
                children = children_of(process.pid)
                process.send_signal(signal.SIGCONT)
                process.kill()
                process.wait(10)
                for child in children:
                    if child.is_running() and not ended(child, 10.0):
                        self.wrong(f"process {child.pid} goes on after the service has been killed")
                        child.kill()

    # -- the course of events ------------------------------------------------------------------------

    def _carry_out(self) -> None:
        if self._router_endpoint:
            self._start_router()
        self.start_service()
        self.await_ready()
        self._start_replay()
        begun = time.monotonic()
        for fault in self.schedule.faults:
            time.sleep(max(0.0, begun + fault.at - time.monotonic()))
            if fault.kind in FAULTS:
                FAULTS[fault.kind](self, fault)
            else:
                getattr(self, f"_{fault.kind}")(fault)
        self._finish_replay()
        expected = expected_windows(self.recording)
        windows = self._windows_at_the_end(len(expected))
        self._compare(windows, expected)
        self._end_well()

    def _finish_replay(self) -> None:
        assert self.replay is not None
        status = self.replay.wait(PATIENCE + SPAN)
        if self.schedule.survives and status != 0:
            said = (self.folder / "replay.txt").read_text()[-500:]
            self.wrong(f"the replay, which was left alone, ended with {status}: {said}")
        while status != 0 and self.outcome.repeats < 3:
            self._start_replay()
            self.outcome.repeats += 1
            status = self.replay.wait(PATIENCE + SPAN)
        if status != 0:
            self.wrong(f"the recording, sent again, ended with {status}")

    def _windows_at_the_end(self, count: int) -> list[dict[str, Any]]:
        deadline = time.monotonic() + PATIENCE
        windows = self.service.windows()
        while len(windows) < count and time.monotonic() < deadline:
            time.sleep(0.2)
            windows = self.service.windows()
        return windows

    def _compare(self, windows: list[dict[str, Any]], expected: list[dict[str, Any]]) -> None:
        starts = [w["start_time"] for w in windows]
        if len(set(starts)) < len(starts):
            self.wrong("a window is there twice")
        right_starts = {w["start_time"] for w in expected}
        beyond = [w for w in starts if w not in right_starts]
        if beyond:
            self.wrong(f"{len(beyond)} windows that the undisturbed run has not: {', '.join(beyond)}")
        missing = [w["start_time"] for w in expected if w["start_time"] not in starts]
        if missing:
            self.wrong(f"{len(missing)} of {len(expected)} windows are missing: {', '.join(missing)}")
        refused = [w for w in windows if w.get("quality") == "refused"]
        if self.damaged and len(refused) <= self.damaged:
            unsaid = [w["start_time"] for w in refused if not w.get("faults")]
            if unsaid:
                self.wrong(f"windows are refused without a reason: {unsaid}")
            if refused:  # the figures after it are those of a machine without that window
                return
        for found, right in zip(windows, expected, strict=False):
            differ = sorted(key for key in right if not same(found.get(key), right[key]))
            if differ:
                key = differ[0]
                self.wrong(f"window {right['index']}: {key} = {found.get(key)}, without faults {right[key]}; {differ}")
                break

    def _end_well(self) -> None:
        process = self.service.process
        assert process is not None
        process.send_signal(signal.SIGTERM)
        try:
            status = process.wait(END_WAIT)
            if status != 0:
                self.wrong(f"the service ended with {status}")
        except subprocess.TimeoutExpired:
            self.wrong(f"the service did not end within {END_WAIT:g} s")
        said = (self.folder / "err.txt").read_text()
        starved = any(fault.kind == "memory_pressure" for fault in self.schedule.faults) and any(
            words in said for words in ("MemoryError", "annot allocate memory", "failed to map segment")
        )  # Python's own words, of a worker that was starved while it began
        if "Traceback" in said and not starved:
            self.wrong(said[said.rindex("Traceback") :][-1500:])

    # -- faults --------------------------------------------------------------------------------------

    def _acknowledged(self) -> set[str]:
        """Starts of the windows that the service shows."""
        return {w["start_time"] for w in self.service.windows()}

    def kill_service(self) -> None:
        """Ends the service at once."""
        assert self.service.process is not None
        self.service.process.kill()
        self.service.process.wait(10)
        time.sleep(0.2)

    def _restarted(self, how: int) -> None:
        before = self._acknowledged()
        self.outcome.acknowledged = max(self.outcome.acknowledged, len(before))
        process = self.service.process
        assert process is not None
        if process.poll() is None:
            process.send_signal(how)
        try:
            process.wait(END_WAIT)
        except subprocess.TimeoutExpired:
            self.wrong(f"the service did not end within {END_WAIT:g} s of signal {how}")
            process.kill()
            process.wait(10)
        time.sleep(0.2)
        self.start_service()
        self.outcome.restarts += 1
        self.await_ready()
        lost = before - self._acknowledged()
        if lost:
            self.wrong(f"{len(lost)} windows that were shown are gone after a restart: {sorted(lost)[:3]}")

    def _service_kill(self, fault: Fault) -> None:
        self._restarted(signal.SIGKILL)

    def _service_term(self, fault: Fault) -> None:
        self._restarted(signal.SIGTERM)

    def _service_stop(self, fault: Fault) -> None:
        assert self.service.process is not None
        self._stopped(self.service.process, fault.lasts)

    def _replay_stop(self, fault: Fault) -> None:
        if self.replay is not None and self.replay.poll() is None:
            self._stopped(self.replay, min(fault.lasts, IDLE / 2))

    def _replay_kill(self, fault: Fault) -> None:
        assert self.replay is not None
        self.replay.kill()
        self.replay.wait(10)
        self._start_replay()  # as whoever watches over it would
        self.outcome.repeats += 1

    def _router_kill(self, fault: Fault) -> None:
        assert self.router is not None
        self._end_router()
        time.sleep(fault.lasts)
        self._start_router()

    def workers(self) -> list[psutil.Process]:
        """The workers and who makes them."""
        assert self.service.process is not None
        return [child for child in children_of(self.service.process.pid) if does(child, "work")]

    def _worker_kill(self, fault: Fault) -> None:
        for worker in self.workers():
            with suppress(psutil.NoSuchProcess):
                worker.kill()

    def _worker_stop(self, fault: Fault) -> None:
        workers = self.workers()
        for worker in workers:
            with suppress(psutil.NoSuchProcess):
                worker.suspend()
        time.sleep(fault.lasts)
        for worker in workers:
            with suppress(psutil.NoSuchProcess):
                worker.resume()

    def _database_lock(self, fault: Fault) -> None:
        with closing(sqlite3.connect(self.data / "gear-twin.sqlite", timeout=10, isolation_level=None)) as database:
            database.execute("BEGIN IMMEDIATE")
            time.sleep(3 * fault.lasts)
            database.execute("ROLLBACK")

    def _disk_full(self, fault: Fault) -> None:
        ballast = self.data / "ballast"
        with ballast.open("wb", buffering=0) as file, suppress(OSError):
            while True:
                file.write(bytes(65_536))
        time.sleep(fault.lasts)
        ballast.unlink()

    def _disk_read_only(self, fault: Fault) -> None:
        """Read-only as a file system becomes after an error: files that are open for writing fail too."""
        remount = ["mount", "-o", "remount,ro", "--make-private", str(self.data)]
        if subprocess.run(remount, check=False, capture_output=True).returncode != 0:
            return self._disk_full(fault)  # files are open for writing: the kernel refuses
        time.sleep(fault.lasts)
        subprocess.run(["mount", "-o", "remount,rw", str(self.data)], check=True)
        return None

    def _clock_jump(self, fault: Fault) -> None:
        rng = random.Random(self.schedule.number)
        self._clock.write_text(str(rng.choice((-86_400, -3600, -60, 60, 3600, 86_400))))

    # -- within --------------------------------------------------------------------------------------

    def _stopped(self, process: subprocess.Popen[str], seconds: float) -> None:
        process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        process.send_signal(signal.SIGCONT)

    def _until(self, condition: Callable[[], bool], seconds: float, what: str) -> None:
        deadline = time.monotonic() + seconds
        while not condition():
            if self.service.process is not None and self.service.process.poll() is not None:
                said = (self.folder / "err.txt").read_text()[-1500:]
                raise RuntimeError(f"the service has ended with {self.service.process.returncode}: {said}")
            if time.monotonic() > deadline:
                raise RuntimeError(f"{what} for {seconds:g} s")
            time.sleep(0.05)

    def wrong(self, what: str) -> None:
        self.outcome.wrong.append(what)


# -- recordings ------------------------------------------------------------------------------------------


def recording_of(schedule: Schedule, folder: Path) -> Path:
    """The recording of a schedule, with what happens to its frames."""
    sound = write_recording(folder / "sound.mcap", windows=WINDOWS, seed=schedule.seed)
    if schedule.frames == "sound":
        return sound
    rng = random.Random(f"frames {schedule.seed} {schedule.number}")
    path = folder / f"{schedule.frames}.mcap"
    with (
        Recording(sound) as recording,
        RecordingWriter(path, rig_text=recording.rig_text, metadata=dict(recording.metadata)) as writer,
    ):
        for raw in disturbed(list(recording.messages()), schedule.frames, rng):
            writer.write(raw.channel, raw.log_time_ns, raw.payload)
    return path


def attack(
    numbers: range, seed: int, folder: Path, say: Callable[[str], None], at_once: int = 2, only: Sequence[str] = ()
) -> list[Outcome]:
    """Carries out the schedules of some numbers, some of them at the same time."""
    done, lock = list[Outcome](), threading.Lock()

    def one(number: int) -> None:
        own = folder / f"{number:04d}"
        own.mkdir()
        outcome = Run(draw(seed, number, only), own)()
        with lock:
            done.append(outcome)
            wrong = sum(bool(o.wrong) for o in done)
            say(f"{len(done)} schedules, {wrong} went wrong" + "".join(f"\n  {number}: {w}" for w in outcome.wrong))

    with ThreadPoolExecutor(at_once) as pool:
        for result in [pool.submit(one, number) for number in numbers]:
            result.result()
    return done
