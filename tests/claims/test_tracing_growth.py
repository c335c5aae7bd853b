"""Sizes that grow, or change a second time, against laws in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest

from service.contract.parts import Growth
from twin.effects import EFFECTS
from twin.effects.size_law import CONSTANT, SizeLaw, factor_between, scaled
from twin.serial import from_plain, to_plain
from twin.tracing.attribution import AttributedEffect
from twin.tracing.crack_growth import growing, losses_by_window
from twin.tracing.gain_change import DRIFT, gain_change, gain_drift
from twin.tracing.growth import growth_of
from twin.tracing.mesh_trials import trial_of, with_law
from twin.tracing.size_laws import interval_std, law_fits
from twin.tracing.transfer_path import Quotient

TURNS = np.arange(1, 9) * 700.0
NOISE = 0.1
COVARIANCE = NOISE**2 * np.eye(TURNS.size)
RAMP = SizeLaw(kind="linear", revolutions=(5600.0,))
TAKEN_BACK = SizeLaw(kind="stepped", revolutions=(4000.0,), factors=(0.0,))


def friction(law=CONSTANT, **more):
    return AttributedEffect.of(
        EFFECTS["tooth_friction"](coefficient=0.1),
        onset=1400.0,
        law=law,
        parameters={"coefficient": (0.1, "", 0.01)},
        log_evidence=50.0,
        **more,
    )


def quotients(drift=0.0, onset=0.0, seed=1, shared=0.01, foreign=0.3):
    """Four lines in eight windows, each with its own offset: a common ramp, and what each window shares by chance.

    foreign  how far the path at a line lies from that of the model, as a logarithm
    """
    rng = np.random.default_rng(seed)
    offset, common = rng.normal(0, foreign, 4), shared * rng.normal(size=TURNS.size)
    ramp = drift * np.maximum(TURNS - onset, 0) / (TURNS[-1] - onset)
    return [
        Quotient(
            frequency=190.0 * (k + 1),
            log=complex(offset[k] + ramp[w] + common[w] + 0.01 * rng.normal(), 0.0),
            std=0.01,
            order=k + 1,
            revolutions=n,
        )
        for w, n in enumerate(TURNS)
        for k in range(4)
    ]


def test_size_grows_in_proportion_to_the_turns_since_the_onset():
    addition = friction(RAMP).addition
    assert addition.at(1000.0) is None and addition.at(1400.0) is None
    for n in (2000.0, 3500.0, 5600.0, 7000.0):
        assert addition.at(n).coefficient == pytest.approx(0.1 * (n - 1400) / (5600 - 1400))
    assert addition.at(1e6).coefficient == 0.3  # the bound of the parameter


def test_effect_that_is_taken_back_is_there_between_its_onset_and_then():
    addition = friction(TAKEN_BACK).addition
    there = [addition.at(n) is not None for n in (1000.0, 2000.0, 3999.0, 4000.0, 9000.0)]
    assert there == [False, True, True, False, False]
    assert addition.changes == (1400.0, 4000.0)


def test_factor_of_a_gain_is_one_of_its_logarithm():
    gain = EFFECTS["sensor_gain"](gain=1.21)
    assert scaled(gain, 0.5).gain == pytest.approx(1.1)
    assert factor_between(gain, EFFECTS["sensor_gain"](gain=1.1)) == pytest.approx(0.5)
    assert scaled(gain, 1.0) is gain


def test_an_effect_is_kept_with_its_law():
    for law in (CONSTANT, RAMP, TAKEN_BACK):
        item = friction(law, onset_std=200.0, change_std=(100.0, 0.1))
        assert from_plain(AttributedEffect, to_plain(item)) == item


def test_rate_of_a_ramp_is_recovered_within_its_standard_deviation():
    errors = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        sizes = 1.5 * np.maximum(TURNS - 2100, 0) / (TURNS[-1] - 2100) + NOISE * rng.normal(size=TURNS.size)
        fits = law_fits(TURNS, sizes, COVARIANCE, prior=1.0)
        assert fits["linear"].log_evidence > fits["constant"].log_evidence + np.log(100)
        errors.append((fits["linear"].sizes[0] - 1.5) / fits["linear"].std[0])
        assert abs(fits["linear"].onset - 2100) <= 3 * fits["linear"].onset_std
    assert np.mean(np.abs(errors) < 2) > 0.8


@pytest.mark.slow
def test_constant_size_has_no_rate_and_no_second_change():
    wrong = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        sizes = 1.0 * (TURNS > 2500) + NOISE * rng.normal(size=TURNS.size)
        fits = law_fits(TURNS, sizes, COVARIANCE, prior=1.0)
        over = max(fits[kind].log_evidence for kind in ("linear", "stepped")) - fits["constant"].log_evidence
        wrong += over > np.log(100)
    assert wrong <= 2  # of 200: Markov's inequality allows 1 in 100


def test_size_that_is_taken_back_or_doubles_is_told_with_its_time():
    for after in (0.0, 2.0):
        sizes = np.where(TURNS < 1000, 0.0, np.where(TURNS < 3700, 1.0, after))
        fits = law_fits(TURNS, sizes, COVARIANCE, prior=1.0)
        best = max(fits.values(), key=lambda f: f.log_evidence)
        assert best.kind == "stepped" and best.second == pytest.approx(3850.0) and best.onset == pytest.approx(1050.0)
        assert best.sizes == pytest.approx([1.0, after], abs=0.05)


def test_drift_of_the_gain_is_found_with_its_size():
    for seed in range(10):
        found = gain_change(quotients(0.3, seed=seed), 0.2)
        assert found is not None and found.law.kind == "linear"
        assert np.log(found.gain) == pytest.approx(0.3, abs=3 * found.std)


@pytest.mark.parametrize(("foreign", "drift"), [(1.0, 0.3), (1.5, -0.3), (2.5, 0.2)])
def test_drift_of_the_gain_is_found_on_a_structure_that_is_another_at_every_line(foreign, drift):
    for seed in range(10):
        found = gain_change(quotients(drift, seed=seed, foreign=foreign), 0.2)
        assert found is not None and found.law.kind == "linear"
        assert np.log(found.gain) == pytest.approx(drift, abs=3 * found.std)
        assert gain_drift(quotients(0.0, seed=seed, foreign=foreign), 0.2) is None


@pytest.mark.slow
@pytest.mark.parametrize("shared", [0.0, 0.02])
def test_constant_gain_does_not_drift(shared):
    alarms = sum(gain_drift(quotients(0.0, seed=seed, shared=shared), 0.2) is not None for seed in range(300))
    assert alarms == 0  # least_evidence allows 1 in 1000
    assert DRIFT.least_evidence == pytest.approx(np.log(1000))


def test_trial_is_as_large_in_each_window_as_its_law_says():
    trial = trial_of("tooth_friction")
    window = [SimpleNamespace(revolutions=n) for n in (1000.0, 2000.0, 5000.0)]
    ramp = with_law(trial, RAMP, 1400.0, [np.array([1.0])])
    assert ramp.at(np.array([1.0]), window[0]) is None
    assert ramp.at(np.array([1.0]), window[2]).coefficient == pytest.approx(0.1 * 3600 / 4200)
    twice = with_law(trial, TAKEN_BACK, 1400.0, [np.array([1.0]), np.array([0.5])])
    values = np.array([1.0, 0.5])
    assert [twice.at(values, w).coefficient for w in window[1:]] == pytest.approx([0.1, 0.05])
    assert twice.addition(values).law.factors == pytest.approx((0.5,))


def test_growth_is_reported_with_rate_and_size_at_the_latest_window():
    assert growth_of(friction(), 5600.0) is None
    grown = growth_of(friction(RAMP, onset_std=0.0), 3500.0)
    assert grown.size.value == pytest.approx(0.05) and grown.size.std == pytest.approx(0.005)
    assert grown.rate.value == pytest.approx(0.05 / 2100)
    stated = Growth.of(grown).as_json()
    assert stated["rate_per_million_revolutions"]["value"] == pytest.approx(0.05 / 2100 * 1e6)
    assert stated["law"] == "linear" and "second_change_at" not in stated
    gone = Growth.of(growth_of(friction(TAKEN_BACK, change_std=(100.0, 0.05)), 5600.0)).as_json()
    assert gone["size_at_latest_window"]["value"] == 0
    assert gone["second_change_at"] == {"value": 4000.0, "unit": "rev", "std": 100.0}
    assert gone["factor_after"]["value"] == 0


def responses(rng):
    """Lines of a gear that grow in proportion to q/(1 − q), as the further deflection of a softer pair does."""
    one = rng.normal(size=30) + 1j * rng.normal(size=30)
    return {q: one * q / (1 - q) for q in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)}


def test_growth_of_a_crack_is_recovered_with_onset_and_size():
    rng = np.random.default_rng(3)
    known = responses(rng)
    one = known[0.5]
    for onset, grows in ((2100.0, True), (2450.0, False)):
        ramp = 0.6 * np.maximum(TURNS - onset, 0) / (TURNS[-1] - onset) if grows else 0.5 * (onset < TURNS)
        lines = (ramp / (1 - ramp))[:, None] * one
        lines = lines + 0.02 * (rng.normal(size=lines.shape) + 1j * rng.normal(size=lines.shape))
        losses, std = losses_by_window(lines, known, noise=0.03, scatter=0.15)
        assert np.abs(losses - ramp).max() < 0.05
        found = growing(TURNS, losses, std)
        assert (found is not None) == grows
        if found is not None:
            assert found.sizes[0] == pytest.approx(0.6, abs=3 * found.std[0])
            assert found.onset == pytest.approx(onset, abs=2 * found.onset_std)


def test_onset_between_two_windows_is_known_to_their_interval():
    assert interval_std([700.0, 1400.0], 1050.0) == pytest.approx(700 / np.sqrt(12))
