"""An alarm as it is listed: its level, its state by ISA-18.2, what raised it, and who did what about it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

from pydantic import Field

from service.alarms.quantities import JUDGED
from service.contract.base import ContractModel
from service.contract.finding import Finding
from service.contract.status import Added

State = Literal["active_unacknowledged", "active_acknowledged", "returned_unacknowledged", "closed"]
STATES: tuple[State, ...] = ("active_unacknowledged", "active_acknowledged", "returned_unacknowledged", "closed")
LEVELS = ("watch", "alarm")


class Signed(ContractModel):
    """Who did something, when, and why."""

    by: str
    note: str
    at: str = Field(description="ISO 8601, by the service's clock")


class HistoryEntry(ContractModel):
    """One thing that happened to an alarm."""

    at: str = Field(description="ISO 8601: start of the window, or the service's clock where no window was evaluated")
    verb: Literal["raised", "escalated", "lowered", "ended", "acknowledged", "cleared"]
    level: Literal["watch", "alarm"]
    value: float | None = None
    limit: float | None = None
    window: int | None = None
    reason: str = ""
    by: str | None = None
    note: str | None = None


class Alarm(ContractModel):
    """One alarm: open until it has returned to normal and is acknowledged, or until somebody clears it."""

    id: int
    asset: str
    rule: str
    quantity: str
    place: str = Field(description="sensor, sensor/gear, effect, …; empty where there is one place only")
    level: Literal["watch", "alarm"]
    state: State
    active: bool = Field(description="whether the quantity is beyond its limit now")
    acknowledged: bool
    value: float | None = Field(description="in `unit`; null where a criterion gave the level")
    limit: float | None
    unit: str
    reason: str
    action: str
    raised_at: str
    window: int | None = Field(description="index of the window that raised it")
    ended_at: str | None = Field(default=None, description="when it returned to normal")
    acknowledgement: Signed | None = None
    clearance: Signed | None = None
    history: list[HistoryEntry] | None = Field(default=None, description="oldest first")


class AlarmCount(ContractModel):
    """Open alarms in numbers."""

    active: int
    unacknowledged: int


def state_of(active: bool, acknowledged: bool) -> State:
    """The state by ISA-18.2."""
    if active:
        return "active_acknowledged" if acknowledged else "active_unacknowledged"
    return "closed" if acknowledged else "returned_unacknowledged"


def counted(alarms: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """How many open alarms are active, and how many nobody has acknowledged."""
    known = list(alarms)
    return {
        "active": sum(a["active"] for a in known),
        "unacknowledged": sum(not a["acknowledged"] for a in known),
    }


def by_urgency(alarms: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Alarms before watches, active before returned, unacknowledged before acknowledged, newest first."""
    newest = sorted(alarms, key=lambda a: (a["raised_at"], a["id"]), reverse=True)
    return sorted(newest, key=lambda a: (-LEVELS.index(a["level"]), not a["active"], a["acknowledged"]))


def added_of(alarms: Sequence[Mapping[str, Any]]) -> list[Added]:
    """What active alarms add to the status; those that rest on its own findings add nothing."""
    return [
        Added(
            finding=Finding(
                subject="/".join(part for part in (alarm["quantity"], alarm["place"]) if part),
                level=alarm["level"],
                reason=alarm["reason"],
                action=alarm["action"],
            ),
            since=alarm["raised_at"],
        )
        for alarm in by_urgency(alarms)
        if alarm["active"] and alarm["quantity"] not in JUDGED
    ]
