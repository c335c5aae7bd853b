"""Files at the edge: one that cannot be read or written is one line that names it; whole files, or none."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

from service.errors import InputError


@contextmanager
def _faults_of(path: str | Path, what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: {what}: {(error.strerror or 'fault').lower()}") from None


def writing(path: str | Path) -> AbstractContextManager[None]:
    """While a file is written; InputError names one that cannot be."""
    return _faults_of(path, "cannot be written")


def reading(path: str | Path, what: str = "") -> AbstractContextManager[None]:
    """While a file is read, which messages call `what`; InputError names one that cannot be."""
    return _faults_of(path, f"{what} cannot be read".strip())


def json_of_file(path: Path, what: str) -> Any:
    """The JSON of a file, which must be `what`; InputError names the file."""
    with reading(path):
        text = path.read_bytes()
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not {what}: {error}") from None


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """The name under which a file is written, which is given its own when it is complete: nobody sees a part of it."""
    path = Path(path)
    part = path.with_name(f"{path.name}.part")
    with writing(path):
        try:
            yield part
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
