"""Rig files: TOML read at the edge, checked by the core, every fault one line with the file's name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from service.errors import InputError
from service.files.documents import load_document
from service.stream.assembly import AssemblySettings
from twin.errors import ParameterError
from twin.rig import Rig

PERIODS, CUT = 4, 2  # common periods of the shafts that a baseline needs, and turns of the pinion cut at the ends
LONGEST = 120.0  # of a window of a slow machine [s]


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
