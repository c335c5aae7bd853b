"""Condition indicators of signals for which they are known in closed form."""

import numpy as np
import pytest

from tests.mesh_pairs import UNSW_RIG
from twin.errors import ParameterError, WindowError
from twin.features.extract import extract
from twin.features.indicator_record import MOST_CONDITIONS, with_na4
from twin.features.indicators import (
    GearIndicators,
    SensorIndicators,
    gear_indicators,
    gear_signals,
    normalised_moments,
    sensor_indicators,
)
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.windows import Edges, Samples, Window

Z, N = 19, 1216
θ = 2 * np.pi * np.arange(N) / N
TEETH = {"gears": {"pinion": {"teeth": 19}, "gear": {"teeth": 52}}}


def samples(values, rate=12800.0):
    return Samples(rate=rate, start=0.0, values=np.asarray(values, float))


def test_parts_add_up_to_the_average_without_its_mean():
    x = np.random.default_rng(0).standard_normal(N) + 3
    s = gear_signals(x, Z)
    assert s.regular + s.difference == pytest.approx(x - x.mean(), abs=1e-12)
    assert s.average == pytest.approx(x - x.mean(), abs=1e-12)
    orders = np.abs(np.fft.rfft(s.residual))
    assert orders[[1, Z, 2 * Z]].max() < 1e-9 and orders[[2, Z - 1, Z + 1]].min() > 1e-3
    assert np.abs(np.fft.rfft(s.difference))[[1, Z - 1, Z, Z + 1]].max() < 1e-9


def test_a_pure_mesh_tone_leaves_no_difference_to_judge():
    found = gear_indicators(2 * np.cos(Z * θ), Z)
    assert found.fm0 == pytest.approx(2.0)
    assert found.energy_ratio == pytest.approx(0, abs=1e-12)
    assert found.sideband_level_factor == pytest.approx(0, abs=1e-12)
    assert (found.fm4, found.m6a, found.m8a) == (None, None, None)
    assert found.residual_moments == (0.0, 0.0)


def test_kurtosis_and_crest_factor_of_a_tone_are_three_halves_and_root_two():
    found = sensor_indicators(samples(2 * np.cos(Z * θ) + 7))
    assert found.rms == pytest.approx(np.sqrt(2))
    assert found.kurtosis == pytest.approx(1.5)
    assert found.crest_factor == pytest.approx(np.sqrt(2), rel=1e-4)


def test_gaussian_noise_has_kurtosis_3_and_moments_15_and_105():
    noise = np.random.default_rng(1).standard_normal(2_000_000)
    assert sensor_indicators(samples(noise)).kurtosis == pytest.approx(3, rel=0.01)
    assert normalised_moments(noise, (2, 3, 4)) == pytest.approx([3, 15, 105], rel=0.03)


def test_one_impulse_has_the_kurtosis_of_its_number_of_samples():
    impulse = np.zeros(100_000)
    impulse[5] = 1
    found = sensor_indicators(samples(impulse))
    assert found.kurtosis == pytest.approx(1e5, rel=1e-3)
    assert found.crest_factor == pytest.approx(np.sqrt(1e5), rel=1e-3)
    assert normalised_moments(impulse, (3, 4)) == pytest.approx([1e10, 1e15], rel=1e-3)


def test_one_line_in_the_difference_gives_fm4_of_three_halves_and_its_energy_ratio():
    found = gear_indicators(4 * np.cos(Z * θ) + 3 * np.cos(7 * θ + 0.3), Z)
    assert (found.fm4, found.m6a, found.m8a) == pytest.approx((3 / 2, 5 / 2, 35 / 8))
    assert found.energy_ratio == pytest.approx(3 / 4)


def test_amplitude_modulation_has_its_sideband_level():
    # (1 + 0.4 cos θ)·cos 19θ: two sidebands of 0.2 each
    x = (1 + 0.4 * np.cos(θ)) * np.cos(Z * θ)
    found = gear_indicators(x, Z)
    assert found.sideband_level_factor == pytest.approx(0.4 / np.sqrt(0.5 * (1 + 2 * 0.04)))
    assert found.fm0 == pytest.approx(np.ptp(x), rel=1e-12)
    # the residual keeps both sidebands, 0.4·cos θ·cos 19θ: variance 0.04, kurtosis (3/8)²/(1/4)² = 9/4
    variance, fourth = found.residual_moments
    assert variance == pytest.approx(0.04)
    assert fourth / variance**2 == pytest.approx(9 / 4)


def test_scale_changes_the_moments_with_a_unit_alone():
    x = np.random.default_rng(3).standard_normal(N) + 2 * np.cos(Z * θ)
    a, b = gear_indicators(x, Z), gear_indicators(1e-6 * x, Z)
    for name in ("fm0", "fm4", "m6a", "m8a", "energy_ratio", "sideband_level_factor"):
        assert getattr(b, name) == pytest.approx(getattr(a, name), rel=1e-9), name
    assert b.residual_moments[0] == pytest.approx(1e-12 * a.residual_moments[0])


def test_a_flat_signal_has_no_indicators_and_invents_none():
    found = sensor_indicators(samples(np.full(N, 3.0)))
    assert (found.rms, found.kurtosis, found.crest_factor) == (0.0, None, None)
    flat = gear_indicators(np.full(N, 3.0), Z)
    assert (flat.fm0, flat.fm4, flat.energy_ratio, flat.sideband_level_factor) == (None,) * 4


def test_too_few_values_a_tooth_and_no_valid_sample_are_refused():
    with pytest.raises(ParameterError, match="at least 4 a tooth"):
        gear_indicators(np.ones(40), Z)
    with pytest.raises(WindowError, match="not one of the channel's samples is valid"):
        sensor_indicators(samples([np.nan, np.nan]))


def window_of(signal, seconds=4.0, speed=10.0, encoders=("pinion",), sensors=("a",)):
    """A machine of 19/52 teeth at constant speed; `signal` of the pinion's angle."""
    t = np.arange(int(seconds * 12800)) / 12800
    edges = {
        "pinion": Edges(per_rev=256, first_index=0, times=np.arange(int(seconds * speed * 256)) / (256 * speed)),
    }
    return Window(
        start_time_ns=0,
        accelerations={name: samples(signal(2 * np.pi * speed * t)) for name in sensors},
        encoders={shaft: edges[shaft] for shaft in encoders},
    )


def test_a_window_has_the_indicators_of_both_gears_without_a_model_of_the_machine():
    def signal(angle):  # a pinion tooth that strikes once a turn, and the mesh
        return 3 * np.cos(19 * angle) + 2 * np.exp(-0.5 * ((angle % (2 * np.pi) - 2) / 0.02) ** 2)

    found = extract(Rig.from_mapping(TEETH), window_of(signal, sensors=("a", "b"))).indicators
    assert set(found) == {"a", "b"} and found["a"] == found["b"]
    pinion, gear = found["a"].gears["pinion"], found["a"].gears["gear"]
    assert pinion.turns in (38, 39, 40) and gear.turns in (13, 14)
    assert pinion.fm4 > 20  # an impulse, once a turn of the pinion
    assert pinion.m6a > pinion.fm4**1.5 and pinion.m8a > pinion.m6a
    assert gear.fm4 < 0.3 * pinion.fm4  # 52 pinion turns are 19 of the gear: the impulse lies anywhere on its turn


def test_without_an_angle_only_the_signal_s_own_indicators_are_there_with_the_reason():
    found = extract(Rig.from_mapping(TEETH), window_of(np.cos, encoders=())).indicators["a"]
    assert found.kurtosis == pytest.approx(1.5, rel=1e-3)
    assert found.gears == {} and set(found.unavailable) == {"pinion", "gear"}
    bare = extract(Rig.from_mapping({}), window_of(np.cos)).indicators["a"]
    assert bare.unavailable["gear"] == "the rig file does not give both numbers of teeth"


def test_too_few_turns_of_a_gear_are_named():
    found = extract(Rig.from_mapping(TEETH), window_of(lambda angle: np.cos(19 * angle), seconds=0.7)).indicators["a"]
    assert set(found.gears) == {"pinion"}
    assert found.unavailable["gear"].endswith("an average needs 3")


def features_with(variance, fourth=None, speed=10.0, torque=10.0, quality="good"):
    own = GearIndicators(
        turns=10,
        fm0=1.0,
        fm4=3.0,
        m6a=15.0,
        m8a=105.0,
        energy_ratio=0.1,
        sideband_level_factor=0.1,
        residual_moments=(variance, 3 * variance**2 if fourth is None else fourth),
    )
    sensor = SensorIndicators(rms=1.0, kurtosis=3.0, crest_factor=4.0, gears={"pinion": own})
    return WindowFeatures(
        start_time_ns=0, duration=1.0, quality=quality, speed_hz=speed, torque_nm=torque, indicators={"a": sensor}
    )


def na4_of(records, features):
    records, found = with_na4(records, features)
    return records, found["a"].gears["pinion"].na4


def test_na4_is_the_residual_s_kurtosis_in_the_first_window_and_grows_with_its_variance_later():
    records, first = na4_of((), features_with(1.0))
    assert first == pytest.approx(3)
    # variance 1 before, 9 now: mean 5, so 3·81/25
    records, second = na4_of(records, features_with(9.0))
    assert second == pytest.approx(3 * 81 / 25)
    assert records[0].windows == 2 and records[0].mean_variance == pytest.approx(5)


def test_na4_compares_windows_of_one_speed_and_torque_only():
    records, _ = na4_of((), features_with(1.0))
    records, other = na4_of(records, features_with(100.0, speed=20.0))
    assert other == pytest.approx(3)
    records, other = na4_of(records, features_with(100.0, torque=20.0))
    assert other == pytest.approx(3)
    assert len(records) == 3
    records, same = na4_of(records, features_with(1.0, speed=10.3, torque=10.5))
    assert same == pytest.approx(3) and len(records) == 3


def test_a_degraded_window_is_compared_and_does_not_enter_the_record():
    records, _ = na4_of((), features_with(1.0))
    after, na4 = na4_of(records, features_with(9.0, quality="degraded"))
    assert na4 == pytest.approx(3 * 81 / 25) and after == records


def test_the_record_is_bounded_and_keeps_the_conditions_used_last():
    records = ()
    for i in range(MOST_CONDITIONS + 3):
        records, _ = na4_of(records, features_with(1.0, speed=10.0 * 1.2**i))
    assert len(records) == MOST_CONDITIONS
    assert records[-1].speed == pytest.approx(10.0 * 1.2 ** (MOST_CONDITIONS + 2))


def test_a_window_has_indicators():
    assert extract(Rig.from_mapping(UNSW_RIG), window_of(np.cos)).indicators
