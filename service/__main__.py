"""`gear-twin`, and `python -m service`."""

from __future__ import annotations

import logging
import os
import sys
import threading
from typing import NoReturn


def main() -> None:
    """Runs the command line and ends the process with its exit status."""
    from service.cli import run

    try:
        status = run(sys.argv[1:])
    except Exception:
        sys.excepthook(*sys.exc_info())
        status = 1
    leave(status)


def leave(status: int) -> NoReturn:
    """Ends the process; at once where Zenoh is loaded or the twin still processes a window.

    Zenoh's own threads, which live on after a session is closed, and a window's would need the interpreter while it is
    torn down, and that ends in an abort. What is committed stays; the window being processed is left to the next start.
    """
    at_work = any(thread.name.startswith("twin") and thread.is_alive() for thread in threading.enumerate())
    if not at_work and "zenoh" not in sys.modules:
        sys.exit(status)
    logging.shutdown()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:  # the reader has gone
        status = status or 1
    os._exit(status)


if __name__ == "__main__":
    main()
