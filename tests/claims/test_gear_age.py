"""What may be said of gears that no window has seen new: growth, a least depth, and what can still be done."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from benchmarks.scoring import read_truth, truth_beside
from tests.unit.test_step import SHORT, recorded
from twin.assessment import Life, Unavailable, Wear
from twin.errors import ParameterError
from twin.gear_age import GearAge
from twin.machine_change import MachineChange
from twin.rig import Rig
from twin.step import Options, State, change, inspect, step
from twin.updating.inspections import Inspection

PLAIN = Options(trace=False)
FIRST_WORN = 3  # windows before it are of new gears


@cache
def truth():
    """Depth at each window [m]."""
    return [1e-6 * w["depth"]["combined_um"] for w in read_truth(truth_beside(SHORT))["windows"]]


def rig_with(age=None, **wear):
    rig = recorded()[0]
    gears = {**rig.values["gears"], **({} if age is None else {"age": age})}
    return Rig.from_mapping({**rig.values, "gears": gears, "wear": {**rig.values["wear"], **wear}})


def recount(window, turns):
    """The window by a counter that was at 0 so many turns of the pinion later."""
    ratio = {"pinion": 1.0, "gear": 19 / 52}
    encoders = {
        shaft: replace(edges, first_index=edges.first_index - round(turns * ratio[shaft] * edges.per_rev))
        for shaft, edges in window.encoders.items()
    }
    return replace(window, encoders=encoders)


def assessed(rig, windows, state=None):
    """State and assessment after each window."""
    state = state or State()
    for window in windows:
        state, found = step(rig, state, window, PLAIN)
        yield state, found


@cache
def from_window(first, age=None, later=0.0):
    """Assessments of the campaign from a window on, by a counter that was set to 0 so many turns later."""
    return [f for _, f in assessed(rig_with(age), [recount(w, later) for w in recorded()[1][first:]])]


def band_um(interval):
    return tuple(None if v is None else round(1e6 * v, 3) for v in (interval.p05, interval.median, interval.p95))


@pytest.mark.parametrize("first", [3, 4, 5])
def test_growth_since_a_first_window_of_worn_gears_proves_a_least_depth(first):
    found, depths = from_window(first), truth()
    low, median, high = band_um(found[-1].wear.depth["combined"])
    grown = 1e6 * (depths[-1] - depths[first])
    assert 0.9 * grown < low <= grown and low < median < high
    assert found[-1].wear.growth.since_revolutions == pytest.approx(found[0].window.revolutions)
    assert 1e6 * found[-1].wear.growth.depth.median == pytest.approx(grown, rel=0.05)


@pytest.mark.parametrize("first", [3, 5])
def test_gears_that_have_run_are_to_be_measured_and_no_more_recorded_when_new(first):
    for found in from_window(first):
        remedies = found.wear.preliminary.remedies
        assert remedies[0].startswith("measure the wear depth at a stop") and not any("new" in r for r in remedies)


@pytest.mark.slow
@pytest.mark.parametrize(("first", "later"), [(0, 0.0), (3, 350.0), (5, 1150.0)])
def test_gears_of_unknown_age_have_a_growth_and_no_depth_whatever_their_counter_shows(first, later):
    for found in from_window(first, "unknown", later):
        low, median, high = band_um(found.wear.depth["combined"])
        assert median is None and high is None and found.wear.profile is None
        assert isinstance(found.life, Unavailable) and "the age of the gears is not known" in found.life.reason
        assert found.window.depth.median is None
    depths = truth()
    grown = 1e6 * (depths[-1] - depths[max(first, FIRST_WORN - 1)])
    assert 0.85 * grown < low <= grown


def test_nothing_of_the_wear_of_unknown_age_is_learned_as_of_new_gears():
    *_, (state, _) = assessed(rig_with("unknown"), recorded()[1][:3])
    assert state.memory.fit is None and not state.memory.unworn and state.memory.track.windows


def test_a_measured_depth_gives_gears_of_unknown_age_depth_and_life_again():
    rig, depths = rig_with("unknown"), truth()
    windows = [recount(w, 350.0) for w in recorded()[1][FIRST_WORN:]]
    *_, (state, found) = assessed(rig, windows[:4])
    assert found.wear.depth["combined"].median is None
    measured = Inspection(revolutions=found.window.revolutions, depth=depths[6], flank="combined", std=2e-6)
    state, at_once = inspect(rig, state, measured)
    assert at_once.wear.depth["combined"].median == pytest.approx(depths[6], rel=0.05)
    ((_, found),) = assessed(rig, windows[4:], state)
    assert isinstance(found.wear, Wear) and isinstance(found.life, Life)
    assert found.wear.depth["combined"].median == pytest.approx(depths[7], rel=0.05)
    assert found.window.depth.median == found.wear.depth["combined"].median


def test_the_revolutions_that_gears_had_made_are_added_to_the_count():
    windows = [recount(w, 350.0) for w in recorded()[1][FIRST_WORN:5]]
    known = [f.window for _, f in assessed(rig_with(350.0), windows)]
    counted = [f.window for f in from_window(FIRST_WORN)]
    assert [w.revolutions for w in known] == pytest.approx([w.revolutions for w in counted[:2]])
    assert band_um(known[1].depth) == band_um(counted[1].depth)


@pytest.mark.slow
def test_gears_that_replace_those_of_unknown_age_are_new():
    rig = rig_with("unknown")
    *_, (state, _) = assessed(rig, [recorded()[1][FIRST_WORN]])
    state, _ = change(rig, state, MachineChange(kind="gears_replaced"))
    *_, (state, found) = assessed(rig, recorded()[1][:FIRST_WORN], state)
    assert state.memory.unworn and found.wear.depth["combined"].median is not None


@pytest.mark.parametrize(("first", "later"), [(6, 1640.0), (7, 2220.0), (7, 2240.0)])
def test_worn_gears_whose_counter_says_new_are_doubted_because_no_wear_is_so_fast(first, later):
    """As where a counter began when it was mounted: tens of micrometres after 160 turns of the pinion."""
    window = recount(recorded()[1][first], later)
    ((_, found),) = assessed(rig_with(), [window])
    assert "were not new when the count began" in " ".join(found.wear.preliminary.reasons)
    assert band_um(found.wear.depth["combined"])[0] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("less", [12.0, 50.0])
def test_a_first_worn_window_far_deeper_than_wear_makes_it_proves_nothing(less):
    """As where another effect looks like wear: the depth is many times what the wear coefficient makes."""
    rig = rig_with(K=recorded()[0].values["wear"]["K"] / less)
    found = [f for _, f in assessed(rig, recorded()[1][: FIRST_WORN + 2])]
    first, second = (f.wear for f in found[FIRST_WORN:])
    assert "times the wear that the rig file's coefficient makes" in " ".join(first.preliminary.reasons)
    assert band_um(first.depth["combined"])[0] == 0.0
    grown = 1e6 * (truth()[FIRST_WORN + 1] - truth()[FIRST_WORN])
    assert 0.4 * grown < band_um(second.depth["combined"])[0] <= grown


@pytest.mark.parametrize("first", [2, 3, 7])
def test_one_level_of_one_recording_gives_no_depth(first):
    window = recorded()[1][first]
    turns = window.encoders["pinion"]
    once = replace(turns, per_rev=1, first_index=turns.first_index // 1024, times=turns.times[::1024])
    ((_, found),) = assessed(rig_with(), [replace(window, encoders={"pinion": once})])
    assert isinstance(found.wear, Unavailable) and isinstance(found.life, Unavailable)
    assert "level" in found.wear.reason and found.window.depth is None


@pytest.mark.parametrize(("stated", "age"), [("new", GearAge()), ("unknown", GearAge(known=False)), (5e3, None)])
def test_a_rig_file_states_the_age_of_its_gears(stated, age):
    assert rig_with(stated).gear_age == (age or GearAge(revolutions=5e3))
    assert rig_with(stated).digest == rig_with().digest  # files of the machine hold whatever its gears' age


@pytest.mark.parametrize("wrong", ["old", -1.0, True])
def test_an_age_that_is_none_is_refused(wrong):
    with pytest.raises(ParameterError, match=r"gears\.age"):
        rig_with(wrong)
