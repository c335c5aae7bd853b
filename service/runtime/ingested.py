"""What the process that receives frames says of itself, and what others may do once it has opened the results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from service.errors import StorageUnavailable
from service.operation.health import Late
from service.results.roles import ANSWER, INGEST
from service.runtime.role_process import Others

OPENED = "the results are being opened"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ingested:
    """How the process that receives frames is.

    begun      whether the results are open, and others may open them
    not_ready  why no frames are taken, or None
    instance   of this process, as positions name it
    unstored   why results cannot be stored now, and since when (ISO 8601)
    lasts      whether that is so for more than a moment
    late       its loops that hang or have ended
    asked_ns   when its figures were asked for last, as `FiguresAsked` has it; 0 for never
    figures    as for /metrics, of that time
    """

    begun: bool = False
    not_ready: str | None = OPENED
    instance: str = ""
    unstored: tuple[str, str] | None = None
    lasts: bool = False
    late: tuple[Late, ...] = ()
    asked_ns: int = 0
    figures: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class FiguresAsked:
    """Whoever answers asks for the figures of the process that receives frames; when [monotonic, ns]."""

    at_ns: int


def figures_asked(others: Others) -> int:
    """When figures were asked for last [monotonic, ns]; 0 for never."""
    said = others.said(ANSWER)
    return said.at_ns if isinstance(said, FiguresAsked) else 0


def ingested(others: Others) -> Ingested:
    """What the process that receives frames has said last."""
    said = others.said(INGEST)
    return said if isinstance(said, Ingested) else Ingested()


def once_begun(others: Others, open_results: Callable[[], Any], wait: float = 0.0) -> Callable[[], Any]:
    """Opens the results once who receives frames has; StorageUnavailable before, after a wait [s]."""

    def opened() -> Any:
        if not others.wait_for(lambda: ingested(others).begun, wait):
            raise StorageUnavailable(ingested(others).not_ready or OPENED, reason="connection lost")
        return open_results()

    return opened
