"""`gear-twin backup`, `restore`, `export`, `check`: looking after what a service has kept."""

from __future__ import annotations

from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.assessing import settings_of, tell
from service.cli.config import ConfigFile

Data = Annotated[Path | None, typer.Option(help="Data directory of the service; default: .gear-twin.")]
Archive = Annotated[Path, typer.Argument(metavar="ARCHIVE", help="Archive of a backup (ZIP).")]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
]
EARLIEST, LATEST = -(2**63), 2**63 - 1


class What(StrEnum):
    """What can be exported."""

    windows = "windows"
    events = "events"


def _place(data: Path | None, config: Path | None) -> tuple[Path, Path | str]:
    """The data directory and the database."""
    from service.results.data_folder import database_of

    settings = settings_of(data=data, config=config)
    return settings.data, database_of(settings.data, settings.database)


def backup(
    archive: Archive,
    signals: Annotated[bool, typer.Option("--signals", help="Back up the raw signals, too.")] = False,
    data: Data = None,
    config: ConfigFile = None,
    json: JsonFile = None,
) -> None:
    """Write a backup of the database and of the files that it refers to; the service may run."""
    from dataclasses import asdict

    from service.json_text import wrote_json
    from service.results.archive import backup as make

    made = make(*_place(data, config), archive, signals=signals)
    wrote_json(asdict(made), json)
    tell(f"{archive}: {made.assets} assets, {made.windows} windows, {made.files} files, {made.bytes / 1e6:.1f} MB")


def restore(archive: Archive, data: Data = None, config: ConfigFile = None, json: JsonFile = None) -> None:
    """Bring a backup back into an empty data directory and database, of the other kind too."""
    from dataclasses import asdict

    from service.json_text import wrote_json
    from service.results.archive import restore as bring_back
    from service.results.data_folder import only_service_of

    folder, where = _place(data, config)
    with only_service_of(folder):
        made = bring_back(archive, folder, where)
    wrote_json(asdict(made), json)
    tell(f"{folder}: {made.assets} assets, {made.windows} windows as of {made.created}")


def check(data: Data = None, config: ConfigFile = None, json: JsonFile = None) -> None:
    """Say what is wrong with a database and its files, and how large it becomes; the service may run."""
    from dataclasses import asdict

    from service.errors import StoreError
    from service.json_text import wrote_json
    from service.results.data_folder import database_of
    from service.results.examination import examine
    from service.results.raw_recordings import kept_in
    from service.results.store_size import forecast_of
    from service.runtime.retention_job import retention_of

    settings = settings_of(data=data, config=config)
    folder, where = settings.data, database_of(settings.data, settings.database)
    findings, counts = examine(folder, where)
    size = None if findings else forecast_of(where, retention_of(settings))
    raw = None if settings.raw_folder is None else kept_in(settings.raw_folder)
    shown = {
        "findings": [asdict(f) for f in findings],
        "rows": counts,
        "size": None if size is None else asdict(size),
        "raw": None if raw is None else asdict(raw),
    }
    if not wrote_json(shown, json):
        for finding in findings:
            print(f"{finding.what}\n    {finding.action}")
    if findings:
        raise StoreError(f"{len(findings)} things are wrong with the database of {folder}")
    tell(f"{folder}: nothing is wrong; {sum(counts.values())} rows were read; {size}")
    if raw is not None:
        tell(f"{settings.raw_folder}: {raw}")


def export(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="File to write: .csv, .jsonl or .parquet.")],
    what: Annotated[What, typer.Option(help="What is written, a row each.")] = What.windows,
    asset: Annotated[list[str] | None, typer.Option(help="An asset; may be repeated; default: all.")] = None,
    begin: Annotated[
        str | None, typer.Option("--from", metavar="TIME", help="Windows from this time on, ISO 8601.")
    ] = None,
    end: Annotated[str | None, typer.Option("--to", metavar="TIME", help="Windows before this time, ISO 8601.")] = None,
    data: Data = None,
    config: ConfigFile = None,
) -> None:
    """Write results as CSV, JSON Lines or Parquet, by asset and time; the service may run."""
    from service.errors import InputError
    from service.results.archive import demand_present
    from service.results.export_rows import FORMS
    from service.results.export_rows import export as write
    from service.results.names import Names
    from service.results.sql_store import SqlStore

    form = out.suffix.removeprefix(".")
    if form not in FORMS:
        raise InputError(f"{out}: must end with {', '.join(f'.{name}' for name in FORMS)}")
    if what is What.events and (begin or end):
        raise InputError("--from and --to choose windows; events are exported whole")
    _, where = _place(data, config)
    demand_present(where)
    span = {"begin_ns": _moment(begin, "--from", EARLIEST), "end_ns": _moment(end, "--to", LATEST)}
    with SqlStore(where) as store:
        labels = Names(store.database).labels()
        for name in asset or ():
            if name not in labels.values():
                raise InputError(f"there is no asset {name}; there are {', '.join(sorted(labels.values())) or 'none'}")
        assets = {own: label for own, label in labels.items() if not asset or label in asset}
        count = write(store, out, form, what=what.value, assets=assets, **span)
    tell(f"{out}: {count} {what.value}")


def _moment(text: str | None, option: str, default: int) -> int:
    """Unix time [ns] of a date."""
    from service.errors import InputError

    if text is None:
        return default
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(f"{option} {text!r} must be a time such as 2026-01-31 or 2026-01-31T12:00:00Z") from None
    moment: Any = found if found.tzinfo else found.replace(tzinfo=UTC)
    return int(moment.timestamp()) * 10**9 + moment.microsecond * 1000
