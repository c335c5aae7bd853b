"""A server of PostgreSQL of the tests' own: in a temporary directory and on a free port of the loopback."""

from __future__ import annotations

import itertools
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
from contextlib import contextmanager
from pathlib import Path

import sqlalchemy as sa

SETTINGS = ("fsync=off", "synchronous_commit=off", "max_connections=60", "listen_addresses=127.0.0.1")


def programs() -> Path | None:
    """The folder of PostgreSQL's programs, the newest; None where it is not installed."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    return found[-1].parent if found else None


class PostgresqlServer:
    """Starts at entry, ends at exit; `stop` and `start` in between are an outage.

    within    the folder in which its own is made; None for that of temporary files
    settings  of the server
    """

    def __init__(self, within=None, settings=SETTINGS):
        self._within, self._settings = within, settings

    def __enter__(self):
        self._bin = programs()
        self._user = "postgres" if os.geteuid() == 0 else None  # it refuses to run as root
        self.folder = Path(tempfile.mkdtemp(prefix="gear-twin-postgresql-", dir=self._within))
        if self._user:
            owner = pwd.getpwnam(self._user)
            os.chown(self.folder, owner.pw_uid, owner.pw_gid)
        self.data, self._count = self.folder / "data", itertools.count()
        self._run("initdb", "-D", self.data, "-A", "trust", "-U", "twin", "--no-sync", "-E", "UTF8", "--locale=C")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.start()
        return self

    def __exit__(self, *_):
        self.stop("immediate")
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self):
        here = (f"port={self.port}", f"unix_socket_directories={self.folder}")
        options = " ".join(f"-c {setting}" for setting in (*self._settings, *here))
        self._run("pg_ctl", "-D", self.data, "-w", "-t", "30", "-l", self.folder / "log", "-o", options, "start")

    def stop(self, how="fast"):
        self._run("pg_ctl", "-D", self.data, "-w", "-m", how, "stop")

    def kill(self):
        """As the machine's power going."""
        os.kill(self.first_process, signal.SIGKILL)

    @contextmanager
    def frozen(self):
        """The server takes connections and answers none, as one that is suspended."""
        os.kill(first := self.first_process, signal.SIGSTOP)
        try:
            yield
        finally:
            os.kill(first, signal.SIGCONT)

    @property
    def first_process(self):
        """The one that starts all others."""
        return int((self.data / "postmaster.pid").read_text().split()[0])

    def url(self, name):
        return f"postgresql://twin@127.0.0.1:{self.port}/{name}"

    @contextmanager
    def new_database(self, encoding="UTF8", template="template0"):
        """The URL of an empty database, or of a copy of another."""
        name = f"twin_{next(self._count)}"
        self.sql(f"CREATE DATABASE {name} ENCODING '{encoding}' TEMPLATE {template}")
        try:
            yield self.url(name)
        finally:
            self.sql(f"DROP DATABASE {name} WITH (FORCE)")

    def sql(self, statement, name="postgres"):
        """Carries out a statement as an administrator; its rows."""
        engine = sa.create_engine(
            self.url(name).replace("postgresql:", "postgresql+psycopg:"), isolation_level="AUTOCOMMIT",
            poolclass=sa.NullPool,
        )  # fmt: skip
        with engine.connect() as db:
            result = db.exec_driver_sql(statement)
            return result.all() if result.returns_rows else []

    def _run(self, program, *arguments):
        done = subprocess.run(
            [self._bin / program, *map(str, arguments)], user=self._user, cwd=self.folder, text=True,
            stdout=subprocess.PIPE if program == "initdb" else subprocess.DEVNULL, stderr=subprocess.STDOUT,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout or (self.folder / "log").read_text()[-2000:]
