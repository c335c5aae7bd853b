"""Tokens of an OpenID Connect issuer, which runs here on the loopback address: who is let in, who is not."""

from __future__ import annotations

import asyncio
import json
import ssl
import time

import httpx
import jwt
import pytest
import service_fakes as fakes
import trustme
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from pytest_httpserver import HTTPServer
from werkzeug import Response

from service.access.access import Access
from service.access.keys import KeyStore
from service.access.roles import Role
from service.access.tokens import COOLDOWN, LIFESPAN, OLDEST, Issuer, TokenRefused, Tokens
from service.api import create_app

RSA = rsa.generate_private_key(public_exponent=65537, key_size=2048)
OTHER = rsa.generate_private_key(public_exponent=65537, key_size=2048)
CURVE = ec.generate_private_key(ec.SECP256R1())


def public(key, kid):
    algorithm = (
        jwt.algorithms.ECAlgorithm if isinstance(key, ec.EllipticCurvePrivateKey) else jwt.algorithms.RSAAlgorithm
    )
    return {**json.loads(algorithm.to_jwk(key.public_key())), "kid": kid, "use": "sig"}


class IssuerHere:
    """An issuer: its description, its keys, tokens; and how often it was asked for keys."""

    def __init__(self, server):
        self.server, self.url = server, server.url_for("").rstrip("/")
        self.keys, self.asked, self.away = {"first": RSA, "curve": CURVE}, 0, False
        server.expect_request("/.well-known/openid-configuration").respond_with_handler(self._described)
        server.expect_request("/keys").respond_with_handler(self._keys)

    def _described(self, _):
        if self.away:
            return Response("away", 503)
        return Response(json.dumps({"issuer": self.url, "jwks_uri": f"{self.url}/keys"}))

    def _keys(self, _):
        self.asked += 1
        if self.away:
            return Response("away", 503)
        return Response(json.dumps({"keys": [public(key, kid) for kid, key in self.keys.items()]}))

    def token(self, key=RSA, kid="first", algorithm="RS256", **claims):
        now = int(time.time())
        usual = {"iss": self.url, "aud": "gear-twin", "sub": "4711", "preferred_username": "ann", "exp": now + 60}
        body = {name: value for name, value in {**usual, "roles": ["operate"], **claims}.items() if value is not None}
        return jwt.encode(body, key, algorithm, headers={"kid": kid})


@pytest.fixture(scope="module")
def server():
    with HTTPServer(host="127.0.0.1") as running:
        yield running


@pytest.fixture
def issuer(server):
    server.clear()
    return IssuerHere(server)


def tokens(issuer, clock=time.monotonic, **given):
    return Tokens(Issuer(issuer=issuer.url, audience="gear-twin", **given), clock)


def refused(checked, token, said):
    with pytest.raises(TokenRefused, match=said):
        checked.who(token, None)


def test_token_names_the_person_and_the_role(issuer):
    checked = tokens(issuer)
    who = checked.who(issuer.token(), "192.0.2.1")
    assert (who.kind, who.name, who.role, who.address) == ("token", "ann", Role.operate, "192.0.2.1")
    assert checked.who(issuer.token(preferred_username=None), None).name == "4711"
    assert checked.who(issuer.token(CURVE, "curve", "ES256"), None).role is Role.operate
    assert issuer.asked == 1


@pytest.mark.parametrize(
    ("claims", "said"),
    [
        ({"iss": "https://elsewhere.example"}, "[Ii]ssuer"),
        ({"aud": "another"}, "[Aa]udience"),
        ({"aud": None}, "aud"),
        ({"exp": 1}, "expired"),
        ({"exp": None}, "exp"),
        ({"nbf": 2**33}, "not yet valid"),
        ({"sub": None}, "sub"),
    ],
)
def test_token_that_is_not_for_here_or_not_now_is_refused(issuer, claims, said):
    refused(tokens(issuer), issuer.token(**claims), said)


def test_clocks_may_differ_by_the_leeway_alone(issuer):
    late = issuer.token(exp=int(time.time()) - 20)
    assert tokens(issuer, leeway=30.0).who(late, None).name == "ann"
    refused(tokens(issuer, leeway=5.0), late, "expired")


def test_token_with_another_key_or_algorithm_is_refused(issuer):
    checked = tokens(issuer)
    refused(checked, issuer.token(OTHER), "[Ss]ignature")
    refused(checked, issuer.token(OTHER, "unknown"), "signing key")
    refused(checked, issuer.token(algorithm="RS512"), "alg")
    refused(tokens(issuer, algorithms=("RS256",)), issuer.token(CURVE, "curve", "ES256"), "alg")
    forged = jwt.encode(
        {"iss": issuer.url, "aud": "gear-twin", "sub": "x", "exp": 2**33}, None, "none", {"kid": "first"}
    )
    refused(checked, forged, "alg|[Ss]ignature")
    refused(checked, "no.token.at-all", ".")
    # a token signed with the public key as if it were a shared secret
    secret = "0" * 40
    refused(checked, jwt.encode({"iss": issuer.url}, secret, "HS256", {"kid": "first"}), "alg")


@pytest.mark.parametrize(
    ("claim", "value", "role"),
    [
        ("roles", ["read", "administer", "other"], Role.administer),
        ("roles", "openid operate", Role.operate),
        ("roles", ["none"], None),
        ("roles", 7, None),
        ("realm_access.roles", {"roles": ["plant-admin"]}, Role.administer),
    ],
)
def test_role_comes_from_the_claim(issuer, claim, value, role):
    mapping = {"plant-admin": Role.administer, **{r.value: r for r in Role}}
    first = claim.partition(".")[0]
    who = tokens(issuer, role_claim=claim, roles=mapping).who(issuer.token(**{"roles": None, first: value}), None)
    assert who.role is role


def test_issuer_that_is_away_does_not_matter_for_a_day_and_is_asked_seldom(issuer):
    now = [1000.0]
    checked = tokens(issuer, lambda: now[0])
    assert checked.who(issuer.token(), None).name == "ann"
    issuer.away = True
    checked._keys.jwk_set_cache = jwt.jwk_set_cache.JWKSetCache(1e-9)  # every look at the keys finds them too old
    for _ in range(5):
        now[0] += LIFESPAN
        for _ in range(20):
            assert checked.who(issuer.token(), None).name == "ann"
    assert issuer.asked == 6
    now[0] += OLDEST
    refused(checked, issuer.token(), "keys are not known")
    issuer.away = False
    now[0] += COOLDOWN
    assert checked.who(issuer.token(), None).name == "ann"


def test_unknown_keys_make_the_service_ask_at_most_every_half_minute_and_new_ones_are_found(issuer):
    now = [1000.0]
    checked = tokens(issuer, lambda: now[0])
    for n in range(50):
        refused(checked, issuer.token(OTHER, f"kid-{n}"), "signing key")
    assert issuer.asked == 1
    issuer.keys["second"] = OTHER
    now[0] += COOLDOWN
    assert checked.who(issuer.token(OTHER, "second"), None).name == "ann"
    assert issuer.asked == 2


def test_issuer_that_was_never_reached_lets_nobody_in(issuer):
    issuer.away = True
    checked = tokens(issuer)
    for _ in range(3):
        refused(checked, issuer.token(), "keys are not known")


def test_issuer_over_tls_is_verified(tmp_path):
    authority, stranger = trustme.CA(), trustme.CA()
    authority.cert_pem.write_to_path(str(tmp_path / "right.pem"))
    stranger.cert_pem.write_to_path(str(tmp_path / "wrong.pem"))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert("127.0.0.1").configure_cert(context)
    server = HTTPServer(host="127.0.0.1", ssl_context=context)
    server.start()
    try:
        issuer = IssuerHere(server)
        assert tokens(issuer, ca=tmp_path / "right.pem").who(issuer.token(), None).name == "ann"
        refused(tokens(issuer, ca=tmp_path / "wrong.pem"), issuer.token(), "keys are not known")
    finally:
        server.stop()


def test_token_opens_the_service_by_its_role(issuer, store, board, tmp_path):
    fakes.campaign(store, board)
    keys = KeyStore(tmp_path)
    app = create_app(board, store, access=Access(keys, tokens(issuer)))
    given = {"revolutions": 6000, "max_depth_um": 150.0, "flank": "combined", "std_um": 4.0}

    async def asked(method, path, token, **body):
        transport = httpx.ASGITransport(app=app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://twin") as caller:
            headers = {"Authorization": f"Bearer {token}"} if token else {}
            return (await caller.request(method, path, headers=headers, **body)).status_code

    def status(token, method="GET", path="/v1/assets", **body):
        return asyncio.run(asked(method, path, token, **body))

    write = {"method": "POST", "path": "/v1/assets/unsw/inspections", "json": given}
    assert status(None) == 401
    assert status(issuer.token()) == 200 and status(issuer.token(), **write) == 201
    assert status(issuer.token(roles=["read"]), **write) == 403
    assert status(issuer.token(roles=[])) == 403
    assert status(issuer.token(exp=1)) == 401
    assert status(keys.add("program", Role.operate), **write) == 201  # keys and tokens hold side by side
