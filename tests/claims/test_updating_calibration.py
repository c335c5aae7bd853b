"""Calibration on unworn windows that the model made with other values: what is learned, and how surely."""

from dataclasses import asdict

import numpy as np
import pytest

from tests.updating_cases import TEN, Condition, machine, model, seen
from twin.model import Model
from twin.updating.calibration import NAMES, PRIOR_SPREAD, Fit, calibrate, compliance_scale, fit_half_width

SLOW = [Condition(speed_hz=2.0, torque=10.0), Condition(speed_hz=2.0, torque=20.0)]


def unworn_windows(twin: Model, conditions=(*SLOW, TEN)):
    return [seen(twin.unworn, c, twin=twin, seed=i, noise=5e-9) for i, c in enumerate(conditions)]


@pytest.mark.parametrize(
    "changes", [{"stiffness_scale": 0.85}, {"modal_damping": 1.25}, {"stiffness_scale": 1.1, "modal_damping": 0.8}]
)
def test_calibration_recovers_the_values_that_made_the_windows(changes):
    twin = machine(**changes)
    fit = calibrate(model(), unworn_windows(twin))
    before, after, true = (asdict(c) for c in (model().calibration, fit.calibration, twin.calibration))
    assert fit.windows == 3
    for name in NAMES:
        assert abs(np.log(after[name] / true[name])) < 2 * fit.std[name], name
    for name in changes:
        assert abs(np.log(after[name] / true[name])) < 0.75 * abs(np.log(before[name] / true[name])) + 1e-9, name


def test_damping_of_the_mesh_is_not_told_by_unworn_windows_and_says_so():
    fit = calibrate(model(), unworn_windows(machine(damping_time=0.7)))
    assert fit.calibration.damping_time == pytest.approx(model().calibration.damping_time, rel=0.05)
    assert fit.std["damping_time"] > 0.9 * PRIOR_SPREAD[2]


def test_windows_leave_every_value_no_less_certain_than_the_prior():
    fit = calibrate(model(), unworn_windows(machine()))
    for name, spread in zip(NAMES, PRIOR_SPREAD, strict=True):
        assert 0 < fit.std[name] <= 1.001 * spread, name
    assert fit.std["stiffness_scale"] < 0.5 * PRIOR_SPREAD[0]


def test_windows_of_the_prior_itself_leave_the_prior():
    fit = calibrate(model(), unworn_windows(machine()))
    assert fit.misfit < 0.1
    for name, value in asdict(fit.calibration).items():
        assert value == pytest.approx(asdict(model().calibration)[name], rel=0.03), name


def test_calibration_without_windows_is_the_prior_with_its_spread():
    fit = calibrate(model(), [])
    assert asdict(fit.calibration) == pytest.approx(asdict(model().calibration), rel=1e-6)
    assert [fit.std[name] for name in NAMES] == pytest.approx(PRIOR_SPREAD, rel=1e-3)


def test_compliance_outside_the_mesh_is_measured_from_two_loads():
    windows = unworn_windows(machine(), SLOW)
    assert compliance_scale(model(), windows) == pytest.approx(1.0, abs=0.01)


def test_compliance_is_left_alone_where_the_loads_do_not_differ():
    assert compliance_scale(model(), unworn_windows(machine(), [SLOW[0], TEN])) == 1.0
    assert compliance_scale(model(), unworn_windows(machine(), SLOW[:1])) == 1.0


def test_half_width_goes_to_the_least_misfit_and_no_further_than_was_tried():
    prior = Fit(calibration=model().calibration, std={}, windows=1, misfit=1.0)
    a = prior.calibration.contact_half_width

    def sharp(best):
        return lambda width: 1e4 * np.log(width / best) ** 2

    assert fit_half_width(prior, sharp(1.2 * a)).calibration.contact_half_width == pytest.approx(1.2 * a, rel=0.01)
    assert fit_half_width(prior, sharp(3 * a)).calibration.contact_half_width == pytest.approx(1.33 * a)
    unmoved = fit_half_width(prior, lambda width: 0.0)
    assert unmoved.calibration.contact_half_width == pytest.approx(a, rel=0.02)
    assert unmoved.std["contact_half_width"] == pytest.approx(0.2, rel=0.1)
    assert fit_half_width(prior, sharp(a)).std["contact_half_width"] == pytest.approx(0.01, rel=0.1)
