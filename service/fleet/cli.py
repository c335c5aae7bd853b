"""`gear-twin fleet assess`; what it needs is imported when it runs."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.assessing import Prefix
from service.cli.config import configured

if TYPE_CHECKING:
    from service.fleet.assess_task import Work

MOST_SAID = 20  # refusals that are printed; the summary holds all of them
REFUSED = 2  # exit status where a recording was refused

fleet_app = typer.Typer(no_args_is_help=True, help="Many machines, and many recordings.")


class Update(StrEnum):
    """The method that sets the wear depth."""

    fused = "fused"
    rms = "rms"


@fleet_app.command()
@configured
def assess(
    recordings: Annotated[
        list[str],
        typer.Argument(
            metavar="RECORDINGS…",
            help="Recordings (MCAP), folders of them, or URLs of an object store, such as s3://bucket/raw.",
        ),
    ],
    results: Annotated[str, typer.Option(metavar="WHERE", help="Folder or URL for the results.", show_default=False)],
    workers: Annotated[
        int | None, typer.Option(min=1, help="Recordings at a time; default: one for each core.")
    ] = None,
    address: Annotated[
        str | None,
        typer.Option(help="Ray cluster that computes, such as 10.0.0.1:6379; default: this machine alone."),
    ] = None,
    rig: Annotated[Path | None, typer.Option(help="Rig file; default: the one attached to each recording.")] = None,
    update: Annotated[
        Update | None,
        typer.Option(
            help="Method that sets the depth: transmission error (fused) or vibration level (rms); default: the "
            "setting, else fused."
        ),
    ] = None,
    no_trace: Annotated[bool, typer.Option("--no-trace", help="Model wear alone: do not search for effects.")] = False,
    relation: Annotated[
        Path | None, typer.Option(help="Relation of level and depth (from `relate`), for machines without a model.")
    ] = None,
    detectability: Annotated[
        Path | None, typer.Option(help="What simulated healthy machines of the rig show (from `detectability`).")
    ] = None,
    false_alarm_rate: Annotated[
        float | None,
        typer.Option(help="Share of campaigns of healthy machines in which an effect may be reported; default 0.01."),
    ] = None,
    asset: Annotated[str | None, typer.Option(help="The asset, if recordings contain several.")] = None,
    prefix: Prefix = None,
    json: Annotated[
        Path | None, typer.Option("--json", help="Write the summary as JSON to this file; - is standard output.")
    ] = None,
) -> int:
    """Assess many recordings side by side; a run that was interrupted goes on where it ended."""
    from service.cli.assessing import tell
    from service.cli.show import progress_bar
    from service.fleet.batch import SUMMARY, assess_all
    from service.json_text import wrote_json
    from service.results.stored_recordings import stored_recordings

    work = work_of(
        results, rig, None if update is None else update.value, not no_trace, relation, detectability,
        false_alarm_rate, asset, prefix,
    )  # fmt: skip
    found = stored_recordings(recordings)
    done = 0
    with progress_bar("assessing") as bar:

        def progress(summary: Any, total: int) -> None:
            nonlocal done
            done = len(summary.outcomes)
            bar(done / total, f"{done} of {total} recordings, {summary.counts['refused']} refused")

        try:
            summary = assess_all(found, work, progress, workers=workers, address=address)
        except KeyboardInterrupt:
            tell(f"{done} of {len(found)} recordings are done; the same command goes on with the others")
            raise
    for reason in summary.refused[:MOST_SAID]:
        tell(reason)
    if len(summary.refused) > MOST_SAID:
        tell(f"{len(summary.refused) - MOST_SAID} more were refused: see {results}/{SUMMARY}")
    if not wrote_json(summary.as_json(work), json):
        counts = summary.counts
        print(
            f"{counts['assessed']} recordings assessed, {counts['found']} found done, {counts['refused']} refused: "
            f"{results}"
        )
    return REFUSED if summary.refused else 0


def work_of(
    results: str,
    rig: Path | None,
    update: str | None,
    trace: bool,
    relation: Path | None = None,
    detectability: Path | None = None,
    false_alarm_rate: float | None = None,
    asset: str | None = None,
    prefix: str | None = None,
) -> Work:
    """What is done with each recording, by the options and the settings; InputError where a file cannot be used."""
    from dataclasses import asdict
    from hashlib import sha256

    from service.cli.assessing import prefix_of, settings_of, windowing
    from service.file_faults import reading
    from service.files.rig import load_rig
    from service.fleet.assess_task import Work
    from service.json_text import plain
    from service.runtime.by_settings import detectability_files, options_of

    def content(path: Path) -> bytes:
        with reading(path):
            return path.read_bytes()

    def digest(path: Path | None) -> str | None:
        return None if path is None else sha256(content(path)).hexdigest()

    if rig is not None:
        load_rig(rig)
    settings, assembly = settings_of(), windowing()
    options = options_of(
        settings, update=update, trace=trace, relation=relation, detectability=detectability,
        false_alarm_rate=false_alarm_rate,
    )  # fmt: skip
    files = detectability_files(settings, detectability)
    given = {
        "update": options.update,
        "error_threshold": options.error_threshold,
        "trace": options.trace,
        "false_alarm_rate": options.false_alarm_rate,
        "status_limits": asdict(options.status_limits),
        "assembly": asdict(assembly),
        "baseline": digest(settings.baseline),
        "relation": digest(relation or settings.relation),
        "detectability": sorted(digest(path) or "" for path in files),
        "rig": digest(rig),
        "asset": asset,
        "prefix": prefix_of(prefix),
    }
    return Work(
        results=results if "://" in results else os.path.abspath(results),
        options=options,
        assembly=assembly,
        prefix=prefix_of(prefix),
        given=plain(given),
        rig=None if rig is None else (rig.name, content(rig)),
        asset=asset,
    )
