"""Searches for effects elsewhere: nobody waits for one but its own asset, and what is made of it is the same."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import pytest
import worker_twins
from fleets import taken
from segments import segment_of
from service_streams import ROOT, wait_until
from test_workers import window

from service.files.recorded_rig import rig_of
from service.fleet import kept_curves
from service.fleet.kept_curves import CurveWriter, StoredCurves
from service.fleet.searches import Search, Searches
from service.json_text import plain
from service.runtime.assess import assess
from service.runtime.computing import Ask, Call, WindowToUse
from service.runtime.curves import Curves
from service.runtime.packed_state import NEW
from service.runtime.reception import Reception
from service.runtime.twin_port import gear_twin
from service.runtime.worker_processes import Processes
from service.runtime.worker_task import Tasks, perform
from service.stream.edge_counts import EncoderCounts
from service.stream.sources.mcap import Recording
from twin.rig import Rig
from twin.updating.model_cache import PATHS

CAMPAIGN = ROOT / "recordings" / "short-campaign.mcap"
LIMIT = 60.0  # of a search [s]


@pytest.fixture(autouse=True)
def readers():
    """Connections for reading are a process's, and last as long as that; here each ends with its test."""
    opened, engine_of = [], kept_curves.engine_of
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            kept_curves, "engine_of", lambda *given, **more: opened.append(engine_of(*given, **more)) or opened[-1]
        )
        patch.setattr(kept_curves, "_silent_until", 0.0)
        kept_curves._reader.cache_clear()
        yield
        kept_curves._reader.cache_clear()
    for engine in opened:
        engine.dispose()


class Given:
    """Searches whose tasks are taken by the test, in place of the engine."""

    def __init__(self, submit=None, limit=LIMIT, tasks=None, keep=lambda asset, curves: None):
        self.made, self.tasks, self.cancelled = [], [], []
        self.inner = Processes(1, task_limit=60.0, cache_bytes=2**28, wake=lambda: None)
        tasks = tasks or Tasks()
        self.searches = Searches(
            self.inner, submit or self.submit, tasks=tasks, keep=keep, limit=limit, wake=lambda: None
        )

    def submit(self, task):
        reply = Future()
        self.tasks.append((task, reply))
        return Search(reply=reply, cancel=lambda: self.cancelled.append(task))

    def ask(self, asset, name, number=0, state=NEW, verb="window"):
        about = WindowToUse(start_ns=10**18 + number * 10**10, segment=segment_of(window(number)))
        rig = Rig.from_mapping({"name": name})
        call = Call(asset=asset, twin=worker_twins.make(None), rig=rig, state=state, ask=Ask(verb, about))
        self.searches.start(call, lambda made: self.made.append((asset, made)))

    def wait(self, what, seconds=30.0):
        def collected():
            self.searches.collect()
            return what()

        wait_until(collected, seconds)


@pytest.fixture
def given(request):
    made = Given(**getattr(request, "param", {}))
    yield made
    made.searches.close()


def searched(path):
    return path.read_text(encoding="utf-8").split() if path.exists() else []


@pytest.mark.slow
def test_other_assets_do_not_wait_for_a_search_and_its_own_asset_does(given, tmp_path):
    marks = tmp_path / "marks"
    given.ask("a", f"searches {marks}")
    given.wait(lambda: given.tasks)
    for number in range(3):
        given.ask("b", "plain", number)
    given.wait(lambda: len(given.made) == 3)
    assert [asset for asset, _ in given.made] == ["b"] * 3 and not searched(marks)
    assert given.searches.figures()["engine_searches"] == 1
    ((task, reply),) = given.tasks
    reply.set_result(perform(task))
    given.wait(lambda: len(given.made) == 4)
    asset, made = given.made[-1]
    assert asset == "a" and made.answer.record["index"] == 0 and not made.handed_back
    assert len(searched(marks)) == 1 and given.searches.figures()["engine_searches"] == 0


@pytest.mark.parametrize("how", ["raised", "cancelled", "not accepted", "late", "without the file"])
def test_a_search_that_the_engine_does_not_make_is_made_here(tmp_path, caplog, how):
    def refuse(task):
        raise ConnectionError("the engine is gone")

    given = Given(submit=refuse if how == "not accepted" else None, limit=0.5 if how == "late" else LIMIT)
    marks = tmp_path / "marks"
    try:
        given.ask("a", f"searches {marks}")
        if how != "not accepted":
            given.wait(lambda: given.tasks)
            ((task, reply),) = given.tasks
            if how == "raised":
                reply.set_exception(OSError("its node has ended"))
            elif how == "cancelled":
                reply.cancel()
            elif how == "without the file":
                gone = WindowToUse(start_ns=0, file=tmp_path / "of another machine.mcap")
                reply.set_result(perform(replace(task, ask=Ask("window", gone), hand_back=False)))
        given.wait(lambda: given.made)
        ((_, made),) = given.made
        assert made.answer.record["index"] == 0 and len(searched(marks)) == 1
        assert given.searches.figures()["engine_searches_failed"] == 1
        assert "a search for effects was not made by the engine, and is made here" in caplog.text
        if how == "late":
            assert given.cancelled == [task]
            reply.set_result(perform(task))  # after all
            given.searches.collect()
            assert len(given.made) == 1
    finally:
        given.searches.close()


def test_the_end_calls_searches_off(given, tmp_path):
    given.ask("a", f"searches {tmp_path / 'marks'}")
    given.wait(lambda: given.tasks)
    given.searches.close()
    assert given.cancelled == [given.tasks[0][0]]
    given.tasks[0][1].set_result(perform(given.tasks[0][0]))
    given.searches.collect()
    assert not given.made


# -- the twin itself ------------------------------------------------------------------------------------


class Recorder:
    """The windows of a campaign as a reception closes them, and what is made of them."""

    def __init__(self, recording):
        self.given, self.expected = [], assess(recording)
        with Recording(recording) as source:
            self.rig = rig_of(source, None)
            reception = Reception(lambda name: self.rig, lambda closed: self.given.append(closed.segment))
            for frame in source.frames(lambda channel, error: pytest.fail(str(error))):
                reception.feed(frame)
            reception.flush()

    def call(self, number, made):
        """What is asked of a window, after what was made of the one before; None before the first."""
        segment, before = self.given[number], EncoderCounts() if made is None else made.encoders
        about = WindowToUse(start_ns=segment.start_ns, segment=segment, before=before)
        state = NEW if made is None else made.state
        return Call(asset="unsw", twin=gear_twin(), rig=self.rig, state=state, ask=Ask("window", about))


def carried_through(recorder, given):
    """What the windows lead to, one after the other."""
    made, answers = None, []
    for number in range(len(recorder.given)):
        given.searches.start(recorder.call(number, made), given.made.append)
        given.wait(lambda: len(given.made) > len(answers), 120.0)
        made = given.made[-1]
        answers.append(made.answer)
    return made.state, answers


@pytest.mark.slow
def test_a_campaign_whose_searches_are_made_elsewhere_is_that_of_one_process_bit_for_bit(fleet):
    recorder = Recorder(CAMPAIGN)
    begin(fleet, "unsw")
    stored, writer = StoredCurves(fleet), CurveWriter(fleet)
    writer.start()
    elsewhere, made_there = ThreadPoolExecutor(1), []

    def submit(task):
        made_there.append(task)
        return Search(reply=elsewhere.submit(perform, task), cancel=lambda: None)

    given = Given(submit=submit, tasks=Tasks(stored), keep=writer.keep)
    try:
        _, answers = carried_through(recorder, given)
    finally:
        given.searches.close()
        elsewhere.shutdown()
        writer.end()
    assert 3 <= len(made_there) <= len(answers)  # not the first windows, which calibrate
    assert [plain(a.record) for a in answers] == [
        {k: v for k, v in w.items() if k in answers[0].record} for w in plain(recorder.expected["windows"])
    ]
    assert plain(answers[-1].report["rul"]) == plain(recorder.expected["rul"])


@pytest.mark.slow
def test_a_process_that_goes_on_with_an_asset_reads_its_curves_and_computes_none(fleet):
    recorder = Recorder(CAMPAIGN)
    begin(fleet, "unsw")
    stored, writer = StoredCurves(fleet), CurveWriter(fleet)
    writer.start()
    tasks, before, kept = Tasks(stored), None, []
    PATHS.clear()
    for number in range(5):
        reply = perform(tasks.of(recorder.call(number, before)))
        before = reply.made
        if reply.curves is not None:
            kept.append(reply.curves)
            writer.keep("unsw", reply.curves)
    wait_until(lambda: not writer._waiting)
    assert kept and all(stored.read("unsw", name) for name in kept[-1].names)
    call = recorder.call(5, before)
    expected = perform(tasks.of(call))
    PATHS.clear()
    made = perform(tasks.of(call))
    assert plain(made.made.answer.record) == plain(expected.made.answer.record)
    long = [path for path in PATHS._paths.values() if len(path.points[0]) > 8]
    assert long and all(path._last is None for path in long)  # no state to go on from: nothing was computed
    writer.end()


# -- where curves are kept ------------------------------------------------------------------------------


def begin(fleet, *assets):
    """Has assets in a fleet: the windows of a new one are kept before anything is computed of it."""
    with taken(fleet) as store:
        for asset in assets:
            store.note(asset, [])


def curves(*names, new=()):
    return Curves(names=frozenset(names), new=tuple((name, f"points of {name}".encode()) for name in new))


@pytest.mark.slow
def test_curves_that_are_no_longer_used_go_and_those_of_other_assets_stay(fleet):
    begin(fleet, "a", "b")
    stored, writer = StoredCurves(fleet), CurveWriter(fleet)
    writer.keep("a", curves("one", "two", new=("one", "two")))
    writer.keep("b", curves("one", new=("one",)))
    writer.start()
    wait_until(lambda: stored.read("b", "one"))
    writer.keep("a", curves("two", "three", new=("three",)))
    wait_until(lambda: stored.read("a", "three"))
    assert stored.read("a", "one") is None and stored.read("a", "two") == b"points of two"
    assert stored.read("b", "one") == b"points of one"
    writer.end()


def test_a_password_of_the_database_is_not_printed_with_a_task():
    assert "secret" not in repr(StoredCurves("postgresql://twin:secret@127.0.0.1/none"))


def test_what_waits_is_joined_by_what_is_newer():
    writer = CurveWriter("postgresql://nobody@127.0.0.1:1/none")
    writer.keep("a", curves("one", "two", new=("one", "two")))
    writer.keep("a", curves("two", "three", new=("three",)))
    assert dict(writer._waiting["a"].new) == {"two": b"points of two", "three": b"points of three"}


def test_a_database_that_is_away_costs_a_look_and_no_more(monkeypatch):
    stored = StoredCurves("postgresql://nobody@127.0.0.1:1/none")
    assert stored.read("a", "one") is None
    asked = []
    monkeypatch.setattr(kept_curves, "_reader", lambda database: asked.append(database))
    assert stored.read("a", "one") is None and not asked
