"""Who may do what: roles of every route, API keys, the page's session, and what is refused."""

from __future__ import annotations

import asyncio
import json
import time

import httpx
import pytest
import service_fakes as fakes
from fastapi import APIRouter, FastAPI

from service.access.access import Access
from service.access.addresses import is_loopback
from service.access.keys import FILE, KeyStore
from service.access.roles import Role
from service.api import create_app, guard
from service.cli import run as command
from service.errors import InputError
from service.runtime.admission import access_of
from service.settings import Settings

INSPECTION = {"revolutions": 6000, "max_depth_um": 150.0, "flank": "combined", "std_um": 4.0}
WRITE = "/v1/assets/unsw/inspections"
FOREIGN = "192.0.2.7"
PUBLIC = {
    "GET /", "GET /docs", "GET /assets/{name}", "MOUNT /static", "GET /healthz", "GET /readyz",
    "GET /v1/session", "POST /v1/session", "DELETE /v1/session",
}  # fmt: skip
ADMINISTER = {
    "POST /v1/unknown-assets/{asset}/adopt", "POST /v1/unknown-assets/{asset}/dismiss",
    "POST /v1/assets/{asset}/rig-proposal",
    "GET /v1/audit", "POST /v1/assets", "PUT /v1/assets/{asset}/alarm-rules", "PUT /v1/assets/{asset}/baseline",
    "POST /v1/assets/{asset}/baseline/learn", "DELETE /v1/assets/{asset}/baseline",
}  # fmt: skip
OPERATE = {
    "POST /v1/assets/{asset}/inspections", "POST /v1/assets/{asset}/effects/{name}",
    "POST /v1/assets/{asset}/alarms/{number}/{verb}", "POST /v1/assets/{asset}/changes",
}  # fmt: skip
READ_BY_POST = {"POST /v1/assets/{asset}/what-if"}


@pytest.fixture
def keys(tmp_path):
    return KeyStore(tmp_path / "keys")


@pytest.fixture
def app(store, board, keys):
    fakes.campaign(store, board)
    return create_app(board, store, access=Access(keys))


def ask(app, method, path, client="127.0.0.1", **given):
    async def once():
        transport = httpx.ASGITransport(app=app, raise_app_exceptions=False, client=(client, 4711))
        async with httpx.AsyncClient(transport=transport, base_url="http://twin") as caller:
            return await caller.request(method, path, **given)

    return asyncio.run(once())


def bearer(key):
    return {"Authorization": f"Bearer {key}"}


# -- every route -------------------------------------------------------------------------------------------


def test_every_route_of_the_app_needs_the_role_that_is_listed_here(app):
    found = {name: role for name, role in guard.roles(app).items() if role is not None}
    undeclared = {name for name, role in guard.roles(app).items() if role is None}
    assert undeclared == {"GET /openapi.json", "HEAD /openapi.json"}
    assert {name for name, role in found.items() if role == guard.PUBLIC} == PUBLIC
    assert {name for name, role in found.items() if role is Role.administer} == ADMINISTER
    assert {name for name, role in found.items() if role is Role.operate} == OPERATE
    rest = set(found) - PUBLIC - ADMINISTER - OPERATE
    assert all(name.startswith("GET ") for name in rest - READ_BY_POST)


def test_every_route_but_the_public_ones_refuses_who_has_no_credential(app, keys):
    keys.add("anybody", Role.read)
    for name, role in guard.roles(app).items():
        method, _, path = name.partition(" ")
        if role is None or role == guard.PUBLIC:
            continue
        answer = ask(app, method, path.format(asset="unsw", name="x", number=1, verb="clear", index=0, view="spectrum"))
        assert answer.status_code == 401, name
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.headers["www-authenticate"].startswith("Bearer")
        assert answer.json()["needs"] == role.value


def test_route_without_a_role_cannot_be_made():
    router = APIRouter(route_class=guard.Guarded)
    with pytest.raises(TypeError, match="/open: forgotten declares no role"):

        @router.get("/open")
        def forgotten():
            return {}


def test_app_with_an_unguarded_route_cannot_be_made():
    bare = FastAPI(docs_url=None, redoc_url=None)
    bare.add_api_route("/open", lambda: {})
    with pytest.raises(RuntimeError, match="routes without a role: GET /open"):
        guard.install(bare)


# -- without credentials -----------------------------------------------------------------------------------


def test_without_credentials_this_computer_may_do_everything_and_nobody_else_anything(app, store):
    assert ask(app, "POST", WRITE, json=INSPECTION).status_code == 201
    for client in (FOREIGN, "::ffff:192.0.2.7", "2001:db8::1"):
        for method, path in (("GET", "/v1/assets"), ("GET", "/metrics"), ("POST", WRITE)):
            answer = ask(app, method, path, client, json=INSPECTION if method == "POST" else None)
            assert answer.status_code == 403, (client, path)
            assert "no credentials" in answer.json()["detail"]
        assert ask(app, "GET", "/healthz", client).status_code == 200
        assert "stale" not in ask(app, "GET", "/readyz", client).json()
    assert len(fakes.jobs_of(store).of("unsw", "inspection")) == 1


def test_anonymous_reading_lets_everybody_read_and_nobody_write(store, board, keys):
    fakes.campaign(store, board)
    app = create_app(board, store, access=Access(keys, anonymous=Role.read))
    keys.add("operator", Role.operate)
    for client in ("127.0.0.1", FOREIGN):
        assert ask(app, "GET", "/v1/assets", client).status_code == 200
        assert ask(app, "POST", WRITE, client, json=INSPECTION).status_code == 401


@pytest.mark.parametrize(
    ("address", "own"),
    [("127.0.0.1", True), ("127.8.9.1", True), ("::1", True), ("[::1]", True), ("::ffff:127.0.0.1", True),
     ("localhost", True), ("0.0.0.0", False), ("::", False), ("10.0.0.1", False), ("example.org", False),
     (None, False)],
)  # fmt: skip
def test_addresses_of_this_computer(address, own):
    assert is_loopback(address) is own


# -- keys ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("role", "read", "operate", "administer"),
    [(Role.read, 200, 403, 403), (Role.operate, 200, 201, 403), (Role.administer, 200, 201, 201)],
)
@pytest.mark.parametrize("client", ["127.0.0.1", FOREIGN])
def test_key_may_do_what_its_role_may(app, keys, role, read, operate, administer, client):
    key = keys.add("somebody", role)
    for headers in (bearer(key), {"X-API-Key": key}):
        assert ask(app, "GET", "/v1/assets", client, headers=headers).status_code == read
        assert ask(app, "POST", WRITE, client, headers=headers, json=INSPECTION).status_code == operate
    made = ask(app, "POST", "/v1/assets", client, headers=bearer(key), json={"asset": "new-1"})
    assert made.status_code == administer
    if administer == 403:
        assert made.json()["needs"] == "administer" and f"somebody has {role}" in made.json()["detail"]


def test_wrong_revoked_and_expired_keys_are_refused(app, keys):
    good = keys.add("good", Role.read)
    wrong = [
        good[:-1] + ("A" if good[-1] != "A" else "B"),
        good.replace(good[3:15], "0" * 12),
        "gt_",
        "x" * 70,
        keys.add("old", Role.read, expires=time.time() - 1),
    ]
    gone = keys.add("gone", Role.read)
    keys.revoke("gone")
    for key in (*wrong, gone):
        answer = ask(app, "GET", "/v1/assets", headers=bearer(key))
        assert answer.status_code == 401, key
        assert key not in answer.text
    assert ask(app, "GET", "/v1/assets", headers=bearer(good)).status_code == 200


def test_wrong_keys_are_limited_by_address_and_right_ones_still_accepted(app, keys, caplog):
    good = keys.add("good", Role.read)
    statuses = [ask(app, "GET", "/v1/assets", FOREIGN, headers=bearer("gt_no")).status_code for _ in range(40)]
    assert statuses == [401] * 20 + [429] * 20
    assert ask(app, "GET", "/v1/assets", "192.0.2.8", headers=bearer("gt_no")).status_code == 401
    assert ask(app, "GET", "/v1/assets", FOREIGN, headers=bearer(good)).status_code == 200
    assert app.state.access.failed == 41
    assert len([r for r in caplog.records if "was refused" in r.message]) == 10
    assert "gt_no" not in caplog.text


def test_only_a_salted_hash_is_stored_and_others_cannot_read_the_file(tmp_path):
    store = KeyStore(tmp_path)
    first, second = store.add("a", Role.read), store.add("b", Role.administer)
    text = (tmp_path / FILE).read_text()
    secrets = [key.split("_", 2)[2] for key in (first, second)]  # a secret may have underscores of its own
    assert all(len(secret) == 43 and secret not in text for secret in secrets)
    entries = json.loads(text)["keys"]
    assert entries[0]["salt"] != entries[1]["salt"] and len(entries[0]["hash"]) == 64
    assert (tmp_path / FILE).stat().st_mode & 0o777 == 0o600


def test_keys_of_the_command_line_hold_in_the_running_service_at_once(tmp_path, store, board, capsys):
    fakes.campaign(store, board)
    app = create_app(board, store, access=Access(KeyStore(tmp_path)))
    assert ask(app, "GET", "/v1/assets").status_code == 200
    assert command(["db", "keys", "add", "--name", "ann", "--role", "operate", "--data", str(tmp_path)]) == 0
    key = capsys.readouterr().out.strip()
    assert ask(app, "GET", "/v1/assets").status_code == 401
    assert ask(app, "GET", "/v1/assets", headers=bearer(key)).status_code == 200
    assert command(["db", "keys", "list", "--data", str(tmp_path)]) == 0
    listed = capsys.readouterr().out
    assert "valid" in listed and "ann" in listed and key not in listed
    assert command(["db", "keys", "revoke", "ann", "--data", str(tmp_path)]) == 0
    assert ask(app, "GET", "/v1/assets", headers=bearer(key)).status_code == 401
    assert ask(app, "GET", "/v1/assets").status_code == 401  # revoking the last key opens nothing


def test_file_of_keys_that_is_removed_or_broken_lets_nobody_in(tmp_path, store, board):
    keys = KeyStore(tmp_path)
    app, key = create_app(board, store, access=Access(keys)), keys.add("ann", Role.read)
    assert ask(app, "GET", "/v1/assets", headers=bearer(key)).status_code == 200
    for change in ((tmp_path / FILE).unlink, lambda: (tmp_path / FILE).write_text("{")):
        change()
        assert ask(app, "GET", "/v1/assets", headers=bearer(key)).status_code == 401
        assert ask(app, "GET", "/v1/assets").status_code == 401


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--name", "", "--role", "read"], "must begin with a letter"),
        (["--name", "a\nb", "--role", "read"], "must begin with a letter"),
        (["--name", "a", "--role", "king"], "'read'"),
        (["--name", "a", "--role", "read", "--expires", "soon"], "such as 90d"),
        (["--name", "a", "--role", "read", "--expires", "2001-01-01"], "in the past"),
    ],
)
def test_key_that_cannot_be_is_one_line(tmp_path, capsys, arguments, said):
    assert command(["db", "keys", "add", "--data", str(tmp_path), *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_two_valid_keys_do_not_share_a_name(tmp_path):
    keys = KeyStore(tmp_path)
    keys.add("ann", Role.read)
    with pytest.raises(InputError, match="a valid key named 'ann'"):
        keys.add("ann", Role.administer)
    keys.revoke("ann")
    keys.add("ann", Role.administer)
    assert [key.state(time.time()) for key in keys.all()] == ["revoked", "valid"]
    assert keys.remove(keys.all()[0].id).name == "ann"
    assert len(keys.all()) == 1


# -- the page's session ------------------------------------------------------------------------------------


def test_session_is_a_cookie_that_scripts_and_other_sites_do_not_get(app, keys):
    key = keys.add("ann", Role.operate)
    answer = ask(app, "POST", "/v1/session", json={"key": key})
    assert answer.json() == {"signed_in": True, "name": "ann", "role": "operate", "credentials": True}
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie and "samesite=strict" in cookie and "secure" not in cookie
    cookies = {"Cookie": f"{guard.COOKIE}={key}"}
    assert ask(app, "POST", WRITE, headers=cookies, json=INSPECTION).status_code == 201
    assert ask(app, "GET", "/v1/session", headers=cookies).json()["name"] == "ann"
    out = ask(app, "DELETE", "/v1/session", headers=cookies)
    assert out.json()["signed_in"] is False and "max-age=0" in out.headers["set-cookie"].lower()


def test_cookie_is_secure_over_tls(app, keys):
    key = keys.add("ann", Role.operate)
    answer = ask(app, "POST", "https://twin/v1/session", json={"key": key})
    assert "; secure" in answer.headers["set-cookie"].lower()


def test_sign_in_with_a_wrong_key_is_refused_and_sets_nothing(app, keys):
    keys.add("ann", Role.operate)
    answer = ask(app, "POST", "/v1/session", json={"key": "gt_wrong"})
    assert answer.status_code == 401 and "set-cookie" not in answer.headers
    stale = ask(app, "GET", "/v1/session", headers={"Cookie": f"{guard.COOKIE}=gt_wrong"})
    assert stale.json()["signed_in"] is False and "max-age=0" in stale.headers["set-cookie"].lower()


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "http://twin.evil.example"},
        {"Origin": "null"},
        {"Referer": "http://evil.example/page"},
        {"Referer": "http://evil.example/http://twin/"},
        {"Referer": "http://twin@evil.example/"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_page_of_another_site_cannot_write(app, store, headers):
    for method, path in (("POST", WRITE), ("PUT", "/v1/assets/unsw/alarm-rules"), ("POST", "/v1/session")):
        answer = ask(app, method, path, headers=headers, json=INSPECTION)
        assert answer.status_code == 403 and "own page" in answer.json()["detail"]
    assert fakes.jobs_of(store).of("unsw", "inspection") == ()
    for own in ({"Origin": "http://twin"}, {"Referer": "http://twin/assets/unsw"}, {}):
        assert ask(app, "POST", WRITE, headers=own, json=INSPECTION).status_code == 201


# -- start ---------------------------------------------------------------------------------------------------


def test_service_that_others_could_reach_without_credentials_does_not_start(tmp_path, capsys):
    arguments = ["serve", "--http", "0.0.0.0:8080", "--data", str(tmp_path)]
    assert command(arguments) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "gear-twin db keys add" in said and "anonymous" in said


def test_service_that_others_reach_starts_with_a_key_an_issuer_or_reading_only(tmp_path):
    def admitted(**given):
        return access_of(Settings(http="0.0.0.0:8080", **given))

    assert admitted(data=tmp_path / "a", anonymous="read").anonymous is Role.read
    assert admitted(data=tmp_path / "b", oidc_issuer="https://login.example.org").configured
    KeyStore(tmp_path / "c").add("ann", Role.read)
    assert admitted(data=tmp_path / "c").configured
    with pytest.raises(InputError, match="no credentials"):
        admitted(data=tmp_path / "d")
