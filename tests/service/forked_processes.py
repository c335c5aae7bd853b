"""Processes that have loaded the service already: one starts in milliseconds instead of two seconds of imports.

A process of this file's, the server, loads the service's modules once for each process of the tests. It has no threads
and opens nothing; for each program that it is asked to run it forks. What is forked is a process like any other: it has
its own environment, arguments and output, runs the program from its first line, and can be stopped and killed.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import json
import os
import runpy
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import IO

ROOT = Path(__file__).parents[2]
LOADED = (
    "service.__main__",
    "service.runtime.serve",
    "service.transport.zenoh",
    "service.contract.estimate",  # and by this the twin
    "alembic.operations",
    "alembic.runtime.migration",
    "alembic.script",
    "service.cli",
    "service.runtime.assess",
)
if os.environ.get("GEAR_TWIN_TEST_FLEET"):
    LOADED += ("service.fleet.front", "service.fleet.partition", "psycopg", "sqlalchemy.dialects.postgresql.psycopg")
NO_INPUT = os.open(os.devnull, os.O_RDONLY)
_LOOK_EVERY = 0.05  # how long one thread that waits keeps others from asking [s]
NUMBER = struct.Struct("i")  # a process's number, and then how it has ended
_lock = threading.Lock()
_server: socket.socket | None = None


class ForkedProcess:
    """A program that is being run, with what the tests ask of `subprocess.Popen`."""

    def __init__(self, program: Path, environment: dict[str, str], out: IO, err: IO) -> None:
        self.args = [str(program)]
        self.returncode: int | None = None
        self._asking = threading.Lock()
        self._ends, ends = os.pipe()
        try:
            asked = {"program": str(program), "environment": environment, "folder": os.getcwd()}
            given = [NO_INPUT, out.fileno(), err.fileno(), ends]
            socket.send_fds(connection(), [json.dumps(asked).encode()], given)
        finally:
            os.close(ends)
        (self.pid,) = NUMBER.unpack(os.read(self._ends, NUMBER.size))

    def poll(self) -> int | None:
        """The exit status, or minus the signal that has ended it; None while it runs."""
        return self.returncode if self._has_ended(0.0) else None

    def wait(self, timeout: float | None = None) -> int:
        """As `poll`, once it has ended."""
        deadline = float("inf") if timeout is None else time.monotonic() + timeout
        while not self._has_ended(min(_LOOK_EVERY, max(deadline - time.monotonic(), 0.0))):
            if time.monotonic() >= deadline:
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Sends a signal; what suspends or goes on is for all that the process has started, too."""
        if self.poll() is None:
            for process in self.all if number in (signal.SIGSTOP, signal.SIGCONT) else [self.pid]:
                with suppress(ProcessLookupError):
                    os.kill(process, number)

    @property
    def all(self) -> list[int]:
        """The process, and all that it has started."""
        return [self.pid, *started_by(self.pid)]

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def _has_ended(self, timeout: float) -> bool:
        """Whether it has, after a time at most [s]; several threads may ask."""
        with self._asking:
            if self.returncode is None and select.select([self._ends], [], [], timeout)[0]:
                (status,) = NUMBER.unpack(os.read(self._ends, NUMBER.size))
                self.returncode = os.waitstatus_to_exitcode(status)
                os.close(self._ends)
            return self.returncode is not None


def started_by(process: int) -> list[int]:
    """The processes that a process has started, and those that they have."""
    found = []
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        with suppress(OSError):  # a thread that has ended meanwhile
            for child in map(int, task.read_text().split()):
                found += [child, *started_by(child)]
    return found


def is_alive(process: int) -> bool:
    """Whether a process runs, or is suspended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def role_of(process: int, role: str) -> int | None:
    """The process that does a role of a service; None where none does."""
    for child in started_by(process):
        with suppress(OSError):
            path = Path(f"/proc/{child}")
            state, parent = (path / "stat").read_text().rpartition(")")[2].split()[:2]
            if (path / "comm").read_text().strip() == role and int(parent) == process and state != "Z":
                return child
    return None


def connection() -> socket.socket:
    """The way to the server, which ends when this process does."""
    global _server
    with _lock:
        if _server is None:
            _server, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            command = [sys.executable, __file__, str(theirs.fileno())]
            environment = os.environ | {"PYTHONPATH": str(ROOT)}
            process = subprocess.Popen(command, pass_fds=[theirs.fileno()], env=environment)
            theirs.close()
            atexit.register(_end, _server, process)
        return _server


def _end(server: socket.socket, process: subprocess.Popen) -> None:
    server.close()
    try:
        process.wait(5)
    except subprocess.TimeoutExpired:  # a command that runs on has the way to it
        process.kill()
        process.wait()


# -- the server ----------------------------------------------------------------------------------------


def serve(requests: socket.socket) -> dict | None:
    """Forks a process for each request; what is asked of a forked one, None here when nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: it ends with the tests
    woken, waking = os.pipe()
    os.set_blocking(waking, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(waking, warn_on_full_buffer=False)
    run: dict[int, int] = {}  # where it is said how a process has ended, by its number
    while True:
        ready = select.select([requests, woken], [], [])[0]
        if woken in ready:
            os.read(woken, 4096)
            _say_ends(run)
        if requests in ready:
            text, given, *_ = socket.recv_fds(requests, 2**20, 4)
            if not text:
                return None
            *streams, ends = given
            number = os.fork()
            if number == 0:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                signal.signal(signal.SIGINT, signal.default_int_handler)
                requests.close()
                return _become(json.loads(text), streams, unused=(woken, waking, ends, *run.values()))
            run[number] = ends
            os.write(ends, NUMBER.pack(number))
            for stream in streams:
                os.close(stream)


def _say_ends(run: dict[int, int]) -> None:
    for number in list(run):
        found, status = os.waitpid(number, os.WNOHANG)
        if found:
            ends = run.pop(number)
            with suppress(BrokenPipeError):  # nobody asks any more
                os.write(ends, NUMBER.pack(status))
            os.close(ends)


def _become(asked: dict, streams: list[int], unused: tuple[int, ...]) -> dict:
    """Gives this process the directory, environment, input and output that are asked for."""
    for number, given in enumerate(streams):
        os.dup2(given, number)
    for number in (*unused, *streams):
        os.close(number)
    os.chdir(asked["folder"])
    os.environ.clear()
    os.environ.update(asked["environment"])
    time.tzset()
    return asked


def _run(asked: dict) -> None:
    """Runs the program, or a module as `python -m` does."""
    if "module" in asked:
        sys.path[0] = asked["folder"]
        sys.argv = [asked["module"], *asked["arguments"]]
        sys.modules.pop(f"{asked['module']}.__main__", None)  # loaded ahead: runpy would warn of it
        runpy.run_module(asked["module"], run_name="__main__", alter_sys=True)
    else:
        sys.argv = [asked["program"]]
        runpy.run_path(asked["program"], run_name="__main__")


if __name__ == "__main__":
    for name in LOADED:
        importlib.import_module(name)
    assert threading.active_count() == 1
    gc.freeze()
    found = serve(socket.socket(fileno=int(sys.argv[1])))
    if found is not None:
        gc.unfreeze()
        _run(found)
