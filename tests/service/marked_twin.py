"""The fake twin, noting in a file each window that it is given; as a program, `gear-twin fleet assess` with it.

python marked_twin.py MARKS SECONDS fleet assess ...
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import fake_twin

from service.runtime.twin_port import Twin


def step(rig, state, window, options):
    """Notes the window, by its asset's rig and its time, and how often."""
    marks, seconds = options
    time.sleep(seconds)
    state, estimate = fake_twin.step(rig, state, window, None)
    line = f"{rig.name} {window.start_time_ns} {os.getpid()}\n".encode()
    opened = os.open(marks, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(opened, line)
    os.close(opened)
    return state, estimate


def marked(marks: Path, seconds: float = 0.0) -> Twin:
    """The twin, with its file and what a window takes [s]."""
    return replace(fake_twin.TWIN, step=step, options=(str(marks), seconds))


if __name__ == "__main__":
    import marked_twin

    from service.__main__ import main
    from service.cli import commands
    from service.fleet import cli

    _, marks, seconds, *arguments = sys.argv
    if "fleet" not in {group.name for group in commands.app.registered_groups}:
        commands.app.add_typer(cli.fleet_app, name="fleet")
    work_of, twin = cli.work_of, marked_twin.marked(Path(marks), float(seconds))
    cli.work_of = lambda *given: replace(work_of(*given), twin=twin)
    sys.argv = ["gear-twin", *arguments]
    main()
