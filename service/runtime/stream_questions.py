"""What comes on a stream and does not fit its asset is noticed: frames of passed times, or a rig of other gears.

People are asked about it by whoever computes (notices.py). Where new assets are adopted, the asset's windows wait for
the answer, so that nothing of another machine is mixed with them. Where people are asked about new assets, anybody
might offer a rig file: it is a proposal, and the asset goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from service.results.asset_table import AssetTable
from service.results.jobs import Notice
from service.results.sql_store import SqlStore
from service.runtime.notices import asked_of_settings
from service.runtime.questions import GEARS_DIFFER, REPEATED
from service.runtime.reception import Reception
from service.runtime.rig_sources import MOST_OFFERED, OfferedRigs
from service.runtime.rigs import Rigs
from service.runtime.routes import Routes
from service.stream.repeats import Repeats

OFFERED = "rig file of the stream"
AGAIN = 64  # frames of passed times after which it is noticed once more: another question may have been open before


class StreamQuestions:
    """Compares the rig file of the settings at the start, and frames and rig files as they come.

    notice  keeps what is to be judged
    """

    def __init__(
        self,
        reception: Reception,
        table: AssetTable,
        store: SqlStore,
        notice: Callable[[Notice], None],
        *,
        rigs: Rigs,
        routes: Routes,
        offered: OfferedRigs,
    ) -> None:
        self._reception, self._table, self._store, self._notice = reception, table, store, notice
        self._rigs, self._routes, self._offered = rigs, routes, offered
        self._fresh: dict[str, Mapping[str, Any]] = {}  # by stream: rig files that have come and were not looked at
        self._repeated: dict[str, int] = {}  # frames of passed times in a row, by asset, as they were noticed last

    def start(self) -> None:
        """Looks whether the rig file of the settings fits, and which questions are open."""
        for snapshot in self._table.every():
            asset, question = snapshot.asset, snapshot.question
            given = self._rigs.given_of(asset)
            if asked_of_settings(question) or (given is not None and self._rigs.differ(asset, given)):
                self._other_rig(asset, given, f"rig file {self._rigs.given_where(asset)}", settings=True)
            if question is not None and question["kind"] == REPEATED:
                self._repeated[asset] = 0

    def __call__(self) -> None:
        """Looks at rig files that have been offered since."""
        self._fresh.update(self._offered.fresh())
        while self._fresh:
            stream = next(iter(self._fresh))
            if len(self._fresh) <= MOST_OFFERED:
                self._look(self._routes.asset_of(stream), self._fresh[stream])
            del self._fresh[stream]

    def _look(self, asset: str, rig: Mapping[str, Any]) -> None:
        if self._rigs.asks:
            self._rigs.propose(asset, rig)
        elif asset in self._reception.assets or self._table.latest(asset) is not None:
            if self._begins_without(asset):
                self._reception.reopen(asset)
            elif self._rigs.differ(asset, rig):
                self._other_rig(asset, rig, OFFERED, settings=False)
            else:
                self._rigs.propose(asset, rig)

    def first_frame(self, asset: str) -> None:
        """Looks for a rig file once more where a change has opened the asset before anybody offered one."""
        if asset in self._reception.assets and self._begins_without(asset):
            self._reception.reopen(asset)

    def _begins_without(self, asset: str) -> bool:
        """Whether an asset that was opened has no rig file, and nothing has been learned of it that might differ."""
        return self._store.next_index(asset) == 0 and self._rigs.lacks(asset)

    def _other_rig(self, asset: str, rig: Mapping[str, Any] | None, where: str, *, settings: bool) -> None:
        seen = {"rig": rig, "where": where, "settings": settings, "ended_ns": self._reception.ended_ns(asset)}
        self._notice(Notice(asset=asset, about=GEARS_DIFFER, seen=seen))

    def look_for_repeats(self, asset: str, repeats: Repeats) -> None:
        """Notices where nothing but frames of passed times is received, and where others come again."""
        frames, noticed = repeats.suspicious(), self._repeated.get(asset)
        if (frames and frames >= (noticed or 0) + AGAIN) or (noticed is not None and not repeats.run):
            ended_ns = self._reception.ended_ns(asset)
            seen = {"frames": frames, "differ": bool(repeats.other), "ended_ns": ended_ns}
            self._repeated.setdefault(asset, 0)  # a commit without an answer may have kept it
            self._notice(Notice(asset=asset, about=REPEATED, seen=seen))
            if frames:
                self._repeated[asset] = frames
            else:
                del self._repeated[asset]
