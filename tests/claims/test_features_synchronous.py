"""Shaft lines of several windows together, and what differs from tooth to tooth."""

import numpy as np
import pytest

from service.stream.sources.mcap import read_windows
from twin.errors import NotAvailable, ParameterError
from twin.features.extract import _base_radius, pinion_angle
from twin.features.resample import AngleSignal
from twin.features.synchronous import Reading, hunting_key, own_mesh_keys, sampled_reading, stack, tooth_keys
from twin.features.synchronous import transmission_error_reading as te_reading
from twin.features.teeth import constant_share, local_change, tooth_pattern
from twin.rig import Rig

TEETH = Z1, Z2 = 19, 52
CLOSE = [(0, 4, 0), (0, 0, 11), (0, 11, 0), (0, 0, 30)]  # orders 4, 4.019, 11, 10.962
TRUE = np.array([1.0, 0.5j, -0.3, 0.2 + 0.2j])
STARTS = (27.3, 1549.9, 3019.97, 4860.5, 6534.6)


def order(key):
    return key[0] * Z1 + key[1] + key[2] * Z1 / Z2


def reading(first_turn, keys, amplitudes, noise=0.0, rng=None, turns=25.1, per_turn=128):
    step = 2 * np.pi / per_turn
    angle = 2 * np.pi * first_turn + step * np.arange(round(turns * per_turn))
    x = np.real(np.exp(1j * np.outer(angle, [order(k) for k in keys])) @ amplitudes)
    if noise:
        x = x + noise * rng.standard_normal(angle.size)
    signal = AngleSignal(start=angle[0], step=step, values=x, usable=np.ones(angle.size, dtype=bool))
    return Reading(signal=signal, parts=lambda o: [(x, np.ones(len(o)))], unit="m")


def test_orders_a_fiftieth_apart_are_told_by_absolute_count():
    found = stack([reading(s, CLOSE, TRUE) for s in STARTS], CLOSE, TEETH)
    assert found.unresolved == ()
    assert np.abs(found.amplitudes - TRUE).max() < 1e-9


def test_covariance_is_that_of_the_scatter():
    rng = np.random.default_rng(3)
    z, spread = [], []
    for _ in range(40):
        found = stack([reading(s, CLOSE, TRUE, 0.2, rng) for s in STARTS], CLOSE, TEETH)
        Δ = found.amplitudes - TRUE
        x = np.concatenate((Δ.real, Δ.imag))
        z.append(x / np.sqrt(found.covariance.diagonal()))
        spread.append(x @ np.linalg.solve(found.covariance, x) / x.size)
    # 320 values: ± 4 %; the floor from 40 correlated bins a line adds bias of a few percent
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.15)
    assert np.mean(spread) == pytest.approx(1, abs=0.3)


def test_one_window_says_how_little_it_tells_of_close_orders():
    rng = np.random.default_rng(4)
    one = stack([reading(STARTS[0], CLOSE, TRUE, 0.2, rng)], CLOSE, TEETH)
    all_ = stack([reading(s, CLOSE, TRUE, 0.2, rng) for s in STARTS], CLOSE, TEETH)
    lone = np.median(one.noise)
    assert one.std((0, 4, 0)) > 1.7 * lone
    assert all_.std((0, 4, 0)) == pytest.approx(lone / np.sqrt(5), rel=0.4)


def test_what_cannot_be_told_is_named_unresolved():
    found = stack([reading(0.0, CLOSE, TRUE, turns=10.0)], CLOSE, TEETH)
    assert found.unresolved == ((0, 0, 11),)  # a fifth of a resolution step from order 4
    assert found.get((0, 0, 11)) is None and found.get((0, 11, 0)) is not None
    with pytest.raises(NotAvailable, match="no window"):
        stack([], CLOSE, TEETH)


def test_mesh_lines_that_grow_leave_shared_lines_alone():
    mesh = [(1, 0, 0), (1, 1, 0), (0, 0, 0)]
    windows = [reading(s, CLOSE + mesh, np.concatenate((TRUE, [1 + i, 0.1j * i, 5 - i]))) for i, s in enumerate(STARTS)]
    found = stack(windows, CLOSE, TEETH, own=mesh)
    assert np.abs(found.amplitudes - TRUE).max() < 1e-9
    for j, expected in enumerate((1 + np.arange(5), 0.1j * np.arange(5), 5 - np.arange(5))):
        column = found.own_amplitudes[:, found.own_keys.index(mesh[j])]
        assert np.abs(column - expected).max() < 1e-9


@pytest.mark.parametrize("teeth", [TEETH, (23, 46), (20, 52)])
def test_hunting_keys_are_multiples_of_the_hunting_frequency(teeth):
    turns = teeth[1] // np.gcd(*teeth)
    for multiple in (1, 2, 17, turns, 3 * turns + 5):
        _, p, g = hunting_key(multiple, teeth)
        assert p + g * teeth[0] / teeth[1] == pytest.approx(multiple / turns)


def test_hunting_lines_are_told_apart_by_absolute_count():
    keys = [hunting_key(n, TEETH) for n in (105, 106, 107)]
    found = stack([reading(s, keys, TRUE[:3]) for s in STARTS], keys, TEETH)
    assert found.unresolved == () and np.abs(found.amplitudes - TRUE[:3]).max() < 1e-8


def bump(tooth, height, highest=16):
    """Pinion lines of a change of one tooth pitch's length round a tooth."""
    m = np.arange(1, highest + 1)
    width = 2 * np.pi / Z1
    return [(0, int(i), 0) for i in m], height * width / np.pi * np.sinc(m * width / (2 * np.pi)) * np.exp(
        -2j * np.pi * m * tooth / Z1
    )


def test_a_cracked_tooth_shows_as_a_local_change_at_its_place():
    rng = np.random.default_rng(6)
    keys, amplitudes = bump(7, 1.0)
    base = rng.normal(size=16) * 0.05 + 0j
    before = stack([reading(s, keys, base, 0.05, rng) for s in STARTS[:2]], keys, TEETH)
    after = stack([reading(s, keys, base + amplitudes, 0.05, rng) for s in STARTS[2:]], keys, TEETH)
    change = local_change(before, after)
    assert change.tooth == 7 and change.share > max(0.8, change.share_if_spread)
    assert change.false_alarm < 1e-6 and change.peak > 0


def test_without_a_change_none_is_significant():
    rng = np.random.default_rng(7)
    keys, amplitudes = bump(7, 1.0)
    p = []
    for _ in range(20):
        a, b = (
            stack([reading(s, keys, amplitudes, 0.1, rng) for s in part], keys, TEETH)
            for part in (STARTS[:2], STARTS[2:])
        )
        p.append(local_change(a, b).false_alarm)
    assert min(p) > 1e-4 and 0.2 < np.mean(p) < 0.8


def test_a_pattern_over_the_teeth_is_given_back_tooth_by_tooth():
    rng = np.random.default_rng(8)
    heights = rng.normal(size=Z1)
    heights -= heights.mean()
    m = np.arange(1, 10)
    X = 2 / Z1 * np.exp(-2j * np.pi * np.outer(m, np.arange(Z1)) / Z1) @ heights
    keys = [(0, int(i), 0) for i in m]
    found = stack([reading(s, keys, X, 0.01, rng) for s in STARTS], keys, TEETH)
    pattern = tooth_pattern(found, "pinion")
    assert np.abs(pattern.values - heights).max() < 5 * pattern.std.max() < 0.01
    assert constant_share([pattern, pattern]) == pytest.approx(1)
    with pytest.raises(ParameterError, match="neither pinion nor gear"):
        tooth_pattern(found, "wheel")


def campaign(shared, name, windows=slice(None)):
    """Shaft lines of the transmission error of chosen windows, those at calibration speed left out."""
    rig, _, found = read_windows(shared / "campaigns" / f"{name}.mcap")
    rig = Rig.from_mapping(rig)
    pairs = [(w, pinion_angle(rig, w, w.accelerations)) for w in found]
    readings = [te_reading(w, t, rig.teeth, _base_radius(rig)) for w, t in pairs if t.speed > 5][windows]
    return stack(readings, tooth_keys(rig.teeth), rig.teeth, own_mesh_keys(rig.teeth))


@pytest.mark.shared
@pytest.mark.parametrize("name", ["D00", "D03", "D05"])
def test_graduation_of_the_encoders_stands_at_low_shaft_orders(shared, name):
    found = campaign(shared, name, slice(0, 1))  # unworn: wear differs from tooth to tooth, which adds to order 1
    assert 1.2e-6 < abs(found.get((0, 0, 1))) < 1.7e-6
    assert abs(found.get((0, 0, 2))) == pytest.approx(0.5e-6, abs=0.1e-6)
    assert abs(found.get((0, 1, 0))) == pytest.approx(0.5e-6, abs=0.1e-6)
    assert found.std((0, 0, 1)) < 0.005e-6


@pytest.mark.shared
@pytest.mark.parametrize(("name", "eccentricity"), [("D04", 90e-6), ("D07", 80e-6)])
def test_gear_eccentricity_is_the_line_at_the_gear_order(shared, name, eccentricity):
    # the encoder's own graduation, 1.5 µm at unknown phase, is on top
    assert abs(campaign(shared, name).get((0, 0, 1))) == pytest.approx(eccentricity, abs=1.7e-6)


@pytest.mark.shared
def test_the_crack_of_a_campaign_is_local_to_two_tooth_pitches_and_only_on_the_pinion(shared):
    before, after = campaign(shared, "D05", slice(0, 4)), campaign(shared, "D05", slice(4, 8))
    change = local_change(before, after)
    assert change.share > 0.82 and change.share > change.share_if_spread + 0.1
    other = local_change(before, after, "gear")
    assert other.share < other.share_if_spread + 0.1 and other.rms < 0.1 * change.rms


@pytest.mark.shared
@pytest.mark.parametrize("name", ["D00", "D03", "D04", "D07"])
def test_no_other_campaign_changes_as_locally_as_a_crack(shared, name):
    change = local_change(campaign(shared, name, slice(0, 3)), campaign(shared, name, slice(-3, None)))
    assert change.share < 0.6 and change.rms < 0.1e-6


@pytest.mark.shared
@pytest.mark.parametrize("name", ["D06", "D11"])
def test_pitch_errors_are_there_from_the_first_windows_and_stay(shared, name):
    first, last = campaign(shared, name, slice(0, 3)), campaign(shared, name, slice(-3, None))
    for gear in ("pinion", "gear"):
        patterns = [tooth_pattern(s, gear, 3) for s in (first, last)]
        assert constant_share(patterns) > 0.99
        assert patterns[0].values.std() > 0.8e-6  # clean: 0.05 µm
    assert tooth_pattern(campaign(shared, "D00", slice(0, 3)), "pinion", 3).values.std() < 0.1e-6


@pytest.mark.shared
def test_eccentricity_shows_as_gear_sidebands_of_the_acceleration(shared):
    sidebands = []
    for name in ("D03", "D04"):
        rig, _, windows = read_windows(shared / "campaigns" / f"{name}.mcap")
        rig = Rig.from_mapping(rig)
        window = next(w for w in windows if pinion_angle(rig, w, w.accelerations).speed > 5)
        read = sampled_reading(window.accelerations["y6"], pinion_angle(rig, window, window.accelerations), "m/s²")
        found = stack([read], [(k, 0, g) for k in (1, 2, 3) for g in (0, -1, 1)], rig.teeth)
        sidebands.append(sum(abs(found.get((k, 0, g))) for k in (1, 2, 3) for g in (-1, 1)))
    assert sidebands[1] > 10 * sidebands[0]
