"""Windows of another revolution count never mix with those before, and one disturbed count ends nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.scoring import windows_of
from tests.dynamics_cases import RIG
from twin.assessment import CountEvent
from twin.fallen_count import CountFellError, count_restarted, with_count_checked
from twin.features.window_features import WindowFeatures
from twin.options import Options
from twin.state import State
from twin.step import step
from twin.tracing.state import Tracing, TwinStage
from twin.updating.history import WindowInput
from twin.updating.memory import Memory
from twin.updating.tracker import WearTrack
from twin.windows import Window

RECORDINGS = Path(__file__).parents[2] / "recordings"
BOTH = ("pinion", "gear")
SPEED = 10.0  # [Hz]
SEEN = 9000.0  # revolutions of the machine before


def state() -> State:
    track = replace(WearTrack.unworn(1e-6), revolutions=SEEN, work=1e-3, windows=3)
    return State(tracing=Tracing(stages=(TwinStage(memory=replace(Memory(), track=track)),)))


def window(revolutions: float, time: float) -> WindowFeatures:
    return WindowFeatures(
        start_time_ns=int(time * 1e9), duration=2.0, quality="good", revolutions=revolutions, speed_hz=SPEED
    )


def after(counts_and_times) -> State:
    """The state after windows, those refused remembered."""
    now = state()
    for revolutions, time in counts_and_times:
        try:
            now = with_count_checked(RIG, now, window(revolutions, time))
        except CountFellError as refused:
            now = refused.state
    return now


def test_a_revolution_count_that_falls_far_is_refused_with_a_question():
    """Two machines, or old gears and new ones, were mixed under one asset name without a word."""
    with pytest.raises(CountFellError, match=r"500 revolutions .* 9000 .* gears been replaced.* another machine\?"):
        with_count_checked(RIG, state(), window(500.0, 1000.0))


def test_another_machine_stays_refused_where_its_count_passes_that_of_the_first():
    """Windows beyond the earlier count were mixed into the first machine's history."""
    now = after([(500.0, 1000.0), (4000.0, 1400.0), (8000.0, 1800.0)])
    with pytest.raises(CountFellError, match=r"continues a revolution count that had fallen to 8000 where 9000"):
        with_count_checked(RIG, now, window(12000.0, 2200.0))


def test_one_disturbed_count_is_refused_and_ends_nothing():
    now = after([(500.0, 1000.0)])
    assert now.fallen is not None and now.fallen.refusals == 1
    assert with_count_checked(RIG, now, window(9500.0, 1050.0)).fallen is None


def test_another_machine_is_not_taken_for_a_disturbance_where_its_second_count_passes_that_of_the_first():
    """D08 after D07, whose encoders were late at first: 7732 and 9041 were taken for D07 with one disturbed count."""
    now = after([(7732.0, 1000.0)])
    with pytest.raises(CountFellError, match=r"continues a revolution count that had fallen to 7732 where 9000"):
        with_count_checked(RIG, now, window(9041.0, 1151.0))
    for disturbed in (10.0, 4000.0, 8500.0):  # windows every 151 s of one machine, one of them with a disturbed count
        now = after([(disturbed, 1000.0)])
        assert with_count_checked(RIG, now, window(SEEN + 2 * 1510.0, 1151.0)).fallen is None


def test_a_count_that_the_lower_one_cannot_have_reached_is_the_first_machines_again():
    now = after([(500.0, 1000.0), (520.0, 1002.0)])
    assert with_count_checked(RIG, now, window(9600.0, 1060.0)).fallen is None


def with_history(*times_and_counts) -> State:
    """The state where windows have been traced at these times [s] and counts."""
    inputs = tuple(WindowInput(index=i, features=window(n, t)) for i, (t, n) in enumerate(times_and_counts))
    return replace(state(), tracing=replace(state().tracing, history=inputs))


def test_a_window_that_arrives_late_is_no_fallen_count():
    """It was refused as that of another machine."""
    traced = with_history((0.0, 100.0), (400.0, 4500.0), (800.0, SEEN))
    assert with_count_checked(RIG, traced, window(4800.0, 450.0)) == traced
    assert with_count_checked(RIG, traced, window(4500.0, 400.0)) == traced  # the same window again


@pytest.mark.parametrize("time, count", [(450.0, 3000.0), (300.0, 4800.0), (900.0, 4800.0), (-100.0, 50.0)])
def test_a_count_that_is_not_that_of_its_time_is_refused(time, count):
    traced = with_history((0.0, 100.0), (400.0, 4500.0), (800.0, SEEN))
    with pytest.raises(CountFellError):
        with_count_checked(RIG, traced, window(count, time))


def test_a_rising_count_changes_nothing():
    assert with_count_checked(RIG, state(), window(9200.0, 1000.0)) == state()


def test_the_fallen_count_survives_a_restart():
    now = after([(500.0, 1000.0), (520.0, 1002.0)])
    assert State.from_dict(now.to_dict()).fallen == now.fallen


@pytest.mark.slow
def test_two_reference_machines_under_one_name_are_asked_about_and_nothing_crashes(shared):
    """D08 after D07, both `unsw-rig`: windows were refused with "operands could not be broadcast", others mixed in."""
    folder = shared / "campaigns"
    rig, first = windows_of(folder / "D07.mcap")
    _, second = windows_of(folder / "D08.mcap")
    assert second[0].start_time_ns > first[-1].start_time_ns
    now = State()
    for found in first[:3]:
        now, _ = step(rig, now, found, Options(trace=True))
    for found in second[:2]:
        with pytest.raises(
            CountFellError, match=r"have the gears been replaced.* or is this another machine"
        ) as refused:
            step(rig, now, found, Options(trace=True))
        now = refused.value.state
    assert now.fallen is not None and now.fallen.refusals == 2


# ---- a count of the same gears that began again


def restarted(windows: list[Window], at: int, shift: float, shafts=BOTH) -> list[Window]:
    """Windows whose counters began again `shift` turns of their shaft before window `at`."""
    out = list(windows[:at])
    first = {shaft: windows[at].encoders[shaft].first_index for shaft in shafts}
    for w in windows[at:]:
        encoders = dict(w.encoders)
        for shaft in shafts:
            e = encoders[shaft]
            encoders[shaft] = replace(e, first_index=e.first_index - first[shaft] + round(shift * e.per_rev))
        out.append(replace(w, encoders=encoders))
    return out


@pytest.fixture(scope="module")
def worn():
    """The windows of a campaign of one pair that wears."""
    return windows_of(RECORDINGS / "short-campaign.mcap")


@pytest.mark.slow
@pytest.mark.parametrize(
    "at, shift, shafts",
    [
        (6, 0.0, ("pinion", "gear")),
        (6, 137.3, ("pinion", "gear")),
        (7, 20.0, ("pinion", "gear")),
        (6, 0.0, ("pinion",)),
    ],
)
def test_a_counter_that_began_again_on_the_same_flanks_is_followed_with_an_event(worn, at, shift, shafts):
    rig, windows = worn
    now, true = State(), windows[at].encoders["pinion"].first_index / windows[at].encoders["pinion"].per_rev
    for w in restarted(windows, at, shift, shafts)[: at + 1]:
        now, found = step(rig, now, w, Options(trace=True))
    (event,) = [e for e in found.events if isinstance(e, CountEvent)]
    assert "transmission error" in event.reason and now.fallen is None
    assert event.revolutions == pytest.approx(true, rel=0.03)  # by the growth of the error


@pytest.mark.slow
def test_new_gears_whose_count_falls_are_asked_about(worn):
    rig, windows = worn
    now, new = State(), replace(windows[2], start_time_ns=windows[6].start_time_ns)
    for w in windows[:6]:
        now, _ = step(rig, now, w, Options(trace=True))
    with pytest.raises(CountFellError):
        step(rig, now, new, Options(trace=True))


@pytest.mark.slow
def test_other_gears_of_a_lower_count_are_asked_about(worn):
    rig, windows = worn
    other = windows_of(RECORDINGS / "faulty-campaign.mcap")[1][4]
    now = State()
    for w in windows[:7]:
        now, _ = step(rig, now, w, Options(trace=True))
    with pytest.raises(CountFellError):
        step(rig, now, replace(other, start_time_ns=windows[7].start_time_ns), Options(trace=True))


def own_counts(*times: float) -> State:
    """The state of a machine whose recordings at these times [s] begin their own counts; 400 turns each."""
    features = [replace(window(200.0, t), turns=400.0, duration=40.0) for t in times]
    inputs = tuple(WindowInput(index=i, features=f) for i, f in enumerate(features))
    return replace(state(), tracing=replace(state().tracing, history=inputs))


def test_recordings_that_begin_their_own_counts_follow_one_another_by_their_dates():
    begun = replace(window(100.0, 90000.0), turns=200.0)
    event = count_restarted(own_counts(0.0, 50000.0), begun)
    assert event is not None and "dates" in event.reason and event.revolutions == SEEN + 100.0


def test_a_count_that_went_on_between_recordings_is_no_count_of_their_own():
    counted_on = with_history((0.0, 100.0), (50000.0, 4500.0))
    assert count_restarted(counted_on, replace(window(100.0, 90000.0), turns=200.0)) is None
