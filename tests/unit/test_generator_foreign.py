"""What shakes the housing without coming from the gears: each has its own mark, and is gone at size zero."""

import numpy as np
import pytest

from recordings.generator import SpecError
from recordings.generator.effects import EFFECTS
from recordings.generator.foreign import LevelModulation, OrderTone, RandomImpacts, Rub
from tests.generator_instances import knobs

RATE, SPEED = 12800.0, 11.0  # [Hz], [Hz]
TIME = np.arange(int(8 * RATE)) / RATE
ANGLE = 2 * np.pi * SPEED * TIME + 0.4
STILL = np.zeros(TIME.size)


def shaken(effect, acceleration=STILL, seed=1):
    return effect(acceleration, TIME, ANGLE, np.random.default_rng(seed))


def amplitude(values, frequency):
    return 2 * abs(np.mean(values * np.exp(-2j * np.pi * frequency * TIME)))


@pytest.mark.parametrize(
    "effect",
    [
        OrderTone(0.0, 7.5, 2),
        LevelModulation(0.0, 39.6),
        RandomImpacts(0.0, 8.0, 900.0, 0.03),
        Rub(0.0, 800, 3000, 0.3),
    ],
)
def test_of_size_zero_nothing_is_left(effect):
    acceleration = np.sin(2 * np.pi * 200 * TIME)
    assert np.array_equal(shaken(effect, acceleration), acceleration)


def test_a_belt_drives_its_tones_at_its_order_whatever_the_speed():
    out = shaken(OrderTone(2.0, 7.5, 2))
    assert amplitude(out, 7.5 * SPEED) == pytest.approx(2.0, rel=1e-3)
    assert amplitude(out, 15 * SPEED) == pytest.approx(1.0, rel=1e-3)
    assert amplitude(out, 7.0 * SPEED) < 0.01


def test_a_breathing_level_makes_sidebands_of_half_its_depth_and_no_line_of_its_own():
    carrier = 3.0 * np.sin(2 * np.pi * 209 * TIME)
    out = shaken(LevelModulation(0.3, 39.5), carrier)
    assert amplitude(out, 209) == pytest.approx(3.0, rel=1e-3)
    for side in (209 - 39.5, 209 + 39.5):
        assert amplitude(out, side) == pytest.approx(3.0 * 0.3 / 2, rel=1e-2)
    assert amplitude(out, 39.5) < 0.01


def test_impacts_come_at_their_rate_and_ring_at_their_frequency():
    out = shaken(RandomImpacts(20.0, 6.0, 1000.0, 0.03))
    loud = np.flatnonzero(abs(out) > 3.0)
    blows = 1 + np.sum(np.diff(loud) > 0.01 * RATE)
    assert 25 < blows < 75  # 48 expected; some overlap, some are too small
    spectrum = np.abs(np.fft.rfft(out))
    assert np.fft.rfftfreq(out.size, 1 / RATE)[spectrum.argmax()] == pytest.approx(1000, abs=60)
    assert 8 < abs(out).max() < 100


def test_impacts_keep_no_time_with_the_shaft():
    """Their energy folded over the turn is even, while that of a rub is not."""
    turn = (ANGLE % (2 * np.pi)) // (np.pi / 2)

    def unevenness(effect):
        energy = np.array([np.sum(shaken(effect)[turn == quarter] ** 2) for quarter in range(4)])
        return energy.max() / energy.sum()

    assert unevenness(RandomImpacts(5.0, 200.0, 1000.0, 0.03)) < 0.4
    assert unevenness(Rub(3.0, 800.0, 3000.0, 0.25)) > 0.45


def test_a_rub_is_noise_of_its_band_over_its_share_of_the_turn():
    out = shaken(Rub(3.0, 800.0, 3000.0, 0.25))
    away = np.cos(ANGLE) < np.cos(np.pi * 0.25) - 1e-9
    assert not np.any(out[away]) and np.mean(~away) == pytest.approx(0.25, abs=0.01)
    power = np.abs(np.fft.rfft(out)) ** 2
    f = np.fft.rfftfreq(out.size, 1 / RATE)
    assert power[(f > 600) & (f < 3600)].sum() > 0.85 * power.sum()
    assert amplitude(out, SPEED) < 0.1  # no tone at the shaft's turn: only its envelope knows it


@pytest.mark.parametrize("name", ["order_tone", "level_modulation", "random_impacts", "rub"])
def test_each_is_in_the_table_and_turns_the_knob_of_what_is_foreign(name):
    assert name in EFFECTS
    least = {
        "order_tone": {"amplitude": 1.0, "order": 3.4},
        "level_modulation": {"depth": 0.1, "frequency_hz": 30.0},
        "random_impacts": {"amplitude": 1.0, "rate_hz": 3.0, "frequency_hz": 900.0},
        "rub": {"amplitude": 1.0},
    }[name]
    assert len(knobs(name, **least).foreign) == 1


def test_a_crack_on_no_known_shaft_is_refused():
    with pytest.raises(SpecError, match="shaft = 'idler', must be 'pinion' or 'gear'"):
        knobs("tooth_crack", tooth=1, remaining_stiffness=0.5, shaft="idler")
