"""Closed forms of statistics and transforms, against scipy.stats and scipy.signal, which a step does without."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import CZT, resample
from scipy.stats import multivariate_normal, rankdata

from twin.closed_forms import chirp_transform, log_density, ranks, resampled
from twin.roots import rising_roots

RANDOM = np.random.default_rng(5)
CAMPAIGN = Path(__file__).parents[2] / "recordings" / "short-campaign.mcap"
A_STEP = f"""
import sys
from pathlib import Path
from service.files.rig import rig_of
from service.stream.sources.mcap import Recording, read_windows
from twin.step import State, step
loaded = [name for name in ("scipy.stats", "scipy.signal") if name in sys.modules]
path = Path({str(CAMPAIGN)!r})
with Recording(path) as recording:
    rig = rig_of(recording, None)
state = State()
for window in read_windows(path)[2][:6]:
    state, _ = step(rig, state, window)
print(loaded, [name for name in ("scipy.stats", "scipy.signal") if name in sys.modules])
"""


def test_a_step_loads_neither_scipy_stats_nor_scipy_signal():
    """A third of the import of twin.step was theirs."""
    out = subprocess.run([sys.executable, "-c", A_STEP], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[] []"


def test_density_of_several_normal_variables_is_that_of_scipy():
    root = RANDOM.normal(size=(6, 6))
    covariance, rest = root @ root.T + np.eye(6), RANDOM.normal(size=(4, 6))
    assert log_density(rest, covariance) == pytest.approx(multivariate_normal.logpdf(rest, cov=covariance), rel=1e-12)
    assert log_density(rest[0], covariance) == pytest.approx(multivariate_normal.logpdf(rest[0], cov=covariance))


def test_ranks_share_their_mean_where_values_are_the_same():
    values = np.array([[3.0, 1.0, 3.0, 2.0, 3.0], [1.0, 1.0, 0.0, 5.0, 4.0]])
    assert ranks(values).tolist() == rankdata(values, axis=1).tolist()
    assert ranks(values[0]).tolist() == [4.0, 1.0, 4.0, 2.0, 4.0]


@pytest.mark.parametrize(("size", "count"), [(12, 30), (30, 12), (15, 32), (33, 15), (16, 16), (15, 15), (8, 9)])
def test_a_period_at_other_places_is_that_of_scipy(size, count):
    values = RANDOM.normal(size=size)
    assert resampled(values, count) == pytest.approx(resample(values, count), rel=1e-12, abs=1e-13)


@pytest.mark.parametrize(("size", "count", "first"), [(400, 90, 0), (90, 400, 1), (257, 257, 1)])
def test_chirp_transform_is_the_sum_itself_and_that_of_scipy(size, count, first):
    φ, values = 0.0137, RANDOM.normal(size=(2, size)) + 1j * RANDOM.normal(size=(2, size))
    found = chirp_transform(size, count, φ, first)(values)
    k, j = np.arange(count) + first, np.arange(size)
    exact = values @ np.exp(-1j * φ * np.outer(j, k))
    assert np.abs(found - exact).max() < 1e-11 * np.abs(exact).max()
    scipys = CZT(size, count, np.exp(-1j * φ), np.exp(1j * φ * first))(values)
    assert np.abs(found - scipys).max() < 1e-10 * np.abs(exact).max()


def test_roots_of_rising_functions_are_found_where_newtons_steps_alone_leave_the_bounds():
    targets = np.array([-0.999, -0.3, 0.0, 0.7, 0.999])
    far = np.full(targets.size, 9.0)  # where tanh is flat

    def excess(x):
        return np.tanh(x) - targets, 1 / np.cosh(x) ** 2

    assert rising_roots(excess, far, -10.0, 10.0) == pytest.approx(np.arctanh(targets), abs=1e-12)
