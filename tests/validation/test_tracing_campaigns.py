"""Effects that nobody declared, found in the reference campaigns.

Source     reference campaigns by an independent simulator (test_campaigns.py); truth in truth/Dxx.json
Tolerance  names right and none besides; parameters within 15 % (20 % of an onset's window spacing apart); depth at the
           last window within 5 % or 2 µm, never worse than without tracing; waveform error on held-out windows
           halved where the effect holds a tenth of the energy or more
All of it  python -m benchmarks.evaluate --set shared
"""

from functools import lru_cache
from pathlib import Path

import pytest

from benchmarks.evaluate import evaluate
from benchmarks.tracing_score import Traced

pytestmark = [pytest.mark.shared, pytest.mark.timeout(600)]


@lru_cache(maxsize=14)
def traced(recording: Path) -> Traced:
    return evaluate(recording)


def campaign(shared, name) -> Traced:
    return traced(shared / "campaigns" / f"{name}.mcap")


def check(score: Traced, percent=15.0):
    assert score.right, f"named {score.named}, verdict {score.verdict}"
    for figure in score.figures:
        assert abs(figure.error_percent) < percent, f"{figure.effect}.{figure.key}: {figure.said:g} for {figure.true:g}"
    assert score.depth_met, f"{score.depth_after} µm for {score.depth_true} µm"
    assert not score.visible or score.halved


@pytest.mark.slow
def test_eccentric_gear_is_named_and_the_depth_left_alone(shared):
    check(campaign(shared, "D04"))


@pytest.mark.slow
def test_non_gear_tones_are_named_by_their_frequencies_and_given_no_effects_name(shared):
    score = campaign(shared, "D08")
    assert score.right and score.named == ("unknown_effect",) and score.lines_found == 3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["D02", "D03", "D07"])
def test_effects_on_the_mesh_are_named_and_no_longer_taken_for_wear(shared, name):
    score = campaign(shared, name)
    check(score)
    assert score.depth_error("after") <= max(score.depth_error("before"), 0.05 * score.depth_true)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["D05", "D06", "D09", "D11"])
def test_teeth_and_sensor_are_told_from_wear(shared, name):
    score = campaign(shared, name)
    assert score.right, f"named {score.named}"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["D00", "D01", "D10", "D12", "D13"])
def test_healthy_machines_have_nothing_added(shared, name):
    """D10 has another structure, D12 no gear encoder, D13 instruments that drift."""
    score = campaign(shared, name)
    assert score.named == () and score.verdict != "unknown_effect"
