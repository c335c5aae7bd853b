"""Which frames are recorded, of which asset and with which rig file: what the service's database says of it now.

    name of a stream ─► asset, whose id names folders, files and topics; None: it is retired, unknown or elsewhere
    asset            ─► its rig file: that of the database, else of the settings, else one that the network offers

Rows are read every few seconds, in a thread of their own, so that no frame waits for a database. Where there is none,
or it has not been read yet, all that comes is recorded.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from service.results.database import Database
from service.results.json_columns import salvage
from service.results.known_assets import kept_rigs, streams_of_all
from service.results.roles import RECORD, OwnRole
from service.runtime.rig_sources import GivenRigs, OfferedRigs
from service.toml_text import document_text

log = logging.getLogger(__name__)

LOOK = 2.0  # between two looks at the rows [s]
SAY_EVERY = 4.0  # [s]
MOST_OTHERS = 1024  # streams that no row names and that are recorded nevertheless, since the start
END_WAIT = 5.0  # [s]


class RecordedAssets(threading.Thread):
    """Follows the rows of assets, until ended.

    open_database  opens the results' database; None where there is none
    asks           whether an asset that no row names waits for a person
    here           whether a stream that no row names would be one of this service
    figures        what is said in the row of this process, where there is a database
    """

    def __init__(
        self,
        open_database: Callable[[], Database] | None = None,
        *,
        asks: bool = False,
        given: GivenRigs | None = None,
        here: Callable[[str], bool] = lambda stream: True,
        figures: Callable[[], Mapping[str, float]] = dict,
    ) -> None:
        super().__init__(name="recorded assets", daemon=True)
        self._open, self._asks, self._given, self._here = open_database, asks, given or GivenRigs(), here
        self._figures = figures
        self.offered: OfferedRigs | None = None  # once there is a network
        self.looked = threading.Event()  # set after the first look
        self._database: Database | None = None
        self._role: OwnRole | None = None  # once there is a database
        self._streams: dict[str, str | None] | None = None  # by name, the asset; None: it is retired
        self._others: set[str] = set()
        self._wanted: dict[str, None] = {}  # assets whose rig files are asked for
        self._sought: set[str] = set()  # of them, those for which the network has been asked
        self._kept: dict[str, bytes] = {}  # rig files as the rows have them
        self._texts: dict[str, bytes] = {}  # the same as TOML
        self._woken, self._stopping = threading.Event(), threading.Event()
        self._say_at = 0.0
        self._fault: str | None = None

    # -- for the thread that records, and the network's callbacks ------------------------------------

    def admits(self, stream: str, channel: str | None = None) -> bool:
        """Whether frames of a stream are recorded."""
        return self.asset_of(stream) is not None

    def asset_of(self, stream: str) -> str | None:
        """The asset of a stream; None where its frames are not recorded."""
        streams = self._streams
        if streams is not None and stream in streams:
            return streams[stream]
        if (self._asks and streams is not None) or not self._here(stream):
            return None
        if stream not in self._others:
            if len(self._others) >= MOST_OTHERS:
                return None
            self._others.add(stream)
            if len(self._others) == MOST_OTHERS:
                log.warning("frames of further unknown assets are not recorded: there are %d", MOST_OTHERS)
        return stream

    def rig_text(self, asset: str) -> bytes | None:
        """The rig file that holds for an asset, as TOML; None while none is known. Never waits."""
        if asset not in self._wanted:
            self._wanted[asset] = None
            self._woken.set()
        return self._texts.get(asset)

    # -- the thread ----------------------------------------------------------------------------------

    def run(self) -> None:
        """Works until ended."""
        while not self._stopping.is_set():
            self._woken.clear()
            try:
                self.look()
            except Exception as error:  # of the network, which may be closed meanwhile
                self._say_fault(error)
            self.looked.set()
            self._woken.wait(LOOK)
        if self._database is not None:
            if (role := self._role) is not None:
                self._attempt(lambda database: role.gone())
            self._database.close()

    def end(self) -> None:
        """Ends the thread."""
        self._stopping.set()
        self._woken.set()
        if self.is_alive():
            self.join(END_WAIT)

    def say(self) -> None:
        """Has the figures said now: they have changed."""
        self._say_at = 0.0
        self._woken.set()

    def look(self) -> None:
        """Reads what the rows say now, and looks for the rig files of those that have none."""
        self._attempt(self._read)
        for asset in [asset for asset in list(self._wanted) if asset not in self._kept]:
            found = self._found_elsewhere(asset)
            if found is not None:
                self._texts[asset] = document_text(found).encode()
        if time.monotonic() >= self._say_at:
            self._say_at = time.monotonic() + SAY_EVERY
            self._attempt(self._say)

    def _attempt(self, work: Callable[[Database], object]) -> None:
        """Works with the database, where there is one and it can be used."""
        if self._open is None:
            return
        try:
            self._database = self._database or self._open()
            work(self._database)
        except Exception as error:  # frames are recorded whatever it is
            self._say_fault(error)
        else:
            self._fault = None

    def _say(self, database: Database) -> None:
        self._role = self._role or OwnRole(database, RECORD)
        self._role.say(self._figures())

    def _say_fault(self, error: Exception) -> None:
        if str(error) != self._fault:
            self._fault = str(error)
            log.warning("the recorder knows of assets what it has read before: %s", self._fault)

    def _read(self, database: Database) -> None:
        self._streams = streams_of_all(database)
        self._others -= self._streams.keys()
        for asset, kept in kept_rigs(database, list(self._wanted)):
            if kept is not None and kept != self._kept.get(asset):
                rig: Mapping[str, Any] | None = salvage(kept, f"rig file of {asset}")
                self._kept[asset] = kept
                if rig:
                    self._texts[asset] = document_text(rig).encode()

    def _found_elsewhere(self, asset: str) -> Mapping[str, Any] | None:
        """The rig file of the settings, or one that the network offers: it is asked once, and then listened to."""
        streams = dict.fromkeys([asset, *(name for name, of in (self._streams or {}).items() if of == asset)])
        for stream in streams:
            if (given := self._given.of(stream)) is not None:
                return given
        if self.offered is None:
            return None
        ask = asset not in self._sought
        self._sought.add(asset)
        return next(filter(None, (self.offered.find(stream, ask=ask) for stream in streams)), None)
