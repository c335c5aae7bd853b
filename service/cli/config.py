"""`gear-twin config`: the settings in effect, each with where it comes from, and a file with all of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ConfigFile = Annotated[
    Path | None, typer.Option("--config", help="Configuration file (TOML).", envvar="GEAR_TWIN_CONFIG")
]


def config(
    config: ConfigFile = None,
    example: Annotated[
        bool, typer.Option("--example", help="Print a commented file with every setting instead.")
    ] = False,
    json: Annotated[
        Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
    ] = None,
) -> None:
    """Print the settings in effect, each with where it comes from; secrets are masked."""
    from service.configuration.load import load, origins
    from service.configuration.printed import effective, effective_text, example_text
    from service.json_text import wrote_json

    if example:
        print(example_text(), end="")
        return
    settings = load(config=config)
    where = origins({"config": config})
    if not wrote_json(effective(settings, where), json):
        print(effective_text(settings, where))
