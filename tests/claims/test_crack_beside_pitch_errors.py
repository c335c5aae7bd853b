"""A tooth that yields from one window to the next is found beside teeth that all change a little between windows."""

import numpy as np
import pytest

from tests.dynamics_cases import RIG
from twin.scales import Scales
from twin.tracing.detectors.crack import local_change
from twin.tracing.tooth_patterns import PATTERNS, Pattern

TEETH = (19, 52)
SCALES = Scales.of(RIG)


def wearing_in(gear, each, step=0.0, at=5, windows=8, seed=0, over=1):
    """A gear's lines with pitch errors that wear in; one tooth yields by a pulse from window `at` on.

    each  change of every tooth from window to window, rms over the turn [m]
    step  rms over the turn of what the tooth's yielding adds in the end [m]
    over  windows over which it yields, each by more than the one before
    """
    rng, z = np.random.default_rng(seed), TEETH[gear]
    m = np.array(PATTERNS.orders(gear, TEETH))
    turned = np.exp(-2j * np.pi * np.outer(m, np.arange(z)) / z)
    of_teeth = lambda size: _sized(turned @ rng.normal(size=z), size)  # noqa: E731
    lines, out = of_teeth(3e-6), []
    pulse = _sized(np.exp(-2j * np.pi * m * 7 / z) * np.exp(-0.5 * (m / (0.45 * z)) ** 2), step)
    for i in range(windows):
        yields = (i - at + 1) / (0.5 * over * (over + 1)) if at <= i < at + over else 0.0
        lines = lines + of_teeth(each) + yields * pulse
        out.append(Pattern(revolutions=500.0 * i, orders=m, lines=lines))
    return out, z


def _sized(lines, size):
    return size * lines / np.sqrt(0.5 * np.sum(np.abs(lines) ** 2))


def found(gear, *args, **how):
    seen, z = wearing_in(gear, *args, **how)
    change = local_change(seen, z, gear, SCALES)
    return None if change is None else change.window


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gear", "each", "step"), [(0, 0.4e-6, 1.0e-6), (1, 0.4e-6, 0.65e-6), (1, 0.25e-6, 0.5e-6), (1, 0.6e-6, 0.9e-6)]
)
def test_a_tooth_that_yields_beside_pitch_errors_that_wear_in_is_found_in_its_window(gear, each, step):
    """A step of 0.65 µm beside 0.4 µm of all teeth: three times the latter was asked for."""
    windows = [(found(gear, each, step, at=at, seed=seed), at) for at in (4, 5, 6) for seed in range(8)]
    assert np.mean([window == at for window, at in windows]) >= 0.75


@pytest.mark.slow
@pytest.mark.parametrize(("gear", "each", "step"), [(0, 0.03e-6, 0.45e-6), (0, 0.06e-6, 1.2e-6), (1, 0.05e-6, 0.5e-6)])
@pytest.mark.parametrize("over", [3, 4])
def test_a_tooth_that_yields_over_several_windows_is_found_with_the_window_in_which_it_begins(gear, each, step, over):
    """Every step of a growing crack is as local as the one before it: none of them is sudden against that."""
    windows = [(found(gear, each, step, at=at, seed=seed, over=over), at) for at in (2, 3) for seed in range(8)]
    assert np.mean([window is not None for window, _ in windows]) >= 0.75
    assert np.mean([window - at in (-1, 0, 1, 2) for window, at in windows if window is not None]) >= 0.75


@pytest.mark.slow
@pytest.mark.parametrize("gear", [0, 1])
@pytest.mark.parametrize("each", [0.1e-6, 0.4e-6, 1.0e-6])
def test_pitch_errors_that_wear_in_alone_are_hardly_ever_a_local_change(gear, each):
    """Of a pinion's random pitch errors, one in eight was a crack from the start."""
    assert sum(found(gear, each, seed=seed) is not None for seed in range(100)) <= 3
