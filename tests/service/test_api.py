"""REST: the contract's routes, each answer checked against the app's own OpenAPI description."""

from __future__ import annotations

import asyncio
import json
import threading
import time

import httpx
import jsonschema
import pytest
import service_fakes as fakes

from service import api
from service.access.access import Access
from service.api import assets, create_app
from service.results.job_queue import JobQueue

PARTS = ("wear", "rul", "residual", "effects")


_descriptions = []  # the one that all apps have


class Client:
    """Calls the app in process and checks every answer against its description."""

    def __init__(self, app):
        if not _descriptions:
            _descriptions.append(app.openapi())
        (self.schema,), self.app = _descriptions, app

    def call(self, method, url, **given):
        async def once():
            transport = httpx.ASGITransport(app=self.app, raise_app_exceptions=False)
            async with httpx.AsyncClient(transport=transport, base_url="http://twin") as client:
                return await client.request(method, url, **given)

        answer = asyncio.run(once())
        self.check(method, url, answer)
        return answer

    def get(self, url, **given):
        return self.call("GET", url, **given)

    def check(self, method, url, answer):
        route = next((r for r in self.schema["paths"] if _matches(r, url.partition("?")[0])), None)
        described = self.schema["paths"].get(route, {}).get(method.lower(), {}).get("responses", {})
        content = described.get(str(answer.status_code), {}).get("content", {})
        media = answer.headers["content-type"].partition(";")[0]
        if answer.status_code >= 400:
            assert media == "application/problem+json"
            schema = {"$ref": "#/components/schemas/Problem"}
        elif route is None or media != "application/json":
            return
        else:
            schema = content[media]["schema"]
        jsonschema.validate(answer.json(), {**schema, "components": self.schema["components"]})


def _matches(route, url):
    ours, theirs = route.split("/"), url.split("/")
    return len(ours) == len(theirs) and all(a == b or a.startswith("{") for a, b in zip(ours, theirs, strict=True))


@pytest.fixture
def client(store, board):
    fakes.campaign(store, board)
    for index in range(3):
        fakes.take(store, board, "spectraquest", index, 100.0 * index, report=fakes.little_known_report())
    return Client(create_app(board, store, figures=lambda: {"queue_frames": 7}))


def test_every_app_has_the_same_description(client, store, board):
    assert create_app(board, store, JobQueue(api.Jobs(store.database)), access=Access()).openapi() == client.schema


def test_each_route_of_an_app_is_the_one_that_its_module_made(store, board):
    served = {id(route) for route in create_app(board, store).routes}
    assert assets.router.routes and all(id(route) in served for route in assets.router.routes)


def test_assets_are_listed_with_their_status(client):
    listed = {a["asset"]: a for a in client.get("/v1/assets").json()}
    assert set(listed) == {"unsw", "spectraquest"}
    assert listed["unsw"]["status"]["level"] == "normal" and listed["unsw"]["data"] == "ok"
    assert listed["unsw"]["windows"] == 14
    assert listed["unsw"]["updates"] == 1 and listed["unsw"]["rig"] == "unsw"
    assert listed["spectraquest"]["rig"] is None


def test_degraded_window_shows_in_the_status(client, store, board):
    fakes.take(store, board, "unsw", 99, 19000.0, quality="degraded", faults=(fakes.FAULT,))
    summary = next(a for a in client.get("/v1/assets").json() if a["asset"] == "unsw")
    assert summary["data"] == "degraded" and "gap in accel/y6" in summary["reason"]
    assert summary["status"]["level"] == "no_verdict" and "gap in accel/y6" in summary["status"]["reasons"][0]


def test_whole_state_has_the_names_of_the_contract_and_the_parts_are_the_same(client):
    whole = client.get("/v1/assets/unsw").json()
    expected = fakes.report(18000.0, 14)
    assert whole["asset"] == "unsw" and len(whole["windows"]) == 14
    for part in (*PARTS, "unexplained", "calibration"):
        assert whole[part] == expected[part]
    for part in PARTS:
        assert client.get(f"/v1/assets/unsw/{part}").json() == whole[part]


def test_what_is_not_known_is_not_available_with_its_reason(client):
    for part in ("wear", "rul", "residual"):
        answer = client.get(f"/v1/assets/spectraquest/{part}").json()
        assert answer["status"] == "not available" and "gears.module" in answer["reason"]
    rig = client.get("/v1/assets/spectraquest/rig").json()
    assert rig["status"] == "not available"


def test_asset_without_a_window_is_known_and_says_so(client, board):
    board.update("fresh", quality={"channels": {"accel/y6": {"frames": 3}}})
    whole = client.get("/v1/assets/fresh").json()
    assert whole["windows"] == [] and whole["wear"]["status"] == "not available"
    assert client.get("/v1/assets/fresh/effects").json() == []


def test_rig_is_answered_as_it_was_given(client):
    assert client.get("/v1/assets/unsw/rig").json()["gears"]["pinion"]["teeth"] == 19


def test_windows_are_paged_by_index_oldest_first(client):
    def indices(query):
        return [w["index"] for w in client.get(f"/v1/assets/unsw/windows{query}").json()]

    assert indices("") == list(range(14))
    assert indices("?limit=5") == [0, 1, 2, 3, 4]
    assert indices("?after=4&limit=3") == [5, 6, 7]
    assert indices("?after=13") == []
    assert indices("?after=-1&limit=1") == [0]


def test_trend_and_quality_follow_the_windows(client):
    trend = client.get("/v1/assets/unsw/trend").json()
    assert len(trend) == 14 and trend[-1]["depth_um"]["combined"]["median"] == fakes.depth_um(18000.0)
    quality = client.get("/v1/assets/unsw/quality").json()
    assert quality["windows"] == {"good": 13, "degraded": 1, "refused": 0}
    assert quality["totals"][0]["kind"] == "gap" and quality["totals"][0]["count"] == 3


def test_inspection_is_kept_and_answered_with_the_twins_figure(client, store):
    given = {"revolutions": 6000, "max_depth_um": 150.0, "flank": "combined", "std_um": 4.0}
    answer = client.call("POST", "/v1/assets/unsw/inspections", json=given)
    assert answer.status_code == 201
    said = answer.json()
    assert said["inspection"]["max_depth_um"] == 150.0
    assert said["twin"]["max_depth_um"]["median"] == pytest.approx(156.0)
    assert said["difference_um"] == pytest.approx(6.0) and said["within_band"] is True
    assert not said["twin"]["extrapolated"]
    assert client.get("/v1/assets/unsw/inspections").json() == [said]


def test_inspection_beyond_the_windows_is_extrapolated(client):
    given = {"revolutions": 20000, "max_depth_um": 480.0, "flank": "pinion", "std_um": 4.0}
    said = client.call("POST", "/v1/assets/unsw/inspections", json=given).json()
    assert said["twin"]["extrapolated"] and said["twin"]["to_revolutions"] == 18000.0


def test_inspection_of_a_machine_without_depths_is_kept_without_a_comparison(client):
    given = {"revolutions": 150, "max_depth_um": 3.0, "flank": "combined", "std_um": 1.0}
    said = client.call("POST", "/v1/assets/spectraquest/inspections", json=given).json()
    assert said["twin"]["status"] == "not available"


def test_inspection_of_an_asset_without_a_committed_window_is_kept(store, board):
    board.update("fresh", quality={"channels": {"accel/y6": {"frames": 3}}})
    client = Client(create_app(board, store))
    given = {"revolutions": 150, "max_depth_um": 3.0, "flank": "combined", "std_um": 1.0}
    answer = client.call("POST", "/v1/assets/fresh/inspections", json=given)
    assert answer.status_code == 201 and answer.json()["twin"]["status"] == "not available"
    assert len(fakes.jobs_of(store).of("fresh", "inspection")) == 1


def test_metrics_that_wait_for_the_store_hold_no_other_request_up(client, store, monkeypatch):
    """The store is slow to answer: liveness is answered all the same."""
    release, rows = threading.Event(), store.database.rows
    monkeypatch.setattr(store.database, "rows", lambda *given: release.wait(20) and rows(*given))

    async def both():
        transport = httpx.ASGITransport(app=client.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://twin") as caller:
            scraped = asyncio.ensure_future(caller.get("/metrics"))
            await asyncio.sleep(0.2)
            alive = await asyncio.wait_for(caller.get("/healthz"), 5)
            waiting = not scraped.done()
            release.set()
            return alive.status_code, waiting, (await scraped).status_code

    try:
        assert asyncio.run(both()) == (200, True, 200)
    finally:
        release.set()


@pytest.mark.slow
def test_decisions_that_wait_hold_no_thread(store, board):
    fakes.campaign(store, board)
    app = create_app(board, store, JobQueue(api.Jobs(store.database)))
    app.state.decision_wait = 6.0

    async def crowd():
        transport = httpx.ASGITransport(app=app)
        async with httpx.AsyncClient(transport=transport, base_url="http://twin", timeout=30) as caller:
            path = "/v1/assets/unsw/effects/misalignment"
            waiting = [asyncio.ensure_future(caller.post(path, json={"decision": "pin"})) for _ in range(60)]
            await asyncio.sleep(0.5)  # more wait than there are threads for requests
            begun = time.monotonic()
            answer = await caller.get("/v1/assets/unsw/windows")
            took = time.monotonic() - begun
            return answer.status_code, took, [(await each).status_code for each in waiting]

    status, took, answers = asyncio.run(crowd())
    assert status == 200 and took < 5.0
    assert answers == [202] * 60


@pytest.mark.parametrize(
    ("change", "at"),
    [
        ({"revolutions": -1}, "revolutions"),
        ({"max_depth_um": "deep"}, "max_depth_um"),
        ({"flank": "left"}, "flank"),
        ({"std_um": 0}, "std_um"),
        ({"std_um": None}, "std_um"),
        ({"depth": 3}, "depth"),
    ],
)
def test_inspection_that_cannot_be_is_a_422_that_names_the_value(client, store, change, at):
    given = {"revolutions": 6000, "max_depth_um": 150.0, "flank": "combined", "std_um": 4.0, **change}
    answer = client.call("POST", "/v1/assets/unsw/inspections", json=given)
    assert answer.status_code == 422
    assert any(at in e["at"] for e in answer.json()["errors"])
    assert fakes.jobs_of(store).of("unsw", "inspection") == ()


@pytest.mark.parametrize("body", [b"{", b"\xff\xfe", b"[]", b'{"revolutions": NaN}'])
def test_body_that_is_no_inspection_is_a_problem(client, body):
    headers = {"content-type": "application/json"}
    answer = client.call("POST", "/v1/assets/unsw/inspections", content=body, headers=headers)
    assert answer.status_code in (400, 422)


@pytest.mark.parametrize("part", ["", "/wear", "/rul", "/windows", "/events", "/rig", "/quality", "/trend"])
def test_unknown_asset_is_a_404_that_names_the_known_ones(client, part):
    answer = client.get(f"/v1/assets/nobody{part}")
    assert answer.status_code == 404
    problem = answer.json()
    assert problem["known"] == ["spectraquest", "unsw"] and "'nobody'" in problem["detail"]
    assert "spectraquest, unsw" in problem["detail"] and problem["instance"] == f"/v1/assets/nobody{part}"


@pytest.mark.parametrize("query", ["limit=0", "limit=x", "after=x", "limit=10001"])
def test_query_that_cannot_be_is_a_422(client, query):
    answer = client.get(f"/v1/assets/unsw/windows?{query}")
    assert answer.status_code == 422 and answer.json()["errors"][0]["at"][0] == "query"


def test_unserved_place_and_method_are_problems(client):
    assert client.get("/v2/assets").status_code == 404
    answer = client.call("DELETE", "/v1/assets/unsw")
    assert answer.status_code == 405 and answer.headers["allow"] == "GET"


def test_fault_of_the_program_is_a_500_without_its_inside(client):
    client.app.state.table = None
    answer = client.get("/v1/assets")
    assert answer.status_code == 500 and "NoneType" not in answer.text


def test_readiness_is_told_apart_from_liveness(store, board):
    reason = ["not yet subscribed"]
    client = Client(create_app(board, store, not_ready=lambda: reason[0]))
    assert client.get("/healthz").status_code == 200
    answer = client.get("/readyz")
    assert answer.status_code == 503 and answer.json()["detail"] == "not yet subscribed"
    reason[0] = None
    assert client.get("/readyz").json() == {"status": "ready", "stale": []}


def test_metrics_tell_frames_windows_faults_depth_and_life(client):
    text = client.get("/metrics").text
    for line in (
        'gear_twin_frames_total{asset="unsw",channel="accel/y6"} 560.0',
        'gear_twin_frame_faults_total{asset="unsw",channel="accel/y6",kind="duplicate"} 13.0',
        'gear_twin_windows_total{asset="unsw",quality="degraded"} 1.0',
        'gear_twin_data_faults_total{asset="unsw",channel="accel/y6",kind="gap"} 3.0',
        'gear_twin_updates_total{asset="unsw"} 1.0',
        "gear_twin_queue_frames 7.0",
    ):
        assert line in text
    depth = 'gear_twin_wear_depth_micrometres{asset="unsw",flank="combined",quantile="0.5"} '
    assert float(text.split(depth)[1].split()[0]) == pytest.approx(fakes.depth_um(18000.0))
    assert 'gear_twin_remaining_life_hours{asset="unsw",quantile="0.95"}' in text
    assert 'gear_twin_remaining_life_hours{asset="spectraquest"' not in text


def test_metrics_count_effects_in_the_twin_and_decisions_that_were_carried_out(client, store, board):
    fakes.take(store, board, "unsw", 90, 19000.0, report=fakes.traced_report(19000.0, 12))
    for verb in ("pin", "reject"):
        fakes.decide(store, "unsw", "misalignment", verb)
    done, _ = fakes.jobs_of(store).pending()
    fakes.carry_out(store, done, state={}, report=board.get("unsw").report, events=[])
    text = client.get("/metrics").text
    assert 'gear_twin_effects{asset="unsw"} 2.0' in text and 'gear_twin_effects{asset="spectraquest"} 0.0' in text
    assert 'gear_twin_decisions_total{asset="unsw",decision="pin"} 1.0' in text
    assert 'decision="reject"' not in text


def test_two_apps_do_not_share_their_metrics(store, board):
    apps = [Client(create_app(board, store, figures=lambda n=n: {"queue_frames": n})) for n in (1, 2)]
    assert ["gear_twin_queue_frames 1.0" in a.get("/metrics").text for a in apps] == [True, False]


def test_openapi_describes_every_route_of_the_contract(client):
    described = client.schema["paths"]
    base = "/v1/assets/{asset}"
    for route in ("/v1/assets", base, *(f"{base}/{p}" for p in (*PARTS, "rig", "windows", "events"))):
        assert "get" in described[route], route
    assert "post" in described[f"{base}/inspections"]
    assert {"/healthz", "/readyz", "/metrics"} <= set(described)
    assert "HTTPValidationError" not in json.dumps(described)


@pytest.mark.parametrize("path", ["/", "/docs"])
def test_pages_and_all_that_they_load_come_from_this_service(client, path):
    page = client.get(path)
    assert page.status_code == 200 and page.headers["content-type"].startswith("text/html")
    assert "http://" not in page.text and "https://" not in page.text
    links = [part.split('"')[0] for key in ('src="', 'href="') for part in page.text.split(key)[1:]]
    for link in links:
        answer = client.get(link)
        assert answer.status_code == 200 and len(answer.content) > 100, link
