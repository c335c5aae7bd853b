"""The whole service over another network and another store, each one file; nothing of Zenoh or SQLite is in it."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from unittest.mock import patch

import fake_twin
import pytest
from memory_transport import MemoryNetwork
from one_partition import served_as_a_fleet
from pydantic import SecretStr
from service_streams import Service, SqliteFile, wait_until, write_recording
from test_decisions import post

from service.json_text import plain
from service.runtime import pump
from service.runtime.assess import assess
from service.runtime.replay import replay
from service.runtime.serve import run
from service.settings import Settings

WINDOWS = 4
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


@contextmanager
def serving(data, network, store, **given):
    """The service in a thread of this process; a reader of its REST."""
    addresses, stop, failed = [], threading.Event(), []
    settings = Settings(http="127.0.0.1:0", data=data, idle_timeout=0.7, **given)
    with_all = {"twin": fake_twin.TWIN, "open_transport": network.open, "announce": addresses.append, "stop": stop}
    if Service.fleets is not None and isinstance(store, SqliteFile):
        database = Service.fleets.database({"DATA": str(data)})
        serve_it = partial(served_as_a_fleet, settings.model_copy(update={"database": SecretStr(database)}))
    else:
        serve_it = partial(run, settings, open_store=store.open)

    def serve():
        try:
            with patch.object(pump, "JOINED", fake_twin.JOINED):
                serve_it(**with_all)
        except Exception as error:
            failed.append(error)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        wait_until(lambda: addresses or failed)
        assert not failed, failed
        reader = Service(data)
        reader.http = addresses[0].removeprefix("http://").strip("/")
        yield reader
    finally:
        stop.set()
        thread.join(20)
    assert not thread.is_alive() and not failed


@pytest.mark.slow
def test_service_runs_over_a_network_in_memory_and_goes_on_after_a_restart(tmp_path, recording):
    network, store = MemoryNetwork(), SqliteFile(tmp_path)
    assessed = plain(assess(recording, twin=fake_twin.TWIN))
    with serving(tmp_path, network, store) as running:
        replay(recording, (), 0, publish_to=network.open_publisher)
        assert running.wait_for_windows(WINDOWS) == assessed["windows"]
        assert network.announced == {"unsw"}
        assert running.get("/v1/assets/unsw/rig")["name"] == "unsw"  # offered on the network
        wait_until(lambda: json.loads(network.published[-1][1])["windows_total"] == WINDOWS)
        assert network.published[-1][0] == "unsw"
        assert json.loads(network.source.state_text("unsw"))["wear"] == assessed["wear"]
        status, answer = post(running, "/v1/assets/unsw/effects/misalignment", {"decision": "pin"})
        assert (status, answer["done"]) == (200, True)
        given = {"revolutions": 1200.0, "max_depth_um": 30.0, "flank": "combined", "std_um": 1.0}
        assert post(running, "/v1/assets/unsw/inspections", given)[0] == 201
        assert 'gear_twin_frames_left_out_total{cause="no_room"} 0.0' in running.text("/metrics")
        before = running.get("/v1/assets/unsw")
    assert network.announced == set()
    with serving(tmp_path, network, store) as again:
        assert again.get("/v1/assets/unsw") == before
        assert len(again.get("/v1/assets/unsw/inspections")) == 1
        replay(recording, (), 0, publish_to=network.open_publisher)  # what was counted is known
        wait_until(lambda: network.inbox.depth == 0)
        assert len(again.windows()) == WINDOWS


def test_network_that_is_off_is_awaited_and_named(tmp_path):
    network = MemoryNetwork(reachable=False)
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        wait_until(lambda: "the network in memory is off" in _reason(running))
        network.reachable = True
        wait_until(lambda: running.get("/readyz") is not None)


def _reason(running):
    try:
        urllib.request.urlopen(f"http://{running.http}/readyz", timeout=5).close()
    except urllib.error.HTTPError as error:
        with error:
            return json.load(error)["detail"]
    return ""


def test_queue_is_bounded_by_the_bytes_of_the_settings(tmp_path):
    network = MemoryNetwork()
    given = {"queue_bytes": 2**20}
    with serving(tmp_path, network, SqliteFile(tmp_path), **given):
        assert network.subscribed.wait(10)
        assert network.inbox._most_bytes == 2**20


@cache
def imported(file: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.slow
@pytest.mark.parametrize(
    ("package", "homes"),
    [
        ("zenoh", {"transport/zenoh.py", "transport/zenoh_session.py"}),
        ("sqlite3", {"results/archive.py", "results/backends.py"}),
        ("psycopg", {"results/backends.py", "results/bounded_connection.py"}),
    ],
)
def test_one_file_alone_knows_the_network_and_one_the_database(package, homes):
    knowing = {str(f.relative_to(ROOT / "service")) for f in (ROOT / "service").rglob("*.py") if package in imported(f)}
    assert knowing == homes


def test_stores_alone_know_how_tables_are_asked():
    knowing = {f.relative_to(ROOT / "service").parts[0] for f in (ROOT / "service").rglob("*.py") if asks_tables(f)}
    assert knowing == {"results", "fleet"}


def asks_tables(file: Path) -> bool:
    return bool(imported(file) & {"sqlalchemy", "alembic"})


@pytest.mark.slow
def test_service_over_other_parts_loads_neither_zenoh_nor_sqlite_nor_the_twin_that_its_workers_compute_with():
    code = (
        "import sys; import service.runtime.receiver, service.runtime.pipeline, service.api, service.results.snapshot; "
        "assert 'zenoh' not in sys.modules, 'zenoh'; assert 'sqlite3' not in sys.modules, 'sqlite3'; "
        "parts = 'twin.state', 'twin.effects', 'twin.dynamics', 'twin.updating'; "
        "twin = {m for m in sys.modules if m.startswith(parts)}; "
        "assert not twin, twin"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
