"""What is likely wrong with a recording that was just imported: its faults, and mistakes of units, wiring and speed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from service.files.import_channel import ChannelMapping
from service.files.units import UNITS
from service.stream.channels import CHANNEL_KINDS
from service.stream.sources.mcap import Recording, windows_of
from twin.plausibility import mistakes_of
from twin.rig import Rig

EXAMINED = 3  # windows, from the first: a mistake of the installation is in all of them
SAME = 0.01  # relative difference of two factors that are one


def likely_mistakes(recording: Path, prefix: str) -> list[str]:
    """A line for each fault and each likely mistake of a recording's windows, each once."""
    lines: dict[tuple[str, ...], str] = {}  # windows of one recording repeat a mistake with other figures
    with Recording(recording, prefix) as opened:
        known = Rig.from_mapping(opened.rig() or {})
        for number, window in enumerate(windows_of(opened)):
            for fault in window.faults:
                said = f"{fault.channel}: {fault.kind.replace('_', ' ')}" + (
                    f", {fault.detail}" if fault.detail else ""
                )
                lines.setdefault((fault.channel, fault.kind), said)
            if number < EXAMINED:
                for mistake in mistakes_of(known, window):
                    lines.setdefault((*mistake.channels, mistake.kind), mistake.text)
    return list(lines.values())


def contradicted_units(channels: Iterable[ChannelMapping], units: Mapping[str, str]) -> Iterator[str]:
    """A line for each channel whose unit in the mapping is not the one that the data file states (`units` by label)."""
    for channel in channels:
        stated = units[channel.label]
        known = UNITS.get(stated.strip().lower())
        if known is None or channel.unit in ("V", "unknown", "pulses", "quadrature", "s"):
            continue
        kind, unit, scale = known
        if kind != channel.kind:
            yield (
                f"{channel.key}: the file states {stated} for {channel.columns[0]!r}, which is no {channel.kind}: "
                f"columns exchanged?"
            )
            continue
        ratio = abs(channel.factor) / abs(CHANNEL_KINDS[kind].import_units[unit].factor * scale)
        if abs(ratio - 1) > SAME:
            size = f"{ratio:.4g} times" if ratio > 1 else f"1/{1 / ratio:.4g} of"
            yield (
                f"{channel.key}.unit = {channel.unit!r}: the file states {stated} for {channel.columns[0]!r}, and the "
                f"values come out {size} that; which is right?"
            )
