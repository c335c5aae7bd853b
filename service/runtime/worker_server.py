"""The server of processes: Python's own, which has loaded the twin once and forks the workers of this process.

It is started with the modules of this process, ends with it, and is killed where it does not answer.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from contextlib import suppress
from multiprocessing import forkserver
from multiprocessing.context import BaseContext

PARENT_DEATH = 1  # of prctl: which signal comes once the process has ended that made this one
QUIET_TRACKER = "ignore:resource_tracker:UserWarning"
_server_starts = threading.Lock()


def start_server() -> None:
    """Starts the server that makes processes, unless it runs, with the modules of this process.

    Python would have it look first in the folder in which the command was started, whatever lies there.
    """
    given = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))}
    with _server_starts:
        before = {name: os.environ.get(name) for name in given}
        os.environ.update(given)
        try:
            forkserver.ensure_running()
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


def kill_server() -> None:
    """Kills the server that makes processes, also where it has been stopped."""
    server = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
    if server is not None:
        with suppress(ProcessLookupError):
            os.kill(server, signal.SIGKILL)


def end_with_server() -> None:
    """Within a process that the server has made: the kernel ends it with the server, and that ends with the service.

    Also where it is suspended: in the midst of a transaction it would hold up the next start.
    """
    ctypes.CDLL(None).prctl(PARENT_DEATH, signal.SIGKILL)
    os.close(forkserver._forkserver._forkserver_alive_fd)  # type: ignore[attr-defined]  # by which the server would live


def server_context() -> BaseContext:
    """How processes are started: a server that has loaded the twin forks them.

    A service that ends at once leaves locks to Python's tracker of resources, which removes them and need not say so.
    """
    if QUIET_TRACKER not in sys.warnoptions:
        sys.warnoptions.append(QUIET_TRACKER)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["service.runtime.worker_loading"])
    return context
