"""Parquet files, by pyarrow."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from service.files.readers.contents import Contents
from service.files.readers.table import Table, split_unit


def read_parquet(path: Path) -> Table:
    """The columns; moments and durations become seconds after the first, other units are metadata or in the name."""
    import pyarrow
    import pyarrow.parquet as parquet

    table = parquet.read_table(path)
    found = Contents(format="Parquet")
    for field, data in zip(table.schema, table.columns, strict=True):
        stated = {
            k.decode(errors="replace"): v for k, v in (field.metadata or {}).items() if not k.startswith(b"PARQUET:")
        }
        unit = "" if "unit" in stated else split_unit(field.name)[1]
        found.add(field.name, partial(_values, pyarrow, field.type, data), stated, unit=unit)
    return found.table()


def _values(pyarrow: Any, kind: Any, data: Any) -> Any:
    """A column as an array, empty cells NaN."""
    if pyarrow.types.is_decimal(kind):
        data = data.cast(pyarrow.float64())
    values = data.to_numpy()
    numbers = pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind) or pyarrow.types.is_boolean(kind)
    return values.astype(float) if numbers and data.null_count else values
