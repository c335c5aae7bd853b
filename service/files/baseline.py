"""Healthy baselines of machines without a rig model: learned from recordings, kept in a file, and compared with.

A baseline file is a NumPy archive: `header`, JSON with the rig file's values and what is said of every recording, and
the lines of every recording and channel.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from fractions import Fraction
from math import inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from service.contract.base import not_available
from service.contract.parts import json_of
from service.errors import InputError
from service.files.recorded_rig import choose_asset, rig_of
from service.files.rig import assembly_for, checked_rig
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
from twin.baseline.off_lines import OffLines
from twin.baseline.reading import TURNS_PER_PERIOD, ChannelLines, SpacingSeen, WindowReading, common_period
from twin.baseline.repeats import Repeats
from twin.baseline.spacing import shared_ratio
from twin.baseline.usable import NotLearned
from twin.errors import TwinError
from twin.features.modulation import modulations
from twin.rig import Rig
from twin.windows import Window

SCHEMA = "gear-twin-baseline/1"
# what NumPy and the readers of its archive raise where a file is cut off, damaged or something else
NO_BASELINE = (ValueError, KeyError, TypeError, AttributeError, EOFError, BadZipFile, zlib.error, ZeroDivisionError)
KEPT = (
    "name", "start_time_ns", "duration", "turns", "period", "speed_hz", "speed_std_hz", "angle_from", "absolute",
    "torque_nm",
)  # fmt: skip
KEPT_OFF_LINES = ("names", "tones", "free_order", "clipped", "constant")


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
    header: dict[str, Any] = {
        "schema": SCHEMA,
        "rig": baseline.rig.values,
        "shafts": [[s.numerator, s.denominator] for s in baseline.shafts],
        "path_scatter": dict(baseline.path_scatter),
        "repeats": _repeats_json(baseline.repeats),
        "not_learned": [asdict(one) for one in baseline.not_learned],
        "copies": list(baseline.copies),
        "readings": [],
    }
    arrays: dict[str, np.ndarray] = {f"std/{name}": std for name, std in baseline.std.items()}
    for i, r in enumerate(baseline.readings):
        values = {name: getattr(r, name) for name in KEPT}
        values |= {"raw": dict(r.raw), "spacings": [asdict(s) for s in r.spacings]}
        header["readings"].append(values | {"rms": {name: c.rms for name, c in r.channels.items()}})
        for name, c in r.channels.items():
            arrays[f"{i}/{name}/lines"] = c.lines
            arrays[f"{i}/{name}/floor"] = c.floor
            if c.off is not None:
                arrays[f"{i}/{name}/off"] = c.off.values
                off = {key: getattr(c.off, key) for key in KEPT_OFF_LINES}
                header["readings"][-1].setdefault("off_lines", {})[name] = off
    arrays["header"] = np.frombuffer(json.dumps(plain(header), ensure_ascii=False).encode(), dtype=np.uint8)
    whole = path.with_name(path.name + ".part")
    try:
        with whole.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
        whole.replace(path)  # a reader sees the file before or after, never a part of it
    except OSError as error:
        whole.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {(error.strerror or 'fault').lower()}") from None


def read_baseline(path: Path) -> Baseline:
    """A baseline from its file; InputError where it is none."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            header = json.loads(bytes(archive["header"]).decode())
            if header.get("schema") != SCHEMA:
                raise InputError(f"{path}: schema {header.get('schema')!r} is not {SCHEMA!r}")
            readings = tuple(_reading(archive, i, values) for i, values in enumerate(header["readings"]))
            std = {name.partition("/")[2]: archive[name] for name in archive.files if name.startswith("std/")}
            return Baseline(
                rig=checked_rig(header["rig"], f"{path}: its rig"),
                shafts=tuple(Fraction(n, d) for n, d in header["shafts"]),
                readings=readings,
                std=std,
                path_scatter=header["path_scatter"],
                not_learned=tuple(_not_learned(one) for one in header["not_learned"]),
                copies=tuple(header["copies"]),
                repeats=_repeats(header["repeats"]),
            )
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {(error.strerror or 'fault').lower()}") from None
    except NO_BASELINE as error:
        raise InputError(f"{path}: not a baseline of `gear-twin baseline`: {error}") from None


def _repeats_json(repeats: Repeats) -> dict[str, Any]:
    """What healthy recordings repeat, with a factor of None where nothing is compared."""
    factors = [[kind, channel, f if isfinite(f) else None] for (kind, channel), f in repeats.factors.items()]
    return asdict(repeats) | {"factors": factors}


def _repeats(given: dict[str, Any]) -> Repeats:
    factors = {(kind, channel): inf if f is None else float(f) for kind, channel, f in given["factors"]}
    return Repeats(**given | {"factors": factors, "pattern": tuple(given["pattern"])})


def _not_learned(given: dict[str, Any]) -> NotLearned:
    return NotLearned(**given | {"windows": tuple(given["windows"])})


def _off_lines(values: np.ndarray, header: dict[str, Any]) -> OffLines:
    return OffLines(
        names=tuple(header["names"]),
        values=values,
        tones=tuple(header["tones"]),
        **{key: float(header[key]) for key in ("free_order", "clipped", "constant")},
    )


def _reading(archive: Any, index: int, values: dict[str, Any]) -> WindowReading:
    rms, off = values.pop("rms"), values.pop("off_lines", {})
    channels = {
        name: ChannelLines(
            lines=archive[f"{index}/{name}/lines"],
            floor=archive[f"{index}/{name}/floor"],
            rms=float(level),
            off=_off_lines(archive[f"{index}/{name}/off"], off[name]) if name in off else None,
        )
        for name, level in rms.items()
    }
    raw = {name: (float(rms), float(kurtosis)) for name, (rms, kurtosis) in values.pop("raw").items()}
    spacings = tuple(SpacingSeen(order=one["order"], clearness=one["clearness"]) for one in values.pop("spacings"))
    return WindowReading(channels=channels, raw=raw, spacings=spacings, **values)
