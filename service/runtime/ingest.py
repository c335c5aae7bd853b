"""The role `ingest`: from the network to windows that wait to be assessed, in `serve` and in a fleet alike."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from functools import partial
from typing import Any

from service.bridges.bridge import Bridges
from service.errors import StorageUnavailable
from service.logs import figures as log_figures
from service.operation.health import WEBHOOKS, Health
from service.operation.telemetry import all_of, sending_traces
from service.operation.timing import Timing, said_figures
from service.results.storage_faults import is_away
from service.runtime.all_figures import figures_of
from service.runtime.begun import Begun
from service.runtime.feed import OnCommit
from service.runtime.ingested import OPENED, Ingested, figures_asked
from service.runtime.receiver import Receiver
from service.runtime.role_process import Context, Others
from service.runtime.storage_watch import StoppedWaiting, awaited
from service.runtime.twin_port import Twin
from service.runtime.webhooks import WebhookSender
from service.runtime.workers import WorkersOf
from service.settings import Settings
from service.transport.protocol import OpenTransport

LOOK_EVERY, LOOK_OFTEN = 0.5, 0.05  # whether there is something else to say, and until frames are taken [s]


def _is_asked(others: Others, answered_ns: int) -> bool:
    """Whether figures have been asked for since they were answered last."""
    return figures_asked(others) != answered_ns


class _Sayer(threading.Thread):
    """Says how this process is, in a thread of its own, as others may wait for a disk."""

    def __init__(self, context: Context, health: Health, *, alone: bool) -> None:
        """alone  whether only the supervisor sees to it that loops that hang do not stay so"""
        super().__init__(name="says", daemon=True)
        self._context, self._health, self._alone = context, health, alone
        self._receiver: Receiver | None = None
        self._figures: Callable[[], Mapping[str, Any]] = dict
        self._ended = threading.Event()
        self.waits: str | None = None  # why the results cannot be opened yet

    def of(self, receiver: Receiver, figures: Callable[[], Mapping[str, Any]]) -> None:
        """Says how a receiver is from now on."""
        self._figures, self._receiver = figures, receiver

    def run(self) -> None:
        said, others = Ingested(), self._context.others
        while not self._ended.is_set():
            pause = LOOK_EVERY if said.not_ready is None else LOOK_OFTEN
            others.wait_for(partial(_is_asked, others, said.asked_ns), pause)
            if self._alone and self._health.late():
                continue  # the supervisor ends who is silent
            self._context.beat()
            now = self._now(said, figures_asked(others))
            if now != said:
                self._context.say(now)
                said = now

    def end(self) -> None:
        self._ended.set()

    def _now(self, said: Ingested, asked_ns: int) -> Ingested:
        receiver = self._receiver
        if receiver is None:
            return Ingested(not_ready=self.waits or OPENED, asked_ns=asked_ns)
        return Ingested(
            begun=True, not_ready=receiver.not_ready(), instance=receiver.instance, unstored=receiver.unstored,
            lasts=receiver.storage_lasts, late=tuple(self._health.late()), asked_ns=asked_ns,
            figures=said.figures if said.asked_ns == asked_ns else self._figures(),
        )  # fmt: skip


def ingest(
    context: Context,
    settings: Settings,
    begin: Callable[[], AbstractContextManager[Begun]],
    twin: Twin,
    workers_of: WorkersOf,
    *,
    timing: Timing,
    open_transport: OpenTransport,
    meant: Callable[[StorageUnavailable], bool] = is_away,
    bridges_of: Callable[[Begun, Callable[[str, bytes], bool]], Bridges] | None = None,
    beside: Callable[[], Mapping[str, Any]] = dict,
    on_commit: Callable[[Begun], OnCommit] = lambda begun: lambda assets: None,
    node: str | None = None,
    says_figures: bool = False,
) -> None:
    """Does the role until it is to end; raises what has ended it before.

    begin         opens the results, as soon as they can be opened
    timing        of the results' storage
    meant         whether results that cannot be opened now are waited for
    bridges_of    the bridges to other networks, of what has begun and what takes a frame; None for none
    beside        more figures
    on_commit     called with assets of which others have committed something
    node          of a cluster, where it is on one
    says_figures  whether its row of the table of roles has its figures, too
    """
    health = Health(settings.loop_limit)
    says = _Sayer(context, health, alone=says_figures)
    says.start()
    with suppress(StoppedWaiting), ExitStack() as stack:
        stack.callback(says.end)
        sent = stack.enter_context(sending_traces(settings.otlp))

        def waited_for(error: StorageUnavailable) -> bool:
            says.waits = str(error)
            return meant(error)

        begun = stack.enter_context(awaited(begin, context.stop, waited_for))
        webhooks = WebhookSender(begun.alarms.store, begun.alarms.waiting)
        others = figures_of(*(part.figures for part in (webhooks, timing)), beside, log_figures)
        receiver = Receiver(
            settings, begun.kept, begun.rigs, twin, open_transport, health, workers_of,
            on_commit=on_commit(begun), on_end=context.stop.set, arrived=all_of(timing.arrived, sent),
            timed=timing.computed, node=node, said=others if says_figures else None,
        )  # fmt: skip
        bridges = () if bridges_of is None else (bridges_of(begun, receiver.offer),)
        parts = (receiver, webhooks, *bridges)
        for part in parts:
            part.start()
        health.thread(WEBHOOKS, webhooks)
        figures = figures_of(receiver.figures, others, *(bridge.figures for bridge in bridges))
        says.of(receiver, lambda: said_figures(figures()))
        try:
            context.stop.wait()
        finally:
            for part in parts:
                part.end()
        if receiver.failure is not None:
            raise receiver.failure
