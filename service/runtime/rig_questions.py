"""Asks people where a rig file describes other gears than those of an asset so far."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from service.results.asset_life import AssetLife
from service.results.board import Board
from service.results.status_events import status_events
from service.results.store import ResultStore
from service.runtime.pipeline import Pipeline
from service.runtime.questions import GEARS_DIFFER, gears_differ
from service.runtime.rigs import OfferedRigs, Rigs
from service.runtime.state_publication import StatePublication
from service.runtime.streams import Streams

log = logging.getLogger(__name__)
OFFERED = "rig file of the stream"


class RigQuestions:
    """Compares the rig file of the settings at the start, and those that are offered as they come."""

    def __init__(
        self,
        pipeline: Pipeline,
        store: ResultStore,
        life: AssetLife,
        board: Board,
        publication: StatePublication,
        *,
        rigs: Rigs,
        streams: Streams,
        offered: OfferedRigs,
    ) -> None:
        self._pipeline, self._store, self._life = pipeline, store, life
        self._board, self._publication = board, publication
        self._rigs, self._streams, self._offered = rigs, streams, offered

    def start(self) -> None:
        """Asks about the rig file of the settings, and ends such a question where that file fits again."""
        for asset in self._store.assets():
            question = self._pipeline.question(asset)
            asked = question is not None and question["kind"] == GEARS_DIFFER and question.get("settings")
            differs = self._rigs.given is not None and self._rigs.named_differences(asset, self._rigs.given)
            if asked and not differs:
                self._close(asset)
            elif self._rigs.given is not None:
                self._compare(asset, self._rigs.given, f"rig file {self._rigs.where}", settings=True)

    def __call__(self) -> None:
        """Asks about rig files that have been offered since."""
        for stream, rig in self._offered.fresh():
            asset = self._streams.asset_of(stream)
            if asset in self._pipeline.assets:
                self._compare(asset, rig, OFFERED, settings=False)

    def _compare(self, asset: str, rig: Mapping[str, Any], where: str, *, settings: bool) -> None:
        differences = self._rigs.named_differences(asset, rig)
        if not differences or self._pipeline.question(asset) is not None or self._ignored(asset, differences):
            return
        question = gears_differ(asset, differences, where, self._pipeline.ended_ns(asset))
        log.warning("%s: %s", asset, question["detail"])
        kept = {**question, "rig": dict(rig), "settings": settings}
        with self._life.transaction():
            self._store.keep(asset, question=kept)
            before = self._board.get(asset)
            changed = status_events(before, *replace(before, question=kept).health()) if before else ()
            self._store.note(asset, [("question", question), *changed])
        self._pipeline.ask(asset, kept)
        self._show(asset, kept)

    def _close(self, asset: str) -> None:
        self._store.keep(asset, question=None)
        self._pipeline.ask(asset, None)
        self._show(asset, None)

    def _ignored(self, asset: str, differences: list[str]) -> bool:
        """Whether people have said before that the earlier rig file holds."""
        return any(
            c.kind == "ignore" and c.effect is not None and c.effect.get("differences") == differences
            for c in self._life.changes(asset)
        )

    def _show(self, asset: str, question: Mapping[str, Any] | None) -> None:
        self._board.update(asset, question=question, last_event_id=self._store.last_event_id(asset))
        self._publication.publish(asset)
