"""Brings a database to the schema of this program, and back to that of an earlier one: Alembic's revisions, run here.

All steps are one transaction: one that fails, or is killed, leaves the schema as it was. Before a file of SQLite is
changed it is copied; a database that a newer program wrote is refused.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import Connection

from service.errors import NewerTables, StoreError
from service.results.backends import Backend
from service.results.migrations.release_scripts import SCRIPTS
from service.results.schema import REVISION

RELEASE = "0001"  # the revision of the last release that knows nothing of revisions ...
VERSION_TABLE = "alembic_version"  # ... and has no such table
FOLDER = Path(__file__).parent / "migrations"


def upgrade(backend: Backend) -> Path | None:
    """Brings the database to the newest schema; the copy of the file as it was before, None where none was needed.

    StoreError where it was written by a newer program.
    """
    engine = backend.for_migration()
    try:
        with engine.connect() as db, db.begin():
            revision = present(db, backend)
            if revision == REVISION:
                return None
            copy = None if revision is None or backend.path is None else _copied(backend.path)
            _run(db, lambda script: script._upgrade_revs("head", _stamped(db)))
            _finish(db, backend, REVISION)
            return copy
    finally:
        engine.dispose()


def downgrade(backend: Backend, revision: str = RELEASE) -> None:
    """Brings the database back to an earlier schema; that of the last release without revisions by default."""
    engine = backend.for_migration()
    try:
        with engine.connect() as db, db.begin():
            present(db, backend)
            _run(db, lambda script: script._downgrade_revs(revision, _stamped(db)))
            _finish(db, backend, revision)
            if revision == RELEASE and backend.path is not None:  # no release without revisions knows a server
                db.exec_driver_sql(f"DROP TABLE {VERSION_TABLE}")
    finally:
        engine.dispose()


def present(db: Connection, backend: Backend) -> str | None:
    """The revision of a database; None where it is empty. StoreError where a newer program wrote it."""
    stamped, version = _stamped(db), 0
    if backend.path is not None:
        version = db.exec_driver_sql("PRAGMA user_version").scalar_one()
    if version > user_version(REVISION) or (stamped or "") > REVISION:
        raise NewerTables(
            f"{backend.name} has schema version {max(version, user_version(stamped or RELEASE))}, this program knows "
            f"up to {user_version(REVISION)}: it was written by a newer gear-twin"
        )
    if stamped is not None:
        return stamped
    return f"release {version}" if version else None


def user_version(revision: str) -> int:
    """`PRAGMA user_version` of SQLite's files at a revision, which earlier releases ask for."""
    return len(SCRIPTS) + int(revision) - int(RELEASE)


def _stamped(db: Connection) -> str | None:
    """The revision that Alembic wrote down."""
    if not sa.inspect(db).has_table(VERSION_TABLE):
        return None
    return db.exec_driver_sql(f"SELECT version_num FROM {VERSION_TABLE}").scalar()


def _run(db: Connection, steps_of: Callable[[Any], Any]) -> None:
    """Carries out Alembic's steps within the transaction of the connection."""
    from alembic.operations import Operations
    from alembic.runtime.migration import MigrationContext
    from alembic.script import ScriptDirectory

    if db.dialect.name == "postgresql":
        db.exec_driver_sql("SELECT pg_advisory_xact_lock(7219431)")  # two programs that start at the same time
    script = ScriptDirectory(str(FOLDER))
    context = MigrationContext.configure(
        db, opts={"fn": lambda revision, context: steps_of(script), "transactional_ddl": True}
    )
    with Operations.context(context):
        context.run_migrations()


def _finish(db: Connection, backend: Backend, revision: str) -> None:
    """Says which schema a file of SQLite has now; StoreError, which undoes all, where a row refers to none."""
    if db.dialect.name != "sqlite":
        return
    db.exec_driver_sql(f"PRAGMA user_version = {user_version(revision)}")
    broken = db.exec_driver_sql("PRAGMA foreign_key_check").all()
    if broken:
        raise StoreError(f"{backend.name} has rows of {broken[0][0]} that belong to no row of {broken[0][2]}")


def _copied(path: Path) -> Path:
    """A copy of the file as it is committed."""
    copy = path.with_name(f"{path.name}.before-{REVISION}")
    unfinished = copy.with_name(f"{copy.name}.part")
    unfinished.unlink(missing_ok=True)
    try:
        with closing(sqlite3.connect(path)) as present, closing(sqlite3.connect(unfinished)) as kept:
            present.backup(kept)
        unfinished.replace(copy)
    finally:
        unfinished.unlink(missing_ok=True)
    return copy
