"""Temporary folders that are deleted even where the process that made them was killed: by the next that needs one."""

from __future__ import annotations

import fcntl
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

PREFIX = "gt-fleet-"  # short: Ray's sockets are below, and their names are bounded
YOUNG = 60.0  # a folder of this age may not have been locked yet [s]


@contextmanager
def scratch() -> Iterator[Path]:
    """An empty folder, until left."""
    _delete_abandoned()
    with TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as name:
        lock = os.open(name, os.O_RDONLY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield Path(name)
        finally:
            os.close(lock)


def _delete_abandoned() -> None:
    for left in Path(gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError):
            if time.time() - left.stat().st_mtime < YOUNG:
                continue
            lock = os.open(left, os.O_RDONLY)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # OSError where somebody uses it
                shutil.rmtree(left, ignore_errors=True)
            finally:
                os.close(lock)
