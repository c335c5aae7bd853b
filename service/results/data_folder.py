"""What the data directory holds, and where the database is."""

from __future__ import annotations

from pathlib import Path

from pydantic import SecretStr

DATABASE = "gear-twin.sqlite"
SIGNALS = "signals"
WAITING = "waiting"
BASELINES = "baselines"


def database_of(data: Path, database: SecretStr | None) -> Path | str:
    """File of the SQLite database in the data directory, or the URL of another database where one is set."""
    return data / DATABASE if database is None else database.get_secret_value()
