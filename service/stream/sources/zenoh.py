"""Live streams: Zenoh sessions, and the subscriber that fills an inbox.

The session is an embedded router by default, so that nothing else need run, or a client of an
external one. The subscriber recovers what an advanced publisher still holds, and takes plain publishers as
they are.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import zenoh
import zenoh.ext

from service.errors import DeliveryError, InputError
from service.stream.channels import CHANNEL_KINDS
from service.stream.inbox import Inbox
from service.stream.wire.topics import PREFIX

_RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
_WAIT_BEFORE_CLOSE_US = 300_000_000  # a subscriber may stall this long before its link is given up
_HISTORY = 4096  # frames a key that a late subscriber asks a publisher's cache for


def session_config(listen: Sequence[str] = (), connect: Sequence[str] = (), wait: float | None = None) -> zenoh.Config:
    """A client of `connect` where given, waiting up to `wait` [s] for it, else a router at `listen`."""
    config = zenoh.Config()
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
    return config


@contextmanager
def open_session(
    listen: Sequence[str] = (), connect: Sequence[str] = (), wait: float | None = None
) -> Iterator[zenoh.Session]:
    """An open session, closed in any case: an unclosed one would hang the process at its end."""
    where = ", ".join(connect or listen)
    try:
        config = session_config(listen, connect, wait)
    except zenoh.ZError:
        raise InputError(f"endpoint {where} is not one; an endpoint reads like tcp/127.0.0.1:7447") from None
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        if connect:
            raise DeliveryError(
                f"no router answers at {where} within {wait or 0:g} s; is the service running?"
            ) from None
        raise DeliveryError(f"cannot listen at {where}: {str(error).splitlines()[0]}; is the port taken?") from None
    with session:
        yield session


class ZenohSource:
    """The measurement keys of all assets, on an open session."""

    def __init__(self, session: zenoh.Session, prefix: str = PREFIX):
        self._session, self._prefix = session, prefix
        self.missed = 0  # samples that a publisher's cache no longer held

    @contextmanager
    def subscribe(self, inbox: Inbox) -> Iterator[ZenohSource]:
        """Fills the inbox until left."""

        def received(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                inbox.guarded(lambda: str(sample.key_expr), sample.payload.to_bytes)

        def missed(miss: zenoh.ext.Miss) -> None:
            self.missed += miss.nb

        with ExitStack() as stack:
            for kind in CHANNEL_KINDS:
                subscriber = zenoh.ext.declare_advanced_subscriber(
                    self._session,
                    f"{self._prefix}/*/{kind}/*",
                    received,
                    history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=_HISTORY),
                    recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                )
                stack.callback(subscriber.undeclare)
                listener = subscriber.sample_miss_listener(missed)
                stack.callback(listener.undeclare)
            stack.callback(inbox.close)
            yield self
