"""Every credential each way: the right one is let in, the wrong one is not, and the audit log has a line of both."""

from __future__ import annotations

import asyncio
import time

import httpx
import jwt
import pytest
import service_fakes as fakes
from pytest_httpserver import HTTPServer
from test_tokens import OTHER, IssuerHere, tokens

from service.access.access import Access
from service.access.keys import KeyStore
from service.access.roles import Role
from service.api import create_app

INSPECTION = {"revolutions": 6000, "max_depth_um": 150.0, "flank": "combined", "std_um": 4.0}
READ, OPERATE, ADMINISTER = (
    ("GET", "/v1/assets", None),
    ("POST", "/v1/assets/unsw/inspections", INSPECTION),
    ("POST", "/v1/assets", {"asset": "new-1"}),
)
ADDRESS = "192.0.2.7"


@pytest.fixture(scope="module")
def issuer():
    with HTTPServer(host="127.0.0.1") as server:
        yield IssuerHere(server)


@pytest.fixture
def service(store, board, tmp_path, issuer):
    """The app with keys, an issuer and certificates; and the credential of each name."""
    fakes.campaign(store, board)
    keys = KeyStore(tmp_path / "keys")
    certificates = {"historian": Role.read, "panel": Role.operate}
    app = create_app(board, store, access=Access(keys, tokens(issuer), certificates=certificates))
    known = {f"key {role}": keys.add(f"key {role}", role) for role in Role}
    known["key expired"] = keys.add("key expired", Role.administer, expires=time.time() - 1)
    known["key revoked"] = keys.add("key revoked", Role.administer)
    keys.revoke("key revoked")
    known["key wrong"] = known["key administer"][:-1] + ("A" if known["key administer"][-1] != "A" else "B")
    for role in Role:
        known[f"token {role}"] = issuer.token(roles=[role.value], preferred_username=f"token {role}")
    known |= {
        "token expired": issuer.token(roles=["administer"], exp=1),
        "token audience": issuer.token(roles=["administer"], aud="another"),
        "token issuer": issuer.token(roles=["administer"], iss="https://elsewhere.example"),
        "token forged": issuer.token(OTHER, roles=["administer"]),
        "token none": jwt.encode(
            {"iss": issuer.url, "aud": "gear-twin", "sub": "x", "exp": 2**33, "roles": ["administer"]}, None, "none",
            {"kid": "first"},
        ),
        "token without a role": issuer.token(roles=["other"], preferred_username="token without a role"),
    }  # fmt: skip
    return app, known


def ask(app, method, path, body, credential=None, certificate=None):
    async def once():
        async def with_certificate(scope, receive, send):
            await app({**scope, "state": {} if certificate is None else {"certificate": certificate}}, receive, send)

        transport = httpx.ASGITransport(app=with_certificate, client=(ADDRESS, 4711))
        headers = {} if credential is None else {"Authorization": f"Bearer {credential}"}
        async with httpx.AsyncClient(transport=transport, base_url="http://twin") as caller:
            return await caller.request(method, path, json=body, headers=headers)

    return asyncio.run(once())


def last_entry(app, known):
    """The newest entry that is not about the making of a key."""
    entries = ask(app, "GET", "/v1/audit?limit=1000", None, known["key administer"]).json()
    return next((entry for entry in reversed(entries) if entry["action"] != "key"), None)


@pytest.mark.parametrize(
    ("name", "role"),
    [
        *((f"key {role}", role) for role in Role),
        *((f"token {role}", role) for role in Role),
        ("certificate historian", Role.read),
        ("certificate panel", Role.operate),
    ],
)
def test_right_credential_does_what_its_role_may_and_the_audit_log_says_who(service, name, role):
    app, known = service
    kind, _, subject = name.partition(" ")
    given = {"certificate": subject} if kind == "certificate" else {"credential": known[name]}
    who = subject if kind == "certificate" else name
    assert ask(app, *READ, **given).status_code == 200
    for needed, call, action in ((Role.operate, OPERATE, "inspection"), (Role.administer, ADMINISTER, "asset created")):
        answer, permitted = ask(app, *call, **given), role.includes(needed)
        assert answer.status_code == (201 if permitted else 403), answer.text
        entry = last_entry(app, known)
        assert (entry["kind"], entry["name"], entry["address"]) == (kind, who, ADDRESS)
        assert entry["action"] == (action if permitted else "refused")
        if not permitted:
            assert f"needs the role {needed}" in entry["outcome"]


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("key wrong", 401), ("key expired", 401), ("key revoked", 401), ("token expired", 401),
        ("token audience", 401), ("token issuer", 401), ("token forged", 401), ("token none", 401),
        ("token without a role", 403),
    ],
)  # fmt: skip
def test_wrong_credential_does_nothing_and_each_attempt_is_in_the_audit_log(service, store, name, status):
    app, known = service
    for call in (READ, OPERATE, ADMINISTER):
        answer = ask(app, *call, credential=known[name])
        assert answer.status_code == status and known[name] not in answer.text
        entry = last_entry(app, known)
        assert (entry["action"], entry["address"]) == ("refused", ADDRESS)
        assert entry["what"] == {"method": call[0], "path": call[1], "status": status}
        assert known[name] not in str(entry)
    assert fakes.jobs_of(store).of("unsw", "inspection") == () and app.state.table.get("new-1") is None


@pytest.mark.parametrize("certificate", [None, "stranger"])
def test_without_a_known_credential_writes_are_entered_and_reads_are_counted_alone(service, certificate):
    """Anybody could fill the log by asking to read; what asks to change something is worth a line."""
    app, known = service
    before, refused = last_entry(app, known), app.state.access.refused
    assert ask(app, *READ, certificate=certificate).status_code == 401
    assert last_entry(app, known) == before and app.state.access.refused == refused + 1
    for call in (OPERATE, ADMINISTER):
        assert ask(app, *call, certificate=certificate).status_code == 401
        entry = last_entry(app, known)
        assert (entry["action"], entry["name"], entry["address"]) == ("refused", None, ADDRESS)
