"""The effect that the documentation adds as its example is one."""

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.dynamics_cases import model, relative
from tests.effects_cases import solved
from twin.effects import EFFECTS, neutral
from twin.effects.extended import extend
from twin.errors import ParameterError
from twin.tracing.mesh_trials import big_enough, mesh_trials, trial_of

FOLDER = Path(__file__).parents[2] / "twin" / "effects"
README = (FOLDER / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def crowning(monkeypatch):
    """The class that the example defines."""
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    module = ModuleType("crowning")
    monkeypatch.setitem(sys.modules, "crowning", module)
    exec(code, module.__dict__)
    return module.Crowning


def test_effect_of_the_example_softens_the_mesh(crowning):
    found, healthy = solved(crowning(crowning=20e-6)), solved()
    assert found.mean_transmission_error > healthy.mean_transmission_error
    assert relative(found.acceleration_lines, healthy.acceleration_lines) > 0.05
    assert np.abs(found.face_moment).max() < 1e-9  # the same on both sides


def test_effect_of_the_example_vanishes_and_is_bounded(crowning):
    assert np.array_equal(solved(neutral(crowning(crowning=1e-6))).acceleration_lines, solved().acceleration_lines)
    with pytest.raises(ParameterError, match=r"crowning = 0.001 m is outside 0 … 0.0002 m"):
        crowning(crowning=1e-3)


def test_effect_of_the_example_is_traced_and_wears_by_slices_once_it_is_in_the_table(crowning, monkeypatch):
    monkeypatch.setitem(EFFECTS, "crowning", crowning)
    trial = mesh_trials()["crowning"]
    assert [f.name for f in trial.free] == ["crowning"]
    assert big_enough("crowning", np.array([0.3])) and not big_enough("crowning", np.array([-0.29]))
    assert trial.make(np.array([2.0])) == crowning(crowning=20e-6)
    assert extend(model(), (crowning(crowning=10e-6),)).slices == 13


def test_effect_that_does_not_repeat_with_the_mesh_cannot_be_fitted_to_mesh_lines():
    with pytest.raises(ParameterError, match="pitch_error has no number that could be fitted"):
        trial_of("pitch_error")
