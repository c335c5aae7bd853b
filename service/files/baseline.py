"""Healthy baselines of machines without a rig model: learned from recordings, kept in a file, and compared with.

A baseline file is a NumPy archive: `header`, JSON of the baseline's fields (twin/serial.py), and the bytes of each
array by number.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from service.contract.base import not_available
from service.contract.parts import json_of
from service.errors import InputError
from service.file_faults import reading, whole_file
from service.files.rig import assembly_for, checked_rig, choose_asset, rig_of
from service.json_text import plain
from service.stream.assembly import DEFAULT, AssemblySettings
from service.stream.sources.mcap import Recording, read_windows
from service.stream.window import by_sound_instruments
from service.stream.wire.topics import PREFIX
from twin import assessment
from twin.baseline.comparison import (
    NO_DEPTH,
    BaselineResult,
    TrackedWindow,
    compare_levels,
    compare_with_baseline,
    described,
    pair_shafts,
    read_lines,
    tracked,
    unattributed_lines,
)
from twin.baseline.energy_breakdown import energy_breakdown
from twin.baseline.learned import Baseline
from twin.baseline.leaving_out import learn
from twin.baseline.modulation import against_baseline
from twin.baseline.reading import TURNS_PER_PERIOD, common_period
from twin.baseline.spacing import shared_ratio
from twin.errors import TwinError
from twin.features.modulation import modulations
from twin.rig import Rig
from twin.serial import from_parts, to_parts
from twin.windows import Window

SCHEMA = "gear-twin-baseline/2"
# what NumPy and the readers of its archive raise where a file is cut off, damaged or something else
NO_BASELINE = (ValueError, KeyError, TypeError, AttributeError, EOFError, BadZipFile, zlib.error)


class Loaded(NamedTuple):
    """The usable windows of one recording."""

    rig: Rig
    asset: str
    windows: list[TrackedWindow]
    refused: list[str]
    untracked: list[Window]  # those refused


def load(
    path: Path,
    rig_path: Path | None = None,
    shafts: Sequence[Fraction] | None = None,
    assembly: AssemblySettings = DEFAULT,
    prefix: str = PREFIX,
    name: str | None = None,
    allow_untracked: bool = False,
) -> Loaded:
    """The windows of a recording that have a pinion angle.

    shafts    known ones; those of the pair where None
    assembly  how frames become windows, the same as in `assess` and in the service
    prefix    first part of the recording's topics
    name      of the recording; that of its file where None
    allow_untracked  whether windows without an angle are enough
    Raises InputError where there is none.
    """
    with Recording(path, prefix) as recording:
        asset = choose_asset(recording, None)
        rig = rig_of(recording, rig_path)
    try:
        shafts = pair_shafts(rig) if shafts is None else shafts
    except TwinError as error:
        raise InputError(f"{path}: a baseline needs the tooth counts of the pair: {error}") from None
    windows, refused, untracked = [], [], []
    for i, window in enumerate(read_windows(path, assembly_for(rig, assembly), prefix)[2]):
        own, window = f"{name or path.stem}#{i}", by_sound_instruments(rig, window)
        try:
            windows.append(tracked(rig, window, own, shafts))
        except TwinError as error:
            refused.append(f"{own}: {error}")
            untracked.append(window)
    if not windows and not (allow_untracked and untracked):
        raise InputError(f"{path}: no window can be used: {refused[0] if refused else 'there is none'}")
    return Loaded(rig, asset, windows, refused, untracked)


def learned(
    paths: Sequence[Path],
    rig_path: Path | None = None,
    assembly: AssemblySettings = DEFAULT,
    prefix: str = PREFIX,
) -> Baseline:
    """A baseline from recordings of the healthy machine.

    Another shaft that is geared to the pinion is included where most windows show its lines.
    """
    loaded = [
        load(path, rig_path, assembly=assembly, prefix=prefix, name=name)
        for path, name in zip(paths, _names(paths), strict=True)
    ]
    rig = loaded[0].rig
    for path, other in zip(paths, loaded, strict=True):
        if other.rig.teeth != rig.teeth:
            raise InputError(f"{path}: {other.rig.teeth} teeth, while {paths[0]} has {rig.teeth}: not one machine")
    windows = [w for found in loaded for w in found.windows]
    try:
        return _learned(rig, windows)
    except TwinError as error:
        raise InputError(f"{', '.join(map(str, paths))}: {error}") from None


def _names(paths: Sequence[Path]) -> list[str]:
    """A name for every file: its own without its ending, with its folder's where another has the same."""
    stems = [path.stem for path in paths]
    return [f"{p.parent.name}/{p.stem}" if stems.count(p.stem) > 1 else p.stem for p in paths]


def learned_from(rig: Rig, windows: Sequence[tuple[str, Window]], earlier: Baseline | None = None) -> Baseline:
    """A baseline from named windows of the healthy machine, added to the recordings of an earlier one."""
    try:
        shafts = pair_shafts(rig)
        return _learned(rig, [tracked(rig, window, name, shafts) for name, window in windows], earlier)
    except TwinError as error:
        raise InputError(f"no baseline can be learned from {', '.join(name for name, _ in windows)}: {error}") from None


def _learned(rig: Rig, windows: Sequence[TrackedWindow], earlier: Baseline | None = None) -> Baseline:
    shafts = (*pair_shafts(rig), *_geared(windows)) if earlier is None else earlier.shafts
    names = {w.name for w in windows}  # a recording that is given once more takes the place of the earlier reading
    before = () if earlier is None else [r for r in earlier.readings if r.name not in names]
    found = learn(rig, [*before, *(read_lines(rig, w, shafts) for w in windows)], shafts)
    return found if earlier is None else replace(found, not_learned=(*earlier.not_learned, *found.not_learned))


def _geared(windows: Sequence[TrackedWindow]) -> tuple[Fraction, ...]:
    """The order of another shaft that most windows show and are long enough to tell apart."""
    ratio = shared_ratio([w.spacings for w in windows])
    if ratio is None:
        return ()
    turns = min(w.track.turns for w in windows)
    return (ratio,) if turns >= TURNS_PER_PERIOD * common_period((Fraction(1), ratio)) else ()


def compared(
    baseline: Baseline,
    path: Path,
    rig_path: Path | None = None,
    assembly: AssemblySettings = DEFAULT,
    prefix: str = PREFIX,
) -> tuple[Loaded, BaselineResult]:
    """A recording compared with a baseline; InputError where it cannot be."""
    loaded = load(path, rig_path, baseline.shafts, assembly, prefix, allow_untracked=True)
    try:
        if loaded.windows:
            return loaded, compare_with_baseline(baseline, loaded.rig, loaded.windows)
        found = compare_levels(baseline, loaded.rig, loaded.untracked, loaded.refused[0])
    except TwinError as error:
        raise InputError(f"{path}: {error}") from None
    if not found.raw_limit.exceeded:
        raise InputError(f"{path}: no window can be used: {loaded.refused[0]}")
    return loaded, found


def answer(loaded: Loaded, baseline: Baseline, found: BaselineResult) -> dict[str, Any]:
    """The answer in the names of the contract."""
    missing, search = not_available(NO_DEPTH), found.unattributed_search
    sought = None if search is None else json_of(search)
    return plain(
        {
            "asset": loaded.asset,
            "baseline": json_of(described(baseline, raw=found.raw_limit)),
            "windows": [json_of(window) for window in found.windows],
            "refused": loaded.refused,
            "wear": missing,
            "rul": missing,
            "residual": json_of(found.residual),
            "effects": [json_of(effect) for effect in found.effects],
            "unexplained": json_of(found.unexplained),
            "unattributed_lines": [json_of(lines) for lines in found.unattributed_lines],
            "unattributed_search": sought,
            "modulation": [json_of(one) for one in modulation_of(loaded, baseline)],
        }
    )


def modulation_of(loaded: Loaded, baseline: Baseline) -> tuple[assessment.Modulation, ...]:
    """Modulations of the latest usable window against those of the baseline."""
    found: list[assessment.Modulation] = []
    for latest in loaded.windows[-1:]:
        for sensor, samples in latest.window.accelerations.items():
            with suppress(TwinError):  # what cannot be read of a sensor, the comparison of its lines says
                found += modulations(samples, latest.track, loaded.rig.teeth, sensor)
    return against_baseline(sorted(found, key=lambda m: -m.depth), baseline)


def lines_of_no_shaft(loaded: Loaded) -> list[dict[str, Any]]:
    """Spacings of lines that neither gear makes."""
    found = unattributed_lines(loaded.windows, pair_shafts(loaded.rig), ("pinion", "gear"))
    return [json_of(lines) for lines in found]


def energy_of(
    path: Path, rig_path: Path | None = None, assembly: AssemblySettings = DEFAULT, prefix: str = PREFIX
) -> list[dict[str, Any]] | dict[str, str]:
    """The energy of a recording's first usable window by origin and channel, or why it is not available."""
    try:
        loaded = load(path, rig_path, assembly=assembly, prefix=prefix)
        first = loaded.windows[0]
        shafts = pair_shafts(loaded.rig)
        found = energy_breakdown(first.window.accelerations, first.track, loaded.rig.teeth, shafts, first.spacings)
    except (InputError, TwinError) as reason:
        return not_available(str(reason))
    return [
        {
            "channel": f.channel,
            "family": f.name,
            "share_percent": 100 * f.share,
            "share_std_percent": 100 * f.share_std,
            "steady": f.steady,
            "steady_if_fixed": f.steady_if_fixed,
        }
        for f in found
    ]


def save(baseline: Baseline, path: Path) -> None:
    """Writes a baseline file; InputError where it cannot be written."""
    fields, arrays = to_parts(baseline)
    header = json.dumps({"schema": SCHEMA, "baseline": fields}, ensure_ascii=False, default=plain).encode()
    members = {str(i): np.frombuffer(data, np.uint8) for i, data in enumerate(arrays)}
    with whole_file(path) as part, part.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, header=np.frombuffer(header, np.uint8), **members)


def read_baseline(path: Path) -> Baseline:
    """A baseline from its file; InputError where it is none."""
    try:
        with reading(path), path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            header = json.loads(bytes(archive["header"]).decode())
            if header.get("schema") != SCHEMA:
                raise InputError(f"{path}: schema {header.get('schema')!r} is not {SCHEMA!r}: learn the baseline again")
            arrays = [archive[str(i)].tobytes() for i in range(len(archive.files) - 1)]
            found = from_parts(Baseline, header["baseline"], arrays)
        return replace(found, rig=checked_rig(found.rig.values, f"{path}: its rig"))
    except InputError:
        raise
    except NO_BASELINE as error:
        raise InputError(f"{path}: not a baseline of `gear-twin baseline`: {error}") from None
