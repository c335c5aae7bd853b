"""Modulation of the mesh vibration by a shaft: its depth, kind and multiple in closed-form signals; none in noise."""

from pathlib import Path

import numpy as np
import pytest

from service.contract.parts import Modulation
from service.files.import_recording import import_recording
from service.report.lines import modulation_sentences
from service.stream.sources.mcap import read_windows
from tests.unit.test_step import minimal_rig
from twin.baseline.comparison import pair_shafts
from twin.baseline.leaving_out import learn
from twin.baseline.modulation import DEFAULT as LIMITS
from twin.baseline.modulation import against_baseline
from twin.baseline.reading import read
from twin.errors import WindowError
from twin.features.angle import angle_track
from twin.features.extract import pinion_angle
from twin.features.modulation import modulations
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.step import step
from twin.windows import Edges, Samples, Window

TEETH = (23, 57)
RATE = 12800.0
SPEED = 24.6
SECONDS = 12.0
TRUE = 2 * np.pi * 0.013  # angle at time zero


def angle_of(t, wander=0.002):
    """Pinion angle of a speed that wanders by a share."""
    return TRUE + 2 * np.pi * SPEED * (t + wander / (2 * np.pi * 0.2) * np.sin(2 * np.pi * 0.2 * t))


def window(depth=0.0, beta=0.0, shaft="pinion", multiple=1, noise=0.05, seed=1, per_rev=1, encoder=True, sign=1):
    """Mesh harmonics 1 to 4 of a 23/57 pair, modulated; an encoder's or a tachometer's edges."""
    t = np.arange(int(SECONDS * RATE)) / RATE
    θ = angle_of(t)
    turn = multiple * θ * (1 if shaft == "pinion" else TEETH[0] / TEETH[1])
    x = noise * np.random.default_rng(seed).normal(size=t.size)
    for k, a in ((1, 10.0), (2, 6.0), (3, 2.0), (4, 1.0)):
        x += a * (1 + depth * np.cos(turn - 0.7)) * np.cos(k * TEETH[0] * θ + beta * np.cos(turn - 0.3) + k)
    number = np.arange(np.ceil(θ[0] / (2 * np.pi) * per_rev), θ[-1] / (2 * np.pi) * per_rev)
    edges = {"pinion": Edges(per_rev=per_rev, first_index=0, times=np.interp(2 * np.pi * number / per_rev, θ, t))}
    return Window(
        start_time_ns=0,
        accelerations={"top": Samples(rate=RATE, start=0.0, values=sign * x)},
        encoders=edges if encoder else {},
    )


def found(w):
    return modulations(w.accelerations["top"], angle_track(w.encoders["pinion"]), TEETH, "top")


@pytest.mark.parametrize("per_rev", [1, 64])
@pytest.mark.parametrize("shaft", ["pinion", "gear"])
@pytest.mark.parametrize("multiple", [1, 2, 3])
@pytest.mark.parametrize("depth", [0.06, 0.15])
def test_depth_of_an_amplitude_modulation_is_that_of_the_signal(depth, multiple, shaft, per_rev):
    (one,) = found(window(depth, shaft=shaft, multiple=multiple, per_rev=per_rev))
    assert (one.shaft, one.multiple) == (shaft, multiple)
    assert one.depth == pytest.approx(depth, abs=4 * one.std + 0.01 * depth)
    assert one.std < 0.002
    assert one.amplitude_share > 0.98
    assert one.frequency == pytest.approx(multiple * SPEED * (1 if shaft == "pinion" else 23 / 57), rel=2e-3)
    assert {pair.harmonic for pair in one.pairs} >= {1, 2}


def test_phase_modulation_is_called_by_its_name():
    (one,) = found(window(beta=0.15))
    assert one.depth == pytest.approx(0.15, rel=0.02)
    assert one.amplitude_share < 0.02
    assert Modulation.of(one).kind == "phase"


def test_modulations_of_both_shafts_are_kept_apart():
    both = window(0.15)
    gear = window(0.12, shaft="gear", noise=0.0)
    values = both.accelerations["top"].values + gear.accelerations["top"].values
    w = Window(
        start_time_ns=0, encoders=both.encoders,
        accelerations={"top": Samples(rate=RATE, start=0.0, values=values / 2)},
    )  # fmt: skip
    pinion, other = found(w)
    assert (pinion.shaft, pinion.depth) == ("pinion", pytest.approx(0.075, rel=0.02))
    assert (other.shaft, other.depth) == ("gear", pytest.approx(0.06, rel=0.03))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("noise", [0.01, 1.0, 5.0])
def test_noise_alone_is_no_modulation(seed, noise):
    assert found(window(noise=noise, seed=seed)) == ()


def test_standard_deviation_is_the_scatter_over_repetitions():
    depths = [found(window(0.15, noise=2.0, seed=s))[0] for s in range(24)]
    scatter = np.std([m.depth for m in depths])
    assert scatter == pytest.approx(np.mean([m.std for m in depths]), rel=0.5)
    assert np.mean([m.depth for m in depths]) == pytest.approx(0.15, abs=3 * scatter / np.sqrt(24))


def test_polarity_of_the_sensor_changes_nothing():
    (one,), (turned,) = found(window(0.15)), found(window(0.15, sign=-1))
    assert turned.depth == pytest.approx(one.depth, rel=1e-9)


def test_mesh_lines_above_the_sampling_rate_are_refused_with_the_reason():
    w = window(0.15)
    slow = Samples(rate=RATE / 12, start=0.0, values=w.accelerations["top"].values[::12])
    with pytest.raises(WindowError, match=r"the mesh frequency lies above 0.45 of the sampling rate 1066.67 Hz"):
        modulations(slow, angle_track(w.encoders["pinion"]), TEETH, "top")


def rig():
    values = {"gears": {"pinion": {"teeth": 23}, "gear": {"teeth": 57}}, "operating": {"pinion_speed_hz": 24.6}}
    return Rig.from_mapping(values)


def test_sidebands_stronger_than_the_mesh_lines_are_not_called_a_modulation():
    one = Modulation.of(found(window(1.4))[0]).as_json()
    (said, _) = modulation_sentences([one])
    assert "more than a modulation can be" in said and "amplitude modulation" not in said


@pytest.mark.parametrize("encoder", [True, False])
def test_answer_names_sidebands_shaft_depth_and_possible_causes(encoder):
    _, assessment = step(rig(), State(), window(0.15, encoder=encoder), Options(trace=False))
    (one,) = assessment.modulation
    text = " ".join(modulation_sentences([Modulation.of(one).as_json()]))
    assert "Sidebands of ±1 × pinion speed (24.6" in text
    assert "mesh harmonic 1, 2, 3" in text and "amplitude modulation of 15" in text and "once per pinion turn" in text
    assert "run-out or eccentricity of the pinion" in text and "cannot be distinguished" in text
    assert "Healthy gears have sidebands, too" in text


def baseline_of(depths):
    """A baseline of windows with these depths, at speeds that differ a little."""
    readings = [read(rig(), window(d, seed=i), pair_shafts(rig()), f"healthy {i}") for i, d in enumerate(depths)]
    return learn(rig(), readings, pair_shafts(rig()))


@pytest.mark.slow
@pytest.mark.parametrize(("depth", "new"), [(0.15, True), (0.075, False)])
def test_modulation_deeper_than_in_the_healthy_baseline_is_new(depth, new):
    known = baseline_of([0.05, 0.06, 0.055, 0.06])
    (one,) = against_baseline(found(window(depth, seed=9)), known)
    assert one.new is new
    assert one.healthy == pytest.approx((0.05, 0.06), abs=2e-3)
    (said,) = modulation_sentences([Modulation.of(one).as_json()])
    assert ("new: 5 to 6 % in the healthy baseline" if new else "as before: 5 to 6 % in the healthy") in said


@pytest.mark.slow
def test_service_compares_modulation_with_its_baseline():
    known = baseline_of([0.05, 0.06, 0.055, 0.06])
    _, assessment = step(rig(), State(), window(0.15, seed=9), Options(trace=False, baseline=known))
    assert [(m.shaft, m.new) for m in assessment.modulation] == [("pinion", True)]


def test_healthy_simulated_machine_has_none_that_is_reported():
    _, _, windows = read_windows(Path("recordings/short-campaign.mcap"))
    rig = minimal_rig()
    for w in windows:
        track = pinion_angle(rig, w, w.accelerations)
        if track.speed < 5:  # the low-speed calibration: its mesh lines are hardly above the noise
            continue
        for name, samples in w.accelerations.items():
            assert modulations(samples, track, rig.teeth, name) == ()


LOADS = (0, 20, 30, 40, 60, 70, 80)


@pytest.mark.shared
@pytest.mark.slow
def test_no_modulation_of_a_healthy_measured_gearbox_is_new_and_some_with_a_broken_tooth_are(shared, tmp_path):
    folder = shared / "measured" / "spectraquest-broken-tooth"

    def depths(state, load):
        out = tmp_path / f"{state}{load}.mcap"
        mapping = Path("recordings/mappings/spectraquest-broken-tooth.toml")
        import_recording(mapping, out, source=folder / f"{state}30hz{load}.csv.gz")
        rig, _, (w, *_) = read_windows(out)
        rig = Rig.from_mapping(rig)
        track = pinion_angle(rig, w, w.accelerations)
        every = [m for name, s in w.accelerations.items() for m in modulations(s, track, rig.teeth, name)]
        return {(m.sensor, m.shaft, m.multiple): m.depth for m in every}

    def new(found, known):
        most = {key: max(k.get(key, 0.0) for k in known) for key in found}
        return [k for k, d in found.items() if d > LIMITS.ratio * most[k] and d > most[k] + LIMITS.more]

    healthy = [depths("h", load) for load in LOADS]
    for i, one in enumerate(healthy):
        assert new(one, healthy[:i] + healthy[i + 1 :]) == []
    broken = [new(depths("b", load), healthy) for load in LOADS]
    assert broken.count([("a1", "pinion", 1)]) == 3 and broken.count([]) == 4
