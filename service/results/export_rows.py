"""Results as tables for other programs: CSV, JSON Lines or Parquet, an asset and a span of time at a time."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

from service.file_faults import whole_file
from service.json_text import plain
from service.results.sql_store import SqlStore

PAGE = 1000  # rows that are held in memory
BANDS = ("median", "p05", "p95")
FLANKS = ("combined", "pinion", "gear")
RECORD = (
    "index", "kind", "quality", "start_time", "revolutions", "speed_hz", "torque_nm", "rms_measured", "rms_predicted",
    "error_percent", "updated", "rms_after", "k_wear_per_n", "wear_depth_um",
)  # fmt: skip
WINDOW_COLUMNS = (
    "asset", "epoch", "start_ns", *RECORD,
    *(f"depth_um_{flank}_{band}" for flank in FLANKS for band in BANDS),
    *(f"rul_{unit}_{band}" for unit in ("hours", "revolutions") for band in BANDS),
)  # fmt: skip
EVENT_COLUMNS = ("asset", "id", "kind", "data")
WHAT: dict[str, tuple[str, ...]] = {"windows": WINDOW_COLUMNS, "events": EVENT_COLUMNS}
"""Kinds of rows that can be exported, and their columns."""


def export(
    store: SqlStore, out: Path, form: str, *, what: str, assets: Mapping[str, str], begin_ns: int, end_ns: int
) -> int:
    """Writes the rows of some assets to a file; how many. A span of time counts for windows, by their start [ns].

    assets  what each is called, by its id
    """
    rows = (
        {"asset": name, **row}
        for asset, name in sorted(assets.items(), key=lambda item: item[1])
        for row in _rows(store, asset, what, begin_ns, end_ns)
    )
    with whole_file(out) as unfinished:
        return FORMS[form](rows, unfinished, WHAT[what])


def _rows(store: SqlStore, asset: str, what: str, begin_ns: int, end_ns: int) -> Iterator[dict[str, Any]]:
    if what == "events":
        after = 0
        while events := store.events(asset, after, PAGE):
            yield from ({"id": e.id, "kind": e.kind, "data": e.data} for e in events)
            after = events[-1].id
        return
    for epoch in store.epochs(asset):
        index = -1
        while page := store.windows(asset, index, PAGE, epoch=epoch["epoch"]):
            for window in page:
                if begin_ns <= window.start_ns < end_ns:
                    yield _window(epoch["epoch"], window.start_ns, window.record, window.figures)
            index = page[-1].record["index"]


def _window(epoch: int, start_ns: int, record: Mapping[str, Any], shown: Mapping[str, Any]) -> dict:
    row = {"epoch": epoch, "start_ns": start_ns, **{name: record.get(name) for name in RECORD}}
    for flank in FLANKS:
        band = (shown.get("depth_um") or {}).get(flank) or {}
        row |= {f"depth_um_{flank}_{name}": band.get(name) for name in BANDS}
    for unit in ("hours", "revolutions"):
        band = shown.get(f"rul_{unit}") or {}
        row |= {f"rul_{unit}_{name}": band.get(name) for name in BANDS}
    return row


def _as_csv(rows: Iterator[dict[str, Any]], out: Path, columns: tuple[str, ...]) -> int:
    with out.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(columns)
        count = 0
        for row in rows:
            table.writerow([_cell(row[name]) for name in columns])
            count += 1
    return count


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return _json(value) if isinstance(value, (dict, list)) else value


def _json(value: Any) -> str:
    return json.dumps(plain(value), separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def _as_json_lines(rows: Iterator[dict[str, Any]], out: Path, columns: tuple[str, ...]) -> int:
    with out.open("w", encoding="utf-8") as file:
        return _lines(rows, file)


def _lines(rows: Iterator[dict[str, Any]], file: IO[str]) -> int:
    count = 0
    for row in rows:
        file.write(_json(row) + "\n")
        count += 1
    return count


def _as_parquet(rows: Iterator[dict[str, Any]], out: Path, columns: tuple[str, ...]) -> int:
    from service.results.parquet_rows import write_parquet  # with packages that an installation may leave out

    texts = ({name: _json(value) if isinstance(value, dict) else value for name, value in row.items()} for row in rows)
    return write_parquet(texts, out, columns, PAGE)


FORMS: dict[str, Callable[[Iterator[dict[str, Any]], Path, tuple[str, ...]], int]] = {
    "csv": _as_csv,
    "jsonl": _as_json_lines,
    "parquet": _as_parquet,
}
"""Forms of a file of results, by its ending."""
