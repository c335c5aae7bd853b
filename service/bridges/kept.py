"""Numbers that a bridge needs again after a restart: how far it has come, kept in one small file."""

from __future__ import annotations

import json
import logging
import os
import threading
from pathlib import Path
from typing import Any

log = logging.getLogger(__name__)


class KeptNumbers:
    """Whole numbers by section and name, written whole and in one step.

    Where the file cannot be written the numbers are kept in memory and written the next time; a file that cannot be
    read is begun again. Either is logged.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._numbers = _read(path)
        self._failed = False

    def section(self, name: str) -> dict[str, int]:
        """A copy of one section; empty where nothing has been kept."""
        with self._lock:
            return dict(self._numbers.get(name, {}))

    def keep(self, name: str, numbers: dict[str, int]) -> None:
        """Keeps a section in place of what it was."""
        with self._lock:
            if self._numbers.get(name, {}) == numbers and not self._failed:
                return
            self._numbers[name] = dict(numbers)
            try:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                new = self._path.with_suffix(".new")
                new.write_text(json.dumps(self._numbers), encoding="utf-8")
                os.replace(new, self._path)
            except OSError as error:
                if not self._failed:
                    log.warning("%s cannot be written: %s", self._path, (error.strerror or "fault").lower())
                self._failed = True
            else:
                self._failed = False


def _read(path: Path) -> dict[str, dict[str, int]]:
    try:
        found: Any = json.loads(path.read_text(encoding="utf-8"))
        return {str(s): {str(k): int(v) for k, v in numbers.items()} for s, numbers in found.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        log.warning("%s cannot be read and is begun again: %s", path, error)
        return {}
