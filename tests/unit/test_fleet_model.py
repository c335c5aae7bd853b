"""The model of a fleet: what it answers where the answer can be stated by hand."""

import numpy as np
import pytest

from benchmarks.fleet_model import Costs, Model, Plan

COSTS = Costs(
    receive=0.02, commit=0.03, warm=np.array([0.05]), cold=np.array([2.0]), database=0.01, close=3.0, detect=5.0,
    restart=4.0, restart_wait=1.0,
)  # fmt: skip
PLAN = Plan(assets=8, period=100.0, partitions=4, nodes=4, cores=2, seconds=300.0)


def test_a_window_without_others_takes_the_sum_of_its_parts():
    result = Model(PLAN, COSTS).run()
    assert result.lags == pytest.approx(np.full(24, 3.0 + 0.02 + 0.01 + 0.05 + 0.03 + 0.01))


def test_all_windows_are_committed_once_though_a_node_is_lost():
    lost = Plan(**{name: getattr(PLAN, name) for name in PLAN.__slots__} | {"lose_at": 120.0, "lose": 1})
    result = Model(lost, COSTS).run()
    assert result.ended.size == 24
    assert np.unique(result.ended).size == 24
    assert result.served == pytest.approx(5.0 + 4.0 + 1.0)


def test_more_than_the_cores_can_do_waits():
    crowded = Plan(assets=1, period=0.02, partitions=1, nodes=1, cores=1, seconds=2.0)
    lags = Model(crowded, COSTS).run().lags
    assert lags[-1] > lags[0] + 5.0


def test_assets_that_are_not_at_hand_begin_with_a_cold_step():
    cold = Plan(assets=1, period=10.0, partitions=1, nodes=1, cores=1, seconds=30.0, warm_start=False)
    lags = Model(cold, COSTS).run().lags
    assert lags[0] - lags[1] == pytest.approx(2.0 - 0.05)
    assert lags[1] == pytest.approx(lags[2])
