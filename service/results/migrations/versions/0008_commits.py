"""The last transaction of everybody who writes, by which an unanswered commit is found out."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    number = sa.BigInteger().with_variant(sa.Integer, "sqlite")
    op.create_table(
        "commits",
        sa.Column("writer", sa.Text, primary_key=True, nullable=False),
        sa.Column("number", number, nullable=False),
        sa.Column("written_ns", number, nullable=False),
    )


def downgrade() -> None:
    op.drop_table("commits")
