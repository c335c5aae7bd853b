"""`gear-twin import`: a data file into a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.cli.assessing import tell
from service.json_text import wrote_json


def import_(
    mapping: Annotated[
        Path, typer.Argument(metavar="MAPPING", help="Mapping file (TOML): which column is which channel.")
    ],
    out: Annotated[Path, typer.Option(help="MCAP file to write.", show_default=False)],
    source: Annotated[Path | None, typer.Option(help="Data file instead of the one that the mapping names.")] = None,
    json: Annotated[
        Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
    ] = None,
) -> None:
    """Convert a data file (CSV, MAT, WAV, TDMS, HDF5, …) into a recording."""
    from service.cli.show import progress_bar
    from service.files.import_recording import import_recording

    with progress_bar("importing") as bar:
        found = import_recording(mapping, out, lambda done, total: bar(done / max(total, 1), f"{done} frames"), source)
    if not wrote_json(found, json):
        print(f"{found['frames']} frames of {found['duration']:g} s imported: {out}")
    for label, counts in found["encoders"].items():
        if any(counts.get(fault) for fault in ("illegal_transitions", "reversals", "missed", "doubled")):
            tell(f"{label}: {found['notes'][label]}")
