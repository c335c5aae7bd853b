"""Names and questions of assets: what is whose stays so, whatever is renamed, answered or fails meanwhile."""

from __future__ import annotations

from dataclasses import replace

import fake_twin
import pytest
import service_fakes as fakes
from memory_transport import MemoryNetwork
from service_streams import RIG, SqliteFile, wait_until, write_recording
from test_asset_life import (
    FIRST,
    LATER,
    UNSW,
    WINDOWS,
    _rig_text,
    asked,
    change,
    revolutions,
    send,
    waiting,
)
from test_other_parts import serving

from service.errors import InputError, StorageUnavailable
from service.results.jobs import Jobs
from service.results.names import Names
from service.results.sql_store import SqlStore
from service.stream.sources.mcap import Recording

DEPTH = {"revolutions": 1200.0, "max_depth_um": 30.0, "flank": "combined", "std_um": 1.0}


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("first") / "first.mcap", WINDOWS)


@pytest.fixture(scope="module")
def second(tmp_path_factory):
    """Another machine under the same name, a day later."""
    return write_recording(tmp_path_factory.mktemp("second") / "second.mcap", WINDOWS, later=LATER, seed=8)


@pytest.fixture(scope="module")
def foreign(tmp_path_factory):
    """Another machine under the same name, recorded at the same time."""
    recording = write_recording(tmp_path_factory.mktemp("foreign") / "foreign.mcap", WINDOWS, seed=8)
    with Recording(recording) as source:
        return list(source.messages())


@pytest.fixture
def network():
    return MemoryNetwork()


@pytest.fixture
def running(tmp_path, network):
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        yield running


def listed(running):
    return [(a["asset"], a["windows"], a["retired"]) for a in running.get("/v1/assets")]


def asked_about_repeats(running, network, foreign):
    """Frames of passed times are sent until the question about them is open, and none is on its way any more."""

    def is_open():
        for frame in foreign[:64]:
            network.publish(frame)
        question = (running.get(UNSW) or {}).get("question")
        return question is not None and question["kind"] == "frames_repeat"

    wait_until(is_open)
    assert network.ask("unsw", 30.0)  # answered once all frames before it are taken


class Fails:
    """Fails once, when it is armed, as a database that is away for a moment."""

    def __init__(self):
        self.armed = self.failed = False

    def __call__(self):
        if self.armed:
            self.armed, self.failed = False, True
            raise StorageUnavailable("the database cannot be used now (away)", reason="away")


@pytest.fixture
def after_the_commit(monkeypatch):
    """The first reading outside a transaction, after a change has been carried out, fails."""
    fails, done, read = Fails(), Jobs.end, Names.routes

    def end(jobs, *given):
        fails.armed = not fails.failed
        return done(jobs, *given)

    def routes(names):
        if names.database._present.db is None:
            fails()
        return read(names)

    monkeypatch.setattr(Jobs, "end", end)
    monkeypatch.setattr(Names, "routes", routes)
    return fails


# -- another machine -------------------------------------------------------------------------------------


def test_the_stream_of_another_machine_stays_its_own_when_the_first_one_is_renamed(tmp_path):
    """The next frames of the second machine went to the first one again."""
    with SqlStore(tmp_path / "x.sqlite") as store:
        names = Names(store.database)
        fakes.take(store, None, "unsw", 0, 100.0)
        names.give_streams("unsw", "bench-2")
        names.rename("unsw", "unsw-old")
        assert names.routes() == {"unsw": "bench-2", "unsw-old": "unsw"}
        names.rename("bench-2", "bench-3")
        assert names.routes() == {"unsw": "bench-2", "unsw-old": "unsw", "bench-3": "bench-2"}
        assert names.labels() == {"unsw": "unsw-old", "bench-2": "bench-3"}
        assert [names.labelled(n) for n in ("unsw", "unsw-old", "bench-2", "bench-3")] == ["unsw"] * 2 + ["bench-2"] * 2


def test_a_name_is_given_once_but_an_asset_may_have_one_of_its_own_again(each_store):
    names = Names(each_store.database)
    for asset in ("unsw", "mill"):
        each_store.note(asset, [])
    names.rename("unsw", "press-7")
    names.rename("unsw", "unsw")  # a mistake is taken back
    assert names.label("unsw") == "unsw" and names.asset_of("press-7") == "unsw"
    for name in ("unsw", "press-7"):
        with pytest.raises(InputError, match=f"there is an asset '{name}' already, or one that was called so"):
            names.rename("mill", name)
    assert names.labels() == {"unsw": "unsw", "mill": "mill"} and not names.is_free("press-7") and names.is_free("saw")


def test_what_is_kept_and_shown_of_an_asset_is_untouched_by_its_names(each_store):
    fakes.campaign(each_store, None)
    before = each_store.asset("unsw"), each_store.windows("unsw"), each_store.events("unsw", 0, 10_000)
    Names(each_store.database).rename("unsw", "press-7")
    assert each_store.assets() == ("unsw",)
    after = each_store.asset("unsw"), each_store.windows("unsw"), each_store.events("unsw", 0, 10_000)
    assert after == (replace(before[0], label="press-7"), *before[1:])
    board = fakes.WrittenTable(each_store)
    assert board.get("unsw") is board.find("press-7") and board.find("unsw") is None and board.names() == ("press-7",)
    assert board.get("unsw").whole["asset"] == board.get("unsw").summary()["asset"] == "press-7"
    assert board.update("unsw", label="mill") is board.find("mill") and board.find("press-7") is None


@pytest.mark.slow
def test_windows_that_wait_for_the_twin_stay_where_frames_of_passed_times_are_another_machines(
    running, network, first, foreign, monkeypatch
):
    """They were taken for those of the question, and given to the other machine."""
    monkeypatch.setattr(fake_twin, "SLOW", 1.0)
    send(network, first)
    asked_about_repeats(running, network, foreign)
    assert change(running, "other_machine", name="bench-2")[0] == 201
    monkeypatch.setattr(fake_twin, "SLOW", 0.0)
    assert revolutions(running.wait_for_windows(WINDOWS)) == FIRST
    assert running.get(UNSW)["question"] is None


@pytest.mark.slow
def test_a_window_in_progress_is_closed_where_frames_of_passed_times_are_another_machines(
    running, network, first, foreign
):
    """Nobody closed it any more, and its publisher was told that it was stored."""
    with Recording(first) as source:
        frames = list(source.messages())
        network.offer_rig("unsw", source.rig_text)
    network.declare(())
    for frame in frames[:-8]:
        network.publish(frame)
    asked_about_repeats(running, network, foreign)  # its frames keep the window open
    assert change(running, "other_machine", name="bench-2")[0] == 201
    assert len(running.wait_for_windows(WINDOWS)) == WINDOWS


@pytest.mark.slow
def test_frames_under_a_name_that_was_given_a_moment_ago_are_of_its_asset(running, network, first, tmp_path):
    """Whoever received them began an asset of that name, which the database refused, and that ended the service."""
    send(network, first)
    running.wait_for_windows(WINDOWS)
    with running.store() as store:
        Names(store.database).rename("unsw", "press-7")  # committed by another process, and not followed yet
    send(network, write_recording(tmp_path / "longer.mcap", WINDOWS + 2, asset="press-7"))
    assert revolutions(running.wait_for_windows(WINDOWS + 2, "press-7")) == [*FIRST, 2410, 3010]
    assert len(running.get("/v1/assets")) == 1


@pytest.mark.slow
def test_a_question_that_ends_by_itself_lets_the_windows_go_on_that_waited(tmp_path, network, first):
    """They waited for good, and later windows went before them."""
    rig = tmp_path / "wider.toml"
    rig.write_text(RIG.read_text().replace("face_width = 0.020", "face_width = 0.025"))
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        send(network, first)
        running.wait_for_windows(WINDOWS)
    with serving(tmp_path, network, SqliteFile(tmp_path), rig=rig) as running:
        wait_until(lambda: waiting(running) == 0)
        send(network, write_recording(tmp_path / "longer.mcap", WINDOWS + 2))
        wait_until(lambda: waiting(running) == 2)
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:  # with the earlier rig file again
        assert revolutions(running.wait_for_windows(WINDOWS + 2)) == [*FIRST, 2410, 3010]
        assert running.get(UNSW)["question"] is None
        send(network, write_recording(tmp_path / "longest.mcap", WINDOWS + 3))
        assert revolutions(running.wait_for_windows(WINDOWS + 3)) == [*FIRST, 2410, 3010, 3610]


# -- changes that meet -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_changes_that_wait_behind_a_new_name_are_of_the_renamed_asset(tmp_path, network, first):
    """They made an asset of the earlier name, without windows, and were lost to the renamed one."""
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        send(network, first)
        running.wait_for_windows(WINDOWS)
    with running.store() as store:
        life = Jobs(store.database)
        life.add("unsw", "renamed", {"name": "press-7"})
        numbers = [life.add("unsw", kind, {"by": "me"}) for kind in ("retired", "oil_changed")]
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        wait_until(lambda: listed(running) == [("press-7", WINDOWS, True)])
        wait_until(lambda: [c["done"] for c in running.get("/v1/assets/press-7/changes")] == [True] * 3)
        assert running.get(UNSW) is None
    with running.store() as store:
        life = Jobs(store.database)
        assert [life.job(n).asset for n in numbers] == ["unsw"] * 2 and store.assets() == ("unsw",)


# -- a storage that fails in the midst of a change -------------------------------------------------------


@pytest.mark.slow
def test_a_storage_that_fails_after_a_machine_was_told_apart_leaves_nothing_half_done(
    running, network, first, second, after_the_commit
):
    """The second attempt found the question closed: the windows waited until the next start."""
    asked(running, network, first, second)
    assert change(running, "other_machine", name="bench-2")[0] == 201
    assert revolutions(running.wait_for_windows(WINDOWS, "bench-2")) == FIRST and after_the_commit.failed
    assert revolutions(running.windows()) == FIRST
    wait_until(lambda: running.get(UNSW)["question"] is None)
    wait_until(lambda: listed(running) == [("bench-2", WINDOWS, False), ("unsw", WINDOWS, False)])


@pytest.mark.slow
def test_a_storage_that_fails_after_gears_were_replaced_does_not_keep_the_earlier_gears(
    tmp_path, network, first, after_the_commit, monkeypatch
):
    """The windows that had waited, and all later ones, were evaluated with the gears that had been taken out."""
    used = []

    def noting(rig, *given):
        used.append(rig.get("gears.face_width"))
        return fake_twin.step(rig, *given)

    monkeypatch.setattr(fake_twin, "TWIN", replace(fake_twin.TWIN, step=noting))
    changed = (b"face_width = 0.020", b"face_width = 0.025")
    wider = write_recording(tmp_path / "wider.mcap", WINDOWS, later=LATER, changed=changed)
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        send(network, first)
        running.wait_for_windows(WINDOWS)
        network.on_rig("unsw", b"".join(_rig_text(wider)))
        wait_until(lambda: waiting(running) == 0)
        send(network, wider)
        wait_until(lambda: waiting(running) == WINDOWS)
        assert change(running, "gears_replaced")[0] == 201
        wait_until(lambda: running.get(UNSW)["epoch"] == 1 and running.get(UNSW)["windows_total"] == WINDOWS)
        wait_until(lambda: running.get(UNSW)["question"] is None)
    assert used == [0.020] * WINDOWS + [0.025] * WINDOWS
