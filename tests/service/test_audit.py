"""The audit log: every change and every refused attempt, by whom, why and with what outcome."""

from __future__ import annotations

import asyncio

import httpx
import pytest
import service_fakes as fakes

from service.access.access import Access
from service.access.keys import KeyStore
from service.access.roles import Role, Who
from service.api import create_app
from service.cli.alarms import AUDITED
from service.report.words import listed
from service.results.audit_log import AuditLog

INSPECTION = {"revolutions": 6000, "max_depth_um": 150.0, "flank": "combined", "std_um": 4.0}
BASE = "/v1/assets/unsw"


@pytest.fixture
def keys(tmp_path):
    return KeyStore(tmp_path / "keys")


@pytest.fixture
def app(store, board, keys):
    fakes.campaign(store, board)
    return create_app(board, store, access=Access(keys))


def ask(app, method, path, key=None, client="192.0.2.9", **given):
    async def once():
        transport = httpx.ASGITransport(app=app, raise_app_exceptions=False, client=(client, 4711))
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        async with httpx.AsyncClient(transport=transport, base_url="http://twin") as caller:
            return await caller.request(method, path, headers=headers, **given)

    return asyncio.run(once())


def entries(app, key, query="?limit=1000"):
    answer = ask(app, "GET", f"/v1/audit{query}", key)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_every_change_is_entered_with_who_when_what_why_and_its_outcome(app, keys, store):
    key = keys.add("ann", Role.administer)
    given = {"by": "Bob", "note": "seen"}
    calls = [
        ("POST", f"{BASE}/inspections", INSPECTION, 201),
        ("POST", f"{BASE}/effects/misalignment", {"decision": "pin", **given}, 202),
        ("POST", f"{BASE}/changes", {"kind": "oil_changed", **given}, 202),
        ("PUT", f"{BASE}/alarm-rules", {"rules": [], **given}, 200),
        ("POST", "/v1/assets", {"asset": "new-1", **given}, 201),
    ]
    for method, path, body, status in calls:
        assert ask(app, method, path, key, json=body).status_code == status, path
    found = entries(app, key)
    assert [e["action"] for e in found] == [
        "key", "inspection", "decision", "oil_changed", "alarm rules", "asset created",
    ]  # fmt: skip
    for entry in found[1:]:
        assert (entry["kind"], entry["name"], entry["role"], entry["address"]) == (
            "key", "ann", "administer", "192.0.2.9",
        )  # fmt: skip
        assert entry["at"].endswith("Z") or "+" in entry["at"]
    assert [e["outcome"] for e in found[1:]] == ["queued", "queued", "queued", "done", "done"]
    assert [e["note"] for e in found[2:]] == ["seen"] * 4
    assert found[2]["what"] == {"effect": "misalignment", "decision": "pin"} and found[2]["asset"] == "unsw"
    line = listed(found, AUDITED)[3]
    assert "ann" in line and "decision" in line and "unsw" in line and "effect misalignment, decision pin" in line


def test_nobody_signs_with_the_name_of_another(app, keys, store):
    key = keys.add("ann", Role.administer)
    ask(app, "POST", f"{BASE}/effects/misalignment", key, json={"decision": "pin", "by": "Bob"})
    ask(app, "POST", f"{BASE}/changes", key, json={"kind": "oil_changed", "by": "Bob"})
    ask(app, "PUT", f"{BASE}/alarm-rules", key, json={"rules": [], "by": "Bob"})
    assert [d.given["by"] for d in fakes.decisions(store, "unsw")] == ["ann"]
    assert app.state.queue.jobs.changes("unsw")[-1].given["by"] == "ann"
    assert ask(app, "GET", f"{BASE}/alarm-rules", key).json()["by"] == "ann"


def test_without_a_credential_the_given_name_signs(store, board):
    fakes.campaign(store, board)
    app = create_app(board, store)
    ask(app, "POST", f"{BASE}/effects/misalignment", client="127.0.0.1", json={"decision": "pin", "by": "Bob"})
    assert [d.given["by"] for d in fakes.decisions(store, "unsw")] == ["Bob"]
    (entry,) = ask(app, "GET", "/v1/audit", client="127.0.0.1").json()
    assert (entry["kind"], entry["name"], entry["address"]) == ("local", None, "127.0.0.1")


def test_outcome_of_a_queued_change_is_that_of_the_change(app, keys, store, board):
    key = keys.add("ann", Role.administer)
    ask(app, "POST", f"{BASE}/effects/misalignment", key, json={"decision": "pin"})
    ask(app, "POST", f"{BASE}/effects/misalignment", key, json={"decision": "reject"})
    first, second = fakes.jobs_of(store).pending()
    fakes.carry_out(store, first, state={}, report=board.get("unsw").report, events=[])
    fakes.jobs_of(store).refuse(second, "there is no such effect in the twin")
    assert [e["outcome"] for e in entries(app, key)[1:]] == ["done", "refused: there is no such effect in the twin"]


def test_change_and_entry_are_there_together_or_not_at_all(app, keys, store, monkeypatch):
    key = keys.add("ann", Role.administer)

    def broken(*_, **__):
        raise OSError("no space")

    monkeypatch.setattr(app.state.audit, "enter", broken)
    app.state.audit.keys_seen = keys.version
    for path, body in ((f"{BASE}/inspections", INSPECTION), (f"{BASE}/effects/misalignment", {"decision": "pin"})):
        assert ask(app, "POST", path, key, json=body).status_code == 500
    assert fakes.jobs_of(store).of("unsw", "inspection") == () and fakes.decisions(store, "unsw") == ()


def test_refused_attempts_are_entered_a_few_a_minute(app, keys):
    admin, reader = keys.add("ann", Role.administer), keys.add("bob", Role.read)
    assert ask(app, "POST", f"{BASE}/inspections", reader, json=INSPECTION).status_code == 403
    assert ask(app, "POST", f"{BASE}/inspections", json=INSPECTION).status_code == 401
    for _ in range(50):
        ask(app, "GET", "/v1/assets", "gt_wrong")
    found = [e for e in entries(app, admin) if e["action"] == "refused"]
    assert len(found) == 30
    assert found[0]["name"] == "bob" and "needs the role operate" in found[0]["outcome"]
    assert found[0]["what"] == {"method": "POST", "path": f"{BASE}/inspections", "status": 403}
    assert found[1]["name"] is None and found[1]["address"] == "192.0.2.9"
    assert "gt_wrong" not in str(found)


def test_keys_are_entered_when_they_are_made_and_revoked(app, keys):
    admin = keys.add("ann", Role.administer)
    keys.add("bob", Role.read)
    keys.revoke("bob")
    found = [(e["what"]["name"], e["note"].split()[0]) for e in entries(app, admin)]
    assert sorted(found) == [("ann", "made"), ("bob", "made"), ("bob", "revoked")]
    assert len(entries(app, admin)) == 3  # once each


def test_log_is_read_by_administrators_alone_and_by_cursor(app, keys):
    admin, operator = keys.add("ann", Role.administer), keys.add("bob", Role.operate)
    assert ask(app, "GET", "/v1/audit", operator).status_code == 403
    for _ in range(5):
        ask(app, "POST", f"{BASE}/inspections", operator, json=INSPECTION)
    everything = entries(app, admin)
    first = entries(app, admin, "?after=0&limit=3")
    rest = entries(app, admin, f"?after={first[-1]['id']}")
    assert first + rest == everything
    assert entries(app, admin, "?limit=2") == everything[-2:]


def test_log_keeps_the_newest_entries(store):
    log = AuditLog(store.database, keep=150)
    who = Who(kind="local", name=None, role=Role.administer, address=None)
    for n in range(420):
        log.enter(who, "change", what={"n": n})
    left = log.entries(0, 10_000)
    assert 150 <= len(left) <= 250 and left[-1]["what"] == {"n": 419}


def test_entries_keep_the_name_that_an_asset_had_then(app, keys):
    key = keys.add("ann", Role.administer)
    ask(app, "POST", f"{BASE}/inspections", key, json=INSPECTION)
    app.state.names.rename("unsw", "press-7")
    assert entries(app, key)[-1]["asset"] == "unsw"
