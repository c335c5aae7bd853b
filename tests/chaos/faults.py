"""Faults of schedules that need more than a signal: damaged files, a database server, HTTP abuse, little memory."""

from __future__ import annotations

import random
import resource
import shutil
import signal
import socket
import sqlite3
import subprocess
import threading
import time
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
from postgresql_server import PostgresqlServer

if TYPE_CHECKING:
    from tests.chaos.schedules import Fault, Run

DATABASE = "gear-twin.sqlite"
LOOKED_AT = 20.0  # how long a service with a damaged database is waited for [s]
SERVER_WAIT = 20.0  # until the processes of a killed database server have ended [s]
LITTLE = 8 * 2**20  # memory that a worker may take besides what it has [bytes]
ABUSE = (
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"a" * 70_000 + b"\r\n\r\n",
    b"POST /v1/assets/unsw/inspections HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 600000000\r\n\r\n"
    + b"[" * 50_000,
    b"POST /v1/assets/unsw/what-if HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 40000\r\n\r\n" + b"[" * 40_000,
    b"GET /v1/assets/unsw/windows?limit=10000 HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n",
    b"GET /v1/assets/unsw/events HTTP/1.1\r\nHost: evil.example\r\n\r\n",
    b"GET /static/../../etc/passwd HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"POST /v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    b"",
    b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n",
)


class KeptServer(PostgresqlServer):  # type: ignore[misc]
    """A database server that can be started again at once after it was killed."""

    def start(self) -> None:
        """Starts it; the processes of a killed one may need a moment to end."""
        deadline = time.monotonic() + SERVER_WAIT
        while True:
            try:
                return super().start()
            except AssertionError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.5)


def flip(path: Path, rng: random.Random, most: int = 4) -> None:
    """Changes one to so many bits of a file."""
    data = bytearray(path.read_bytes())
    for _ in range(rng.randint(1, most) if data else 0):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    path.write_bytes(data)


def database_flip(run: Run, fault: Fault) -> None:
    """Bits of the database change between two starts: the service starts, or says in one line why not.

    Then the sound database is put back, as from a backup: nothing was acknowledged meanwhile, as the publisher stands
    still.
    """
    rng = random.Random(f"flip {run.schedule.seed} {run.schedule.number} {fault.at}")
    with standing_still(run):
        run.kill_service()
        sound = run.folder / "sound"
        shutil.rmtree(sound, ignore_errors=True)
        shutil.copytree(run.data, sound)
        damaged = rng.choice([p for p in run.data.glob(f"{DATABASE}*") if p.suffix != ".lock" and p.stat().st_size])
        flip(damaged, rng)
        run.start_service()
        deadline = time.monotonic() + LOOKED_AT
        process = run.service.process
        assert process is not None
        while run.service.get("/healthz") is None and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.1)
        if process.poll() is None:
            for path in ("/v1/assets", "/v1/assets/unsw", "/v1/assets/unsw/windows"):
                run.service.get(path)  # answered or refused: a traceback is found at the end
        elif process.returncode != 2:
            run.wrong(f"with a damaged {damaged.name} the service ended with {process.returncode}")
        run.kill_service()
        for path in list(run.data.iterdir()):
            if path.name != "ballast":
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        shutil.copytree(sound, run.data, dirs_exist_ok=True)
        run.start_service()
        run.await_ready()
    run.outcome.restarts += 2


def window_flip(run: Run, fault: Fault) -> None:
    """Bits of a window's file change between two starts: that window is refused with the reason, or used as it was."""
    rng = random.Random(f"window {run.schedule.seed} {run.schedule.number} {fault.at}")
    run.kill_service()
    with closing(sqlite3.connect(run.data / DATABASE)) as database:
        waits = {name for (name,) in database.execute("SELECT file FROM jobs WHERE kind = 'window'")}
    files = sorted(p for p in run.data.rglob("*.mcap") if p.stat().st_size)
    if files:
        flip(rng.choice([p for p in files if p.name in waits] or files), rng)
        run.damaged += 1
    run.start_service()
    run.outcome.restarts += 1
    run.await_ready()


def http_abuse(run: Run, fault: Fault) -> None:
    """Requests that are none, half ones, huge ones and connections that are held, while frames flow."""
    rng = random.Random(f"http {run.schedule.seed} {run.schedule.number} {fault.at}")
    host, _, port = run.service.http.rpartition(":")
    ended = time.monotonic() + max(fault.lasts, 1.0)

    def abuse(own: random.Random) -> None:
        with ExitStack() as held:
            while time.monotonic() < ended:
                with suppress(OSError):
                    caller = held.enter_context(closing(socket.create_connection((host, int(port)), 2.0)))
                    caller.settimeout(0.2)
                    caller.sendall(own.choice(ABUSE))
                    if own.random() < 0.5:
                        caller.recv(65_536)
                        caller.close()
                time.sleep(0.01)

    threads = [threading.Thread(target=abuse, args=(random.Random(rng.random()),)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    deadline = time.monotonic() + 15.0
    while run.service.get("/healthz") is None:
        if time.monotonic() > deadline:
            run.wrong("after the abuse of HTTP health is not answered within 15 s")
            return
        time.sleep(0.1)


def memory_pressure(run: Run, fault: Fault) -> None:
    """Workers get hardly more memory than they have, for a while; not the process that makes them."""
    before = []
    for worker in run.workers():
        with suppress(psutil.Error):
            if worker.ppid() == run.service.process.pid:
                continue
            before.append((worker, worker.rlimit(resource.RLIMIT_AS)))
            limit = worker.memory_info().vms + LITTLE
            worker.rlimit(resource.RLIMIT_AS, (limit, before[-1][1][1]))
    time.sleep(fault.lasts)
    for worker, limits in before:
        with suppress(psutil.Error):
            worker.rlimit(resource.RLIMIT_AS, limits)


def database_slow(run: Run, fault: Fault) -> None:
    """Whoever writes must wait again and again, as on a disk that is slow."""
    ended = time.monotonic() + 2 * fault.lasts
    with closing(sqlite3.connect(run.data / DATABASE, timeout=30, isolation_level=None)) as database:
        while time.monotonic() < ended:
            with suppress(sqlite3.OperationalError):
                database.execute("BEGIN IMMEDIATE")
                time.sleep(0.3)
                database.execute("ROLLBACK")
            time.sleep(0.05)


def router_stop(run: Run, fault: Fault) -> None:
    """The router stands still."""
    assert run.router is not None
    run.router.send_signal(signal.SIGSTOP)
    time.sleep(min(fault.lasts, 3.0))
    run.router.send_signal(signal.SIGCONT)


def postgresql_kill(run: Run, fault: Fault) -> None:
    """The database server is killed, and is back after a while."""
    assert run.server is not None
    run.server.kill()
    time.sleep(fault.lasts)
    run.server.start()


def postgresql_restart(run: Run, fault: Fault) -> None:
    """The database server is restarted at once, as for an update."""
    assert run.server is not None
    run.server.stop("immediate")
    run.server.start()


def standing_still(run: Run) -> Any:
    """The publisher stands still while inside."""
    stack = ExitStack()
    replay: subprocess.Popen[str] | None = run.replay
    if replay is not None and replay.poll() is None:
        replay.send_signal(signal.SIGSTOP)
        stack.callback(lambda: replay.send_signal(signal.SIGCONT))
    return stack


FAULTS = {
    fault.__name__: fault
    for fault in (
        database_flip, window_flip, http_abuse, memory_pressure, database_slow, router_stop, postgresql_kill,
        postgresql_restart,
    )
}  # fmt: skip
SQLITE_ALONE = {"database_lock", "database_slow", "database_flip"}
