"""`gear-twin record`: from a live stream to a file, until Ctrl-C, a termination signal or the time is up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Sequence
from pathlib import Path

from service.cli.show import progress_bar
from service.errors import InputError
from service.runtime.record import Recorded, record
from service.stream.inbox import Inbox
from service.transport.zenoh import open_zenoh
from service.transport.zenoh_links import NONE, ZenohLinks


def record_live(
    out: Path,
    connect: Sequence[str] | None,
    listen: Sequence[str] | None,
    duration: float,
    rig: Path | None,
    description: str,
    prefix: str,
    links: ZenohLinks = NONE,
) -> Recorded:
    """Records; answers how many frames were written, and what became of the others."""
    if not connect and not listen:
        raise InputError("give --connect ENDPOINT of a router, or --listen ENDPOINT to open one")
    try:
        rig_text = rig.read_bytes() if rig else None
    except OSError as error:
        raise InputError(f"{rig}: rig file cannot be read: {(error.strerror or 'fault').lower()}") from None
    stop = threading.Event()
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    inbox = Inbox(prefix=prefix)
    try:
        with (
            open_zenoh(listen or (), connect or (), prefix, wait=30.0, links=links) as transport,
            progress_bar("recording") as bar,
        ):
            return record(
                transport,
                inbox,
                out,
                stop=stop,
                duration=duration,
                rig_text=rig_text,
                description=description,
                prefix=prefix,
                progress=lambda frames, refused: bar(0.0, f"{frames} frames, {refused} refused"),
            )
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
