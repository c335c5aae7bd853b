"""Roles and who has them: read < operate < administer."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from service.steady_clock import later_time_ns

Kind = Literal["key", "token", "certificate", "local", "anonymous"]


class Role(StrEnum):
    """What somebody may do; each role may do all that the ones before it may."""

    read = "read"
    operate = "operate"
    administer = "administer"

    @property
    def rank(self) -> int:
        return list(Role).index(self)

    def includes(self, other: Role) -> bool:
        return self.rank >= other.rank


@dataclass(frozen=True, slots=True, kw_only=True)
class Who:
    """Who a request comes from."""

    kind: Kind
    name: str | None  # of a key, a token's or a certificate's subject; None where nobody is named
    role: Role | None  # None where nothing is allowed
    address: str | None  # of the client
    expires: float | None = None  # Unix time at which the credential ends [s]

    def may(self, role: Role) -> bool:
        return self.role is not None and self.role.includes(role) and not self.expired

    @property
    def expired(self) -> bool:
        return self.expires is not None and later_time_ns() >= self.expires * 1e9
