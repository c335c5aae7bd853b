"""Requests made up from the OpenAPI description: no answer outside it, and never a fault of the program."""

from __future__ import annotations

import pytest
import schemathesis
import service_fakes as fakes
from gear_signals import meshing_window
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from schemathesis.generation import GenerationMode

from service.api import create_app
from service.results.baseline_store import BaselineStore
from service.results.board import Board
from service.results.signal_store import SignalStore
from service.results.sql_store import SqlStore

EXAMPLES = 20
BASE = "/v1/assets/{asset}"
PARTS = (
    "wear", "rul", "residual", "effects", "tracing", "decisions", "rig", "windows", "trend", "quality", "inspections",
    "alarms", "alarm-rules", "signals", "waterfall", "indicators", "windows/{index}/signals/{view}",
    "changes", "epochs", "baseline",
)  # fmt: skip
# The stream of events never ends by itself: test_api_events.py reads it.
OPERATIONS = [
    *(("GET", route) for route in ("/v1/assets", "/v1/alarms", BASE, "/healthz", "/readyz", "/metrics")),
    *(("GET", f"{BASE}/{part}") for part in PARTS),
    ("POST", f"{BASE}/inspections"),
    ("POST", f"{BASE}/effects/{{name}}"),
    ("POST", f"{BASE}/alarms/{{number}}/{{verb}}"),
    ("PUT", f"{BASE}/alarm-rules"),
    ("POST", f"{BASE}/changes"),
    ("PUT", f"{BASE}/baseline"),
    ("DELETE", f"{BASE}/baseline"),
    ("POST", f"{BASE}/baseline/learn"),
    ("POST", "/v1/assets"),
    ("GET", "/v1/audit"),
    ("GET", "/v1/session"),
    ("POST", "/v1/session"),
    ("DELETE", "/v1/session"),
]
# The fields of a duty depend on one another, which the description cannot say: see test_what_if_answers.py.
DEPENDENT = [("POST", f"{BASE}/what-if")]
LONGER = [("GET", f"{BASE}/report")]


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    board, store = Board(), SqlStore(tmp_path_factory.mktemp("schema") / "twin.sqlite")
    fakes.campaign(store, board, asset="unsw", windows=6)
    fakes.take(store, board, "0", 0, 1.0, report=fakes.little_known_report())
    signals = SignalStore(tmp_path_factory.mktemp("signals"), 2**30)
    for index in range(3):
        signals.keep("unsw", index, meshing_window(index), revolutions=100.0 * index)
    baselines = BaselineStore(store.database, tmp_path_factory.mktemp("baselines"))
    app = create_app(board, store, signals=signals, baselines=baselines)
    yield schemathesis.openapi.from_asgi("/openapi.json", app)
    store.close()


def test_every_operation_of_the_description_is_called_here(described):
    found = {(o.ok().method.upper(), o.ok().path) for o in described.get_all_operations()}
    assert found == {*OPERATIONS, *LONGER, *DEPENDENT, ("GET", f"{BASE}/events")}


def answers_as_described(operation, mode):
    @settings(
        max_examples=EXAMPLES, deadline=None, derandomize=True, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(case=operation.as_strategy(generation_mode=mode), known=st.booleans())
    def answered(case, known):
        if known and mode is GenerationMode.POSITIVE and "asset" in case.path_parameters:
            case.path_parameters["asset"] = "unsw"
        case.call_and_validate()

    answered()


@pytest.mark.parametrize(
    ("method", "path"), [*OPERATIONS, *(pytest.param(*operation, marks=pytest.mark.slow) for operation in LONGER)]
)
def test_request_by_the_description_is_answered_by_it(described, method, path):
    answers_as_described(described[path][method], GenerationMode.POSITIVE)


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", f"{BASE}/windows"),
        ("POST", f"{BASE}/inspections"),
        ("POST", f"{BASE}/effects/{{name}}"),
        ("POST", f"{BASE}/alarms/{{number}}/{{verb}}"),
        ("PUT", f"{BASE}/alarm-rules"),
    ],
)
def test_request_against_the_description_is_refused_by_it(described, method, path):
    answers_as_described(described[path][method], GenerationMode.NEGATIVE)
