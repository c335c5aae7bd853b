"""The twin on Zenoh, and what the service asks of Zenoh beside the measurements.

- `{prefix}/{asset}/twin/state` is published at each change and answers `get`, with the JSON of REST.
- `{prefix}/{asset}/twin/alive` is a liveliness token, held while the service runs.
- `{prefix}/{asset}/rig` may carry the machine's rig file (`application/toml`), published or answering
  `get`: a replay offers its recording's there. It is used where no other rig file is known.

Exceptions in callbacks would vanish: they are caught, logged and counted.
"""

from __future__ import annotations

import json
import logging
import threading
import tomllib
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

import zenoh

from service.errors import InputError
from service.files.rig import checked_rig
from service.results.board import Board
from service.stream.wire.topics import NAME

log = logging.getLogger(__name__)

JSON = zenoh.Encoding.APPLICATION_JSON
RIG_WAIT = 1.0  # how long a rig file is asked for [s]


class Guard:
    """Runs callbacks and counts those that failed."""

    def __init__(self) -> None:
        self.errors = 0

    def __call__(self, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        def guarded(argument: Any) -> None:
            try:
                callback(argument)
            except Exception:
                self.errors += 1
                log.exception("a Zenoh callback failed")

        return guarded


class LiveState:
    """The board's assets as Zenoh keys, until closed."""

    def __init__(self, session: zenoh.Session, board: Board, prefix: str, guard: Guard) -> None:
        self._session, self._board, self._prefix = session, board, prefix
        self._stack = ExitStack()
        self._tokens: set[str] = set()
        queryable = session.declare_queryable(f"{prefix}/*/twin/state", guard(self._answer))
        self._stack.callback(queryable.undeclare)
        for asset in board.assets():
            self._live(asset)

    def __enter__(self) -> LiveState:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def publish(self, asset: str) -> None:
        """Publishes the asset's state as the board has it."""
        snapshot = self._board.get(asset)
        if snapshot is None:
            return
        self._live(asset)
        self._session.put(self._key(asset, "state"), _payload(snapshot.whole), encoding=JSON)

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            for asset in self._board.assets():
                key, snapshot = zenoh.KeyExpr(self._key(asset, "state")), self._board.get(asset)
                if snapshot is not None and query.key_expr.intersects(key):
                    query.reply(key, _payload(snapshot.whole), encoding=JSON)

    def _live(self, asset: str) -> None:
        if asset not in self._tokens:
            token = self._session.liveliness().declare_token(self._key(asset, "alive"))
            self._stack.callback(token.undeclare)
            self._tokens.add(asset)

    def _key(self, asset: str, what: str) -> str:
        return f"{self._prefix}/{asset}/twin/{what}"


class OfferedRigs:
    """Rig files that others offer on Zenoh, until closed."""

    def __init__(self, session: zenoh.Session, prefix: str, guard: Guard) -> None:
        self._session, self._prefix = session, prefix
        self._offered: dict[str, dict[str, Any]] = {}
        self._lock = threading.Lock()
        self._take = guard(self._received)
        self._subscriber = session.declare_subscriber(f"{prefix}/*/rig", self._take)

    def __enter__(self) -> OfferedRigs:
        return self

    def __exit__(self, *_: object) -> None:
        self._subscriber.undeclare()

    def find(self, asset: str) -> Mapping[str, Any] | None:
        """The rig file offered for the asset, asked for where none has come; None where there is none."""
        with self._lock:
            if asset in self._offered:
                return self._offered[asset]
        for reply in self._session.get(f"{self._prefix}/{asset}/rig", timeout=RIG_WAIT):
            if reply.ok is not None:
                self._take(reply.ok)
        with self._lock:
            return self._offered.get(asset)

    def _received(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        asset = key.removeprefix(f"{self._prefix}/").removesuffix("/rig")
        if not NAME.fullmatch(asset) or sample.kind != zenoh.SampleKind.PUT:
            return
        try:
            mapping = tomllib.loads(sample.payload.to_bytes().decode("utf-8"))
            checked_rig(mapping, key)
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            log.error("the rig file offered at %s is not TOML: %s", key, error)
        except InputError as error:
            log.error("the rig file offered at %s cannot be used: %s", key, error)
        else:
            with self._lock:
                self._offered[asset] = mapping


def _payload(whole: Mapping[str, Any]) -> str:
    return json.dumps(whole, allow_nan=False)
