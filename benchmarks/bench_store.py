"""The store with a long history and a short one, with many assets and few, and against SQLite and JSON alone.

    python -m benchmarks.bench_store [--short 2000] [--long 50000] [--few 200] [--many 10000] [--rounds 15]

Two databases are made by the same inserts, and each thing is done with them in turn, so that a machine that becomes
slower meanwhile makes the ratio no other. What it costs to fetch, unpack and parse the same rows by hand is the floor
of reading. Ends with 1 where a ratio of long to short, or of many to few, is above LIMIT.
"""

from __future__ import annotations

import argparse
import json
import sqlite3
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import zstandard
from sqlalchemy import insert

from benchmarks.bench_pipeline import Figure
from service.contract.finding import SEVERITY
from service.results.asset_list import Choice, Place
from service.results.asset_table import AssetTable
from service.results.json_columns import dump, seal
from service.results.schema import ASSETS, EVENTS, WINDOWS
from service.results.sql_store import SqlStore

LIMIT = 1.5
ASSET = "machine"
SPACING_NS = 600 * 10**9
AREAS = 20
TIMES = 20  # that a page is read: one takes less than a clock of processor time tells apart
RECORD = {
    "kind": "measurement", "start_time": "2026-01-01T00:00:00+00:00", "updated": False, "quality": "good",
    "rms_measured": 14.251, "rms_predicted": 14.183, "error_percent": -0.477, "speed_hz": 10.0, "torque_nm": 9.98,
    "mesh_bands": [1.0 / (k + 3) for k in range(40)], "notes": [], "faults": [],
}  # fmt: skip
FIGURES = {"depth_um": {f: {"median": 31.2, "p05": 29.9, "p95": 32.6} for f in ("combined", "pinion", "gear")}}


def made(path: Path, windows: int) -> SqlStore:
    """A store with so many windows of one asset, each with its event."""
    store = SqlStore(path)
    rows, events = [], []
    for n in range(windows):
        start = n * SPACING_NS
        row = {"asset": ASSET, "start_ns": start, "number": n, "epoch": 0, "seal": seal(start, n, 0)}
        record = {**RECORD, "index": n, "revolutions": 100.0 * n}
        rows.append({**row, "record": dump(record), "figures": dump(FIGURES)})
        events.append({"asset": ASSET, "kind": "window", "data": dump({}), "start_ns": start, "again_ns": start})
    counts = {"windows": windows, "updates": 0, "received_ns": 1, "epoch": 0}
    with store.database.transaction() as db:
        db.execute(insert(ASSETS), {"asset": ASSET, "label": ASSET, **counts, "seal": seal(*counts.values())})
        db.execute(insert(WINDOWS), rows)
        db.execute(insert(EVENTS), events)
    return store


def by_hand(path: Path, limit: int) -> list[Any]:
    """Records and figures of the first windows, with nothing but SQLite, Zstandard and JSON."""
    unpack = zstandard.ZstdDecompressor().decompress
    query = "SELECT record, figures FROM windows WHERE asset = ? ORDER BY number LIMIT ?"
    with closing(sqlite3.connect(path)) as db:
        return [tuple(json.loads(unpack(part)) for part in row) for row in db.execute(query, (ASSET, limit))]


def actions(store: SqlStore, windows: int) -> dict[str, Callable[[], object]]:
    """What is compared."""
    added = iter(range(windows, 2**62))

    def commit() -> object:
        n = next(added)
        record = {**RECORD, "index": n}
        given: dict[str, Any] = {"state": {"windows": n}, "report": {}, "received_ns": 1}
        return store.commit(ASSET, n * SPACING_NS, record=record, events=[("window", record)], **given)

    assert store.path is not None
    return {
        "commit of a window": commit,
        "1000 windows": lambda: store.windows(ASSET, -1, 1000),
        "1000 windows by hand": partial(by_hand, store.path, 1000),
        "100 windows in the middle": lambda: store.windows(ASSET, windows // 2, 100),
        "500 events": lambda: store.events(ASSET, 0, 500),
        "thinned to 100": lambda: store.windows(ASSET, -1, 101, -(-windows // 100)),
        "thinned to 1000": lambda: store.windows(ASSET, -1, 1001, -(-windows // 1000)),
        "epochs": lambda: store.epochs(ASSET),
        "assets of a start": lambda: AssetTable(store, most=None).load(),
    }


def plant(path: Path, assets: int) -> SqlStore:
    """A store with so many assets in AREAS areas, a tenth of them with an alarm."""
    store, rows = SqlStore(path), []
    for n in range(assets):
        level = "alarm" if n % 10 == 0 else "normal"
        name, area = f"line-{n % AREAS:02}.gb-{n:05}", f"line-{n % AREAS:02}"
        summary = json.dumps({"asset": name, "status": {"level": level, "reasons": []}, "data": "live"})
        shown = {"area": area, "level": level, "severity": SEVERITY.index(level), "words": name, "summary": summary}
        rows.append({"asset": name, "label": name, "windows": 0, "updates": 0, "epoch": 0, **shown})
    with store.database.transaction() as db:
        db.execute(insert(ASSETS), rows)
    return store


def lists(store: SqlStore, assets: int) -> dict[str, Callable[[], object]]:
    """Pages of the list, each of ten assets, so many TIMES."""
    table = AssetTable(store)
    middle = Place(severity=SEVERITY.index("normal"), asset=f"line-{AREAS // 2:02}")

    def page(**choice: Any) -> Callable[[], object]:
        chosen = Choice(limit=10, **choice)
        return lambda: [table.page(chosen) for _ in range(TIMES)]

    return {
        "first page of a list": page(),
        "page in the middle": page(after=middle),
        "page of an area": page(area="line-03"),
        "page of alarms": page(levels=("alarm",)),
        "page of those in use": page(retired=False),
    }


def compared(
    make: Callable[[Path, int], SqlStore], do: Callable[[SqlStore, int], dict[str, Callable[[], object]]],
    sizes: tuple[int, int], rounds: int,
) -> dict[str, tuple[float, float]]:  # fmt: skip
    """By action: its median time with a small and with a large store [s]."""
    with TemporaryDirectory() as folder, ExitStack() as stack:
        stores = [stack.enter_context(make(Path(folder) / f"{n}.sqlite", n)) for n in sizes]
        both = [do(store, n) for store, n in zip(stores, sizes, strict=True)]
        times: dict[str, tuple[list[float], list[float]]] = {name: ([], []) for name in both[0]}
        for turn in range(rounds + 1):
            for name, taken in times.items():
                for each, kept in zip(both, taken, strict=True):
                    begun = time.process_time()
                    each[name]()
                    if turn:  # the first warms up
                        kept.append(time.process_time() - begun)
        return {name: (median(a), median(b)) for name, (a, b) in times.items()}


def figures(found: dict[str, tuple[float, float]]) -> list[Figure]:
    """What is aimed at."""
    worst = max(b / a for a, b in found.values())
    return [Figure(what="store: a large one in comparison with a small one", value=worst, unit="times", aim=LIMIT)]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_store", description="Costs of the store.")
    parser.add_argument("--short", type=int, default=2000, help="windows of the short history")
    parser.add_argument("--long", type=int, default=50_000, help="windows of the long history")
    parser.add_argument("--few", type=int, default=200, help="assets of the short list")
    parser.add_argument("--many", type=int, default=10_000, help="assets of the long list")
    parser.add_argument("--rounds", type=int, default=15, help="how often each is timed")
    given = parser.parse_args()
    missed = []
    found = compared(made, actions, (given.short, given.long), given.rounds)
    pages = compared(plant, lists, (given.few, given.many), given.rounds)
    for table, sizes in ((found, (given.short, given.long)), (pages, (given.few, given.many))):
        print(f"{'processor time, median':28}{sizes[0]:>15} {sizes[1]:>15}   ratio")
        for name, (a, b) in table.items():
            print(f"{name:28}{1e3 * a:>13.2f} ms {1e3 * b:>13.2f} ms {b / a:>7.2f}")
            if b / a > LIMIT:
                missed.append(name)
    ratio = found["1000 windows"][1] / found["1000 windows by hand"][1]
    print(f"1000 windows, to SQLite, Zstandard and JSON by hand: {ratio:.2f}")
    for name in missed:
        print(f"missed: {name} takes more than {LIMIT:g} times as long with the larger store", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
