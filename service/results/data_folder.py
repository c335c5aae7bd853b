"""What the data directory holds, and where the database is."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pydantic import SecretStr

from service.errors import InputError

DATABASE = "gear-twin.sqlite"
SEGMENTS = "segments"  # of windows that wait, and of those whose signals are kept
BASELINES = "baselines"
ROLES_END = 2.0  # how long the roles of a service that was killed are waited for [s]


def database_of(data: Path, database: SecretStr | None) -> Path | str:
    """File of the SQLite database in the data directory, or the URL of another database where one is set."""
    return data / DATABASE if database is None else database.get_secret_value()


@contextmanager
def only_service_of(data: Path) -> Iterator[None]:
    """Holds the data directory; InputError where another service has it.

    The folder itself is locked as well as a file in it: a file can be deleted while it is held. NFS locks files alone.
    """
    with ExitStack() as held:
        try:
            data.mkdir(parents=True, exist_ok=True)
            folder = os.open(data, os.O_RDONLY)
            held.callback(os.close, folder)
            file = held.enter_context((data / "service.lock").open("w"))
        except OSError as error:
            raise InputError(f"{data}: cannot be the data directory: {error.strerror}") from None
        with suppress(OSError):  # the file's lock holds alone where folders have none
            _lock(folder, data)
        try:
            _lock(file.fileno(), data)
        except OSError as error:
            raise InputError(
                f"{data}: its file system cannot lock the file service.lock ({error.strerror}), so nothing keeps "
                "a second service out; give a directory on a disk of this computer, or on NFS with its lock service"
            ) from None
        yield


def _lock(descriptor: int, data: Path) -> None:
    """Locks a file or folder until it is closed; OSError where its file system cannot.

    The roles of a service hold it, too: where that was killed, they end within a moment.
    """
    until = time.monotonic() + ROLES_END
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() >= until:
                raise InputError(f"{data}: another service has this data directory; give another") from None
        time.sleep(0.02)
