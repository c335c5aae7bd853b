"""`gear-twin doctor`: what a recording and a rig file support, and what they do not and why."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import InputError
from service.files.rig import checked_rig, choose_asset, expected_channels, load_rig
from service.setup.abilities import Ability, Equipment, abilities, equipment_of_rig, one_more
from service.stream.assembly import DEFAULT, AssemblySettings
from service.stream.channels import CHANNEL_KINDS, SHAFTS, Layout, kind_of
from service.stream.sources.mcap import Recording, windows_of
from service.stream.wire.topics import PREFIX
from twin.errors import TwinError
from twin.features.extract import extract
from twin.plausibility import mistakes_of
from twin.rig import Rig
from twin.rig_notes import rig_notes
from twin.suitability import NOTE, PROBLEM, Finding, Seen, findings
from twin.windows import Window

EXAMINED = 3  # windows, from the first, that are examined for likely mistakes
MOST_WINDOWS = 40  # that are read: enough to see operating points and growth, at most a minute of work


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelRow:
    """One channel over the windows that were read."""

    label: str
    rate: str  # with its unit
    duration: float  # [s]
    level: str  # with its unit


@dataclass(frozen=True, slots=True, kw_only=True)
class Examination:
    """Everything that the doctor says."""

    recording: str | None
    rig: str | None
    windows: int
    channels: tuple[ChannelRow, ...]
    findings: tuple[Finding, ...]
    abilities: tuple[Ability, ...]
    one_more_sensor: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def examined(
    path: Path | None,
    rig_path: Path | None,
    asset: str | None = None,
    assembly: AssemblySettings = DEFAULT,
    prefix: str = PREFIX,
) -> Examination:
    """The examination of a recording, of a rig file, or of both; InputError where neither can be used."""
    if path is None:
        if rig_path is None:
            raise InputError("nothing to examine: name a recording, or a rig file with --rig")
        return _of_rig(load_rig(rig_path), rig_path)
    with Recording(path, prefix) as recording:
        name, mapping = choose_asset(recording, asset), recording.rig()
        rig = load_rig(rig_path) if rig_path else checked_rig(mapping or {}, f"{path}: attached rig.toml")
        windows = list(islice(windows_of(recording, assembly, name), MOST_WINDOWS))
    if not windows:
        raise InputError(f"{path}: no whole window: {'; '.join(recording.faults) or 'no frames'}")
    return _of_windows(path, rig, rig_path or (f"{path}: attached" if mapping is not None else None), windows)


def _of_rig(rig: Rig, rig_path: Path) -> Examination:
    """A rig file alone: the sensors that it names."""
    accelerometers = int(rig.accelerometer is not None)
    edges = tuple(int(rig.get(f"encoders.{shaft}_edges_per_rev", 0)) for shaft in SHAFTS)
    equipment = equipment_of_rig(rig, accelerometers, (edges[0], edges[1]), rig.has("sensors.torque"))
    return _with_abilities(equipment, None, rig_path, 0, (), _rig_findings(rig))


def _of_windows(path: Path, rig: Rig, rig_said: Any, windows: list[Window]) -> Examination:
    seen, refused = [], []
    for window in windows:
        try:
            seen.append(Seen(window=window, features=extract(rig, window)))
        except TwinError as error:
            refused.append(str(error))
    mistakes = list(_mistakes(rig, windows))
    named = {finding.mistake for finding in mistakes}
    if "swapped" in named:  # the speed is another shaft's then, and so is the mesh frequency
        named.add("mesh")
    own = [f for f in findings(rig, seen) if not f.mistake or f.mistake not in named]
    channels = _channels(windows)
    found = [*_channel_findings(rig, channels), *own, *mistakes, *_rig_findings(rig)]
    for reason in dict.fromkeys(refused):
        found.append(Finding(level=PROBLEM, text=f"{refused.count(reason)} of {len(windows)} windows: {reason}"))
    edges = [max((e.per_rev for e in channels.get(f"encoder/{shaft}", ())), default=0) for shaft in SHAFTS]
    accelerometers = sum(label.startswith("accel/") for label in channels)
    equipment = equipment_of_rig(rig, accelerometers, (edges[0], edges[1]), "torque/pinion" in channels)
    rows = tuple(_row(label, held) for label, held in channels.items())
    return _with_abilities(equipment, path, rig_said, len(windows), rows, found)


def _with_abilities(
    equipment: Equipment, path: Path | None, rig_said: Any, windows: int, rows: Any, found: Any
) -> Examination:
    return Examination(
        recording=None if path is None else str(path),
        rig=None if rig_said is None else str(rig_said),
        windows=windows,
        channels=rows,
        findings=tuple(found),
        abilities=abilities(equipment),
        one_more_sensor=one_more(equipment),
    )


def _channels(windows: list[Window]) -> dict[str, list[Any]]:
    """What the windows hold of each channel, by its label."""
    found: dict[str, list[Any]] = {}
    for window in windows:
        for kind in (k for k in CHANNEL_KINDS.values() if not k.slow):
            for name, held in getattr(window, kind.window_field).items():
                found.setdefault(f"{kind.segment}/{name}", []).append(held)
        for label, value in window.slow.items():
            found.setdefault(label, []).append(value)
    return dict(sorted(found.items()))


def _row(label: str, held: list[Any]) -> ChannelRow:
    kind = kind_of(label)
    if kind.layout is Layout.SAMPLES:
        values = np.concatenate([s.values for s in held])
        values = values[np.isfinite(values)]
        level = "no valid sample"
        if values.size:
            first = f"RMS {values.std():.3g}" if kind.vibration else f"mean {values.mean():.4g}"
            level = f"{first}, largest {np.abs(values).max():.3g} {kind.unit}"
        return ChannelRow(label=label, rate=f"{held[0].rate:g} Hz", duration=sum(s.duration for s in held), level=level)
    if kind.layout is Layout.EDGES:
        known = [np.flatnonzero(np.isfinite(e.times)) for e in held]
        turns = sum((k[-1] - k[0]) / e.per_rev for k, e in zip(known, held, strict=True) if k.size)
        length = sum(float(np.nanmax(e.times) - np.nanmin(e.times)) for e in held if np.isfinite(e.times).any())
        rate = "1 edge a turn" if held[0].per_rev == 1 else f"{held[0].per_rev} edges a turn"
        return ChannelRow(
            label=label, rate=rate, duration=length,
            level=f"{turns:.4g} turns, {turns / length:.4g} Hz" if length else "no valid edge",
        )  # fmt: skip
    values = np.array([s.value for s in held])
    return ChannelRow(label=label, rate="slow", duration=0.0, level=f"{values.min():.4g} to {values.max():.4g} (SI)")


def _channel_findings(rig: Rig, labels: Collection[str]) -> Iterator[Finding]:
    """Channels that the rig file names and the recording lacks, and an accelerometer that it does not name."""
    for label in expected_channels(rig):
        if label not in labels:
            yield Finding(
                level=NOTE if label.startswith("temperature") else PROBLEM,
                text=f"{label}, which the rig file names, is not in the recording",
                remedy="another name in the mapping, or another sensor in the rig file?",
            )
    sensors = [label for label in labels if label.startswith("accel/")]
    if sensors and rig.accelerometer is None and len(sensors) > 1:
        yield Finding(
            level=NOTE,
            text=f"{len(sensors)} accelerometers, and the rig file names none as the reference (sensors.accelerometer)",
            remedy=f"one of {', '.join(label.partition('/')[2] for label in sensors)}",
        )


def _mistakes(rig: Rig, windows: list[Window]) -> Iterator[Finding]:
    """Likely mistakes of units, wiring, clocks and speed in the first windows, each once."""
    known = set()
    for window in windows[:EXAMINED]:
        for mistake in mistakes_of(rig, window):
            if (mistake.kind, mistake.channels) not in known:
                known.add((mistake.kind, mistake.channels))
                text = f"{', '.join(mistake.channels)}: {mistake.evidence}"
                yield Finding(level=PROBLEM, text=text, remedy=mistake.remedy, mistake=mistake.kind)


def _rig_findings(rig: Rig) -> Iterator[Finding]:
    for note in rig_notes(rig):
        yield Finding(level=NOTE, text=f"rig file: {note}")
