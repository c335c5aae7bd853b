"""Inspections become part of the estimate: once each, whatever is killed, and the answer says what they changed."""

from __future__ import annotations

import signal
from types import SimpleNamespace

import pytest
import service_fakes as fakes
from memory_transport import MemoryNetwork
from service_streams import Service, SqliteFile, service, wait_until, write_recording
from test_decisions import post
from test_other_parts import serving

from service.contract.inspections import BY_LEVEL, outcome_of
from service.errors import StorageUnavailable
from service.results.jobs import Jobs
from service.runtime.computing import Made
from service.runtime.decisions import Decisions
from service.runtime.place import Place
from service.runtime.reception import Reception
from service.runtime.replay import replay
from service.runtime.twin_port import Answer

WINDOWS = 3
GIVEN = {"revolutions": 1200.0, "max_depth_um": 30.0, "flank": "combined", "std_um": 1.0}
PATH = "/v1/assets/unsw/inspections"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


def used(running: Service) -> float:
    """How many inspections are part of the estimate."""
    wear = running.get("/v1/assets/unsw/wear")
    return wear["k_wear_per_n"] if "inspections" in wear else 0.0


@pytest.mark.slow
def test_answer_says_what_the_inspection_changed_and_the_state_shows_it(tmp_path, recording):
    with service(tmp_path) as running:
        replay(recording, [running.endpoint], 0)
        wait_until(lambda: (running.get("/v1/assets/unsw") or {}).get("windows_total") == WINDOWS)
        before = running.get("/v1/assets/unsw")
        status, answer = post(running, PATH, GIVEN)
        assert status == 201 and answer["applied"] is True and answer["reason"] is None
        assert answer["twin"]["max_depth_um"]["median"] > 0
        changed = answer["changed"]["depth_um"]
        assert changed["before"] == before["wear"]["max_depth_um"]["combined"]
        assert changed["after"] == {"median": 30.0, "p05": 29.0, "p95": 31.0}
        after = running.get("/v1/assets/unsw")
        assert after["wear"]["max_depth_um"]["combined"]["median"] == 30.0
        assert after["residual"] == before["residual"]  # what the inspection does not concern stays
        assert running.get(PATH) == [answer]
        status, wrong = post(running, PATH, {**GIVEN, "max_depth_um": 600.0})
        assert wrong["contradiction"] == "The inspection contradicts."
    with running.store() as store:
        assert [e.kind for e in store.events("unsw", 0)].count("rul") == WINDOWS + 2


@pytest.mark.slow
@pytest.mark.serve_only("a front end is not told that the storage of a worker is full")
@pytest.mark.parametrize("verb", ["inspection", "decision"])
def test_what_a_full_disk_keeps_from_being_used_is_answered_at_once_as_waiting(tmp_path, recording, monkeypatch, verb):
    """What is kept was answered after half a minute, as though it might be carried out meanwhile."""
    network, full = MemoryNetwork(), [True]
    monkeypatch.setattr("service.api.DECISION_WAIT", 3600.0)
    monkeypatch.setattr(Jobs, "end", _unless_full(Jobs.end, full))
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        replay(recording, (), 0, publish_to=network.open_publisher)
        running.wait_for_windows(WINDOWS)
        if verb == "inspection":
            status, answer = post(running, PATH, GIVEN)
            assert status == 201 and answer["applied"] is False and answer["reason"].startswith("kept")
        else:
            status, answer = post(running, "/v1/assets/unsw/effects/misalignment", {"decision": "pin"})
            assert status == 202 and answer["done"] is False
        full.clear()
        wait_until(running.ready)
        wait_until(lambda: used(running) == 1.0 or verb == "decision")


def _unless_full(method, full):
    def call(*given, **named):
        if full:
            raise StorageUnavailable("the disk is full", reason="no space")
        return method(*given, **named)

    return call


@pytest.mark.slow
def test_inspection_that_meets_an_internal_error_is_kept_and_changes_nothing(tmp_path, recording):
    with service(tmp_path) as running:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        status, answer = post(running, PATH, {**GIVEN, "max_depth_um": 2000.0})
        assert status == 201 and answer["applied"] is False and "ZeroDivisionError" in answer["reason"]
        assert used(running) == 0 and len(running.get(PATH)) == 1


@pytest.mark.slow
def test_inspection_that_was_kept_before_a_kill_is_used_once_by_the_next_start(tmp_path, recording):
    running = Service(tmp_path).start()
    try:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        running.end(signal.SIGKILL)
        with running.store() as store:
            number = fakes.inspect(store, "unsw", GIVEN, {"twin": {}})
        for _ in range(2):
            running.start()
            wait_until(lambda: used(running) > 0.5)
            assert used(running) == 1.0
            running.end(signal.SIGKILL)
        with running.store() as store:
            assert fakes.jobs_of(store).job(number).done and not fakes.jobs_of(store).pending()
            assert fakes.jobs_of(store).job(number).outcome["applied"] is True
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.slow
def test_machine_whose_depth_comes_from_a_relation_is_told_where_the_inspection_belongs():
    after = {"wear": {"method": "level", "max_depth_um": {"combined": fakes.band(30.0, 0.2)}}}
    assert outcome_of(GIVEN, None, after) == {
        "applied": False, "reason": BY_LEVEL, "changed": None, "contradiction": None
    }  # fmt: skip


def test_inspection_before_the_first_depth_is_kept_for_it():
    after = {"wear": {"status": "not available", "reason": "no window has been assessed yet"}}
    said = outcome_of(GIVEN, None, after)
    assert not said["applied"] and said["reason"].startswith("kept, and used from the first window")


def outcomes(store, report, answer, **stream):
    """What an inspection and a decision lead to, of an asset with such a report and a stream as given."""
    place = Place(asset="unsw", rig=None, twin=None, state=None, report=report)
    made = Made(state=SimpleNamespace(to_dict=dict), answer=Answer(record={}, report=answer, events=()))
    jobs, kinds = Jobs(store.database), Decisions(SimpleNamespace(**stream)).kinds
    store.note("unsw", [])
    numbers = (fakes.inspect(store, "unsw", GIVEN, {}), fakes.decide(store, "unsw", "misalignment", "pin"))
    for job in map(jobs.job, numbers):
        yield kinds[job.kind].then(place, job, made).report


def test_status_that_an_inspection_leaves_as_it_was_holds_since_the_same_time(store):
    since = {"time": "2026-01-01T00:00:00Z", "revolutions": 5.0}
    status = fakes.status("alarm", "worn")
    before = {"status": {**status, "since": since}, "residual": 1}
    after = [*outcomes(store, before, {"status": status}, ended_ns=lambda asset: 10**18)]
    assert [report["status"] for report in after] == [{**status, "since": since}] * 2
    assert after[0]["residual"] == 1  # what the inspection does not concern stays


@pytest.mark.parametrize("report", [None, {"status": {"level": "normal", "since": {"time": "earlier"}}}])
def test_status_that_a_person_changes_holds_since_the_newest_window_and_where_there_is_none_since_now(store, report):
    """No window has ended by a clock that was just set."""
    stream = Reception(lambda asset: None, lambda window: None, host_clock=lambda: 1_790_000_000 * 10**9)
    if True:
        given = {"ended_ns": stream.ended_ns}
        for after in outcomes(store, report, {"status": fakes.status("alarm", "worn")}, **given):
            assert after["status"]["since"]["time"].startswith("2026-09-21T14:13:20")
