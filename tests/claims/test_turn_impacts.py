"""Weak impacts once a turn are told by lines in phase at one angle, beyond what healthy recordings differ by."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from tests.claims.test_baseline import RATE, RIG, SHAFTS, SPEED, TEETH, healthy, machine, parts
from twin.baseline.diagnosis import diagnose
from twin.baseline.findings import compare
from twin.baseline.leaving_out import learn
from twin.baseline.reading import angle_of
from twin.baseline.turn_impact_findings import impacts_named, impacts_of
from twin.baseline.turn_impacts import own_lines, tail_evidence, turn_impacts
from twin.windows import Samples

RING_HZ, DECAY = 1120.0, 500.0


def struck(window, shaft, peak, angle=0.2, sensor="a"):
    """A window with impacts at an angle of a shaft that ring; the peak of one sensor's, half at the other [m/s²]."""
    track = angle_of(RIG, window)
    t = np.arange(int(0.02 * RATE)) / RATE
    ring = np.exp(-DECAY * t) * np.sin(2 * np.pi * RING_HZ * t)
    out = {}
    for name, samples in window.accelerations.items():
        first, last = (float(shaft) * θ / (2 * np.pi) for θ in (track.start, track.stop))
        turns = np.arange(np.ceil(first), np.floor(last) - 1) + angle
        places = np.rint((track.time(2 * np.pi * turns / float(shaft)) - samples.start) * RATE).astype(int)
        pulses = np.zeros(samples.values.size)
        pulses[places] = peak * (1 if name == sensor else 0.5)
        out[name] = replace(samples, values=samples.values + np.convolve(pulses, ring)[: pulses.size])
    return replace(window, accelerations=out)


def largest(window, baseline=None, **given):
    base = baseline or healthy()
    compared = compare(base, parts(window).whole)
    return turn_impacts(base, compared.reading, compared.expected, **given)


@pytest.mark.parametrize(("shaft", "where"), [(Fraction(1), "pinion"), (Fraction(*TEETH), "gear")])
def test_impacts_a_third_of_the_rms_high_are_named_with_their_shaft(shaft, where):
    window = machine(0.42, 99)
    peak = window.accelerations["a"].values.std() / 3
    found = diagnose(healthy(), [parts(struck(window, shaft, peak))])
    (effect,) = [e for e in found.effects if "deviation" in e.parameters]
    assert effect.name == "tooth_crack" and where in effect.detail
    assert effect.parameters["shaft_order"].value == pytest.approx(float(shaft))
    assert 0.25 * peak < effect.parameters["peak"].value < peak  # within the octave, without the lines of the mesh
    assert "coupling" in " ".join(effect.indistinguishable_from)


def test_impacts_keep_their_angle_of_the_shaft_wherever_the_zero_of_a_window_lies():
    shaft, angles = Fraction(1), []
    for seed in (99, 7, 23):
        window = machine(0.42, seed)
        θ = np.random.default_rng(seed).uniform(0, 12)  # turns at the window's start, as `machine` draws them
        track = angle_of(RIG, window)
        (one, *_) = largest(struck(window, shaft, 2.0, angle=(0.2 - θ + track.start / (2 * np.pi)) % 1))
        angles.append(one.angle)
    assert np.abs((np.array(angles) - angles[0] + 0.5) % 1 - 0.5).max() < 0.02


@pytest.mark.parametrize("load", [0.05, 0.3, 0.42, 0.7])
def test_healthy_machine_and_its_halves_have_no_impacts_once_a_turn(load):
    whole = machine(load, 50)
    half = replace(whole, accelerations={
        n: Samples(start=0.0, rate=RATE, values=s.values[: s.values.size // 2]) for n, s in whole.accelerations.items()
    })  # fmt: skip
    for window in (whole, half):
        assert largest(window)[0].deviation < 4


def test_half_a_recording_shows_the_impacts_of_the_whole():
    window = struck(machine(0.42, 99), Fraction(1), 1.5)
    half = replace(window, accelerations={
        n: Samples(start=0.0, rate=RATE, values=s.values[: s.values.size // 2]) for n, s in window.accelerations.items()
    })  # fmt: skip
    for one in (largest(window)[0], largest(half)[0]):
        assert one.shaft == 1 and one.deviation > 6


def test_neither_noise_nor_modulation_of_the_mesh_is_an_impact():
    rng, window = np.random.default_rng(3), machine(0.42, 99)
    noisy = replace(window, accelerations={
        n: replace(s, values=s.values + s.values.std() * rng.normal(size=s.values.size))
        for n, s in window.accelerations.items()
    })  # fmt: skip
    assert largest(noisy)[0].deviation < 4
    t = np.arange(int(8.0 * RATE)) / RATE
    turn = 2 * np.pi * SPEED * (1 - 0.0042) * t
    tone = sum(np.cos(k * TEETH[0] * turn) / k for k in (1, 2, 3))
    modulated = replace(window, accelerations={
        n: replace(s, values=s.values + 0.8 * np.cos(turn) * tone) for n, s in window.accelerations.items()
    })  # fmt: skip
    assert largest(modulated)[0].deviation < 4


def test_impact_that_the_healthy_machine_had_is_not_named_as_a_fault_where_it_has_gone():
    compared = compare(healthy(), parts(machine(0.42, 99)).whole)
    orders = np.arange(1, compared.expected.lines["a"].size + 1) / 3
    pulse = np.where(orders % 1 == 0, 0.05 * np.exp(-2j * np.pi * 0.3 * orders), 0)
    expected = replace(compared.expected, lines={n: x + pulse for n, x in compared.expected.lines.items()})
    gone = replace(compared, expected=expected)
    found = impacts_of(healthy(), [gone], [])
    assert found[0][0].shaft == 1 and found[0][0].deviation > 6 and not found[0][0].rises
    (effect,) = impacts_named(healthy(), [gone], found, [])
    assert effect.name == "unknown_effect" and "has gone" in effect.detail


def test_recording_that_was_learned_has_no_impacts_beside_its_own_baseline():
    base = healthy()
    one = base.readings[2]
    assert turn_impacts(base, one, base.expected(one))[0].deviation < 3


def test_four_recordings_are_too_few_and_changed_sensors_take_no_part():
    window = struck(machine(0.42, 99), Fraction(1), 2.0)
    few = learn(RIG, list(healthy().readings[:4]), SHAFTS)
    assert largest(window, few) == ()
    assert set(largest(window, unusable=["a"])[0].peak) == {"b"}
    assert largest(window, unusable=["a", "b"]) == ()


def test_evidence_is_what_random_phases_reach_by_chance():
    """(1 − t)^(N−1) for each of C channels: the sum S of their logarithms exceeds s with probability e^{−evidence}."""
    rng, N, C = np.random.default_rng(1), 30, 3
    z = rng.normal(size=(40_000, C, N)) + 1j * rng.normal(size=(40_000, C, N))
    T = np.abs(z.sum(axis=2)) ** 2 / (N * np.sum(np.abs(z) ** 2, axis=2))
    S = -(N - 1) * np.log1p(-T).sum(axis=1)
    for s in (2.0, 5.0, 8.0):
        assert np.mean(s < S) == pytest.approx(np.exp(-tail_evidence(s, C)), rel=0.1)


def test_lines_of_faster_shafts_and_those_about_the_mesh_are_left_out():
    k = own_lines(Fraction(2, 5), (Fraction(1), Fraction(2, 5)), 5, 20, (100, 250))
    order = k / 5
    assert np.all((order > 20) & (order <= 50))
    assert not np.any(order % 1 == 0)
    assert np.all(np.abs((order + 10) % 20 - 10) > 2.5)
