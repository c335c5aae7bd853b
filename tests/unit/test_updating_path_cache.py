"""Wear paths are kept within a budget of memory, and machines that take turns do not drive each other out."""

from __future__ import annotations

import gc
import tracemalloc
from dataclasses import dataclass

import pytest

from tests.dynamics_cases import model
from twin.effects import EFFECTS
from twin.effects.extended import extend
from twin.model import Condition
from twin.updating.path_cache import PathCache
from twin.wear.path import WearPath

MB = 2**20


@dataclass
class Path:
    nbytes: int = 3 * MB


def new(kept: object) -> Path:
    assert kept is None
    return Path()


def turns(assets: int, budget: int, rounds: int = 40) -> float:
    """Share of the windows of machines in turn that find their path."""
    cache = PathCache(budget)
    for _ in range(rounds):
        for asset in range(assets):
            cache.get(asset, new)
    return 1 - cache.built / (assets * rounds)


def test_a_path_is_made_once():
    cache = PathCache()
    assert cache.get("a", new) is cache.get("a", new)
    assert cache.built == 1


def test_paths_stay_within_the_budget_also_when_they_grow():
    cache = PathCache(10 * MB)
    paths = [cache.get(i, new) for i in range(8)]
    assert cache.nbytes <= 10 * MB
    paths[-1].nbytes = 9 * MB
    cache.get(7, new)
    assert cache.nbytes <= 10 * MB and len(cache) == 1


def test_the_path_asked_for_is_kept_even_if_it_alone_is_beyond_the_budget():
    cache = PathCache(MB)
    assert cache.get("a", new) is cache.get("a", new)


@pytest.mark.parametrize(("assets", "least"), [(10, 0.97), (12, 0.4), (20, 0.08)])
def test_more_machines_than_fit_slow_down_gradually(assets, least):
    """Ten fit. With replacement by least recent use the twelfth made every window of every machine start anew."""
    assert turns(assets, 30 * MB) > least


def test_twelve_machines_fit_by_default():
    assert turns(12, PathCache().budget) == pytest.approx(1 - 1 / 40)


@pytest.mark.slow
@pytest.mark.parametrize("effects", [(), (EFFECTS["misalignment"](lead_gap=30e-6),)], ids=["plain", "sliced"])
def test_a_path_takes_the_memory_that_it_says(effects):
    """The budget is kept by what paths say of themselves; tracemalloc sees every array of numpy."""
    worn = extend(model(), effects)

    def made(speed_hz: float) -> WearPath:
        path = WearPath(worn, Condition(speed_hz=speed_hz, torque=10.0), worn.unworn, 100e-6)
        for depth in (3e-6, 9e-6, 15e-6):
            path.profile_at(depth)
        return path

    made(9.0)  # fills the caches that all paths share
    gc.collect()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        paths = [made(10.0 + 0.1 * k) for k in range(12)]
        gc.collect()
        taken = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    said = sum(path.nbytes for path in paths)
    assert 0.8 * taken < said < 1.25 * taken


def test_points_that_are_kept_elsewhere_are_taken():
    cache, taken = PathCache(), []
    cache.known = {"a": "points of a"}.get
    assert cache.find("a") is None
    assert cache.get("a", lambda kept: taken.append(kept) or Path()) is cache.get("a", new) is cache.find("a")
    assert taken == ["points of a"]
