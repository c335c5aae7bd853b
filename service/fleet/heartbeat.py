"""A partition's worker says every second that it is at work, and how; and learns here, too, that it is so no longer."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy import bindparam
from sqlalchemy.exc import SQLAlchemyError

from service.fleet.databases import engine_of
from service.fleet.fence import Fence
from service.fleet.layout import PARTITIONS, SERVER_NOW
from service.operation.health import Late
from service.operation.metric_catalogue import METRICS

log = logging.getLogger(__name__)

EVERY = 1.0  # [s]
FIGURES_EVERY = 5.0  # [s]
SILENT = 10.0  # time without a word after which a partition counts as not served [s]
STOP_WAIT = 2.0  # [s]

_SEEN = (
    sa.update(PARTITIONS)
    .where(PARTITIONS.c.number == bindparam("of"), PARTITIONS.c.token == bindparam("held"))
    .values(seen_ns=SERVER_NOW)
)
_FIGURES = _SEEN.values(figures=bindparam("said"))
_GONE = (
    sa.update(PARTITIONS)
    .where(PARTITIONS.c.number == bindparam("of"), PARTITIONS.c.token == bindparam("held"))
    .values(seen_ns=None, worker=None, node=None)
)


class Heartbeat(threading.Thread):
    """Keeps `partitions.seen_ns` and `partitions.figures` of one partition, on a connection of its own.

    figures    what the worker says of itself, as for /metrics
    not_ready  why it takes no frames, or None
    late       the loops of the worker that hang or have ended: it is silent as long as there are any
    """

    def __init__(
        self,
        database: str,
        fence: Fence,
        figures: Callable[[], Mapping[str, Any]],
        not_ready: Callable[[], str | None],
        late: Callable[[], Sequence[Late]],
    ) -> None:
        super().__init__(name="heartbeat", daemon=True)
        self._engine = engine_of(database, name=fence.application, pool_size=1, max_overflow=0)
        self._fence, self._figures, self._not_ready, self._late = fence, figures, not_ready, late
        self._stopping = threading.Event()
        self._silent = False

    def run(self) -> None:
        """Works until ended."""
        figures_at = 0.0
        while True:
            try:
                with_figures = time.monotonic() >= figures_at
                if self._turns():
                    self._say(with_figures)
                if with_figures:
                    figures_at = time.monotonic() + FIGURES_EVERY
            except SQLAlchemyError as error:  # whoever keeps windows says it
                log.debug("the heartbeat of partition %d: %s", self._fence.partition, error)
            if self._stopping.wait(EVERY):
                return

    def end(self) -> None:
        """Ends the thread, and says that nobody serves the partition now."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOP_WAIT)
        try:
            with self._engine.begin() as db:
                db.execute(_GONE, {"of": self._fence.partition, "held": self._fence.token})
        except SQLAlchemyError as error:
            log.debug("partition %d could not be given back: %s", self._fence.partition, error)
        self._engine.dispose()

    def _turns(self) -> bool:
        """Whether all loops turn; what hangs is said once."""
        late = self._late()
        if late and not self._silent:
            log.error(
                "partition %d is silent until its loops turn again: %s",
                self._fence.partition,
                "; ".join(map(str, late)),
            )
        self._silent = bool(late)
        return not late

    def _say(self, with_figures: bool) -> None:
        given: dict[str, Any] = {"of": self._fence.partition, "held": self._fence.token}
        statement = _SEEN
        if with_figures:
            statement = _FIGURES
            given["said"] = {"not_ready": self._not_ready(), **_numbers(self._figures())}
        with self._engine.begin() as db:
            held = db.execute(statement, given).rowcount
        if not held:
            self._fence.lost()


def _numbers(figures: Mapping[str, Any]) -> dict[str, float | dict[str, float]]:
    """The figures that are numbers; those of each cause or the like by their label, of those of each asset the sum."""
    out: dict[str, float | dict[str, float]] = {}
    for name, value in figures.items():
        parts = dict(value) if isinstance(value, Mapping) else {"": value}
        if not all(isinstance(part, int | float) for part in parts.values()):
            continue
        labels = METRICS[name].labels if name in METRICS else ()
        by_label = isinstance(value, Mapping) and len(labels) == 1 and labels != ("asset",)
        out[name] = (
            {str(label): float(part) for label, part in parts.items()} if by_label else float(sum(parts.values()))
        )
    return out
