"""The date of the end of life: how much of the time a machine runs, stated or observed."""

from __future__ import annotations

import pytest

from tests.mesh_pairs import UNSW_RIG
from twin.assessment import Interval, Life, LifeDate, Unavailable
from twin.rig import Rig
from twin.updating.running_time import MOST_MARKS, dated, running_share, with_mark

DAY = 86400
NS = 10**9
SPEED = 10.0
RIG = Rig.from_mapping(UNSW_RIG)
LIFE = Life(
    criterion="max_depth", limit=5e-4, reached=False, revolutions=Interval(median=3.6e6, p05=1.8e6, p95=None),
    time=Interval(median=3.6e5, p05=1.8e5, p95=None), speed=SPEED, torque=10.0,
)  # fmt: skip


def stated(hours):
    return Rig.from_mapping(UNSW_RIG | {"operating": {**UNSW_RIG["operating"], "hours_per_day": hours}})


def marks(days, hours_a_day, start=0, count=0.0):
    """A window a day of a machine that runs so many hours of each."""
    out = ()
    for day in range(start, start + days):
        out = with_mark(out, day * DAY * NS, count + (day - start) * hours_a_day * 3600 * SPEED, SPEED)
    return out


def test_running_time_per_day_of_the_rig_file_is_used_before_any_observation():
    assert running_share(stated(6.0), marks(20, 12.0)) == (pytest.approx(0.25), "rig file")


def test_running_time_is_observed_from_the_counts_of_the_windows():
    assert running_share(RIG, marks(20, 8.0)) == (pytest.approx(1 / 3), "observed")


def test_a_change_of_shifts_shows_within_a_month():
    before = marks(300, 4.0)
    later = before
    for day in range(300, 345):
        count = before[-1].revolutions + (day - 299) * 16 * 3600 * SPEED
        later = with_mark(later, day * DAY * NS, count, SPEED)
    share, _ = running_share(RIG, later)
    assert share == pytest.approx(16 / 24, rel=0.02)


def test_marks_of_a_long_history_stay_few():
    assert len(marks(1000, 8.0)) <= MOST_MARKS
    assert running_share(RIG, marks(1000, 8.0)) == (pytest.approx(1 / 3), "observed")


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ((), "operating.hours_per_day"),
        (marks(6, 8.0), "cover 120 h, and 7 days are needed"),
        (marks(10, 30.0), "only 216 h have passed"),
        (marks(10, 0.0), "has not run in the last 9 days"),
    ],
)
def test_without_a_running_time_there_is_no_date_but_its_reason(given, why):
    found = dated(RIG, LIFE, given)
    assert isinstance(found.date, Unavailable) and why in found.date.reason


def test_date_is_the_latest_window_and_the_life_over_the_share_that_runs():
    found = dated(stated(12.0), LIFE, marks(3, 8.0))
    assert isinstance(found.date, LifeDate)
    since = 2 * DAY * NS
    assert (found.date.since_ns, found.date.median_ns) == (since, since + 720_000 * NS)
    assert (found.date.p05_ns, found.date.p95_ns) == (since + 360_000 * NS, None)


def test_no_date_is_stated_beyond_a_hundred_years():
    found = dated(stated(0.001), LIFE, marks(3, 8.0))
    assert found.date.median_ns is None and found.date.source == "rig file"


def test_window_that_arrives_late_or_has_no_count_leaves_no_mark():
    before = marks(3, 8.0)
    assert with_mark(before, DAY * NS, 10.0, SPEED) == before
    assert with_mark(before, 9 * DAY * NS, None, SPEED) == before
    assert with_mark(before, 9 * DAY * NS, 1e9, None) == before
