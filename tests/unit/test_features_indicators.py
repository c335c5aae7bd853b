"""Condition indicators of signals for which they are known in closed form."""

import numpy as np
import pytest

from twin.errors import ParameterError
from twin.features.indicators import (
    energy_operator,
    gear_condition_metrics,
    gear_signals,
    na4,
    normalised_moment,
)

Z, N = 19, 1216
θ = 2 * np.pi * np.arange(N) / N


def close(value, expected, **tolerance):
    return value == pytest.approx(expected, **tolerance)


def test_parts_add_up_to_the_average_without_its_mean():
    x = np.random.default_rng(0).standard_normal(N) + 3
    s = gear_signals(x, Z)
    assert s.regular + s.difference == pytest.approx(x - x.mean(), abs=1e-12)
    assert s.average == pytest.approx(x - x.mean(), abs=1e-12)
    orders = np.abs(np.fft.rfft(s.residual))
    assert orders[[1, Z, 2 * Z]].max() < 1e-9 and orders[[2, Z - 1, Z + 1]].min() > 1e-3
    assert np.abs(np.fft.rfft(s.difference))[[1, Z - 1, Z, Z + 1]].max() < 1e-9


def test_one_mesh_line_has_the_values_of_a_line():
    found = gear_condition_metrics(2 * np.cos(Z * θ), Z)
    assert close(found.RMS, np.sqrt(2))
    assert found.Kurtosis == pytest.approx(1.5)
    assert found.CrestFactor == pytest.approx(np.sqrt(2))
    assert close(found.FM0, 2.0)
    assert found.EnergyRatio == pytest.approx(0, abs=1e-12)
    assert found.SidebandRatio == pytest.approx(0, abs=1e-12)
    assert np.isnan(
        [found.FM4, found.M6A, found.M8A, found.NA4, found.EnergyOperator]
    ).all()  # nothing but rounding to judge


def test_moments_of_a_line_of_noise_and_of_a_spike():
    x = np.cos(7 * θ)
    assert [normalised_moment(x, h) for h in (2, 3, 4)] == pytest.approx([3 / 2, 5 / 2, 35 / 8])
    noise = np.random.default_rng(1).standard_normal(2_000_000)
    assert [normalised_moment(noise, h) for h in (2, 3, 4)] == pytest.approx([3, 15, 105], rel=0.03)
    spike = np.zeros(100_000)
    spike[5] = 1
    assert [normalised_moment(spike, h) for h in (2, 3, 4)] == pytest.approx([1e5, 1e10, 1e15], rel=1e-3)


def test_difference_signal_of_one_line_gives_fm4_and_energy_ratio():
    found = gear_condition_metrics(4 * np.cos(Z * θ) + 3 * np.cos(7 * θ + 0.3), Z)
    assert close(found.FM4, 1.5) and close(found.M6A, 2.5) and close(found.M8A, 35 / 8)
    assert found.EnergyRatio == pytest.approx(3 / 4)


def test_sidebands_of_amplitude_modulation():
    # (1 + 0.4 cos θ)·cos 19θ: two sidebands of 0.2 each
    x = (1 + 0.4 * np.cos(θ)) * np.cos(Z * θ)
    found = gear_condition_metrics(x, Z)
    assert found.SidebandRatio == pytest.approx(0.4)
    assert found.SidebandLevelFactor == pytest.approx(0.4 / np.sqrt(0.5 * (1 + 2 * 0.04)))
    assert close(found.FM0, np.ptp(x), rel=1e-12)
    # in the residual the two sidebands stay: 0.4·cos θ·cos 19θ, kurtosis (3/8)²/(1/4)² = 9/4
    assert close(found.NA4, 9 / 4)


def test_na4_grows_with_the_square_of_the_variance_where_fm4_does_not():
    r = np.random.default_rng(2).standard_normal(50_000)
    assert na4(r) == pytest.approx(normalised_moment(r, 2))
    # variance 1 before, 9 now: mean 5, so 81·3/25
    assert na4(3 * r, [r]) == pytest.approx(81 / 25 * normalised_moment(r, 2), rel=1e-9)


def test_energy_operator_of_two_lines():
    # ψ of cos aθ is constant; of a + b the cross terms vary as cosines: kurtosis of their sum, by its own definition
    a, b = 7, 11
    x = np.cos(a * θ) + np.cos(b * θ)
    δ = 2 * np.pi / N
    sines = np.sin(a * δ) ** 2 + np.sin(b * δ) ** 2
    # x_n² − x_{n−1}x_{n+1}, cross terms: 2·cA·cB − [cos A₋·cos B₊ + cos A₊·cos B₋]
    c = (1 - np.cos((a + b) * δ)) * np.cos((b - a) * θ) + (1 - np.cos((b - a) * δ)) * np.cos((a + b) * θ)
    assert energy_operator(x) == pytest.approx(normalised_moment(sines + c, 2), rel=1e-9)
    assert np.isnan(energy_operator(np.cos(7 * θ)))


def test_scale_changes_the_rms_alone():
    x = np.random.default_rng(3).standard_normal(N) + 2 * np.cos(Z * θ)
    a, b = gear_condition_metrics(x, Z), gear_condition_metrics(1e-6 * x, Z)
    assert close(b.RMS, 1e-6 * a.RMS)
    for name in ("Kurtosis", "FM0", "FM4", "M6A", "M8A", "NA4", "EnergyRatio", "EnergyOperator", "SidebandRatio"):
        assert getattr(b, name) == pytest.approx(getattr(a, name), rel=1e-9), name


def test_too_few_values_are_refused():
    with pytest.raises(ParameterError, match="at least 4 a tooth"):
        gear_condition_metrics(np.ones(40), Z)
