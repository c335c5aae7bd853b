"""`gear-twin db`: looking after what a service has kept."""

from __future__ import annotations

import re
import time
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer import Argument, Option

from service.access.roles import Role
from service.cli.assessing import Data, Shown, answering, settings_of, tell
from service.cli.config import ConfigFile
from service.errors import InputError, StoreError
from service.report.words import listed

app = typer.Typer(no_args_is_help=True, help="Look after a database and its files: backups, exports, API keys.")
keys = typer.Typer(no_args_is_help=True, help="Make, list and revoke the API keys of a service.")

Which = Annotated[str, Argument(metavar="KEY", help="Name or identifier of the key, as listed.")]
Archive = Annotated[Path, Argument(metavar="ARCHIVE", help="Archive of a backup (ZIP).")]
What = Literal["windows", "events"]  # can be exported
KEYS = "id state role name created expires"
DAY = 86_400.0  # [s]
EARLIEST, LATEST = -(2**63), 2**63 - 1


@keys.command()
@answering
def add(
    name: Annotated[str, Option(help="Name of the person or program; it signs what is done with the key.")],
    role: Annotated[Role, Option(help="What may be done with it; each role includes the one before.")],
    expires: Annotated[
        str | None, Option(metavar="DATE|DAYSd", help="When it ends, ISO 8601 or as 90d; default: never.")
    ] = None,
    data: Data = None,
    config: ConfigFile = None,
) -> Shown:
    """Make a key. It is printed this once and cannot be shown again: only a salted hash of it is kept."""
    key = _store(data, config).add(name, role, None if expires is None else _expiry(expires))
    note = f"key of {name} with the role {role}: keep it now, it cannot be shown again"
    return Shown({"name": name, "role": role.value, "key": key}, lambda: key, (note,))


@keys.command(name="list")
@answering
def list_(data: Data = None, config: ConfigFile = None) -> Shown:
    """List the keys: their names, roles and times, never the keys themselves."""
    now = time.time()
    found: list[dict[str, Any]] = [
        {
            "id": key.id,
            "name": key.name,
            "role": key.role.value,
            "state": key.state(now),
            "created": _text(key.created),
            "expires": _text(key.expires),
            "revoked": _text(key.revoked),
        }
        for key in _store(data, config).all()
    ]
    return Shown(found, lambda: listed(found, KEYS) or "no keys: only clients of this computer are let in")


@keys.command()
def revoke(which: Which, data: Data = None, config: ConfigFile = None) -> None:
    """Revoke a key: it is refused from now on."""
    key = _store(data, config).revoke(which)
    print(f"revoked: {key.name} ({key.id})")


@keys.command()
def remove(which: Which, data: Data = None, config: ConfigFile = None) -> None:
    """Remove a revoked or expired key from the list."""
    key = _store(data, config).remove(which)
    print(f"removed: {key.name} ({key.id})")


def _store(data: Path | None, config: Path | None) -> Any:
    from service.access.keys import KeyStore

    return KeyStore(settings_of(data=data, config=config).data)


def _expiry(text: str) -> float:
    """Unix time [s] of a date, or of a number of days from now."""
    days = re.fullmatch(r"(\d{1,5})d", text)
    if days:
        return time.time() + int(days[1]) * DAY
    moment = _date(text, f"--expires {text!r} must be a date such as 2027-01-31, or days such as 90d").timestamp()
    if moment <= time.time():
        raise InputError(f"--expires {text!r} is in the past")
    return moment


def _date(text: str, wrong: str) -> datetime:
    """A date, of UTC where it names no zone; InputError says what is wrong."""
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(wrong) from None
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def _text(moment: float | None) -> str | None:
    return None if moment is None else datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _place(data: Path | None, config: Path | None) -> tuple[Path, Path | str]:
    """The data directory and the database."""
    from service.results.data_folder import database_of

    settings = settings_of(data=data, config=config)
    return settings.data, database_of(settings.data, settings.database)


@app.command()
@answering
def backup(
    archive: Archive,
    signals: Annotated[bool, Option("--signals", help="Back up the raw signals, too.")] = False,
    data: Data = None,
    config: ConfigFile = None,
) -> Shown:
    """Write a backup of the database and of the files that it refers to; the service may run."""
    from service.results.archive import backup as make

    made = make(*_place(data, config), archive, signals=signals)
    held = f"{made.assets} assets, {made.windows} windows, {made.files} files, {made.bytes / 1e6:.1f} MB"
    return Shown(asdict(made), lambda: (), (f"{archive}: {held}",))


@app.command()
@answering
def restore(archive: Archive, data: Data = None, config: ConfigFile = None) -> Shown:
    """Bring a backup back into an empty data directory and database, of the other kind too."""
    from service.results.archive import restore as bring_back
    from service.results.data_folder import only_service_of

    folder, where = _place(data, config)
    with only_service_of(folder):
        made = bring_back(archive, folder, where)
    note = f"{folder}: {made.assets} assets, {made.windows} windows as of {made.created}"
    return Shown(asdict(made), lambda: (), (note,))


@app.command()
@answering
def check(data: Data = None, config: ConfigFile = None) -> Shown:
    """Say what is wrong with a database and its files, and how large it becomes; the service may run."""
    from service.results.data_folder import database_of
    from service.results.examination import examine
    from service.results.raw_recordings import kept_in
    from service.results.retention import Retention
    from service.results.store_size import forecast_of

    settings = settings_of(data=data, config=config)
    folder, where = settings.data, database_of(settings.data, settings.database)
    findings, counts = examine(folder, where)
    size = None if findings else forecast_of(where, Retention.of(settings))
    raw = None if settings.raw_folder is None else kept_in(settings.raw_folder)
    shown = {
        "findings": [asdict(f) for f in findings],
        "rows": counts,
        "size": None if size is None else asdict(size),
        "raw": None if raw is None else asdict(raw),
    }
    wrong = [f"{finding.what}\n    {finding.action}" for finding in findings]
    notes = [f"{folder}: nothing is wrong; {sum(counts.values())} rows were read; {size}"]
    if raw is not None:
        notes.append(f"{settings.raw_folder}: {raw}")
    failed = StoreError(f"{len(findings)} things are wrong with the database of {folder}") if findings else None
    return Shown(shown, lambda: wrong, () if failed else tuple(notes), failed)


@app.command()
def export(
    out: Annotated[Path, Argument(metavar="OUT", help="File to write: .csv, .jsonl or .parquet.")],
    what: Annotated[What, Option(help="What is written, a row each.")] = "windows",
    asset: Annotated[list[str] | None, Option(help="An asset; may be repeated; default: all.")] = None,
    begin: Annotated[str | None, Option("--from", metavar="TIME", help="Windows from this time on, ISO 8601.")] = None,
    end: Annotated[str | None, Option("--to", metavar="TIME", help="Windows before this time, ISO 8601.")] = None,
    data: Data = None,
    config: ConfigFile = None,
) -> None:
    """Write results as CSV, JSON Lines or Parquet, by asset and time; the service may run."""
    from service.results.archive import demand_present
    from service.results.export_rows import FORMS
    from service.results.export_rows import export as write
    from service.results.names import Names
    from service.results.sql_store import SqlStore

    form = out.suffix.removeprefix(".")
    if form not in FORMS:
        raise InputError(f"{out}: must end with {', '.join(f'.{name}' for name in FORMS)}")
    if what == "events" and (begin or end):
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
        count = write(store, out, form, what=what, assets=assets, **span)
    tell(f"{out}: {count} {what}")


def _moment(text: str | None, option: str, default: int) -> int:
    """Unix time [ns] of a date."""
    if text is None:
        return default
    found = _date(text, f"{option} {text!r} must be a time such as 2026-01-31 or 2026-01-31T12:00:00Z")
    return int(found.timestamp()) * 10**9 + found.microsecond * 1000


app.add_typer(keys, name="keys")
