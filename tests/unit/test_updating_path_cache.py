"""Wear paths are kept within a budget of memory, and machines that take turns do not drive each other out."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from twin.updating.path_cache import PathCache

MB = 2**20


@dataclass
class Path:
    nbytes: int = 3 * MB


def turns(assets: int, budget: int, rounds: int = 40) -> float:
    """Share of the windows of machines in turn that find their path."""
    cache = PathCache(budget)
    for _ in range(rounds):
        for asset in range(assets):
            cache.get(asset, Path)
    return 1 - cache.built / (assets * rounds)


def test_a_path_is_made_once():
    cache = PathCache()
    assert cache.get("a", Path) is cache.get("a", Path)
    assert cache.built == 1


def test_paths_stay_within_the_budget_also_when_they_grow():
    cache = PathCache(10 * MB)
    paths = [cache.get(i, Path) for i in range(8)]
    assert cache.nbytes <= 10 * MB
    paths[-1].nbytes = 9 * MB
    cache.get(7, Path)
    assert cache.nbytes <= 10 * MB and len(cache) == 1


def test_the_path_asked_for_is_kept_even_if_it_alone_is_beyond_the_budget():
    cache = PathCache(MB)
    assert cache.get("a", Path) is cache.get("a", Path)


@pytest.mark.parametrize(("assets", "least"), [(10, 0.97), (12, 0.4), (20, 0.08)])
def test_more_machines_than_fit_slow_down_gradually(assets, least):
    """Ten fit. With replacement by least recent use the twelfth made every window of every machine start anew."""
    assert turns(assets, 30 * MB) > least


def test_twelve_machines_fit_by_default():
    assert turns(12, PathCache().budget) == pytest.approx(1 - 1 / 40)
