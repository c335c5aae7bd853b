"""An asset that sends nothing of use any more is not shown as well: when, since when, and what ends it."""

from __future__ import annotations

import pytest
import service_fakes as fakes
from test_api import Client

from service.alarms.keeper import AlarmKeeper
from service.alarms.rules import DEFAULT_RULES, Rule
from service.api import create_app
from service.errors import StorageUnavailable
from service.results.alarm_store import AlarmStore
from service.results.window_jobs import WindowJobs
from service.runtime.commits import Commits
from service.runtime.staleness import NS, StalenessLimits, StalenessWatch, silent, usual_pause
from service.steady_clock import steady_time_ns

LIMITS = StalenessLimits(silent=3600.0, fruitless=120.0)
BEGIN = fakes.START_NS  # when the first window of the fakes was committed


def watch_of(store, board, published, limits, clock, alarms=None):
    """The watch over a board as it is written into the tables."""
    commits = Commits(store, board, WindowJobs(store.database), alarms=alarms)

    def keep(outcome):
        commits.commit(outcome)
        published.publish(outcome.asset)

    return StalenessWatch(board, keep, limits, clock=clock)


class Published(list):
    def publish(self, asset):
        self.append(asset)


@pytest.fixture
def watched(store, board):
    """The watch over one asset with a window, and a clock that can be set [s after that window]."""
    fakes.take(store, board, "unsw", 0, 10.0)
    now = [0.0]
    published = Published()
    watch = watch_of(store, board, published, LIMITS, lambda: BEGIN + round(now[0] * NS))

    def at(seconds, frame=False):
        now[0] = seconds
        if frame:
            watch.heard("unsw")
        watch()
        return board.get("unsw").whole["data"]["level"]

    at.published = published
    return at


def test_asset_without_a_window_for_longer_than_stated_is_stale_and_says_since_when(watched, store, board):
    assert watched(3599.0) == "ok"
    assert watched(3602.0) == "stale"
    assert watched.published == ["unsw"]
    reason = board.get("unsw").whole["data"]["reason"]
    status = board.get("unsw").whole["status"]
    assert (status["level"], status["reasons"]) == ("no_verdict", [f"N{reason[1:]}."])
    assert status["since"] == {"time": "2023-11-14T22:13:20.000000000Z", "revolutions": None}
    assert reason == "no whole measurement window has been received since 2023-11-14 22:13:20 UTC"
    fault, changed = store.events("unsw", 0)[-2:]
    assert (fault.kind, fault.data["kind"], fault.data["detail"]) == ("data_fault", "stale", reason)
    assert (changed.kind, changed.data["level"], changed.data["data"]["level"]) == ("status", "no_verdict", "stale")
    assert board.get("unsw").last_event_id == changed.id


def test_a_new_window_ends_it(watched, store, board):
    assert watched(4000.0) == "stale"
    fakes.take(store, board, "unsw", 7, 20.0)  # 4200 s after the first
    assert board.get("unsw").whole["data"]["level"] == "ok"
    assert watched(4300.0) == "ok"


def test_frames_that_never_become_a_window_make_an_asset_stale_much_sooner(watched, board):
    """As where all time stamps contradict what was received before."""
    for second in range(10, 125, 5):
        assert watched(float(second), frame=True) == "ok"
    assert watched(135.0, frame=True) == "stale"
    reason = board.get("unsw").whole["data"]["reason"]
    assert "frames have been received since 2023-11-14 22:13:30 UTC without a whole" in reason


def test_frames_with_windows_between_them_are_in_order(watched, store, board):
    for index in range(1, 4):
        for second in range(600 * (index - 1) + 540, 600 * index, 5):
            assert watched(float(second), frame=True) == "ok"
        fakes.take(store, board, "unsw", index, 10.0)


def test_it_is_told_once_and_survives_no_restart_falsely(watched, store, board):
    for second in (4000.0, 4002.0, 4004.0):
        assert watched(second) == "stale"
    assert sum(e.data.get("kind") == "stale" for e in store.events("unsw", 0)) == 1


def test_it_is_told_once_where_the_storage_fails_meanwhile(store, board, monkeypatch):
    def unavailable(asset):
        raise StorageUnavailable("away", reason="away")

    fakes.take(store, board, "unsw", 0, 10.0)
    now, alarms = [BEGIN + 4000 * NS], AlarmKeeper(AlarmStore(store.database))
    watch = watch_of(store, board, Published(), LIMITS, lambda: now[0], alarms)
    with monkeypatch.context() as patched:
        patched.setattr(store, "last_event_id", unavailable)
        with pytest.raises(StorageUnavailable):
            watch()
    now[0] += 2 * NS
    watch()
    told = [event.kind for event in store.events("unsw", 0) if event.kind in ("data_fault", "alarm", "status")]
    assert told == ["data_fault", "alarm", "status"] and board.get("unsw").whole["data"]["level"] == "stale"


def test_asset_that_never_had_a_window_is_measured_from_the_start_of_the_service(store, board):
    board.update("fresh", quality={})
    now = [0]
    watch = watch_of(store, board, Published(), LIMITS, lambda: BEGIN + now[0] * NS)
    now[0] = 3000
    watch()
    assert board.get("fresh").whole["data"]["level"] == "waiting"
    now[0] = 3700
    watch()
    assert board.get("fresh").whole["data"]["level"] == "stale"


def test_asset_that_comes_later_is_measured_from_when_the_service_first_knew_of_it(store, board):
    now = [0]
    watch = watch_of(store, board, Published(), LIMITS, lambda: BEGIN + now[0] * NS)

    def level(seconds):
        now[0] = seconds
        watch()
        return board.get("late").whole["data"]["level"]

    watch()
    board.update("late")
    assert level(10_000) == "waiting"  # known since this look
    watch.heard("late")
    assert level(13_600) == "waiting"
    assert level(13_601) == "stale"
    assert "since 2023-11-15 01:00:00 UTC" in board.get("late").whole["data"]["reason"]


def test_retirement_ends_it_with_its_alarm_and_frames_of_before_are_forgotten(store, board):
    fakes.take(store, board, "unsw", 0, 10.0)
    alarms, now = AlarmKeeper(AlarmStore(store.database), webhooks=["http://plant/hook"]), [0.0]
    published = Published()
    watch = watch_of(store, board, published, LIMITS, lambda: BEGIN + round(now[0] * NS), alarms)

    def level(seconds, frame=False):
        now[0] = seconds
        if frame:
            watch.heard("unsw")
        watch()
        return board.get("unsw").whole["data"]["level"]

    assert [level(float(second), frame=True) for second in range(10, 150, 5)][-1] == "stale"
    assert [a["quantity"] for a in board.get("unsw").alarms] == ["data"]
    board.update("unsw", retired={"since": "2023-11-14T22:20:00Z"})
    published.clear()
    assert level(200.0) == "ok"
    (alarm,) = board.get("unsw").alarms
    assert board.stale() == [] and not alarm["active"]  # it is open until somebody acknowledges it, as any that ended
    assert published == ["unsw"] and alarms.store.waiting() == 2  # that it was raised, and that it ended
    ended, changed = store.events("unsw", 0)[-2:]
    assert (ended.kind, ended.data["verb"]) == ("alarm", "ended")
    assert (changed.kind, changed.data["data"]["level"]) == ("status", "ok")
    assert level(10_000.0) == "ok" and published == ["unsw"]
    board.update("unsw", retired=None)
    silent = LIMITS.silent
    assert level(10_001.0, frame=True) == level(9_999.0 + silent) == "ok"  # reinstated: it has time to send
    assert level(10_001.0 + silent) == "stale"
    assert board.get("unsw").stale.reason.startswith("no whole measurement window has been received since")


class Alarmed:
    """The watch over one asset with a window, with alarms by the given rules, and a clock that can be set."""

    def __init__(self, store, board, rules=DEFAULT_RULES):
        fakes.take(store, board, "unsw", 0, 10.0)
        self.store, self.board, self.judged, self._now = store, board, 0, 0.0
        self.keeper, self.published = AlarmKeeper(AlarmStore(store.database), rules), Published()
        data = self.keeper.data

        def counted(asset, shown):
            self.judged += 1
            return data(asset, shown)

        self.keeper.data = counted
        self.watch = watch_of(store, board, self.published, LIMITS, lambda: BEGIN + round(self._now * NS), self.keeper)

    def look(self, seconds, asset="unsw"):
        """What is shown of the data alarms after a look so many seconds after the window."""
        self._now = seconds
        self.watch()
        return [(a["id"], a["active"]) for a in self.board.get(asset).alarms if a["quantity"] == "data"]

    def clear(self, number):
        self.keeper.sign("unsw", number, "cleared", "Anna", "")
        self.board.update("unsw", alarms=self.keeper.open("unsw"))

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
    assert alarmed.told() == ["stale", "raised", "raised"], "that it is stale is told once"
    assert alarmed.published == ["unsw", "unsw"] and alarmed.judged == 2


def test_stale_asset_without_a_data_rule_is_not_judged_again_at_each_look(store, board):
    alarmed = Alarmed(store, board, (Rule(name="depth", quantity="depth"),))
    for second in range(4000, 4100, 2):
        assert alarmed.look(float(second)) == []
    assert alarmed.judged == 1 and alarmed.published == ["unsw"]


def test_what_is_known_of_an_asset_outlives_its_name(store, board):
    fakes.take(store, board, "unsw", 0, 10.0)
    board.update("fresh")
    now = [0]
    watch = watch_of(store, board, Published(), LIMITS, lambda: BEGIN + now[0] * NS)

    def look(seconds, heard):
        now[0] = seconds
        watch.heard(heard)
        watch()

    def reason(asset):
        return board.get(asset).stale and board.get(asset).stale.reason

    for second in range(10, 140, 5):
        look(second, "unsw")
    fruitless = reason("unsw")
    assert fruitless.startswith("frames have been received since 2023-11-14 22:13:30 UTC")
    board.update("unsw", label="press-7")
    look(150, "unsw")
    assert reason("unsw") == fruitless
    look(3601, "unsw")
    assert "since 2023-11-14 22:13:20 UTC" in reason("fresh")  # when the service first knew of it


def test_readiness_and_metrics_name_the_stale_asset(watched, store, board):
    watched(4000.0)
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
    """The watch over an asset with so many windows, ten minutes apart, and a clock that can be set [s]."""
    for index in range(number):
        fakes.take(store, board, "unsw", index, 10.0 + index)
    last = fakes.START_NS + (number - 1) * 600 * NS
    now = [0.0]
    watch = watch_of(store, board, Published(), A_DAY, lambda: last + round(now[0] * NS))

    def at(seconds, frame=False):
        now[0] = seconds
        if frame:
            watch.heard("unsw")
        watch()
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
    records = [{"start_time": f"2026-03-{1 + m // 1440:02d}T{m % 1440 // 60:02d}:{m % 60:02d}:00Z"} for m in minutes]
    assert usual_pause(records) == pytest.approx(600.0)
    assert usual_pause(records[:3]) is None and usual_pause([{"start_time": None}] * 9) is None


@pytest.mark.parametrize("step", [-86_400.0, 86_400.0, 1e9])
def test_clock_of_the_machine_that_steps_makes_nothing_silent_and_hides_no_silence(store, board, monkeypatch, step):
    """Windows are dated by a clock that may step; silence is measured by one that cannot."""
    for index in range(5):
        fakes.take(store, board, "unsw", index, 10.0 + index)
    now = [0.0]
    last = board.get("unsw").received_ns
    watch = watch_of(store, board, Published(), A_DAY, lambda: last + round(now[0] * NS))
    watch()
    now[0] = 60.0
    board.update("unsw", received_ns=last + round(step * NS))  # the next window, by the clock after its step
    watch()
    assert board.get("unsw").whole["data"]["level"] == "ok"
    now[0] = 60.0 + 3 * EVERY + 10
    watch()
    assert board.get("unsw").whole["data"]["level"] == "stale"


def test_steady_clock_goes_on_where_the_machines_clock_steps(monkeypatch):
    import time

    before = steady_time_ns()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    assert 0 <= steady_time_ns() - before < 10 * NS
