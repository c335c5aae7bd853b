"""A partition as an actor of Ray, which starts it again wherever there is room when its process or its node ends.

Only `engine` imports this file, in a process that uses Ray; Ray's workers load it with the actor.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Sequence
from importlib import import_module

import ray

from service.errors import NewerTables, StoreError
from service.fleet.layout import END_WAIT, Condition, Layout
from service.fleet.partition import serve_partition
from service.logs import logging_by
from service.operation.health import Late
from service.runtime.twin_port import Twin
from service.settings import Settings

log = logging.getLogger(__name__)

FAILED = 70  # exit status of a process whose partition could not go on: EX_SOFTWARE
NEWER_WAIT = 30.0  # before a partition with tables of a newer release is tried again, maybe on another node [s]


class PartitionActor:
    """Serves one partition from its begin to its end, in a thread of its own."""

    def __init__(self, settings: Settings, partition: int, layout: Layout, twin_from: str | None = None) -> None:
        """twin_from  module and name of the twin, `module:name`; None for the twin itself"""
        self._partition = partition
        self._node = ray.get_runtime_context().get_node_id()
        self._stop = threading.Event()
        self._late: Callable[[], Sequence[Late]] | None = None  # once the partition has been taken
        self._ended = False  # on demand
        given = settings, partition, layout, twin_from
        self._thread = threading.Thread(target=self._serve, args=given, name="partition", daemon=True)
        self._thread.start()

    def condition(self) -> Condition:
        """How the partition is; answered once the actor has been placed."""
        late = () if self._late is None else tuple(map(str, self._late()))
        return Condition(node=self._node, served=self._late is not None, late=late)

    def end(self) -> None:
        """Ends the work: what is committed stays, and what waits is left to the next start."""
        self._ended = True
        self._stop.set()
        self._thread.join(END_WAIT)

    def _serve(self, settings: Settings, partition: int, layout: Layout, twin_from: str | None) -> None:
        with logging_by(settings):
            try:
                serve_partition(
                    settings, partition, layout, self._stop, node=self._node[:12], twin=_twin(twin_from),
                    at_work=self._is_at_work,
                )  # fmt: skip
            except StoreError as error:
                newer = isinstance(error, NewerTables) or isinstance(error.__cause__, NewerTables)
                log.error("partition %d cannot be served by this release: %s", partition, error, exc_info=not newer)
                if newer:
                    self._stop.wait(NEWER_WAIT)
            except BaseException:
                log.exception("partition %d cannot go on: its process ends, and is started again", partition)
        if not self._ended:
            logging.shutdown()
            os._exit(FAILED)

    def _is_at_work(self, late: Callable[[], Sequence[Late]]) -> None:
        self._late = late


def _twin(twin_from: str | None) -> Twin | None:
    if twin_from is None:
        return None
    module, _, name = twin_from.partition(":")
    twin = getattr(import_module(module), name)
    assert isinstance(twin, Twin)
    return twin
