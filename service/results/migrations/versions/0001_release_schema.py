"""The schema of the last release before Alembic: `PRAGMA user_version` 8 of its SQLite files."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from service.results.migrations.release_scripts import statements_from

revision = "0001"
down_revision = None

NUMBER = sa.BigInteger()


def upgrade() -> None:
    """SQLite: whatever an earlier release left is completed; PostgreSQL: the same tables."""
    db = op.get_bind()
    if db.dialect.name == "sqlite":
        version = db.exec_driver_sql("PRAGMA user_version").scalar_one()
        for statement in statements_from(version):
            db.exec_driver_sql(statement)
        return
    _results()
    _submitted()
    _alarms()
    _life()


def downgrade() -> None:
    raise NotImplementedError("there is no schema before this one")


def _asset(primary_key: bool = False) -> sa.Column:
    """The column that names the asset."""
    to = sa.ForeignKey("assets.asset", deferrable=True)
    return sa.Column("asset", sa.Text, to, nullable=False, primary_key=primary_key)


def _id() -> sa.Column:
    return sa.Column("id", NUMBER, primary_key=True)


def _text(name: str, nullable: bool = False) -> sa.Column:
    return sa.Column(name, sa.Text, nullable=nullable)


def _number(name: str, default: str | None = None, nullable: bool = False) -> sa.Column:
    return sa.Column(name, NUMBER, nullable=nullable, server_default=default)


def _results() -> None:
    parts = ("rig", "state", "report", "assembly", "quality", "question", "retired")
    op.create_table(
        "assets",
        sa.Column("asset", sa.Text, primary_key=True),
        *(_text(name, nullable=True) for name in parts),
        *(_number(name, "0") for name in ("windows", "updates", "epoch")),
        _number("received_ns", nullable=True),
    )
    op.create_table(
        "windows",
        _asset(primary_key=True),
        sa.Column("start_ns", NUMBER, primary_key=True, autoincrement=False),
        _text("record"),
        _text("figures"),
        _number("number", "0"),
        _number("epoch", "0"),
    )
    op.create_index("windows_by_number", "windows", ["asset", "number"])
    op.create_index("windows_by_epoch", "windows", ["asset", "epoch", "number"])
    op.create_table("events", _id(), _asset(), _text("kind"), _text("data"))
    op.create_index("events_of_asset", "events", ["asset", "id"])
    op.create_table(
        "fault_totals",
        _asset(primary_key=True),
        *(sa.Column(name, sa.Text, primary_key=True) for name in ("kind", "channel", "action")),
        _number("count"),
        _number("windows"),
    )


def _submitted() -> None:
    op.create_table(
        "inspections",
        _id(),
        _asset(),
        _number("received_ns"),
        _text("inspection"),
        _text("answer"),
        _number("done", "1"),
    )
    op.create_index("inspections_waiting", "inspections", ["done", "id"])
    op.create_table(
        "decisions",
        _id(),
        _asset(),
        _number("received_ns"),
        _text("name"),
        _text("verb"),
        _number("done", "0"),
        *(_text(name, nullable=True) for name in ("refused", "signed_by", "note")),
    )
    op.create_index("decisions_waiting", "decisions", ["done", "id"])


def _alarms() -> None:
    op.create_table("alarm_rules", _asset(primary_key=True), _text("rules"), _text("changed"))
    op.create_table("alarm_memory", _asset(primary_key=True), _text("memory"))
    op.create_table("alarms", _id(), _asset(), _text("name"), _number("open"), _text("record"))
    op.create_index("alarms_open", "alarms", ["asset", "name"], unique=True, postgresql_where=sa.text("open = 1"))
    op.create_table(
        "alarm_history",
        _id(),
        sa.Column("alarm", NUMBER, sa.ForeignKey("alarms.id", deferrable=True), nullable=False),
        _text("entry"),
    )
    op.create_index("history_of_alarm", "alarm_history", ["alarm", "id"])
    op.create_table(
        "webhook_outbox",
        sa.Column("number", NUMBER, primary_key=True),
        *(_text(name) for name in ("name", "url", "body")),
        _number("created_ns"),
        _number("next_ns"),
        _number("attempts", "0"),
    )


def _life() -> None:
    op.create_table(
        "changes",
        _id(),
        _asset(),
        _number("received_ns"),
        _text("kind"),
        _text("given"),
        _number("done", "0"),
        *(_text(name, nullable=True) for name in ("refused", "effect")),
    )
    op.create_index("changes_waiting", "changes", ["done", "id"])
    op.create_table("waiting", _id(), _asset(), _number("start_ns"), _number("bytes"))
    op.create_index("waiting_of_asset", "waiting", ["asset", "id"])
    op.create_table("routes", sa.Column("stream", sa.Text, primary_key=True), _asset())
    op.create_table("baselines", _asset(primary_key=True), _text("file"), _text("about"))
    op.create_table("baseline_numbers", _id())
