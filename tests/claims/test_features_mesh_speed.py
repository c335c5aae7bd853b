"""Speed from mesh lines: found where it is, refused where the teeth are not the machine's."""

import numpy as np
import pytest

from twin.errors import NotAvailable
from twin.features.extract import extract
from twin.features.mesh_speed import mesh_speed, mesh_track
from twin.plausibility import mistakes_of
from twin.rig import Rig
from twin.windows import Samples, Window

RATE, Z1, Z2 = 12800.0, 29, 71


def machine(speed, seconds=5.0, seed=0, noise=0.3, wander=0.001, sidebands=0.3, foreign=2.0):
    """Two accelerometers: mesh lines, sidebands, a strong non-gear tone and noise; speed wanders slowly."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    θ = 2 * np.pi * speed * (t + wander / 2 * np.sin(2 * t))
    out = {}
    for name in ("a", "b"):
        modulation = 1 + sidebands * (
            np.cos(θ + rng.uniform(0, 6)) + np.cos(2 * θ) + np.cos(θ * Z1 / Z2 + rng.uniform(0, 6))
        )
        levels = rng.uniform(0.3, 1.5, 5)
        x = sum(a * np.cos(k * Z1 * θ + rng.uniform(0, 6)) for k, a in enumerate(levels, start=1)) * modulation
        x = x + foreign * np.cos(2 * np.pi * 713.7 * t) + noise * rng.standard_normal(t.size)
        out[name] = Samples(rate=RATE, start=0.0, values=x)
    middle = θ[(t > 0.1 * seconds) & (t < 0.9 * seconds)]
    return out, (middle[-1] - middle[0]) / (2 * np.pi * 0.8 * seconds)


@pytest.mark.parametrize("speed", [24.63, 25.0, 25.4])
@pytest.mark.parametrize("seconds", [2.5, 5.0, 10.0])
def test_speed_is_found_within_a_tenth_of_a_permille_of_the_truth(speed, seconds):
    signals, _ = machine(speed, seconds, wander=0.0)
    assert mesh_speed(signals, (Z1, Z2), 25.0).mesh_hz == pytest.approx(Z1 * speed, rel=1e-4)


def test_phase_follows_a_speed_that_wanders():
    signals, mean = machine(25.2, 10.0, wander=0.002)
    found = mesh_speed(signals, (Z1, Z2), 25.0)
    assert found.track.speed == pytest.approx(mean, rel=5e-4)
    assert found.track.speed_variation == pytest.approx(0.002 / np.sqrt(2), rel=0.2)


def test_one_sensor_and_no_sidebands_are_enough():
    signals, _ = machine(25.2, wander=0.0, sidebands=0.0)
    found = mesh_speed({"a": signals["a"]}, (Z1, Z2), 25.0)
    assert found.mesh_hz == pytest.approx(Z1 * 25.2, rel=1e-4)


@pytest.mark.parametrize("teeth", [(28, 71), (30, 71), (27, 60), (31, 80), (23, 46), (40, 71)])
def test_wrong_tooth_counts_do_not_hold(teeth):
    signals, _ = machine(25.2)
    with pytest.raises(NotAvailable, match="wrong tooth count"):
        mesh_speed(signals, teeth, 25.0)


def test_noise_alone_has_no_speed():
    rng = np.random.default_rng(4)
    for _ in range(10):
        noise = {"a": Samples(rate=RATE, start=0.0, values=rng.standard_normal(32000))}
        with pytest.raises(NotAvailable, match=r"no comb|sidebands"):
            mesh_speed(noise, (Z1, Z2), 25.0)


def test_a_sampling_rate_below_the_mesh_is_named():
    slow = {"a": Samples(rate=1000.0, start=0.0, values=np.random.default_rng(0).standard_normal(5000))}
    with pytest.raises(NotAvailable, match="725 Hz"):
        mesh_speed(slow, (Z1, Z2), 25.0)


def two_combs(apart, share=0.9, seconds=5.0, noise=0.2):
    """Lines at the multiples of two mesh frequencies, as sidebands of a carrier make them beside a planetary mesh."""
    t = np.arange(round(seconds * RATE)) / RATE
    rng = np.random.default_rng(7)
    out = {}
    for name in ("a", "b"):
        x = noise * rng.standard_normal(t.size)
        for k in range(1, 6):
            for factor, size in ((1.0, 1.0), (1 + apart, share)):
                x += size * np.cos(2 * np.pi * k * Z1 * 25.0 * factor * t + rng.uniform(0, 6))
        out[name] = Samples(rate=RATE, start=0.0, values=x)
    return out


@pytest.mark.parametrize("apart", [0.01, -0.008, 0.006])
def test_two_combs_within_a_per_cent_are_two_candidates_and_the_speed_carries_the_doubt(apart):
    found = mesh_speed(two_combs(apart), (Z1, 40), 25.0)
    true = {Z1 * 25.0, Z1 * 25.0 * (1 + apart)}
    seen = [found.mesh_hz, *found.rivals]
    assert len(found.rivals) == 1
    assert all(min(abs(f - one) for one in seen) < 1.0 for f in true)
    rig = Rig.from_mapping({
        "gears": {"pinion": {"teeth": Z1}, "gear": {"teeth": 40}}, "operating": {"pinion_speed_hz": 25.0},
    })  # fmt: skip
    track = mesh_track(rig, two_combs(apart))
    assert track.speed_std >= 0.4 * abs(apart) * 25.0 and "either may be the speed" in track.doubt
    window = Window(start_time_ns=0, accelerations=two_combs(apart))
    assert any("either may be the speed" in mistake.text for mistake in mistakes_of(rig, window))
    indicators = extract(rig, window).indicators
    assert "either may be the speed" in indicators["a"].doubt


@pytest.mark.parametrize("wander", [0.0, 0.001])
def test_one_comb_with_sidebands_is_one_candidate(wander):
    assert mesh_speed(machine(25.2, wander=wander)[0], (Z1, Z2), 25.0).rivals == ()
