"""Fixtures of the answering side: a store and a board in a directory of their own."""

from __future__ import annotations

import os
import shutil
import socket
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import one_partition
import pytest
import service_fakes as fakes
import uvicorn
from browsers import under_policy
from postgresql_server import PostgresqlServer
from postgresql_server import programs as postgresql_server_programs
from service_streams import Service

from service.api import create_app
from service.api.limits import Limits
from service.results import database, migrate
from service.results.sql_store import SqlStore
from service.runtime import delivery
from tests.rules import FLEET


@pytest.fixture(scope="session", autouse=True)
def new_files_are_copied(tmp_path_factory):
    """A new file of SQLite is a copy of one that the program has made: a tenth of the time that its migrations take."""
    made = tmp_path_factory.mktemp("database") / "new.sqlite"
    SqlStore(made).close()
    upgrade = migrate.upgrade

    def copied(backend):
        if backend.path is not None and not backend.path.exists():
            backend.path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(made, backend.path)
        return upgrade(backend)

    with patch.object(database, "upgrade", copied):
        yield


@pytest.fixture(scope="session", autouse=True)
def publishers_look_often():
    """A replay learns within 0.2 s that all is stored, not within 1 s."""
    with patch.object(delivery, "_ASK_AGAIN", (0.05, 0.2)):
        yield


@pytest.fixture(scope="session", autouse=bool(os.environ.get(FLEET)))
def services_are_fleets(postgresql_server):
    """Every service of the tests is a fleet of one partition; only where this run is of fleets."""
    with one_partition.fleets(postgresql_server) as Service.fleets:
        yield
    Service.fleets = None


@pytest.fixture
def new_files_are_made(monkeypatch):
    """Nothing is copied: for tests of the migrations."""
    monkeypatch.setattr(database, "upgrade", migrate.upgrade)


@pytest.fixture
def store(request, tmp_path):
    """A store of one service; that of a front end in modules that say OVER_FLEET."""
    if getattr(request.module, "OVER_FLEET", False):
        yield request.getfixturevalue("fleet_store")
        return
    with SqlStore(tmp_path / "twin.sqlite") as opened:
        yield opened


@pytest.fixture
def share(tmp_path, monkeypatch):
    """A folder as shares of Windows have it: it ignores case and dots at the end of names, and has no `con`."""
    mkdir, folder = Path.mkdir, tmp_path / "share"

    def as_there(path, *given, **other):
        if path.is_relative_to(folder) and path != folder:
            path = path.with_name(path.name.rstrip("."))
            if path.name.partition(".")[0].lower() == "con":
                raise OSError("no such name")
            path = next((p for p in path.parent.iterdir() if p.name.lower() == path.name.lower()), path)
        mkdir(path, *given, **other)

    monkeypatch.setattr(Path, "mkdir", as_there)
    folder.mkdir()
    return folder


@pytest.fixture(scope="session")
def made_fleet(postgresql_server):
    """The name of a database with a fleet, to be copied."""
    from fleets import PARTITIONS

    from service.fleet.databases import engine_of
    from service.fleet.layout import create

    with postgresql_server.new_database() as url:
        engine = engine_of(url)
        create(engine, PARTITIONS)
        engine.dispose()
        yield url.rpartition("/")[2]


@pytest.fixture
def fleet_store(postgresql_server, made_fleet):
    """The store of a front end, over a fleet of three partitions."""
    from fleets import at_front

    with postgresql_server.new_database(template=made_fleet) as url, at_front(url) as opened:
        yield opened


@pytest.fixture(scope="session")
def postgresql_server():
    """A server of PostgreSQL for this process's tests."""
    if postgresql_server_programs() is None:
        reason = "PostgreSQL is not installed (Debian's package postgresql)"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    with PostgresqlServer() as server:
        yield server


@pytest.fixture
def empty_postgresql(postgresql_server):
    """The URL of a database of PostgreSQL in which there is nothing."""
    with postgresql_server.new_database() as url:
        yield url


@pytest.fixture
def fleet(postgresql_server, made_fleet):
    """The URL of the database of a fleet of three partitions."""
    with postgresql_server.new_database(template=made_fleet) as url:
        yield url


@pytest.fixture(scope="session")
def made_postgresql(postgresql_server):
    """The name of a database that the program has made, to be copied: a tenth of the time that its migrations take."""
    with postgresql_server.new_database() as url:
        SqlStore(url).close()
        yield url.rpartition("/")[2]


@pytest.fixture
def postgresql(postgresql_server, made_postgresql):
    """The URL of a new database of PostgreSQL."""
    with postgresql_server.new_database(template=made_postgresql) as url:
        yield url


@pytest.fixture(params=["sqlite", "postgresql"])
def where(request, tmp_path):
    """A new database of each kind, as a store is told it: a file or a URL."""
    return tmp_path / "twin.sqlite" if request.param == "sqlite" else request.getfixturevalue("postgresql")


@pytest.fixture
def each_store(where):
    """A store in each kind of database."""
    with SqlStore(where) as opened:
        yield opened


@pytest.fixture
def board(store):
    """A board over the store."""
    shown = fakes.WrittenTable(store)
    yield shown
    shown.close()


@contextmanager
def serving(board, store, signals=None, access=None):
    """The app over a real socket; yields its address."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        port = listening.getsockname()[1]
        app = create_app(board, store, signals=signals, access=access)
        config = uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=3)
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            while not server.started:
                assert thread.is_alive(), "the server did not start"
                time.sleep(0.01)
            yield f"http://127.0.0.1:{port}"
        finally:
            board.close()
            server.should_exit = True
            thread.join(10)
            assert not thread.is_alive(), "the server did not stop"


@pytest.fixture
def signals():
    """The store of raw signals that the app has; a module of tests may put its own in place."""
    return None


@pytest.fixture
def access():
    """Whom the app lets in; a module of tests may put its own in place."""
    return None


@pytest.fixture
def address(store, board, signals, access):
    with serving(board, store, signals, access) as where:
        yield where


CHROMIUM = Path(os.environ.get("GEAR_TWIN_CHROMIUM", "/usr/bin/chromium"))
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@pytest.fixture(scope="module")
def browser():
    """Chromium, for one module: its event loop runs in this thread, where other modules run their own."""
    if not CHROMIUM.exists():
        reason = f"{CHROMIUM} is not installed (Debian's package chromium; GEAR_TWIN_CHROMIUM names another)"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
        yield chromium
        chromium.close()


@pytest.fixture
def open_page(browser, address):
    """Opens the page at a path; every message of an error and every request elsewhere fails the test.

    Returns once the view is drawn. `allowed` names a text that messages may contain, where the test provokes them.
    """
    opened, wrong = [], []

    def open_at(path="/", width=1440, height=900, allowed=None, **given):
        def note(text):
            if allowed is None or allowed not in text:
                wrong.append(text)

        page = under_policy(browser.new_page(viewport={"width": width, "height": height}, **given))
        page.on("pageerror", lambda error: note(str(error)))
        page.on("console", lambda m: note(m.text) if m.type in ("error", "warning") else None)
        page.on("request", lambda r: None if _own(r.url, address) else note(f"left for {r.url}"))
        page.goto(address + path)
        opened.append(page)
        if not path.startswith("/docs"):
            page.wait_for_selector("main[data-view]:not([data-view=loading])", timeout=15_000)
        return page

    yield open_at
    for page in opened:
        page.close()
    assert wrong == []


def _own(url, address):
    return url.startswith((address, "data:", "blob:"))


@pytest.fixture(scope="module")
def app(tmp_path_factory):
    """The interface to a campaign, called by its name on the plant's network too."""
    with SqlStore(tmp_path_factory.mktemp("attacks") / "twin.sqlite") as store:
        board = fakes.WrittenTable(store)
        fakes.campaign(store, board)
        yield create_app(board, store, limits=Limits(hosts=("twin.plant.example",)))
