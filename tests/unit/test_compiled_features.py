"""The compiled kernels of the features against scipy, numpy and closed forms."""

import threading

import numpy as np
import pytest
from scipy import ndimage
from scipy.interpolate import PPoly

from twin import compiled
from twin.compiled import statistics
from twin.errors import NotAvailable, ParameterError
from twin.features import noise_floor as floors
from twin.features.noise_floor import noise_floor

RNG = np.random.default_rng(11)


@pytest.mark.parametrize("n", [1, 2, 3, 5, 6, 7, 40, 64, 65, 1000])
def test_quintic_splines_are_those_of_scipy_also_beyond_the_ends(n):
    values = RNG.standard_normal(n)
    at = np.concatenate((RNG.uniform(-2.5 * n, 3.5 * n, 500), np.arange(-n, 2 * n + 1.0), [1.9999, n - 3.5, n - 1.0]))
    found = compiled.quintic_coefficients(values)
    expected = ndimage.spline_filter1d(values, order=5, mode="mirror")
    assert found == pytest.approx(expected, abs=1e-13 * np.abs(expected).max())
    through = ndimage.map_coordinates(expected, at[np.newaxis], order=5, mode="mirror", prefilter=False)
    assert compiled.quintic_at(found, at) == pytest.approx(through, abs=2e-13 * np.abs(expected).max())


@pytest.mark.parametrize("n", [1, 2, 5, 64, 65, 1000])
@pytest.mark.parametrize("count", [1, 3, 4])
def test_four_splines_side_by_side_are_those_of_each_alone(n, count):
    records = [RNG.standard_normal(n) for _ in range(count)]
    splines = compiled.quintic_coefficients_of_four(records)
    at = RNG.uniform(-1.5 * n, 2.5 * n, (7, 301))
    means = compiled.quintic_means_of_four(splines, at)
    for k, values in enumerate(records):
        alone = compiled.quintic_coefficients(values)
        assert splines[:, k] == pytest.approx(alone, abs=1e-13 * np.abs(alone).max())
        expected = compiled.quintic_at(alone, at.ravel()).reshape(at.shape).mean(axis=0)
        assert means[k] == pytest.approx(expected, abs=1e-12 * np.abs(alone).max())
    assert np.isnan(compiled.quintic_means_of_four(splines, np.array([[0.0, np.nan]]))[0]).tolist() == [False, True]


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e6])
def test_moments_are_those_of_the_finite_values(offset, scale):
    values = offset * scale + scale * RNG.standard_t(5, 10_001)
    found = statistics.moments(np.concatenate(([np.nan, np.inf], values, [-np.inf])))
    d = values - values.mean()
    assert found.finite == values.size
    assert found.mean == pytest.approx(values.mean(), rel=1e-14, abs=1e-14 * scale)
    assert found.square == pytest.approx(np.mean(d**2), rel=1e-9)
    assert found.most == pytest.approx(np.abs(d).max(), rel=1e-9)
    assert found.kurtosis == pytest.approx(np.mean(d**4) / np.mean(d**2) ** 2, rel=1e-9)


def test_moments_of_one_value_and_of_none():
    assert statistics.moments(np.array([3.0, np.nan])) == (1, 3.0, 0.0, 0.0, 0.0)
    assert statistics.moments(np.array([np.nan])).finite == statistics.moments(np.empty(0)).finite == 0


def test_a_quintic_spline_passes_through_its_values_and_follows_a_sine_to_its_known_response():
    k, at = np.arange(400.0), np.linspace(150, 250, 977)
    spline = compiled.quintic_coefficients(np.sin(2 * np.pi * 0.05 * k))
    assert compiled.quintic_at(spline, k) == pytest.approx(np.sin(2 * np.pi * 0.05 * k), abs=1e-13)
    assert compiled.quintic_at(spline, at) == pytest.approx(np.sin(2 * np.pi * 0.05 * at), abs=1e-7)


def test_straight_lines_are_those_of_numpy():
    values = RNG.standard_normal(50)
    at = np.concatenate((RNG.uniform(-5, 55, 300), [0.0, 48.0, 49.0, np.inf, -np.inf]))
    assert compiled.linear_at(values, at) == pytest.approx(np.interp(at, np.arange(50), values), abs=1e-14)
    assert compiled.linear_at(np.array([3.0]), np.array([-1.0, 0.0, 2.0])) == pytest.approx(3.0)


def test_piecewise_cubics_are_those_of_scipy_in_any_order_of_places():
    knots, cubics = np.cumsum(RNG.uniform(0.5, 2, 13)), RNG.standard_normal((4, 12))
    at = np.concatenate((RNG.uniform(knots[0] - 1, knots[-1] + 1, 300), knots))
    value, slope = compiled.cubics_at(knots, cubics, at)
    expected = PPoly(cubics, knots)
    assert value == pytest.approx(expected(at), rel=1e-12, abs=1e-13)
    assert slope == pytest.approx(expected(at, 1), rel=1e-12, abs=1e-13)
    alone, none = compiled.cubics_at(knots, cubics, at, slopes=False)
    assert np.array_equal(alone, value) and none.size == 0


def test_lost_values_and_places_give_nan_and_nothing_else():
    spline = compiled.quintic_coefficients(RNG.standard_normal(30))
    at = np.array([3.5, np.nan, np.inf, -np.inf, 29.0])
    assert np.isnan(compiled.quintic_at(spline, at)).tolist() == [False, True, True, True, False]
    assert np.isnan(compiled.quintic_coefficients(np.array([1.0, np.nan, 2.0]))).all()
    assert np.isnan(compiled.linear_at(np.arange(5.0), at)).tolist() == [False, True, False, False, False]
    value, slope = compiled.cubics_at(np.arange(3.0), np.ones((4, 2)), np.array([np.nan, 0.0]))
    assert np.isnan([value[0], slope[0]]).all() and value[1] == slope[1] == 1.0
    assert compiled.quintic_coefficients(np.empty(0)).size == compiled.quintic_at(spline, np.empty(0)).size == 0


@pytest.mark.parametrize(
    "call",
    [
        lambda: compiled.quintic_coefficients(np.ones((2, 3))),
        lambda: compiled.quintic_at(np.empty(0), np.ones(3)),
        lambda: compiled.quintic_coefficients_of_four([np.ones(3), np.ones(4)]),
        lambda: compiled.quintic_coefficients_of_four(5 * [np.ones(3)]),
        lambda: compiled.quintic_means_of_four(np.ones((3, 3)), np.ones((2, 2))),
        lambda: compiled.quintic_means_of_four(np.ones((3, 4)), np.ones((0, 2))),
        lambda: compiled.linear_at(np.ones(3), np.ones((2, 2))),
        lambda: compiled.cubics_at(np.ones(1), np.ones((4, 0)), np.ones(3)),
        lambda: compiled.cubics_at(np.arange(4.0), np.ones((4, 2)), np.ones(3)),
        lambda: compiled.noise_floor(
            np.ones(50), np.zeros(49, dtype=bool), 20, least=5, bias=np.ones(21), first=(0.25, 1.0), clipped=1e-4,
            correlation=2.0, passes=4,
        ),
        lambda: compiled.noise_floor(
            np.ones(50), np.zeros(50, dtype=bool), 60, least=5, bias=np.ones(61), first=(0.25, 1.0), clipped=1e-4,
            correlation=2.0, passes=4,
        ),
    ],
)  # fmt: skip
def test_arrays_of_another_shape_are_refused(call):
    with pytest.raises(ParameterError):
        call()


def stated_floor(power, lines, block):
    """The floor as twin/features/noise_floor.py states it, by numpy; None where lines fill all."""
    size = min(block, power.size)
    starts = np.arange(0, power.size - size + 1, max(size // 2, 1))
    if starts[-1] != power.size - size:
        starts = np.append(starts, power.size - size)
    index = starts[:, None] + np.arange(size)
    out, quantile = lines, 0.25
    for _ in range(floors.PASSES):
        blocks = np.where(out[index] | ~np.isfinite(power[index]), np.nan, power[index])
        count = np.isfinite(blocks).sum(axis=1)
        good = count >= floors.LEAST_BINS
        if not good.any():
            return None
        bias = floors.median_bias(count[good]) if quantile == 0.5 else -np.log1p(-quantile)
        level = np.maximum(np.nanquantile(blocks[good], quantile, axis=1) / bias, np.finfo(float).tiny)
        floor = np.exp(np.interp(np.arange(power.size), index.mean(axis=1)[good], np.log(level)))
        freedom = np.log(2) ** 2 * np.median(count[good]) / floors.HANN_CORRELATION
        high = power > floor * floors.threshold(floors.CLIPPED, 1, freedom)
        out, quantile = lines | np.convolve(high, np.ones(3), "same").astype(bool), 0.5
    return floor, freedom


@pytest.mark.parametrize("n, block", [(24, 96), (96, 96), (97, 96), (144, 96), (1000, 96), (1013, 97), (20_000, 96)])
@pytest.mark.parametrize("case", ["noise", "lines", "known lines", "lost bins", "silence"])
def test_the_noise_floor_is_the_one_that_is_stated(n, block, case):
    power = RNG.exponential(size=n) * np.exp(np.cos(np.arange(n) / 300))
    known = np.zeros(n, dtype=bool)
    if case != "noise":
        power[::11] *= 300
    if case == "known lines":
        known[n // 3 : n // 2] = True
    if case == "lost bins":
        power[5 : n // 4] = np.nan
        power[n // 2] = np.inf
    if case == "silence":
        power[n // 4 :] = 0.0
    expected = stated_floor(power, known, block)
    if expected is None:
        with pytest.raises(NotAvailable, match="lines fill"):
            noise_floor(power, known, block)
        return
    found = noise_floor(power, known, block)
    assert found.power == pytest.approx(expected[0], rel=1e-11)
    assert found.freedom == pytest.approx(expected[1], rel=1e-14)


def test_kernels_of_the_features_may_run_in_threads_at_once():
    values = RNG.standard_normal(5000)
    at = np.sort(RNG.uniform(0, 4999, 5000))
    power = RNG.exponential(size=5000)
    expected = compiled.quintic_at(compiled.quintic_coefficients(values), at), noise_floor(power).power
    wrong = []

    def work():
        for _ in range(50):
            found = compiled.quintic_at(compiled.quintic_coefficients(values), at), noise_floor(power).power
            if not all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True)):
                wrong.append(found)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
