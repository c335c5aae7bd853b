"""`gear-twin replay`, `record`, `simulate` and `example`: recordings published, made of a stream, and simulated."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from service.cli.assessing import Data, Prefix, Recording, RigFile, Shown, answering, settings_of, tell
from service.cli.config import ConfigFile
from service.cli.show import progress_bar
from service.errors import DeliveryError, InputError
from service.file_faults import reading
from service.json_text import write_text
from service.termination import until_told

CLOCKS_DIFFER = 60.0  # by which a logger's clock may be ahead of this computer's [s]
Connect = Annotated[list[str] | None, Option(help="Endpoint of a service or router, such as tcp/127.0.0.1:7447.")]
Listen = Annotated[list[str] | None, Option(help="Endpoint at which to open a Zenoh router.")]

example = typer.Typer(
    no_args_is_help=True, help="Published cases computed again and compared with what their authors found."
)


@answering
def replay(
    recording: Recording,
    connect: Connect = None,
    speed: Annotated[
        float,
        Option(min=0.0, help="Factor on the recorded speed; 0: as fast as subscribers receive it, without pauses."),
    ] = 1.0,
    max_pause: Annotated[
        float, Option(min=0.0, help="Longest pause between frames that is kept, in seconds of the recording.")
    ] = float("inf"),
    wait: Annotated[float, Option(min=0.1, help="Seconds to wait for a router and a subscriber.")] = 30.0,
    asset: Annotated[str | None, Option(help="Publish under this asset's name in place of the recording's.")] = None,
    prefix: Prefix = None,
    recorded: Annotated[
        str | None, Option(metavar="PREFIX", help="First part of the recording's topics, where it is another.")
    ] = None,
    future: Annotated[
        bool, Option("--future", help="Take a recording that is dated in the future, such as a simulated one.")
    ] = False,
    config: ConfigFile = None,
) -> Shown:
    """Publish a recording on Zenoh as it was recorded, or faster; ends when the service has stored all of it."""
    from service.logs import logging_by
    from service.runtime.replay import replay as run
    from service.transport.zenoh import open_publisher

    if not speed < float("inf"):
        raise InputError(f"--speed {speed:g} must be a number from 0 up")
    settings = settings_of(config=config, prefix=prefix)
    begun = time.monotonic()
    with logging_by(settings), progress_bar("replaying") as bar:
        delivered = run(
            recording,
            connect or settings.connect or settings.listen,
            speed,
            max_pause=max_pause,
            prefix=settings.prefix,
            wait=wait,
            progress=lambda share, frames: bar(share, f"{frames} frames"),
            on_fault=tell,
            asset=asset,
            recorded=recorded,
            until=float("inf") if future else time.time() + CLOCKS_DIFFER,
            publish_to=partial(open_publisher, links=settings.zenoh_links),
        )
    seconds = time.monotonic() - begun
    data = {"frames": delivered, "seconds": seconds}
    return Shown(data, lambda: f"{delivered} frames stored in {seconds:.2f} s")


@answering
def record(
    out: Annotated[
        Path | None,
        Option(help="MCAP file to write; default: without end, as the settings of raw recordings say."),
    ] = None,
    connect: Connect = None,
    listen: Listen = None,
    duration: Annotated[float, Option(min=0.0, help="Stop after this many seconds; default: at Ctrl-C.")] = float(
        "inf"
    ),
    rig: RigFile = None,
    description: Annotated[str, Option(help="Text for the recording's metadata; with --out.")] = "recorded live",
    data: Data = None,
    prefix: Prefix = None,
    config: ConfigFile = None,
) -> Shown:
    """Record a live stream into a file (MCAP), or all streams into a folder of rolling files."""
    from service.logs import logging_by

    settings = settings_of(config=config, prefix=prefix, data=data, rig=rig if out is None else None)
    where = out or settings.raw_url or settings.raw_folder
    if where is None:
        raise InputError("give --out FILE, or set folder or url in the table [raw] of the settings")
    with logging_by(settings):
        source = connect or ([] if listen else settings.connect)
        if not source and not listen:
            raise InputError("give --connect ENDPOINT of a router, or --listen ENDPOINT to open one")
        links = settings.zenoh_links
        if out is None:
            done = keep_live(settings, source, listen, duration)
        else:
            done = record_live(out, source, listen, duration, rig, description, settings.prefix, links)
    lacking = (
        f"{sum(done[1:])} frames are not in {where}: {done.missed} were lost on the way, {done.left_out} came faster "
        f"than they could be written, and {done.refused} break the contract"
    )
    failed = DeliveryError(lacking) if any(done[1:]) and out is not None else None
    notes = (lacking,) if any(done[1:]) and out is None else ()  # it had no end that it could have missed
    data_of = {"recording": str(where), **done._asdict()}
    return Shown(data_of, lambda: f"{done.frames} frames recorded: {where}", notes, failed)


def keep_live(settings: Any, connect: Sequence[str] | None, listen: Sequence[str] | None, duration: float) -> Any:
    """Records by the table [raw] of the settings; answers how many frames were written, and what became of others."""
    from service.results.data_folder import database_of
    from service.results.database import Database
    from service.runtime.raw_recorder import keep_recording
    from service.transport.zenoh import open_zenoh

    where = database_of(settings.data, settings.database)
    there = not isinstance(where, Path) or where.exists()
    transport = partial(open_zenoh, listen or (), connect or (), settings.prefix, 30.0, settings.zenoh_links)
    with until_told() as stop:
        if duration < float("inf"):
            over = threading.Timer(duration, stop.set)
            over.daemon = True
            over.start()
        return keep_recording(
            settings, transport, stop=stop, open_database=partial(Database, where, shared=True) if there else None
        )


def record_live(
    out: Path,
    connect: Sequence[str] | None,
    listen: Sequence[str] | None,
    duration: float,
    rig: Path | None,
    description: str,
    prefix: str,
    links: Any,
) -> Any:
    """Records; answers how many frames were written, and what became of the others."""
    from service.runtime.record import record as written
    from service.stream.inbox import Inbox
    from service.transport.zenoh import open_zenoh

    with reading(rig or "", "rig file"):
        rig_text = rig.read_bytes() if rig else None
    inbox = Inbox(prefix=prefix)
    with (
        until_told() as stop,
        open_zenoh(listen or (), connect or (), prefix, wait=30.0, links=links) as transport,
        progress_bar("recording") as bar,
    ):
        return written(
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


@answering
def simulate(
    spec: Annotated[Path, Argument(metavar="SPEC", help="Specification of the campaign (TOML).")],
    out: Annotated[Path, Option(help="MCAP file to write.", show_default=False)],
    truth: Annotated[Path | None, Option(help="File for the true wear and effects (JSON).")] = None,
) -> Shown:
    """Simulate a wear campaign into a recording, with an independent simulator."""
    from recordings import simulate_file
    from recordings.generator.errors import SpecError

    with progress_bar("simulating") as bar:
        try:
            simulate_file(spec, out, truth, bar)
        except SpecError as error:
            raise InputError(str(error)) from None
        except OSError as error:
            raise InputError(f"{error.filename}: {(error.strerror or 'fault').lower()}") from None
    data = {"recording": str(out), "truth": str(truth) if truth else None}
    return Shown(data, lambda: f"simulated: {out}")


@example.callback()
def examples() -> None:
    """Published cases computed again and compared with what their authors found."""


@example.command()
@answering
def misalignment(
    out: Annotated[Path | None, Option(help="HTML page with figures to write.")] = None,
    draws: Annotated[
        int,
        Option(
            min=0, max=1000, help="Sets of all estimated parameters drawn at random, some 4 s each; 0: nominal alone."
        ),
    ] = 20,
) -> Shown:
    """Spur gears misaligned by 1° as bodies on shafts (Dąbrowski et al. 2012); about 50 s plus the draws."""
    from service.report.pages import STYLE
    from studies.misalignment.plots import page
    from studies.misalignment.report import as_numbers, text
    from studies.misalignment.study import study

    with progress_bar("computing") as bar:
        found = study(bar, draws=draws)
    if out is not None:
        write_text(out, page(found, STYLE))
    return Shown(as_numbers(found), lambda: text(found), () if out is None else (f"figures written to {out}",))
