"""The first revision: all tables. A later one changes them, and then this one has to say what they were."""

from __future__ import annotations

from alembic import op
from sqlalchemy import text

from service.results.schema import METADATA

revision = "0010"
down_revision = None


def upgrade() -> None:
    METADATA.create_all(op.get_bind())
    if op.get_bind().dialect.name == "postgresql":  # whose dialect no table names, because a start would load it
        op.drop_index("alarms_open")
        op.create_index("alarms_open", "alarms", ["asset", "name"], unique=True, postgresql_where=text("open = 1"))
