"""A healthy baseline of one asset: learned from its own windows, given as a file, renewed, removed, and used."""

from __future__ import annotations

import urllib.error
import urllib.request
from dataclasses import replace
from functools import lru_cache

import fake_twin
import pytest
from memory_transport import MemoryNetwork
from segments import in_folder, keep
from service_streams import Service, SqliteFile
from sqlalchemy import update
from test_baselines import recording
from test_decisions import post
from test_other_parts import serving

from service.cli import run
from service.errors import InputError
from service.files.baseline import learned, read_baseline, save
from service.results import baseline_learning
from service.results.baseline_learning import learn_from_windows
from service.results.baseline_store import BaselineStore
from service.results.data_folder import BASELINES, SEGMENTS
from service.results.jobs import Jobs
from service.results.schema import ASSETS
from service.runtime.asset_twins import AssetTwins
from service.runtime.twin_port import gear_twin
from service.stream.assembly import Assembler
from tests.claims.test_baseline import SPEED, TEETH, machine
from twin.baseline.validity import identity_of
from twin.machine_change import MachineChange
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.step import change, step

LOADS = (0.1, 0.3, 0.5, 0.7, 0.9)
SOUND = ("good",) * len(LOADS)
BENCH = "/v1/assets/bench"
RIG = {
    "gears": {"pinion": {"teeth": TEETH[0]}, "gear": {"teeth": TEETH[1]}},
    "operating": {"pinion_speed_hz": SPEED},
}
START_NS, HOUR_NS = 1_700_000_000 * 10**9, 3_600 * 10**9


@lru_cache
def bench(load, seed):
    return machine(load, seed)


def with_windows(folder, grades=SOUND):
    """A data directory with sound windows of a healthy machine whose signals are kept."""
    folder.mkdir(exist_ok=True)
    kept = Service(folder)
    with kept.store() as store:
        signals = in_folder(store, kept.folder / SEGMENTS)
        store.keep_rig("bench", RIG)
        for i, (load, grade) in enumerate(zip(LOADS, grades, strict=True)):
            window = replace(bench(load, i), start_time_ns=START_NS + i * HOUR_NS)
            store.commit(
                "bench", window.start_time_ns, record={"index": i, "quality": grade, "start_time": ""}, state={},
                report=None, received_ns=1,
            )  # fmt: skip
            keep(signals, "bench", i, window)
        with store.database.transaction() as db:
            db.execute(update(ASSETS).values(state=None, assembly=None))  # no twin has a state of these windows
    return folder


@pytest.fixture
def running(tmp_path):
    data = with_windows(tmp_path / "data", ("good", "good", "repaired", "good", "degraded"))
    with serving(data, MemoryNetwork(), SqliteFile(data)) as running:
        yield running


def request(running, method, path, data=None):
    asked = urllib.request.Request(f"http://{running.http}{path}", data, method=method)
    try:
        with urllib.request.urlopen(asked, timeout=60) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


@pytest.mark.slow
def test_a_baseline_is_learned_from_windows_renewed_and_removed(running):
    assert running.get(f"{BENCH}/baseline") == {"own": False}
    status, answer = post(running, f"{BENCH}/baseline/learn", {"windows": [0, 1, 2], "by": "me", "note": "new gears"})
    assert (status, answer["own"], answer["by"], answer["windows"]) == (201, True, "me", [0, 1, 2])
    assert sorted(answer["baseline"]["recordings"]) == ["bench#0", "bench#1", "bench#2"]
    assert answer["baseline"]["sufficiency"]["recordings"] == 3
    status, answer = post(running, f"{BENCH}/baseline/learn", {"windows": [3], "add": True})
    assert status == 201 and len(answer["baseline"]["recordings"]) == 4 and answer["added"] is True
    assert [c["kind"] for c in running.get(f"{BENCH}/changes")] == ["baseline_given", "baseline_given"]
    assert request(running, "DELETE", f"{BENCH}/baseline")[0] == 200
    assert running.get(f"{BENCH}/baseline") == {"own": False}


@pytest.mark.slow
def test_a_baseline_that_was_learned_while_gears_were_replaced_is_not_used(tmp_path, monkeypatch):
    """The wear of the new gears was compared with the old ones as the healthy state."""
    data = with_windows(tmp_path / "data")
    with Service(data).store() as store:
        store.keep("bench", state=fake_twin.FakeState().to_dict(), assembly=Assembler().to_dict())
    with serving(data, MemoryNetwork(), SqliteFile(data)) as running:
        written = baseline_learning.written

        def meanwhile(baseline, path):
            monkeypatch.undo()
            assert post(running, f"{BENCH}/changes", {"kind": "gears_replaced"})[0] == 201
            return written(baseline, path)

        monkeypatch.setattr(baseline_learning, "written", meanwhile)
        status, answer = post(running, f"{BENCH}/baseline/learn", {"windows": [0, 1, 2]})
        assert status == 409 and "window 0 was measured before the change 'gears_replaced'" in answer["detail"]
        assert running.get(f"{BENCH}/baseline") == {"own": False}


@pytest.mark.parametrize(
    ("windows", "text"),
    [
        ([0, 4], "window 4 is degraded: a baseline is learned from sound windows"),
        ([0, 17], "window 17 is none of the present gears of bench"),
        ([0], "at least two recordings"),
    ],
)
def test_windows_that_cannot_be_learned_from_are_named(running, windows, text):
    status, answer = post(running, f"{BENCH}/baseline/learn", {"windows": windows})
    assert status == 409 and text in answer["detail"]


def test_windows_from_before_a_change_are_of_another_machine(tmp_path):
    data = with_windows(tmp_path / "data")
    with Service(data).store() as store:
        signals, jobs = in_folder(store, Service(data).folder / SEGMENTS), Jobs(store.database)
        made = jobs.add("bench", "sensor_moved", {"sensor": "a"})
        jobs.end(jobs.job(made), {"from_window": 2})
        with pytest.raises(InputError, match=r"window 1 was measured before the change 'sensor_moved'.*from 2 on"):
            learn_from_windows("bench", [1, 2, 3], store, signals, jobs)
        assert len(learn_from_windows("bench", [2, 3, 4], store, signals, jobs).readings) == 3


@pytest.mark.slow
def test_nothing_is_added_to_a_baseline_that_a_change_has_ended(tmp_path):
    data = with_windows(tmp_path / "data")
    file = tmp_path / "first.baseline"
    with Service(data).store() as store:
        signals, jobs = in_folder(store, Service(data).folder / SEGMENTS), Jobs(store.database)
        first = learn_from_windows("bench", [0, 1, 2], store, signals, jobs)
        save(first, file)
        again = learn_from_windows("bench", [2, 3], store, signals, jobs, file)
        assert sorted(r.name for r in again.readings) == [f"bench#{i}" for i in range(4)]  # window 2 counts once
        store.keep("bench", state={"outdated": {"a": identity_of(first)}})
        with pytest.raises(InputError, match="learned before the machine was changed"):
            learn_from_windows("bench", [3], store, signals, jobs, file)


def test_a_baseline_that_waits_to_be_used_outlives_a_restart(tmp_path, each_store):
    store = each_store
    baselines = BaselineStore(store.database, tmp_path / "baselines")
    waits, unused = baselines.new_path(), baselines.new_path()
    for path in (waits, unused):
        path.write_bytes(b"learned")
    Jobs(store.database).add("bench", "baseline_given", {"file": waits.name})
    BaselineStore(store.database, tmp_path / "baselines")
    assert waits.exists() and not unused.exists()


@pytest.mark.slow
def test_a_baseline_of_other_gears_is_refused_and_one_of_these_is_taken(running, tmp_path):
    own = [recording(tmp_path, f"h{i}", load=load, seed=i) for i, load in enumerate((0.1, 0.3, 0.5))]
    other = Rig.from_mapping({**RIG, "gears": {"pinion": {"teeth": 21}, "gear": {"teeth": 30}}})
    save(replace(learned(own), rig=other), tmp_path / "other.baseline")
    status, text = request(running, "PUT", f"{BENCH}/baseline", (tmp_path / "other.baseline").read_bytes())
    assert status == 409 and f"bench has {TEETH[0]} and {TEETH[1]}" in text
    status, text = request(running, "PUT", f"{BENCH}/baseline", b"no baseline")
    assert status == 409 and "not a baseline" in text and "/" not in text.split("detail")[1].split("instance")[0]
    assert (
        run(
            [
                "remote",
                "assets",
                "baseline",
                "bench",
                *map(str, own),
                "--by",
                "me",
                "--service",
                f"http://{running.http}",
            ]
        )
        == 0
    )
    assert running.get(f"{BENCH}/baseline")["by"] == "me"
    assert len(list((running.folder / BASELINES).iterdir())) == 1  # what was refused is gone


@pytest.mark.slow
def test_the_command_learns_from_windows_and_says_what_it_suffices_for(running, capsys):
    url = ["--service", f"http://{running.http}"]
    assert run(["remote", "assets", "baseline", "bench", "--windows", "0-2,3", *url]) == 0
    assert "4" in capsys.readouterr().out
    assert run(["remote", "assets", "baseline", "bench", "--remove", *url]) == 0
    assert capsys.readouterr().out == "bench has no baseline of its own\n"
    assert run(["remote", "assets", "baseline", "bench", "--windows", "x", *url]) == 2
    assert "no window number or range" in capsys.readouterr().err


@pytest.mark.slow
def test_a_baseline_outlives_a_restart_and_a_new_name(tmp_path):
    data = with_windows(tmp_path / "data")
    with serving(data, MemoryNetwork(), SqliteFile(data)) as running:
        assert post(running, f"{BENCH}/baseline/learn", {"windows": [0, 1, 2]})[0] == 201
        assert post(running, f"{BENCH}/changes", {"kind": "renamed", "name": "press"})[0] == 201
    with serving(data, MemoryNetwork(), SqliteFile(data)) as running:
        assert running.get("/v1/assets/press/baseline")["own"]


# -- in the twin -----------------------------------------------------------------------------------------


@pytest.fixture
def baselines(tmp_path, each_store):
    return BaselineStore(each_store.database, tmp_path / "baselines")


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("healthy")
    files = [recording(folder, f"h{i}", load=load, seed=i) for i, load in enumerate(LOADS)]
    save(learned(files), folder / "healthy.baseline")
    return folder / "healthy.baseline"


@pytest.mark.slow
def test_the_baseline_of_the_settings_holds_where_the_teeth_fit_alone(baselines, healthy):
    """A box with 23 and 57 teeth was asked which teeth were right: its own, or those of another machine's baseline."""
    shared = read_baseline(healthy)
    twins = AssetTwins(gear_twin(Options(baseline=shared)), baselines)
    assert twins.of("bench", Rig.from_mapping(RIG)).options.baseline is shared
    other = {"gears": {"pinion": {"teeth": 23}, "gear": {"teeth": 57}}}
    assert twins.of("box", Rig.from_mapping(other)).options.baseline is None
    assert twins.of("unknown", Rig.from_mapping({})).options.baseline is shared


def test_an_asset_s_own_baseline_goes_before_that_of_the_settings(baselines, healthy):
    shared = read_baseline(healthy)
    path = baselines.new_path()
    path.write_bytes(healthy.read_bytes())
    baselines.use("bench", path.name, {"by": "me"})
    twins = AssetTwins(gear_twin(Options(baseline=shared)), baselines)
    own = twins.of("bench", Rig.from_mapping(RIG)).options.baseline
    assert own is not shared and len(own.readings) == len(LOADS)


MADE = [("gears_replaced", {}), ("reassembled", {}), ("sensor_moved", {"sensor": "a"})]


@pytest.mark.parametrize(("kind", "given"), MADE)
def test_a_baseline_of_before_a_change_is_not_compared_with(healthy, kind, given):
    rig, options = Rig.from_mapping(RIG), Options(baseline=read_baseline(healthy), trace=False)
    fault = machine(0.42, 99, pulse=2.0)
    _, before = step(rig, State(), fault, options)
    assert "tooth_crack" in [e.name for e in before.effects]
    state, _ = change(rig, State(), MachineChange(kind=kind, **given), options)
    _, answer = step(rig, state, fault, options)
    if kind == "sensor_moved":
        assert "a" not in answer.baseline.channels  # the other accelerometer is compared as before
        return
    assert "tooth_crack" not in [e.name for e in answer.effects]
    assert answer.unexplained.verdict == "insufficient_data" and "learn it again" in answer.unexplained.reason


def test_numbers_of_windows_are_read_from_a_list():
    from service.cli.assets import numbers_of

    assert numbers_of("0-3, 7") == [0, 1, 2, 3, 7]
    with pytest.raises(InputError, match="no window number"):
        numbers_of("3;4")
