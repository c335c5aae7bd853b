"""Values as they are kept in columns of the database: JSON in frames of Zstandard that carry a checksum.

The checksum finds what no parser does: a digit that is another one than was written.
"""

from __future__ import annotations

import logging
import threading
import zlib
from collections.abc import Callable
from typing import Any

import zstandard
from pydantic_core import from_json

from service.errors import DamageError
from service.json_text import JsonText, compact

LEVEL = 1  # of compression: higher ones take many times as long for a few per cent
LARGEST = 2**30  # bytes of one value

log = logging.getLogger(__name__)
_of_thread = threading.local()  # compressors are for one thread each
_said: set[str] = set()  # damaged values that the log names already
MOST_SAID = 1000


def dump(value: Any) -> bytes | None:
    """A value as it is kept; None stays None, and a number that is not finite becomes null."""
    if value is None:
        return None
    text = value.text if isinstance(value, JsonText) else compact(value)
    try:
        compressor = _of_thread.compressor
    except AttributeError:
        compressor = _of_thread.compressor = zstandard.ZstdCompressor(level=LEVEL, write_checksum=True)
    return compressor.compress(text.encode())


def load(kept: bytes | None, what: str = "a row of the database") -> Any:
    """A value as it was given; None stays None. DamageError where it is not what was written.

    what  the value, for the error
    """
    text = load_text(kept, what)
    try:
        return None if text is None else from_json(text.text, cache_strings="keys")
    except ValueError as error:
        raise DamageError(f"{what} is damaged ({error})") from None


def load_text(kept: bytes | None, what: str = "a row of the database") -> JsonText | None:
    """As `load`, for a large mapping that few look into: it is checked, and parsed by the first who does."""
    if kept is None:
        return None
    try:
        decompressor = _of_thread.decompressor
    except AttributeError:
        decompressor = _of_thread.decompressor = zstandard.ZstdDecompressor()
    try:
        if not _has_checksum(kept):
            raise ValueError("no checksum")
        return JsonText(decompressor.decompress(kept).decode())
    except (zstandard.ZstdError, ValueError, TypeError, MemoryError) as error:
        raise DamageError(f"{what} is damaged ({str(error) or type(error).__name__})") from None


def salvage(kept: bytes | None, what: str, read: Callable[[bytes | None, str], Any] = load) -> Any:
    """A value as it was given, or as `read` gives it; None where it is damaged, which the log says once."""
    try:
        return read(kept, what)
    except DamageError as error:
        say_damage(error)
        return None


def say_damage(error: DamageError) -> None:
    """Says in the log, once a start, that something kept is damaged and is left out."""
    text = str(error)
    if text not in _said and len(_said) < MOST_SAID:
        _said.add(text)
        log.error("%s; it is left out, and a backup would have it", text)


def seal(*numbers: int | None) -> int:
    """A checksum of the numbers of a row."""
    return zlib.crc32(",".join(map(str, numbers)).encode())


def _has_checksum(kept: bytes) -> bool:
    """Whether the frame says so itself: one damaged bit there would leave the rest unchecked."""
    if not isinstance(kept, bytes):
        raise ValueError("no frame of Zstandard")
    found = zstandard.get_frame_parameters(kept)
    return found.has_checksum and found.content_size <= LARGEST
