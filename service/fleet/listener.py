"""A partition's worker and the front ends: what they have written is looked at as soon as they say so, by notifications
of PostgreSQL.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

from service.errors import StoreError
from service.fleet.channel import Follower
from service.fleet.naming import PartitionStreams
from service.fleet.notices import ASSET, NAMED, channel_of
from service.results.job_queue import ALARM
from service.results.job_queue import ASSET as BEGUN
from service.runtime.worker import Kept

log = logging.getLogger(__name__)


class Listener(Follower):
    """Wakes a partition's worker, until ended.

    wake     called after each notification: the worker looks at what waits
    streams  of the partition: read again when a name has been given that hashes to another one
    """

    def __init__(
        self,
        database: str,
        partition: int,
        kept: Kept,
        wake: Callable[[], None],
        streams: PartitionStreams,
    ) -> None:
        super().__init__(database, channel_of(partition), "listener")
        self._partition, self._kept, self._wake = partition, kept, wake
        self._streams, self._names_given = streams, True

    def begun(self) -> None:
        self._names_given = True

    def look(self) -> None:
        """Finds what notifications that were lost would have said."""
        kept = self._kept
        kept.queue.asked.set()
        try:
            self._read_names()
            for asset in kept.store.assets():
                self._show_new(asset)
        except StoreError as error:  # whoever keeps windows says it
            log.debug("what waits in partition %d is looked at later: %s", self._partition, error)
        self._wake()

    def take(self, said: Iterable[str]) -> None:
        for each in said:
            what, _, asset = each.partition(" ")
            self._take_up(what, asset)
        self._wake()

    def _take_up(self, what: str, asset: str) -> None:
        """What a front end has written concerns an asset."""
        kept = self._kept
        try:
            if what == ASSET:
                kept.queue.asked.set()
                self._show_new(asset)
                if kept.table.latest(asset) is not None:
                    kept.told(ALARM, asset)  # what became of one may be what was written
            elif what == NAMED:
                self._names_given = True
                self._read_names()
        except StoreError as error:  # whoever keeps windows says it; the next look finds what is there
            log.debug("what was announced of %s waits: %s", asset, error)

    def _read_names(self) -> None:
        if self._names_given:
            self._streams.read(self._kept.store.database)
            self._names_given = False

    def _show_new(self, asset: str) -> None:
        """An asset that a front end has created is one of the partition's from now on."""
        kept = self._kept
        if kept.table.latest(asset) is None and asset in kept.store.assets():
            kept.told(BEGUN, asset)
