"""An inspection beside the twin's own depth."""

from __future__ import annotations

import pytest

from service.results.inspections import compare

TREND = [
    {"revolutions": n, "depth_um": {"combined": {"median": d, "p05": 0.9 * d, "p95": 1.1 * d}}}
    for n, d in ((1000.0, 20.0), (2000.0, 40.0), (4000.0, 80.0))
]


def inspected(revolutions, depth, flank="combined", std=1.0):
    return compare({"revolutions": revolutions, "max_depth_um": depth, "flank": flank, "std_um": std}, TREND)


def test_twin_is_interpolated_in_revolutions():
    answer = inspected(3000.0, 57.0)
    assert answer["twin"]["max_depth_um"] == {
        "median": pytest.approx(60), "p05": pytest.approx(54), "p95": pytest.approx(66)
    }  # fmt: skip
    assert not answer["twin"]["extrapolated"]
    assert answer["difference_um"] == pytest.approx(3)
    assert answer["difference_percent"] == pytest.approx(100 * 3 / 57)
    assert answer["within_band"]


@pytest.mark.parametrize(("measured", "within"), [(53.9, False), (54.1, True), (65.9, True), (66.1, False)])
def test_band_decides_what_lies_within(measured, within):
    assert inspected(3000.0, measured)["within_band"] is within


@pytest.mark.parametrize(("revolutions", "depth"), [(500.0, 10.0), (6000.0, 120.0), (0.0, 0.0)])
def test_outside_the_windows_the_twin_is_extrapolated_and_says_so(revolutions, depth):
    answer = inspected(revolutions, 30.0)
    assert answer["twin"]["extrapolated"]
    assert answer["twin"]["max_depth_um"]["median"] == pytest.approx(depth)


def test_difference_in_standard_deviations_joins_inspection_and_twin():
    std = (66 - 54) / (2 * 1.6449)
    assert inspected(3000.0, 50.0, std=2.0)["difference_in_std"] == pytest.approx(10 / (std**2 + 4) ** 0.5)


def test_flank_that_the_twin_does_not_tell_is_not_available():
    answer = inspected(3000.0, 50.0, flank="gear")
    assert answer["twin"]["status"] == "not available" and "gear" in answer["twin"]["reason"]
    assert "difference_um" not in answer


def test_one_window_extrapolates_from_new_gears():
    answer = compare({"revolutions": 3000.0, "max_depth_um": 50.0, "flank": "combined", "std_um": 1.0}, TREND[:1])
    assert answer["twin"]["max_depth_um"]["median"] == pytest.approx(60)
    assert answer["twin"]["extrapolated"]
