"""Depth from encoder lines that the model itself made at a known depth: the estimator's algebra, not its truth."""

from dataclasses import replace

import numpy as np
import pytest

from tests.updating_cases import TEN, curve, model, seen
from twin.model import Condition
from twin.updating.depth import DEPTH, HARMONICS, Gauge, estimate_depth
from twin.updating.encoders import gauge_of
from twin.updating.memory import MeanOffset, Memory, Segment
from twin.updating.prediction import Expectation
from twin.wear.curve import MasterCurve

CURVE = curve()
DEEPEST = 60e-6
BLANK = Memory()
TRUE = 31.3e-6  # between the curve's own points
SEGMENT = Segment(speed_hz=10.0, torque=10.0, start_depth=0.0, start_work=0.0)
OFF = np.array([0.3 + 0.1j, -0.2 + 0.2j, 0.1 - 0.1j]) * 1e-6  # graduation, pitch, friction: there from the start [m]


def window(depth, **options):
    return seen(CURVE.profile(depth), revolutions=5000.0, **options)


def estimated(features, memory=BLANK, near=TRUE, deepest=DEEPEST, **changes):
    gauge = replace(gauge_of(features, memory, model(), TEN), **changes)
    expectation = Expectation.at(model(), CURVE, TEN, near)
    pinion_only = features.transmission_error is None
    return estimate_depth(gauge, expectation.response(pinion_only, gauge.from_unworn), 0.0, deepest)


@pytest.mark.parametrize("depth", [2e-6, 10e-6, TRUE, 55e-6])
def test_depth_is_recovered_from_noiseless_lines(depth):
    found = estimated(window(depth), near=depth)
    assert found.depth == pytest.approx(depth, rel=2e-3)
    assert found.misfit < 0.05


def test_depth_is_recovered_from_a_linearisation_about_another_depth():
    assert estimated(window(TRUE), near=20e-6).depth == pytest.approx(TRUE, rel=0.02)


def test_depth_is_recovered_within_its_noise():
    noise = 0.3e-6
    found = [estimated(window(TRUE, noise=noise, seed=seed)) for seed in range(12)]
    errors = np.array([f.depth - TRUE for f in found])
    stds = np.array([f.std for f in found])
    assert np.all(np.abs(errors) < 3 * stds)
    assert errors.std() < 2 * np.mean([f.noise_std for f in found])
    assert abs(errors.mean()) < errors.std()


@pytest.mark.parametrize("phase", [-np.pi, -3.0, -1.0, 0.4, 2.5, np.pi])
def test_mesh_phase_of_the_disc_does_not_matter_and_is_found(phase):
    found = estimated(window(TRUE, phase=phase))
    assert found.depth == pytest.approx(TRUE, rel=2e-3)
    assert np.exp(1j * found.phase) == pytest.approx(np.exp(1j * phase), abs=0.01)


def test_phase_known_on_the_other_side_of_the_cut_is_the_same_phase():
    found = estimated(window(TRUE, phase=-3.1), phase=3.1, phase_std=0.1)
    assert found.depth == pytest.approx(TRUE, rel=5e-3)
    assert found.misfit < 1.0


def test_constant_disturbance_drops_out_against_an_unworn_window():
    unworn = seen(model().unworn, disturbance=np.resize(np.append(OFF, np.zeros(9)), 12))
    worn = window(TRUE, disturbance=np.append(OFF, np.zeros(9)))
    with_reference = estimated(worn, Memory(unworn=(unworn,), segments=(SEGMENT,)))
    without = estimated(worn, Memory(segments=(SEGMENT,)))
    assert with_reference.depth == pytest.approx(TRUE, rel=2e-3)
    assert abs(without.depth / TRUE - 1) > 5 * abs(with_reference.depth / TRUE - 1)


def test_unworn_window_of_another_torque_is_no_reference():
    other = replace(seen(model().unworn), torque_nm=20.0)
    assert not gauge_of(window(TRUE), Memory(unworn=(other,), segments=(SEGMENT,)), model(), TEN).from_unworn


def test_drift_of_the_mean_does_not_pull_the_depth_beyond_its_std():
    """4 µm between the discs' zeros would be 6 µm of depth if the mean were believed."""
    memory = Memory(offset=MeanOffset(value=0.0, var=(0.3e-6) ** 2, torque=10.0))
    found = estimated(window(TRUE, offset=4e-6), memory)
    assert abs(found.depth - TRUE) < 1.6449 * found.std
    assert abs(found.depth - TRUE) < 1e-6
    assert found.from_lines == pytest.approx(TRUE, rel=2e-3)


def test_mean_and_lines_together_are_no_less_certain_than_the_lines_alone():
    lines = estimated(window(TRUE))
    both = estimated(window(TRUE), Memory(offset=MeanOffset(value=0.0, var=0.0, torque=10.0)))
    assert both.std <= lines.std
    assert both.depth == pytest.approx(TRUE, rel=2e-3)


def test_misfit_widens_the_standard_deviation():
    good = estimated(window(TRUE))
    bent = estimated(window(TRUE, disturbance=np.append([0, 3e-6j, -4e-6], np.zeros(9))))
    assert bent.misfit > 1
    assert bent.std > good.std * 0.9 * np.sqrt(bent.misfit)


def test_flanks_worn_by_static_forces_are_measured_within_the_standard_deviation():
    """A curve worn at a crawl has no waves of dynamic forces on its flanks."""
    static = MasterCurve.build(model(), Condition(speed_hz=0.05, torque=10.0), model().unworn, 55e-6)
    found = estimated(seen(static.profile(50e-6), revolutions=5000.0), near=50e-6)
    assert abs(found.depth - 50e-6) < found.std
    assert found.std > DEPTH.shape_scatter * found.depth**2


def test_depth_at_the_end_of_the_search_says_so():
    assert estimated(window(TRUE), deepest=20e-6).at_limit
    assert not estimated(window(TRUE)).at_limit


def test_pinion_encoder_alone_recovers_the_depth_of_the_model():
    features = window(TRUE, gear_encoder=False)
    assert estimated(features).depth == pytest.approx(TRUE, rel=0.01)


def test_pinion_encoder_alone_is_less_certain():
    both = estimated(window(TRUE))
    alone = estimated(window(TRUE, gear_encoder=False))
    assert alone.std > 2 * both.std


def test_window_without_encoders_has_no_gauge():
    features = replace(window(TRUE), transmission_error=None, pinion_motion=None)
    assert gauge_of(features, Memory(), model(), TEN) is None


def test_standard_deviation_of_lines_that_say_nothing_is_infinite_not_a_crash():
    still = Gauge(
        lines=np.zeros(HARMONICS, dtype=complex), from_unworn=True, lines_std=np.full(HARMONICS, 1e-9),
        mean=None, mean_std=float("nan"), phase=None, phase_std=3.0,
    )  # fmt: skip
    found = estimate_depth(
        still, lambda d: (np.zeros((d.size, HARMONICS), dtype=complex), np.zeros(d.size)), 0.0, DEEPEST
    )
    assert found.std == float("inf")
