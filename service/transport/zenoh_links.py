"""How Zenoh links are protected: certificates, users, and a whole configuration of Zenoh's own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from service.file_faults import reading


@dataclass(frozen=True, slots=True, kw_only=True)
class ZenohLinks:
    """Protection of a session's links; nothing for links within one computer.

    config        a whole configuration of Zenoh (JSON5); what else is given here is laid over it
    authorities   certificates (PEM) by which the other side is verified
    certificate   own certificate (PEM), with its key: the embedded router's, or that of a client
    demand        whether the router lets in only clients whose certificate the authorities have signed
    verify_name   whether a client demands that the router's certificate names the address that it connects to
    user          name and password of a client
    users         file of the users that the router lets in, a line `name:password` each
    """

    config: Path | None = None
    authorities: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    demand: bool = False
    verify_name: bool = True
    user: str | None = None
    password: str | None = None
    users: Path | None = None

    @property
    def admits_known_clients_only(self) -> bool:
        """Whether a router lets in only whom it knows; a whole configuration is taken at its word."""
        return self.demand or self.users is not None or self.config is not None

    def options(self, router: bool) -> dict[str, Any]:
        """Zenoh's own keys and values; InputError names a file that cannot be read."""
        side = "listen" if router else "connect"
        tls = "transport/link/tls"
        given: dict[str, Any] = {
            f"{tls}/root_ca_certificate": _readable("zenoh_authorities", self.authorities),
            f"{tls}/{side}_certificate": _readable("zenoh_certificate", self.certificate),
            f"{tls}/{side}_private_key": _readable("zenoh_private_key", self.key),
            f"{tls}/enable_mtls": self.demand if router else (self.certificate is not None or None),
            f"{tls}/verify_name_on_connect": None if self.verify_name else False,
            "transport/auth/usrpwd/user": self.user,
            "transport/auth/usrpwd/password": self.password,
            "transport/auth/usrpwd/dictionary_file": _readable("zenoh_users", self.users) if router else None,
        }
        if self.certificate is None and router:
            given[f"{tls}/enable_mtls"] = None
        return {key: value for key, value in given.items() if value is not None}


NONE = ZenohLinks()


def _readable(setting: str, path: Path | None) -> str | None:
    if path is None:
        return None
    with reading(f"{setting} = {path}"), path.open("rb"):
        return str(path)
