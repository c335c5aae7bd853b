"""What is wrong with a database and the files that it refers to, and what to do: `gear-twin db check`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import sqlalchemy as sa
from sqlalchemy import Connection
from sqlalchemy.exc import SQLAlchemyError

from service.errors import DamageError
from service.results.backends import backend_of
from service.results.data_folder import BASELINES, SEGMENTS
from service.results.json_columns import load, seal
from service.results.migrate import present
from service.results.schema import ASSETS, JOBS, METADATA, WINDOW, WINDOWS
from service.results.schema import BASELINES as OWN_BASELINES
from service.results.segment_file import read_segment

RESTORE = "restore the latest backup into an empty directory (`gear-twin db restore`)"
MOST_SAID = 100  # findings of one kind
_SEGMENTS = sa.select(WINDOWS.c.segment).where(WINDOWS.c.segment.is_not(None))


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that is wrong."""

    what: str
    action: str


def examine(data: Path, where: Path | str) -> tuple[list[Finding], dict[str, int]]:
    """Everything that is wrong, and how many rows of each table were read. The service may run."""
    backend = backend_of(where)
    if backend.path is not None and not backend.path.exists():
        return [Finding(what=f"{backend.path} is not there", action=RESTORE)], {}
    engine = backend.for_reading()
    findings: list[Finding] = []
    counts: dict[str, int] = {}
    try:
        with engine.connect() as db:
            findings += _of_the_file(db) if backend.path is not None else []
            if present(db, backend) is None:
                return [*findings, Finding(what=f"{backend.name} holds no results", action=RESTORE)], {}
            for table in METADATA.sorted_tables:
                counts[table.name] = 0
                for finding in _of_rows(db, table, counts):
                    findings.append(finding)
            findings += _of_files(db, data)
    except SQLAlchemyError as error:
        cause = str(getattr(error, "orig", None) or error).splitlines()[0]
        findings.append(Finding(what=f"{backend.name} cannot be read on: {cause}", action=RESTORE))
    finally:
        engine.dispose()
    return findings, counts


def _of_the_file(db: Connection) -> Iterator[Finding]:
    """What SQLite itself finds."""
    for (found,) in db.exec_driver_sql(f"PRAGMA integrity_check({MOST_SAID})").all():
        if found != "ok":
            yield Finding(what=f"the file is damaged: {' '.join(found.split())}", action=RESTORE)
    for row in db.exec_driver_sql("PRAGMA foreign_key_check").all()[:MOST_SAID]:
        yield Finding(what=f"a row of {row[0]} belongs to no row of {row[2]}", action=RESTORE)


def _of_rows(db: Connection, table: sa.Table, counts: dict[str, int]) -> Iterator[Finding]:
    """Values that are not what was written."""
    kept = [column.name for column in table.c if isinstance(column.type, sa.LargeBinary)]
    key = list(table.primary_key.columns)
    said = 0
    with db.execute(sa.select(table).order_by(*key).execution_options(yield_per=500)) as rows:
        for row in rows.mappings():
            counts[table.name] += 1
            what = f"{table.name} {', '.join(str(row[column.name]) for column in key)}"
            for finding in _of_row(table, row, kept, what):
                said += 1
                if said <= MOST_SAID:
                    yield finding


def _of_row(table: sa.Table, row: sa.RowMapping, kept: list[str], what: str) -> Iterator[Finding]:
    for name in kept:
        try:
            load(row[name], f"{name} of {what}")
        except DamageError as error:
            yield Finding(what=str(error), action=_action(table, name))
    sealed = None
    if table is WINDOWS:
        sealed = seal(row["start_ns"], row["number"], row["epoch"])
    elif table is ASSETS and row["seal"] is not None:
        sealed = seal(*(row[name] for name in ("windows", "updates", "received_ns", "epoch")))
    if sealed is not None and sealed != row["seal"]:
        yield Finding(what=f"numbers of {what} are damaged", action=_action(table, "state"))


def _action(table: sa.Table, column: str) -> str:
    if table is ASSETS and column != "report":
        return f"{RESTORE}: the asset's windows wait until then"
    if table is ASSETS:
        return "nothing: the asset's next window writes it anew"
    return f"nothing, if it can be done without: it is left out of all answers; otherwise {RESTORE}"


def _of_files(db: Connection, data: Path) -> Iterator[Finding]:
    """Files that the database refers to."""
    for (file,) in db.execute(sa.select(OWN_BASELINES.c.file)).all():
        if not (data / BASELINES / file).is_file():
            yield Finding(what=f"the baseline {data / BASELINES / file} is not there", action=RESTORE)
    waiting = sa.select(JOBS.c.id, JOBS.c.asset, JOBS.c.file).where(JOBS.c.kind == WINDOW)
    for number, asset, file in db.execute(waiting).all():
        path = data / SEGMENTS / file
        try:
            read_segment(path)
        except FileNotFoundError:
            if db.execute(sa.select(JOBS.c.id).where(JOBS.c.id == number)).first() is None:
                continue  # it was processed while this looked
            action = "send the recordings from then on again: the service goes on before it"
            yield Finding(what=f"{path}, a window of {asset} that waits, is not there", action=action)
        except (OSError, ValueError) as error:
            action = "nothing: the service refuses this window and counts it"
            yield Finding(what=f"{path}, a window of {asset} that waits, cannot be read: {error}", action=action)
    for file in db.execute(_SEGMENTS).scalars().all():
        path = data / SEGMENTS / file
        if not path.is_file() and db.execute(_SEGMENTS.where(WINDOWS.c.segment == file)).first() is not None:
            action = "nothing, if it can be done without: the views of its window say that it has been deleted"
            yield Finding(what=f"the raw signals {path} are not there", action=action)
