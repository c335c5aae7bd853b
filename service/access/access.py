"""The rule of access: who a request comes from, and whether that is enough for a role.

- Where neither keys nor an issuer are configured, clients of this computer may do everything and nobody else anything.
- Where there is any, everybody needs a credential, also on this computer.
- `anonymous` lets everybody read without one.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING

from limits import parse
from limits.storage import MemoryStorage
from limits.strategies import FixedWindowRateLimiter

from service.access.addresses import is_loopback, network
from service.access.keys import PREFIX, KeyStore
from service.access.roles import Role, Who

if TYPE_CHECKING:  # where no issuer is set, its packages are not loaded
    from service.access.tokens import Tokens

FAILED_ATTEMPTS = parse("20/minute")  # of one address, after which wrong credentials are answered with 429
LOGGED = parse("10/minute")  # lines about refused requests
ENTERED = parse("30/minute")  # entries about them in the audit log
log = logging.getLogger(__name__)


class Refused(Exception):
    """A request that may not be: the status, one sentence, and what would be needed."""

    def __init__(self, status: int, detail: str, needs: Role | None = None, retry_after: int | None = None) -> None:
        super().__init__(detail)
        self.status, self.detail, self.needs, self.retry_after = status, detail, needs, retry_after


class Access:
    """Whom the service lets in.

    keys       API keys; None for none
    tokens     tokens of an issuer; None for none
    anonymous  what everybody may do without a credential; None for nothing
    certificates  roles by the subject of a client's certificate
    """

    def __init__(
        self,
        keys: KeyStore | None = None,
        tokens: Tokens | None = None,
        anonymous: Role | None = None,
        certificates: Mapping[str, Role] | None = None,
    ) -> None:
        self.keys, self.tokens, self.anonymous, self.certificates = keys, tokens, anonymous, certificates or {}
        self._limiter = FixedWindowRateLimiter(MemoryStorage())
        self.refused = 0  # requests without the role they need
        self.failed = 0  # wrong credentials

    @property
    def configured(self) -> bool:
        """Whether there are credentials."""
        return self.tokens is not None or bool(self.certificates) or (self.keys is not None and self.keys.configured)

    def who(self, credential: str | None, address: str | None, subject: str | None = None) -> Who:
        """Whom a request comes from; Refused where its credential is wrong. May wait for the issuer of a token.

        subject  of the verified certificate that the client has shown
        """
        if credential is None:
            if subject is not None and subject in self.certificates:
                return Who(kind="certificate", name=subject, role=self.certificates[subject], address=address)
            return self._without_credential(address)
        if not credential.startswith(PREFIX) and self.tokens is not None:
            from service.access.tokens import TokenRefused

            try:
                return self.tokens.who(credential, address)
            except TokenRefused as error:
                raise self._wrong(address, f"the token is not accepted: {error}") from None
        key = self.keys.find(credential) if self.keys is not None else None
        if key is None:
            raise self._wrong(address, "this key is unknown, expired or revoked")
        return Who(kind="key", name=key.name, role=key.role, address=address, expires=key.expires)

    def demand(self, who: Who, role: Role) -> None:
        """Refused where somebody may not do what needs a role."""
        if who.may(role):
            return
        self.refused += 1
        if who.kind in ("local", "anonymous"):
            if self.configured:
                status, detail = 401, f"this needs a key or token with the role {role}; sign in, or send one as Bearer"
            else:
                status = 403
                detail = (
                    f"this needs the role {role}, and the service has no credentials: only clients of its own computer "
                    "may do this; add a key there (gear-twin db keys add)"
                )
        else:
            status, detail = 403, f"this needs the role {role}; {who.name} has {who.role or 'none'}"
        self.note(who.address, detail)
        raise Refused(status, detail, role)

    def still(self, who: Who, credential: str | None) -> bool:
        """Whether somebody who was let in to read may still do so; never waits."""
        if who.kind == "key" and self.keys is not None and credential is not None:
            key = self.keys.find(credential)
            return key is not None and key.role.includes(Role.read)
        if who.kind in ("local", "anonymous"):
            return self._without_credential(who.address).may(Role.read)
        return not who.expired

    def enters_refusal(self) -> bool:
        """Whether a refusal is entered in the audit log: a few a minute are, and all are counted."""
        return self._limiter.hit(ENTERED, "entered")

    def figures(self) -> dict[str, float]:
        """Counts for the metrics."""
        return {"refused_requests": self.refused, "wrong_credentials": self.failed}

    def note(self, address: str | None, what: str) -> None:
        """Logs a refusal, a few a minute."""
        if self._limiter.hit(LOGGED, "log"):
            log.warning("a request from %s was refused: %s", address or "an unknown address", what)

    def _without_credential(self, address: str | None) -> Who:
        if not self.configured and is_loopback(address):
            return Who(kind="local", name=None, role=Role.administer, address=address)
        return Who(kind="anonymous", name=None, role=self.anonymous, address=address)

    def _wrong(self, address: str | None, detail: str) -> Refused:
        """Wrong credentials are counted by address. Right ones are accepted from it all the same."""
        self.failed += 1
        self.note(address, detail)
        if self._limiter.hit(FAILED_ATTEMPTS, "failed", network(address)):
            return Refused(401, detail)
        return Refused(429, "too many wrong credentials from this address; try again in a minute", retry_after=60)
