"""Every registered wear law."""

from __future__ import annotations

import numpy as np
import pytest

from tests.dynamics_cases import RIG
from tests.updating_cases import TEN, model
from twin.errors import ParameterError
from twin.model import Calibration, Model
from twin.rig import Rig
from twin.wear.curve import MasterCurve
from twin.wear.laws import LAWS, law_of
from twin.wear.laws.law import WearLaw

PARAMETERS: dict[str, dict[str, float]] = {"archard": {}}  # one instance a law
EVERY = [LAWS[name].of(values) for name, values in PARAMETERS.items()]
WORK = np.array([0.0, 0.3, 2.0, 7.0])  # [N·m]


def rig_with(name: str, values: dict[str, float]) -> Rig:
    wear = {**RIG.values["wear"], "law": name, **({name: values} if values else {})}
    return Rig.from_mapping({**RIG.values, "wear": wear})


def curve_with(name: str, values: dict[str, float], until: float = 6e-6) -> MasterCurve:
    rig = rig_with(name, values)
    twin = Model.of(rig, Calibration.prior(rig))
    return MasterCurve.build(twin, TEN, twin.unworn, until)


def test_every_law_of_the_table_is_tested():
    assert PARAMETERS.keys() == LAWS.keys()


@pytest.mark.parametrize("law", EVERY, ids=lambda law: law.name)
def test_a_rig_file_names_the_law_and_gives_its_parameters(law: WearLaw):
    assert law_of(rig_with(law.name, PARAMETERS[law.name])) == law


@pytest.mark.parametrize("law", EVERY, ids=lambda law: law.name)
def test_no_law_wears_without_sliding_work_or_puts_material_on(law: WearLaw):
    for worn in (0.0, 1e-7, 3e-6, 1e-3):
        rate = law.rate(WORK, np.full(WORK.size, worn))
        assert rate[0] == 0.0 and np.all(np.diff(rate) > 0)


@pytest.mark.parametrize("law", EVERY, ids=lambda law: law.name)
def test_every_law_wears_each_slice_of_the_face_as_if_it_were_alone(law: WearLaw):
    worn = np.array([[0.0, 1e-6, 2e-6, 3e-6], [4e-6, 0.0, 1e-5, 1e-7]])
    both = law.rate(np.array([WORK, 2 * WORK]), worn)
    assert np.array_equal(both, [law.rate(WORK, worn[0]), law.rate(2 * WORK, worn[1])])


def test_a_rig_file_without_a_law_wears_by_archards():
    assert law_of(RIG).name == "archard"
    plain = MasterCurve.build(model(), TEN, model().unworn, 2e-6)
    assert np.array_equal(curve_with("archard", {}, 2e-6).work, plain.work)


def test_a_law_that_is_not_known_is_refused_with_those_that_are():
    with pytest.raises(ParameterError, match=r"wear\.law = 'magic' must be one of archard"):
        rig_with("magic", {})
