"""Windows of a machine without a model compared with its healthy baseline, as an assessment.

One function decides for a single window of a stream and for all windows of a recording: `compare_with_baseline`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from twin.assessment import (
    BaselineAssessment,
    BaselineWindow,
    EffectAssessment,
    Evidence,
    HeldOutErrors,
    LineSideband,
    PossibleCause,
    Range,
    RawLimit,
    Residual,
    SidebandLimit,
    SpectralLine,
    SpectrumExcerpt,
    UnattributedLines,
    UnattributedSearch,
    Unexplained,
)
from twin.baseline.causes import causes_of, one_bearing
from twin.baseline.diagnosis import Diagnosis, WindowParts, diagnose
from twin.baseline.findings import BaselineComparison
from twin.baseline.known_spacings import REACH, is_new, showing
from twin.baseline.learned import Baseline
from twin.baseline.named import Named
from twin.baseline.raw_limit import limit_on
from twin.baseline.reading import TURNS_PER_PERIOD, SpacingSeen, WindowReading, angle_of, raw_of, read
from twin.baseline.shaft_names import belonging, shaft_name
from twin.baseline.spacing import Spacing, SpacingsFound, unattributed_spacings
from twin.baseline.sufficiency import left_out_of, sufficiency_of
from twin.baseline.verdict import with_raw_limit
from twin.errors import NotAvailable
from twin.features.angle import AngleTrack
from twin.learned_limits import OperatingPoint
from twin.rig import Rig
from twin.windows import Window

DAY_NS = 86_400 * 10**9
NO_DEPTH = "the rig file gives no model of the machine: a healthy baseline shows changes, not the depth of wear"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackedWindow:
    """One usable window with its pinion angle."""

    name: str
    window: Window
    track: AngleTrack
    sought: SpacingsFound  # lines that no known shaft makes

    @property
    def spacings(self) -> tuple[Spacing, ...]:
        """Of lines that no known shaft makes, the clearest first."""
        return self.sought.spacings


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BaselineResult:
    """Windows compared with a baseline."""

    residual: Residual
    effects: tuple[EffectAssessment, ...]
    unexplained: Unexplained
    windows: tuple[BaselineWindow, ...]
    unattributed_lines: tuple[UnattributedLines, ...]
    unattributed_search: UnattributedSearch | None  # of the latest window; None where its angle is not known
    raw_limit: RawLimit


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LinesWithoutShaft:
    """Lines of one window that neither gear makes; `unexplained` is None where further shafts make them."""

    lines: tuple[UnattributedLines, ...]
    sought: UnattributedSearch
    unexplained: Unexplained | None


def pair_shafts(rig: Rig) -> tuple[Fraction, Fraction]:
    """Orders of pinion and gear, of the pinion's rotation."""
    z1, z2 = rig.teeth
    return Fraction(1), Fraction(int(z1), int(z2))


def tracked(rig: Rig, window: Window, name: str, shafts: Sequence[Fraction]) -> TrackedWindow:
    """A window with its pinion angle and the spacing of lines that none of these shafts makes.

    Raises TwinError where the angle cannot be determined.
    """
    track = angle_of(rig, window)
    sought = unattributed_spacings(window.accelerations, track, rig.teeth, shafts)
    return TrackedWindow(name=name, window=window, track=track, sought=sought)


def compare_with_baseline(baseline: Baseline, rig: Rig, windows: Sequence[TrackedWindow]) -> BaselineResult:
    """Changes of one window, or of all windows of a recording, against a healthy baseline.

    Raises TwinError where they cannot be compared.
    """
    demand_same_teeth(baseline, rig)
    found = diagnose(baseline, [_parts(baseline, w) for w in windows])
    names = [shaft_name(s, baseline) for s in baseline.shafts]
    return BaselineResult(
        residual=Residual(
            rms_error=found.error("rms_after"),
            waveform_error=found.error("waveform_after"),
            windows=len(windows),
            bands=found.bands,
            lines=found.lines,
            channels=found.errors,
        ),
        effects=tuple(_effect(e, found) for e in found.effects),
        unexplained=Unexplained(verdict=found.verdict, share=found.share, lines=found.lines, reason=found.reason),
        windows=tuple(_window(i, c) for i, c in enumerate(found.compared)),
        unattributed_lines=unattributed_lines(windows, baseline.shafts, names, baseline),
        unattributed_search=_search_of(windows[-1]),
        raw_limit=found.raw,
    )


def compare_levels(baseline: Baseline, rig: Rig, windows: Sequence[Window], why: str) -> BaselineResult:
    """Windows without a known angle against a healthy baseline: by their raw levels alone.

    why  their lines cannot be compared
    """
    demand_same_teeth(baseline, rig)
    raw = [{name: raw_of(s.values) for name, s in w.accelerations.items()} for w in windows]
    verdict, reason, limit = with_raw_limit("insufficient_data", why, limit_on(baseline, raw), ())
    return BaselineResult(
        residual=Residual(reason=why),
        effects=(),
        unexplained=Unexplained(verdict=verdict, reason=reason),
        windows=(),
        unattributed_lines=(),
        unattributed_search=None,
        raw_limit=limit,
    )


def demand_same_teeth(baseline: Baseline, rig: Rig) -> None:
    """NotAvailable where a machine has other tooth counts than the baseline."""
    if rig.teeth != baseline.rig.teeth:
        raise NotAvailable(
            f"the rig file gives {rig.teeth} teeth, but the baseline was learned with {baseline.rig.teeth}: "
            "which are right?"
        )


def lines_without_shaft(rig: Rig, window: Window, name: str) -> LinesWithoutShaft:
    """Lines of one window that neither gear makes.

    Raises TwinError where the pinion's angle cannot be determined.
    """
    shafts = pair_shafts(rig)
    z1 = rig.teeth[0]
    seen = tracked(rig, window, name, shafts)
    lines = unattributed_lines([seen], shafts, ("pinion", "gear"))
    speed = seen.track.speed
    free = [spacing for spacing in seen.spacings if spacing.ratio is None]
    if not free:
        return LinesWithoutShaft(lines=lines, sought=_search_of(seen), unexplained=None)
    orders: dict[float, SpectralLine] = {}
    for spacing in free:
        for side in spacing.sidebands:
            for sign in (-1, 1) if side.harmonic else (1,):
                order = side.harmonic * z1 + sign * side.multiple * spacing.order
                orders.setdefault(round(order, 6), SpectralLine(order=order, frequency=order * speed, share=None))
    places = ", ".join(f"{s.order * speed:.3f} Hz" for s in free)
    whose = belonging(free[0].order / free[0].part, rig.teeth, REACH / seen.track.turns)
    unexplained = Unexplained(
        verdict="unknown_effect",
        lines=tuple(orders.values()),
        reason=f"lines spaced by {places} {whose}",
    )
    return LinesWithoutShaft(lines=lines, sought=_search_of(seen), unexplained=unexplained)


def read_lines(rig: Rig, w: TrackedWindow, shafts: Sequence[Fraction]) -> WindowReading:
    """The lines of a window at the orders of its shafts, with the spacings of those that no shaft makes."""
    seen = [SpacingSeen(order=s.order / s.part, clearness=-s.log_chance) for s in w.spacings if s.ratio not in shafts]
    return replace(read(rig, w.window, shafts, w.name, w.track), spacings=tuple(seen))


def described(
    baseline: Baseline, window: BaselineWindow | None = None, raw: RawLimit | None = None
) -> BaselineAssessment:
    """What a baseline was learned from, and the window that was compared with it."""
    return BaselineAssessment(
        recordings=tuple(r.name for r in baseline.readings),
        operating_points={axis: Range(low=low, high=high) for axis, (low, high) in baseline.range.items()},
        shafts=tuple(float(s) for s in baseline.shafts),
        channels=tuple(sorted(baseline.std)),
        window=window,
        left_out=left_out_of(baseline),
        raw_limit=raw,
        not_learned=(*baseline.copies, *(one.text for one in baseline.not_learned)),
        sufficiency=sufficiency_of(baseline),
        days=len({r.start_time_ns // DAY_NS for r in baseline.readings}),
        loads=loads_of(baseline.readings),
    )


def loads_of(readings: Sequence[WindowReading]) -> int:
    """At how many operating conditions windows were recorded."""
    found: list[OperatingPoint] = []
    for reading in readings:
        point = OperatingPoint(speed=reading.speed_hz, torque=reading.torque_nm)
        if not any(point.matches(known) for known in found):
            found.append(point)
    return len(found)


def unattributed_lines(
    windows: Sequence[TrackedWindow],
    shafts: Sequence[Fraction],
    names: Sequence[str],
    baseline: Baseline | None = None,
) -> tuple[UnattributedLines, ...]:
    """Spacings of lines that none of these shafts makes, with the causes that were tried, and whether they are new."""
    return tuple(
        _beside(_unattributed(w, spacing, shafts, names), w, baseline)
        for w in windows
        for spacing in w.spacings
        if spacing.ratio not in shafts
    )


def _beside(lines: UnattributedLines, w: TrackedWindow, baseline: Baseline | None) -> UnattributedLines:
    """Lines of no shaft with the healthy recordings that show them, too."""
    if baseline is None:
        return lines
    here = read(baseline.rig, w.window, baseline.shafts, w.name, w.track)
    seen = SpacingSeen(order=lines.order / lines.part, clearness=lines.clearness)
    return replace(lines, healthy=showing(seen, here, baseline.readings), new=is_new(seen, here, baseline))


def _search_of(window: TrackedWindow) -> UnattributedSearch:
    sought, speed = window.sought, window.track.speed
    return UnattributedSearch(
        window=window.name,
        smallest=sought.smallest * speed,
        largest=sought.largest * speed,
        found=len(sought.spacings),
        limits=tuple(
            SidebandLimit(channel=x.channel, harmonic=x.harmonic, amplitude=x.amplitude) for x in sought.limits
        ),
    )


def _unattributed(
    window: TrackedWindow, s: Spacing, shafts: Sequence[Fraction], names: Sequence[str]
) -> UnattributedLines:
    track = window.track
    others = [(x.order / x.part, x.std / x.part) for x in window.spacings if x is not s]
    at, std = s.order / s.part, s.std / s.part
    causes = [*causes_of(at, std, track.speed, shafts, names), *one_bearing(at, std, others)]
    return UnattributedLines(
        window=window.name,
        order=s.order,
        order_std=s.std,
        frequency=s.order * track.speed,
        frequency_std=float(np.hypot(s.std * track.speed, s.order * track.speed_std)),
        part=s.part,
        geared=None if s.ratio is None else str(s.ratio),
        clearness=-s.log_chance,
        next_clearness=-s.next_log_chance,
        sidebands=tuple(
            LineSideband(
                channel=b.channel, harmonic=b.harmonic, multiple=b.multiple, amplitude=b.amplitude, depth=b.depth
            )
            for b in s.sidebands
        ),
        spectrum=tuple(
            SpectrumExcerpt(
                channel=e.channel,
                harmonic=e.harmonic,
                start=e.start * track.speed,
                step=e.step * track.speed,
                amplitude=tuple(float(f"{a:.4g}") for a in e.amplitude),
            )
            for e in s.excerpts
        ),
        causes=tuple(PossibleCause(name=c.name, possible=c.possible, detail=c.detail) for c in causes),
        channels=s.channels,
    )


def _parts(baseline: Baseline, w: TrackedWindow) -> WindowParts:
    """A window's lines, of all its turns and of either half."""
    rig, shafts = baseline.rig, baseline.shafts
    whole = read_lines(rig, w, shafts)
    if whole.turns < 2 * TURNS_PER_PERIOD * whole.period:
        return WindowParts(whole=whole)
    halves = [read(rig, w.window, shafts, w.name, w.track, part) for part in ((0.0, 0.5), (0.5, 1.0))]
    return WindowParts(whole=whole, first=halves[0], second=halves[1])


def _window(index: int, compared: BaselineComparison) -> BaselineWindow:
    reading, expected = compared.reading, compared.expected
    return BaselineWindow(
        index=index,
        name=reading.name,
        start_time_ns=reading.start_time_ns,
        speed=reading.speed_hz,
        speed_std=reading.speed_std_hz,
        speed_source=reading.angle_from,
        torque=reading.torque_nm,
        between=expected.between,
        interpolated=expected.interpolated,
        pattern_correlation=None if expected.alignment is None else expected.alignment.correlation,
        same_teeth=compared.same_teeth,
        pattern_compared=compared.repeats.pattern_compared,
    )


def _effect(effect: Named, found: Diagnosis) -> EffectAssessment:
    def errors(when: str) -> HeldOutErrors:
        return HeldOutErrors(
            rms=found.error(f"rms_{when}", effect.channels), waveform=found.error(f"waveform_{when}", effect.channels)
        )

    return EffectAssessment(
        name=effect.name,
        parameters=effect.parameters,
        evidence=Evidence(
            log_evidence=effect.log_evidence,
            runner_up=effect.runner_up,
            over_runner_up=effect.over_runner_up,
            indistinguishable_from=effect.indistinguishable_from,
            detail=effect.detail,
        ),
        status=None,
        error_before=errors("before"),
        error_after=errors("after"),
        channels=effect.channels,
        windows=effect.windows,
        curves={name: tuple(values) for name, values in effect.curves.items()},
    )
