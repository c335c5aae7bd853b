"""The audit log: who changed what, when and why. Entries can be added, and the oldest removed, but none changed."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"

NUMBER = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    texts = ("kind", "action", "outcome")
    optional = ("name", "role", "address", "asset", "note", "reference")
    op.create_table(
        "audit",
        sa.Column("id", NUMBER, primary_key=True, autoincrement=True),
        sa.Column("at_ns", NUMBER, nullable=False),
        *(sa.Column(name, sa.Text, nullable=False) for name in texts),
        *(sa.Column(name, sa.Text, nullable=True) for name in optional),
        sa.Column("number", NUMBER, nullable=True),
        sa.Column("what", sa.LargeBinary, nullable=False),
        sqlite_autoincrement=True,
    )


def downgrade() -> None:
    op.drop_table("audit")
