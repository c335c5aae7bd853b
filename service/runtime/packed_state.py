"""A twin's state on its way between processes: compressed JSON text, which only the one that computes looks into."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import zstandard

from service.json_text import JsonText, compact

LEVEL = 1  # of the compression: a state shrinks to a tenth, higher levels only take longer


@dataclass(frozen=True, slots=True)
class PackedState:
    """A state as compressed JSON text."""

    packed: bytes

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> PackedState:
        """The state of what `to_dict` gave."""
        text = data.text if isinstance(data, JsonText) else compact(data)
        return cls(zstandard.ZstdCompressor(LEVEL).compress(text.encode()))

    @property
    def version(self) -> bytes:
        """The same for equal states alone."""
        return hashlib.blake2b(self.packed, digest_size=16).digest()

    def to_dict(self) -> JsonText:
        """The state's data, which are not parsed until somebody looks into them."""
        return JsonText(zstandard.ZstdDecompressor().decompress(self.packed).decode())


NEW = PackedState.of({})
"""What a twin remembers that has seen nothing yet."""


class StoredState:
    """A state that is read from the store when it is first needed: a service with many assets starts at once."""

    def __init__(self, read: Callable[[], Mapping[str, Any] | None]) -> None:
        self._read = read

    def to_dict(self) -> Mapping[str, Any]:
        """The state's data."""
        state = self._read()
        return {} if state is None else state  # not by its truth, for which a text would be parsed

    def pack(self) -> PackedState:
        """The state as it is sent."""
        return PackedState.of(self.to_dict())
