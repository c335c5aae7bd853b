"""Parquet files, by pyarrow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from service.files.dates import stated_in
from service.files.readers.table import Column, Table, split_unit


def read_parquet(path: Path) -> Table:
    """The columns; moments become seconds after the first, a column's unit is its metadata's or in its name."""
    import pyarrow
    import pyarrow.parquet as parquet

    table = parquet.read_table(path)
    columns, others = [], []
    dates = [(key.decode(), value) for key, value in (table.schema.metadata or {}).items()]
    for field, data in zip(table.schema, table.columns, strict=True):
        if pyarrow.types.is_timestamp(field.type) and len(data) and data[0].is_valid:
            dates.insert(0, ("date", f"{data[0].as_py()}".encode()))
    for field, data in zip(table.schema, table.columns, strict=True):
        values = _values(pyarrow, field.type, data)
        if values is None or values.size < 2:
            others.append(field.name)
            continue
        stated = (field.metadata or {}).get(b"unit", b"").decode()
        unit = "s" if pyarrow.types.is_timestamp(field.type) else stated or split_unit(field.name)[1]
        columns.append(Column(name=field.name, values=values, unit=unit))
    return Table(format="Parquet", columns=tuple(columns), other_names=tuple(others), started=stated_in(dates))


def _values(pyarrow: Any, kind: Any, data: Any) -> np.ndarray | None:
    """A column as numbers, empty cells NaN; None of texts and lists."""
    if pyarrow.types.is_timestamp(kind):
        moments = data.to_numpy()
        return (moments - moments[0]) / np.timedelta64(1, "s")
    if pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind) or pyarrow.types.is_boolean(kind):
        values = data.to_numpy()
        return values if data.null_count == 0 else values.astype(float)
    return None
