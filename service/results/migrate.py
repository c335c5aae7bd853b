"""Brings a database to the schema of this program: Alembic's revisions, run here.

All steps are one transaction: one that fails, or is killed, leaves the schema as it was. A database that another
program wrote is refused: a newer one's, and one from before the first revision.
"""

from __future__ import annotations

from pathlib import Path

import sqlalchemy as sa
from sqlalchemy import Connection

from service.errors import NewerTables, StoreError
from service.results.backends import Backend
from service.results.schema import ASSETS, REVISION

FIRST = "0016"  # revision
VERSION_TABLE = "alembic_version"
FOLDER = Path(__file__).parent / "migrations"


def upgrade(backend: Backend) -> None:
    """Brings the database to the newest schema; StoreError where another program's cannot be."""
    engine = backend.for_migration()
    try:
        with engine.connect() as db, db.begin():
            if present(db, backend) != REVISION:
                make_tables(db)
    finally:
        engine.dispose()


def present(db: Connection, backend: Backend) -> str | None:
    """The revision of a database; None where it is empty. StoreError where it cannot be brought to the newest."""
    tables, stamped = sa.inspect(db), None
    if tables.has_table(VERSION_TABLE):
        stamped = db.exec_driver_sql(f"SELECT version_num FROM {VERSION_TABLE}").scalar()
    if stamped is not None and stamped > REVISION:
        raise NewerTables(
            f"{backend.name} has schema {stamped}, this program knows up to {REVISION}: it was written by a newer "
            "gear-twin"
        )
    if (stamped is None and tables.has_table(ASSETS.name)) or (stamped is not None and stamped < FIRST):
        raise StoreError(
            f"{backend.name} has tables from before the first release, which no program reads any more: begin with "
            "an empty --data directory or database, and assess the recordings anew (gear-twin replay)"
        )
    return stamped


def make_tables(db: Connection) -> None:
    """Carries out Alembic's steps within the transaction of the connection."""
    from alembic.operations import Operations
    from alembic.runtime.migration import MigrationContext
    from alembic.script import ScriptDirectory

    if db.dialect.name == "postgresql":
        db.exec_driver_sql("SELECT pg_advisory_xact_lock(7219431)")  # two programs that start at the same time
    script = ScriptDirectory(str(FOLDER))
    context = MigrationContext.configure(
        db, opts={"fn": lambda revision, context: script._upgrade_revs("head", revision), "transactional_ddl": True}
    )
    with Operations.context(context):
        context.run_migrations()
