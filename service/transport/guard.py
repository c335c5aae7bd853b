"""Callbacks of a network, whose exceptions nobody would see: they are logged and counted."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

log = logging.getLogger(__name__)


class Guard:
    """Runs callbacks and counts those that failed."""

    def __init__(self) -> None:
        self.errors = 0

    def __call__(self, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """The callback, without its exceptions."""

        def guarded(argument: Any) -> None:
            try:
                callback(argument)
            except Exception:
                self.errors += 1
                log.exception("a callback of the network failed")

        return guarded
