"""A backup: one archive (ZIP) of the database and of the files that it refers to, with checksums.

    manifest.json       what it is, and size and SHA-256 of every file
    database.sqlite     all tables as of one moment, whichever kind of database they are of
    segments/, baselines/               files of the data directory; raw signals where they are asked for

It is made while the service runs. Restoring verifies the whole archive before anything is changed, and never writes
over anything; the target may be of the other kind.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from service import __version__
from service.errors import InputError, StoreError
from service.results.backends import Backend, SqliteFile, backend_of
from service.results.data_folder import BASELINES, DATABASE, SEGMENTS
from service.results.migrate import present, upgrade
from service.results.schema import FOLDERS, REVISION
from service.results.storage_faults import storage_error
from service.results.table_copy import copy_rows, count_rows

FORMAT = 1
MANIFEST = "manifest.json"
COPY = "database.sqlite"
TRIES = 5  # to find database and files of one moment
BLOCK = 2**20  # bytes read at a time


@dataclass(frozen=True, slots=True, kw_only=True)
class Backup:
    """What an archive holds."""

    created: str
    schema: str  # revision of its tables
    assets: int
    windows: int
    files: int
    bytes: int


def backup(data: Path, where: Path | str, archive: Path, *, signals: bool = False) -> Backup:
    """Writes an archive of a service's data directory and database, whole or not at all; the service may run.

    signals  whether the raw signals are part of it
    """
    if archive.exists():
        raise InputError(f"{archive} exists already: give another name, or remove it")
    backend = backend_of(where)
    if backend.path is not None and not backend.path.exists():
        raise InputError(f"{backend.path} does not exist: there is nothing to back up")
    unfinished = archive.with_name(f"{archive.name}.part")
    try:
        with storage_faults(str(archive)), TemporaryDirectory(prefix=".backup-", dir=data) as folder:
            held = Path(folder)
            _snapshot(data, backend, held, signals)
            made = _packed(held, unfinished)
            unfinished.replace(archive)
    finally:
        unfinished.unlink(missing_ok=True)
    return made


def restore(archive: Path, data: Path, where: Path | str) -> Backup:
    """Brings an archive back into an empty data directory and database, which no service uses meanwhile."""
    backend = backend_of(where)
    _demand_empty(data, backend)
    with storage_faults(str(data)), TemporaryDirectory(prefix=".restore-", dir=data) as folder:
        held = Path(folder)
        manifest = _unpacked(archive, held)
        _demand_sound(held / COPY, archive)
        try:
            upgrade(SqliteFile(held / COPY))
        except StoreError as error:
            raise StoreError(str(error).replace(str(held / COPY), f"the database of {archive}")) from error
        for name in (SEGMENTS, BASELINES):
            if (held / name).exists():
                (held / name).replace(data / name)
        if isinstance(backend, SqliteFile):
            backend.path.parent.mkdir(parents=True, exist_ok=True)
            (held / COPY).replace(backend.path)
        else:
            _into_server(held / COPY, backend)
    return Backup(**manifest["about"])


# -- making --------------------------------------------------------------------------------------------


def _snapshot(data: Path, backend: Backend, held: Path, signals: bool) -> None:
    """Files and database as of one moment: a file that is deleted meanwhile stays here, by a link."""
    for _ in range(TRIES):
        _link(data, held, SEGMENTS, BASELINES)
        (held / COPY).unlink(missing_ok=True)
        _copy_database(backend, held / COPY)
        _link(data, held, SEGMENTS, BASELINES)
        named = _named(held / COPY, signals)
        missing = [data / place for place in named if named[place] and not (held / place).exists()]
        if not missing:
            break
    else:
        raise StoreError(
            f"{missing[0]} is named by the database and is not there: `gear-twin db check` says what to do"
        )
    for path in (held / SEGMENTS).glob("*"):
        if path.relative_to(held) not in named:
            path.unlink()  # of windows that are no part of this moment, or of raw signals that are not asked for


def _copy_database(backend: Backend, copy: Path) -> None:
    if backend.path is not None:
        with closing(sqlite3.connect(backend.path)) as present_file, closing(sqlite3.connect(copy)) as kept:
            present_file.backup(kept)  # one step: as of one moment, and holding up nobody who writes
            kept.execute("PRAGMA journal_mode = DELETE")
        _demand_sound(copy, backend.path)
        _of_no_folder(copy)
        return
    fresh = SqliteFile(copy)
    upgrade(fresh)
    source_engine, target_engine = backend.for_reading(), fresh.for_migration()
    try:
        with source_engine.connect().execution_options(isolation_level="REPEATABLE READ") as source:
            if present(source, backend) != REVISION:
                raise StoreError(f"{backend.name} holds no results")
            with target_engine.connect() as target, target.begin():
                copy_rows(source, target)
    finally:
        source_engine.dispose()
        target_engine.dispose()
    with closing(sqlite3.connect(copy)) as db:
        db.execute("PRAGMA journal_mode = DELETE")
    _of_no_folder(copy)


def _of_no_folder(copy: Path) -> None:
    """Takes out which folder holds the segments: it is where a backup is brought back to."""
    with closing(sqlite3.connect(copy)) as db, db:
        db.execute(f"DELETE FROM {FOLDERS.name}")


def _link(data: Path, held: Path, *folders: str) -> None:
    """Hard links to all files of some folders; one that goes away meanwhile is left out."""
    for name in folders:
        for path in sorted((data / name).rglob("*")) if (data / name).is_dir() else ():
            link = held / path.relative_to(data)
            if path.is_file() and path.suffix != ".part" and not link.exists():
                link.parent.mkdir(parents=True, exist_ok=True)
                try:
                    os.link(path, link)
                except FileNotFoundError:
                    continue


def _named(copy: Path, signals: bool) -> dict[Path, bool]:
    """The files that a database names, and whether it cannot do without each; no raw signals where they are no part."""
    with closing(sqlite3.connect(copy)) as db, db:
        if not signals:
            db.execute("UPDATE windows SET segment = NULL WHERE segment IS NOT NULL")
        kept = db.execute("SELECT segment FROM windows WHERE segment IS NOT NULL").fetchall()
        waiting = db.execute("SELECT file FROM jobs WHERE kind = 'window'").fetchall()
        own = db.execute("SELECT file FROM baselines").fetchall()
    named = {Path(SEGMENTS, name): False for (name,) in kept}
    return named | {
        Path(folder, name): True for folder, rows in ((SEGMENTS, waiting), (BASELINES, own)) for (name,) in rows
    }


def _packed(held: Path, archive: Path) -> Backup:
    with closing(sqlite3.connect(held / COPY)) as db:
        assets = db.execute("SELECT COUNT(*) FROM assets").fetchone()[0]
        windows = db.execute("SELECT COUNT(*) FROM windows").fetchone()[0]
    files = sorted(path for path in held.rglob("*") if path.is_file())
    about = {
        "created": datetime.now(UTC).isoformat(timespec="seconds"), "schema": REVISION, "assets": assets,
        "windows": windows, "files": len(files) - 1, "bytes": sum(path.stat().st_size for path in files),
    }  # fmt: skip
    members = {}
    with archive.open("wb") as file:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED, allowZip64=True) as packed:
            for path in files:
                name = path.relative_to(held).as_posix()
                members[name] = {"bytes": path.stat().st_size, "sha256": _sha256(path)}
                packed.write(path, name)
            manifest = {"format": FORMAT, "program": f"gear-twin {__version__}", "about": about, "files": members}
            packed.writestr(MANIFEST, json.dumps(manifest, indent=1))
        file.flush()
        os.fsync(file.fileno())
    return Backup(**about)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


# -- bringing back -------------------------------------------------------------------------------------


def _demand_empty(data: Path, backend: Backend) -> None:
    """InputError where something would be written over."""
    data.mkdir(parents=True, exist_ok=True)
    for name in (DATABASE, SEGMENTS, BASELINES):
        path = data / name
        if path.is_file() or (path.is_dir() and any(path.iterdir())):
            raise InputError(f"{path} is there already: a backup is restored into an empty data directory")
    if backend.path is not None:
        if backend.path.exists():
            raise InputError(f"{backend.path} is there already: a backup is restored in place of no database")
        return
    with storage_faults(backend.name):
        upgrade(backend)
        engine = backend.for_migration()
        with engine.connect() as db:
            filled = [name for name, count in count_rows(db).items() if count]
        engine.dispose()
    if filled:
        raise InputError(f"{backend.name} has rows in {', '.join(filled)}: a backup is restored into an empty database")


def _unpacked(archive: Path, held: Path) -> dict[str, Any]:
    """The manifest, when all files are unpacked and are what was written; InputError where they are not."""
    try:
        with zipfile.ZipFile(archive) as packed:
            manifest = json.loads(packed.read(MANIFEST))
            if manifest["format"] != FORMAT:
                raise InputError(f"{archive} has format {manifest['format']}, this program knows {FORMAT}")
            for name, expected in manifest["files"].items():
                path = (held / name).resolve()
                if held.resolve() not in path.parents or not _is_ours(name):
                    raise InputError(f"{archive} names a file outside of a data directory: {name}")
                path.parent.mkdir(parents=True, exist_ok=True)
                with packed.open(name) as source, path.open("wb") as target:
                    shutil.copyfileobj(source, target, BLOCK)
                if path.stat().st_size != expected["bytes"] or _sha256(path) != expected["sha256"]:
                    raise InputError(f"{archive} is damaged: {name} is not what was written")
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError, EOFError, NotImplementedError) as error:
        raise InputError(f"{archive} is no whole backup of gear-twin: {error}") from None
    except FileNotFoundError:
        raise InputError(f"{archive} does not exist") from None
    return manifest


def _is_ours(name: str) -> bool:
    return name == COPY or name.split("/")[0] in (SEGMENTS, BASELINES)


def _demand_sound(copy: Path, of: Path) -> None:
    with closing(sqlite3.connect(copy)) as db:
        try:
            found = db.execute("PRAGMA integrity_check(1)").fetchone()[0]
        except sqlite3.DatabaseError as error:
            found = str(error)
    if found != "ok":
        raise StoreError(f"the database of {of} is damaged ({' '.join(found.split())}): `gear-twin db check` says more")


def _into_server(copy: Path, backend: Backend) -> None:
    source = SqliteFile(copy)
    from_file, to_server = source.for_migration(), backend.for_migration()
    try:
        with from_file.connect() as rows, to_server.connect() as target, target.begin():
            copied = copy_rows(rows, target)
            if copied != count_rows(target):
                raise StoreError(f"{backend.name} did not take all rows: it was left empty")
    finally:
        from_file.dispose()
        to_server.dispose()


@contextmanager
def storage_faults(where: str) -> Iterator[None]:
    """Failures of files and databases as errors of the service."""
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        raise storage_error(error, where) or StoreError(f"{where}: {error}") from error
    except SQLAlchemyError as error:
        cause = getattr(error, "orig", None) or error
        raise storage_error(cause, where) or StoreError(f"{where}: {str(cause).splitlines()[0]}") from error


def demand_present(where: Path | str) -> None:
    """InputError where the database is not there, or holds no results."""
    backend = backend_of(where)
    if backend.path is not None and not backend.path.exists():
        raise InputError(f"{backend.path} does not exist")
    engine = backend.for_reading()
    try:
        with storage_faults(backend.name), engine.connect() as db:
            if present(db, backend) != REVISION:
                raise InputError(f"{backend.name} holds no results")
    finally:
        engine.dispose()
