"""The asset and the rig of a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

from service.errors import FrameError, InputError
from service.files.rig import checked_rig, load_mapping
from service.stream.frames import Frame
from service.stream.wire.topics import Channel
from twin.rig import Rig


class Source(Protocol):
    """A recording that is open: a file, or several that follow one another.

    path              where it is, for people
    size, bytes_read  of it, and of what has been read [bytes]
    faults            what is damaged in it; complete once all frames are read
    """

    @property
    def path(self) -> str | Path: ...
    @property
    def size(self) -> int: ...
    @property
    def bytes_read(self) -> int: ...
    @property
    def faults(self) -> list[str]: ...
    @property
    def assets(self) -> list[str]: ...
    def labels(self, asset: str) -> tuple[str, ...]:
        """The channels of an asset."""

    def rig(self) -> dict[str, Any] | None:
        """The rig file that it holds, as a mapping."""

    def frames(self, on_error: Callable[[Channel, FrameError], None]) -> Iterator[Frame]:
        """The frames; what breaks the contract is handed to `on_error` instead."""


def choose_asset(recording: Source, asset: str | None) -> str:
    """The asset asked for, or the only one."""
    assets = recording.assets
    if asset is None and len(assets) == 1:
        return assets[0]
    if asset in assets:
        return asset
    what = f"has no asset {asset!r}" if asset else "holds more than one asset"
    raise InputError(f"{recording.path}: {what}; choose one of {', '.join(assets)}")


def rig_of(recording: Source, rig_path: str | Path | None) -> Rig:
    """The rig of a file, or the recording's attachment."""
    mapping = recording.rig()
    if rig_path is not None:
        return _with_age(load_mapping(rig_path), mapping, str(rig_path))
    if mapping is None:
        why = f" ({'; '.join(recording.faults)})" if recording.faults else ""
        raise InputError(f"{recording.path}: no rig.toml is attached{why}: give a rig file")
    return checked_rig(mapping, f"{recording.path}: attached rig.toml")


def _with_age(given: dict[str, Any], attached: dict[str, Any] | None, where: str) -> Rig:
    """A rig file given in place of the attached one: where it says nothing of the gears' age, the recording does."""
    age = (attached or {}).get("gears", {}).get("age")
    gears = given.get("gears", {})
    if age is None or "age" in gears:
        return checked_rig(given, where)
    return checked_rig({**given, "gears": {**gears, "age": age}}, where)
