"""Requests made up from the OpenAPI description, by callers with each credential.

    python -m tests.chaos http [--count N] [--seed S]

Each operation is called with requests by the description and against it, N of each for every caller: without keys and
with them, from this computer and from another, with a key of each role, a wrong one, a revoked one. No answer may be a
fault of the program or differ from the description; whoever has the role is not refused for it, and whoever has not is;
every refusal is a problem document, and every answer carries the headers that browsers need.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import schemathesis
import segments
import service_fakes as fakes
from gear_signals import meshing_window
from hypothesis import HealthCheck, given, settings
from hypothesis import seed as drawn_from
from hypothesis import strategies as st
from hypothesis.errors import Unsatisfiable
from schemathesis.checks import negative_data_rejection, positive_data_acceptance
from schemathesis.generation import GenerationMode

from service.access.access import Access
from service.access.keys import KeyStore
from service.access.roles import Role
from service.api import create_app
from service.api.limits import Limits
from service.results.baseline_store import BaselineStore
from service.results.sql_store import SqlStore

ASSET = "/v1/assets/{asset}"
EVENTS = ("GET", f"{ASSET}/events")  # the stream never ends by itself: only its refusals are looked at here
# What is given depends on what else is given, which the description cannot say: such requests may be refused as well.
DEPENDENT = {("POST", f"{ASSET}/what-if"), ("GET", f"{ASSET}/windows/{{index}}/signals/{{view}}")}
HERE, ELSEWHERE = "127.0.0.1", "192.0.2.7"
TOO_LONG = 414
BEFORE_ROLES = {400, 413, 414, 415, 421, 431, 429}  # refusals that do not ask who calls


@dataclass(frozen=True, slots=True, kw_only=True)
class Caller:
    """Who calls: from where, with which credential, and the role that this gives; None for none."""

    name: str
    keys: bool  # whether the service has keys
    address: str = HERE
    key: str | None = None
    role: Role | None = None


OWN = Caller(name="this computer, no keys", keys=False, role=Role.administer)
CALLERS = (
    OWN,
    Caller(name="elsewhere, no keys", keys=False, address=ELSEWHERE),
    Caller(name="this computer, no credential", keys=True),
    Caller(name="elsewhere, no credential", keys=True, address=ELSEWHERE),
    Caller(name="wrong key", keys=True, address="192.0.2.8", key="wrong"),
    Caller(name="revoked key", keys=True, address="192.0.2.9", key="revoked"),
    Caller(name="key that may read", keys=True, address=ELSEWHERE, key="read", role=Role.read),
    Caller(name="key that may operate", keys=True, key="operate", role=Role.operate),
    Caller(name="key that may administer", keys=True, address=ELSEWHERE, key="administer", role=Role.administer),
)


class Interface:
    """The whole interface over a small campaign, without keys and with them."""

    def __init__(self, folder: Path) -> None:
        self._stores = [SqlStore(folder / f"{name}.sqlite") for name in ("open", "keyed")]
        keys = KeyStore(folder / "keys")
        self._keys = {role.value: keys.add(role.value, role) for role in Role}
        self._keys |= {"revoked": keys.add("revoked", Role.administer), "wrong": "gt_000000000000_" + "A" * 43}
        keys.revoke("revoked")
        self._apps = {
            keyed: self._app(store, folder / store_name, Access(keys) if keyed else Access())
            for keyed, store, store_name in zip((False, True), self._stores, ("open", "keyed"), strict=True)
        }

    def close(self) -> None:
        for store in self._stores:
            store.close()

    def _app(self, store: SqlStore, folder: Path, access: Access) -> Any:
        board = fakes.WrittenTable(store)
        fakes.campaign(store, board, asset="unsw", windows=6)
        fakes.take(store, board, "0", 0, 1.0, report=fakes.little_known_report())
        signals = segments.in_folder(store, folder / "segments")
        for index in range(3):
            segments.keep(signals, "unsw", index, meshing_window(index), revolutions=100.0 * index)
        return create_app(
            board, store, signals=signals, baselines=BaselineStore(store.database, folder / "baselines"),
            access=access, limits=Limits(per_minute=10**9),
        )  # fmt: skip

    def described(self, caller: Caller) -> Any:
        """The description of the interface, called from the caller's address."""
        app = self._apps[caller.keys]

        async def called(scope: Any, receive: Any, send: Any) -> None:
            await app({**scope, "client": (caller.address, 4711)}, receive, send)

        return schemathesis.openapi.from_asgi("/openapi.json", called)

    def headers(self, caller: Caller) -> dict[str, str]:
        return {} if caller.key is None else {"Authorization": f"Bearer {self._keys[caller.key]}"}


@contextmanager
def interface(folder: Path) -> Iterator[Interface]:
    opened = Interface(folder)
    try:
        yield opened
    finally:
        opened.close()


def operations(described: Any) -> list[tuple[str, str]]:
    """Method and path of each operation."""
    return [(o.ok().method.upper(), o.ok().path) for o in described.get_all_operations()]


def call(
    target: Interface,
    caller: Caller,
    described: Any,
    method: str,
    path: str,
    mode: GenerationMode,
    count: int,
    seed: int | None = None,
    answered: Callable[[int], None] = lambda status: None,
) -> None:
    """Calls one operation so many times; raises where an answer is not as it must be.

    seed  of the requests; None: the same in any run
    """
    operation, headers = described[path][method], target.headers(caller)
    role = operation.definition.raw.get("x-role")
    depends = (method, path) in DEPENDENT

    @settings(
        max_examples=count, deadline=None, derandomize=seed is None, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(case=operation.as_strategy(generation_mode=mode), known=st.booleans())
    def made_up(case: Any, known: bool) -> None:
        if known and mode is GenerationMode.POSITIVE and "asset" in case.path_parameters:
            case.path_parameters["asset"] = "unsw"
        response = case.call(headers=headers)
        answered(response.status_code)
        demand_safe(response, None if role is None else Role(role), caller)
        demand_described(case, response, headers, depends)

    (made_up if seed is None else drawn_from(seed)(made_up))()


def demand_described(case: Any, response: Any, headers: dict[str, str], depends: bool = False) -> None:
    """Raises where an answer is not as the description says.

    depends  whether what the description allows can be refused because of the state that the service is in
    """
    excluded = [positive_data_acceptance] if depends else []
    if response.status_code == TOO_LONG:  # whatever is in the address, before it is looked at
        excluded = [positive_data_acceptance, negative_data_rejection]
    case.validate_response(response, excluded_checks=excluded, headers=headers)


def demand_safe(response: Any, needed: Role | None, caller: Caller) -> None:
    """AssertionError where an answer shows the inside, lets in who may not, or keeps out who may."""
    status, headers = response.status_code, {name.lower(): value for name, value in response.headers.items()}
    text = response.content.decode(errors="replace")
    said = f"{caller.name}: {status} {text[:500]}"
    assert status < 500 or status == 503, said
    assert "x-content-type-options" in headers and "content-security-policy" in headers, said
    if status >= 400:
        assert "application/problem+json" in str(headers["content-type"]), said
        problem = json.loads(text)
        assert problem["status"] == status and problem["title"] and problem["detail"], said
    if needed is None or status in BEFORE_ROLES:
        return
    if caller.role is not None and caller.role.includes(needed):
        assert status not in (401, 403), said
    else:
        assert status in (401, 403), said


@dataclass(slots=True)
class Tally:
    """What became of the requests of all callers."""

    requests: int = 0
    answers: dict[str, int] = field(default_factory=dict)  # by status
    faults: list[str] = field(default_factory=list)

    def add_fault(self, fault: str, say: Callable[[str], None]) -> None:
        """Says a fault when it is found: the rest can take an hour."""
        self.faults.append(fault)
        say(fault)

    def count(self, status: int) -> None:
        self.requests += 1
        self.answers[str(status)] = self.answers.get(str(status), 0) + 1


def attack(
    count: int, seed: int, folder: Path, say: Callable[[str], None], callers: Sequence[Caller] = CALLERS
) -> Tally:
    """Calls every operation, by the description and against it, as each of the callers."""
    tally = Tally()
    logging.getLogger("service").addHandler(logging.NullHandler())  # what is refused is logged
    with interface(folder) as target:
        for caller in callers:
            described = target.described(caller)
            for method, path in operations(described):
                if (method, path) == EVENTS and caller.role is not None:
                    continue
                for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):
                    try:
                        call(target, caller, described, method, path, mode, count, seed, tally.count)
                    except Unsatisfiable:
                        continue  # nothing of this operation can be given wrong
                    except BaseExceptionGroup as error:
                        tally.add_fault(f"{caller.name}, {method} {path}, {mode.value}: {error.exceptions[0]}", say)
                    except AssertionError as error:
                        tally.add_fault(f"{caller.name}, {method} {path}, {mode.value}: {error}", say)
            say(f"{caller.name}: {tally.requests} requests so far, {len(tally.faults)} faults")
    return tally
