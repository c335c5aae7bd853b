"""Front ends of a fleet answer as one service does, and hand on what people decide once."""

from __future__ import annotations

import json
import threading
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import httpx
import pytest
from fleets import front, routed, row, worker
from service_streams import service, wait_until, write_recording

from service.errors import StoreError
from service.fleet.layout import partition_of
from service.results.data_folder import SEGMENTS
from service.runtime.replay import replay

pytestmark = pytest.mark.slow

UNSW = "/v1/assets/unsw"
get, post = partial(httpx.get, timeout=60), partial(httpx.post, timeout=60)
WINDOWS = 6
UNHURRIED = "5"  # silence that ends a window where the publisher shares its processor with front ends [s]
PARTS = (
    "", "/wear", "/rul", "/residual", "/effects", "/tracing", "/rig", "/windows", "/trend", "/quality", "/inspections",
    "/alarms", "/alarm-rules", "/signals", "/indicators", "/changes", "/epochs", "/baseline", "/decisions",
    "/windows/0/signals/waveform", "/waterfall",
)  # fmt: skip
OWN = {  # of a process or its clock, or numbers of which others take some, too
    "received", "received_ns", "last_frame", "last_seen", "last_event_id", "id", "at", "since", "raised_at",
}  # fmt: skip


def without_own(value):
    """An answer without what differs from run to run."""
    if isinstance(value, dict):
        return {k: without_own(v) for k, v in value.items() if k not in OWN}
    return [without_own(v) for v in value] if isinstance(value, list) else value


@contextmanager
def at_work(tmp_path, fleet, **settings):
    """A worker; its process."""
    with routed() as endpoint, worker(tmp_path / "data-of-worker", fleet, endpoint, **settings) as process:
        process.endpoint, process.recording = endpoint, write_recording(tmp_path / "campaign.mcap", WINDOWS)
        yield process


def replayed(process, fleet):
    """The worker has taken all windows of the recording."""
    replay(process.recording, [process.endpoint], 0, prefix=process.prefix, recorded="gearbox")
    wait_until(lambda: row(fleet) is not None and row(fleet)["summary"]["windows"] == WINDOWS)


def data_of(process):
    return Path(process.given["DATA"])


@pytest.fixture
def begun(tmp_path, fleet):
    """Calls of a front end, with a worker behind it that has seen no frame yet."""
    with (
        at_work(tmp_path, fleet) as process,
        front(fleet, data_of(process)) as address,
        httpx.Client(base_url=address, timeout=60) as client,
    ):
        client.process, client.fleet = process, fleet
        yield client


@pytest.fixture
def ask(begun):
    """Calls of a front end, with a worker behind it that has taken the windows of a recording."""
    replayed(begun.process, begun.fleet)
    return begun


def compare(one, other, *paths):
    for path in paths:
        mine, theirs = one.get(path), other.get(path)
        assert mine.status_code == theirs.status_code, path
        assert without_own(mine.json()) == without_own(theirs.json()), path


def test_every_answer_is_that_of_one_service(tmp_path, fleet, ask):
    with service(tmp_path / "plain", NEW_ASSETS="adopt", WORKERS="0") as plain:
        replay(ask.process.recording, [plain.endpoint], 0)
        plain.wait_for_windows(6)
        with httpx.Client(base_url=f"http://{plain.http}", timeout=60) as other:
            wait_until(lambda: other.get("/v1/assets").json()[0]["windows"] == 6)
            wait_until(lambda: len(other.get(f"{UNSW}/signals").json()["windows"]) == 6)
            wait_until(lambda: len(ask.get(f"{UNSW}/signals").json()["windows"]) == 6)
            compare(ask, other, "/v1/assets", "/v1/areas", "/v1/alarms", "/v1/assets?limit=1")
            plain.end()
            plain.start()  # reports of the fake twin are shown otherwise once they have been read from the store
            frames = other.get(UNSW).json()["data_quality"]
            wait_until(lambda: ask.get(UNSW).json()["data_quality"] == frames)  # counted in its row now and then
            compare(ask, other, *(UNSW + part for part in PARTS))
            for path in (f"{UNSW}/report", "/v1/assets/none", "/v1/assets/%00", f"{UNSW}/windows/99/signals/waveform"):
                assert ask.get(path).status_code == other.get(path).status_code
            assert ask.get("/").text == other.get("/").text


def test_a_decision_is_carried_out_once_and_shown_by_every_front_end(tmp_path, fleet, ask):
    with front(fleet, data_of(ask.process)) as second:
        done = ask.post(f"{UNSW}/effects/misalignment", json={"decision": "accept", "by": "Anna"})
        assert done.status_code == 200 and done.json()["done"]
        shown = [get(f"{address}{UNSW}/decisions").json() for address in (ask.base_url, second)]
        assert shown[0] == shown[1] == [done.json()]
        numbers = set()

        def accept(address):
            answer = post(f"{address}{UNSW}/effects/misalignment", json={"decision": "accept"})
            numbers.add(answer.json()["id"])

        threads = [threading.Thread(target=accept, args=(a,)) for a in 4 * [str(ask.base_url), second]]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(numbers) == 8
        entries = get(f"{second}/v1/audit").json()
        assert [e["outcome"] for e in entries] == 9 * ["done"]
        assert [e["id"] for e in entries] == sorted(e["id"] for e in entries)


def test_what_has_been_done_is_shown_by_the_next_answer(ask):
    before = ask.get(UNSW).json()
    inspected = ask.post(
        f"{UNSW}/inspections", json={"revolutions": 100.0, "max_depth_um": 5.0, "flank": "combined", "std_um": 1.0}
    )
    assert inspected.status_code == 201, inspected.text
    assert ask.get(f"{UNSW}/inspections").json() == [inspected.json()]
    changed = ask.post(f"{UNSW}/changes", json={"kind": "gears_replaced", "by": "Anna", "note": "worn"})
    assert changed.status_code == 201 and changed.json()["done"], changed.text
    after = ask.get(UNSW).json()
    assert (before["epoch"], after["epoch"]) == (0, 1) and after["windows"] == []
    retired = ask.post(f"{UNSW}/changes", json={"kind": "retired"})
    assert retired.status_code == 201 and ask.get(UNSW).json()["retired"] is not None


def test_an_asset_is_renamed_and_found_under_its_new_name(ask):
    assert ask.get(UNSW).status_code == 200
    assert ask.post(f"{UNSW}/changes", json={"kind": "renamed", "name": "press-1"}).status_code == 201
    wait_until(lambda: ask.get("/v1/assets/press-1").status_code == 200)
    wait_until(lambda: ask.get(UNSW).status_code == 404)
    assert len(ask.get("/v1/assets/press-1/windows").json()) == 6
    assert ask.post("/v1/assets", json={"asset": "unsw"}).status_code == 409  # it was called so
    assert ask.post("/v1/assets", json={"asset": "other"}).status_code == 201
    refused = ask.post("/v1/assets/press-1/changes", json={"kind": "renamed", "name": "other"})
    assert refused.status_code == 409 and "already" in refused.json()["detail"]
    assert ask.get("/v1/audit").json()[-1]["outcome"].startswith("refused: there is an asset 'other'")


def test_an_asset_that_is_created_at_a_front_end_is_the_workers_too(ask):
    number = ask.process.partition
    name = next(n for n in (f"press-{i}" for i in range(100)) if partition_of(n, 3) == number)
    created = ask.post("/v1/assets", json={"asset": name, "rig": {"name": "a press"}, "by": "Anna"})
    assert created.status_code == 201 and created.json()["rig"] == "a press"
    assert name in [a["asset"] for a in ask.get("/v1/assets").json()]
    wait_until(lambda: row(ask.fleet, name)["summary"]["rig"] == "a press")  # the worker has written it
    assert ask.post("/v1/assets", json={"asset": name}).status_code == 409


def test_alarms_are_signed_once_by_the_rules_of_the_asset(fleet, begun):
    assert begun.post("/v1/assets", json={"asset": "unsw"}).status_code == 201
    rule = {"name": "deep", "quantity": "depth", "watch": 10, "alarm": 1000}
    rules = begun.put(f"{UNSW}/alarm-rules", json={"by": "Anna", "rules": [rule]})
    assert rules.status_code == 200 and begun.get(f"{UNSW}/alarm-rules").json()["own"], rules.text
    replayed(begun.process, fleet)
    (alarm,) = begun.get(f"{UNSW}/alarms").json()
    url = f"{UNSW}/alarms/{alarm['id']}/acknowledge"
    with front(fleet, data_of(begun.process)) as second:
        assert begun.post(url, json={"by": "Anna"}).status_code == 200
        assert post(f"{second}{url}", json={"by": "Bert"}).status_code == 409
        for address in (begun.base_url, second):
            assert get(f"{address}/v1/alarms").json()[0]["acknowledged"]
            assert get(f"{address}{UNSW}").json()["alarms"]["unacknowledged"] == 0
    wait_until(lambda: row(fleet)["summary"]["alarms"]["unacknowledged"] == 0)  # the worker shows it


def test_unknown_assets_wait_at_every_front_end_until_one_adopts_them(tmp_path, fleet):
    with (
        at_work(tmp_path, fleet, NEW_ASSETS="ask", IDLE_TIMEOUT=UNHURRIED) as process,
        front(fleet, data_of(process), new_assets="ask") as address,
        front(fleet, data_of(process), new_assets="ask") as second,
    ):
        sending = threading.Thread(target=replayed, args=(process, fleet))
        sending.start()
        wait_until(lambda: get(f"{second}/v1/unknown-assets").json()["assets"] != [])
        (unknown,) = get(f"{address}/v1/unknown-assets").json()["assets"]
        assert (unknown["asset"], unknown["rig_name"], get(f"{address}{UNSW}").status_code) == (
            "unsw",
            "unsw",
            404,
        )
        position = get(f"{address}{UNSW}/position").json()
        assert not position["accepting"] and "unsw is unknown" in position["reason"]
        adopted = post(f"{second}/v1/unknown-assets/unsw/adopt", json={"by": "Anna"})
        assert adopted.status_code == 201, adopted.text
        wait_until(lambda: get(f"{address}/v1/rig-proposals").json() != [])  # it was adopted without its rig file
        sending.join(60)
        assert get(f"{address}/v1/unknown-assets").json()["assets"] == []
        (proposal,) = get(f"{address}/v1/rig-proposals").json()
        decision = {"decision": "accept", "digest": proposal["digest"]}
        accepted = post(f"{address}{UNSW}/rig-proposal", json=decision)
        assert accepted.status_code == 201 and accepted.json()["done"], accepted.text
        assert get(f"{second}{UNSW}/rig").json()["name"] == "unsw"
        wait_until(lambda: get(f"{second}/v1/rig-proposals").json() == [])


def test_a_dismissed_asset_is_listed_no_more(tmp_path, fleet):
    with (
        at_work(tmp_path, fleet, NEW_ASSETS="ask", IDLE_TIMEOUT=UNHURRIED) as process,
        front(fleet, data_of(process), new_assets="ask") as address,
    ):
        sending = threading.Thread(target=replayed, args=(process, fleet))
        sending.start()
        wait_until(lambda: get(f"{address}/v1/unknown-assets").json()["assets"] != [])
        assert post(f"{address}/v1/unknown-assets/unsw/dismiss", json={}).status_code == 200
        wait_until(lambda: get(f"{address}/v1/unknown-assets").json()["frames"] > 0)
        assert get(f"{address}/v1/unknown-assets").json()["assets"] == []
        assert post(f"{address}/v1/assets", json={"asset": "unsw"}).status_code == 201  # after all
        sending.join(60)


def test_events_come_as_they_happen(tmp_path, ask):
    kinds = []
    listening = threading.Event()

    def listen():
        with httpx.stream("GET", f"{ask.base_url}{UNSW}/events", timeout=60) as answer:
            listening.set()
            for line in answer.iter_lines():
                if line.startswith("event: "):
                    kinds.append(line.removeprefix("event: "))
                if line.startswith("data: ") and kinds[-1:] == ["change"]:
                    kinds.append(json.loads(line.removeprefix("data: "))["kind"])
                    return

    thread = threading.Thread(target=listen)
    thread.start()
    assert listening.wait(30)
    ask.post(f"{UNSW}/changes", json={"kind": "oil_changed"})
    thread.join(30)
    assert kinds[-1] == "oil_changed"


def test_a_front_end_says_what_of_the_fleet_is_served(ask):
    number = ask.process.partition
    wait_until(lambda: ask.get("/readyz").json()["unserved_partitions"] == [n for n in range(3) if n != number])
    said = ask.get("/metrics").text
    assert "gear_twin_fleet_partitions 3.0" in said and "gear_twin_fleet_partitions_served 1.0" in said
    assert 'gear_twin_fleet_assets{level="' in said
    wait_until(lambda: "gear_twin_network_connected 1.0" in ask.get("/metrics").text)
    assert [path.name for path in (data_of(ask.process) / SEGMENTS).glob("[0-9]*")] == [f"{number:03d}"]


def test_a_front_end_outlives_its_database(tmp_path, postgresql_server, fleet):
    with front(fleet, tmp_path / "data") as address, httpx.Client(base_url=address, timeout=60) as client:
        assert client.post("/v1/assets", json={"asset": "unsw"}).status_code == 201
        wait_until(lambda: client.get("/readyz").status_code == 200)
        postgresql_server.stop("immediate")
        try:
            wait_until(lambda: client.get("/readyz").status_code == 503)
            assert client.get(UNSW).status_code == 503 and client.get("/healthz").status_code == 200
        finally:
            postgresql_server.start()
        wait_until(lambda: client.get("/readyz").status_code == 200)
        assert client.get(UNSW).status_code == 200 and client.get("/v1/audit").json()[0]["asset"] == "unsw"


def test_what_is_no_fleet_is_said(tmp_path, empty_postgresql):
    with pytest.raises(StoreError, match="the database holds no fleet"), front(empty_postgresql, tmp_path / "data"):
        pass
