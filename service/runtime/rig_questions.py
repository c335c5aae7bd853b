"""Asks people where a rig file describes other gears than those of an asset so far.

Where new assets are adopted, the asset's windows wait for the answer, so that nothing of another machine is mixed with
them. Where people are asked about new assets, anybody might offer a rig file: it is a proposal, and the asset goes on.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.results.jobs import Jobs
from service.results.sql_store import SqlStore
from service.runtime.lanes import Lanes
from service.runtime.questions import GEARS_DIFFER, gears_differ
from service.runtime.reception import Reception
from service.runtime.rigs import OfferedRigs, Rigs
from service.runtime.streams import Streams

OFFERED = "rig file of the stream"


class RigQuestions:
    """Compares the rig file of the settings at the start, and those that are offered as they come."""

    def __init__(
        self,
        reception: Reception,
        lanes: Lanes,
        store: SqlStore,
        jobs: Jobs,
        *,
        rigs: Rigs,
        streams: Streams,
        offered: OfferedRigs,
    ) -> None:
        self._reception, self._lanes, self._store, self._jobs = reception, lanes, store, jobs
        self._rigs, self._streams, self._offered = rigs, streams, offered

    def start(self) -> None:
        """Asks about the rig file of the settings, and ends such a question where that file fits again."""
        for asset in self._store.assets():
            question = self._lanes.question(asset)
            asked = question is not None and question["kind"] == GEARS_DIFFER and question.get("settings")
            given = self._rigs.given_of(asset)
            differs = given is not None and self._rigs.named_differences(asset, given)
            if asked and not differs:
                self._lanes.ask(asset, None)
            elif given is not None:
                self._compare(asset, given, f"rig file {self._rigs.given_where(asset)}", settings=True)

    def __call__(self) -> None:
        """Asks about rig files that have been offered since."""
        for stream, rig in self._offered.fresh():
            asset = self._streams.asset_of(stream)
            if self._rigs.asks:
                self._rigs.propose(asset, rig)
            elif asset in self._reception.assets or self._lanes.find(asset) is not None:
                if self._begins_without(asset):
                    self._look_up(asset)
                else:
                    self._compare(asset, rig, OFFERED, settings=False)

    def first_frame(self, asset: str) -> None:
        """Looks for a rig file once more where a change has opened the asset before anybody offered one."""
        if self._lanes.find(asset) is not None and self._begins_without(asset):
            self._look_up(asset)

    def _begins_without(self, asset: str) -> bool:
        """Whether an asset that was opened has no rig file, and nothing has been learned of it that might differ."""
        lane = self._lanes.find(asset)
        return (lane is None or lane.index == 0) and self._rigs.lacks(asset)

    def _look_up(self, asset: str) -> None:
        self._reception.reopen(asset)
        self._lanes.reopen(asset)

    def _compare(self, asset: str, rig: Mapping[str, Any], where: str, *, settings: bool) -> None:
        differences = self._rigs.named_differences(asset, rig)
        if not differences and not settings:
            self._rigs.propose(asset, rig)
        if not differences or self._lanes.question(asset) is not None or self._ignored(asset, differences):
            return
        question = gears_differ(differences, where, self._reception.ended_ns(asset))
        kept = {**question, "rig": dict(rig), "settings": settings}
        self._lanes.ask(asset, kept)

    def _ignored(self, asset: str, differences: list[str]) -> bool:
        """Whether people have said before that the earlier rig file holds."""
        return any(
            job.outcome is not None and job.outcome.get("differences") == differences
            for job in self._jobs.of(asset, "ignore")
        )
