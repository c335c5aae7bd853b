"""Where rig files come from: the settings, and whoever offers some on the network."""

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
from service.results.unknown_assets import UnknownAssets
from service.transport.protocol import Transport

log = logging.getLogger(__name__)

RIG_WAIT = 1.0  # how long a rig file is asked for [s]
RIG_BYTES = 2**17  # of a rig file that is offered
MOST_OFFERED = 256  # streams for which rig files that were offered are kept


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


class OfferedRigs:
    """Rig files that others offer on the network: a replay offers its recording's there."""

    def __init__(self, transport: Transport, unknown: UnknownAssets | None = None) -> None:
        self._transport, self._unknown = transport, unknown or UnknownAssets()
        self._offered: dict[str, bytes] = {}  # the newest at the end
        self._fresh: dict[str, None] = {}  # streams for which a rig file has come since they were last asked for
        self._lock = threading.Lock()

    @contextmanager
    def watching(self) -> Iterator[OfferedRigs]:
        """Remembers what is published until left."""
        with self._transport.watch_rigs(self._received):
            yield self

    def find(self, stream: str, *, ask: bool = True) -> Mapping[str, Any] | None:
        """The rig file offered for a stream, asked for where none has come; None where there is none."""
        if ask and stream not in self._offered:
            for text in self._transport.ask_rig(stream, RIG_WAIT):
                self._received(stream, text)
        with self._lock:
            found = self._offered.get(stream)
        return None if found is None else parsed_document(found, f"the rig file offered for {stream}")

    def fresh(self) -> list[tuple[str, Mapping[str, Any]]]:
        """The rig files that have come since this was last called, with the streams that they are for."""
        if not self._fresh:
            return []
        with self._lock:
            streams, self._fresh = self._fresh, {}
            found = [(stream, self._offered[stream]) for stream in streams if stream in self._offered]
        return [(stream, parsed_document(text, f"the rig file offered for {stream}")) for stream, text in found]

    def _received(self, asset: str, text: bytes) -> None:
        try:
            if len(text) > RIG_BYTES:
                raise InputError(f"it has {len(text)} bytes, and at most {RIG_BYTES} are accepted")
            mapping = parsed_document(text, f"the rig file offered for {asset}")
            checked_rig(mapping, f"rig of {asset}")
        except InputError as error:
            log.error("the rig file offered for %s cannot be used: %s", asset, error, extra={"asset": asset})
            return
        if not self._unknown.is_known(asset):
            self._unknown.offered(asset, mapping, len(text))
            return
        with self._lock:
            self._offered.pop(asset, None)
            self._offered[asset] = text
            self._fresh[asset] = None
            if len(self._offered) > MOST_OFFERED:
                oldest = next(iter(self._offered))
                del self._offered[oldest]
                self._fresh.pop(oldest, None)
