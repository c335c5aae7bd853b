"""Tones steady in hertz, told from order lines by the wander of the speed."""

import json

import numpy as np
import pytest

from service.stream.sources.mcap import read_windows
from twin.features.angle import angle_track
from twin.features.extract import pinion_angle
from twin.features.tones import non_gear_tones, window_tones
from twin.rig import Rig
from twin.windows import Edges, Samples

TEETH = (19, 52)
BAND = (5.0, 2200.0)  # that tones are sought in [Hz]
RATE, SECONDS, SPEED = 6400.0, 2.5, 10.0


def machine(seed, tones=(), wander=1.5e-3, speed=SPEED, noise=0.1, colour=0.0, rate=RATE, strange=()):
    """A window of order lines, steady tones and noise of a shaft whose speed wanders; samples and angle."""
    rng = np.random.default_rng(seed)
    t = np.arange(-0.1, SECONDS + 0.1, 1 / rate)
    phase = rng.uniform(0, 2 * np.pi, 3)
    θ = 2 * np.pi * speed * t + sum(
        wander * np.sqrt(2 / 3) * speed / f * np.sin(2 * np.pi * f * t + p)
        for f, p in zip((0.43, 1.1, 1.9), phase, strict=True)
    )
    x = noise * rng.standard_normal(t.size)
    for n in range(1, t.size if colour else 0):
        x[n] += colour * x[n - 1]
    for k in range(1, 9):  # mesh lines with sidebands, pinion orders
        for o, a in ((19 * k, 3 / k), (19 * k + 1, 0.2), (19 * k - 19 / 52, 0.3), (k + 5, 0.1)):
            x += a * np.cos(o * θ + rng.uniform(0, 6))
    for o, a in strange:
        x += a * np.cos(o * θ + rng.uniform(0, 6))
    for f, a in tones:
        x += a * np.cos(2 * np.pi * f * t + rng.uniform(0, 6))
    keep = (t >= 0) & (t < SECONDS)
    edges = np.arange(int(θ[0] / (2 * np.pi) * 1024) + 1, int(θ[-1] / (2 * np.pi) * 1024))
    times = np.interp(edges * 2 * np.pi / 1024, θ, t)
    track = angle_track(Edges(per_rev=1024, first_index=int(edges[0]) + 10240, times=times))
    return Samples(rate=rate, start=float(t[keep][0]), values=x[keep]), track


def test_a_tone_on_a_shaft_order_is_found_by_its_steadiness():
    # 50.003 Hz is order 5 of the pinion to within a hundredth of a window's resolution
    found = window_tones(*machine(1, [(50.003, 1.0), (333.3, 0.5)]), TEETH, BAND)
    assert len(found) == 2
    for tone in found:
        truth, a = (50.003, 1.0) if tone.frequency < 100 else (333.3, 0.5)
        assert abs(tone.frequency - truth) < 4 * tone.frequency_std < 0.05
        assert abs(abs(tone.amplitude) - a) < 5 * tone.std
        assert tone.evidence > 10 and tone.false_alarm < 1e-6


@pytest.mark.slow
def test_uncertainties_are_those_of_the_scatter():
    errors = []
    for seed in range(24):
        (tone,) = window_tones(*machine(seed, [(333.3, 0.3)]), TEETH, BAND)
        errors.append(((tone.frequency - 333.3) / tone.frequency_std, (abs(tone.amplitude) - 0.3) / tone.std))
    f, a = np.sqrt(np.mean(np.square(errors), axis=0))
    assert 0.65 < f < 1.45 and 0.65 < a < 1.45  # 24 values: ± 14 %, and the misfit may widen them


@pytest.mark.slow
@pytest.mark.parametrize("colour", [0.0, 0.8])
def test_noise_and_order_lines_alone_give_no_tone(colour):
    # 40 records at 1e-2 each: 0.4 expected, three or more have probability 0.008
    alarms = sum(
        bool(window_tones(*machine(100 + seed, colour=colour, rate=3200.0), TEETH, BAND, false_alarm=1e-2))
        for seed in range(40)
    )
    assert alarms < 3


def test_at_a_steady_speed_nothing_is_claimed():
    windows = [window_tones(*machine(seed, [(50.0, 1.0)], wander=0.0), TEETH, BAND) for seed in (1, 2)]
    assert non_gear_tones(windows, [SECONDS] * 2) == ()


@pytest.mark.parametrize("wander", [1e-4, 3e-4, 1.5e-3])
def test_a_line_locked_to_the_angle_at_a_strange_order_is_no_foreign_tone(wander):
    windows = [window_tones(*machine(seed, strange=((7.31, 1.0),), wander=wander), TEETH, BAND) for seed in range(4)]
    assert non_gear_tones(windows, [SECONDS] * 4) == ()


def test_windows_together_are_surer_than_one_and_say_which_hold_the_tone():
    windows = [
        window_tones(*machine(seed, [(150.0, 0.2)] if seed > 1 else [], speed=10 + 0.03 * seed), TEETH, BAND)
        for seed in range(5)
    ]
    (tone,) = non_gear_tones(windows, [SECONDS] * 5)
    assert tone.frequency == pytest.approx(150.0, abs=0.01)
    assert [a is None for a in tone.amplitudes] == [True, True, False, False, False]
    assert tone.frequency_std < min(t.frequency_std for w in windows for t in w)
    assert tone.evidence > max(t.evidence for w in windows for t in w)


def campaign(shared, name):
    rig, _, windows = read_windows(shared / "campaigns" / f"{name}.mcap")
    rig = Rig.from_mapping(rig)
    found = [
        window_tones(w.accelerations["y6"], pinion_angle(rig, w, w.accelerations), rig.teeth, BAND) for w in windows
    ]
    return non_gear_tones(found, [w.duration for w in windows]), found


@pytest.mark.shared
def test_interference_in_a_campaign_is_found_from_its_onset_on(shared):
    together, windows = campaign(shared, "D08")
    truth = json.loads((shared / "campaigns" / "truth" / "D08.json").read_text())["windows"]
    active = [bool(w["effects_active"]) for w in truth]
    assert [round(t.frequency) for t in sorted(together, key=lambda t: t.frequency)] == [50, 150, 250]
    for tone, a in zip(sorted(together, key=lambda t: t.frequency), (3.0, 3.5, 2.0), strict=True):
        assert tone.frequency == pytest.approx(round(tone.frequency), abs=0.05)
        assert [x is not None for x in tone.amplitudes] == active
        assert [x for x in tone.amplitudes if x is not None] == pytest.approx([a] * sum(active), rel=0.005)
    # the mains themselves drift, all harmonics by the same share: 5e-4 in one window
    for window in windows[2:]:
        pitch = [t.frequency / round(t.frequency, -1) for t in window]
        assert np.ptp(pitch) < 3e-5


@pytest.mark.shared
@pytest.mark.parametrize("name", [f"D{i:02d}" for i in range(14) if i != 8])
def test_no_other_campaign_holds_a_foreign_tone(shared, name):
    assert campaign(shared, name)[0] == ()
