"""What the twin in use leaves at the shafts' own orders, in every channel: content that no effect explains.

    left = Σ|y − m|²/Σ|y|²                over the lines of a channel in held-out windows
    share of a line = |y − m|²/Σ|y|²      of the acceleration's lines that the twin has no prediction for: ½A²/RMS²

y  measured line, m predicted by the twin with all its effects, complex

A line counts where it is clear of what healthy machines of the rig file have (healthy_lines.py). The lines together
must hold more of a channel than a healthy machine leaves at most. They are content like
any other then, with channel, order, size and growth; what the encoders alone show may be a disc's own. Where they do
not and the twin is not confirmed, a path to the accelerometer that is not the rig file's is what is unknown.

Source   errors of graduation and mounting of discs: the rig file's tolerances; the rest is a description, not a cause
Holds    machines whose teeth do not differ and are not cracked by what was found: these have lines at all orders
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.assessment import SpectralLine
from twin.features.shaft_orders import GEAR, PINION, owner_of
from twin.features.window_features import MeasuredLines
from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.earned import in_use
from twin.tracing.healthy_lines import largest_healthy
from twin.tracing.held_out_error import ENCODERS, ChannelComparison, HeldOutComparison
from twin.tracing.state import Tracing
from twin.tracing.unexplained import excess
from twin.tracing.unknown_words import CHANNEL_NAMES, OTHER_PATH, of_growth
from twin.updating.history import WindowInput

MOST_SAID = 3  # lines of a channel in a sentence
UNITS = {"acceleration": (1.0, "m/s²"), "encoder": (1e6, "µm"), "torque": (1.0, "N·m")}


@dataclass(frozen=True, slots=True, kw_only=True)
class ContentLeftThresholds:
    """When lines of the shafts' own orders are content that nothing explains."""

    swing: float = deciding(
        0.02, of="mean torque", meaning="amplitude of a torque line that counts", source="as for a force on a shaft"
    )
    clear: float = deciding(
        6.0,
        of="standard deviation of a healthy machine's line",
        meaning="what is left of a line that counts",
        source="derivation: three standard deviations of machines twice as far from their rig files",
    )
    same_size: float = deciding(
        2.0, meaning="scatter of a level over that of its noise, above which its growth is stated", source="convention"
    )
    same_order: float = deciding(
        1e-4, unit="order", meaning="distance within which two orders are one", source="rounding of products of teeth"
    )
    windows_share: float = deciding(
        0.6, of="windows", meaning="share of them that must show a line", source="as for lines of no shaft"
    )


THRESHOLDS = ContentLeftThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftLine:
    """One line that nothing explains."""

    channel: str  # "acceleration", "encoder" or "torque"
    order: float  # of the pinion
    size: float  # amplitude left, rms over the windows, in the channel's unit
    share: float  # of the channel's energy


def with_content_left(rig: Rig, tracing: Tracing, limits: ContentLeftThresholds = THRESHOLDS) -> Tracing:
    """The memory with what the twin in use leaves at the shafts' orders, in words and among the unattributed lines."""
    if tracing.few_windows or not tracing.stages or any(_fills(f) for f in tracing.found):
        return tracing
    lines = lines_left(in_use(rig, tracing), tracing.history, limits)
    if not lines:
        return _other_path(tracing)
    said = "; ".join(part for part in (tracing.unknown, sentence(rig, lines, tracing.history, limits)) if part)
    speed = next(t.features.speed_hz for t in reversed(tracing.history) if t.features.speed_hz) or 1.0
    heard = tuple(
        SpectralLine(
            order=line.order,
            frequency=line.order * speed,
            share=line.share if line.channel == "acceleration" else None,
            kind=f"{_owner(rig, line.order)}, in the {CHANNEL_NAMES[line.channel]}",
        )
        for line in lines
    )
    return replace(tracing, unknown=said, unattributed=(*tracing.unattributed, *heard))


def _other_path(tracing: Tracing) -> Tracing:
    """The memory with another path to the accelerometer as what is unknown, where the twin is not confirmed by it."""
    unconfirmed = (excess(tracing.error, "waveform") or 0.0) > 1.0
    if not (tracing.latest.other_structure and unconfirmed) or tracing.unknown:
        return tracing
    return replace(tracing, unknown=OTHER_PATH)


def _fills(found: AttributedEffect) -> bool:
    """Whether an effect that was found has lines at all orders of a shaft by itself."""
    facts = found.addition.effect.facts
    return facts.acts_on == "teeth" or facts.separates_teeth


def lines_left(
    compared: Sequence[HeldOutComparison],
    history: Sequence[WindowInput],
    limits: ContentLeftThresholds = THRESHOLDS,
) -> tuple[LeftLine, ...]:
    """Lines that nothing explains, of every channel whose lines together count, the strongest of each first.

    compared  held-out windows with the twin in use
    """
    out: list[LeftLine] = []
    loads = [abs(t.features.torque_nm) for t in history if t.features.torque_nm is not None]
    swing = limits.swing * float(np.mean(loads)) if loads else 0.0
    for channel, names in (("acceleration", ("acceleration",)), ("encoder", ENCODERS), ("torque", ("torque",))):
        seen = [w.channels[name] for w in compared for name in names if name in w.channels]
        energy = sum(lines.energy for lines in seen)
        if len(seen) < 2 or energy <= 0:
            continue
        lines = _of_channel(channel, seen, energy, swing, limits)
        if channel == "acceleration":
            lines = [*lines, *_unread(history, limits)]
        lines = sorted(lines, key=lambda line: -line.share)
        if sum(line.share for line in lines) > largest_healthy([one.variance for one in seen]) / energy:
            out += lines[:MOST_SAID]
    return tuple(out)


def _of_channel(
    channel: str, seen: Sequence[ChannelComparison], energy: float, swing: float, limits: ContentLeftThresholds
) -> list[LeftLine]:
    """Lines of one channel that are clear of what healthy machines have.

    swing  amplitude of a torque line that counts [N·m]
    """
    left: dict[float, list[tuple[float, float]]] = {}
    for s in seen:
        rests = np.abs(s.measured - s.predicted) ** 2
        for o, rest, v in zip(s.orders.tolist(), rests.tolist(), s.variance.tolist(), strict=True):
            left.setdefault(round(o, 6), []).append((rest, v))
    out = []
    for o, found in left.items():
        rest, healthy = np.mean(found, axis=0)
        size = float(np.sqrt(rest))
        counts = channel != "torque" or size > swing
        if counts and rest > limits.clear**2 * healthy and len(found) >= limits.windows_share * len(seen):
            out.append(LeftLine(channel=channel, order=o, size=size, share=sum(r for r, _ in found) / energy))
    return out


def _unread(history: Sequence[WindowInput], limits: ContentLeftThresholds) -> list[LeftLine]:
    """Lines of the acceleration at turns of the shafts, away from the mesh's, that the twin predicts nothing of."""
    windows = [t for t in history if t.non_gear is not None and t.features.rms]
    found: dict[float, list[tuple[float, float]]] = {}
    for t in windows:
        for o, a in t.non_gear.shafts if t.non_gear is not None else ():
            found.setdefault(round(o, 6), []).append((a, 0.5 * a**2 / (t.features.rms or np.inf) ** 2))
    return [
        LeftLine(
            channel="acceleration",
            order=o,
            size=float(np.sqrt(np.mean([a**2 for a, _ in lines]))),
            share=float(np.mean([share for _, share in lines])),
        )
        for o, lines in found.items()
        if len(lines) >= max(2, limits.windows_share * len(windows))
    ]


def _owner(rig: Rig, order: float) -> str:
    """What a line of the shafts' own orders is, in words."""
    z1, z2 = rig.teeth
    if abs(order - z1 * round(order / z1)) < THRESHOLDS.same_order and round(order / z1):
        return f"mesh order {round(order / z1)}"
    name = owner_of(order, rig.teeth, THRESHOLDS.same_order)
    if name == PINION:
        return f"{_times(round(order))} of the pinion"
    if name == GEAR:
        return f"{_times(round(order * z2 / z1))} of the gear"
    return "sideband of the mesh"


def _times(count: int) -> str:
    return "once a turn" if count == 1 else f"{count} times a turn"


def sentence(
    rig: Rig, lines: Sequence[LeftLine], history: Sequence[WindowInput], limits: ContentLeftThresholds = THRESHOLDS
) -> str:
    """Lines that no effect explains, by channel, in words."""
    parts = []
    speeds = [t.features.speed_hz for t in history if t.features.speed_hz]
    for channel in dict.fromkeys(line.channel for line in lines):
        own = [line for line in lines if line.channel == channel]
        factor, unit = UNITS[channel]
        sizes = [f"order {o.order:.3f} ({_owner(rig, o.order)}) with {factor * o.size:.3g} {unit}" for o in own]
        share = 100 * min(sum(line.share for line in own), 1.0)
        parts.append(
            f"lines of the shafts' own orders that no effect explains make {share:.0f} % of the "
            f"{CHANNEL_NAMES[channel]}: {', '.join(sizes)}{_band(own, speeds)}; "
            f"{_growth(channel, own[0].order, history, limits)}"
            f"{_cause(rig, own, lines)}"
        )
    return "; ".join(parts)


def _band(lines: Sequence[LeftLine], speeds: Sequence[float]) -> str:
    """The frequencies of lines over all windows."""
    if not speeds:
        return ""
    low, high = (f(line.order for line in lines) * f(speeds) for f in (min, max))
    return f", from {low:.4g} Hz to {high:.4g} Hz over the windows"


def _cause(rig: Rig, lines: Sequence[LeftLine], every: Sequence[LeftLine]) -> str:
    """What may make lines of a channel, where no other channel has any.

    every  lines of all channels
    """
    of_mesh = [o for o in lines if _owner(rig, o.order).startswith("mesh")]
    channel = lines[0].channel
    if channel == "encoder" and not of_mesh and all(line.channel == "encoder" for line in every):
        shafts = sorted({_owner(rig, o.order).rsplit(" ", 1)[-1] for o in lines})
        return (
            "; no other channel shows them: the encoder's own disc, off its centre or out of round, on the shaft of "
            f"the {' or the '.join(shafts)} makes such lines; a gear would make sidebands of the mesh, too"
        )
    if channel == "acceleration" and of_mesh:
        return "; the accelerometer, its mount or direction, its channel, or the path to it is not that of the rig file"
    return ""


def _growth(channel: str, order: float, history: Sequence[WindowInput], limits: ContentLeftThresholds) -> str:
    """How a line's measured amplitude goes over the windows."""
    at = [(t.features.revolutions or 0.0, y) for t in history if (y := _measured(channel, order, t)) is not None]
    if len(at) < 3:
        return "too few windows show how it grows"
    turns, sizes = np.array(at).T
    if np.ptp(turns) <= 0:
        return "too few windows show how it grows"
    (slope, _), cov = np.polyfit(turns, sizes, 1, cov="unscaled")
    left = sizes - np.polyval(np.polyfit(turns, sizes, 1), turns)
    std = float(np.sqrt(cov[0, 0] * np.sum(left**2) / max(len(at) - 2, 1)))
    mean = float(sizes.mean())
    if abs(slope) < limits.same_size * std or abs(slope) * np.ptp(turns) < 0.1 * mean:
        return f"its size stays the same to within {100 * max(float(sizes.std()) / mean, 0.01):.0f} %"
    return of_growth("size", slope / mean)


def _measured(channel: str, order: float, window: WindowInput) -> float | None:
    """Amplitude of a channel's line at an order in one window; None where it was not read."""
    features = window.features
    by_name: Mapping[str, MeasuredLines | None] = {
        "acceleration": features.acceleration,
        "encoder": features.transmission_error or features.pinion_motion,
        "torque": features.torque,
    }
    lines = by_name[channel]
    if lines is None:
        return None
    near = [
        abs(y) for o, y in zip(lines.orders, lines.amplitudes, strict=True) if abs(o - order) < THRESHOLDS.same_order
    ]
    if not near and channel == "acceleration" and window.non_gear is not None:
        near = [a for o, a in window.non_gear.shafts if abs(o - order) < THRESHOLDS.same_order]
    return float(near[0]) if near else None
