"""What holds for every effect of the table."""

from dataclasses import fields, is_dataclass
from fractions import Fraction
from itertools import pairwise
from math import inf, nan

import numpy as np
import pytest

from tests.dynamics_cases import TEN, model, relative
from tests.effects_cases import GEAR_INSTANCES, INSTANCES, MESH, solved, with_instance
from twin.dynamics.harmonic_balance import TOLERANCE
from twin.effects import EFFECTS, neutral, solve_with
from twin.effects.setup import contacts_of
from twin.errors import ParameterError

CONTRACT = [
    "pinion_eccentricity",
    "gear_eccentricity",
    "misalignment",
    "tooth_friction",
    "pitch_error",
    "profile_error",
    "tooth_crack",
    "mass_unbalance",
    "torque_ripple",
    "bearing_defect",
    "backlash_rattle",
    "mesh_stiffness_loss",
    "mesh_damping",
    "sensor_gain",
    "sensor_resonance",
]
NAMES = [name for name in EFFECTS if name != "none"]
UNSLICED = [name for name in NAMES if EFFECTS[name].facts.slices == 1]  # a sliced face takes minutes over long periods
RESONANT = 10  # amplification of what the solver leaves (TOLERANCE of the mean force) by a mode: 1/(2ζ), ζ of some 0.05
SENSORS = [name for name, kind in EFFECTS.items() if kind.facts.acts_on == "sensor"]


def channels(found):
    return (found.acceleration_lines, found.transmission_error_lines, found.torque_lines, found.steady.deflection)


def test_table_holds_the_names_of_the_contract_and_every_effect_has_an_instance():
    assert set(EFFECTS) == set(INSTANCES)
    assert set(EFFECTS) >= {"none", *CONTRACT}  # more may be added
    for name, (effect, _) in INSTANCES.items():
        assert type(effect) is EFFECTS[name]


def test_no_effect_is_the_model_itself_to_the_bit():
    steady = model().steady(model().unworn, TEN)
    found = solved(EFFECTS["none"]())
    assert np.array_equal(found.steady.deflection, steady.deflection)
    assert np.array_equal(found.acceleration_lines, model().acceleration_lines(steady))
    assert found.acceleration_rms() == pytest.approx(model().acceleration_rms(steady), rel=1e-12)
    assert found.mean_transmission_error == pytest.approx(model().mean_transmission_error(steady, TEN), rel=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_signature_is_what_the_model_makes(name):
    """Of the stated instance, in the orders of acceleration and transmission error and in the channels that move."""
    effect, signature = INSTANCES[name][0], EFFECTS[name].signature
    found, base = solved(effect, period="hunting"), with_instance("none", "hunting")
    pairs = {
        "acceleration": (found.acceleration_lines, base.acceleration_lines),
        "encoder": (found.transmission_error_lines, base.transmission_error_lines),
        "torque": (found.torque_lines, base.torque_lines),
    }
    moved = {c for c, (a, b) in pairs.items() if np.abs(a - b).max() > 1e-6 * np.abs(b).max()}
    assert moved <= {*signature.channels, "encoder", "torque"} and set(signature.channels) <= moved
    if signature.shape == "path":
        assert moved == {"acceleration"}
    with_it, without = pairs["encoder"]
    change = np.abs(np.abs(with_it) - np.abs(without))
    z1 = model().mesh.pair.teeth[0]
    own = {"pinion": 1.0, "gear": z1 / model().mesh.pair.teeth[1]}
    mesh = np.isclose(found.orders % z1, 0) | np.isclose(found.orders % z1, z1)
    if signature.shape == "alike":
        solved_to = TOLERANCE * base.steady.deflection.mean() * RESONANT
        assert change[~mesh].max() < max(1e-6 * change.max(), 2 * solved_to)
    if signature.shape == "run_out":
        strongest = found.orders[np.argmax(np.where(mesh, 0, change))]
        assert any(np.isclose(strongest, own[shaft]) for shaft in signature.shafts)
    if signature.shape in ("local", "all_round"):
        several = np.sort(np.where(mesh, 0, change))[::-1]
        assert several[5] > 0.05 * several[0]


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_left_of_an_effect_at_its_neutral_values_to_the_bit(name):
    effect = neutral(INSTANCES[name][0])
    healthy = with_instance("none", effect.period)
    for found, expected in zip(channels(solved(effect)), channels(healthy), strict=True):
        assert np.array_equal(found, expected)


@pytest.mark.parametrize("name", NAMES)
def test_effect_with_a_value_changes_what_the_channels_report(name):
    period = INSTANCES[name][0].period
    found, healthy = with_instance(name, period), with_instance("none", period)
    assert relative(found.acceleration_lines, healthy.acceleration_lines) > 1e-5


@pytest.mark.parametrize("name", SENSORS)
def test_effect_on_the_sensor_leaves_transmission_error_and_torque_alone_to_the_bit(name):
    found, healthy = with_instance(name, "mesh"), with_instance("none", "mesh")
    assert np.array_equal(found.transmission_error_lines, healthy.transmission_error_lines)
    assert np.array_equal(found.torque_lines, healthy.torque_lines)


@pytest.mark.parametrize("name", [*UNSLICED, *GEAR_INSTANCES])
def test_effect_moves_only_the_orders_that_theory_gives_it(name):
    _, step = {**INSTANCES, **GEAR_INSTANCES}[name]
    found, healthy = with_instance(name, "hunting"), with_instance("none", "hunting")
    change = np.abs(found.transmission_error_lines - healthy.transmission_error_lines)
    change = change + 1e-9 * np.abs(found.acceleration_lines - healthy.acceleration_lines)  # 1 m/s² as 1 nm
    allowed = np.zeros(change.size, dtype=bool)
    allowed[step - 1 :: step] = True
    assert change[allowed].max() > 1e-12
    assert change[~allowed].max() < 1e-5 * change[allowed].max()


@pytest.mark.parametrize("name", [*UNSLICED, *GEAR_INSTANCES])
def test_lines_over_the_shortest_period_are_those_over_the_hunting_period(name):
    effect, _ = {**INSTANCES, **GEAR_INSTANCES}[name]
    whole, short = with_instance(name, "hunting"), solved(effect, samples=64)
    orders = short.orders[short.orders * TEN.speed_hz <= 2000]
    assert relative(short.acceleration(orders), whole.acceleration(orders)) < 1e-6


@pytest.mark.parametrize("name", [n for n in NAMES if INSTANCES[n][0].period != "mesh"])
def test_effect_that_does_not_repeat_with_the_mesh_is_refused_there(name):
    with pytest.raises(ParameterError, match=r"does not repeat over the period of the mesh: .* is needed"):
        solve_with(model(), [INSTANCES[name][0]], model().unworn, TEN, "mesh")


def test_shortest_period_is_that_of_all_effects_together():
    assert solved(INSTANCES["tooth_friction"][0]).setup.turns == Fraction(1, 19)
    assert solved(INSTANCES["tooth_crack"][0], INSTANCES["tooth_friction"][0]).setup.turns == 1
    assert solved(INSTANCES["gear_eccentricity"][0]).setup.turns == Fraction(52, 19)
    assert solved(INSTANCES["gear_eccentricity"][0], INSTANCES["pitch_error"][0]).setup.turns == 52


@pytest.mark.parametrize(("first", "second"), list(pairwise(UNSLICED)))
def test_order_in_which_effects_are_applied_does_not_matter(first, second):
    a, b = INSTANCES[first][0], INSTANCES[second][0]
    setups = []
    for effects in ((a, b), (b, a)):
        setup = with_instance("none", "hunting").setup
        for effect in effects:
            setup = effect.apply(setup)
        setups.append(setup)
    one, other = setups
    for field in ("stiffness", "separation", "slope", "damping_time"):
        np.testing.assert_allclose(getattr(one, field), getattr(other, field), rtol=1e-12, atol=1e-18)
    assert (len(one.actions), len(one.loads)) == (len(other.actions), len(other.loads))
    f = np.array([10.0, 760.0])
    gains = [np.prod([gain(f) for gain in setup.accelerometer], axis=0) for setup in setups]
    assert gains[0] == pytest.approx(gains[1], rel=1e-12)


def test_effects_of_all_kinds_solve_together():
    chosen = ("gear_eccentricity", "tooth_friction", "tooth_crack", "mass_unbalance", "sensor_gain")
    found = solved(*(INSTANCES[name][0] for name in chosen))
    alone = with_instance("gear_eccentricity", "hunting")
    own = 19 / 52
    assert found.transmission_error([own]) == pytest.approx(alone.transmission_error([own]), rel=2e-2)
    assert abs(found.torque([19.0])[0]) > 10 * abs(alone.torque([19.0])[0])  # friction's


@pytest.mark.parametrize("name", EFFECTS)
def test_effect_is_plain_frozen_data_with_its_parameters_described(name):
    cls = EFFECTS[name]
    assert is_dataclass(cls) and cls.__dataclass_params__.frozen
    numbers = {f.name for f in fields(cls) if f.type not in ("str", "int", "tuple[str, ...]")}
    described = {p.name for p in cls.parameters}
    assert numbers <= described <= {f.name for f in fields(cls)}
    for p in cls.parameters:
        assert p.low < p.high and p.prior > 0
        assert p.shape or p.low <= p.neutral <= p.high or p.neutral == inf


@pytest.mark.parametrize(
    ("name", "parameter"),
    [(n, p) for n in NAMES for p in EFFECTS[n].parameters],
    ids=lambda v: getattr(v, "name", v),
)
def test_value_out_of_bounds_is_refused_with_the_number_and_the_range(name, parameter):
    effect = INSTANCES[name][0]
    given = {f.name: getattr(effect, f.name) for f in fields(effect)}
    for wrong in (parameter.high * 1.1 + 1e-12, nan):
        value = (wrong,) if parameter.many else wrong
        with pytest.raises(ParameterError, match=rf"\.{parameter.name} = .* is outside .* … "):
            type(effect)(**{**given, parameter.name: value})


def test_mesh_orders_alone_are_lines_of_the_mesh_period():
    found = with_instance("none", "mesh")
    assert found.orders[:3] == pytest.approx([19, 38, 57])
    with pytest.raises(ParameterError, match=r"order 20 of the pinion's rotation is no line of the period"):
        found.acceleration([19, 20])
    assert 19 * found.setup.mesh.pair.teeth[1] == MESH


def test_as_many_profiles_as_slices_are_needed():
    setup = EFFECTS["misalignment"](lead_gap=1e-5).apply(with_instance("none", "mesh").setup)
    with pytest.raises(ParameterError, match="2 worn profiles for 13 slices"):
        contacts_of(setup, [model().unworn] * 2)
