"""Inspections of a machine with a model: depth, rate and life follow, and so do later windows."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.scoring import run, windows_of
from service.contract.estimate import inspect as inspect_in_contract
from twin.assessment import Life, Wear
from twin.errors import ParameterError
from twin.machine_change import MachineChange
from twin.machine_changes import changed
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.step import inspect, step
from twin.updating.inspections import MOST_INSPECTIONS, Inspection, with_inspection
from twin.updating.model_cache import curve_of
from twin.updating.update import reference_rate
from twin.what_if import DutyPoint, Phase, what_if

RECORDING = Path(__file__).parents[2] / "recordings" / "short-campaign.mcap"


def measured(revolutions, depth, std=1e-6, flank="combined"):
    return Inspection(revolutions=float(revolutions), depth=depth, std=std, flank=flank)


@pytest.fixture(scope="module")
def machine():
    """Rig, the last window and the state before it, of the short campaign without attribution."""
    rig, windows = windows_of(RECORDING)
    state, _ = run(rig, windows[:-1], Options(trace=False))
    return rig, windows[-1], state


def test_depth_rate_and_life_follow_an_inspection(machine):
    rig, _, state = machine
    before = state.latest.wear
    depth, count = before.depth["combined"], state.memory.track.revolutions
    after, found = inspect(rig, state, measured(count, 0.97 * depth.median, 0.2e-6))
    wear, life = found.wear, found.life
    assert isinstance(wear, Wear) and isinstance(life, Life)
    assert 0.965 * depth.median < wear.depth["combined"].median < 0.985 * depth.median
    assert wear.depth["combined"].p95 - wear.depth["combined"].p05 < 0.6 * (depth.p95 - depth.p05)
    assert 0.95 < wear.wear_coefficient / before.wear_coefficient < 0.99
    assert life.revolutions.median > state.latest.life.revolutions.median
    assert wear.depth["pinion"].median == pytest.approx(52 / 71 * wear.depth["combined"].median)
    assert max(wear.profile.pinion.depth) < max(before.profile.pinion.depth)
    assert wear.inspected.depth_by_windows == depth and not wear.inspected.compared[0].contradicts
    assert State.from_dict(after.to_dict()) == after
    assert after.memory == state.memory  # the windows' own memory is untouched


def test_inspection_of_one_flank_is_that_of_both_over_its_share(machine):
    rig, _, state = machine
    count, depth = state.memory.track.revolutions, 0.97 * state.latest.wear.depth["combined"].median
    share = 52 / 71
    whole = inspect(rig, state, measured(count, depth, 0.5e-6))[1].wear.depth["combined"]
    for flank, part in (("pinion", share), ("gear", 1 - share)):
        own = inspect(rig, state, measured(count, part * depth, part * 0.5e-6, flank))[1].wear.depth["combined"]
        assert own.median == pytest.approx(whole.median, rel=1e-6)


def test_windows_after_an_inspection_go_on_with_it(machine):
    rig, window, state = machine
    count, depth = state.memory.track.revolutions, state.latest.wear.depth["combined"].median
    inspected, _ = inspect(rig, state, measured(count, 0.97 * depth, 0.2e-6))
    _, plain = step(rig, state, window, Options(trace=False))
    _, found = step(rig, inspected, window, Options(trace=False))
    assert 0.96 < found.wear.depth["combined"].median / plain.wear.depth["combined"].median < 0.99
    assert found.window.depth == found.wear.depth["combined"]
    assert found.window.wear_coefficient == found.wear.wear_coefficient
    assert found.window.rms_predicted == plain.window.rms_predicted


def test_late_entry_of_an_early_inspection_counts_as_of_its_time(machine):
    rig, window, state = machine
    early = measured(800, 0.9 * state.memory.points[1].depth, 0.5e-6)
    first, _ = inspect(rig, state, early)
    entered_before, _ = step(rig, first, window, Options(trace=False))
    later, _ = step(rig, state, window, Options(trace=False))
    entered_after, _ = inspect(rig, later, early)
    assert entered_after.latest.wear.depth == entered_before.latest.wear.depth
    assert entered_after.latest.life == entered_before.latest.life


def test_contradiction_is_said_with_both_figures_and_kept(machine):
    rig, _, state = machine
    depth, count = state.latest.wear.depth["combined"].median, state.memory.track.revolutions
    given = {"revolutions": count, "max_depth_um": 1.5e6 * depth, "flank": "combined", "std_um": 1.0}
    _, estimate = inspect_in_contract(rig, state, given)
    wear = estimate.report["wear"]
    (sentence,) = wear["inspections"]["contradictions"]
    assert f"{1.5e6 * depth:.1f} ± 1.0 µm on both flanks together" in sentence and "standard deviations" in sentence
    band = wear["max_depth_um"]["combined"]
    assert band["p05"] < 1e6 * depth < 1.5e6 * depth < 1.01 * band["p95"]
    assert estimate.report["status"]["level"] != "normal"
    assert sentence in estimate.report["status"]["reasons"]


def test_inspection_before_any_window_is_kept_for_the_first_depth(machine):
    rig, window, _ = machine
    state, found = inspect(rig, State(), measured(800, 20e-6))
    assert not isinstance(found.wear, Wear) and len(state.inspections) == 1
    _, found = step(rig, state, window, Options(trace=False))
    assert found.wear.inspected is not None


def test_only_so_many_inspections_are_used():
    kept = ()
    for n in range(2 * MOST_INSPECTIONS):
        kept = with_inspection(kept, measured(n, 1e-6))
    assert len(kept) == MOST_INSPECTIONS and kept[-1].revolutions == 2 * MOST_INSPECTIONS - 1


def test_inspection_of_new_gears_is_weighed_with_the_rate_of_the_pair_before(machine):
    """The rig file states a fifth of the coefficient that was learned; no worn window of the new gears has come."""
    rig, _, state = machine
    wear = {**rig.values["wear"], "K": 0.2 * rig.get("wear.K")}
    rig = Rig.from_mapping({**rig.values, "wear": wear})
    state = changed(rig, state, MachineChange(kind="gears_replaced"))
    learned = state.memory.track.rate
    assert learned > 3 * reference_rate(rig) * rig.get("wear.K")
    state, found = step(rig, state, windows_of(RECORDING)[1][2], Options(trace=False))
    assert isinstance(found.wear, Wear) and not state.memory.track.windows
    assert State.from_dict(json.loads(json.dumps(state.to_dict()))) == state
    depth = curve_of(rig, state.memory).depth_at(1000.0 * learned)
    state, found = inspect(rig, state, measured(1000, depth))
    assert not found.wear.inspected.compared[0].contradicts
    assert found.wear.wear_coefficient * reference_rate(rig) == pytest.approx(learned, rel=0.02)


@pytest.mark.parametrize("inspections, preliminary", [(1, True), (2, True), (3, False)])
def test_life_by_inspections_alone_is_preliminary_until_the_third(machine, inspections, preliminary):
    """No worn window has come: one measured depth gives a rate, the third tests it."""
    rig, _, learned = machine
    state, _ = step(rig, State(), windows_of(RECORDING)[1][2], Options(trace=False))
    curve = curve_of(rig, state.memory)
    for count in (1500, 1000, 500)[:inspections]:
        state, found = inspect(rig, state, measured(count, curve.depth_at(count * learned.memory.track.rate)))
    assert isinstance(found.life, Life) and (found.life.preliminary is not None) == preliminary
    present = Phase(points=(DutyPoint(speed=found.life.speed, torque=found.life.torque),))
    assert what_if(rig, state, [present]).preliminary == found.life.preliminary
    if preliminary:
        (reason,) = found.life.preliminary.reasons
        assert f"0 worn windows and {inspections} inspection" in reason


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"flank": "tooth"}, "must be one of combined, pinion, gear"),
        ({"depth": 30.0}, "micrometres?"),
        ({"std": 0.0}, "outside \\(0, 0.1\\)"),
        ({"revolutions": -1.0}, "must not be negative"),
    ],
)
def test_inspection_that_cannot_be_is_refused(change, why):
    with pytest.raises(ParameterError, match=why):
        Inspection(**{"revolutions": 1.0, "depth": 1e-6, "flank": "combined", "std": 1e-6, **change})
