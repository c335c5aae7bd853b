"""`gear-twin relate` and `gear-twin depths`: the relation of vibration level and wear depth, and depths by it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.cli.assessing import tell
from service.json_text import write_text, wrote_json

JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
]


def relate(
    series: Annotated[
        Path, typer.Argument(metavar="SERIES", help="Series file (TOML): levels at measured wear depths.")
    ],
    source: Annotated[
        Path | None, typer.Option(help="Table of records (CSV) instead of the one that the series file names.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="HTML page with figures to write.")] = None,
    relation: Annotated[Path | None, typer.Option(help="Relation file to write, for `serve --relation`.")] = None,
    draws: Annotated[int, typer.Option(min=0, max=200, help="Number of draws of the estimated values.")] = 12,
    json: JsonFile = None,
) -> None:
    """Calibrate the relation of vibration level and wear depth on measured depths, and test causes of its error."""
    from service.cli import relation_report as shown
    from service.cli.show import progress_bar
    from service.errors import InputError
    from service.files import relation as relating
    from service.files.series import load_series
    from twin.errors import TwinError

    known = load_series(series, source)
    with progress_bar("relating") as bar:
        try:
            tried = relating.tried_on(known, draws, bar)
        except TwinError as error:
            raise InputError(f"{series}: {error}") from None
    answer = relating.answer(known, tried)
    printed = wrote_json(answer, json)
    if relation is not None:
        relating.save_relation(known, tried, relation)
    if out is not None:
        write_text(out, shown.page(answer))
    if not printed:
        print(shown.text(answer))
    for path, what in ((out, "figures"), (relation, "relation")):
        if path is not None:
            tell(f"{what} written to {path}")


def depths(
    relation: Annotated[Path, typer.Argument(metavar="RELATION", help="Relation file (from `relate`).")],
    table: Annotated[Path, typer.Argument(metavar="TABLE", help="Levels (CSV), a row a record, columns as `relate`.")],
    delimiter: Annotated[str, typer.Option(help="Between the columns of the table.")] = ",",
    out: Annotated[Path | None, typer.Option(help="CSV file to write.")] = None,
    json: JsonFile = None,
) -> None:
    """Wear depths of a table of vibration levels, by a relation of level and depth."""
    from service.cli.relation_report import depths_text
    from service.files.level_table import as_csv, depths_of
    from service.files.relation import read_relation

    found = depths_of(read_relation(relation), table, delimiter)
    printed = wrote_json(found, json)
    if out is not None:
        write_text(out, as_csv(found))
        tell(f"{len(found)} depths written to {out}")
    elif not printed:
        print(depths_text(found))
