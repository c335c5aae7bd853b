"""REST: alarms of one asset or of all, what people do about them, and the rules that raise them."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Annotated, Any, Literal

from fastapi import Query, Request
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from service.access.roles import Role
from service.alarms.quantities import QUANTITIES
from service.alarms.rules import MOST_RULES, Rule, RuleFields, RuleFile, first_fault
from service.api.assets import LARGEST
from service.api.audit import audited, signer
from service.api.guard import Routes
from service.api.problems import problem
from service.api.reading import asset_of
from service.contract.alarms import Alarm
from service.contract.base import AnswerModel
from service.results.jobs import ALARMS, Notice
from service.results.status_events import status_events

router = Routes("alarms", prefix="/v1")

VERBS = {"acknowledge": "acknowledged", "clear": "cleared"}
RULES_BODY = 256 * 1024  # of a request with as many rules as there may be [bytes]
LONGEST_NAME, LONGEST_NOTE = 100, 2000


class AlarmQuery(BaseModel):
    """Which alarms are asked for."""

    state: Literal["open", "all"] = Field("open", description="all: with those that are closed")
    after: int = Field(0, ge=0, le=LARGEST, description="only alarms with an id above this one")
    limit: int = Field(1000, ge=1, le=10_000, description="at most this many")


class SignedIn(BaseModel):
    """Who does something about an alarm, and why."""

    model_config = ConfigDict(extra="forbid", strict=True)

    by: str = Field(min_length=1, max_length=LONGEST_NAME, pattern=r"\S", description="name of the person")
    note: str = Field("", max_length=LONGEST_NOTE, description="what was seen or done")


class RulesIn(BaseModel):
    """Alarm rules of one asset, in place of those before."""

    model_config = ConfigDict(extra="forbid")

    by: str = Field(min_length=1, max_length=LONGEST_NAME, pattern=r"\S", description="name of the person")
    note: str = Field("", max_length=LONGEST_NOTE, description="why they are changed")
    rules: tuple[RuleFields, ...] = Field(max_length=MOST_RULES)


class Learned(AnswerModel):
    """Learned limits of one rule at one place under one operating condition."""

    rule: str
    quantity: str
    place: str
    speed_hz: float | None
    torque_nm: float | None
    windows: int = Field(description="healthy windows so far")
    median: float | None = Field(None, description="of the healthy windows; absent while there are too few")
    watch: float | None = None
    alarm: float | None = None
    text: str = Field(description="how far the learning has come, with the expected rate of false alarms")


class QuantityOut(AnswerModel):
    """A quantity that rules may watch."""

    name: str
    label: str
    unit: str
    bases: list[str] = Field(description="what its limits may come from; the first is the default")
    direction: Literal["above", "below"] = Field(description="on which side it is bad")
    places: str = Field(description="what tells its instances apart; empty where there is one")


class AlarmRules(AnswerModel):
    """The alarm rules of one asset."""

    own: bool = Field(description="false where they are those of the settings")
    by: str | None = Field(description="who changed them last")
    note: str | None
    at: str | None = Field(description="ISO 8601")
    rules: list[Rule]
    learning: list[Learned]
    quantities: list[QuantityOut] = Field(description="that rules may watch")


@router.entry("GET /alarms", Role.read, list[Alarm], 422)
def all_alarms(request: Request, query: Annotated[AlarmQuery, Query()]) -> Any:
    """Alarms of all assets with their history, most urgent first."""
    return JSONResponse(_listed(request, None, query))


@router.entry("GET /assets/{asset}/alarms", Role.read, list[Alarm], 404, 422)
def alarms(request: Request, asset: str, query: Annotated[AlarmQuery, Query()]) -> Any:
    """Alarms of one asset with their history, most urgent first."""
    return JSONResponse(_listed(request, asset_of(request, asset), query))


def _listed(request: Request, asset: str | None, query: AlarmQuery) -> list[Any]:
    store = request.app.state.alarms.store
    return list(store.listed(asset, closed=query.state == "all", after=query.after, limit=query.limit))


@router.entry("POST /assets/{asset}/alarms/{number}/{verb}", Role.operate, Alarm, 400, 404, 409, 422)
def sign(request: Request, asset: str, number: int, verb: Literal["acknowledge", "clear"], given: SignedIn) -> Any:
    """Acknowledges or clears an open alarm by name; a cleared quantity still beyond its limit is raised again."""
    own = asset_of(request, asset)
    keeper, store, table = request.app.state.alarms, request.app.state.store, request.app.state.table
    known = keeper.store.alarm(own, number) if 0 < number <= LARGEST else None
    if known is None:
        numbers = ", ".join(str(alarm["id"]) for alarm in keeper.open(own)) or "none"
        return problem(request, 404, f"{asset} has no alarm {number}; open alarms: {numbers}")
    with keeper.transaction() as db:
        store.database.ensure(db, own)  # nobody else commits anything of it meanwhile
        before = table.get(own)
        assert before is not None
        done = keeper.sign(own, number, VERBS[verb], signer(request, given.by) or "", given.note.strip())
        open_now = keeper.open(own)
        if done is not None:
            shown = replace(before, alarms=open_now).with_whole()
            store.note(own, (*done[1], *status_events(before, *shown.health())))
            if verb == "clear" and before.stale is not None:
                request.app.state.queue.jobs.notice(Notice(asset=own, about=ALARMS, seen={}))  # its cause may last
            what = {"alarm": number, "quantity": known["quantity"], "place": known["place"]}
            request.app.state.audit.enter(
                request.state.who, f"alarm {VERBS[verb]}", asset=asset, note=given.note.strip() or None, what=what
            )
        table.write(replace(before, alarms=open_now, last_event_id=store.last_event_id(own)).with_whole())
    table.changed(own)
    if done is None:
        return problem(request, 409, _refusal(number, known))
    return JSONResponse(keeper.store.alarm(own, number))


def _refusal(number: int, alarm: Any) -> str:
    signed = alarm.get("acknowledgement")
    if alarm["state"] == "closed" or not signed:
        return f"alarm {number} is closed already"
    return f"alarm {number} was acknowledged by {signed['by']} at {signed['at']} already"


@router.entry("GET /assets/{asset}/alarm-rules", Role.read, AlarmRules, 404, 422)
def rules(request: Request, asset: str) -> Any:
    """The alarm rules of one asset, and how far limits have been learned."""
    return JSONResponse(_rules(request, asset_of(request, asset)))


@router.entry(
    "PUT /assets/{asset}/alarm-rules", Role.administer, AlarmRules, 400, 404, 409, 422, max_body_size=RULES_BODY
)
def set_rules(request: Request, asset: str, given: RulesIn) -> Any:
    """Gives one asset alarm rules of its own; alarms whose rule is gone end with the next window."""
    own = asset_of(request, asset)
    try:
        checked = RuleFile.model_validate({"rule": [rule.model_dump() for rule in given.rules]})
    except ValidationError as error:
        return problem(request, 409, f"the rules contradict themselves: {first_fault(error)}")
    by, note = signer(request, given.by) or "", given.note.strip()
    what = {"rules": [rule.name for rule in checked.rule]}
    keeper = request.app.state.alarms
    audited(request, "alarm rules", asset, lambda: keeper.set_rules(own, checked.rule, by, note), note=note, what=what)
    return JSONResponse(_rules(request, own))


def _rules(request: Request, asset: str) -> dict[str, Any]:
    quantities = [QuantityOut(name=name, **asdict(q)).model_dump() for name, q in QUANTITIES.items()]
    return {**request.app.state.alarms.described(asset), "quantities": quantities}
