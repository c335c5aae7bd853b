"""A host as an actor of Ray, which starts it again when its process ends.

Only `engine` imports this file, in a process that uses Ray; Ray's workers load it with the actor.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from contextlib import suppress

from service.fleet.host import BEGIN, Host
from service.fleet.layout import END_WAIT

FAILED = 70  # exit status of a process whose host could not go on: EX_SOFTWARE


class HostActor:
    """Has a process of its own be a host, from its begin to its end: Ray's own processes have threads, and the
    supervisor of roles must have none.
    """

    def __init__(self, host: Host) -> None:
        path = os.pathsep.join(map(os.path.abspath, sys.path))
        self._ending, self._began = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._serve, args=(host, path), name="host", daemon=True)
        self._thread.start()
        self._began.wait()

    def end(self) -> None:
        """Ends the work: what is committed stays, and what waits is left to the next start."""
        self._ending.set()
        self._process.terminate()
        self._thread.join(END_WAIT)

    def _serve(self, host: Host, path: str) -> None:
        """Waits for the end of the process, which the kernel ends with this thread."""
        self._process = subprocess.Popen(
            [sys.executable, "-c", BEGIN, str(os.getpid())], stdin=subprocess.PIPE,
            env=os.environ | {"PYTHONSAFEPATH": "1", "PYTHONPATH": path},
        )  # fmt: skip
        self._began.set()
        with suppress(BrokenPipeError):  # it has ended already
            self._process.communicate(pickle.dumps(host))
        if not self._ending.is_set():
            os._exit(FAILED)
