"""Asks people where what comes on a stream does not fit its asset: frames of passed times, or a rig of other gears.

Where new assets are adopted, the asset's windows wait for the answer, so that nothing of another machine is mixed with
them. Where people are asked about new assets, anybody might offer a rig file: it is a proposal, and the asset goes on.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

from service.contract.status import shown_question
from service.results.asset_table import AssetTable
from service.results.jobs import Jobs
from service.results.sql_store import SqlStore
from service.runtime.outcomes import Outcome
from service.runtime.questions import GEARS_DIFFER, REPEATED, frames_repeat, gears_differ
from service.runtime.reception import Reception
from service.runtime.rigs import OfferedRigs, Rigs
from service.runtime.streams import Streams
from service.stream.repeats import Repeats

log = logging.getLogger(__name__)

OFFERED = "rig file of the stream"


class StreamQuestions:
    """Compares the rig file of the settings at the start, and frames and rig files as they come.

    keep  keeps what a question changes, and shows it
    """

    def __init__(
        self,
        reception: Reception,
        table: AssetTable,
        store: SqlStore,
        jobs: Jobs,
        keep: Callable[[Outcome], None],
        *,
        rigs: Rigs,
        streams: Streams,
        offered: OfferedRigs,
    ) -> None:
        self._reception, self._table, self._store, self._jobs, self._keep = reception, table, store, jobs, keep
        self._rigs, self._streams, self._offered = rigs, streams, offered

    def start(self) -> None:
        """Asks about the rig file of the settings, and ends such a question where that file fits again."""
        for asset in self._store.assets():
            question = self._question(asset)
            asked = question is not None and question["kind"] == GEARS_DIFFER and question.get("settings")
            given = self._rigs.given_of(asset)
            differs = given is not None and self._rigs.named_differences(asset, given)
            if asked and not differs:
                self._ask(asset, None)
            elif given is not None:
                self._compare(asset, given, f"rig file {self._rigs.given_where(asset)}", settings=True)

    def __call__(self) -> None:
        """Asks about rig files that have been offered since."""
        for stream, rig in self._offered.fresh():
            asset = self._streams.asset_of(stream)
            if self._rigs.asks:
                self._rigs.propose(asset, rig)
            elif asset in self._reception.assets or self._table.latest(asset) is not None:
                if self._begins_without(asset):
                    self._look_up(asset)
                else:
                    self._compare(asset, rig, OFFERED, settings=False)

    def first_frame(self, asset: str) -> None:
        """Looks for a rig file once more where a change has opened the asset before anybody offered one."""
        if asset in self._reception.assets and self._begins_without(asset):
            self._look_up(asset)

    def _begins_without(self, asset: str) -> bool:
        """Whether an asset that was opened has no rig file, and nothing has been learned of it that might differ."""
        return self._store.next_index(asset) == 0 and self._rigs.lacks(asset)

    def _look_up(self, asset: str) -> None:
        self._reception.reopen(asset)

    def _compare(self, asset: str, rig: Mapping[str, Any], where: str, *, settings: bool) -> None:
        differences = self._rigs.named_differences(asset, rig)
        if not differences and not settings:
            self._rigs.propose(asset, rig)
        if not differences or self._question(asset) is not None or self._ignored(asset, differences):
            return
        question = gears_differ(differences, where, self._reception.ended_ns(asset))
        kept = {**question, "rig": dict(rig), "settings": settings}
        self._ask(asset, kept)

    def look_for_repeats(self, asset: str, repeats: Repeats) -> None:
        """Asks where nothing but frames of passed times is received, and ends that question where others come."""
        question = self._question(asset)
        if question is not None and question["kind"] != REPEATED:
            return
        frames = repeats.suspicious()
        if frames and question is None:
            self._ask(asset, frames_repeat(frames, bool(repeats.other), self._reception.ended_ns(asset)))
        elif question is not None and not repeats.run:
            self._ask(asset, None)

    def _question(self, asset: str) -> Mapping[str, Any] | None:
        """The question about an asset that is open."""
        shown = self._table.latest(asset)
        return None if shown is None else shown.question

    def _ask(self, asset: str, question: Mapping[str, Any] | None) -> None:
        """Opens a question, or ends it: what waited for its answer is next then."""
        events = () if question is None else (("question", shown_question(question) or {}),)
        if question is not None:
            log.warning("%s: %s", asset, question["detail"], extra={"asset": asset})
        self._keep(Outcome(asset=asset, changed={"question": question}, events=events))

    def _ignored(self, asset: str, differences: list[str]) -> bool:
        """Whether people have said before that the earlier rig file holds."""
        return any(
            job.outcome is not None and job.outcome.get("differences") == differences
            for job in self._jobs.of(asset, "ignore")
        )
