"""A stiffness of the pair that the rig file gives, from finite elements say, takes the place of the energy method."""

import copy

import numpy as np
import pytest

from tests.mesh_pairs import UNSW, UNSW_RIG
from twin.errors import ParameterError
from twin.mesh.stiffness import PairStiffness, pair_stiffness
from twin.model import Calibration, Condition, Model
from twin.rig import Rig
from twin.rig_notes import rig_notes

OWN = PairStiffness.of(UNSW)
TEN = Condition(speed_hz=10.0, torque=10.0)


def rig_given(s, k, source="given"):
    values = copy.deepcopy(UNSW_RIG)
    values["mesh"] |= {"pair_s": list(map(float, s)), "pair_stiffness": list(map(float, k)), "stiffness_source": source}
    return Rig.from_mapping(values)


def steady(rig):
    model = Model.of(rig, Calibration.prior(rig))
    state = model.steady(model.unworn, TEN)
    return model, state.require_converged()


def level(rig):
    model, state = steady(rig)
    return model.acceleration_rms(state)


def energy_table(points):
    """Stiffness by the energy method over the path of contact, at its ends too."""
    s = np.linspace(UNSW.path_start, UNSW.path_end, points)
    return s, pair_stiffness(UNSW, s)


def interpolation_error(points):
    """Largest relative difference of the stiffness that the model uses from the energy method's own."""
    rig = rig_given(*energy_table(points))
    k, own = Model.of(rig, Calibration.prior(rig)).mesh.stiffness, OWN
    s = np.linspace(UNSW.path_start, UNSW.path_end, 2001)
    return np.abs(k(s) / own(s) - 1).max()


def test_energy_method_s_own_curve_gives_its_own_results():
    given, own = steady(rig_given(OWN.s, OWN.values)), steady(Rig.from_mapping(UNSW_RIG))
    for lines in ("acceleration_lines", "transmission_error_lines", "torque_lines"):
        a, b = (getattr(model, lines)(state)[:10] for model, state in (given, own))
        assert a == pytest.approx(b, rel=1e-6, abs=1e-6 * np.abs(b).max())
    assert level(rig_given(OWN.s, OWN.values)) == pytest.approx(level(Rig.from_mapping(UNSW_RIG)), rel=1e-7)


def test_error_of_a_coarser_table_falls_with_the_fourth_power_of_its_spacing():
    coarse, fine = interpolation_error(81), interpolation_error(161)
    assert interpolation_error(21) < 1e-4
    assert np.log2(coarse / fine) == pytest.approx(4, abs=0.3)


def test_given_stiffness_changes_the_vibration_and_its_scale_multiplies_it():
    s, k = energy_table(41)
    assert level(rig_given(s, 1.5 * k)) != pytest.approx(level(rig_given(s, k)), rel=0.05)
    scaled = copy.deepcopy(dict(rig_given(s, k).values))
    scaled["mesh"] = dict(scaled["mesh"]) | {"stiffness_scale": 1.5}
    assert level(Rig.from_mapping(scaled)) == pytest.approx(level(rig_given(s, 1.5 * k)), rel=1e-9)


def test_source_of_the_stiffness_is_said():
    s, k = energy_table(41)
    assert Rig.from_mapping(UNSW_RIG).mesh_stiffness_source == "potential-energy method"
    assert rig_given(s, k).mesh_stiffness_source == "given in the rig file"


def test_table_that_is_not_selected_is_compared_with_the_energy_method():
    s, k = energy_table(41)
    assert rig_notes(rig_given(s, k, "energy")) == ()
    (note,) = rig_notes(rig_given(s, 3 * k, "energy"))
    assert note.startswith("mesh.pair_stiffness departs by up to +200 % from the potential-energy method")
    assert note.endswith('not used: set mesh.stiffness_source = "given" to use it')


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s, k: (s[::-1], k), r"mesh\.pair_s\[1\] = .* m must be above mesh\.pair_s\[0\]"),
        (lambda s, k: (s, np.where(np.arange(k.size) == 7, 0.0, k)), r"mesh\.pair_stiffness\[7\] = 0 N/m must be pos"),
        (lambda s, k: (s / 2, k), r"mesh\.pair_s spans .* must reach over the path of contact"),
        (lambda s, k: (s[:3], k[:3]), r"mesh\.pair_s has 3 values: at least 4 are needed"),
        (lambda s, k: (s, k[:-1]), r"mesh\.pair_s has 41 values and mesh\.pair_stiffness 40: one each"),
        (
            lambda s, k: (s, np.where(np.arange(k.size) % 2, 100.0, k)),
            r"given pair stiffness falls to -.* stay positive",
        ),
    ],
)
def test_table_that_cannot_be_is_refused(change, message):
    with pytest.raises(ParameterError, match=message):
        rig_given(*change(*energy_table(41)))


def test_selected_table_that_is_missing_is_refused():
    values = copy.deepcopy(UNSW_RIG)
    values["mesh"]["stiffness_source"] = "given"
    del values["mesh"]["pair_stiffness"]
    with pytest.raises(ParameterError, match=r"mesh\.pair_s and mesh\.pair_stiffness go together"):
        Rig.from_mapping(values)
