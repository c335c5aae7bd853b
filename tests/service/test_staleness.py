"""An asset that sends nothing of use any more is not shown as well: when, since when, and what ends it."""

from __future__ import annotations

from dataclasses import replace

import fake_twin
import pytest
import service_fakes as fakes
from sqlalchemy import text
from test_api import Client

from service.alarms.keeper import AlarmKeeper
from service.alarms.rules import DEFAULT_RULES, Rule
from service.api import create_app
from service.errors import StorageUnavailable
from service.results.alarm_store import AlarmStore
from service.results.baseline_store import BaselineStore
from service.results.jobs import NOTICE, Jobs
from service.results.names import Names
from service.results.window_jobs import WindowJobs
from service.runtime.staleness import NS, StalenessLimits, StalenessWatch, silent, usual_pause
from service.runtime.work import Work
from service.steady_clock import steady_time_ns

LIMITS = StalenessLimits(silent=3600.0, fruitless=120.0)
BEGIN = fakes.START_NS  # when the first window of the fakes was committed
TWIN = replace(fake_twin.TWIN, load_state=lambda kept: fake_twin.FakeState())


class Watched:
    """The watch over the assets of a board, whoever judges what it notices, and a clock that can be set [s]."""

    def __init__(self, store, board, limits=LIMITS, begin=BEGIN, alarms=None):
        self.store, self.board, self.now = store, board, 0.0
        self._begin, self._limits = begin, limits
        self.jobs, folder = Jobs(store.database), store.path.parent
        self.windows = WindowJobs(store.database, folder / "segments")
        self.work = Work(
            store, board, TWIN, windows=self.windows, names=Names(store.database),
            baselines=BaselineStore(store.database, folder / "baselines"), alarms=alarms,
        )  # fmt: skip
        self.restart()

    def restart(self):
        self.watch = StalenessWatch(
            self.board, self.jobs.notice, self._limits, clock=lambda: self._begin + round(self.now * NS)
        )

    def judge(self):
        """Carries out what waits."""
        for asset in self.board.assets():
            while self.work.turn(asset).job is not None:
                pass

    def at(self, seconds, frame="", judge=True, asset="unsw"):
        """What is shown of the data of an asset after a look at a time, at which a frame of one may come."""
        self.now = seconds
        if frame:
            self.watch.heard(frame)
        self.watch()
        if judge:
            self.judge()
        return self.level(asset)

    def level(self, asset="unsw"):
        return self.board.get(asset).whole["data"]["level"]

    def window(self, index):
        """A window comes, and is committed at once."""
        self.watch.closed("unsw", fakes.START_NS + index * 600 * NS)
        fakes.take(self.store, self.board, "unsw", index, 10.0 + index)

    def reason(self, asset="unsw"):
        stale = self.board.get(asset).stale
        return stale and stale.reason

    def waiting(self):
        """What was noticed and is not judged yet."""
        return [job for job in self.jobs.pending() if job.kind == NOTICE]


@pytest.fixture
def watched(store, board):
    """The watch over one asset with a window."""
    fakes.take(store, board, "unsw", 0, 10.0)
    return Watched(store, board)


def test_asset_without_a_window_for_longer_than_stated_is_stale_and_says_since_when(watched, store, board):
    assert watched.at(3599.0) == "ok"
    assert watched.at(3602.0) == "stale"
    reason = board.get("unsw").whole["data"]["reason"]
    status = board.get("unsw").whole["status"]
    assert (status["level"], status["reasons"]) == ("no_verdict", [f"N{reason[1:]}."])
    assert status["since"] == {"time": "2023-11-14T22:13:20.000000000Z", "revolutions": None}
    assert reason == "no whole measurement window has been received since 2023-11-14 22:13:20 UTC"
    fault, changed = store.events("unsw", 0)[-2:]
    assert (fault.kind, fault.data["kind"], fault.data["detail"]) == ("data_fault", "stale", reason)
    assert (changed.kind, changed.data["level"], changed.data["data"]["level"]) == ("status", "no_verdict", "stale")
    assert board.get("unsw").last_event_id == changed.id


def test_a_new_window_ends_it(watched):
    assert watched.at(4000.0) == "stale"
    watched.now = 4200.0
    watched.window(7)
    assert watched.level() == "ok"
    assert watched.at(4300.0) == "ok"


def test_frames_that_never_become_a_window_make_an_asset_stale_much_sooner(watched, board):
    """As where all time stamps contradict what was received before."""
    for second in range(10, 125, 5):
        assert watched.at(float(second), frame="unsw") == "ok"
    assert watched.at(135.0, frame="unsw") == "stale"
    reason = board.get("unsw").whole["data"]["reason"]
    assert "frames have been received since 2023-11-14 22:13:30 UTC without a whole" in reason


def test_frames_with_windows_between_them_are_in_order(watched):
    for index in range(1, 4):
        for second in range(600 * (index - 1) + 540, 600 * index, 5):
            assert watched.at(float(second), frame="unsw") == "ok"
        watched.window(index)


def test_it_is_told_once_also_after_a_restart(watched, store):
    for second in (4000.0, 4002.0, 4004.0):
        assert watched.at(second) == "stale"
    watched.restart()
    assert watched.at(4006.0) == "stale"
    assert sum(e.data.get("kind") == "stale" for e in store.events("unsw", 0)) == 1 and not watched.waiting()


def test_it_is_told_once_where_the_storage_fails_meanwhile(store, board, monkeypatch):
    def unavailable(*given):
        raise StorageUnavailable("away", reason="away")

    fakes.take(store, board, "unsw", 0, 10.0)
    watched = Watched(store, board, alarms=AlarmKeeper(AlarmStore(store.database)))
    with monkeypatch.context() as patched:
        patched.setattr(watched.jobs, "notice", unavailable)
        watched.restart()
        with pytest.raises(StorageUnavailable):
            watched.at(4000.0)
    with monkeypatch.context() as patched:
        patched.setattr(store, "last_event_id", unavailable)
        watched.restart()
        assert watched.at(4002.0) == "ok" and watched.work.turn("unsw").unstored is not None
    assert watched.at(4004.0) == "stale"
    told = [event.kind for event in store.events("unsw", 0) if event.kind in ("data_fault", "alarm", "status")]
    assert told == ["data_fault", "alarm", "status"]


# -- what was noticed, and is judged later -------------------------------------------------------------------


def test_what_waits_to_be_judged_waits_once(watched):
    for second in (4000.0, 4002.0, 4004.0):
        watched.at(second, judge=False)
    watched.restart()
    watched.at(4006.0, judge=False)
    (notice,) = watched.waiting()
    assert watched.level() == "ok" and notice.given["reason"].startswith("no whole measurement window")
    watched.judge()
    assert watched.level() == "stale" and not watched.waiting()


def test_silence_that_has_ended_by_the_time_it_is_judged_leads_to_nothing(watched, store):
    for index in range(1, 5):
        watched.now = 600.0 * index
        watched.window(index)
    before = store.last_event_id("unsw"), board_version(store)
    assert watched.at(2400.0 + 2000.0, judge=False) == "ok" and watched.waiting()
    watched.at(2400.0 + 2005.0, frame="unsw", judge=False)
    (notice,) = watched.waiting()
    assert notice.given["reason"] is None
    watched.judge()
    assert (store.last_event_id("unsw"), board_version(store)) == before and not watched.waiting()


def board_version(store):
    return store.database.rows(text("SELECT version FROM assets WHERE asset = 'unsw'"))


def waits(watched, comes=True):
    """A window comes, or had come before, that waits for its turn; it has no room: nobody needs frames of it."""
    start_ns = fakes.START_NS + round(watched.now * NS) + 600 * NS
    written = replace(watched.windows.write(fakes.SEGMENT), start_ns=start_ns)
    window = watched.windows.add_waiting("unsw", written)
    watched.windows.leave_out(window, "no room")
    if comes:
        watched.watch.closed("unsw", start_ns)


def test_a_window_that_comes_before_it_is_judged_makes_nothing_of_it(watched, store):
    watched.at(4000.0, judge=False)
    waits(watched)
    assert not watched.waiting()
    watched.judge()
    assert watched.level() != "stale" and "stale" not in [e.data.get("kind") for e in store.events("unsw", 0)]


def test_windows_that_had_come_before_do_not_end_it_and_later_ones_do(watched):
    waits(watched)
    watched.at(4000.0, judge=False)
    assert watched.work.turn("unsw").kind == NOTICE and watched.level() == "stale"
    assert watched.work.turn("unsw").index == 1 and watched.level() == "stale"
    watched.now = 4100.0
    waits(watched)
    assert watched.work.turn("unsw").index == 2 and watched.level() != "stale"


def test_a_window_that_came_long_ago_and_is_kept_only_now_ends_nothing(watched):
    """The storage was away: the asset was shown as sound from then on, however long nothing came."""
    assert watched.at(4000.0) == "stale"
    waits(watched, comes=False)
    watched.watch.stored("unsw")
    assert watched.at(4002.0) == "stale" and not watched.waiting()
    assert [event.data.get("kind") for event in watched.store.events("unsw", 0)].count("stale") == 1


def test_an_asset_that_was_retired_before_it_is_judged_is_not_shown_so(watched, board):
    watched.jobs.add("unsw", "retired", {"by": "Anna"})
    watched.at(4000.0)
    assert board.get("unsw").retired is not None and watched.level() == "ok" and not watched.waiting()


def test_what_the_last_run_has_noticed_is_dropped_by_the_next_start_and_seen_anew(watched):
    watched.at(4000.0, judge=False)
    watched.jobs.forget("stale")
    assert not watched.waiting()
    watched.restart()
    assert watched.at(4001.0) == "stale"


def test_windows_that_wait_at_a_start_have_been_received(watched, store, board):
    watch = StalenessWatch(
        board, watched.jobs.notice, LIMITS, clock=lambda: BEGIN + 5000 * NS, waiting=lambda asset: BEGIN + 4000 * NS
    )
    watch()
    assert not watched.waiting()


# -- assets that come and go ---------------------------------------------------------------------------------


def test_asset_that_never_had_a_window_is_measured_from_the_start_of_the_service(store, board):
    board.update("fresh", quality={})
    watched = Watched(store, board)
    assert watched.at(3000.0, asset="fresh") == "waiting"
    assert watched.at(3700.0, asset="fresh") == "stale"


def test_asset_that_comes_later_is_measured_from_when_the_service_first_knew_of_it(store, board):
    watched = Watched(store, board)

    watched.watch()
    board.update("late")
    assert watched.at(10_000, asset="late") == "waiting"  # known since this look
    assert watched.at(13_600, frame="late", asset="late") == "waiting"
    assert watched.at(13_601, asset="late") == "stale"
    assert "since 2023-11-15 01:00:00 UTC" in board.get("late").whole["data"]["reason"]


def test_retirement_ends_it_with_its_alarm_and_frames_of_before_are_forgotten(store, board):
    fakes.take(store, board, "unsw", 0, 10.0)
    alarms = AlarmKeeper(AlarmStore(store.database), webhooks=["http://plant/hook"])
    watched = Watched(store, board, alarms=alarms)
    assert [watched.at(float(second), frame="unsw") for second in range(10, 150, 5)][-1] == "stale"
    assert [a["quantity"] for a in board.get("unsw").alarms] == ["data"]
    watched.jobs.add("unsw", "retired", {"by": "Anna"})
    watched.judge()
    watched.watch.retire("unsw", True)
    assert watched.at(200.0) == "ok"
    (alarm,) = board.get("unsw").alarms
    assert board.stale() == [] and not alarm["active"]  # it is open until somebody acknowledges it, as any that ended
    assert alarms.store.waiting() == 2  # that it was raised, and that it ended
    change, ended, changed = store.events("unsw", 0)[-3:]
    assert (change.kind, ended.kind, ended.data["verb"]) == ("change", "alarm", "ended")
    assert (changed.kind, changed.data["data"]["level"]) == ("status", "ok")
    assert watched.at(10_000.0) == "ok" and store.last_event_id("unsw") == changed.id
    watched.jobs.add("unsw", "reinstated", {"by": "Anna"})
    watched.judge()
    watched.watch.retire("unsw", False)
    silent = LIMITS.silent
    assert watched.at(10_001.0, frame="unsw") == watched.at(9_999.0 + silent) == "ok"  # reinstated: it has time to send
    assert watched.at(10_001.0 + silent) == "stale"
    assert watched.reason().startswith("no whole measurement window has been received since")


class Alarmed(Watched):
    """The watch over one asset with a window, with alarms by the given rules."""

    def __init__(self, store, board, rules=DEFAULT_RULES):
        fakes.take(store, board, "unsw", 0, 10.0)
        self.keeper, self.judged = AlarmKeeper(AlarmStore(store.database), rules), 0
        data = self.keeper.data

        def counted(asset, shown):
            self.judged += 1
            return data(asset, shown)

        self.keeper.data = counted
        super().__init__(store, board, alarms=self.keeper)

    def look(self, seconds):
        """What is shown of the data alarms after a look so many seconds after the window."""
        self.at(seconds)
        return [(a["id"], a["active"]) for a in self.board.get("unsw").alarms if a["quantity"] == "data"]

    def clear(self, number):
        client = Client(create_app(self.board, self.store, alarms=self.keeper))
        given = {"by": "Anna", "note": "seen"}
        assert client.call("POST", f"/v1/assets/unsw/alarms/{number}/clear", json=given).status_code == 200

    def told(self):
        events = [e for e in self.store.events("unsw", 0) if e.kind in ("alarm", "data_fault")]
        return [e.data.get("verb") or e.data["kind"] for e in events]


def test_data_rule_that_must_last_is_raised_once_the_asset_is_stale(store, board):
    alarmed = Alarmed(store, board, (Rule(name="data", quantity="data", windows=3, seconds=600.0),))
    assert alarmed.look(4000.0) == [(1, True)]


def test_data_alarm_that_was_cleared_is_raised_again_while_the_asset_stays_stale(store, board):
    alarmed = Alarmed(store, board)
    assert alarmed.look(4000.0) == [(1, True)]
    alarmed.clear(1)
    assert alarmed.look(4002.0) == [(2, True)] == alarmed.look(4004.0)
    assert alarmed.told() == ["stale", "raised", "cleared", "raised"], "that it is stale is told once"
    assert alarmed.judged == 2


def test_alarm_that_was_cleared_after_new_data_had_come_is_not_judged(store, board):
    alarmed = Alarmed(store, board)
    alarmed.look(4000.0)
    alarmed.clear(1)
    alarmed.window(7)
    alarmed.judge()
    assert alarmed.judged == 1 and board.get("unsw").alarms == ()


def test_rules_that_are_others_after_a_restart_hold_for_what_is_stale_already(store, board):
    alarmed = Alarmed(store, board, (Rule(name="depth", quantity="depth"),))
    assert alarmed.look(4000.0) == []
    alarmed.keeper._rules = DEFAULT_RULES
    alarmed.restart()
    assert alarmed.look(4002.0) == [(1, True)] and alarmed.told() == ["stale", "raised"]


def test_stale_asset_without_a_data_rule_is_not_judged_again_at_each_look(store, board):
    alarmed = Alarmed(store, board, (Rule(name="depth", quantity="depth"),))
    for second in range(4000, 4100, 2):
        assert alarmed.look(float(second)) == []
    assert alarmed.judged == 1


def test_what_is_known_of_an_asset_outlives_its_name(store, board):
    fakes.take(store, board, "unsw", 0, 10.0)
    board.update("fresh")
    watched = Watched(store, board)
    for second in range(10, 140, 5):
        watched.at(second, frame="unsw")
    fruitless = watched.reason()
    assert fruitless.startswith("frames have been received since 2023-11-14 22:13:30 UTC")
    board.update("unsw", label="press-7")
    watched.at(150, frame="unsw")
    assert watched.reason() == fruitless
    watched.at(3601, frame="unsw")
    assert "since 2023-11-14 22:13:20 UTC" in watched.reason("fresh")  # when the service first knew of it


def test_readiness_and_metrics_name_the_stale_asset(watched, store, board):
    watched.at(4000.0)
    client = Client(create_app(board, store))
    (named,) = client.get("/readyz").json()["stale"]
    assert (named["asset"], named["since"]) == ("unsw", "2023-11-14T22:13:20.000000000Z")
    text = client.get("/metrics").text
    assert 'gear_twin_stale{asset="unsw"} 1.0' in text
    assert 'gear_twin_last_window_seconds{asset="unsw"} 1.7e+09' in text
    assert client.get("/v1/assets").json()[0]["data"] == "stale"


# -- silence by the stream's own rhythm ----------------------------------------------------------------------

A_DAY = StalenessLimits(silent=86_400.0, fruitless=3600.0)
EVERY = 600.0  # pause of the fakes' windows [s]


def of_windows(store, board, number):
    """What is shown of the data of an asset with so many windows, ten minutes apart, at a time after the last [s]."""
    for index in range(number):
        fakes.take(store, board, "unsw", index, 10.0 + index)
    watched = Watched(store, board, A_DAY, fakes.START_NS + (number - 1) * 600 * NS)

    def at(seconds, frame=False):
        watched.at(seconds, frame="unsw" if frame else "")
        return board.get("unsw").whole["data"]

    return at


def test_logger_that_is_dead_is_said_to_be_silent_after_three_of_its_own_pauses(store, board):
    """It was "data good, the latest window is good" for 24 hours."""
    at = of_windows(store, board, 5)
    assert at(3 * EVERY - 10)["level"] == "ok"
    data = at(3 * EVERY + 10)
    assert data["level"] == "stale" and data["since"] == "2023-11-14T22:53:20.000000000Z"
    assert data["reason"].endswith("since 2023-11-14 22:53:20 UTC; usually a window comes every 10 min")
    status = board.get("unsw").whole["status"]
    assert status["level"] == "no_verdict" and "acquisition" in status["action"]


def test_frames_that_come_again_end_the_silence(store, board):
    at = of_windows(store, board, 5)
    assert at(5 * EVERY)["level"] == "stale"
    assert at(5 * EVERY + 5, frame=True)["level"] == "ok"
    assert at(5 * EVERY + 5 + 3 * EVERY - 10)["level"] == "ok" and at(9 * EVERY)["level"] == "stale"


def test_windows_that_wait_to_be_assessed_are_no_silence_while_frames_come(store, board):
    at = of_windows(store, board, 5)
    levels = [at(float(second), frame=True)["level"] for second in range(60, 3000, 60)]
    assert set(levels) == {"ok"}


@pytest.mark.parametrize("number", [1, 2, 3])
def test_rhythm_of_too_few_windows_is_not_known(store, board, number):
    assert of_windows(store, board, number)(20 * EVERY)["level"] == "ok"


def test_unbroken_stream_is_not_silent_within_three_of_the_longest_frames():
    seen = fakes.START_NS
    assert silent(seen + 29 * NS, seen, 1.0) is None and silent(seen + 31 * NS, seen, 1.0) is not None
    assert silent(seen + 10**6 * NS, seen, None) is None


def test_usual_pause_is_not_that_of_a_weekend_or_of_a_clock_that_was_set_back():
    minutes = (0, 10, 20, 30, 3910, 3920, 3900, 3930)
    starts = [60.0 * minute for minute in minutes]
    assert usual_pause(starts) == pytest.approx(600.0) and usual_pause(starts[:3]) is None


@pytest.mark.parametrize("step", [-86_400.0, 86_400.0, 1e9])
def test_clock_of_the_machine_that_steps_makes_nothing_silent_and_hides_no_silence(store, board, step):
    """Windows are dated by a clock that may step; silence is measured by one that cannot."""
    for index in range(5):
        fakes.take(store, board, "unsw", index, 10.0 + index)
    watched = Watched(store, board, A_DAY, fakes.START_NS + 4 * 600 * NS)
    watched.now = 60.0
    watched.window(5)
    board.update("unsw", received_ns=watched._begin + round(step * NS))  # by the clock after its step
    assert watched.at(61.0) == "ok"
    assert watched.at(60.0 + 3 * EVERY + 10) == "stale"


def test_clock_that_was_ahead_in_the_last_run_hides_no_silence(store, board):
    for index in range(5):
        fakes.take(store, board, "unsw", index, 10.0 + index)
    board.update("unsw", received_ns=fakes.START_NS + 10**9 * NS)
    watched = Watched(store, board, A_DAY, fakes.START_NS + 4 * 600 * NS)
    assert (watched.at(60.0), watched.at(3 * EVERY + 10)) == ("ok", "stale")


def test_steady_clock_goes_on_where_the_machines_clock_steps(monkeypatch):
    import time

    before = steady_time_ns()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    assert 0 <= steady_time_ns() - before < 10 * NS


def test_what_may_have_been_kept_is_noticed_again_whatever_is_so_by_then(store, board):
    """A commit had no answer; frames came again within a second, and the asset stayed stale."""
    for index in range(5):
        fakes.take(store, board, "unsw", index, 10.0 + index)
    watched = Watched(store, board, A_DAY, fakes.START_NS + 4 * 600 * NS)
    keep = watched.jobs.notice

    def unanswered(*notices):
        keep(*notices)
        raise StorageUnavailable("the connection is lost", reason="connection lost", unknown=True)

    watched.watch._notice = unanswered
    with pytest.raises(StorageUnavailable):
        watched.at(5 * EVERY)
    watched.judge()
    assert watched.level() == "stale"
    watched.watch._notice = keep
    assert watched.at(5 * EVERY + 2, frame="unsw") == "ok"
