"""A spike is a sample that no filtered signal can hold; nothing that a machine does is one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from twin.features.despike import spikes, without_spikes
from twin.features.plausible import torque_contradiction
from twin.rig import Rig

RATE = 12800.0
RNG = np.random.default_rng(3)


@pytest.mark.parametrize("run", [1, 2])
@pytest.mark.parametrize("place", [0, 700, 1998])
def test_one_or_two_samples_far_beyond_all_others_are_spikes(run, place):
    values = 10 + 0.1 * RNG.standard_normal(2000)
    values[place : place + run] = 1e6
    assert np.flatnonzero(spikes(values)).tolist() == list(range(place, place + run))
    assert np.nanmean(without_spikes(values)) == pytest.approx(10, abs=0.02)


def test_samples_beside_a_gap_can_be_spikes():
    values = 10 + 0.1 * RNG.standard_normal(2000)
    values[100:110] = np.nan
    values[110] = 1e5
    assert np.flatnonzero(spikes(values)).tolist() == [110]


def test_an_impact_behind_an_anti_aliasing_filter_is_no_spike():
    for offset in np.linspace(0, 1, 11):
        impact = 1000 * np.sinc(0.9 * (np.arange(4000) - 2000 - offset))
        assert not spikes(impact + 0.1 * RNG.standard_normal(4000)).any()


def test_the_ringing_of_a_resonance_after_an_impact_is_no_spike():
    t = np.arange(4000) / RATE
    for f in (800.0, 3000.0, 5500.0):
        ring = np.where(t > 0.1, 500 * np.exp(-300 * (t - 0.1)) * np.sin(2 * np.pi * f * (t - 0.1)), 0.0)
        low = signal.sosfiltfilt(signal.butter(6, 0.8, output="sos"), ring)
        assert not spikes(low + 0.05 * RNG.standard_normal(t.size)).any()


def test_a_step_of_torque_and_steps_of_a_converter_are_no_spikes():
    step = np.where(np.arange(2000) < 1990, 0.0, 40.0) + 0.01 * RNG.standard_normal(2000)
    assert not spikes(step).any()
    coarse = np.full(2000, 10.0)
    coarse[RNG.integers(0, 2000, 40)] += 0.1
    assert not spikes(coarse).any()
    assert without_spikes(coarse) is coarse


def test_without_a_spike_the_very_same_values_come_back():
    values = RNG.standard_normal(500)
    assert without_spikes(values) is values
    assert not spikes(np.full(100, np.nan)).any() and not spikes(np.zeros(0)).any()


def test_a_torque_is_held_against_what_the_rig_file_states():
    rig = Rig.from_mapping({"operating": {"input_torque": 10.0, "calibration_points": [[2.0, 20.0]]}})
    assert torque_contradiction(rig, 79.0) is None and torque_contradiction(rig, -20.0) is None
    assert "4.05 times the largest" in torque_contradiction(rig, 81.0)
    assert torque_contradiction(Rig.from_mapping({}), 1e9) is None
