"""Impacts once a turn are told from errors of all teeth by how far the mean turn is one pulse."""

from fractions import Fraction

import numpy as np
import pytest

from twin.baseline.turn_pulses import shaft_of, turn_pulses

SHAFTS = (Fraction(1), Fraction(2, 5))
PERIOD, TEETH, COUNT = 5, 20, 500  # lines at k/5, up to order 100
BANDS = {"upper": (40.0, 80.0)}


def lines_at(shaft, values):
    out = np.zeros(COUNT, complex)
    k = np.arange(int(shaft * PERIOD), COUNT + 1, int(shaft * PERIOD))
    out[k - 1] = values[: k.size]
    return out


def test_lines_of_random_phases_have_the_kurtosis_of_noise():
    """|z|² of a sum of many lines is exponential: ⟨|z|⁴⟩/⟨|z|²⟩² = 2, a little less for few."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(200):
        values = np.exp(2j * np.pi * rng.uniform(size=COUNT))
        found.append(np.exp(turn_pulses(lines_at(SHAFTS[0], values), PERIOD, SHAFTS, TEETH, BANDS)[
            "pulse once a turn of order 1, upper"]))  # fmt: skip
    assert np.mean(found) == pytest.approx(2.0, rel=0.05)


def test_lines_in_phase_are_one_pulse_of_their_shaft_alone():
    """n lines in phase: ⟨|z|⁴⟩/⟨|z|²⟩² = (2n² + 1)/(3n), 23 for 34 lines; those left out at the mesh lower it."""
    n = np.arange(COUNT)
    pulse = lines_at(SHAFTS[1], np.exp(-2j * np.pi * 0.3 * n))
    rng = np.random.default_rng(2)
    noise = 0.01 * (rng.normal(size=COUNT) + 1j * rng.normal(size=COUNT))
    found = turn_pulses(pulse + noise, PERIOD, SHAFTS, TEETH, BANDS)
    of = {shaft_of(name): np.exp(value) for name, value in found.items()}
    lines = 100  # of the gear between 40 and 80 orders
    assert 0.4 * (2 * lines**2 + 1) / (3 * lines) < of[SHAFTS[1]] < (2 * lines**2 + 1) / (3 * lines)


def test_mesh_lines_and_their_first_sidebands_are_left_out():
    values = np.zeros(COUNT, complex)
    order = np.arange(1, COUNT + 1) / PERIOD
    values[np.isin(np.abs((order + 10) % 20 - 10), (0.0, 1.0))] = 100.0
    quiet = np.exp(2j * np.pi * np.random.default_rng(3).uniform(size=COUNT))
    with_mesh, without = (turn_pulses(x, PERIOD, SHAFTS, TEETH, BANDS) for x in (quiet + values, quiet))
    assert with_mesh["pulse once a turn of order 1, upper"] == pytest.approx(
        without["pulse once a turn of order 1, upper"]
    )


def test_bands_of_few_lines_are_left_out():
    assert turn_pulses(np.ones(COUNT, complex), PERIOD, SHAFTS, TEETH, {"narrow": (40.0, 45.0)}) == {}
