"""The list of ten thousand assets by pages; `benchmarks.bench_store` has what they cost."""

from __future__ import annotations

from dataclasses import replace

import pytest
import service_fakes as fakes
from test_asset_list import at

from service.results.asset_list import Choice
from service.results.asset_rows import put
from service.results.sql_store import SqlStore

ASSETS = 10_000
LEVELS = ("normal",) * 90 + ("no_verdict",) * 4 + ("watch",) * 3 + ("alarm",) * 2 + ("end_of_life",)


@pytest.fixture
def board(fleet_store, tmp_path):
    """What a front end shows of ten thousand assets in a hundred areas."""
    shown = fakes.WrittenTable(fleet_store)
    with SqlStore(tmp_path / "twin.sqlite") as one:
        written, patterns = fakes.WrittenTable(one), {}
        for number, level in enumerate(dict.fromkeys(LEVELS)):
            fakes.campaign(one, written, f"a{number}")
            fakes.take(one, written, f"a{number}", 20, 18100.0, report=at(level))
            patterns[level] = written.get(f"a{number}")
    snapshots = []
    for number in range(ASSETS):
        name = f"plant-{number % 10}.line-{number // 10 % 10}.gb-{number:05d}"
        pattern = patterns[LEVELS[(37 * number + number // 100) % 100]]
        snapshots.append(replace(pattern, asset=name, label=name))
    put(fleet_store.database, snapshots)
    return shown


def listed(board, **choice):
    return [summary["asset"] for summary in board.page(Choice(limit=100, **choice)).summaries]


@pytest.mark.slow
def test_pages_of_ten_thousand_assets_hold_each_once_the_most_severe_first(board):
    names, after, pages = [], None, 0
    while pages == 0 or after is not None:
        page = board.page(Choice(after=after, limit=100))
        names += [(summary["status"]["level"], summary["asset"]) for summary in page.summaries]
        after, pages = page.next, pages + 1
    assert pages == 100 and len(set(names)) == ASSETS
    assert [level for level, _ in names[:300]] == 100 * ["end_of_life"] + 200 * ["alarm"]
    assert names[:100] == sorted(names[:100])
    assert listed(board, area="plant-3.line-4") == [name for _, name in names if name.startswith("plant-3.line-4.")]
    assert listed(board, levels=("alarm",)) == [name for _, name in names[100:200]]
    assert listed(board, words=("gb-07345",)) == ["plant-5.line-4.gb-07345"]
    assert listed(board, retired=False) == [name for _, name in names[:100]]
    assert len(board.areas()) == 100 and sum(area["assets"] for area in board.areas()) == ASSETS
