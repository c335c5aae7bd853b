"""Rows of results as a Parquet file, by pyarrow."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.parquet

TEXTS = ("asset", "kind", "quality", "start_time", "data")
WHOLE = ("epoch", "start_ns", "index", "id")
TRUTHS = ("updated",)


def write_parquet(rows: Iterator[dict[str, Any]], out: Path, columns: tuple[str, ...], page: int) -> int:
    """Writes rows to a file, `page` of them in memory; how many."""
    schema = pyarrow.schema([(name, _type_of(name)) for name in columns])
    count = 0
    with pyarrow.parquet.ParquetWriter(out, schema) as writer:
        while part := list(islice(rows, page)):
            fitted = [{name: row[name] for name in columns} for row in part]
            writer.write_table(pyarrow.Table.from_pylist(fitted, schema=schema))
            count += len(part)
    return count


def _type_of(column: str) -> Any:
    if column in TEXTS:
        return pyarrow.string()
    if column in WHOLE:
        return pyarrow.int64()
    return pyarrow.bool_() if column in TRUTHS else pyarrow.float64()
