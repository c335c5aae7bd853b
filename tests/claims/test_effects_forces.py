"""What each effect outside the mesh does by theory: unbalance, ripple, bearings, rattle, the sensor."""

import numpy as np
import pytest

from tests.dynamics_cases import TEN, model, relative
from tests.effects_cases import TEETH, solved, with_instance
from twin.dynamics.structure import direction
from twin.effects import EFFECTS, BearingGeometry
from twin.errors import ParameterError
from twin.model import Condition

Z1, Z2 = TEETH
DEFECT, RATTLE, UNBALANCE = (EFFECTS[n] for n in ("bearing_defect", "backlash_rattle", "mass_unbalance"))
RIPPLE = EFFECTS["torque_ripple"]
LIGHT = Condition(speed_hz=10.0, torque=2.0)


# --- unbalance and ripple


@pytest.mark.parametrize(("rotor", "order"), [("pinion", 1.0), ("gear", Z1 / Z2)])
def test_unbalance_grows_with_its_size_and_shows_at_its_own_order(rotor, order):
    one, two = (abs(solved(UNBALANCE(**{rotor: U})).acceleration([order])[0]) for U in (1e-3, 2e-3))
    assert two == pytest.approx(2 * one, rel=1e-3)
    assert one > 1e-10


def test_unbalance_is_a_force_of_constant_size_that_turns_with_its_gear():
    setup = UNBALANCE(pinion=1e-3, gear=2e-3).apply(with_instance("none", "hunting").setup)
    ω1, ω2 = setup.omega
    forces = [np.fft.irfft(load.lines, setup.samples, norm="forward") for load in setup.loads]
    for (x, y), size, sense in (((forces[0], forces[1]), 1e-3 * ω1**2, -1), ((forces[2], forces[3]), 2e-3 * ω2**2, 1)):
        assert np.hypot(x, y) == pytest.approx(size, rel=1e-9)
        turned = np.unwrap(np.angle(x[:2000] + 1j * y[:2000]))
        assert np.sign(turned[-1] - turned[0]) == sense  # the gears turn opposite ways


def test_unbalance_about_a_closed_mesh_is_the_response_of_a_linear_structure():
    """With the mean mesh stiffness in the mesh's place: (K + k·ggᵀ + iωC − ω²M)·q = f."""
    found, structure = solved(UNBALANCE(pinion=1e-3)), model().structure
    ω, force = found.setup.omega[0], 1e-3 * found.setup.omega[0] ** 2
    k = 2.72e8 * (1 + 1j * ω * model().calibration.damping_time)
    D = structure.stiffness + k * np.outer(structure.mesh, structure.mesh) - ω**2 * structure.mass
    D = D + 1j * ω * structure.damping
    q = np.linalg.solve(D, force * (direction({"x5": 1.0}) + 1j * direction({"y5": 1.0})))
    assert found.acceleration([1.0])[0] == pytest.approx(-(ω**2) * model().accelerometer @ q, rel=2e-2)


def test_torque_ripple_shows_at_its_order_and_in_proportion():
    one, two = (solved(RIPPLE(amplitude=T, order=10.0)).torque([10.0])[0] for T in (0.5, 1.0))
    assert two == pytest.approx(2 * one, rel=1e-3)


def test_torque_ripple_turns_with_its_phase():
    one, other = (solved(RIPPLE(amplitude=0.5, order=2.0, phase=φ)).torque([2.0])[0] for φ in (0.0, 0.5))
    assert other / one == pytest.approx(np.exp(0.5j), rel=1e-3)


# --- bearings


def test_impact_orders_of_a_6205_bearing():
    """9 balls of 7.94 mm on 39.04 mm: the values that the bearing's makers print."""
    orders = BearingGeometry(balls=9, ball_diameter=7.94e-3, pitch_diameter=39.04e-3).orders()
    assert orders == pytest.approx({"cage": 0.3983, "outer": 3.5848, "inner": 5.4152, "ball": 4.7135}, rel=1e-3)
    assert orders["outer"] + orders["inner"] == pytest.approx(9.0)


def forces(defect):
    """Force of the defect over the record, and the record's length [s]."""
    setup = defect.apply(with_instance("none", "hunting").setup)
    length = float(setup.turns) / TEN.speed_hz
    return np.fft.irfft(setup.loads[0].lines, setup.samples, norm="forward"), length


def test_blows_without_slip_are_lines_at_the_order_and_its_multiples():
    force, _ = forces(DEFECT(blow=50.0, order=3.5))
    lines = np.abs(np.fft.rfft(force))
    on = np.zeros(lines.size, dtype=bool)
    on[182::182] = True  # 3.5·52
    assert lines[~on].max() < 1e-9 * lines[on].max()


@pytest.mark.slow
def test_slip_spreads_the_lines_and_the_envelope_keeps_the_order():
    steady, slipping = DEFECT(blow=50.0, order=3.5), DEFECT(blow=50.0, order=3.5, slip=0.02)
    spectra = [np.abs(np.fft.rfft(forces(defect)[0])) for defect in (steady, slipping)]
    assert spectra[1][182 * 10] < 0.7 * spectra[0][182 * 10]
    envelope = np.abs(np.fft.rfft(forces(slipping)[0] ** 2))[1:]
    near = np.arange(1, envelope.size + 1)
    peak = near[: 182 * 3 // 2][np.argmax(envelope[: 182 * 3 // 2])]
    assert abs(peak - 182) <= 4


@pytest.mark.slow
def test_mean_spectrum_of_slipping_blows_is_that_of_a_renewal_process():
    defect = {"blow": 50.0, "order": 3.5, "slip": 0.05}
    density = 0
    for seed in range(24):
        force, length = forces(DEFECT(**defect, seed=seed))
        density = density + 2 * np.abs(np.fft.rfft(force, norm="forward")) ** 2 * length / 24
    f = np.arange(density.size) / length
    for low, high in ((300.0, 600.0), (600.0, 1200.0), (1200.0, 2400.0)):
        band = (f >= low) & (f < high)
        expected = DEFECT(**defect).power_spectrum(f[band], TEN.speed_hz).mean()
        assert density[band].mean() == pytest.approx(expected, rel=0.1)


def test_modulated_blows_have_sidebands_at_the_modulation_order():
    force, _ = forces(DEFECT(blow=50.0, order=3.5, modulation=0.8, modulation_order=1.0))
    lines = np.abs(np.fft.rfft(force))
    assert lines[182 + 52] == pytest.approx(0.4 * lines[182], rel=0.05)
    assert lines[182 + 19] < 1e-6 * lines[182]


def test_bearing_defect_hardly_moves_the_transmission_error():
    found, healthy = with_instance("bearing_defect", "hunting"), with_instance("none", "hunting")
    in_band = found.orders * TEN.speed_hz <= 2000
    a, e = (
        getattr(found, channel)[in_band] - getattr(healthy, channel)[in_band]
        for channel in ("acceleration_lines", "transmission_error_lines")
    )
    assert np.linalg.norm(a) > 0.5 * np.linalg.norm(healthy.acceleration_lines[in_band])
    assert np.linalg.norm(e) < 0.15 * np.linalg.norm(healthy.transmission_error_lines[in_band])


def test_only_bearings_can_have_a_bearing_defect():
    with pytest.raises(ParameterError, match='place = "th5" is no bearing coordinate: x4, y4'):
        DEFECT(blow=1.0, place="th5")


# --- rattle


def test_backlash_alone_does_not_show_to_the_bit():
    found, healthy = solved(RATTLE(extra_backlash=5e-4, load_ripple=0.0)), with_instance("none", "pinion")
    assert np.array_equal(found.acceleration_lines, healthy.acceleration_lines)


def test_small_ripple_keeps_the_teeth_together_whatever_the_backlash():
    narrow, wide = (solved(RATTLE(extra_backlash=j, load_ripple=1.0, order=2.0)) for j in (0.0, 1e-3))
    assert np.array_equal(narrow.acceleration_lines, wide.acceleration_lines)
    assert narrow.steady.contact_loss == 0


# --- the sensor


def test_gain_multiplies_every_order_alike():
    found, healthy = with_instance("sensor_gain", "mesh"), with_instance("none", "mesh")
    assert found.acceleration_lines == pytest.approx(0.88 * healthy.acceleration_lines, rel=1e-12)


def test_resonance_reports_slow_motion_truly_and_amplifies_at_its_frequency():
    mount = EFFECTS["sensor_resonance"](frequency=1000.0, damping_ratio=0.05)
    slow, at, above = mount.response(np.array([1.0, 1000.0, 5000.0]))
    assert slow == pytest.approx(1.0, abs=1e-5)
    assert abs(at) == pytest.approx(np.sqrt(1 + 0.01) / 0.1, rel=1e-9)
    assert abs(above) < 0.05
    assert np.angle(at) < -1.3


def test_gain_and_resonance_multiply():
    gain, mount = EFFECTS["sensor_gain"](gain=0.9), EFFECTS["sensor_resonance"](frequency=3000.0)
    both, alone = solved(gain, mount), solved(mount)
    assert relative(both.acceleration_lines, 0.9 * alone.acceleration_lines) < 1e-12
