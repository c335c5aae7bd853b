"""Transmission error of a pair whose motion is known: what was put in comes out."""

import numpy as np
import pytest

from twin.errors import NotAvailable, WindowError
from twin.features.angle import angle_track
from twin.features.orders import order_lines
from twin.features.transmission_error import transmission_error
from twin.windows import Edges

Z1, Z2, RB1 = 19, 52, 0.01785
SPEED = 10.0
MESH = {19: 20e-6 * np.exp(0.4j), 38: 6e-6j, 57: -2e-6 + 0j, 114: 0.5e-6 + 0j, 190: 0.3e-6 * np.exp(2j)}
GRADUATION = {1: 8e-6 + 0j, 2: 3e-6j, 5: 1e-6 + 0j}  # of each disc, along its own turn [rad]


def time_at(angle):
    return (angle + 0.15 * np.sin(angle / 25) + 0.1 * np.cos(angle / 40)) / (2 * np.pi * SPEED)


def wave(angle, lines):
    return sum(np.real(a * np.exp(1j * o * angle)) for o, a in lines.items())


def edges_of(ratio, share, per_rev, first_turn, turns, constant=0.0, graduation=GRADUATION, lines=MESH):
    """Edges of a disc whose angle is (θ + share·TE(θ)/r_b1 − constant)/ratio, less its graduation error.

    ratio       pinion turns per turn of the disc
    first_turn  pinion turn at which the record starts
    """
    low = (2 * np.pi * first_turn - constant) / ratio
    first = int(np.ceil(low / (2 * np.pi) * per_rev))
    φ = 2 * np.pi / per_rev * (first + np.arange(int(turns / ratio * per_rev)))
    target = ratio * (φ + wave(φ, graduation)) + constant
    θ = target.copy()
    for _ in range(40):
        θ = target - share * wave(θ, lines) / RB1
    return Edges(per_rev=per_rev, first_index=first, times=time_at(θ) - time_at(2 * np.pi * first_turn))


def both(first_turn=1276.3, turns=25.1, constant=1.7, **more):
    pinion = edges_of(1.0, 0.7, 1024, first_turn, turns, **more)
    gear = edges_of(Z2 / Z1, -0.3, 2048, first_turn, turns, constant=constant, **more)
    return pinion, gear


def lines_of(te, orders):
    h1, h2 = te.responses(orders)
    return order_lines(te.signal, orders, [(te.pinion.values, h1), (-te.gear.values, h2)])


def test_mesh_lines_come_out_with_amplitude_and_phase_though_speed_wanders_and_discs_are_imperfect():
    orders = np.array([*MESH, 0.0, 1, 2, 5, Z1 / Z2, 2 * Z1 / Z2, 5 * Z1 / Z2])
    found = lines_of(transmission_error(*both(), (Z1, Z2), RB1), orders)
    wanted = np.array(list(MESH.values()))
    # 1e-9 m: the smoothed angle takes a few 1e-6 rad of the discs' first orders, times the order
    assert np.abs(found.amplitudes[:5] - wanted).max() < 2e-9


def test_graduation_errors_stand_at_the_orders_of_their_own_shaft():
    orders = np.array([0.0, 19, 38, 57, 1, 2, 5, Z1 / Z2, 2 * Z1 / Z2, 5 * Z1 / Z2])
    found = lines_of(transmission_error(*both(), (Z1, Z2), RB1), orders)
    pinion = np.array(list(GRADUATION.values())) * RB1
    assert np.abs(found.amplitudes[4:7] + pinion).max() < 2e-9  # an edge that comes late reads as lag
    assert np.abs(found.amplitudes[7:]) == pytest.approx(np.abs(pinion) * Z2 / Z1, abs=2e-9)


@pytest.mark.slow
@pytest.mark.parametrize("constant", [0.0, 1.7, 40.0])
def test_mean_is_the_constant_between_the_discs_whatever_the_window(constant):
    orders = np.array([0.0, 19, 38, 57, 1, 2, Z1 / Z2, 2 * Z1 / Z2])
    for first_turn, turns in ((0.2, 14.3), (500.77, 25.1), (9000.1, 48.0)):
        te = transmission_error(*both(first_turn, turns, constant), (Z1, Z2), RB1)
        assert lines_of(te, orders).at(0).real == pytest.approx(RB1 * constant, abs=2e-8)


def test_a_deflection_that_presses_the_teeth_together_is_positive():
    unloaded = transmission_error(*both(constant=0.0), (Z1, Z2), RB1).signal.values.mean()
    pressed = transmission_error(*both(constant=30e-6 / RB1), (Z1, Z2), RB1).signal.values.mean()
    assert pressed - unloaded == pytest.approx(30e-6, abs=2e-8)


def test_waveform_on_the_angle_grid_is_the_wave_that_was_put_in():
    pinion, gear = both(constant=0.0, graduation={})
    signal = transmission_error(pinion, gear, (Z1, Z2), RB1).signal
    inner = slice(2000, -2000)
    error = signal.values - wave(signal.angles, MESH)
    assert np.abs(error[inner]).max() < 2e-8


@pytest.mark.slow
def test_angles_are_given_where_no_base_radius_is_known():
    pinion, gear = both()
    metres = transmission_error(pinion, gear, (Z1, Z2), RB1).signal.values
    angle = transmission_error(pinion, gear, (Z1, Z2), None)
    assert angle.unit == "rad"
    assert angle.signal.values * RB1 == pytest.approx(metres, rel=1e-12)


def test_lost_edges_do_not_bias_the_lines():
    pinion, gear = both()
    orders = np.array([19.0, 38, 57, 0, 1, 2, 5, Z1 / Z2, 2 * Z1 / Z2, 5 * Z1 / Z2])
    whole = lines_of(transmission_error(pinion, gear, (Z1, Z2), RB1), orders).amplitudes
    times = pinion.times.copy()
    times[[7000, 7001, 15000]] = np.nan
    times[9000:10500] = np.nan
    holed = Edges(per_rev=pinion.per_rev, first_index=pinion.first_index, times=times)
    found = lines_of(transmission_error(holed, gear, (Z1, Z2), RB1), orders).amplitudes
    assert np.abs(found[:3] - whole[:3]).max() < 2e-8


def test_smoothed_angle_leaves_the_transmission_error_out():
    pinion, _ = both(graduation={})
    track = angle_track(pinion)
    θ = np.linspace(track.start + 20, track.stop - 20, 500)
    expected = time_at(θ) - time_at(2 * np.pi * 1276.3)
    assert np.abs(track.time(θ) - expected).max() * 2 * np.pi * SPEED < 2e-5


def test_an_encoder_too_coarse_for_the_mesh_is_refused_with_the_number_needed():
    pinion, gear = both()
    coarse = Edges(per_rev=64, first_index=0, times=gear.times[::32])
    with pytest.raises(NotAvailable, match="at least 38"):
        transmission_error(pinion, coarse, (Z1, Z2), RB1)


def test_edges_that_run_backwards_are_refused():
    pinion, _ = both()
    backwards = Edges(per_rev=1024, first_index=0, times=pinion.times[::-1])
    with pytest.raises(WindowError, match="reversed"):
        angle_track(backwards)
