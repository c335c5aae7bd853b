"""Requests made up from the OpenAPI description: no answer outside it, and never a fault of the program."""

from __future__ import annotations

import pytest
from schemathesis.generation import GenerationMode

from tests.chaos.api import ASSET, CALLERS, EVENTS, OWN, attack, call, demand_described, interface, operations

EXAMPLES = 20
PARTS = (
    "wear", "rul", "residual", "effects", "tracing", "decisions", "rig", "windows", "trend", "quality", "inspections",
    "alarms", "alarm-rules", "signals", "waterfall", "indicators", "windows/{index}/signals/{view}",
    "changes", "epochs", "baseline",
)  # fmt: skip
OPERATIONS = [
    *(("GET", route) for route in ("/v1/assets", "/v1/areas", "/v1/alarms", ASSET, "/healthz", "/readyz", "/metrics")),
    *(("GET", f"{ASSET}/{part}") for part in PARTS),
    ("POST", f"{ASSET}/inspections"),
    ("POST", f"{ASSET}/effects/{{name}}"),
    ("POST", f"{ASSET}/alarms/{{number}}/{{verb}}"),
    ("PUT", f"{ASSET}/alarm-rules"),
    ("POST", f"{ASSET}/changes"),
    ("PUT", f"{ASSET}/baseline"),
    ("DELETE", f"{ASSET}/baseline"),
    ("POST", f"{ASSET}/baseline/learn"),
    ("POST", f"{ASSET}/what-if"),
    ("POST", "/v1/assets"),
    ("GET", f"{ASSET}/position"),
    ("GET", "/v1/unknown-assets"),
    ("GET", "/v1/rig-proposals"),
    ("POST", f"{ASSET}/rig-proposal"),
    ("POST", "/v1/unknown-assets/{asset}/adopt"),
    ("POST", "/v1/unknown-assets/{asset}/dismiss"),
    ("GET", "/v1/audit"),
    ("GET", "/v1/session"),
    ("POST", "/v1/session"),
    ("DELETE", "/v1/session"),
]
LONGER = [("GET", f"{ASSET}/report")]


@pytest.fixture(scope="module")
def target(tmp_path_factory):
    with interface(tmp_path_factory.mktemp("schema")) as opened:
        yield opened


@pytest.fixture(scope="module")
def described(target):
    return target.described(OWN)


@pytest.mark.slow
def test_every_operation_of_the_description_is_called_here(described):
    assert set(operations(described)) == {*OPERATIONS, *LONGER, EVENTS}


@pytest.mark.parametrize(
    ("method", "path"), [*OPERATIONS, *(pytest.param(*operation, marks=pytest.mark.slow) for operation in LONGER)]
)
def test_request_by_the_description_is_answered_by_it(target, described, method, path):
    statuses = []
    call(target, OWN, described, method, path, GenerationMode.POSITIVE, EXAMPLES, answered=statuses.append)
    signs_in = (method, path) == ("POST", "/v1/session")  # with keys that nobody made
    assert signs_in or not {401, 403} & set(statuses), "the role was not enough"


@pytest.mark.parametrize("note", ["é" * 2000, "é" * 2001])
def test_an_address_that_is_too_long_is_refused_whatever_is_in_it(target, described, note):
    operation = described[f"{ASSET}/baseline"]["PUT"]
    given = {"path_parameters": {"asset": "unsw"}, "query": {"note": note}, "media_type": "application/octet-stream"}
    case, headers = operation.Case(**given, body=b"x"), target.headers(OWN)
    response = case.call(headers=headers)
    assert response.status_code == 414 and "longer than" in response.json()["detail"]
    demand_described(case, response, headers)


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", f"{ASSET}/windows"),
        ("POST", f"{ASSET}/inspections"),
        ("POST", f"{ASSET}/effects/{{name}}"),
        ("POST", f"{ASSET}/alarms/{{number}}/{{verb}}"),
        ("PUT", f"{ASSET}/alarm-rules"),
    ],
)
def test_request_against_the_description_is_refused_by_it(target, described, method, path):
    call(target, OWN, described, method, path, GenerationMode.NEGATIVE, EXAMPLES)


@pytest.mark.slow
@pytest.mark.parametrize("caller", CALLERS[1:], ids=lambda caller: caller.name)
@pytest.mark.parametrize(("method", "path"), [("GET", ASSET), ("POST", f"{ASSET}/inspections"), ("GET", "/v1/audit")])
def test_callers_with_each_credential_are_answered_by_the_description(target, caller, method, path):
    call(target, caller, target.described(caller), method, path, GenerationMode.POSITIVE, 3)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_every_operation_is_answered_by_the_description(tmp_path):
    """As who may do all, as nobody, and by a key that may read; `make chaos` does it as all callers."""
    callers = [
        c for c in CALLERS if c.name in ("this computer, no keys", "elsewhere, no credential", "key that may read")
    ]
    tally = attack(2, 1, tmp_path, lambda line: None, callers)
    assert len(callers) == 3 and tally.faults == [] and tally.requests > 300
