"""`gear-twin example`: published cases computed again and compared with what their authors found."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    no_args_is_help=True, help="Published cases computed again and compared with what their authors found."
)


@app.callback()
def examples() -> None:
    """Published cases computed again and compared with what their authors found."""


@app.command()
def misalignment(
    out: Annotated[Path | None, typer.Option(help="HTML page with figures to write.")] = None,
    json: Annotated[
        Path | None, typer.Option("--json", help="Write the numbers as JSON to this file; - prints.")
    ] = None,
    draws: Annotated[
        int,
        typer.Option(
            min=0, max=1000, help="Sets of all estimated parameters drawn at random, some 4 s each; 0: nominal alone."
        ),
    ] = 20,
) -> None:
    """Spur gears misaligned by 1° as bodies on shafts (Dąbrowski et al. 2012); about 50 s plus the draws."""
    from service.cli.figure_style import STYLE
    from service.cli.show import progress_bar, say
    from service.json_text import write_text, wrote_json
    from studies.misalignment.plots import page
    from studies.misalignment.report import as_numbers, text
    from studies.misalignment.study import study

    with progress_bar("computing") as bar:
        found = study(bar, draws=draws)
    printed = wrote_json(as_numbers(found), json)
    if out is not None:
        write_text(out, page(found, STYLE))
    if not printed:
        print(text(found))
    if out is not None:
        say(f"figures written to {out}")
