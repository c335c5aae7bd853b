"""The list of ten thousand assets: every page costs the same, wherever it is."""

from __future__ import annotations

import statistics
import time
from dataclasses import replace

import pytest
import service_fakes as fakes
from test_asset_list import at

from service.results.asset_list import Choice
from service.results.asset_rows import put
from service.results.sql_store import SqlStore

ASSETS = 10_000
LEVELS = ("normal",) * 90 + ("no_verdict",) * 4 + ("watch",) * 3 + ("alarm",) * 2 + ("end_of_life",)
LONGEST = 0.05  # that a page may take here, on a busy machine [s]


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


def median_of(call, times=9):
    took = []
    for _ in range(times):
        began = time.perf_counter()
        call()
        took.append(time.perf_counter() - began)
    return statistics.median(took)


@pytest.mark.slow
def test_pages_of_ten_thousand_assets_take_milliseconds(board):
    names, after, last, pages = [], None, None, 0
    while pages == 0 or after is not None:
        page = board.page(Choice(after=after, limit=100))
        names += [(summary["status"]["level"], summary["asset"]) for summary in page.summaries]
        after, pages = page.next, pages + 1
        last = after or last
    assert pages == 100 and len(set(names)) == ASSETS
    assert [level for level, _ in names[:300]] == 100 * ["end_of_life"] + 200 * ["alarm"]
    assert names[:100] == sorted(names[:100])
    choices = {
        "the first page": Choice(limit=100),
        "the last page": Choice(limit=100, after=last),
        "of an area": Choice(limit=100, area="plant-3.line-4"),
        "alarms": Choice(limit=100, levels=("alarm",)),
        "in use": Choice(limit=100, retired=False),
        "a name": Choice(limit=100, words=("gb-07345",)),
        "a word of many": Choice(limit=100, words=("line-7",)),
    }
    took = {what: median_of(lambda choice=choice: board.page(choice)) for what, choice in choices.items()}
    took |= {"areas": median_of(board.areas), "levels": median_of(board.levels)}
    took["all at once"] = median_of(board.summaries, 1)
    print({what: f"{1000 * seconds:.1f} ms" for what, seconds in took.items()})
    assert all(seconds < LONGEST for what, seconds in took.items() if what not in ("areas", "all at once")), took
    assert len(board.areas()) == 100 and sum(area["assets"] for area in board.areas()) == ASSETS
