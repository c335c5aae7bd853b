"""What every effect declares about itself is what the model makes of it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.effects_cases import GEAR_INSTANCES, INSTANCES, solved, with_instance
from twin.effects import EFFECTS, neutral
from twin.effects.facts import ALARM_CLASSES, CLAIMS, DetectionThresholds, Facts, FittedNumber
from twin.effects.parameter import Parameter
from twin.thresholds import rows_of
from twin.tracing.held_out_content import CONTENT, ORDER
from twin.tracing.mesh_trials import fitted_numbers, mesh_trials, trial_of

NAMES = [name for name in EFFECTS if name != "none"]
OF_MESH = [name for name in NAMES if EFFECTS[name].facts.detector == "mesh"]


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_declares_its_facts(name):
    facts = EFFECTS[name].facts
    assert isinstance(facts, Facts) and facts.label
    assert bool(facts.detector) == (name != "none")
    assert facts.action.endswith(".") and facts.action[0].isupper()
    assert set(facts.stated) <= {p.name for p in EFFECTS[name].parameters if p.shape}
    for row in rows_of(facts.detection):
        assert row.about.meaning and row.about.source


def test_labels_are_unique():
    labels = [kind.facts.label for kind in EFFECTS.values()]
    assert len(set(labels)) == len(labels)


def test_unknown_declarations_are_refused():
    facts = EFFECTS["tooth_crack"].facts
    for wrong in ({"acts_on": "housing"}, {"detector": "oracle"}, {"alarm_class": "panic"}):
        with pytest.raises(ValueError, match="must be one of"):
            replace(facts, **wrong)
    assert {kind.facts.alarm_class for kind in EFFECTS.values()} == set(ALARM_CLASSES)


@pytest.mark.parametrize("name", [*NAMES, *GEAR_INSTANCES])
def test_instance_repeats_over_a_declared_period(name):
    effect = {**INSTANCES, **GEAR_INSTANCES}[name][0]
    assert effect.period in effect.facts.periods
    assert neutral(effect).period in effect.facts.periods


@pytest.mark.parametrize("name", NAMES)
def test_effect_on_the_sensor_is_the_only_kind_that_changes_acceleration_alone(name):
    effect = INSTANCES[name][0]
    healthy, found = with_instance("none", effect.period), with_instance(name, effect.period)
    alone = np.array_equal(found.transmission_error_lines, healthy.transmission_error_lines)
    assert alone == (effect.facts.acts_on == "sensor")


@pytest.mark.parametrize("name", [n for n in NAMES if not EFFECTS[n].facts.changes_mesh_lines])
def test_effect_that_is_said_not_to_change_mesh_lines_changes_them_by_less_than_half_a_percent_once_worn(name):
    effect = INSTANCES[name][0]
    orders = 19 * np.arange(1, 4)
    found, healthy = solved(effect, depth=50e-6), solved(depth=50e-6)
    change = np.abs(found.transmission_error(orders) - healthy.transmission_error(orders))
    assert change.max() < 5e-3 * np.abs(healthy.transmission_error(orders)).max()


@pytest.mark.parametrize("name", NAMES)
def test_effect_slices_the_face_as_it_declares(name):
    effect = INSTANCES[name][0]
    assert with_instance(name, effect.period).setup.slices == effect.facts.slices


@pytest.mark.parametrize("name", [n for n in NAMES if EFFECTS[n].facts.tilts_shaft])
def test_effect_that_tilts_a_shaft_moves_the_mean_transmission_error(name):
    found, healthy = with_instance(name, "mesh"), with_instance("none", "mesh")
    assert found.mean_transmission_error - healthy.mean_transmission_error > 1e-6


def test_mesh_search_tries_every_effect_that_it_is_declared_to_find_and_those_that_shape_wear_last():
    trials = mesh_trials()
    assert set(trials) == set(OF_MESH)
    shaping = [trial.facts.shapes_wear for trial in trials.values()]
    assert shaping == sorted(shaping)


@pytest.mark.parametrize("name", OF_MESH)
def test_fitted_numbers_start_within_their_bounds_and_make_the_parameters_that_they_stand_for(name):
    trial, numbers = trial_of(name), fitted_numbers(name)
    start = np.array([f.start for f in trial.free])
    effect = trial.make(start)
    for number, u in zip(numbers, start, strict=True):
        assert number.low <= u <= number.high
        assert getattr(effect, number.parameter.name) == number.value(u)
        assert number.parameter in effect.parameters


def test_logarithmic_number_multiplies_and_plain_number_adds():
    parameter = Parameter(name="size", unit="m", low=0.0, high=1.0, prior=0.1)
    linear = FittedNumber(parameter=parameter, scale=0.1, centre=0.5, low=-1, high=1)
    ratio = FittedNumber(parameter=parameter, scale=0.1, centre=0.5, logarithmic=True, low=-1, high=1)
    assert linear.value(2.0) == pytest.approx(0.7)
    assert ratio.value(2.0) / ratio.value(1.0) == pytest.approx(np.exp(0.1))
    assert ratio.value(0.0) == 0.5


def test_least_detectable_size_has_a_default():
    assert DetectionThresholds().least_size == 0.3


def test_every_claim_but_lines_has_a_content_of_its_own_which_repeats_at_an_order_of_the_effect():
    assert {"lines", *CONTENT} == set(CLAIMS)
    of_content = [effect for effect in EFFECTS.values() if effect.facts.claims in CONTENT]
    assert of_content and all(ORDER in {p.name for p in effect.parameters} for effect in of_content)
