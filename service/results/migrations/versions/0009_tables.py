"""The first revision: all tables. A later one changes them, and then this one has to say what they were."""

from __future__ import annotations

from alembic import op

from service.results.schema import METADATA

revision = "0009"
down_revision = None


def upgrade() -> None:
    METADATA.create_all(op.get_bind())
