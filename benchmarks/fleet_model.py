"""A model of a fleet: windows of many assets through partitions on nodes, event by event.

Each partition has a thread that receives and commits, and one process that computes. What either does next is the
oldest thing that waits for it. It needs a core of its node for as long as it computes, and none while it waits for the
database. A node that is lost takes what is under way with it: the windows wait, the partition begins on another node
once the loss is known, and the first window of each asset there finds nothing at hand.
"""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Costs:
    """What things take [s]."""

    receive: float  # processor time of the receiving thread until a window is durable
    commit: float  # processor time of the same thread once it has been computed
    warm: Array  # steps of assets that are at hand, to be drawn from
    cold: Array  # the first step of an asset in a process
    sleep: float = 0.0  # in place of a step: a twin that only sleeps, for many assets at once
    database: float = 0.0  # one transaction, without a core
    close: float = 0.0  # silence after which a window is closed
    asked_every: float = 0.0  # how often the publisher of many assets asks how far they are stored; 0: never
    asking: float = 0.0  # what follows a question and counts as no silence
    detect: float = 5.0  # until the loss of a node is known
    restart: float = 5.0  # processor time of a partition's start
    restart_wait: float = 0.0  # of the same, without a core


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A fleet and its load."""

    assets: int
    period: float  # of an asset's windows [s]
    partitions: int
    nodes: int
    cores: int  # of each node
    seconds: float
    lose_at: float | None = None  # when nodes are lost [s]
    lose: int = 0  # how many
    warm_start: bool = True  # every asset is at hand at the begin
    learning: int = 0  # windows of each asset at its begin that are drawn from `cold` instead


@dataclass(slots=True)
class Result:
    """What came of it."""

    plan: Plan
    ended: Array = field(default_factory=lambda: np.empty(0))  # end of each window [s]
    committed: Array = field(default_factory=lambda: np.empty(0))  # when its results were [s]
    busy: float = 0.0  # of all cores
    served: float = 0.0  # after a loss, until the last partition is served [s]
    drained: float = 0.0  # after a loss, until nothing waits that came before it was served [s]

    @property
    def lags(self) -> Array:
        """Of results behind windows, before any loss [s]."""
        lose_at = self.plan.lose_at
        chosen = np.ones(self.ended.size, bool) if lose_at is None else self.committed < lose_at
        return (self.committed - self.ended)[chosen]

    def lag(self, percent: float) -> float:
        lags = self.lags
        return float(np.percentile(lags, percent)) if lags.size else float("nan")


@dataclass(slots=True, eq=False)
class _Node:
    free: int
    waiting: deque[_Task] = field(default_factory=deque)
    lost: bool = False


@dataclass(slots=True, eq=False)
class _Task:
    thread: _Thread
    processor: float
    wait: float
    done: Callable[[], None]


@dataclass(slots=True, eq=False)
class _Thread:
    """One thing at a time, on the node of its partition."""

    node: _Node
    waiting: deque[_Task] = field(default_factory=deque)
    busy: bool = False


@dataclass(slots=True, eq=False)
class _Window:
    asset: int
    ended: float


class _Partition:
    def __init__(self, node: _Node) -> None:
        self.begin(node)
        self.served = True
        self.open: dict[int, _Window] = {}  # closed windows whose results are not committed, by their number
        self.warm: set[int] = set()  # assets at hand

    def begin(self, node: _Node) -> None:
        self.node = node
        self.receiving, self.computing = _Thread(node), _Thread(node)


class Model:
    """One run of a plan."""

    def __init__(self, plan: Plan, costs: Costs, seed: int = 1) -> None:
        self._plan, self._costs, self._rng = plan, costs, np.random.default_rng(seed)
        self._now, self._order = 0.0, itertools.count()
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._nodes = [_Node(plan.cores) for _ in range(plan.nodes)]
        self._partitions = [_Partition(self._nodes[p % plan.nodes]) for p in range(plan.partitions)]
        self._seen: dict[int, int] = {}
        self._result = Result(plan)
        self._ended: list[float] = []
        self._committed: list[float] = []

    def run(self) -> Result:
        """The whole plan, until nothing waits."""
        plan, rng = self._plan, self._rng
        for asset, phase in enumerate(rng.permutation(plan.assets) * plan.period / plan.assets):
            if plan.warm_start:
                self._partitions[asset % plan.partitions].warm.add(asset)
            for ended in np.arange(phase, plan.seconds, plan.period):
                window = _Window(asset, float(ended))
                self._at(window.ended + self._silence(), partial(self._close, window))
        if plan.lose_at is not None:
            self._at(plan.lose_at, self._lose)
        while self._events:
            self._now, _, event = heapq.heappop(self._events)
            event()
        result = self._result
        result.ended, result.committed = np.array(self._ended), np.array(self._committed)
        if plan.lose_at is not None:
            late = result.ended < plan.lose_at + result.served
            result.drained = float(np.max(result.committed[late], initial=plan.lose_at)) - plan.lose_at
        return result

    def _silence(self) -> float:
        """How long after its last frame a window is closed."""
        costs = self._costs
        if not costs.asked_every:
            return costs.close
        ended, counted, next_question = 0.0, 0.0, float(self._rng.uniform(0.0, costs.asked_every))
        while counted + next_question - ended < costs.close:
            counted += next_question - ended
            ended = next_question + costs.asking
            next_question += costs.asked_every
        return ended + costs.close - counted

    # -- windows -------------------------------------------------------------------------------------

    def _close(self, window: _Window) -> None:
        partition = self._partitions[window.asset % self._plan.partitions]
        partition.open[id(window)] = window
        if partition.served:
            self._receive(partition, window)

    def _receive(self, partition: _Partition, window: _Window) -> None:
        costs = self._costs
        self._do(partition.receiving, costs.receive, costs.database, partial(self._compute, partition, window))

    def _compute(self, partition: _Partition, window: _Window) -> None:
        asset, costs = window.asset, self._costs
        learns = self._seen.get(asset, 0) < self._plan.learning
        if costs.sleep:
            self._at(self._now + costs.sleep, partial(self._slept, partition, partition.node, window))
            return
        drawn = costs.warm if asset in partition.warm and not learns else costs.cold
        partition.warm.add(asset)
        step = float(self._rng.choice(drawn))
        self._do(partition.computing, step, 0.0, partial(self._commit, partition, window))

    def _slept(self, partition: _Partition, node: _Node, window: _Window) -> None:
        if not node.lost:
            self._commit(partition, window)

    def _commit(self, partition: _Partition, window: _Window) -> None:
        def committed() -> None:
            del partition.open[id(window)]
            self._seen[window.asset] = self._seen.get(window.asset, 0) + 1
            self._ended.append(window.ended)
            self._committed.append(self._now)

        self._do(partition.receiving, self._costs.commit, self._costs.database, committed)

    # -- nodes ---------------------------------------------------------------------------------------

    def _lose(self) -> None:
        lost = self._nodes[: self._plan.lose]
        for node in lost:
            node.lost = True
        gone = [p for p in self._partitions if p.node.lost]
        for partition in gone:
            partition.served = False
        self._at(self._now + self._costs.detect, partial(self._replace, gone))

    def _replace(self, gone: list[_Partition]) -> None:
        counts = {id(node): 0 for node in self._nodes}
        for partition in self._partitions:
            counts[id(partition.node)] += 1
        for partition in gone:
            node = min((n for n in self._nodes if not n.lost), key=lambda n: counts[id(n)])
            counts[id(node)] += 1
            partition.begin(node)
            partition.warm.clear()
            costs = self._costs
            self._do(partition.receiving, costs.restart, costs.restart_wait, partial(self._served, partition))

    def _served(self, partition: _Partition) -> None:
        assert self._plan.lose_at is not None
        partition.served = True
        self._result.served = self._now - self._plan.lose_at
        for window in list(partition.open.values()):
            self._receive(partition, window)

    # -- cores ---------------------------------------------------------------------------------------

    def _do(self, thread: _Thread, processor: float, wait: float, done: Callable[[], None]) -> None:
        thread.waiting.append(_Task(thread, processor, wait, done))
        self._next(thread)

    def _next(self, thread: _Thread) -> None:
        if thread.waiting and not thread.busy:
            thread.busy = True
            thread.node.waiting.append(thread.waiting.popleft())
            self._grant(thread.node)

    def _grant(self, node: _Node) -> None:
        while node.free and node.waiting and not node.lost:
            task = node.waiting.popleft()
            node.free -= 1
            self._result.busy += task.processor
            self._at(self._now + task.processor, partial(self._computed, task))

    def _computed(self, task: _Task) -> None:
        node = task.thread.node
        if node.lost:
            return
        node.free += 1
        self._grant(node)
        self._at(self._now + task.wait, partial(self._finish, task))

    def _finish(self, task: _Task) -> None:
        thread = task.thread
        if thread.node.lost:
            return
        thread.busy = False
        task.done()
        self._next(thread)

    def _at(self, time: float, event: Callable[[], None]) -> None:
        heapq.heappush(self._events, (time, next(self._order), event))
