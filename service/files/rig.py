"""Rig files: TOML read at the edge, checked by the core, every fault one line with the file's name.

A rig is a file's, or that which is attached to a recording. The age of the gears is stated as `new`, "5000 rev",
"1200 h" or `unknown`; a rig file holds it in revolutions.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

from service.errors import FrameError, InputError
from service.files.documents import load_document
from service.stream.assembly import AssemblySettings
from service.stream.frames import Frame
from service.stream.wire.topics import Channel
from twin.errors import ParameterError
from twin.gear_age import NEW, UNKNOWN
from twin.rig import Rig

PERIODS, CUT = 4, 2  # common periods of the shafts that a baseline needs, and turns of the pinion cut at the ends
LONGEST = 120.0  # of a window of a slow machine [s]
HOUR = 3600.0  # [s]
EXAMPLE_AGE = "5000 rev"
_AGE = re.compile(r"\s*(\d+(?:[.,]\d+)?)\s*(rev|revolutions|turns|h|hours)\s*")


def load_mapping(path: str | Path) -> dict[str, Any]:
    """The mapping of a rig file."""
    return load_document(path, "rig file")


def checked_rig(mapping: Mapping[str, Any], where: str) -> Rig:
    """The rig of a mapping; InputError with `where` in front of what is wrong."""
    try:
        return Rig.from_mapping(mapping)
    except ParameterError as error:
        raise InputError(f"{where}: {error}") from None


def load_rig(path: str | Path) -> Rig:
    """The rig of a rig file."""
    return checked_rig(load_mapping(path), str(path))


def expected_channels(rig: Rig) -> tuple[str, ...]:
    """Labels of the channels that the machine has by its rig file."""
    labels = [f"accel/{rig.accelerometer}"] if rig.accelerometer else []
    labels += [f"encoder/{shaft}" for shaft in ("pinion", "gear") if rig.has(f"encoders.{shaft}_edges_per_rev")]
    if rig.has("sensors.torque"):
        labels.append("torque/pinion")
    labels += [f"temperature/{place}" for place in rig.get("sensors.temperature", ())]
    return tuple(labels)


def assembly_for(rig: Rig, base: AssemblySettings) -> AssemblySettings:
    """How the frames of a machine become windows: its channels too are waited for, its sensors' ranges hold.

    A slow machine that is judged by a healthy baseline alone has windows in which its shafts come round often enough.
    """
    own = replace(base.waiting_for(expected_channels(rig)), rig=rig)
    speed = rig.get("operating.pinion_speed_hz")
    if not speed or rig.has("gears.module") or not rig.has("gears.pinion.teeth", "gears.gear.teeth"):
        return own
    common = Fraction(*rig.teeth).denominator  # pinion turns after which the same teeth meet
    return replace(own, length=min(max(base.length, (PERIODS * common + CUT) / speed), max(LONGEST, base.length)))


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


def age_of(where: str, given: object, speed_hz: float | None) -> str | float:
    """`new`, `unknown`, or the revolutions of the pinion that the gears have made; InputError for anything else.

    speed_hz  of the pinion, by which hours become revolutions; None where it is not known
    """
    if given in (NEW, UNKNOWN):
        return str(given)
    found = _AGE.fullmatch(given) if isinstance(given, str) else None
    if found is None:
        raise InputError(
            f"{where} = {given!r} must be {NEW}, {UNKNOWN}, revolutions of the pinion such as {EXAMPLE_AGE!r}, or "
            "hours run such as '1200 h'"
        )
    value = float(found[1].replace(",", "."))
    if found[2] not in ("h", "hours"):
        return value
    if speed_hz is None:
        raise InputError(
            f"{where} = {given!r}: hours become revolutions by the pinion's speed, which is not known; state "
            "operating.pinion_speed_hz in the rig file, or revolutions"
        )
    return value * HOUR * speed_hz
