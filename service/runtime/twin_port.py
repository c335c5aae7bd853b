"""The twin as the loop sees it: it takes a window or a decision, and gives a new state and an answer for people.

`Twin` holds the functions of `twin.step`; the tests put others in their place. What the core computes becomes names
and units of the contract here, on its way out of the core, and nowhere later.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from operator import attrgetter
from typing import Any

from service.errors import FAULT
from service.json_text import plain
from twin.errors import NotAvailable, TwinError
from twin.machine_change import MachineChange
from twin.observed import PartRefused
from twin.rig import Rig
from twin.tracing.decisions import Decision
from twin.windows import Window

log = logging.getLogger(__name__)

Events = tuple[tuple[str, Mapping[str, Any]], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What the twin says after a window or a decision; JSON-safe."""

    record: Mapping[str, Any]  # of the window; empty after a decision
    report: Mapping[str, Any]  # the parts of the answer
    events: Events  # kind and data


@dataclass(frozen=True, slots=True, kw_only=True)
class Twin:
    """The functions of one twin and the options that they are called with."""

    step: Callable[..., tuple[Any, Any]]  # (rig, state, window, options) → state, estimate
    new_state: Callable[[], Any]
    load_state: Callable[[Mapping[str, Any]], Any]  # from what `state.to_dict()` gave
    decide: Callable[..., tuple[Any, Any]] | None = None  # (rig, state, decision, options) → state, estimate
    inspect: Callable[..., tuple[Any, Any]] | None = None  # (rig, state, inspection, options) → state, estimate
    change: Callable[..., tuple[Any, Any]] | None = None  # (rig, state, change, options) → state, estimate
    ignore: Callable[[Any], Any] = lambda state: state  # the state that refuses windows of the fallen count unasked
    forget: Callable[[Any], Any] = lambda state: state  # the state without a fallen count
    curves: Callable[[Rig, Any], Mapping[Any, Any]] | None = None  # (rig, state) → wear curves at hand, by their keys
    options: Any = None
    at_once: int = 64  # how many of its calls the threads of one process may carry out at once
    make: Callable[[Any], Twin] | None = None  # makes it of options in another process; None where that cannot be

    def process(self, rig: Rig, state: Any, window: Window) -> tuple[Any, Answer]:
        """One window; TwinError where it cannot be used."""
        state, estimate = self.step(rig, state, window, self.options)
        return state, _answer(estimate)

    def apply(self, rig: Rig, state: Any, decision: Decision) -> tuple[Any, Answer]:
        """An engineer's decision on an effect; TwinError where it cannot be followed."""
        if self.decide is None:
            raise NotAvailable("this twin accepts no decisions")
        state, estimate = self.decide(rig, state, decision, self.options)
        return state, _answer(estimate)

    def inspected(self, rig: Rig, state: Any, inspection: Mapping[str, Any]) -> tuple[Any, Answer]:
        """A measured wear depth, as it was posted; TwinError where it cannot be used."""
        if self.inspect is None:
            raise NotAvailable("this twin does not use inspections")
        state, estimate = self.inspect(rig, state, inspection, self.options)
        return state, _answer(estimate)

    def follow(self, rig: Rig, state: Any, made: MachineChange) -> tuple[Any, Answer]:
        """A change of the machine; TwinError where it cannot be followed."""
        if self.change is None:
            raise NotAvailable("this twin follows no changes of the machine")
        state, estimate = self.change(rig, state, made, self.options)
        return state, _answer(estimate)


@dataclass(frozen=True, slots=True)
class _Later:
    """A function of a module that is imported at the first call."""

    module: str
    name: str

    def __call__(self, *given: Any) -> Any:
        return attrgetter(self.name)(import_module(self.module))(*given)


def gear_twin(options: Any = None) -> Twin:
    """The twin itself, imported where it is first called: the service's own process never does that."""
    from twin.options import Options

    return Twin(
        step=_Later("service.contract.estimate", "step"),
        new_state=_Later("twin.state", "State"),
        load_state=_Later("twin.state", "State.from_dict"),
        decide=_Later("service.contract.estimate", "decide"),
        inspect=_Later("service.contract.estimate", "inspect"),
        change=_Later("service.contract.estimate", "change"),
        ignore=_Later("twin.fallen_count", "with_fallen_ignored"),
        forget=_Later("twin.fallen_count", "with_fallen_forgotten"),
        curves=_Later("twin.kept_curves", "curves_of"),
        options=options or Options(),
        at_once=1,  # wear curves grow as they are used
        make=gear_twin,
    )


def guarded(twin: Twin, passed: tuple[type[Exception], ...] = ()) -> Twin:
    """The twin, with an internal error costing only the window or decision in which it occurred.

    passed  errors that whoever calls looks after
    """
    through: tuple[type[Exception], ...] = (TwinError, PartRefused, *passed)

    def barrier(call: Callable[..., tuple[Any, Any]]) -> Callable[..., tuple[Any, Any]]:
        def called(*given: Any) -> tuple[Any, Any]:
            try:
                return call(*given)
            except through:
                raise
            except Exception as error:
                log.exception("a window or decision was refused because of an internal error")
                raise TwinError(f"{FAULT}: {type(error).__name__}: {error}") from error

        return called

    return replace(
        twin,
        step=barrier(twin.step),
        decide=None if twin.decide is None else barrier(twin.decide),
        inspect=None if twin.inspect is None else barrier(twin.inspect),
        change=None if twin.change is None else barrier(twin.change),
    )


def _answer(estimate: Any) -> Answer:
    return Answer(
        record=plain(estimate.record),
        report=plain(estimate.report),
        events=tuple((kind, plain(data)) for kind, data in estimate.events),
    )
