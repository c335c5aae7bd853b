"""How far the lines of a machine with an estimated structure may be off: what the draws say, and what they ignore."""

import numpy as np
import pytest

from tests.dynamics_cases import RIG
from tests.estimated_machines import machine, rig_of
from twin.model import Calibration, Condition, Model, mesh_of
from twin.rig import Rig
from twin.structure_spread import SAMPLES, _responses, drawn, structure_spread
from twin.wear.curve import MasterCurve

TEN = Condition(speed_hz=10.0, torque=10.0)
NOMINAL = Model.of(rig_of("lab"), Calibration.prior(rig_of("lab")))


def test_a_rig_that_is_known_has_no_spread():
    assert structure_spread(RIG, 10.0) is None


def test_the_linear_factor_is_that_of_the_whole_response():
    """Solved steady states of worn and unworn flanks differ from the nominal ones by the factor of the structure."""
    curve = MasterCurve.build(NOMINAL, TEN, NOMINAL.unworn, 21e-6)
    new, worn = curve.profile(0.0), curve.profile(20e-6)
    ω = 2 * np.pi * 190.0 * np.arange(1, 4)
    stiffness = mesh_of(NOMINAL.rig, SAMPLES).stiffness.mesh_mean

    def change(twin: Model) -> np.ndarray:
        both = [twin.transmission_error_lines(twin.steady(p, TEN))[:3] for p in (new, worn)]
        return both[1] - both[0]

    nominal, response = change(NOMINAL), _responses(NOMINAL.rig, stiffness, ω)[0]
    for seed in range(6):
        twin = machine("lab", seed)
        solved = np.log(np.abs(change(twin) / nominal))
        linear = np.log(np.abs(_responses(twin.rig, stiffness, ω)[0] / response))
        assert solved == pytest.approx(linear, abs=0.08), seed


def test_the_growth_of_the_mean_does_not_depend_on_the_structure():
    curve = MasterCurve.build(NOMINAL, TEN, NOMINAL.unworn, 21e-6)
    new, worn = curve.profile(0.0), curve.profile(20e-6)
    grown = []
    for twin in (NOMINAL, *(machine("lab", seed) for seed in range(4))):
        means = [twin.mean_transmission_error(twin.steady(p, TEN), TEN) for p in (new, worn)]
        grown.append(means[1] - means[0])
    assert grown == pytest.approx([grown[0]] * len(grown), rel=5e-3)


def test_the_draws_have_the_stated_spread_and_leave_known_values_alone():
    rig, random = rig_of("lab"), np.random.default_rng(3)
    drawings = [drawn(rig, random) for _ in range(400)]
    for key, spread in (("bearings.ky_input", 1.0), ("inertias.J5", 0.3), ("mesh.stiffness_scale", 0.15)):
        logs = np.log([d.get(key) / rig.get(key) for d in drawings])
        assert logs.std() == pytest.approx(spread, rel=0.15)
        assert abs(logs.mean()) < 0.2 * spread
    for key in ("gears.module", "wear.K", "end_of_life.max_depth", "shafts.gear_position_fraction"):
        assert {d.get(key) for d in drawings} == {rig.get(key)}


def test_lines_far_below_the_first_resonance_of_the_mesh_are_surer():
    slow, fast = structure_spread(rig_of("lab"), 2.0), structure_spread(rig_of("lab"), 10.0)
    assert slow is not None and fast is not None
    assert np.all(slow.transmission_error.std[:3] < 0.35)
    assert np.all(fast.transmission_error.std[1:3] > 2 * slow.transmission_error.std[1:3])
    assert fast.acceleration.std.min() > 1.0  # the vibration level says next to nothing


def test_known_values_narrow_the_spread():
    rig = rig_of("lab")
    known = [k for k in rig.estimated.assumed if k.split(".")[0] not in ("torsional_stiffness", "inertias", "masses")]
    narrower = Rig.from_mapping({**rig.values, "estimated": {**rig.values["estimated"], "assumed": known}})
    wide, narrow = structure_spread(rig, 10.0), structure_spread(narrower, 10.0)
    assert wide is not None and narrow is not None
    assert narrow.transmission_error.std[:3].mean() < 0.8 * wide.transmission_error.std[:3].mean()
