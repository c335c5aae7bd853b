"""Zenoh sessions: how the service, `replay` and `record` join the network. Only this file and `zenoh` import Zenoh.

The session is an embedded router by default, so that nothing else need run, or a client of an external router.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from service.errors import DeliveryError, InputError, NotReachable
from service.transport.zenoh_links import NONE, ZenohLinks

_RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
_WAIT_BEFORE_CLOSE_US = (
    10_000_000  # a subscriber may stall this long before its link is given up; what was on it is sent again
)


_ANSWERS = ["put", "delete", "reply", "declare_queryable", "liveliness_token"]
_ASKS = ["query", "declare_subscriber", "liveliness_query", "declare_liveliness_subscriber"]
WITHIN = "unixsock-stream"  # the protocol over which the service's own processes connect


def session_config(
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    wait: float | None = None,
    links: ZenohLinks = NONE,
    alone: str | None = None,
) -> zenoh.Config:
    """A client of `connect` where given, waiting up to `wait` [s] for it, else a router at `listen`.

    alone  keys on which a router without a configuration of its own lets nobody but its own session publish and answer
    """
    if links.config is None:
        config = zenoh.Config()
        config.insert_json5("scouting/delay", "0")  # the wait for peers that scouting finds, which is off
    else:
        config = _from_file(links.config)
    config.insert_json5("mode", json.dumps("client" if connect else "router"))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    block = "transport/link/tx/queue/congestion_control/block/wait_before_close"
    config.insert_json5(block, json.dumps(_WAIT_BEFORE_CLOSE_US))
    if connect:
        config.insert_json5("connect/endpoints", json.dumps(list(connect)))
        config.insert_json5("connect/timeout_ms", json.dumps(-1 if wait is None else round(wait * 1000)))
        config.insert_json5("connect/retry", json.dumps(_RETRY))
    else:
        config.insert_json5("listen/endpoints", json.dumps(list(listen)))
        if alone is not None and links.config is None:
            config.insert_json5("access_control", json.dumps(_refusing_answers(alone)))
        if links.config is not None and any(endpoint.startswith(WITHIN) for endpoint in listen):
            config.insert_json5(
                "access_control", json.dumps(_knowing_own(json.loads(config.get_json("access_control"))))
            )
    for key, value in links.options(router=not connect).items():
        config.insert_json5(key, json.dumps(value))
    return config


def _refusing_answers(keys: str) -> dict[str, Any]:
    """Access control that lets in everything but answers on some keys: what comes over a link is not its session's."""
    rule = {"id": "answers", "permission": "deny", "flows": ["ingress"], "messages": _ANSWERS, "key_exprs": [keys]}
    return {
        "enabled": True,
        "default_permission": "allow",
        "rules": [rule],
        "subjects": [{"id": "all"}],
        "policies": [{"rules": ["answers"], "subjects": ["all"]}],
    }


def _knowing_own(control: dict[str, Any]) -> dict[str, Any]:
    """Access control that lets the service's own processes hear everything, too."""
    name = "the service's own processes"
    given = {part: control.get(part) or [] for part in ("rules", "subjects", "policies")}
    hears: dict[str, Any] = {"id": name, "permission": "allow", "flows": ["ingress", "egress"], "key_exprs": ["**"]}
    hears["messages"] = [*_ANSWERS, *_ASKS]
    return control | {
        "rules": [*given["rules"], hears],
        "subjects": [*given["subjects"], {"id": name, "link_protocols": [WITHIN]}],
        "policies": [*given["policies"], {"rules": [name], "subjects": [name]}],
    }


def _from_file(path: Path) -> zenoh.Config:
    try:
        return zenoh.Config.from_file(str(path))
    except zenoh.ZError as error:
        raise InputError(f"zenoh_config = {path}: is no configuration of Zenoh: {str(error).splitlines()[0]}") from None


@contextmanager
def open_session(
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    wait: float | None = None,
    links: ZenohLinks = NONE,
    alone: str | None = None,
) -> Iterator[zenoh.Session]:
    """An open session, closed in any case: an unclosed one would hang the process at its end.

    Raises NotReachable where no router answers at `connect`, DeliveryError where `listen` cannot be had.
    """
    zenoh.try_init_log_from_env()  # RUST_LOG=warn makes Zenoh say why it refuses a connection
    where = ", ".join(connect or listen)
    try:
        config = session_config(listen, connect, wait, links, alone)
    except zenoh.ZError:
        raise InputError(f"endpoint {where} is not one; an endpoint reads like tcp/127.0.0.1:7447") from None
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        if connect:
            raise NotReachable(
                f"no router answers at {where} within {wait or 0:g} s, or it does not let this client in; is the "
                f"service running{_AND_THESE if _protected(connect, links) else ''}?"
            ) from None
        hint = "are certificate, key and users right?" if _protected(listen, links) else "is the port taken?"
        raise DeliveryError(f"cannot listen at {where}: {str(error).splitlines()[0]}; {hint}") from None
    with session:
        yield session


_AND_THESE = ", and are authorities, certificate, user and password right"


def _protected(endpoints: Sequence[str], links: ZenohLinks) -> bool:
    """Whether certificates or users take part."""
    return links != NONE or any(endpoint.startswith(("tls/", "quic/")) for endpoint in endpoints)
