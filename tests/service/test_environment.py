"""The environment that others make: folders of modules, workers that cannot be started, proxies, quotas."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import shutil
import socket
import sqlite3
import stat
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import pytest
import service_fakes as fakes
import sqlalchemy
from fake_twin import TWIN
from memory_transport import MemoryNetwork
from service_streams import ROOT, Service, SqliteFile, free_port, wait_until, write_recording
from test_other_parts import serving as serving_here
from test_workers import Pool

from gear_twin import Client
from service.access.roles import Role, Who
from service.cli import run
from service.errors import InputError, StoreError
from service.json_text import plain
from service.operation.journey import Journey
from service.results import backends, database, migrate
from service.results.data_folder import only_service_of
from service.runtime.assess import assess
from service.runtime.replay import replay
from service.runtime.usable_cores import usable_cores
from service.steady_clock import later_time_ns

BROKEN = "raise ImportError('the kernels of this folder cannot be loaded')\n"


@pytest.mark.slow
@pytest.mark.parametrize("lying", ["checkout", "random.py", "numpy/__init__.py"])
def test_workers_take_the_modules_of_the_service_whatever_lies_where_it_is_started(tmp_path, monkeypatch, lying):
    if lying == "checkout":
        copy_program(tmp_path)
        (tmp_path / "twin" / "compiled" / "kernels.so").unlink()
    else:
        (tmp_path / lying).parent.mkdir(exist_ok=True)
        (tmp_path / lying).write_text("# another module of this name\n")
    monkeypatch.chdir(tmp_path)
    before = os.environ.get("PYTHONPATH")
    pool = Pool(tmp_path / "pool", workers=1)
    try:
        pool.window("a")
        pool.wait("a", 1)
        assert pool.reasons("a") == [None]
        assert "PYTHONSAFEPATH" not in os.environ and os.environ.get("PYTHONPATH") == before
    finally:
        pool.close()


def copy_program(folder):
    for part in ("service", "twin", "recordings"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__", "*.mcap", "source"))


@contextmanager
def serving(folder):
    """`gear-twin serve` of a copy of the program in which the workers' part cannot be loaded."""
    copy_program(folder)
    (folder / "twin" / "updating" / "model_cache.py").write_text(BROKEN)
    running = Service(folder / "data")
    given = {f"GEAR_TWIN_{name}": value for name, value in running.given.items()}
    with running.out.open("w") as out, running.err.open("w") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "service", "serve"], cwd=folder, stdout=out, stderr=err,
            env=os.environ | given | {"PYTHONPATH": str(folder)},
        )  # fmt: skip
    try:
        wait_until(lambda: "serves" in running.said()[0])
        yield running
    finally:
        process.terminate()
        process.wait(20)


@pytest.mark.slow
def test_a_service_none_of_whose_workers_lives_is_not_ready_and_says_why_wherever_it_is_asked(tmp_path, capsys):
    recording = write_recording(tmp_path / "a.mcap", windows=2)
    (tmp_path / "program").mkdir()
    with serving(tmp_path / "program") as running:
        why = "no worker process can be started"
        wait_until(lambda: "has ended with status" in running.said()[1])
        assert run(["remote", "ready", "--url", f"http://{running.http}"]) == 2 and why in capsys.readouterr().err
        assert run(["replay", str(recording), "--connect", running.endpoint, "--speed", "0"]) == 0
        assert re.search(f"the frames are stored and cannot be assessed now: {why}: .+", capsys.readouterr().err)
        wait_until(lambda: why in str(running.get("/v1/assets")))
        (asset,) = running.get("/v1/assets")
        assert why in asset["status"]["reasons"][0] and why in asset["data"] + asset["reason"]
        assert "log of the service" in asset["status"]["action"]
        assert running.said()[1].count("has ended with status") < 10


# -- proxies -------------------------------------------------------------------------------------------


class Proxy(BaseHTTPRequestHandler):
    """Notes what it is asked for, and knows nothing."""

    asked: ClassVar[list[str]] = []

    def do_GET(self):
        self.asked.append(self.path)
        self.send_error(502)

    do_POST = do_CONNECT = do_GET

    def log_message(self, *_):
        pass


@pytest.fixture
def proxy(monkeypatch):
    """A proxy that the environment names for everything."""
    Proxy.asked.clear()
    with ThreadingHTTPServer(("127.0.0.1", 0), Proxy) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        for name in ("http_proxy", "https_proxy", "all_proxy"):
            monkeypatch.setenv(name, f"http://127.0.0.1:{server.server_port}")
            monkeypatch.setenv(name.upper(), f"http://127.0.0.1:{server.server_port}")
        yield Proxy.asked
        server.shutdown()


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "127.0.0.2", socket.gethostname()])
def test_commands_and_the_client_ask_a_service_directly_whatever_proxy_is_named(proxy, capsys, host):
    """The image's health check is `gear-twin remote ready`."""

    class Ready(Proxy):
        def do_GET(self):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b'{"status": "ready"}' if self.path == "/readyz" else b"[]")

    with ThreadingHTTPServer(("0.0.0.0", 0), Ready) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://{host}:{server.server_port}"
        assert run(["remote", "ready", "--url", url]) == 0 and capsys.readouterr().out == "ready\n"
        with Client(url) as client:
            assert client.assets() == []
        server.shutdown()
    assert proxy == []


@pytest.mark.slow
@pytest.mark.parametrize("given", [{}, {"NO_PROXY": "example.org"}, {"no_proxy": "*"}])
def test_webhooks_and_whatever_else_reads_the_environment_reach_this_computer_directly(proxy, given):
    """In a process of its own, as the variables are read where the program begins."""
    program = (
        "import service, httpx, urllib.request, sys\n"
        "for url in sys.argv[1:]:\n"
        "    for ask in (httpx.get, urllib.request.urlopen)[:1 if '[' in url else 2]:\n"
        "        try: ask(url)\n"
        "        except Exception: pass\n"
    )
    environment = {name: value for name, value in os.environ.items() if name.lower() != "no_proxy"} | given
    urls = [f"http://{host}:9/" for host in ("127.0.0.1", "localhost", "[::1]", "plant.example")]
    urls = urls[: 3 if given == {"no_proxy": "*"} else 4]
    subprocess.run([sys.executable, "-c", program, *urls], env=environment, check=True, timeout=60)
    assert proxy == urls[3:] * 2


# -- quotas --------------------------------------------------------------------------------------------


def groups(folder, text, **files):
    """Control groups as a kernel shows them: `self` says which are this process's; files by their place."""
    (folder / "self").write_text(text)
    for place, content in files.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text(content)
    return usable_cores(folder / "self", folder)


GROUP = next(f for f in (Path("/sys/fs/cgroup/cpu"), Path("/sys/fs/cgroup")) if f.name == "cgroup" or f.exists())


def may_make_groups():
    """Whether control groups with a quota can be made here: of version 1, or below the root of version 2."""
    tried = GROUP / f"gear-twin-tried-{os.getpid()}"
    try:
        tried.mkdir()
        made = any((tried / name).exists() for name in ("cpu.cfs_quota_us", "cpu.max"))
        tried.rmdir()
        return made
    except OSError:
        return False


OWN = len(os.sched_getaffinity(0))


@pytest.mark.parametrize(
    ("text", "files", "cores"),
    [
        ("0::/\n", {"cpu.max": "100000 100000\n"}, 1),
        ("0::/\n", {"cpu.max": "50000 100000\n"}, 1),
        ("0::/\n", {"cpu.max": "max 100000\n"}, OWN),
        ("0::/kubepods/pod1\n", {"kubepods/cpu.max": "100000 100000\n", "kubepods/pod1/cpu.max": "max 100000\n"}, 1),
        ("0::/../other\n", {"cpu.max": "100000 100000\n"}, 1),
        ("4:cpu,cpuacct:/docker/a\n", {"cpu,cpuacct/docker/a/cpu.cfs_quota_us": "150000\n",
                                       "cpu,cpuacct/docker/a/cpu.cfs_period_us": "100000\n"}, 1),
        ("4:cpu:/docker/a\n", {"cpu/cpu.cfs_quota_us": "20000\n", "cpu/cpu.cfs_period_us": "20000\n"}, 1),
        ("4:cpu:/\n", {"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, OWN),
        ("4:cpuset:/\n", {"cpuset/cpu.max": "1 100000\n"}, OWN),
        ("", {}, OWN),
    ],
)  # fmt: skip
def test_cores_are_those_of_the_quota_where_a_control_group_has_one(tmp_path, monkeypatch, text, files, cores):
    assert groups(tmp_path, text, **files) == cores


def test_a_quota_above_one_core_is_whole_cores_of_a_large_machine(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)))
    assert groups(tmp_path, "0::/\n", **{"cpu.max": "450000 100000\n"}) == 4
    assert groups(tmp_path, "0::/\n", **{"cpu.max": "9900000 100000\n"}) == 64


@pytest.mark.containers
@pytest.mark.skipif(not may_make_groups(), reason="no control group of processor time can be made here")
def test_a_process_in_a_real_control_group_with_a_quota_has_no_more_workers_than_that():
    own = GROUP / f"gear-twin-test-{os.getpid()}"
    own.mkdir()
    limit, quota = ("cpu.cfs_quota_us", "100000") if GROUP.name == "cpu" else ("cpu.max", "100000 100000")
    (own / limit).write_text(quota)
    program = (
        f"import os\nopen({str(own / 'cgroup.procs')!r}, 'w').write(str(os.getpid()))\n"
        "from service.runtime.usable_cores import usable_cores\nprint(usable_cores())"
    )
    try:
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
        assert done.stdout == "1\n", done.stderr
    finally:
        own.rmdir()


# -- a clock that is set back --------------------------------------------------------------------------


@pytest.fixture
def stepped(monkeypatch):
    """Sets this machine's clock back by a day, as a person or a time service might; returns it to how it was before."""
    real, by = time.time_ns, [0]
    monkeypatch.setattr(time, "time_ns", lambda: real() - by[0])
    monkeypatch.setattr(time, "time", lambda: (real() - by[0]) / 1e9)

    def step(seconds=86_400):
        by[0] = round(seconds * 1e9)

    return step


def test_a_clock_that_is_set_back_dates_nothing_earlier_than_before_and_one_set_forward_is_followed(stepped):
    before = later_time_ns()
    stepped()
    assert 0 <= later_time_ns() - before < 60e9
    stepped(-86_400)
    assert later_time_ns() - before > 86_000e9


def test_a_credential_that_has_expired_stays_so_when_the_clock_is_set_back(stepped):
    who = Who(kind="key", name="a", role=Role.read, address=None, expires=time.time() - 5)
    assert who.expired
    stepped()
    assert who.expired and not who.may(Role.read)


def test_a_window_that_waits_has_waited_as_long_when_the_clock_is_set_back(stepped):
    journey = Journey()
    stepped()
    journey.stored_ns = later_time_ns()
    wait_until(lambda: journey.waited > 0.01)
    assert 0 <= journey.delay < 5


def test_what_was_asked_before_the_clock_was_set_back_is_carried_out_before_what_is_asked_after(store, stepped):
    store.keep("unsw")
    fakes.decide(store, "unsw", "misalignment", "pin")
    stepped()
    jobs = fakes.jobs_of(store)
    jobs.add("unsw", "oil_changed", {})
    assert [job.kind for job in jobs.pending()] == ["decision", "oil_changed"]


@pytest.mark.slow
def test_frames_of_now_are_used_at_their_own_times_when_the_clock_of_the_service_is_set_back(tmp_path, stepped):
    late = time.time() - 1_700_000_000 - 3600
    recording, network = write_recording(tmp_path / "now.mcap", windows=3, later=late), MemoryNetwork()
    with serving_here(tmp_path, network, SqliteFile(tmp_path / "sqlite")) as running:
        stepped()
        replay(recording, (), 0, publish_to=network.open_publisher)
        windows = running.wait_for_windows(3, seconds=20.0)
        assert not any(window["faults"] for window in windows)
    stepped(0)
    assert [w["quality"] for w in windows] == ["good"] * 3
    expected = plain(assess(recording, twin=TWIN))["windows"]
    assert [w["start_time"] for w in windows] == [w["start_time"] for w in expected]


# -- file systems of others ----------------------------------------------------------------------------


@pytest.mark.parametrize("number", [errno.EBADF, errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS])
def test_a_file_system_that_locks_files_alone_is_used_and_keeps_a_second_service_out(tmp_path, monkeypatch, number):
    """On NFS a folder, which can only be opened for reading, cannot be locked."""
    real = fcntl.flock

    def flock(file, how):
        if stat.S_ISDIR(os.fstat(file if isinstance(file, int) else file.fileno()).st_mode):
            raise OSError(number, os.strerror(number))
        real(file, how)

    monkeypatch.setattr(fcntl, "flock", flock)
    with ExitStack() as stack:
        stack.enter_context(only_service_of(tmp_path))
        with pytest.raises(InputError, match="another service has this"), only_service_of(tmp_path):
            pass


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EIO])
def test_a_file_system_without_locks_is_refused_with_the_reason(tmp_path, monkeypatch, number):
    def flock(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.raises(InputError) as refused, only_service_of(tmp_path):
        pass
    assert os.strerror(number) in str(refused.value) and "another service" not in str(refused.value)
    assert "give a directory on a disk of this computer" in str(refused.value)


@pytest.mark.parametrize("vfs", ["unix-dotfile", "unix-none"])
def test_a_service_does_not_begin_where_sqlite_cannot_have_a_write_ahead_log(tmp_path, monkeypatch, capsys, vfs):
    """SQLite's own way to a file system without shared memory."""
    make = sqlalchemy.create_engine

    def without_shared_memory(url, *, creator, **given):
        def connect():
            ((_, _, file),) = creator().execute("PRAGMA database_list")
            return sqlite3.connect(f"file:{file}?vfs={vfs}", uri=True, check_same_thread=False)

        return make(url, creator=connect, **given)

    monkeypatch.setattr(sqlalchemy, "create_engine", without_shared_memory)
    monkeypatch.setattr(database, "upgrade", migrate.upgrade)  # of a new file
    monkeypatch.setenv("GEAR_TWIN_HTTP", f"127.0.0.1:{free_port()}")
    assert run(["serve", "--data", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert "does not allow the write-ahead log (WAL) of SQLite" in said.err and "serves" not in said.out
    assert said.err.strip().count("\n") <= 1 and "PostgreSQL" in said.err


def test_shared_memory_that_cannot_be_mapped_is_said_at_the_start(tmp_path):
    connection = SimpleNamespace(execute=failing("SQLITE_IOERR_SHMMAP"))
    with pytest.raises(StoreError, match="does not allow the write-ahead log"):
        backends._log_ahead(connection)
    connection.execute = failing("SQLITE_FULL")
    with pytest.raises(sqlite3.OperationalError):
        backends._log_ahead(connection)


def failing(name):
    """A statement that SQLite ends with an error of this name."""

    def execute(_):
        error = sqlite3.OperationalError("disk I/O error")
        error.sqlite_errorname = name
        raise error

    return execute
