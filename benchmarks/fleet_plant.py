"""What the benchmarks of a fleet share: its recordings, and a fleet with its database, router and publishers.

The database's server is one of the tests' own. Processor times are of whole trees of processes, those that have ended
meanwhile included.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import psutil
import sqlalchemy as sa

from benchmarks.trace_campaigns.generate import FOLDER, RIG
from recordings.generator.deliver import simulate_file
from service.fleet.census import Census, census
from service.fleet.databases import engine_of, front_tables
from service.fleet.layout import Layout, partition_of
from service.results.database import Database
from service.results.roles import Roles
from service.runtime.demo import free_port
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter

ROOT = Path(__file__).parents[1]
TESTS = ROOT / "tests" / "service"
SPEC = """
schema = "gear-campaign/1"
rig = "{rig}"
asset = "fleet"
started = "2026-02-02T08:00:00+00:00"
seed = 17
[wear]
k_m2_per_n = 6.07e-12
from_revolutions = 47
contact_half_width_um = 200
[machine]
mesh_stiffness_scale = 0.9
[[calibration]]
speed_hz = 2.0
torque_nm = 10.0
seconds = 3.0
[[calibration]]
speed_hz = 2.0
torque_nm = 20.0
seconds = 3.0
[[conditions]]
speed_hz = 10.0
torque_nm = 10.0
[windows]
seconds = 2.5
at_revolutions = {revolutions}
"""
MEASUREMENTS = 28  # windows of the campaign after its two of calibration
WINDOWS = MEASUREMENTS + 2
EVERY = 90.0  # revolutions between two windows
SETTLED_WITHIN = 600.0  # a stretch's windows [s]
STARTED_WITHIN = 240.0  # a fleet [s]
LOOK_EVERY = 0.1  # [s]
ASK_EVERY = 1.0  # of the database, whose processor time is measured [s]


def campaign() -> Path:
    """A campaign of one asset with WINDOWS windows of 2.5 s at 12.8 kHz, made where it is not there."""
    spec = SPEC.format(rig=RIG, revolutions=[EVERY * k for k in range(MEASUREMENTS)])
    name = f"fleet-{hashlib.sha256(spec.encode()).hexdigest()[:12]}"
    path = FOLDER / f"{name}.mcap"
    if not path.exists():
        FOLDER.mkdir(parents=True, exist_ok=True)
        toml, made = FOLDER / f"{name}.toml", FOLDER / f"{name}.partial.mcap"
        toml.write_text(spec, encoding="utf-8")
        simulate_file(str(toml), str(made), None, lambda share, what: None)
        made.rename(path)
    return path


def many(source: Path, path: Path, assets: Sequence[str]) -> Path:
    """A recording of so many assets, each with the frames of the one in the source."""
    with (
        Recording(source) as recording,
        RecordingWriter(path, rig_text=recording.rig_text, metadata=recording.metadata) as writer,
    ):
        for frame in recording.messages():
            for asset in assets:
                writer.write(frame.channel._replace(asset=asset), frame.log_time_ns, frame.payload)
    return path


def names_of(partition: int, partitions: int, count: int, begin: str) -> list[str]:
    """So many names of assets of a partition."""
    found: list[str] = []
    number = 0
    while len(found) < count:
        if partition_of(name := f"{begin}-{number}", partitions) == partition:
            found.append(name)
        number += 1
    return found


def wait_until(reached: Callable[[], bool], seconds: float, what: str, every: float = LOOK_EVERY) -> None:
    """Returns as soon as something is so; RuntimeError where it takes longer."""
    end = time.monotonic() + seconds
    while not reached():
        if time.monotonic() > end:
            raise RuntimeError(f"{what}: not within {seconds:g} s")
        time.sleep(every)


# -- processes -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Spent:
    """Processor time by group of processes [s], at one moment."""

    groups: Mapping[str, float]
    at: float  # by the wall clock [s]

    def since(self, before: Spent) -> dict[str, float]:
        """What was spent from an earlier moment to this one."""
        return {name: value - before.groups.get(name, 0.0) for name, value in self.groups.items()}


def tree(pid: int) -> list[psutil.Process]:
    """A process and all that it has started."""
    with suppress(psutil.Error):
        top = psutil.Process(pid)
        return [top, *top.children(recursive=True)]
    return []


def group_of(process: psutil.Process, top: int) -> str:
    """What a process of a fleet is: `up`, the engine's head or a node, a host, a partition or what computes."""
    for ancestor in (process, *process.parents()):
        words = " ".join(ancestor.cmdline())
        if "HostActor" in words:
            role = process.name().partition(" ")[0]
            return {"work": "computing", "ingest": "partition", "record": "partition"}.get(role, "host")
        if "--node-name=" in words:
            return "head" if "--node-name=head" in words else "node"
        if ancestor.pid == top:
            break
    return "up"


def spent_by(pids: Sequence[int], group: Callable[[psutil.Process, int], str]) -> dict[str, float]:
    """Processor time by group; of processes that have ended, with whoever started them.

    pids  each with all that it has started
    """
    found: dict[str, float] = defaultdict(float)
    for pid in pids:
        for process in tree(pid):
            with suppress(psutil.Error):
                times = process.cpu_times()
                used = times.user + times.system + times.children_user + times.children_system
                found[group(process, pid)] += used
    return dict(found)


def memory_by(
    pids: Sequence[int], group: Callable[[psutil.Process, int], str]
) -> dict[str, tuple[int, int, int]]:  # fmt: skip
    """By group: number of processes, and their own memory (USS), and with a share of what is shared (PSS) [B]."""
    found: dict[str, tuple[int, int, int]] = {}
    for pid in pids:
        for process in tree(pid):
            with suppress(psutil.Error):
                used, name = process.memory_full_info(), group(process, pid)
                count, uss, pss = found.get(name, (0, 0, 0))
                found[name] = (count + 1, uss + used.uss, pss + used.pss)
    return found


def program(
    *arguments: str, said: Path, environment: Mapping[str, str] | None = None, **settings: str
) -> subprocess.Popen[bytes]:  # fmt: skip
    """A program of this interpreter, with settings of the service."""
    environment = {**os.environ, **(environment or {}), **{f"GEAR_TWIN_{n}": value for n, value in settings.items()}}
    environment |= {"PYTHONPATH": os.pathsep.join([str(ROOT), str(TESTS)]), "PYTHONUNBUFFERED": "1"}
    with said.open("wb") as out:
        return subprocess.Popen([sys.executable, *arguments], stdout=out, stderr=out, env=environment, cwd=ROOT)


def ended(process: subprocess.Popen[bytes]) -> None:
    """Ends a program in good order, or else at once."""
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            process.wait(90)
    if process.poll() is None:
        process.kill()
        process.wait()


def killed(process: subprocess.Popen[bytes]) -> None:
    """Ends a program at once, where it has not ended."""
    if process.poll() is None:
        process.kill()
        process.wait()


ROUTER = """
import sys, time
from service.transport.zenoh_session import open_session
with open_session(listen=[sys.argv[1]]):
    print("up", flush=True)
    time.sleep(1e6)
"""
PUBLISHER = """
import sys
from service.runtime.replay import replay
path, endpoint, prefix, recorded, speed, most = sys.argv[1:]
replay(path, [endpoint], float(speed), max_pause=float(most), prefix=prefix, recorded=recorded, wait=300.0)
"""


@contextmanager
def router(folder: Path) -> Iterator[tuple[str, int]]:
    """A router of Zenoh: where it is reached, and its process."""
    endpoint, said = f"tcp/127.0.0.1:{free_port(range(21000, 22000))}", folder / "router.txt"
    process = program("-c", ROUTER, endpoint, said=said)
    try:
        wait_until(lambda: "up" in said.read_text(), 30, "the router")
        yield endpoint, process.pid
    finally:
        process.kill()
        process.wait()


def publisher(
    path: Path, endpoint: str, prefix: str, said: Path, speed: float = 0.0, most: float = 1e9
) -> subprocess.Popen[bytes]:
    """`gear-twin replay` of a recording, under keys that begin with a prefix."""
    return program("-c", PUBLISHER, str(path), endpoint, prefix, "gearbox", str(speed), str(most), said=said)


@contextmanager
def postgresql(*, durable: bool = False) -> Iterator[tuple[str, Callable[[], float], Path]]:
    """A database of a server of its own: its URL, what its server has spent [s], and the folder of its data.

    durable  whether commits reach the disk
    """
    sys.path.insert(0, str(TESTS))
    import postgresql_server

    kept = ("max_connections=120", "listen_addresses=127.0.0.1", "track_commit_timestamp=on")
    postgresql_server.SETTINGS = kept if durable else (*postgresql_server.SETTINGS, *kept)
    with postgresql_server.PostgresqlServer() as server, server.new_database() as url:
        data = Path(server.folder) / "data"
        pid = int((data / "postmaster.pid").read_text().split()[0])
        yield url, lambda: spent_by([pid], lambda process, top: "server")["server"], data


def _either(process: subprocess.Popen[bytes], ready: Callable[[], bool]) -> bool:
    return process.poll() is not None or ready()


class Plant:
    """A fleet that runs, with router and database.

    program  what runs the fleet: the command itself, or the tests' one with the fake twin
    """

    def __init__(
        self, folder: Path, url: str, endpoint: str, partitions: int, nodes: int, *, fake: bool = False,
        **settings: str,
    ) -> None:  # fmt: skip
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.endpoint, self.layout = folder, endpoint, Layout(partitions)
        self.tables = engine_of(url, poolclass=sa.NullPool)
        self.database = Database(front_tables(url, self.layout))
        self.roles = Roles(self.database)
        self._arguments = (
            [str(TESTS / "fleet_up.py"), "fake_twin"] if fake else ["-m", "service", "fleet", "up", "--no-front"]
        )
        self._settings = {
            "DATA": str(folder / "data"), "DATABASE": url, "CONNECT": json.dumps([endpoint]), "NEW_ASSETS": "adopt",
            "FLEET_PARTITIONS": str(partitions), "TRACE": "false", "IDLE_TIMEOUT": "2",
        } | settings  # fmt: skip
        sys.path.insert(0, str(TESTS))
        from ray_nodes import RayNodes

        self.nodes, self._count = RayNodes(folder / "ray"), nodes
        self._process: subprocess.Popen[bytes] | None = None
        self._asked = 0  # questions of this program's own
        self.started: dict[str, float] = {}  # what had been reached, after how long [s]

    def __enter__(self) -> Plant:
        begun = time.monotonic()
        said = self.folder / "fleet.txt"
        self.nodes.start_head()
        for number in range(self._count):
            self.nodes.add(f"node-{number + 1}")
        self.started["head and nodes"] = time.monotonic() - begun
        given = self._settings | {"FLEET_ADDRESS": self.nodes.address}
        process = self._process = program(*self._arguments, said=said, environment=self.nodes.environment, **given)
        reached: dict[str, Callable[[], bool]] = {
            "tables and actors": lambda: "fleet of" in said.read_text(),
            "first partition": lambda: any(row["served"] for row in self.census().partitions),
            "all partitions": lambda: not self.census().not_served,
        }
        try:
            for name, ready in reached.items():
                wait_until(partial(_either, process, ready), STARTED_WITHIN, name)
                if process.poll() is not None:
                    raise RuntimeError(f"the fleet has ended: {said.read_text()}")
                self.started[name] = time.monotonic() - begun
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process is not None
        ended(self._process)
        self.nodes.__exit__()
        self.tables.dispose()
        self.database.close()

    @property
    def pids(self) -> list[int]:
        """The processes of `fleet up`, and of the engine's head and nodes."""
        assert self._process is not None
        return [self._process.pid, *(process.pid for process in self.nodes.processes.values())]

    def census(self) -> Census:
        """Which partitions are served."""
        return census(self.roles)

    def spent(self) -> Spent:
        """Processor times of all its processes."""
        return Spent(spent_by(self.pids, group_of), time.monotonic())

    def windows(self) -> int:
        """How many are committed."""
        self._asked += 1
        with self.tables.connect() as db:
            return int(db.exec_driver_sql("SELECT count(*) FROM windows").scalar_one())

    def await_windows(self, count: int) -> None:
        """Until so many windows are committed."""
        wait_until(lambda: self.windows() >= count, SETTLED_WITHIN, f"{count} windows", ASK_EVERY)

    def written(self) -> dict[str, float]:
        """What the database has carried out: transactions of the fleet, bytes of its log, and bytes of its tables."""
        self._asked += 1
        with self.tables.connect() as db:
            done, log, size = db.exec_driver_sql(
                "SELECT xact_commit, pg_current_wal_lsn() - '0/0', pg_database_size(current_database()) "
                "FROM pg_stat_database WHERE datname = current_database()"
            ).one()
        return {"transactions": float(done) - self._asked, "log": float(log), "size": float(size)}
