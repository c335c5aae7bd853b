"""Steady states moved to first order against the same states solved anew."""

import numpy as np
import pytest

from tests.dynamics_cases import PRIOR, RIG, TEN, model, worn
from tests.effects_cases import INSTANCES
from twin.effects import EFFECTS
from twin.effects.response import Nearby, solve_with
from twin.errors import ParameterError
from twin.model import Model
from twin.wear.curve import MasterCurve

DEPTH = 30e-6
ORDERS = 190.0


def lines(response):
    """What all channels see, scaled to alike sizes."""
    orders = response.orders[response.orders <= ORDERS]
    return np.concatenate((1e6 * response.transmission_error(orders), response.acceleration(orders)))


def calibrated(**values) -> Model:
    return Model.of(RIG, PRIOR, samples=1024).calibrated(**values)


PARAMETERS = {
    "mesh stiffness": lambda ε: (calibrated(stiffness_scale=PRIOR.stiffness_scale * (1 + ε)), ()),
    "contact damping": lambda ε: (calibrated(damping_time=PRIOR.damping_time * (1 + ε)), ()),
    "modal damping": lambda ε: (calibrated(modal_damping=PRIOR.modal_damping * (1 + ε)), ()),
    "friction from none": lambda ε: (model(), (EFFECTS["tooth_friction"](coefficient=0.1 * ε),)),
    "friction": lambda ε: (model(), (EFFECTS["tooth_friction"](coefficient=0.08 + 0.1 * ε),)),
    "misalignment": lambda ε: (model(), (EFFECTS["misalignment"](lead_gap=20e-6 + 30e-6 * ε),)),
    "tip relief": lambda ε: (model(), (EFFECTS["profile_error"](pinion_relief=8e-6 + 10e-6 * ε),)),
    "stiffness loss": lambda ε: (model(), (EFFECTS["mesh_stiffness_loss"](loss=0.15 * ε),)),
    "unbalance": lambda ε: (model(), (EFFECTS["mass_unbalance"](pinion=1e-3 * (1 + ε)),)),
}


@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize("depth", [0.0, DEPTH])
def test_first_order_is_the_limit_of_states_solved_anew(name, depth):
    profile = worn(TEN, depth)

    def solved(ε):
        twin, effects = PARAMETERS[name](ε)
        return solve_with(twin, effects, profile, TEN, samples=256)

    base = solved(0.0)
    nearby = Nearby(base)
    errors = []
    for ε in (1e-2, 1e-3):
        twin, effects = PARAMETERS[name](ε)
        change = lines(nearby.response(twin, effects, profile)) - lines(base)
        true = lines(solved(ε)) - lines(base)
        assert np.linalg.norm(true) > 0
        errors.append(np.linalg.norm(change - true) / np.linalg.norm(true))
    assert errors[1] < 0.1  # slices of unworn misaligned faces open and close already at 30 nm
    assert errors[1] < 0.2 * errors[0] or errors[1] < 1e-6  # falls with the step: what is left is of second order


def test_deeper_wear_is_a_parameter_like_any_other():
    curve = MasterCurve.build(model(), TEN, model().unworn, 2 * DEPTH)
    shallow, deep = curve.profile(DEPTH), curve.profile(DEPTH + 0.1e-6)
    base = solve_with(model(), (), shallow, TEN, samples=256)
    near = Nearby(base).response(model(), (), deep)
    true = solve_with(model(), (), deep, TEN, samples=256)
    change, moved = lines(true) - lines(base), lines(near) - lines(base)
    assert np.linalg.norm(moved - change) < 0.02 * np.linalg.norm(change)


OF_MESH = [name for name, instances in INSTANCES.items() if instances[0].period == "mesh"]


@pytest.mark.parametrize("name", OF_MESH)
def test_recalibrated_state_is_that_with_the_effect_applied_anew(name):
    """Whatever an effect does to a setup, it leaves the structure and multiplies what is calibrated."""
    effect, profile = INSTANCES[name][0], worn(TEN, DEPTH)
    nearby = Nearby(solve_with(model(), (effect,), profile, TEN, samples=256))
    ε = 1e-3
    other = calibrated(
        stiffness_scale=PRIOR.stiffness_scale * (1 + ε),
        damping_time=PRIOR.damping_time * (1 - ε),
        modal_damping=PRIOR.modal_damping * (1 + 2 * ε),
    )
    np.testing.assert_allclose(
        lines(nearby.recalibrated(other)), lines(nearby.response(other, (effect,), profile)), rtol=1e-9, atol=1e-12
    )


def test_nothing_changed_moves_nothing():
    base = solve_with(model(), (), worn(TEN, DEPTH), TEN, samples=256)
    same = Nearby(base).response(model(), (), worn(TEN, DEPTH))
    np.testing.assert_allclose(lines(same), lines(base), rtol=1e-12, atol=1e-12)


def test_another_period_is_refused():
    base = solve_with(model(), (), worn(TEN, DEPTH), TEN, samples=256)
    with pytest.raises(ParameterError, match="samples a period"):
        Nearby(base).response(model(), (EFFECTS["tooth_crack"](stiffness_loss=0.1, tooth=0),), worn(TEN, DEPTH))
