"""Shaft-synchronous forces are distinguished from tooth errors: ripple from pitch errors, run-out from unbalance."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from tests.dynamics_cases import FOURTEEN, RIG, model
from tests.dynamics_cases import TEN as CONDITION
from twin.effects import EFFECTS
from twin.effects.response import solve_with
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.scales import Scales
from twin.tracing.attribution import AttributedEffect
from twin.tracing.beside_ripple import BesideRipple
from twin.tracing.detectors.rattle import find_rattle
from twin.tracing.detectors.shaft_forces import find_shaft_forces, run_out_of, tooth_errors_explain
from twin.tracing.detectors.tooth_errors import find_pitch_errors
from twin.tracing.findings import Findings
from twin.tracing.shaft_lines import without_line, without_order
from twin.tracing.shaft_remainder import shaft_lines

PHASE = 0.7  # of the mesh against the encoder's zero [rad]
RIPPLE = EFFECTS["torque_ripple"](amplitude=0.5, order=8.0, phase=0.4)
PITCH = EFFECTS["pitch_error"](pinion=tuple(3e-6 * np.random.default_rng(5).normal(size=19)))
SWAY = EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=0.5, order=1.0)
NOISE = 1e-4  # [N·m]
SCALES = Scales.of(RIG)
UNWORN = [(CONDITION, model().unworn)] * 6


def recorded(*effects, count=6, torque_scale=1.0, condition=CONDITION):
    """Windows of a machine whose torque meter, accelerometer and encoders show effects, in the encoder's angle."""
    response = solve_with(model(), effects, model().unworn, condition, "pinion")
    orders = np.arange(1.0, 11.0)
    rng = np.random.default_rng(3)

    def lines(values, unit, noise=NOISE):
        turned = values * np.exp(1j * orders * PHASE / 19)
        noisy = turned + noise * (rng.normal(size=10) + 1j * rng.normal(size=10))
        return MeasuredLines(
            unit=unit,
            keys=tuple((0, int(p), 0) for p in orders),
            orders=tuple(orders.tolist()),
            amplitudes=tuple(noisy.tolist()),
            std=(noise,) * 10,
        )

    return [
        WindowFeatures(
            start_time_ns=n, duration=5.0, quality="good", speed_hz=condition.speed_hz, revolutions=1e3 * n, rms=1.0,
            torque=lines(torque_scale * response.torque(orders), "N·m"),
            acceleration=lines(response.acceleration(orders), "m/s²"),
            transmission_error=lines(response.transmission_error(orders), "m", 1e-8),
        )
        for n in range(count)
    ]  # fmt: skip


def test_ripple_is_found_with_its_order_size_and_phase():
    (found,) = find_shaft_forces(model(), recorded(RIPPLE), [CONDITION] * 6, PHASE, SCALES)
    assert found.effect.order == 8.0
    assert found.effect.amplitude == pytest.approx(0.5, rel=0.02)
    assert found.effect.phase == pytest.approx(0.4, abs=0.02)
    assert not tooth_errors_explain(model(), recorded(RIPPLE), UNWORN, (PITCH,), PHASE, 8)


@pytest.mark.parametrize("order", [3, 5, 6, 8])
def test_torque_that_pitch_errors_make_is_theirs_and_three_times_as_much_is_not(order):
    assert tooth_errors_explain(model(), recorded(PITCH), UNWORN, (PITCH,), PHASE, order)
    assert not tooth_errors_explain(model(), recorded(PITCH, torque_scale=3.0), UNWORN, (PITCH,), PHASE, order)


@pytest.mark.parametrize(
    ("unbalance", "teeth"),
    [
        (0.02, EFFECTS["tooth_crack"](stiffness_loss=0.6, tooth=4)),
        (0.008, EFFECTS["tooth_crack"](stiffness_loss=0.3, tooth=11)),
        (0.02, PITCH),
        (0.0, EFFECTS["tooth_crack"](stiffness_loss=0.6, tooth=4)),
        (0.0, PITCH),
    ],
)
def test_an_unbalance_beside_teeth_that_differ_stays_one_and_teeth_alone_make_none(unbalance, teeth):
    heavy = EFFECTS["mass_unbalance"](pinion=unbalance, pinion_heavy_point=1.0)
    windows = recorded(*((heavy, teeth) if unbalance else (teeth,)))
    suspected = find_shaft_forces(model(), windows, [CONDITION] * 6, PHASE, SCALES)
    differing = AttributedEffect.of(teeth, parameters={}, log_evidence=100.0)
    findings = replace(Findings(), forces=tuple(suspected), effects=(differing,))
    beside = findings.forces_beside_teeth(shaft_lines(model(), windows, SCALES))
    assert [f.name for f in beside if f.channel == "acceleration"] == (["mass_unbalance"] if unbalance else [])


@pytest.mark.parametrize("name", ["torque_ripple", "mass_unbalance"])
def test_what_turns_is_found_where_speed_and_load_change_from_window_to_window(name):
    effect = RIPPLE if name == "torque_ripple" else EFFECTS["mass_unbalance"](pinion=0.02, pinion_heavy_point=1.0)
    conditions = [CONDITION, FOURTEEN] * 2
    windows = [recorded(effect, count=1, condition=c)[0] for c in conditions]
    (found,) = find_shaft_forces(model(), windows, conditions, PHASE, SCALES)
    for parameter in effect.parameters:
        expected = getattr(effect, parameter.name)
        assert getattr(found.effect, parameter.name) == pytest.approx(expected, rel=0.02, abs=1e-9)


@pytest.mark.parametrize(("share", "noise"), [(0.7, 0.0), (0.3, 0.8)])
def test_load_that_swings_as_far_as_its_mean_rattles_and_less_where_noise_tells_of_blows(share, noise):
    scale = share * CONDITION.torque / abs(solve_with(model(), (SWAY,), model().unworn, CONDITION).torque([1.0])[0])
    windows = [replace(w, noise_rms=noise) for w in recorded(SWAY, torque_scale=scale)]
    found = find_rattle(model(), windows, [CONDITION] * 6, SCALES)
    assert found is not None and found.name == "backlash_rattle"
    steady = [replace(w, noise_rms=0.0) for w in recorded(SWAY, torque_scale=0.3 / share * scale)]
    assert find_rattle(model(), steady, [CONDITION] * 6, SCALES) is None


@pytest.mark.parametrize(("size", "scatter", "noise", "rattles"), [
    (60e-6, 0.03, 0.8, True), (60e-6, 0.001, 0.8, False), (2e-6, 0.03, 0.8, False), (60e-6, 0.03, 0.1, False),
])  # fmt: skip
def test_teeth_that_strike_rattle_without_a_torque_meter_where_the_transmission_error_sways(
    size, scatter, noise, rattles
):
    rng = np.random.default_rng(9)
    windows = []
    for w in recorded(SWAY):
        sway = replace(w.acceleration, unit="m", amplitudes=(size * (1 + scatter * rng.normal()), *(1e-7,) * 9))
        windows.append(replace(w, torque=None, transmission_error=sway, noise_rms=noise))
    found = find_rattle(model(), windows, [CONDITION] * 6, SCALES)
    assert (found is not None) == rattles
    if found is not None:
        assert found.parameters == {"order": (1.0, "", 0.0)}


@pytest.mark.parametrize(("run_out", "orders"), [(60e-6, [8.0]), (0.0, [])])
def test_ripple_is_found_beside_the_torque_of_an_eccentric_pinion_and_not_beside_another_force(run_out, orders):
    windows = []
    for w in recorded(RIPPLE):
        torque = (0.8 * w.torque.at(0, 8, 0), *w.torque.amplitudes[1:])
        error = replace(w.torque, unit="m", amplitudes=(run_out * np.exp(0.3j), *(1e-9,) * 9))
        windows.append(replace(w, torque=replace(w.torque, amplitudes=torque), transmission_error=error))
    assert [f.order for f in find_shaft_forces(model(), windows, [CONDITION] * 6, PHASE, SCALES)] == orders


@pytest.mark.parametrize("order", [2, 3])  # whose aliases by 19 teeth are not read
def test_pitch_errors_beside_a_ripple_are_fitted_to_what_the_ripple_leaves_of_their_line(order):
    ripple = EFFECTS["torque_ripple"](amplitude=0.5, order=float(order), phase=0.4)
    orders = np.arange(1.0, 16.0)
    both = solve_with(model(), (ripple, PITCH), model().unworn, CONDITION, "pinion").transmission_error(orders)
    made = solve_with(model(), (ripple,), model().unworn, CONDITION, "pinion").transmission_error([order])[0]
    turn = np.exp(1j * orders * PHASE / 19)
    error = MeasuredLines(
        unit="m", keys=tuple((0, int(p), 0) for p in orders), orders=tuple(orders), amplitudes=tuple(both * turn),
        std=(1e-9,) * 15,
    )  # fmt: skip
    windows = [replace(w, transmission_error=error) for w in recorded(ripple, count=3)]
    rest = without_line(windows, (0, order, 0), [made * turn[order - 1]] * 3)
    beside = BesideRipple(windows=tuple(rest), order=order, std=0.15 * abs(made))

    def off(beside):
        found = find_pitch_errors(
            model(), without_order(windows, order), [CONDITION] * 3, [model().unworn] * 3, PHASE, SCALES,
            RIG.tolerances, beside=beside,
        )  # fmt: skip
        true = np.array(PITCH.pinion) - np.mean(PITCH.pinion)
        return np.linalg.norm(np.array(found.effect.pinion) - true) / np.linalg.norm(true)

    assert off(beside) < 0.15 < off(None)


def test_line_that_grows_from_window_to_window_is_no_ripple():
    windows = [recorded(RIPPLE, count=1, torque_scale=s)[0] for s in (0.1, 0.3, 0.6, 1.0, 1.5, 2.0)]
    assert find_shaft_forces(model(), windows, [CONDITION] * 6, PHASE, SCALES) == []


def test_run_out_of_an_unbalance_is_in_proportion_and_turns_with_the_heavy_point():
    small, large = (EFFECTS["mass_unbalance"](pinion=U) for U in (1e-3, 4e-3))
    turned = EFFECTS["mass_unbalance"](pinion=1e-3, pinion_heavy_point=pi / 2)
    one = run_out_of(model(), CONDITION, small)
    assert abs(one) > 0
    assert run_out_of(model(), CONDITION, large) == pytest.approx(4 * one, rel=1e-3)
    assert run_out_of(model(), CONDITION, turned) == pytest.approx(1j * one, rel=1e-3)
