"""Windows that cannot be used until people have answered: into the store, and shown on the board."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from service.contract.question import shown_question
from service.results.asset_life import AssetLife
from service.results.board import Board
from service.results.status_events import status_events
from service.results.store import ResultStore
from service.runtime import questions
from service.runtime.pipeline import HeldWindow
from service.runtime.state_publication import StatePublication
from twin.windows import Window

log = logging.getLogger(__name__)


class WaitingWindows:
    """A `WaitingPlace` over the service's database."""

    def __init__(
        self,
        store: ResultStore,
        life: AssetLife,
        board: Board,
        publication: StatePublication,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._store, self._life, self._board, self._publication = store, life, board, publication
        self._clock = clock

    def hold(self, held: HeldWindow) -> Mapping[str, Any]:
        """Keeps a window with the place to resume the stream from, in one transaction."""
        with self._life.transaction():
            kept = held.waited is not None or self._life.add_waiting(held.asset, held.window)
            count, _ = self._life.waiting_total(held.asset)
            question = questions.waiting(held.question, count, 0 if kept else 1)
            self._store.keep(
                held.asset,
                state=held.state.to_dict(),
                assembly=held.assembly,
                quality=held.quality,
                question=question,
            )
            before = self._board.get(held.asset)
            changed = status_events(before, *replace(before, question=question).health()) if before else ()
            self._store.note(held.asset, (*held.events, *changed))
        if not kept:
            log.warning("%s: a window was left out: %d windows wait for an answer already", held.asset, count)
        self._board.update(
            held.asset,
            question=question,
            received_ns=self._clock(),
            last_event_id=self._store.last_event_id(held.asset),
        )
        self._publication.publish(held.asset)
        return question

    def ask(self, asset: str, question: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
        """Keeps and shows a question for which no window waits yet, or that it is over."""
        before = self._board.get(asset)
        with self._life.transaction():
            self._store.keep(asset, question=question)
            events = () if question is None else (("question", shown_question(question)),)
            changed = status_events(before, *replace(before, question=question).health()) if before else ()
            self._store.note(asset, (*events, *changed))
        if question is not None:
            log.warning("%s: %s", asset, question["detail"])
        self._board.update(asset, question=question, last_event_id=self._store.last_event_id(asset))
        self._publication.publish(asset)
        return question

    def waiting(self, asset: str) -> Iterator[tuple[int, Window]]:
        """The windows of an asset that wait; one whose file is damaged is given up."""
        for entry in self._life.waiting(asset):
            try:
                window = self._life.read_waiting(entry.id)
            except (OSError, ValueError, KeyError, TypeError) as error:
                log.error("%s: a window that waited cannot be read and is left out: %s", asset, error)
                self._life.drop_waiting(entry.id)
                continue
            yield entry.id, window
