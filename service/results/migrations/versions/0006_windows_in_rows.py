"""SQLite keeps windows in an ordinary table: one without row numbers gives each row of 1 kB and more a page of its own.

The file does not become smaller by that; what is free in it is used for the next windows.
"""

from __future__ import annotations

from alembic import op

revision = "0006"
down_revision = "0005"

COLUMNS = "asset, start_ns, record, figures, number, epoch, seal, notable"
TABLE = """CREATE TABLE windows (
        asset TEXT NOT NULL REFERENCES assets(asset),
        start_ns INTEGER NOT NULL,
        record TEXT NOT NULL,
        figures TEXT NOT NULL, number INTEGER NOT NULL DEFAULT 0, epoch INTEGER NOT NULL DEFAULT 0, \
seal BIGINT, notable BIGINT DEFAULT '0' NOT NULL,
        PRIMARY KEY (asset, start_ns)
    )"""
INDEXES = {"windows_by_number": "asset, number", "windows_by_epoch": "asset, epoch, number"}


def upgrade() -> None:
    _rebuild(TABLE)


def downgrade() -> None:
    _rebuild(f"{TABLE} WITHOUT ROWID")


def _rebuild(table: str) -> None:
    if op.get_bind().dialect.name != "sqlite":
        return
    op.execute("ALTER TABLE windows RENAME TO windows_before")
    for name in INDEXES:
        op.execute(f"DROP INDEX {name}")
    op.execute(table)
    op.execute(f"INSERT INTO windows ({COLUMNS}) SELECT {COLUMNS} FROM windows_before ORDER BY asset, start_ns")
    op.execute("DROP TABLE windows_before")
    for name, columns in INDEXES.items():
        op.execute(f"CREATE INDEX {name} ON windows ({columns})")
