"""Faults of the instruments, each against what it should do to a known signal; growth of effects."""

import numpy as np
import pytest

from recordings.generator.effects import EFFECTS, grown, knobs_at
from recordings.generator.foreign import DriftingTone, SecondMesh
from recordings.generator.sensor_faults import Clock, DiscLine, LooseAccelerometer, held, seen
from recordings.generator.sensors import mounted
from tests.generator_instances import knobs, pair

RATE = 51200.0
TIME = np.arange(int(2 * RATE)) / RATE


def rng(seed=1):
    return np.random.default_rng(seed)


def amplitude(values, frequency):
    return 2 * abs(np.mean(values * np.exp(-2j * np.pi * frequency * TIME[: values.size])))


def test_an_accelerometer_held_firmly_is_one_on_a_soft_mount():
    """The closed form of the linear mount, in a band where the damper counts little."""
    signal = np.sin(2 * np.pi * 600 * TIME) + 0.4 * np.sin(2 * np.pi * 1500 * TIME)
    frequency = np.full(TIME.size, 2500.0)
    out = held(signal, 1 / RATE, frequency, 0.03, 1e9)
    linear = mounted(signal, RATE, 2500.0, 0.03)
    assert np.std(out[20000:] - linear[20000:]) < 0.02 * linear.std()


def test_a_loose_accelerometer_rattles_only_where_it_is_loud():
    frequency = np.full(TIME.size, 2500.0)
    distortion = []
    for level in (1.0, 30.0):
        out = held(level * np.sin(2 * np.pi * 500 * TIME), 1 / RATE, frequency, 0.05, 20.0)[20480:]
        distortion.append(amplitude(out, 1000) / amplitude(out, 500))
    assert distortion[0] < 1e-3 and distortion[1] > 0.05


def test_every_window_finds_a_loose_accelerometer_otherwise():
    signal = np.sin(2 * np.pi * 500 * TIME)
    loose = LooseAccelerometer(2500.0, 0.05, 100.0, 0.3)
    random = rng()
    levels = [amplitude(loose(signal, 1 / RATE, random)[20000:], 500) for _ in range(4)]
    assert np.ptp(levels) > 0.03


@pytest.mark.slow
def test_a_clock_that_is_off_gives_the_signal_of_another_moment():
    values = np.sin(2 * np.pi * 300 * TIME)
    inside = slice(4000, -4000)
    late = Clock(shift=1e-3)(values, 1 / RATE, 0.0)
    assert late[inside] == pytest.approx(np.sin(2 * np.pi * 300 * (TIME[inside] + 1e-3)), abs=1e-4)
    drifting = Clock(drift=1e-5)(values, 1 / RATE, 100.0)
    expected = np.sin(2 * np.pi * 300 * (TIME[inside] + 1e-5 * (100 + TIME[inside])))
    assert drifting[inside] == pytest.approx(expected, abs=1e-4)
    assert Clock()(values, 1 / RATE, 5.0) is values


def test_a_lost_line_is_missed_once_a_turn_and_the_count_falls_behind():
    per_rev, first = 8, 2000
    times = np.arange(40) * 1e-3
    fault = DiscLine(3, False, 1.0, 0.0)
    number, at = seen(first, times, per_rev, [fault], rng())
    lost = np.flatnonzero((first + np.arange(40)) % per_rev == 3)
    assert len(at) == 35 and not np.isin(times[lost], at).any()
    assert number == first - first // per_rev  # 250 turns, one line of each; line 3 of the present one is to come


def test_a_doubled_line_is_counted_once_more_a_turn():
    number, at = seen(1600, np.arange(40) * 1e-3, 8, [DiscLine(3, True, 1.0, 100.0)], rng())
    assert len(at) == 45 and np.all(np.diff(at) > 0)
    assert number == 1600 + 100  # turns 100 … 199


def test_wrong_polarity_turns_the_sign_and_nothing_else():
    assert knobs("wrong_polarity").gain == -1.0


def test_a_drifting_tone_runs_through_the_frequencies_that_it_says():
    tone = DriftingTone(2.0, 300.0, 0.0, 0.1, 1)
    out = tone(np.zeros(TIME.size), TIME, TIME, rng())
    crossings = TIME[1:][(out[:-1] < 0) & (out[1:] >= 0)]
    found = 1 / np.diff(crossings)
    assert found[:5].mean() == pytest.approx(285, rel=5e-3) and found[-5:].mean() == pytest.approx(315, rel=5e-3)
    assert out.std() == pytest.approx(2 / np.sqrt(2), rel=1e-2)


def test_a_tone_lies_elsewhere_in_every_window_and_within_its_bounds():
    tone, random = DriftingTone(1.0, 300.0, 0.05, 0.0, 1), rng()
    found = []
    for _ in range(6):
        out = tone(np.zeros(TIME.size), TIME, TIME, random)
        found.append(np.argmax(np.abs(np.fft.rfft(out))) / 2)
    assert np.ptp(found) > 5 and min(found) >= 285 and max(found) <= 315


def test_another_machines_mesh_has_its_own_lines_and_sidebands():
    mesh = SecondMesh(3.0, 31, 20.0, 0.0, 0.4, 2)
    out = mesh(np.zeros(TIME.size), TIME, TIME, rng())
    assert amplitude(out, 620) == pytest.approx(3.0, rel=1e-2)
    assert amplitude(out, 1240) == pytest.approx(1.5, rel=1e-2)
    assert amplitude(out, 640) == pytest.approx(3.0 * 0.4 / 2, rel=1e-2)
    assert amplitude(out, 607) < 0.02


@pytest.mark.parametrize(("revolutions", "remaining"), [(100.0, 1.0), (200.0, 0.8), (300.0, 0.6), (900.0, 0.6)])
def test_a_crack_grows_evenly_from_its_onset(revolutions, remaining):
    row = {"name": "tooth_crack", "onset_revolutions": 100.0, "full_revolutions": 300.0, "tooth": 3, "shaft": "pinion"}
    told = grown(row | {"remaining_stiffness": 0.6}, revolutions)
    assert told["remaining_stiffness"] == pytest.approx(remaining)


def test_misalignment_that_sets_in_twice_adds_up():
    rows = tuple(
        {"name": "misalignment", "lead_um": lead, "onset_revolutions": onset, "full_revolutions": 0.0}
        for lead, onset in ((10.0, 0.0), (15.0, 500.0))
    )
    assert [knobs_at(rows, at, pair(), 1)[0].lead for at in (0.0, 600.0)] == pytest.approx([10e-6, 25e-6])


def test_what_grows_is_a_parameter_of_the_effect():
    for name, effect in EFFECTS.items():
        assert set(effect.grows) <= set(effect.parameters), name
