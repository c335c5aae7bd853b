"""`status` and `data`: what a person should know first about a machine, and whether usable data come from it.

Every status, wherever it is shown or acted on, is made by `status_from` one typed `Basis`. The level is that of the
most severe finding (service/contract/findings.py), the reasons are those of all findings, and the action is that of the
first. `normal` is said only where there is no finding, and then with what it rests on. Besides what the assessment
says, the basis holds the window that the verdict rests on (verdict.py), and what the service knows when it is shown:

| what | level |
| --- | --- |
| the latest windows were not assessed for longer than is usual | no_verdict |
| the latest window is refused or degraded | no_verdict |
| no whole window for longer than the service allows | no_verdict |
| an active alarm on a level, an indicator or a temperature | that of the alarm |

A level rises at once, and falls only after some assessed windows in a row at a lower level (twin/held_level.py).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from pydantic import Field

from service.contract.base import ContractModel, iso_time
from service.contract.finding import NO_ACTION, SEVERITY, Finding, Level, by_severity, sentence, shortened
from service.contract.findings import findings_of, normal_reason
from service.contract.verdict import SUBJECT, Verdict
from twin import assessment
from twin.attention import STATUS_LIMITS, StatusLimits
from twin.held_level import HeldLevel, LevelHysteresis

DataLevel = Literal["waiting", "ok", "degraded", "stale"]
DATA_LEVELS: tuple[DataLevel, ...] = ("waiting", "ok", "degraded", "stale")
NORMAL_REASON = "Nothing that calls for attention was found."
HELD: tuple[Level, ...] = ("watch", "alarm", "end_of_life")
HYSTERESIS = LevelHysteresis()
WAIT = "Send the first measurement window: nothing can be said of the machine before."
WAIT_ON = "Wait until the windows that have come are assessed: nothing needs to be sent."
REPAIR_WORKERS = "Look into the log of the service: what has been received is kept, and assessed once a worker lives."
MOST_BEHIND = 3  # machines that are named
REPAIR = "Free space, repair the disk, or start the database server: what has been received is kept meanwhile."
CHECK = "Check the data before the machine is judged"
ANSWER = "Answer the open question: windows wait for it."
HIDDEN = ("rig", "settings")  # what the service keeps with a question for itself


class Since(ContractModel):
    """When a level was reached."""

    time: str | None
    revolutions: float | None


class Status(ContractModel):
    """What a person should know first."""

    level: Level
    summary: str = Field(default="", description="the state in at most 25 words")
    reasons: list[str] = Field(description="one sentence each, most important first")
    action: str = Field(default=NO_ACTION, description="what to do: one sentence in the imperative")
    findings: list[Finding] = Field(default=[], description="what the level is made of, most severe first")
    since: Since | None = Field(default=None, description="when this level was reached")
    verdict: Verdict | None = Field(default=None, description="the window that the verdict rests on")


class Backlog(ContractModel):
    """Windows that have come and are not assessed yet."""

    windows: int
    since: str = Field(description="when the oldest of them was complete, ISO 8601, by the service's clock")
    behind: list[str] = Field(description="machines that are assessed before; empty where it is this machine's turn")
    reason: str | None = Field(default=None, description="why no window of any machine can be assessed at present")

    def sentence(self) -> str:
        """How many wait, since when and behind which machines, or why none can be assessed."""
        behind = f", behind {', '.join(self.behind[:MOST_BEHIND])}" if self.behind else ""
        wait = "windows wait" if self.windows > 1 else "window waits"
        why = f": {self.reason}" if self.reason else behind
        return f"{self.windows} {wait} to be assessed since {self.since[11:19]} UTC{why}"


class DataStatus(ContractModel):
    """Whether usable data come; says nothing of the machine's health."""

    level: DataLevel
    reason: str
    since: str | None = Field(default=None, description="when it became degraded or stale, ISO 8601")
    waiting: Backlog | None = Field(default=None, description="absent while no window waits to be assessed")


class Unstored(ContractModel):
    """Why results cannot be stored at present; windows that are received wait."""

    reason: str
    since: str = Field(description="ISO 8601, by the service's clock")


class Added(ContractModel):
    """A finding of the service that is not in the assessment."""

    finding: Finding
    since: str | None = None  # ISO 8601


class Question(ContractModel):
    """A question that only people can answer. While it is open, the asset is never `normal`."""

    kind: Literal["count_fell", "gears_differ", "frames_repeat"]
    text: str
    detail: str = Field(description="what raised it")
    since: str = Field(description="ISO 8601, by the stream's clock")
    answers: list[str] = Field(description="kinds of change that answer it (`POST /v1/assets/{asset}/changes`)")
    waiting: int = Field(description="windows that are kept until it is answered, and processed then")
    left_out: int | None = Field(default=None, description="windows for which there was no room to wait")
    differences: list[str] | None = Field(default=None, description="of the rig files")


class Retired(ContractModel):
    """An asset that is out of use."""

    since: str
    by: str | None = None
    note: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Basis:
    """All that a status is made of."""

    findings: tuple[Finding, ...]
    normal: str = NORMAL_REASON  # what is said where nothing is found
    verdict: Verdict | None = None  # the window that the findings rest on; None where they rest on none


def status_from(basis: Basis) -> Status:
    """The status: the one function that makes levels, reasons and actions."""
    old = None if basis.verdict is None else basis.verdict.finding()
    ordered = _ordered(basis.findings if old is None else (*basis.findings, old))
    reasons = [f.reason for f in ordered]
    if not ordered or ordered[0].level == "normal":
        reasons.insert(0, basis.normal)
    level, summary = (ordered[0].level if ordered else "normal"), reasons[0]
    if old is None and basis.verdict is not None and basis.verdict.not_assessed and basis.verdict.window is not None:
        reasons.insert(1, basis.verdict.sentence())
        summary = basis.verdict.summary() if level == "normal" else summary
    status = Status(
        level=level,
        summary=shortened(summary),
        reasons=list(dict.fromkeys(reasons)),
        action=ordered[0].action if ordered else NO_ACTION,
        findings=ordered,
    )
    return status if basis.verdict is None else status.model_copy(update={"verdict": basis.verdict})


def _ordered(findings: Iterable[Finding]) -> list[Finding]:
    """The most severe first; of no verdict, what must be cured before anything else can be judged.

    That windows were not assessed follows the first finding, so that it is said beside a standing alarm.
    """
    first = {"question": 0, SUBJECT: 1, "storage": 2, "data": 3}
    found = by_severity(findings)
    found.sort(key=lambda f: (-SEVERITY.index(f.level), first.get(f.subject, 4) if f.level == "no_verdict" else 0))
    old = next((f for f in found[1:] if f.subject == SUBJECT), None)
    if old is not None and found[0].level != "no_verdict":
        found.remove(old)
        found.insert(1, old)
    return found


# -- of an assessment --------------------------------------------------------------------------------------


def status_of(found: assessment.Assessment, limits: StatusLimits = STATUS_LIMITS) -> Status:
    """The status that an assessment alone gives, without `since` and without the levels of earlier windows."""
    return status_from(basis_of(found, limits))


def status_after(
    found: assessment.Assessment, held: HeldLevel, limits: StatusLimits = STATUS_LIMITS
) -> tuple[Status, HeldLevel]:
    """The status after a window and the level that is held then: it falls only after some windows in a row."""
    basis = basis_of(found, limits)
    top = next(iter(_ordered(basis.findings)), None)
    rank, was = SEVERITY.index("normal" if top is None else top.level), SEVERITY.index(held.level)  # type: ignore[arg-type]
    verdict = found.verdict
    at = 0 if verdict is None else verdict.latest_ns
    if rank >= was or found.window is None:
        return status_from(basis), level_held(top, at)
    counts = verdict is None or verdict.index is None or not verdict.since
    held = replace(held, lower=held.lower + counts)
    if held.lower >= HYSTERESIS.windows:
        return status_from(basis), level_held(top, at)
    kept = tuple(f for f in basis.findings if f.subject != held.subject)
    return status_from(replace(basis, findings=(_still(held), *kept))), held


def level_held(top: Finding | None, time_ns: int) -> HeldLevel:
    """The level that is held after a window at `time_ns` whose first finding this is."""
    if top is None or top.level not in HELD:
        return HeldLevel()
    return HeldLevel(level=top.level, subject=top.subject, reason=top.reason, action=top.action, time_ns=time_ns)


def _still(held: HeldLevel) -> Finding:
    """The finding of an earlier window whose level is held."""
    until = iso_time(held.time_ns)[:16].replace("T", " ")
    since = f"lower since in {held.lower} of the {HYSTERESIS.windows} windows after which the level falls"
    return Finding(
        subject=held.subject,
        level=held.level,  # type: ignore[arg-type]
        reason=f"{held.reason} So it was until {until} UTC; {since}.",
        action=held.action,
    )


def basis_of(found: assessment.Assessment, limits: StatusLimits = STATUS_LIMITS) -> Basis:
    """What an assessment gives for a status."""
    return Basis(
        findings=tuple(findings_of(found, limits)),
        normal=normal_reason(found),
        verdict=None if found.verdict is None else Verdict.of(found.verdict),
    )


def without_verdict(reason: str, action: str) -> dict[str, Any]:
    """A status that gives no verdict, for one reason, as JSON data."""
    finding = Finding(subject="data", level="no_verdict", reason=sentence(reason), action=action)
    return status_from(Basis(findings=(finding,))).as_json()


def none_yet(reason: str, backlog: Backlog | None = None) -> dict[str, Any]:
    """The status of an asset before its first assessment; `backlog` waits for it."""
    if backlog is None:
        return without_verdict(reason, WAIT)
    return without_verdict(backlog.sentence(), WAIT_ON if backlog.reason is None else REPAIR_WORKERS)


def with_status_since(
    before: Mapping[str, Any] | None,
    now: Mapping[str, Any],
    time_ns: int,
    revolutions: float | None,
    index: int | None = None,
) -> dict[str, Any]:
    """A report whose status says since when its level holds: as before where the level is the same, else this window.

    before  the report of the window before; time_ns, revolutions and index are this window's
    index   None where no window was assessed: the verdict's window is then that of before
    """
    if "status" not in now:
        return dict(now)
    old, status = (before or {}).get("status") or {}, now["status"]
    since = old.get("since") if old.get("level") == status["level"] else None
    since = since or Since(time=iso_time(time_ns), revolutions=revolutions).as_json()
    status = {**status, "since": since}
    verdict = status.get("verdict")
    if verdict is not None and verdict["window"] is not None:
        own = index if index is not None and not verdict["not_assessed"] else (old.get("verdict") or {}).get("window")
        status["verdict"] = {**verdict, "window": verdict["window"] if own is None else own}
    return {**now, "status": status}


# -- what the service adds ---------------------------------------------------------------------------------


def data_of(
    records: Sequence[Mapping[str, Any]],
    stale: tuple[str, str] | None = None,
    waiting: str = "no window yet",
    backlog: Backlog | None = None,
) -> DataStatus:
    """Whether usable data come.

    records  the latest windows, oldest first
    stale    why no whole window has come for longer than the service allows, and since when; None where one has
    waiting  what is said before the first window
    backlog  the windows that wait to be assessed; None where none does
    """
    found = _data_of(records, stale, waiting)
    if backlog is None:
        return found
    reason = f"{found.reason}; {backlog.sentence()}" if records else backlog.sentence()
    return found.model_copy(update={"reason": reason, "waiting": backlog})


def _data_of(records: Sequence[Mapping[str, Any]], stale: tuple[str, str] | None, waiting: str) -> DataStatus:
    """The same without what waits."""
    if stale is not None:
        return DataStatus(level="stale", reason=stale[0], since=stale[1])
    if not records:
        return DataStatus(level="waiting", reason=waiting)
    grade, since = _grade(records[-1]), None
    if grade not in ("degraded", "refused"):
        return DataStatus(level="ok", reason=f"the latest window is {grade}{_without(records[-1])}")
    for record in reversed(records):
        if _grade(record) not in ("degraded", "refused"):
            break
        since = record.get("start_time")
    faults = dict.fromkeys(f"{f['kind'].replace('_', ' ')} in {f['channel']}" for f in records[-1].get("faults") or ())
    why = records[-1].get("reason") or ", ".join(faults) or "the cause was not recorded"
    return DataStatus(level="degraded", reason=f"the latest window is {grade}: {why}", since=since)


def _without(record: Mapping[str, Any]) -> str:
    """What a good window does not say of the gears, and why: it has no speed, or is too short for their averages."""
    speed = (record.get("not_available") or {}).get("speed_hz")
    if speed:
        return f", without a speed: {speed}"
    sensors = (record.get("indicators") or {}).values()
    why = [reason for sensor in sensors for reason in (sensor.get("not_available") or {}).values()]
    return "" if not why or any(s.get("gears") for s in sensors) else f", without indicators of the gears: {why[0]}"


def shown(
    status: Mapping[str, Any],
    data: DataStatus,
    added: Sequence[Added] = (),
    records: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """A report's status as it is shown: as of the latest window, with the data's quality and what the service found.

    records  of the latest windows, oldest first
    """
    bad = [_data_finding(data)] if data.level in ("degraded", "stale") else []
    return _with(status, [*bad, *added], records)


def of_wear_alone(status: Mapping[str, Any]) -> bool:
    """Whether something is found beside which a remaining life, which counts wear alone, must not calm."""
    found = [(f["subject"].partition("/")[0], SEVERITY.index(f["level"])) for f in status.get("findings") or ()]
    return any(
        subject == "unexplained" or (subject in ("effect", "level") and rank >= SEVERITY.index("alarm"))
        for subject, rank in found
    )


def not_stored(unstored: tuple[str, str] | None) -> tuple[Added, ...]:
    """The finding that the storage cannot be used, from reason and time; nothing is `normal` until it can."""
    if unstored is None:
        return ()
    reason, since = unstored
    text = sentence(f"Results cannot be stored: {reason}")
    return (Added(finding=Finding(subject="storage", level="no_verdict", reason=text, action=REPAIR), since=since),)


def asked(question: Mapping[str, Any] | None) -> tuple[Added, ...]:
    """The finding that an open question is: nothing is `normal` until it is answered."""
    if question is None:
        return ()
    reason = f"{question['text']} {question['detail']}"
    finding = Finding(subject="question", level="no_verdict", reason=reason, action=ANSWER)
    return (Added(finding=finding, since=question["since"]),)


def shown_question(question: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """The question as it is shown."""
    return None if question is None else {k: v for k, v in question.items() if k not in HIDDEN}


def _with(status: Mapping[str, Any], added: Sequence[Added], records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    stored, before = status.get("verdict"), status["level"]
    verdict = None if stored is None else Verdict.model_validate(stored).with_records(records)
    own = tuple(f for f in map(Finding.model_validate, status["findings"]) if f.subject != SUBJECT)
    normal = status["reasons"][0] if before == "normal" and status["reasons"] else NORMAL_REASON
    basis = Basis(findings=(*own, *(a.finding for a in added)), normal=normal, verdict=verdict)
    now = status_from(basis).as_json()
    since = status.get("since")
    if now["level"] != before:
        began = next((a.since for a in added if a.finding.level == now["level"]), None)
        since = None if began is None else Since(time=began, revolutions=None).as_json()
    return {**status, **now, "since": since}


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
