"""Tokens of an OpenID Connect issuer: signature, issuer, audience, times and role.

The issuer's keys are fetched when they are first needed, kept, and fetched again after five minutes or when a token
names an unknown key, but at most every half minute, whatever clients send. While the issuer cannot be reached the keys
that are known hold on for a day.
"""

from __future__ import annotations

import logging
import ssl
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import jwt

from service.access.roles import Role, Who
from service.errors import InputError

LIFESPAN = 300.0  # of fetched keys, after which they are fetched again [s]
COOLDOWN = 30.0  # between two attempts to fetch keys [s]
OLDEST = 86_400.0  # age up to which keys hold while the issuer cannot be reached [s]
TIMEOUT = 5.0  # of one request to the issuer [s]
log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Issuer:
    """What tokens must be like."""

    issuer: str
    audience: str
    algorithms: tuple[str, ...] = ("RS256", "ES256")
    leeway: float = 30.0  # difference of clocks that is allowed [s]
    role_claim: str = "roles"  # path of the claim, such as realm_access.roles
    roles: Mapping[str, Role] = field(default_factory=lambda: {role.value: role for role in Role})
    name_claim: str = "preferred_username"  # sub where the token has none
    keys_url: str | None = None  # None: as the issuer's own description says
    ca: Path | None = None  # certificates of the authorities that sign the issuer's; None: those of the system


class TokenRefused(Exception):
    """A token that cannot be accepted, with the reason."""


class IssuerKeys(jwt.PyJWKClient):
    """The issuer's keys, asked for at most every COOLDOWN; those known hold on while it cannot be reached."""

    def __init__(self, issuer: Issuer, clock: Callable[[], float] = time.monotonic) -> None:
        trust = None
        if issuer.ca is not None:
            try:
                trust = ssl.create_default_context(cafile=issuer.ca)
            except (OSError, ssl.SSLError) as error:
                raise InputError(f"{issuer.ca}: cannot be read as certificates: {error}") from None
        super().__init__(
            issuer.keys_url or issuer.issuer, lifespan=LIFESPAN, timeout=TIMEOUT, ssl_context=trust, cooldown_duration=0
        )
        self._issuer, self._clock = issuer, clock
        self._found = issuer.keys_url is not None
        self._kept: Any = None
        self._kept_at = self._attempted = -float("inf")

    def fetch_data(self) -> Any:
        """The issuer's key set: fetched, or the one that is known."""
        now = self._clock()
        if now - self._attempted < COOLDOWN:
            return self._known(now, "it was asked less than half a minute ago")
        self._attempted = now
        try:
            if not self._found:
                self.uri, self._found = self._described(), True
            fetched = super().fetch_data()
        except (jwt.PyJWTError, httpx.HTTPError, OSError, ValueError, KeyError, TypeError) as error:
            log.warning("the keys of the issuer %s cannot be fetched: %s", self._issuer.issuer, error)
            return self._known(now, str(error))
        self._kept, self._kept_at = fetched, now
        return fetched

    def _known(self, now: float, why: str) -> Any:
        if self._kept is None or now - self._kept_at > OLDEST:
            raise jwt.PyJWKClientConnectionError(f"the issuer's keys are not known: {why}")
        return self._kept

    def _described(self) -> str:
        """Where the issuer's own description says that its keys are."""
        trust: Any = self.ssl_context or True
        url = f"{self._issuer.issuer.rstrip('/')}/.well-known/openid-configuration"
        with httpx.Client(verify=trust, timeout=TIMEOUT, trust_env=False) as client:
            described = client.get(url).raise_for_status().json()
        if described["issuer"] != self._issuer.issuer:
            raise ValueError(f"{url} describes the issuer {described['issuer']!r}")
        return str(described["jwks_uri"])


class Tokens:
    """Checks tokens; usable from any thread, and may wait for the issuer."""

    def __init__(self, issuer: Issuer, clock: Callable[[], float] = time.monotonic) -> None:
        self.issuer = issuer
        self._keys = IssuerKeys(issuer, clock)

    def who(self, token: str, address: str | None) -> Who:
        """Whom a token names; TokenRefused says why none."""
        issuer = self.issuer
        try:
            key = self._keys.get_signing_key_from_jwt(token)
            claims = jwt.decode(
                token,
                key,
                algorithms=list(issuer.algorithms),
                audience=issuer.audience,
                issuer=issuer.issuer,
                leeway=issuer.leeway,
                options={"require": ["exp", "iss", "aud", "sub"]},
            )
        except jwt.PyJWTError as error:
            raise TokenRefused(str(error)) from None
        name = claims.get(issuer.name_claim)
        named = name if isinstance(name, str) and name else str(claims["sub"])
        return Who(
            kind="token",
            name=named[:100],
            role=_role(claims, issuer),
            address=address,
            expires=float(claims["exp"]) + issuer.leeway,
        )


def _role(claims: Mapping[str, Any], issuer: Issuer) -> Role | None:
    """The highest role that the claim maps to; None where it maps to none."""
    value: Any = claims
    for part in issuer.role_claim.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    given = value.split() if isinstance(value, str) else value
    names = [name for name in given if isinstance(name, str)] if isinstance(given, list) else []
    return max((issuer.roles[name] for name in names if name in issuer.roles), key=lambda r: r.rank, default=None)
