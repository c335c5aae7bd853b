"""Where lines of no gear enter, and how they move with speed, load and time.

Every entry (twin/effects/unknown_effect.py) fixes the ratio of the channels. The clearest channel y0 stands for the
excitation, whose size is free in every window; each other channel c then says

    ln p = −eᴴ·C⁻¹·e − ln det C,     e_i = y_ci − ρ_i·y0_i,     C = diag(2σ_ci²) + s²·(ρ·y0)(ρ·y0)ᴴ

ρ   ratio of the channels' transfers from the entry, by window
s   what the machine's structure may differ from the model's, common to all windows
σ   standard deviation of a line's real and imaginary part

A place where the lines would need an impossible size is none. Places of one kind (the bearings, say) share
the evidence of their kind evenly. The level at the entry is then compared
with a constant, the torque, the square of the speed, and steady growth.

Source   Gaussian errors; Bayes' theorem for the kinds, as likely before; Schwarz's −½·ln n for a free number
Holds    lines that the mesh answers linearly; structures within the rig's tolerance, not at a sharp resonance
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from twin.effects.unknown_effect import BEARINGS, CHANNELS, TORQUES, transfers
from twin.model import Model
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.unknown_lines import FollowedLine, SeenWindow

KINDS: Mapping[str, tuple[str, ...]] = {
    "mesh": ("mesh",),
    "bearing": BEARINGS,
    "shaft": TORQUES,
    **{channel: (channel,) for channel in CHANNELS},
}
LAWS = ("constant", "torque", "speed", "growth")


@dataclass(frozen=True, slots=True, kw_only=True)
class EntryThresholds:
    """What lines of an excitation may differ from the model's."""

    structure: float = deciding(
        0.4,
        of="modelled ratio of two channels",
        meaning="standard deviation of a ratio's real and imaginary part",
        source="not derived: chosen; wider than 3 % of stiffness and 20 % of damping make it but at a resonance",
    )
    error_floor: float = deciding(
        0.005,
        of="gear graduation error",
        meaning="least standard deviation of a line of the transmission error",
        source="not derived: chosen; 8 nm on the reference rig",
    )
    torque_floor: float = deciding(
        0.5, of="torque noise floor", meaning="least standard deviation of a line of the torque", source="chosen"
    )
    largest: float = deciding(
        5.0,
        of="mean torque, and of its force at the base circle",
        meaning="amplitude of a torque, and of a force at a bearing, beyond which a place is impossible",
        source="not derived: chosen; teeth separate beyond one, and the inertia between is not certain",
    )
    told: float = deciding(
        3.0, unit="nat", meaning="evidence between two entries, or two laws, that tells them apart", source="1 to 20"
    )
    level_scatter: float = deciding(
        0.02, of="level", meaning="least scatter of a level from window to window", source="not derived: chosen"
    )


THRESHOLDS = EntryThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """Where lines of one cause enter."""

    place: str  # of ENTRIES
    kind: str  # of KINDS
    log_evidence: float  # over the next kind [nat]
    alike: tuple[str, ...]  # kinds that explain the channels as well
    compared: tuple[str, ...]  # channels that the place was told by, beside the clearest


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """How levels move; A·(T/T0)^p·(n/n0)^q·(1 + g·(N − N0))."""

    name: str  # of LAWS
    alike: tuple[str, ...]  # laws that the windows cannot tell from it
    levels: tuple[float, ...]  # A of each line
    stds: tuple[float, ...]
    growth: float  # g [1/revolution]
    scatter: float  # relative, of a window's level about the law
    torque: float  # T0 [N·m]
    speed: float  # n0 [Hz]
    revolutions: float  # N0


def entry_of(
    model: Model | None,
    lines: Sequence[FollowedLine],
    windows: Sequence[SeenWindow],
    scales: Scales,
    limits: EntryThresholds = THRESHOLDS,
) -> Entry:
    """The place from which lines of one cause are explained best; without a model, their clearest channel."""
    clearest = lines[0].channel
    compared = tuple(c for c in CHANNELS if c != clearest and any(c in r.channels for _, r in lines[0].at))
    if model is None or not compared:
        rest = tuple(kind for kind in KINDS if kind not in CHANNELS)
        return Entry(place=clearest, kind=clearest, log_evidence=0.0, alike=rest, compared=())
    floor = {
        "acceleration": scales.acceleration,
        "encoder": limits.error_floor * scales.graduation[1],
        "torque": limits.torque_floor * scales.torque_noise,
    }
    by_place = {
        place: -np.inf
        if any(_impossible(model, place, line, windows, scales, limits.largest) for line in lines)
        else sum(_evidence(model, place, line, windows, floor, limits.structure) for line in lines)
        for places in KINDS.values()
        for place in places
    }
    by_kind = {}
    for kind, places in KINDS.items():
        values = np.array([by_place[place] for place in places])
        top = float(values.max())
        by_kind[kind] = -np.inf if top == -np.inf else top + log(float(np.exp(values - top).mean()))
    ranked = sorted(by_kind, key=lambda kind: -by_kind[kind])
    best = ranked[0]
    return Entry(
        place=max(KINDS[best], key=lambda place: by_place[place]),
        kind=best,
        log_evidence=float(min(by_kind[best] - by_kind[ranked[1]], 1e6)),
        alike=tuple(kind for kind in ranked[1:] if by_kind[best] - by_kind[kind] < limits.told),
        compared=compared,
    )


def _impossible(
    model: Model, place: str, line: FollowedLine, windows: Sequence[SeenWindow], scales: Scales, largest: float
) -> bool:
    """Whether a line would need a displacement of a whole tooth, or a torque or force far beyond the load's."""
    if place in CHANNELS:
        return False
    made = np.abs(transfers(model, place, [r.frequency for _, r in line.at])[line.channel])
    seen = np.array([abs(r.amplitude(line.channel) or 0.0) for _, r in line.at])
    mean = np.abs(np.array([windows[i].torque for i, _ in line.at]))
    force = 1 / model.mesh.pair.base_radius[0]
    most = (
        np.full(mean.size, scales.base_pitch)
        if place == "mesh"
        else largest * mean * (1.0 if place in TORQUES else force)
    )
    return bool(np.median(seen - made * most) > 0)


def _evidence(
    model: Model,
    place: str,
    line: FollowedLine,
    windows: Sequence[SeenWindow],
    floor: Mapping[str, float],
    structure: float,
) -> float:
    """ln p of the channels of a line, for an excitation at a place."""
    used = [(i, r) for i, r in line.at if windows[i].fitted] or list(line.at)
    made = transfers(model, place, [r.frequency for _, r in used])
    first = np.array([r.amplitude(line.channel) for _, r in used], dtype=complex)
    total = 0.0
    if not np.abs(made[line.channel]).min() > 0:
        return -np.inf  # what enters another channel alone is not seen in this one
    for channel in CHANNELS:
        if channel == line.channel:
            continue
        there = [n for n, (_, r) in enumerate(used) if channel in r.channels]
        if not there:
            continue
        y = np.array([used[n][1].amplitude(channel) for n in there], dtype=complex)
        std = np.array([max(used[n][1].noise(channel), floor[channel]) for n in there])
        expected = (made[channel] / made[line.channel] * first)[there]
        left = y - expected
        C = np.diag(2 * std**2).astype(complex) + 2 * structure**2 * np.outer(expected, expected.conj())
        _, size = np.linalg.slogdet(C)
        total += -float(np.vdot(left, np.linalg.solve(C, left)).real) - float(size)
    return total


def law_of(
    model: Model | None,
    place: str,
    lines: Sequence[FollowedLine],
    windows: Sequence[SeenWindow],
    limits: EntryThresholds = THRESHOLDS,
) -> Law:
    """How the level of lines of one cause moves at the place where they enter."""
    which, levels, stds, torque, speed, turns = [], [], [], [], [], []
    for n, line in enumerate(lines):
        for i, r in [(i, r) for i, r in line.at if windows[i].fitted] or list(line.at):
            made = 1.0 if model is None else abs(transfers(model, place, [r.frequency])[line.channel][0])
            which.append(n)
            levels.append(abs(r.amplitude(line.channel) or 0) / made)
            stds.append(r.noise(line.channel) / made)
            torque.append(windows[i].torque)
            speed.append(windows[i].speed_hz)
            turns.append(windows[i].revolutions)
    line_of, a = np.array(which), np.array(levels)
    T0, n0, N0 = float(np.mean(torque)), float(np.mean(speed)), float(np.mean(turns))
    factors = {
        "constant": np.ones(a.size),
        "torque": np.array(torque) / T0,
        "speed": (np.array(speed) / n0) ** 2,
    }
    found = {name: _levels(a, line_of, factor, len(lines)) for name, factor in factors.items()}
    growth = _growth(a, line_of, np.array(turns) - N0, len(lines))
    found["growth"] = _levels(a, line_of, 1 + growth * (np.array(turns) - N0), len(lines))
    free = {name: float(name == "growth") for name in found}
    support = {
        name: -0.5 * a.size * log(scatter**2 + limits.level_scatter**2) - 0.5 * free[name] * log(a.size)
        for name, (_, scatter) in found.items()
    }
    if a.size - len(lines) < 2:  # too few windows for a law: a constant says it all
        support = {name: float(name == "constant") for name in support}
    best = max(support, key=lambda name: support[name])
    if support[best] - support["constant"] < limits.told:
        best = "constant"
    sizes, scatter = found[best]
    counts = np.array([(line_of == n).sum() for n in range(len(lines))])
    noise = np.array([np.mean(np.array(stds)[line_of == n]) for n in range(len(lines))])
    return Law(
        name=best,
        alike=tuple(name for name in LAWS if name != best and support[best] - support[name] < limits.told),
        levels=tuple(float(s) for s in sizes),
        stds=tuple(float(s) for s in np.hypot(sizes * max(scatter, limits.level_scatter), noise) / np.sqrt(counts)),
        growth=float(growth) if best == "growth" else 0.0,
        scatter=float(scatter),
        torque=T0,
        speed=n0,
        revolutions=N0,
    )


def _levels(a: np.ndarray, line_of: np.ndarray, factor: np.ndarray, count: int) -> tuple[np.ndarray, float]:
    """Level of each line under a law (count,), and the relative scatter of the windows about it."""
    sums = [np.bincount(line_of, weights=values, minlength=count) for values in (a * factor, factor**2, a)]
    sizes = sums[0] / np.maximum(sums[1], 1e-12)
    mean = np.maximum(sums[2] / np.bincount(line_of, minlength=count), 1e-300)
    relative = (a - sizes[line_of] * factor) / mean[line_of]
    return sizes, float(np.sqrt((relative**2).sum() / max(a.size - count, 1)))


def _growth(a: np.ndarray, line_of: np.ndarray, turns: np.ndarray, count: int) -> float:
    """Relative growth per revolution that all lines share, 0 where the revolutions do not vary."""
    relative = a / np.array([a[line_of == n].mean() for n in range(count)])[line_of]
    within = turns - np.array([turns[line_of == n].mean() for n in range(count)])[line_of]
    size = float(within @ within)
    return 0.0 if size == 0 else float(within @ (relative - 1) / size)
