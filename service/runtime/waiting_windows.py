"""Windows that cannot be used until people have answered: into the store, and shown on the board."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from service.contract.status import shown_question
from service.results.board import Board
from service.results.sql_store import SqlStore
from service.results.status_events import status_events
from service.results.window_jobs import WindowJobs
from service.runtime import questions
from service.runtime.outcomes import HeldWindow
from service.runtime.state_publication import StatePublication
from service.steady_clock import later_time_ns

log = logging.getLogger(__name__)


class WaitingWindows:
    """A `WaitingPlace` over the service's database."""

    def __init__(
        self,
        store: SqlStore,
        windows: WindowJobs,
        board: Board,
        publication: StatePublication,
        clock: Callable[[], int] = later_time_ns,
    ) -> None:
        self._store, self._windows, self._board, self._publication = store, windows, board, publication
        self._clock = clock

    def hold(self, held: HeldWindow) -> Mapping[str, Any]:
        """Keeps that a window waits for the answer, and what the twin remembers of it, in one transaction."""
        question, received_ns = questions.waiting(held.question, held.waiting), self._clock()
        with self._windows.transaction():
            state = {} if held.state is None else {"state": held.state.to_dict()}
            self._store.keep(held.asset, question=question, received_ns=received_ns, **state)
            before = self._board.get(held.asset)
            changed = status_events(before, *replace(before, question=question).health()) if before else ()
            self._store.note(held.asset, (*held.events, *changed))
            last = self._store.last_event_id(held.asset)
        self._board.update(held.asset, question=question, received_ns=received_ns, last_event_id=last)
        self._publication.publish(held.asset)
        return question

    def ask(self, asset: str, question: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
        """Keeps and shows a question for which no window waits yet, or that it is over."""
        before = self._board.get(asset)
        with self._windows.transaction():
            self._store.keep(asset, question=question)
            events = () if question is None else (("question", shown_question(question)),)
            changed = status_events(before, *replace(before, question=question).health()) if before else ()
            self._store.note(asset, (*events, *changed))
            last = self._store.last_event_id(asset)
        if question is not None:
            log.warning("%s: %s", asset, question["detail"], extra={"asset": asset})
        self._board.update(asset, question=question, last_event_id=last)
        self._publication.publish(asset)
        return question
