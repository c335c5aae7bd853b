"""Parquet files, by pyarrow."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from service.files.readers.contents import Contents
from service.files.readers.stored import PIECE, SHORT, row_of
from service.files.readers.table import Table, split_unit


def read_parquet(path: Path) -> Table:
    """The columns; moments and durations become seconds after the first, other units are metadata or in the name."""
    import pyarrow
    import pyarrow.parquet as parquet

    found = Contents(format="Parquet")
    with parquet.ParquetFile(path, pre_buffer=False) as file:
        schema = file.schema_arrow
        found.entries += [(key.decode(errors="replace"), value) for key, value in (schema.metadata or {}).items()]
        for field in schema:
            stated = {
                k.decode(errors="replace"): v
                for k, v in (field.metadata or {}).items()
                if not k.startswith(b"PARQUET:")
            }
            unit = "" if "unit" in stated else split_unit(field.name)[1]
            found.add(field.name, partial(_row, pyarrow.types, file, field), stated, unit=unit)
    return found.table()


def _row(types: Any, file: Any, field: Any) -> Any:
    """A column, empty cells NaN."""
    is_long = file.metadata.num_rows > SHORT
    plain = types.is_floating(field.type) or types.is_decimal(field.type)
    numbers = plain or types.is_integer(field.type) or types.is_boolean(field.type)
    if not is_long or not (numbers or types.is_temporal(field.type)):
        data = file.read(columns=[field.name]).column(0)
        return _values(types, field.type, data, numbers and data.null_count > 0)
    batches = file.iter_batches(PIECE, columns=[field.name])
    return row_of(_values(types, field.type, batch.column(0), numbers) for batch in batches)


def _values(types: Any, kind: Any, data: Any, as_float: bool) -> Any:
    if types.is_decimal(kind):
        data = data.cast("float64")
    values = data.to_numpy(zero_copy_only=False) if hasattr(data, "buffers") else data.to_numpy()
    return values.astype(float) if as_float else values
