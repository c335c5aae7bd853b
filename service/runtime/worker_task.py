"""What a worker process does: one call after the other, with what it has loaded before at hand.

Everything arrives as bytes, so that the service's own process neither parses nor builds states. Rigs, twins and the
states that a call led to are kept by what they were made from, within bounds. What is logged meanwhile goes back with
the result: the service's log has it in its own form, and no lock is shared with a process that may be killed.
"""

from __future__ import annotations

import logging
import os
import pickle
import signal
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from multiprocessing import connection, parent_process
from typing import Any, TypeVar

from service.logs import carry
from service.runtime.computing import Ask, Call, Made, carry_out
from service.runtime.curves import CurvePlace, Curves, WorkerCurves
from service.runtime.packed_state import PackedState
from service.runtime.twin_port import Twin, guarded
from twin.rig import Rig

T = TypeVar("T")

MACHINES = 2048  # that are at hand pickled; those of others are pickled again
KEPT = 64  # assets whose rig, twin and state a worker has at hand; those of others are loaded again
NICENESS = 10  # of a worker: frames are received and requests are answered before windows are computed
MOST_RECORDS = 200  # log records that one call sends back

Machine = tuple[Callable[[Any], Twin], Any, Rig]
"""What makes a twin, its options, and the rig."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A call as it is sent to a worker.

    curves  where wear curves are kept, for those that this worker has not computed; None where they are nowhere
    """

    asset: str
    machine: bytes  # a pickled `Machine`
    state: PackedState
    ask: Ask
    hand_back: bool = False
    curves: CurvePlace | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """What a worker sends back: `made.state` is packed.

    curves  the asset's wear curves, where there are new ones and they are kept
    """

    made: Made
    records: tuple[logging.LogRecord, ...]
    curves: Curves | None = None


class Tasks:
    """Calls as tasks; machines are pickled once."""

    def __init__(self, curves: CurvePlace | None = None) -> None:
        self._curves = curves
        self._machines = _Recent(MACHINES)  # twin, rig and both pickled, by asset

    def of(self, call: Call) -> Task:
        """The task of a call whose state is packed."""
        assert isinstance(call.state, PackedState)
        known = self._machines.get(call.asset)
        if known is None or known[0] is not call.twin or known[1] is not call.rig:
            pickled = pickle.dumps((call.twin.make, call.twin.options, call.rig))
            known = call.twin, call.rig, pickled
            self._machines.keep(call.asset, known)
        return Task(
            asset=call.asset, machine=known[2], state=call.state, ask=call.ask, hand_back=call.hand_back,
            curves=self._curves,
        )  # fmt: skip


class _Recent(OrderedDict[Hashable, Any]):
    """Values by key, so many of the most recently used ones."""

    def __init__(self, most: int = KEPT) -> None:
        super().__init__()
        self._most = most

    def get_or(self, key: Hashable, make: Callable[[], T]) -> T:
        value: T = self[key] if key in self else make()
        self.keep(key, value)
        return value

    def keep(self, key: Hashable, value: Any) -> None:
        self[key] = value
        self.move_to_end(key)
        while len(self) > self._most:
            self.popitem(last=False)


class _Records(logging.Handler):
    """Keeps what is logged until it is taken."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: list[logging.LogRecord] = []

    def emit(self, record: logging.LogRecord) -> None:
        if len(self.kept) < MOST_RECORDS:
            carry(record)
            self.kept.append(record)

    def take(self) -> tuple[logging.LogRecord, ...]:
        taken, self.kept = tuple(self.kept), []
        return taken


_machines, _states, _records, _curves = _Recent(), _Recent(), _Records(), WorkerCurves()


def begin(log_level: int, cache_bytes: int) -> None:
    """Prepares a worker: it ends with the service, and not by signals that are meant for that."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    prepare(log_level, cache_bytes)


def prepare(log_level: int, cache_bytes: int) -> None:
    """Lets this process carry out tasks and do nothing else."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    root = logging.getLogger()
    root.handlers[:] = [_records]
    root.setLevel(log_level)
    logging.captureWarnings(True)
    from twin.updating.model_cache import PATHS  # loads the twin, which the service's own process does without

    PATHS.budget = cache_bytes


def _end_with_parent() -> None:
    """Ends the process at once when the service has ended, however that was."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def perform(task: Task) -> Reply:
    """Carries a call out."""
    twin, rig = _machines.get_or(task.machine, lambda: _machine(task.machine))
    version, state = _states.get(task.asset, (None, None))
    if task.state.version != version:
        state = task.state
    call = Call(asset=task.asset, twin=twin, rig=rig, state=state, ask=task.ask, hand_back=task.hand_back)
    curves = None
    with _curves.read_from(task.curves, task.asset):
        made = carry_out(call)
    if made.state is not None:
        if task.curves is not None and twin.curves is not None:
            curves = _curves.new_of(task.asset, twin.curves(rig, made.state))
        packed = PackedState.of(made.state.to_dict())
        _states.keep(task.asset, (packed.version, made.state))
        made = replace(made, state=packed)
    return Reply(made=made, records=_records.take(), curves=curves)


def _machine(pickled: bytes) -> tuple[Twin, Rig]:
    make, options, rig = pickle.loads(pickled)
    return guarded(make(options), passed=(MemoryError,)), rig  # another process may have enough
