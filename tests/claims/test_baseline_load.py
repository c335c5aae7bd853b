"""The direction with load is part of an effect's signature, and the end of the learned range is no cliff."""

from dataclasses import replace

import numpy as np
import pytest

from tests.claims.test_baseline import RIG, SHAFTS, machine, parts
from tests.effects_cases import TEN, solved
from twin.baseline.diagnosis import diagnose
from twin.baseline.findings import compare
from twin.baseline.leaving_out import learn
from twin.baseline.load_direction import fall_with_load
from twin.baseline.operating import distance_beyond
from twin.effects import EFFECTS

LOADS = np.linspace(0.1, 0.9, 7)


def shaft_lines(torque):
    """Transmission error that a crack adds, off the mesh orders."""
    condition = replace(TEN, torque=torque)
    crack = EFFECTS["tooth_crack"](stiffness_loss=0.2, tooth=3)
    found = solved(crack, condition=condition)
    off_mesh = np.abs(found.orders % 19) > 1e-6
    return np.linalg.norm(found.transmission_error_lines[off_mesh])


def test_what_a_cracked_tooth_adds_rises_with_load():
    """The deflection is load over stiffness, so that twice the load gives nearly twice of it."""
    assert EFFECTS["tooth_crack"].signature.load == "rises"
    assert shaft_lines(20.0) / shaft_lines(10.0) == pytest.approx(2.0, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize(("sign", "falls"), [(-1, True), (1, False)])
def test_direction_with_load_is_that_of_the_healthy_machine(sign, falls):
    """Beside a pulse of e^(±1.5·load) in the healthy machine, one that is twice as high."""
    readings = [
        parts(machine(load, i, pulse=1.5 * np.exp(1.5 * sign * (load - 0.5))), name=f"h{i}").whole
        for i, load in enumerate(LOADS)
    ]
    baseline = learn(RIG, readings, SHAFTS)
    here = compare(baseline, parts(machine(0.45, 99, pulse=3.0)).whole)
    strongest = next(c for c in here.changes if float(c.shaft) < 1 and c.channel == "a")
    assert strongest in here.believed
    ratio = fall_with_load(baseline, [here], [[strongest]], strongest)
    if falls:
        assert np.exp(-1.5 * np.ptp(LOADS)) < ratio < 0.7  # the shaft's own lines, which rise, are among them
    else:
        assert ratio is None


@pytest.mark.slow
def test_threshold_grows_evenly_from_the_end_of_the_learned_range():
    points = np.array([[0.0], [0.5], [1.0]])
    assert distance_beyond(points, np.array([0.7])) == distance_beyond(points, np.array([1.04])) == 0.0
    assert distance_beyond(points, np.array([1.1])) == pytest.approx(0.1)
    baseline = learn(RIG, [parts(machine(load, i), name=f"h{i}").whole for i, load in enumerate(LOADS)], SHAFTS)
    inside, just, far = (compare(baseline, parts(machine(load, 50)).whole) for load in (0.5, 0.98, 1.4))
    assert inside.extrapolated == 1.0
    assert 1.0 < just.extrapolated < far.extrapolated == far.limits.extrapolated
    assert diagnose(baseline, [parts(machine(0.98, 50))]).verdict == "explained"
    assert diagnose(baseline, [parts(machine(1.4, 50))]).verdict == "insufficient_data"
