"""Windows that wait say where their asset's stream went on before them."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"


def upgrade() -> None:
    op.add_column("waiting", sa.Column("before", sa.LargeBinary))


def downgrade() -> None:
    op.drop_column("waiting", "before")
