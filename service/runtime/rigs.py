"""Which rig file an asset has, and what happens where it is not the one that the asset's state was learned with.

The rig file of the settings goes before the stored one, and that before one offered on the network. A state that was
learned with other gears says nothing about these: people are asked (questions.py), and the earlier rig file holds until
they have answered. Any other change is adopted, and an event tells what has changed.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from service.errors import InputError
from service.files.documents import parsed_document
from service.files.rig import checked_rig, load_mapping
from service.results.board import Board
from service.results.store import ResultStore, StoredAsset
from service.transport.protocol import Transport
from twin.rig import Rig

log = logging.getLogger(__name__)

RIG_WAIT = 1.0  # how long a rig file is asked for [s]
IDENTITY = "gears."  # keys that make a machine another one
MOST_NAMED = 6  # changed keys that a message names
_ABSENT = object()


@dataclass(frozen=True, slots=True, kw_only=True)
class RigChange:
    """How a rig file differs from an earlier one: lines such as `gears.pinion.teeth = 23 (was 19)`."""

    identity: tuple[str, ...] = ()  # given before, and given otherwise or not at all now
    other: tuple[str, ...] = ()


def rig_change(before: Mapping[str, Any], now: Mapping[str, Any]) -> RigChange:
    """What differs between two rig files; a key that only adds what was not known before changes no identity."""
    old, new = dict(_flat(before)), dict(_flat(now))
    identity: list[str] = []
    other: list[str] = []
    for key in sorted(old.keys() | new.keys()):
        was, value = old.get(key, _ABSENT), new.get(key, _ABSENT)
        if was != value:
            line = f"{key} = {_text(value)} (was {_text(was)})"
            (identity if key.startswith(IDENTITY) and was is not _ABSENT else other).append(line)
    return RigChange(identity=tuple(identity), other=tuple(other))


def other_gears(stored: StoredAsset, rig: Mapping[str, Any]) -> tuple[str, ...]:
    """How a rig file describes other gears than those that an asset's state was learned with; else empty."""
    if stored.rig is None or stored.state is None:
        return ()
    return rig_change(stored.rig, rig).identity


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenRigs:
    """The rig files of the settings: each with what it is called in messages."""

    all: tuple[Mapping[str, Any], str] | None = None  # of every asset that has none of its own
    own: Mapping[str, tuple[Mapping[str, Any], str]] = field(default_factory=dict)

    @classmethod
    def read(cls, of_all: Path | None, own: Mapping[str, Path]) -> GivenRigs:
        """Reads the files; InputError where one cannot be used."""
        return cls(
            all=None if of_all is None else _read(of_all), own={asset: _read(path) for asset, path in own.items()}
        )

    def of(self, asset: str) -> Mapping[str, Any] | None:
        """The rig file that the settings give for an asset."""
        found = self.own.get(asset) or self.all
        return None if found is None else found[0]

    def where(self, asset: str) -> str:
        """What it is called."""
        found = self.own.get(asset) or self.all
        return "rig" if found is None else found[1]


def _read(path: Path) -> tuple[Mapping[str, Any], str]:
    rig = load_mapping(path)
    checked_rig(rig, str(path))
    return rig, str(path)


class Rigs:
    """The rig files of all assets.

    given  those of the settings
    """

    def __init__(self, store: ResultStore, board: Board, given: GivenRigs) -> None:
        self._store, self._board, self.given = store, board, given

    def named_differences(self, asset: str, rig: Mapping[str, Any]) -> list[str]:
        """How a rig file describes other gears than those of an asset so far, teeth first, absent values last."""
        lines = sorted(
            other_gears(self._store.asset(asset), rig), key=lambda line: (".teeth =" not in line, "= absent" in line)
        )
        more = [f"and {len(lines) - MOST_NAMED} more"] if len(lines) > MOST_NAMED else []
        return [*lines[:MOST_NAMED], *more]

    def of(self, asset: str, offered: OfferedRigs) -> Rig:
        """The rig of an asset; one of which nothing is known where there is none."""
        stored = self._store.asset(asset)
        given = self.given.of(asset)
        differs = given is not None and other_gears(stored, given)
        rig = (None if differs else given) or stored.rig or offered.find(asset)
        if rig is None:
            log.warning(
                "no rig file is known for %s: only what needs none will be available", asset, extra={"asset": asset}
            )
            return Rig.from_mapping({})
        checked = checked_rig(rig, f"rig of {asset}")
        if rig != stored.rig:
            self._adopt(stored, rig)
        self._board.update(asset, rig=rig)
        return checked

    def _adopt(self, stored: StoredAsset, rig: Mapping[str, Any]) -> None:
        """Keeps a rig file, with an event where it replaces the one that a state was learned with."""
        if stored.rig is not None and stored.state is not None:
            lines = rig_change(stored.rig, rig).other
            detail = f"the rig file has changed since the stored state was learned: {_named(lines)}"
            log.warning("%s: %s", stored.asset, detail, extra={"asset": stored.asset})
            fault = {
                "window": None, "kind": "rig_changed", "channel": "rig", "count": len(lines), "action": "none",
                "detail": detail,
            }  # fmt: skip
            self._store.note(stored.asset, [("data_fault", fault)])
            self._board.update(stored.asset, last_event_id=self._store.last_event_id(stored.asset))
        self._store.keep_rig(stored.asset, rig)


class OfferedRigs:
    """Rig files that others offer on the network: a replay offers its recording's there."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._offered: dict[str, dict[str, Any]] = {}
        self._fresh: list[str] = []  # streams for which a rig file has come since they were last asked for
        self._lock = threading.Lock()

    @contextmanager
    def watching(self) -> Iterator[OfferedRigs]:
        """Remembers what is published until left."""
        with self._transport.watch_rigs(self._received):
            yield self

    def find(self, asset: str) -> Mapping[str, Any] | None:
        """The rig file offered for the asset, asked for where none has come; None where there is none."""
        with self._lock:
            if asset in self._offered:
                return self._offered[asset]
        for text in self._transport.ask_rig(asset, RIG_WAIT):
            self._received(asset, text)
        with self._lock:
            return self._offered.get(asset)

    def fresh(self) -> list[tuple[str, Mapping[str, Any]]]:
        """The rig files that have come since this was last called, with the streams that they are for."""
        if not self._fresh:
            return []
        with self._lock:
            streams, self._fresh = dict.fromkeys(self._fresh), []
            return [(stream, self._offered[stream]) for stream in streams]

    def _received(self, asset: str, text: bytes) -> None:
        try:
            mapping = parsed_document(text, f"the rig file offered for {asset}")
            checked_rig(mapping, f"rig of {asset}")
        except InputError as error:
            log.error("the rig file offered for %s cannot be used: %s", asset, error, extra={"asset": asset})
        else:
            with self._lock:
                self._offered[asset] = mapping
                self._fresh.append(asset)


def _flat(mapping: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _text(value: Any) -> str:
    if value is _ABSENT:
        return "absent"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _named(lines: tuple[str, ...]) -> str:
    more = f" and {len(lines) - MOST_NAMED} more" if len(lines) > MOST_NAMED else ""
    return ", ".join(lines[:MOST_NAMED]) + more
