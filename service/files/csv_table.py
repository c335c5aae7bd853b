"""A CSV table as rows by the names of its columns; a fault is one line that says what is wrong."""

from __future__ import annotations

import csv
from pathlib import Path

from service.errors import InputError


def read_table(table: Path, delimiter: str) -> tuple[list[str], list[dict[str, str]]]:
    """The names of the columns and the rows, each with a cell for every column; InputError where it cannot be read."""
    if len(delimiter) != 1:
        raise InputError(f"{table}: delimiter = {delimiter!r} must be one character")
    try:
        with table.open(encoding="utf-8-sig", newline="") as lines:
            reader = csv.DictReader(lines, delimiter=delimiter)
            header, rows = list(reader.fieldnames or ()), list(reader)
    except OSError as error:
        raise InputError(f"{table}: cannot be read: {(error.strerror or 'fault').lower()}") from None
    except (UnicodeDecodeError, csv.Error, ValueError) as error:
        raise InputError(f"{table}: is no readable CSV file: {error}") from None
    for number, row in enumerate(rows, start=2):
        if None in row or None in row.values():
            raise InputError(f"{table.name}, line {number}: {len(header)} cells are needed, as in the header")
    return header, rows
