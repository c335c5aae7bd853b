"""Impacts and modulations, by spectral kurtosis and envelope."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from service.files.import_recording import import_recording
from service.stream.sources.mcap import read_windows
from twin.errors import NotAvailable, ParameterError
from twin.features.envelope import Carrier, NearBins, kurtogram, modulations, strange_modulations, without_shaft_lines
from twin.features.extract import pinion_angle
from twin.features.resample import AngleSignal, on_angle
from twin.rig import Rig

TEETH = (19, 52)
PER_TURN, TURNS = 1280, 25.3


def on_grid(x, start=100.37):
    return AngleSignal(start=2 * np.pi * start, step=2 * np.pi / PER_TURN, values=x, usable=np.ones(x.size, dtype=bool))


def mesh(rng, n):
    """Mesh lines with sidebands."""
    θ = 2 * np.pi * (100.37 + np.arange(n) / PER_TURN)
    keys = [(19 * k + s, a / k) for k in range(1, 12) for s, a in ((0, 5.0), (1, 0.4), (-19 / 52, 0.6))]
    return sum(a * np.cos(o * θ + rng.uniform(0, 6)) for o, a in keys)


def bearing(rng, n, order, slip=0.01, height=3.0):
    """Impacts at an order of the shaft, with slip, ringing a mode at order 330."""
    at = np.cumsum((1 + slip * rng.standard_normal(int(2 * TURNS * order))) / order) * PER_TURN
    x = np.zeros(n)
    x[at[at < n - 1].astype(int)] = height
    r, w = 0.97, 2 * np.pi * 330 / PER_TURN
    return lfilter([1.0], [1.0, -2 * r * np.cos(w), r * r], x)


def test_a_bearing_defect_is_found_under_mesh_lines_with_its_rate_and_band():
    rng = np.random.default_rng(1)
    n = round(TURNS * PER_TURN)
    x = mesh(rng, n) + bearing(rng, n, 3.58) + rng.standard_normal(n)
    band, found = strange_modulations(on_grid(x), TEETH)
    assert band.low < 330 < band.high and band.deviation > 10
    assert found[0].shaft is None and found[0].false_alarm < 1e-4
    assert found[0].rate / max(1, round(found[0].rate / 3.58)) == pytest.approx(3.58, rel=0.01)


@pytest.mark.slow
def test_mesh_lines_and_noise_alone_hold_no_strange_modulation():
    # 60 records at 1e-2: three or more have probability 0.02
    n, alarms = round(TURNS * PER_TURN), 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        noise = lfilter([1.0], [1.0, -0.6], rng.standard_normal(n)) if seed % 2 else rng.standard_normal(n)
        _, found = strange_modulations(on_grid(mesh(rng, n) + noise), TEETH, false_alarm=1e-2)
        alarms += any(m.shaft is None for m in found)
    assert alarms < 3


def test_shaft_lines_are_taken_out_and_noise_is_left():
    rng = np.random.default_rng(2)
    n = round(TURNS * PER_TURN)
    noise = rng.standard_normal(n)
    rest = without_shaft_lines(on_grid(mesh(rng, n) + noise), TEETH)
    assert rest.values.std() == pytest.approx(1.0, rel=0.03)
    assert rest.turns == pytest.approx(0.7 * TURNS, rel=0.01)


def test_kurtosis_is_zero_for_noise_minus_one_for_a_line_and_greatest_where_impacts_ring():
    rng = np.random.default_rng(3)
    n = 32768
    noise = kurtogram(rng.standard_normal(n), PER_TURN)
    assert abs(np.mean([b.kurtosis for b in noise])) < 0.05
    assert np.sqrt(np.mean([b.deviation**2 for b in noise])) == pytest.approx(1.0, abs=0.35)
    line = kurtogram(np.cos(2 * np.pi * 0.2003 * np.arange(n)), 1.0, (0.19, 0.21))
    assert min(b.kurtosis for b in line if b.low < 0.2003 < b.high) == pytest.approx(-1, abs=0.02)
    best = kurtogram(bearing(rng, n, 3.58) + rng.standard_normal(n), PER_TURN)[0]
    assert best.low < 330 < best.high


def test_rate_and_its_uncertainty_are_those_of_the_scatter():
    t = np.arange(20000) / 2000
    errors = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        x = (1 + 0.3 * np.cos(2 * np.pi * 17.37 * t + seed)) * np.cos(2 * np.pi * 400.1 * t)
        found = modulations(Carrier(x + 0.3 * rng.standard_normal(t.size), 2000.0), (340.0, 460.0))
        errors.append((found[0].rate - 17.37) / found[0].rate_std)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.35  # 30 values: ± 13 %
    # |1 + m cos|² = 1 + m²/2 + 2m·cos + …
    assert found[0].depth == pytest.approx(0.6 / (1 + 0.045 + 0.3**2 * 120 / 1000), rel=0.15)


@pytest.mark.parametrize("n", [180, 4096, 50_021])
def test_power_between_two_bins_is_that_of_the_whole_sum(n):
    rng, k = np.random.default_rng(n), np.arange(n)
    bins = np.array([4, n // 7, n // 2 - 3])
    x = rng.standard_normal(n) * np.hanning(n) + np.cos(2 * np.pi * (bins[1] + 0.3) * k / n)
    offsets = np.array([[-1.0, -0.37, 0.0, 0.3, 1.0], [-0.9, 0.1, 0.2, 0.3, 0.4], [0.0, 0.5, 1.0, -0.5, -1.0]])
    found = NearBins(x, bins).power(offsets)
    for bin_, near, power in zip(bins, offsets, found, strict=True):
        whole = np.abs(np.exp(-2j * np.pi * np.outer(bin_ + near, k) / n) @ x)
        assert np.sqrt(power) == pytest.approx(whole, abs=1e-9 * np.abs(x).sum())


def test_bands_as_narrow_as_asked_for_are_left_out_and_the_others_are_the_same():
    x = np.random.default_rng(4).standard_normal(8192)
    every, wide = kurtogram(x, PER_TURN), kurtogram(x, PER_TURN, wider_than=50.0)
    assert wide == tuple(b for b in every if b.high - b.low > 50.0) and 0 < len(wide) < len(every)
    assert kurtogram(x, PER_TURN, wider_than=1e4) == ()


def test_modulations_by_a_shaft_carry_its_name():
    t = np.arange(20000) / 2000
    x = (1 + 0.3 * np.cos(2 * np.pi * 10 * t) + 0.2 * np.cos(2 * np.pi * 13.7 * t)) * np.cos(2 * np.pi * 400 * t)
    x += 0.1 * np.random.default_rng(0).standard_normal(t.size)
    found = modulations(Carrier(x, 2000.0), (340.0, 460.0), (("pinion", 10.0),))
    assert {round(m.rate, 1): m.shaft for m in found if m.over_floor > 1000} == {10.0: "pinion", 13.7: None}


def test_what_cannot_be_is_refused():
    with pytest.raises(ParameterError, match="band"):
        modulations(Carrier(np.ones(1000), 1000.0), (400.0, 600.0))
    with pytest.raises(NotAvailable, match="kurtogram"):
        kurtogram(np.ones(100), 100.0, (10.0, 20.0))


@pytest.mark.slow
@pytest.mark.shared
def test_the_measured_rig_is_modulated_at_39_58_hz_round_its_mesh_line(shared, tmp_path):
    folder = "spur-rig-28ch-2000rpm"
    mapping = Path(__file__).resolve().parents[2] / "recordings" / "mappings" / f"{folder}.toml"
    import_recording(mapping, tmp_path / "a.mcap", source=shared / "measured" / folder / "channels.npz")
    rig, _, (window,) = read_windows(tmp_path / "a.mcap")
    speed = pinion_angle(Rig.from_mapping(rig), window, window.accelerations).speed
    rates, stds = [], []
    for sensor in ("ch01", "ch11", "ch14", "ch20"):
        s = window.accelerations[sensor]
        found = modulations(Carrier(s.values, s.rate), (646.6, 886.6), (("pinion", speed), ("gear", speed / 2)))
        line = min(found, key=lambda m: abs(m.rate - 39.58))
        assert line.shaft is None and line.false_alarm < 1e-6
        rates.append(line.rate)
        stds.append(line.rate_std)
    assert rates == pytest.approx([39.58] * 4, abs=0.05)
    assert np.ptp(rates) < 6 * max(stds) < 0.05


def campaign(shared, name):
    rig, _, windows = read_windows(shared / "campaigns" / f"{name}.mcap")
    rig = Rig.from_mapping(rig)
    tracks = [pinion_angle(rig, w, w.accelerations) for w in windows]
    return [
        strange_modulations(on_angle(w.accelerations["y6"], t)[0], rig.teeth)
        for w, t in zip(windows, tracks, strict=True)
        if t.speed > 5
    ]


@pytest.mark.shared
@pytest.mark.parametrize("name", ["D00", "D13"])
def test_clean_campaigns_hold_no_modulation_but_the_shafts(shared, name):
    assert not [m for _, found in campaign(shared, name) for m in found if m.shaft is None]


@pytest.mark.shared
def test_a_crack_makes_impacts_from_its_onset_on(shared):
    kurtosis = [band.kurtosis for band, _ in campaign(shared, "D05")]
    assert min(kurtosis[4:]) > 2 * max(kurtosis[:4])
