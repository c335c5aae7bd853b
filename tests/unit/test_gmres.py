"""Generalised minimal residuals on line spectra, and the direct solution of the low harmonics."""

import numpy as np
import pytest

from twin.dynamics.gmres import gmres
from twin.dynamics.low_harmonics import low_harmonic_inverse

RNG = np.random.default_rng(7)


def spectrum(n: int) -> np.ndarray:
    return np.fft.rfft(RNG.standard_normal(n)) / n


def test_operator_with_conjugates_is_solved():
    n = 12
    A, B = (RNG.standard_normal((n, n)) + 1j * RNG.standard_normal((n, n)) for _ in range(2))

    def apply(u):
        return 6 * u + 0.3 * A @ u + 0.3 * B @ u.conj()

    expected = RNG.standard_normal(n) + 1j * RNG.standard_normal(n)
    assert gmres(apply, apply(expected), 1e-13) == pytest.approx(expected, rel=1e-9)


def test_residual_meets_the_tolerance_and_no_more_steps_are_taken():
    steps = []

    def apply(u):
        steps.append(1)
        return np.linspace(1, 3, u.size) * u

    right = RNG.standard_normal(200) + 1j * RNG.standard_normal(200)
    u = gmres(apply, right, 1e-2)
    taken = len(steps)
    assert np.linalg.norm(right - apply(u)) <= 1e-2 * np.linalg.norm(right) * (1 + 1e-9)
    assert taken < 8


def test_nothing_to_solve_gives_nothing():
    assert np.array_equal(gmres(lambda u: u, np.zeros(4, dtype=complex), 1e-6), np.zeros(4))


def test_identity_is_solved_in_one_step():
    right = spectrum(64)
    assert gmres(lambda u: u, right, 1e-12) == pytest.approx(right, rel=1e-12)


def test_low_harmonics_are_inverted_exactly_where_the_operator_has_no_others():
    n, m = 256, 20
    stiffness, weight = RNG.standard_normal(n), 1 + 0.3 * RNG.standard_normal(n)
    ratio = np.ones(n // 2 + 1) + 0.2j * np.arange(n // 2 + 1) / n
    w = np.where(np.arange(n // 2 + 1) < m, 0.1 * spectrum(n) * n**0.5 + 0.05, 0)
    w[0] = 0.1

    def low(u):
        change = np.fft.irfft(w * u, n, norm="forward")
        out = np.fft.rfft(stiffness * change, norm="forward") + ratio * np.fft.rfft(weight * change, norm="forward")
        return u + np.where(np.arange(n // 2 + 1) < m, out, 0)

    inverse = low_harmonic_inverse([(np.ones(n // 2 + 1), stiffness), (ratio, weight)], w, m)
    u = spectrum(n)
    assert inverse(low(u)) == pytest.approx(u, rel=1e-9, abs=1e-12)
