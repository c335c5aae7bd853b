"""The steady state of the harmonic balance is the motion that the time integrator settles on, effects included."""

import numpy as np
import pytest

from tests.dynamics_cases import model, relative
from tests.effects_cases import TEETH, action_power, solved
from twin.dynamics.integrator import integrate, steady_start
from twin.dynamics.structure import direction
from twin.effects import EFFECTS
from twin.model import Condition

FAST = Condition(speed_hz=20.0, torque=10.0)
SAMPLES = 160  # a mesh period, two a step: 33 µs
STRUCTURE = model().structure

CASES = {
    "pinion_eccentricity": EFFECTS["pinion_eccentricity"](eccentricity=20e-6, high_point=1.0),
    "gear_eccentricity": EFFECTS["gear_eccentricity"](eccentricity=20e-6),
    "pitch_error": EFFECTS["pitch_error"].drawn(TEETH, 4e-6, 3e-6, seed=3),
    "tooth_crack": EFFECTS["tooth_crack"](stiffness_loss=0.3, tooth=5),
    "misalignment": EFFECTS["misalignment"](lead_gap=20e-6),
    "tooth_friction": EFFECTS["tooth_friction"](coefficient=0.1),
    "profile_error": EFFECTS["profile_error"](pinion_relief=10e-6),
}


def compared(found, samples=SAMPLES):
    """Spectra of the accelerometer up to 2 kHz over ten late turns of the pinion, integrated and balanced."""
    accelerometer, load = model().accelerometer, found.constant_loads
    start = steady_start(STRUCTURE, found.steady, load)
    turn = samples * TEETH[0] // 2  # steps
    step = 2 * found.contacts.period / found.contacts.samples
    motion = integrate(STRUCTURE, found.contacts, load, 26 * turn * step, accelerometer[None], start=start)
    late = slice(16 * turn, 26 * turn)
    lines = np.concatenate(([0], found.acceleration_lines / 2))
    balanced = np.fft.irfft(lines, found.contacts.samples, norm="forward")[::2]
    balanced = np.resize(balanced, 52 * turn)  # as often as it fits into the hunting-tooth period
    spectra = [np.fft.rfft(a[late]) for a in (motion.acceleration[:, 0], balanced)]
    in_band = np.fft.rfftfreq(10 * turn, step) <= 2000
    return [spectrum[in_band] for spectrum in spectra]


@pytest.mark.parametrize("name", CASES)
def test_harmonic_balance_settles_where_time_integration_does(name):
    found = solved(CASES[name], depth=20e-6, condition=FAST, samples=SAMPLES)
    integrated, balanced = compared(found)
    assert relative(integrated, balanced) < 2e-3


@pytest.mark.parametrize("name", ["misalignment", "tooth_friction"])
def test_the_two_approach_each_other_as_the_step_shrinks(name):
    errors = []
    for samples in (SAMPLES, 2 * SAMPLES):
        found = solved(CASES[name], depth=20e-6, condition=FAST, samples=samples)
        errors.append(relative(*compared(found, samples)))
    assert errors[1] < errors[0] / 4


def test_integration_without_the_effect_settles_elsewhere():
    integrated, _ = compared(solved(CASES["tooth_friction"], depth=20e-6, condition=FAST, samples=SAMPLES))
    _, healthy = compared(solved(depth=20e-6, condition=FAST, samples=SAMPLES))
    assert relative(integrated, healthy) > 0.1


def test_friction_leaves_the_brake_less_torque():
    found = solved(CASES["tooth_friction"])
    torque = found.constant_loads @ direction({"th13": 1.0})
    lost = found.setup.condition.torque * found.setup.omega[0] + torque * found.setup.omega[1]
    assert lost == pytest.approx(action_power(found).mean(), rel=1e-7)
    assert lost > 0
