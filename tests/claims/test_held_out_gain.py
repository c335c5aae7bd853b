"""An effect stays where held-out windows are likelier with it, judged by the lines that it moves."""

from dataclasses import replace

import numpy as np
import pytest

from tests.mesh_pairs import UNSW_RIG
from twin.rig import Rig
from twin.scales import Scales
from twin.tracing.confirmation import CONFIRMATION_LIMITS
from twin.tracing.held_out_error import ChannelComparison, HeldOutComparison
from twin.tracing.held_out_gain import SCATTER, log_likelihood_ratio
from twin.tracing.scatter import MODELLED

RIG = Rig.from_mapping(UNSW_RIG)
SCALES = Scales.of(RIG)
SHAFTS = (1.0, 19 / 52)
ORDERS = np.array([1.0, 2.0, 19.0, 38.0])


def window(predicted, measured, channel="torque", std=1e-3):
    """One window with the lines of one channel."""
    lines = ChannelComparison(
        orders=ORDERS, measured=np.asarray(measured, dtype=complex), predicted=np.asarray(predicted, dtype=complex),
        std=np.full(ORDERS.size, std),
    )  # fmt: skip
    return HeldOutComparison(
        index=0, speed_hz=10.0, orders=ORDERS, measured=lines.measured, predicted=lines.predicted, std=lines.std,
        rms_measured=1.0, rms_predicted=1.0, error_left=0.0, error_measured=1.0, channels={channel: lines},
    )  # fmt: skip


MESH = np.array([0.0, 0.0, 3.0, 2.0])
RIPPLE = np.array([0.0, 0.2j, 0.0, 0.0])


def gain(share, model_error=0.0, channel="torque", seed=1):
    """Of a ripple fitted `share` times as large as it is, beside mesh lines whose phase the model has wrong [rad]."""
    noise = 1e-3 * np.random.default_rng(seed).normal(size=(2, ORDERS.size))
    measured = MESH * np.exp(1j * model_error) + RIPPLE + noise[0] + 1j * noise[1]
    without, present = window(MESH, measured, channel), window(MESH + share * RIPPLE, measured, channel)
    return log_likelihood_ratio(without, present, SHAFTS, SCALES)


def test_effect_pays_most_at_its_size_and_costs_where_it_points_away_or_is_far_too_large():
    gains = {share: gain(share) for share in (-1.0, 0.0, 0.5, 1.0, 1.5, 4.0)}
    assert gains[0.0] == 0
    assert max(gains, key=gains.get) == 1.0
    assert gains[1.0] > CONFIRMATION_LIMITS.least_gain
    assert gains[-1.0] < 0 and gains[4.0] < 0


def test_gain_of_one_line_is_that_of_complex_normal_densities():
    size, noise, floor = 0.2, 1e-3, SCATTER.weak_line * 3.0
    without, present = window(MESH, MESH + RIPPLE), window(MESH + RIPPLE, MESH + RIPPLE)
    before = 2 * noise**2 + floor**2
    after = before + (MODELLED * size) ** 2
    expected = size**2 / before + np.log(before / after)
    assert log_likelihood_ratio(without, present, SHAFTS, SCALES) == pytest.approx(expected, rel=1e-9)


def test_lines_that_an_effect_does_not_move_neither_help_nor_hide_it():
    assert gain(1.0, model_error=0.2) == pytest.approx(gain(1.0), rel=0.01)
    assert gain(-1.0, model_error=0.2) < 0, "the whole error is no larger by 1e-4 of it"


def test_run_out_within_what_a_disc_has_itself_proves_nothing_and_one_beyond_it_does():
    once = SCALES.once_per_turn[0]
    for size, proves in ((once, False), (10 * once, True)):
        run_out = np.array([size, 0, 0, 0], dtype=complex)
        mesh = 1e-6 * MESH
        without, present = (window(m, mesh + run_out, "transmission_error", 1e-9) for m in (mesh, mesh + run_out))
        assert (log_likelihood_ratio(without, present, SHAFTS, SCALES) > CONFIRMATION_LIMITS.least_gain) == proves


def test_chance_passes_the_limit_no_more_often_than_it_says():
    """A ripple fitted to the noise of other windows: of 4,000 healthy machines at most 1 % keep it."""
    rng = np.random.default_rng(2)
    kept = 0
    for _ in range(4000):
        first, second = (1e-2 * (rng.normal(size=4) + 1j * rng.normal(size=4)) for _ in range(2))
        weak = np.array([0.0, 1.0, 0.0, 0.0])
        without = window(0 * MESH, second, std=1e-2)
        present = replace(without, channels=window(weak * first, second, std=1e-2).channels)
        kept += log_likelihood_ratio(without, present, SHAFTS, SCALES) > CONFIRMATION_LIMITS.least_gain
    assert kept <= 0.01 * 4000
