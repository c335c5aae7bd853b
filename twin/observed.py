"""Long parts of a step, for whoever wants to know when they begin and end: the core itself has no clock.

with part("tracing"): ...              in the core
with observed_by(watch): step(...)     around it; watch(name) is a context manager that encloses each part

Where a part is to be made elsewhere, `watch` raises PartRefused: the step ends by it, and nothing has been made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar

Watch = Callable[[str], AbstractContextManager[object]]

TRACING = "tracing"  # the search for effects besides wear, and their fit


class PartRefused(Exception):
    """A part of a step that is not to be made here."""


_WATCH: ContextVar[Watch | None] = ContextVar("watch", default=None)


def part(name: str) -> AbstractContextManager[object]:
    """A long part of a step."""
    watch = _WATCH.get()
    return nullcontext() if watch is None else watch(name)


@contextmanager
def observed_by(watch: Watch) -> Iterator[None]:
    """Parts of steps made inside, in this thread, are enclosed by what `watch` answers."""
    token = _WATCH.set(watch)
    try:
        yield
    finally:
        _WATCH.reset(token)
