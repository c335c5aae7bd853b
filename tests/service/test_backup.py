"""Backup, restore, export and check: what a service has kept can be looked after."""

from __future__ import annotations

import csv
import json
import sqlite3
import threading
import zipfile
from contextlib import closing
from dataclasses import fields, replace
from pathlib import Path

import pytest
import service_fakes as fakes
from gear_signals import meshing_window
from segments import in_folder, keep

from service.access.keys import FILE
from service.cli import run
from service.errors import InputError, StoreError
from service.results.alarm_store import AlarmStore
from service.results.archive import backup, restore
from service.results.baseline_store import BaselineStore
from service.results.data_folder import BASELINES, DATABASE, SEGMENTS, only_service_of
from service.results.jobs import Jobs
from service.results.names import Names
from service.results.segment_file import read_segment
from service.results.sql_store import SqlStore
from service.results.window_jobs import WindowJobs
from service.stream.samples import Span

ROOT = Path(__file__).parents[2]


def fill(data, where):
    """Something of everything."""
    with SqlStore(where) as store:
        fakes.fill(store, data)
        keep(in_folder(store, data / SEGMENTS), "unsw", 1, meshing_window())


def answers(data, where):
    """All that is answered of a data directory."""
    found = {}
    with SqlStore(where) as store:
        life = WindowJobs(store.database, data / SEGMENTS)
        for asset in store.assets():
            stored = store.asset(asset)
            found[asset] = [getattr(stored, part.name) for part in fields(stored)]
            found[asset, "windows"] = store.windows(asset)
            found[asset, "events"] = store.events(asset, 0, 10_000)
            found[asset, "rest"] = [
                Jobs(store.database).of(asset, kind) for kind in ("decision", "inspection", "retired")
            ]
            found[asset, "waiting"] = [read_segment(life.path_of(w)).start_ns for w in life.waiting(asset)]
            found[asset, "signals"] = in_folder(store, data / SEGMENTS).kept(asset)
            own = BaselineStore(store.database, data / BASELINES).path(asset)
            found[asset, "baseline"] = own and own.read_bytes()
        found["alarms"] = AlarmStore(store.database).due(2)
        found["routes"] = Names(store.database).routes()
    return found


@pytest.fixture
def data(tmp_path):
    (tmp_path / "data").mkdir()
    return tmp_path / "data"


def place(kind, data, request):
    return data / DATABASE if kind == "sqlite" else request.getfixturevalue("postgresql")


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "to"), [("sqlite", "sqlite"), ("sqlite", "postgresql"), ("postgresql", "sqlite")])
def test_backup_brings_everything_back_also_into_the_other_kind_of_database(kind, to, data, tmp_path, request):
    where = place(kind, data, request)
    fill(data, where)
    expected = answers(data, where)
    made = backup(data, where, tmp_path / "b.zip", signals=True)
    assert (made.assets, made.windows) == (2, 17)
    new = tmp_path / "new"
    target = place(to, new, request)
    assert restore(tmp_path / "b.zip", new, target) == made
    assert answers(new, target) == expected
    assert [window.number for window in expected["unsw", "signals"]] == [1]
    assert not [p for p in (*data.iterdir(), *new.iterdir()) if p.name.startswith(".")]
    with SqlStore(target) as store:  # no number is given twice
        last = max(e.id for e in store.events("unsw", 0, 10_000))
        store.note("unsw", [("status", {})])
        assert store.last_event_id("unsw") > last
        assert fakes.decide(store, "unsw", "x", "pin") > fakes.decisions(store, "unsw")[0].id


@pytest.mark.slow
def test_backup_of_a_service_at_work_is_of_one_moment(data, tmp_path):
    where = data / DATABASE
    fill(data, where)
    stop = threading.Event()

    def work():
        with SqlStore(where) as store:
            life = WindowJobs(store.database, data / SEGMENTS)
            index = 14
            while not stop.is_set():
                life.add_waiting("unsw", life.write(replace(fakes.SEGMENT, span=Span(index, index + 1))))
                (entry,) = life.waiting("unsw")
                with life.transaction():
                    fakes.take(store, None, "unsw", index, 100.0 * index)
                    life.drop_waiting(entry)
                life.path_of(entry).unlink()
                index += 1

    worker = threading.Thread(target=work)
    worker.start()
    try:
        for number in range(8):
            backup(data, where, tmp_path / f"{number}.zip")
    finally:
        stop.set()
        worker.join()
    for number in range(8):
        new = tmp_path / f"new-{number}"
        restore(tmp_path / f"{number}.zip", new, new / DATABASE)
        with SqlStore(new / DATABASE) as store:
            life = WindowJobs(store.database, new / SEGMENTS)
            indices = [w.record["index"] for w in store.windows("unsw")]
            assert indices == list(range(len(indices))) and store.asset("unsw").windows == len(indices)
            told = [e.data["index"] for e in store.events("unsw", 0, 10_000) if e.kind == "window"]
            assert told == indices
            assert [read_segment(life.path_of(w)).start_ns for w in life.waiting("unsw")] in ([], [len(indices)])


def test_a_backup_without_the_raw_signals_names_none_and_leaves_those_that_are_there(data, tmp_path):
    fill(data, data / DATABASE)
    expected = answers(data, data / DATABASE)
    made, new = backup(data, data / DATABASE, tmp_path / "b.zip"), tmp_path / "new"
    restore(tmp_path / "b.zip", new, new / DATABASE)
    assert len(list((new / SEGMENTS).iterdir())) == 1 and made.files == 2  # of the window that waits
    assert answers(new, new / DATABASE) == {**expected, ("unsw", "signals"): ()}
    assert answers(data, data / DATABASE) == expected


def test_a_backup_does_without_raw_signals_that_somebody_has_deleted(data, tmp_path):
    fill(data, data / DATABASE)
    with SqlStore(data / DATABASE) as store:
        (kept,) = (file for _, file in in_folder(store, data / SEGMENTS)._named("unsw"))
    (data / SEGMENTS / kept).unlink()
    backup(data, data / DATABASE, tmp_path / "b.zip", signals=True)


def test_backup_is_restored_into_nothing_but_an_empty_place(data, tmp_path, postgresql):
    fill(data, data / DATABASE)
    backup(data, data / DATABASE, tmp_path / "b.zip")
    before = (data / DATABASE).read_bytes()
    with pytest.raises(InputError, match=r"gear-twin.sqlite is there already"):
        restore(tmp_path / "b.zip", data, data / DATABASE)
    assert (data / DATABASE).read_bytes() == before
    with SqlStore(postgresql) as store:
        store.keep("unsw", rig={})
    with pytest.raises(InputError, match="has rows in assets"):
        restore(tmp_path / "b.zip", tmp_path / "new", postgresql)
    with pytest.raises(InputError, match="exists already"):
        backup(data, data / DATABASE, tmp_path / "b.zip")


@pytest.mark.parametrize("harm", ["flip", "cut", "member", "other"])
def test_damaged_archive_is_refused_before_anything_is_changed(data, tmp_path, harm):
    fill(data, data / DATABASE)
    archive, new = tmp_path / "b.zip", tmp_path / "new"
    backup(data, data / DATABASE, archive)
    content = bytearray(archive.read_bytes())
    if harm == "flip":
        content[len(content) // 2] ^= 1
    elif harm == "cut":
        del content[-2000:]
    elif harm == "other":
        content = b"no archive"
    archive.write_bytes(content)
    if harm == "member":
        with zipfile.ZipFile(archive) as packed:
            members = {name: packed.read(name) for name in packed.namelist()}
        manifest = json.loads(members["manifest.json"])
        manifest["files"]["../escaped"] = manifest["files"].pop("database.sqlite")
        with zipfile.ZipFile(archive, "w") as packed:
            packed.writestr("manifest.json", json.dumps(manifest))
            packed.writestr("../escaped", members["database.sqlite"])
    with pytest.raises(InputError, match=r"b\.zip"):
        restore(archive, new, new / DATABASE)
    assert not new.exists() or not list(new.iterdir())
    assert not (tmp_path / "escaped").exists()


def test_backup_of_a_damaged_database_is_refused(data, tmp_path):
    fill(data, data / DATABASE)
    with closing(sqlite3.connect(data / DATABASE)) as db:
        db.execute("PRAGMA journal_mode = DELETE")
    content = bytearray((data / DATABASE).read_bytes())
    content[4096:8192] = bytes(4096)
    (data / DATABASE).write_bytes(content)
    with pytest.raises(StoreError, match="damaged"):
        backup(data, data / DATABASE, tmp_path / "b.zip")
    assert [p.name for p in tmp_path.iterdir()] == ["data"]


# -- the commands ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_commands_back_up_and_restore_while_a_service_has_the_directory(data, tmp_path, capsys):
    fill(data, data / DATABASE)
    with only_service_of(data):
        assert run(["db", "backup", str(tmp_path / "b.zip"), "--data", str(data)]) == 0
        assert "2 assets, 17 windows" in capsys.readouterr().err
        assert run(["db", "restore", str(tmp_path / "b.zip"), "--data", str(data)]) == 2
        assert "another service has this data directory" in capsys.readouterr().err
    assert run(["db", "restore", str(tmp_path / "b.zip"), "--data", str(tmp_path / "new"), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["windows"] == 17
    assert run(["db", "check", "--data", str(tmp_path / "new")]) == 0
    assert run(["db", "restore", str(tmp_path / "none.zip"), "--data", str(tmp_path / "other")]) == 2


def test_an_archive_holds_no_credentials(data, tmp_path):
    fill(data, data / DATABASE)
    (data / FILE).write_text("[]")
    backup(data, data / DATABASE, tmp_path / "b.zip", signals=True)
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        assert archive.namelist() and not [name for name in archive.namelist() if FILE in name]


def test_check_says_what_is_wrong_and_what_to_do(data, capsys):
    fill(data, data / DATABASE)
    with closing(sqlite3.connect(data / DATABASE)) as db:
        db.execute("UPDATE windows SET record = x'00' WHERE asset = 'unsw' AND number = 3")
        db.execute("UPDATE assets SET windows = windows + 1 WHERE asset = 'other'")
        db.execute("UPDATE alarm_memory SET asset = 'nobody'")
        db.commit()
    for path in (data / SEGMENTS).glob("*.mcap"):  # of a window that waits, and of one whose signals are kept
        path.unlink()
    next((data / BASELINES).iterdir()).unlink()
    assert run(["db", "check", "--data", str(data)]) == 2
    said = capsys.readouterr()
    assert "gear-twin: 6 things are wrong" in said.err and "Traceback" not in said.err
    for part in (
        "record of windows unsw, ",
        "numbers of assets other",
        "alarm_memory belongs to no",
        "not there",
        "baseline",
        "the raw signals ",
    ):
        assert part in said.out
    assert said.out.count("gear-twin db restore") >= 4


def test_check_knows_no_trouble_with_either_kind(where, data, capsys, monkeypatch):
    fill(data, where)
    monkeypatch.setenv("GEAR_TWIN_DATABASE", where if isinstance(where, str) else f"sqlite:///{where}")
    assert run(["db", "check", "--data", str(data)]) == 0
    assert "nothing is wrong" in capsys.readouterr().err


@pytest.mark.slow
def test_results_are_exported_by_asset_and_time(data, tmp_path, capsys):
    fill(data, data / DATABASE)
    out = tmp_path / "out.csv"
    given = ["--data", str(data), "--asset", "unsw", "--from", "2023-11-14T22:23:20Z", "--to", "2023-11-14T23:03:20Z"]
    assert run(["db", "export", str(out), *given]) == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert [row["index"] for row in rows] == ["1", "2", "3", "4"] and {row["asset"] for row in rows} == {"unsw"}
    with SqlStore(data / DATABASE) as store:
        expected = store.windows("unsw")[2]
    assert float(rows[1]["depth_um_combined_p95"]) == expected.figures["depth_um"]["combined"]["p95"]
    assert float(rows[1]["rms_measured"]) == expected.record["rms_measured"]
    assert run(["db", "export", str(tmp_path / "e.jsonl"), "--what", "events", "--data", str(data)]) == 0
    events = [json.loads(line) for line in (tmp_path / "e.jsonl").read_text().splitlines()]
    assert {e["asset"] for e in events} == {"unsw", "spindle"} and "window" in {e["kind"] for e in events}
    assert run(["db", "export", str(tmp_path / "w.parquet"), "--data", str(data)]) == 0
    import pyarrow.parquet

    assert pyarrow.parquet.read_table(tmp_path / "w.parquet").num_rows == 17
    for wrong in (["x.xlsx"], ["x.csv", "--asset", "nobody"], ["x.csv", "--from", "yesterday"]):
        assert run(["db", "export", str(tmp_path / wrong[0]), *wrong[1:], "--data", str(data)]) == 2
    assert not (tmp_path / "x.csv").exists()
