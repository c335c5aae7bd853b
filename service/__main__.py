"""`gear-twin`, and `python -m service`."""

from __future__ import annotations

import os
import sys
import threading


def main() -> None:
    """Runs the command line and ends the process with its exit status."""
    from service.cli import run

    leave(run(sys.argv[1:]))


def leave(status: int) -> None:
    """Ends the process; at once where the twin is still at work on a window.

    What is committed stays, and that window is left to the next start: tearing the interpreter down under a running
    thread would end in an abort.
    """
    if any(thread.name == "twin" and thread.is_alive() for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    main()
