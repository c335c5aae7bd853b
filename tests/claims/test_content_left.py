"""What the twin leaves at the shafts' own orders is told with channel, order, size and growth, and what may make it."""

import numpy as np
import pytest

from benchmarks.foreign_content import KINDS, is_right, spoiled
from benchmarks.scoring import ROOT, run, windows_of
from tests.dynamics_cases import RIG
from twin.features.non_gear import NonGearFeatures
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.scales import Scales
from twin.tracing.content_left import lines_left, sentence
from twin.tracing.held_out_error import ChannelComparison, HeldOutComparison
from twin.updating.history import WindowInput

TEETH, GEAR = (19, 52), 19 / 52
SHORT = ROOT / "recordings" / "short-campaign.mcap"
ORDERS = np.array([1.0, 2.0, GEAR, 2 * GEAR, 19.0, 38.0, 57.0])
DISC = Scales.of(RIG).once_per_turn[1]


def channel(measured, predicted, std, disc=0.0):
    """One channel of a healthy machine: noise, a tenth of every predicted line, and what the discs have."""
    predicted = np.array(predicted, complex)
    return ChannelComparison(
        orders=ORDERS, measured=np.array(measured, complex), predicted=predicted, std=np.full(ORDERS.size, std),
        variance=2 * std**2 + (0.1 * np.abs(predicted)) ** 2 + np.where(ORDERS < 2.5, disc, 0.0) ** 2,
    )  # fmt: skip


def compared(encoder=None, heard=None, torque=None):
    """A window whose transmission error, acceleration and torque are left as given, at ORDERS."""
    mesh_e = np.array([0, 0, 0, 0, 8e-6, 3e-6, 1e-6])
    mesh_a = np.array([0, 0, 0, 0, 2.0, 3.0, 1.0])
    channels = {
        "transmission_error": channel(mesh_e + (0 if encoder is None else encoder), mesh_e, 1e-9, DISC),
        "acceleration": channel(mesh_a + (0 if heard is None else heard), mesh_a, 1e-3),
        "torque": channel(np.zeros(7) + (1e-6 if torque is None else torque), np.zeros(7), 1e-3),
    }
    return HeldOutComparison(index=1, speed_hz=10.0, channels=channels, rms_measured=3.0, rms_predicted=3.0)


def history(sizes, shafts=()):
    """Windows whose transmission error has a line once a gear turn of these sizes [m]."""
    out = []
    for n, size in enumerate(sizes):
        lines = MeasuredLines(unit="m", keys=((0, 0, 1),), orders=(GEAR,), amplitudes=(complex(size),), std=(1e-9,))
        beside = NonGearFeatures(duration=2.5, speed_hz=10.0, tones=(), lines=(), kurtosis=1.0, rates=(), shafts=shafts)
        features = WindowFeatures(
            start_time_ns=n, duration=2.5, quality="good", speed_hz=10.0, torque_nm=10.0, rms=3.0,
            revolutions=1000.0 * n, transmission_error=lines,
        )  # fmt: skip
        out.append(WindowInput(index=n, features=features, non_gear=beside))
    return out


def once_a_gear_turn(size):
    return size * (np.abs(ORDERS - GEAR) < 1e-9)


@pytest.mark.parametrize(("order", "words"), [
    (1.0, "once a turn of the pinion"), (2.0, "2 times a turn of the pinion"), (2 * GEAR, "2 times a turn of the gear"),
])  # fmt: skip
def test_a_line_of_any_turn_of_a_disc_is_told_with_its_order_and_size(order, words):
    lines = lines_left([compared(encoder=30e-6 * (np.abs(ORDERS - order) < 1e-9))] * 2, history([1e-6] * 4))
    assert [(line.channel, round(line.order, 4)) for line in lines] == [("encoder", round(order, 4))]
    said = sentence(RIG, lines, history([1e-6] * 4))
    assert words in said and "30 µm" in said and "disc" in said


def test_a_line_of_the_encoders_alone_may_be_the_discs_own_and_no_gear_is_named():
    seen = [compared(encoder=once_a_gear_turn(40e-6))] * 2
    lines = lines_left(seen, history([40e-6] * 4))
    assert [(line.channel, round(line.order, 4)) for line in lines] == [("encoder", round(GEAR, 4))]
    assert lines[0].size == pytest.approx(40e-6) and lines[0].share > 0.9
    said = sentence(RIG, lines, history([40e-6, 40.2e-6, 39.9e-6, 40e-6]))
    for part in (
        "transmission error",
        "order 0.365 (once a turn of the gear) with 40 µm",
        "Hz",
        "stays the same",
        "disc",
    ):
        assert part in said


def test_growth_is_told_where_the_line_grows():
    lines = lines_left([compared(encoder=once_a_gear_turn(40e-6))] * 2, history([40e-6] * 4))
    assert "grows by" in sentence(RIG, lines, history([20e-6, 30e-6, 40e-6, 50e-6]))


@pytest.mark.parametrize("times", [0.5, 1.0, 2.0, 4.0])
def test_what_discs_within_twice_their_tolerance_make_is_no_content(times):
    assert lines_left([compared(encoder=once_a_gear_turn(times * DISC))] * 2, history([1e-6] * 4)) == ()


def test_mesh_lines_that_no_structure_within_tolerances_makes_are_content_of_the_accelerometer_or_its_path():
    far = np.array([0, 0, 0, 0, -3.0, 1.0, 2.0])
    lines = lines_left([compared(heard=far)] * 2, history([1e-6] * 4))
    assert {line.channel for line in lines} == {"acceleration"}
    assert "mount or direction" in sentence(RIG, lines, history([1e-6] * 4))
    near = 0.12 * far
    assert lines_left([compared(heard=near)] * 2, history([1e-6] * 4)) == ()


def test_lines_of_the_acceleration_at_turns_that_the_twin_does_not_predict_are_content():
    strong, weak = ((9.5, 2.5), (28.5, 1.0)), ((9.5, 0.3),)
    (first, second) = lines_left([compared()] * 2, history([1e-6] * 4, strong))
    assert (first.order, second.order) == (9.5, 28.5)
    assert "26 times a turn of the gear" in sentence(RIG, (first,), history([1e-6] * 4, strong))
    assert lines_left([compared()] * 2, history([1e-6] * 4, weak)) == ()


def test_a_torque_line_counts_from_a_fiftieth_of_the_torque():
    at = np.abs(ORDERS - 2.0) < 1e-9
    assert [o.order for o in lines_left([compared(torque=0.5 * at)] * 2, history([1e-6] * 4))] == [2.0]
    assert lines_left([compared(torque=0.1 * at)] * 2, history([1e-6] * 4)) == ()


def test_a_line_that_one_window_alone_is_compared_in_is_not_told():
    assert lines_left([compared(encoder=once_a_gear_turn(40e-6))], history([40e-6] * 4)) == ()


# ------------------------------------------------------------------------------------------ whole machines


@pytest.mark.slow
@pytest.mark.parametrize("name", ["load zone", "foreign modulation", "half of the mesh"])
def test_content_of_no_effect_is_told_by_its_order_or_frequency_and_under_no_other_name(name):
    rig, windows = windows_of(SHORT)
    given, s = spoiled(rig, windows, KINDS[name], 3)
    _, estimates = run(rig, given)
    report = estimates[-1].report
    assert not {e["name"] for e in report["effects"]} - {"unknown_effect"}
    assert report["unexplained"]["verdict"] == "unknown_effect" and is_right(KINDS[name], s, report)
