"""`gear-twin doctor`: what a recording and a rig file support, and what one more sensor would add."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.assessing import Prefix


def doctor(
    recording: Annotated[
        Path | None, typer.Argument(metavar="[RECORDING]", help="Recording (MCAP).", show_default=False)
    ] = None,
    rig: Annotated[
        Path | None, typer.Option("--rig", help="Rig file; default: the one attached to the recording.")
    ] = None,
    asset: Annotated[str | None, typer.Option(help="The asset, if a recording contains several.")] = None,
    prefix: Prefix = None,
    json: Annotated[
        Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
    ] = None,
) -> None:
    """Examine a recording and a rig file: what they support, likely mistakes, and what one more sensor would add."""
    from service.cli.assessing import prefix_of, windowing
    from service.cli.init import print_abilities
    from service.json_text import wrote_json
    from service.setup.examination import examined

    found = examined(recording, rig, asset, windowing(), prefix_of(prefix))
    if wrote_json(found.as_json(), json):
        return
    _print_channels(found)
    _print_findings(found)
    print_abilities(found.abilities, found.one_more_sensor)


def _print_channels(found: Any) -> None:
    from rich.console import Console
    from rich.table import Table

    print(f"recording: {found.recording or 'none'}\nrig file: {found.rig or 'none: nothing is known of the machine'}")
    if not found.channels:
        return
    table = Table(title=f"Channels, first {found.windows} windows", title_justify="left", box=None, pad_edge=False)
    for head in ("channel", "rate", "duration", "level"):
        table.add_column(head, overflow="fold", justify="right" if head == "duration" else "left")
    for row in found.channels:
        table.add_row(row.label, row.rate, f"{row.duration:.4g} s", row.level)
    console = Console(highlight=False)
    console.print()
    console.print(table)


def _print_findings(found: Any) -> None:
    if not found.findings:
        return
    print("\nFindings")
    order = {"problem": 0, "note": 1, "ok": 2}
    for finding in sorted(found.findings, key=lambda f: order[f.level]):
        print(f"{finding.level:8}{finding.text}")
        if finding.remedy:
            print(f"{'':8}→ {finding.remedy}")
