"""A window whose torque swings at an order of no shaft calibrates nothing: its mean is not the load of the teeth."""

from dataclasses import replace

import pytest

from tests.mesh_pairs import UNSW_RIG
from tests.stored_states import stored_state
from twin.features.channel_lines import LineReading
from twin.features.non_gear import NonGearFeatures
from twin.rig import Rig
from twin.updating.conditions import swing_of
from twin.updating.history import UpdateOptions, update_window
from twin.updating.memory import Memory

RIG = Rig.from_mapping(UNSW_RIG)
OPTIONS = UpdateOptions(threshold=0.05, update="fused", update_until=float("inf"))


def beside(size, order=0.625):
    reading = LineReading(
        order=order, frequency=10 * order, std=0.01, follows_angle=5.0, channels={"torque": (size, 0.0, 0.01)}
    )
    return NonGearFeatures(
        duration=5.0, speed_hz=10.0, tones=(), lines=(), kurtosis=None, rates=(), readings=(reading,)
    )


@pytest.mark.parametrize(("size", "order"), [(31.0, 0.625), (1.2, 0.37), (2.0, 4.31)])
def test_torque_that_swings_by_a_tenth_of_its_mean_does_not_stand_for_the_load(size, order):
    assert f"{size:.3g} N·m at order {order:.3g}" in swing_of(beside(size, order), 10.0)


def test_small_swing_an_unknown_torque_and_a_window_that_was_not_examined_say_nothing():
    assert swing_of(beside(0.5), 10.0) is None and swing_of(beside(5.0), None) is None and swing_of(None, 10.0) is None


def test_window_with_a_swing_calibrates_nothing():
    """Stiffness was calibrated to 1.32 and damping to 4.5 × by such windows."""
    window = stored_state("unsw-rig").tracing.history[0]
    steady = update_window(RIG, Memory(), window, OPTIONS)
    swinging = update_window(
        RIG, Memory(), replace(window, torque_fault=swing_of(beside(31.0), window.features.torque_nm)), OPTIONS
    )
    assert steady.memory.unworn and not swinging.memory.unworn
