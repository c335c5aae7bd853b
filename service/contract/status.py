"""`status` and `data`: what a person should know first about a machine, and whether usable data come from it.

The level is that of the most severe finding (service/contract/findings.py), the reasons are those of all findings, and
the action is that of the first. `normal` is said only where there is no finding, so that nothing that the contract
names as an alarm can pass for normal. What the service knows besides the assessment is added where the state is shown:

| what | level |
| --- | --- |
| the latest window is refused or degraded | no_verdict |
| no whole window for longer than the service allows | no_verdict |
| an active alarm on a level, an indicator or a temperature | that of the alarm |
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from service.contract.base import ContractModel, iso_time
from service.contract.finding import SEVERITY, Finding, Level, by_severity, sentence
from twin.attention import STATUS_LIMITS, StatusLimits

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment

DataLevel = Literal["waiting", "ok", "degraded", "stale"]
DATA_LEVELS: tuple[DataLevel, ...] = ("waiting", "ok", "degraded", "stale")
NORMAL_REASON = "The twin explains the vibration, and wear is far from its limit."
NO_ACTION = "No action needed."
WAIT = "Send the first measurement window: nothing can be said of the machine before."
RENEW = "Send a new measurement window: it renews the figures."
REPAIR = "Free space, repair the disk, or start the database server: what has been received is kept meanwhile."
CHECK = "Check the data before the machine is judged"


class Since(ContractModel):
    """When a level was reached."""

    time: str | None
    revolutions: float | None


class Status(ContractModel):
    """What a person should know first."""

    level: Level
    reasons: list[str] = Field(description="one sentence each, most important first")
    action: str = Field(default=NO_ACTION, description="what to do: one sentence in the imperative")
    findings: list[Finding] = Field(default=[], description="what the level is made of, most severe first")
    since: Since | None = Field(default=None, description="when this level was reached")


class DataStatus(ContractModel):
    """Whether usable data come; says nothing of the machine's health."""

    level: DataLevel
    reason: str
    since: str | None = Field(default=None, description="when it became degraded or stale, ISO 8601")


class Unstored(ContractModel):
    """Why results cannot be stored at present; windows that are received wait."""

    reason: str
    since: str = Field(description="ISO 8601, by the service's clock")


class Added(ContractModel):
    """A finding of the service that is not in the assessment."""

    finding: Finding
    since: str | None = None  # ISO 8601


# -- of an assessment --------------------------------------------------------------------------------------


def status_of(found: assessment.Assessment, limits: StatusLimits = STATUS_LIMITS) -> Status:
    """The status that an assessment alone gives, without `since`."""
    from service.contract.findings import findings_of  # loads the types of the twin, which a start does without

    return of_findings(findings_of(found, limits))


def of_findings(findings: Iterable[Finding]) -> Status:
    """The status that findings make."""
    ordered = by_severity(findings)
    if not ordered:
        return Status(level="normal", reasons=[NORMAL_REASON], action=NO_ACTION, findings=[])
    return Status(
        level=ordered[0].level,
        reasons=list(dict.fromkeys(f.reason for f in ordered)),
        action=ordered[0].action,
        findings=ordered,
    )


def without_verdict(reason: str, action: str) -> dict[str, Any]:
    """A status that gives no verdict, for one reason, as JSON data."""
    finding = Finding(subject="data", level="no_verdict", reason=sentence(reason), action=action)
    return of_findings([finding]).as_json()


def none_yet(reason: str) -> dict[str, Any]:
    """The status of an asset before its first assessment."""
    return without_verdict(reason, WAIT)


def with_status_since(
    before: Mapping[str, Any] | None, now: Mapping[str, Any], time_ns: int, revolutions: float | None
) -> dict[str, Any]:
    """A report whose status says since when its level holds: as before where the level is the same, else this window.

    before  the report of the window before; time_ns and revolutions are this window's
    """
    if "status" not in now:
        return dict(now)
    old, status = (before or {}).get("status") or {}, now["status"]
    since = old.get("since") if old.get("level") == status["level"] else None
    since = since or Since(time=iso_time(time_ns), revolutions=revolutions).as_json()
    return {**now, "status": {**status, "since": since}}


# -- what the service adds ---------------------------------------------------------------------------------


def data_of(
    records: Sequence[Mapping[str, Any]], stale: tuple[str, str] | None = None, waiting: str = "no window yet"
) -> DataStatus:
    """Whether usable data come.

    records  the latest windows, oldest first
    stale    why no whole window has come for longer than the service allows, and since when; None where one has
    waiting  what is said before the first window
    """
    if stale is not None:
        return DataStatus(level="stale", reason=stale[0], since=stale[1])
    if not records:
        return DataStatus(level="waiting", reason=waiting)
    grade, since = _grade(records[-1]), None
    if grade not in ("degraded", "refused"):
        return DataStatus(level="ok", reason=f"the latest window is {grade}")
    for record in reversed(records):
        if _grade(record) not in ("degraded", "refused"):
            break
        since = record.get("start_time")
    faults = dict.fromkeys(f"{f['kind'].replace('_', ' ')} in {f['channel']}" for f in records[-1].get("faults") or ())
    why = records[-1].get("reason") or ", ".join(faults) or "the cause was not recorded"
    return DataStatus(level="degraded", reason=f"the latest window is {grade}: {why}", since=since)


def shown(status: Mapping[str, Any], data: DataStatus, added: Sequence[Added] = ()) -> dict[str, Any]:
    """A report's status as it is shown: with the quality of the data, and with what the service found besides."""
    bad = [_data_finding(data)] if data.level in ("degraded", "stale") else []
    return _with(status, [*bad, *added])


def not_stored(unstored: tuple[str, str] | None) -> tuple[Added, ...]:
    """The finding that the storage cannot be used, from reason and time; nothing is `normal` until it can."""
    if unstored is None:
        return ()
    reason, since = unstored
    text = sentence(f"Results cannot be stored: {reason}")
    return (Added(finding=Finding(subject="storage", level="no_verdict", reason=text, action=REPAIR), since=since),)


def _with(status: Mapping[str, Any], added: Sequence[Added]) -> dict[str, Any]:
    before = status["level"]
    findings = by_severity([*_findings_in(status), *(a.finding for a in added)])
    # of no verdict, an open question comes first, then the data: nothing else can be judged before they are cured
    first = {("question", "no_verdict"): 0, ("data", "no_verdict"): 1}
    findings.sort(key=lambda f: (-SEVERITY.index(f.level), first.get((f.subject, f.level), 2)))
    now = of_findings(findings).as_json()
    if not findings:
        now["reasons"] = list(status["reasons"])
    since = status.get("since")
    if now["level"] != before:
        began = next((a.since for a in added if a.finding.level == now["level"]), None)
        since = None if began is None else Since(time=began, revolutions=None).as_json()
    return {**status, **now, "since": since}


def _findings_in(status: Mapping[str, Any]) -> list[Finding]:
    """The findings of a report; those of a report without any (of an earlier version) are made of its reasons."""
    kept = status.get("findings")
    if kept is not None:
        return [Finding.model_validate(finding) for finding in kept]
    if status["level"] == "normal":
        return []
    action = status.get("action") or RENEW
    return [Finding(subject="report", level=status["level"], reason=r, action=action) for r in status["reasons"]]


def _data_finding(data: DataStatus) -> Added:
    reason = sentence(f"{data.reason[:1].upper()}{data.reason[1:]}")
    action = (
        "Check the acquisition and the connection: no usable measurement window is received."
        if data.level == "stale"
        else f"{CHECK}: {sentence(data.reason)}"
    )
    finding = Finding(subject="data", level="no_verdict", reason=reason, action=action)
    return Added(finding=finding, since=data.since)


def _grade(record: Mapping[str, Any]) -> str:
    return record.get("quality") or "good"
