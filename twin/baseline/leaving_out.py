"""Each healthy recording left out in turn: what it shows against a baseline of the others.

One pass serves every kind of comparison: each gives how far the recording left out is over the limit from which a
change would be believed, and what the recordings show there raises that limit for everybody (repeats.py). A second
recording left out gives these limits without the first one, which is then judged by them as a new one would be: how
often it is called changed is the number of false alarms that is stated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
from scipy.special import stdtrit

from twin.baseline.alignment import align
from twin.baseline.findings import DEFAULT as FINDINGS
from twin.baseline.findings import BaselineComparison, compare
from twin.baseline.known_spacings import clearest_over
from twin.baseline.learned import Baseline, interpolated_lines, laid_over, scatter_of
from twin.baseline.left_over import left_over
from twin.baseline.modulation import deepest_over
from twin.baseline.off_line_changes import added_noise, off_line_changes
from twin.baseline.raw_limit import raw_over
from twin.baseline.reading import WindowReading
from twin.baseline.recordings import others_of, recording_of
from twin.baseline.repeats import (
    BY_PATTERN,
    DEFAULT,
    EXCHANGED,
    IMPACTS,
    LINES,
    MISFIT,
    MODULATION,
    NOISE,
    NOTHING_LEFT_OUT,
    OFF_LINES,
    PATHS,
    RAW,
    SPACINGS,
    Key,
    Repeats,
    RepeatThresholds,
    factors_of,
    share_of,
)
from twin.baseline.turn_impacts import DEFAULT as IMPACT_LIMITS
from twin.baseline.turn_impacts import turn_impacts
from twin.baseline.verdict import DEFAULT as VERDICT
from twin.errors import NotAvailable
from twin.rig import Rig

Fold = frozenset[int]  # windows that are left out together
Scores = Mapping[Key, float]


def learn(rig: Rig, readings: Sequence[WindowReading], shafts: Sequence[Fraction]) -> Baseline:
    """A baseline from windows of the healthy machine, two at least, with what they repeat of one another.

    Raises NotAvailable where the windows do not share a channel.
    """
    baseline = laid_over(rig, readings, shafts)
    return replace(baseline, repeats=repeats_of(baseline))


def repeats_of(baseline: Baseline, limits: RepeatThresholds = DEFAULT) -> Repeats:
    """What the windows of a baseline repeat of one another."""
    pattern = _pattern(baseline)
    least = min(pattern, key=lambda i: pattern[i], default=None)
    found = Repeats(
        pattern=tuple(pattern.values()),
        unlike="" if least is None else baseline.readings[least].name,
        pattern_compared=is_repeated(pattern),
    )
    folds = _folds(baseline.readings, limits)
    if len(folds) < DEFAULT.least_recordings:
        return found
    without = {fold: _without(baseline, fold) for fold in folds}
    scores = {
        fold: _scores_of(others, baseline, fold) | _exchanged(others, baseline, fold)
        for fold, others in without.items()
    }
    alarms, raw = _false_alarms(baseline, without, scores, limits)
    return replace(
        found,
        factors={key: f for key, f in factors_of(list(scores.values()), limits).items() if f != 1.0},
        left_out=len(folds),
        false_alarms=alarms,
        raw_false_alarms=raw,
    )


def _folds(readings: Sequence[WindowReading], limits: RepeatThresholds) -> list[Fold]:
    """The parts that are left out: recordings; of a single one, its windows."""
    of = recording_of(readings)
    if len(set(of)) < DEFAULT.least_recordings:
        of = list(range(len(readings)))
    parts = sorted(set(of))
    count = min(len(parts), limits.most_folds)
    return [frozenset(i for i, part in enumerate(of) if parts.index(part) % count == fold) for fold in range(count)]


def _without(baseline: Baseline, gone: Fold) -> Baseline:
    """The baseline of the other windows."""
    readings = tuple(r for i, r in enumerate(baseline.readings) if i not in gone)
    std, path = scatter_of(readings, baseline.axes)
    return replace(baseline, readings=readings, std=std, path_scatter=path, repeats=NOTHING_LEFT_OUT)


def _false_alarms(
    baseline: Baseline,
    without: Mapping[Fold, Baseline],
    scores: Mapping[Fold, Scores],
    limits: RepeatThresholds,
) -> tuple[int, int]:
    """How many parts left out are called changed by limits of the others alone; and by the raw limit alone."""
    alarms = raw = 0
    for fold, others in without.items():
        over = {key: r for key, r in scores[fold].items() if r > 1}
        if over:  # limits of the others are raised only by what they show themselves
            known = _factors_without(baseline, fold, list(without), limits)
            over = {key: r for key, r in over.items() if r > known.get(key, 1.0)}
            if not is_repeated(_pattern(others)):
                over = {(kind, channel): r for (kind, channel), r in over.items() if kind not in BY_PATTERN}
        alarms += bool(over) or _is_unlike(baseline, others, fold)
        raw += (RAW, "") in over
    return alarms, raw


def _factors_without(
    baseline: Baseline, fold: Fold, folds: Sequence[Fold], limits: RepeatThresholds
) -> dict[Key, float]:
    """Factors that the others give, a second part of them left out in turn; none where too few are left."""
    others = [other for other in folds if other != fold]
    if len(others) < DEFAULT.least_recordings:
        return {}
    return factors_of([_scores_of(_without(baseline, fold | other), baseline, other) for other in others], limits)


def _is_unlike(baseline: Baseline, others: Baseline, fold: Fold) -> bool:
    """Whether most windows left out have another tooth pattern than others that repeat theirs."""
    if all(r.absolute for r in baseline.readings):
        return False
    alike = [c for i in fold if (c := _correlation(others, baseline.readings[i])) is not None]
    return bool(alike) and float(np.median(alike)) <= FINDINGS.same_teeth and is_repeated(_pattern(others))


def _pattern(baseline: Baseline) -> dict[int, float]:
    """Correlation of every window with the tooth pattern of the other recordings; none where the angle has a zero."""
    if all(r.absolute for r in baseline.readings):
        return {}
    out = {}
    for i, others in enumerate(others_of(baseline.readings)):
        known = replace(baseline, readings=tuple(baseline.readings[j] for j in others))
        found = _correlation(known, baseline.readings[i])
        if found is not None:
            out[i] = found
    return out


def _correlation(others: Baseline, reading: WindowReading) -> float | None:
    lines = interpolated_lines(others.readings, reading, others.axes)
    found = align(
        {name: c.lines for name, c in reading.channels.items()}, lines, reading.period, int(others.rig.teeth[0])
    )
    return None if found is None else found.correlation


def is_repeated(pattern: Mapping[int, float], limits: RepeatThresholds = DEFAULT) -> bool:
    """Whether a new recording will show the pattern of the others, but for its share of false alarms."""
    found = np.array(list(pattern.values()))
    if found.size < limits.least_recordings:
        return bool(np.all(found > FINDINGS.same_teeth))
    t = -stdtrit(found.size - 1, share_of(1, limits))
    return bool(found.mean() - t * found.std(ddof=1) * np.sqrt(1 + 1 / found.size) > FINDINGS.same_teeth)


def _scores_of(others: Baseline, baseline: Baseline, fold: Fold) -> dict[Key, float]:
    """What a part left out shows over every limit: the median over its windows, of which most must show a change."""
    windows = [baseline.readings[i] for i in sorted(fold)]
    each = [_scores(others, window) for window in windows]
    keys = {key for one in each for key in one}
    found = {key: float(np.median([one.get(key, 0.0) for one in each])) for key in keys}
    raw = raw_over(others, windows)
    return found if raw is None else {**found, (RAW, ""): raw}


def _exchanged(others: Baseline, baseline: Baseline, fold: Fold) -> dict[Key, float]:
    """How far windows left out seem to have two channels exchanged."""
    gains = [others.swapped(baseline.readings[i]) for i in sorted(fold)]
    return {(EXCHANGED, ""): float(np.median([0.0 if found is None else found.over for found in gains]))}


def _scores(others: Baseline, reading: WindowReading) -> dict[Key, float]:
    """What one window shows over every limit."""
    try:
        compared = compare(others, reading)
    except NotAvailable:
        return {}
    out: dict[Key, float] = {(SPACINGS, ""): clearest_over(reading, others.readings)}
    for name in reading.channels:
        out[MODULATION, name] = deepest_over(reading, others, name)
    common = max((p.common_power for p in compared.paths), key=abs, default=0.0)
    changes = off_line_changes(others, reading, compared.expected.wider, common)
    for name in dict.fromkeys(change.channel for change in changes):
        own = [change for change in changes if change.channel == name]
        noise = added_noise(own, len(others.std))
        out[OFF_LINES, name] = own[0].over  # the largest deviation comes first
        out[NOISE, name] = 0.0 if noise is None else noise.over
    return {**out, **_by_pattern(others, compared)} if compared.same_teeth else out


def _by_pattern(others: Baseline, compared: BaselineComparison) -> dict[Key, float]:
    """What a window shows over every limit of what lies on the angle."""
    out: dict[Key, float] = {}
    for change in compared.candidates:
        key = LINES, change.channel
        out[key] = max(out.get(key, 0.0), change.log_evidence / compared.least_evidence(change))
    for path in compared.paths:
        out[PATHS, path.channel] = path.over
    _, misfit, _ = left_over([compared])
    out[MISFIT, ""] = misfit / (VERDICT.misfit * compared.extrapolated**2)
    impacts = turn_impacts(others, compared.reading, compared.expected)
    if impacts:
        out[IMPACTS, ""] = max(impacts[0].deviation / IMPACT_LIMITS.changed, 0.0)
    return out
