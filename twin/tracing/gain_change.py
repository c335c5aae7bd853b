"""An accelerometer that changes while it is watched: its gain, at one time or evenly, or its mount, which resonates.

    ln|q_kw| = a_k + c_w + h(n_w)·ln g + noise      step: h = 0, then 1;  drift: h = (n − n_0)/(n_last − n_0) after n_0
    ln q_k after a time less that before ~ N(ln g(f_k), V)          g of the mount (twin/effects/sensor_resonance.py)

q_kw  quotient of line k in window w (transfer_path.py)
a_k   what the structure makes of the line, another for each line and frequency: free
c_w   what all lines of a window share by chance: a drift is told from several windows, not from several lines
g     gain at the latest window over the gain before the onset

The structure is the same in all windows and drops out, so this needs no tolerance of the rig file. A common shape h is
a linear regression; its evidence is that of a Gaussian prior on ln g. A step is judged by its lines against one
another, with the noise widened to what they scatter. A resonance's skirts reach over the whole band, so that all lines
must agree on it in size and phase; its rivals are lines that stay, that change by one factor, each by its own, or one
alone, as wear can make it. What the model's transmission error lacks is nearly the same before and after, so that its
lines speak too.

Source   D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 28 (evidence of a linear
         model, Occam factor); which law: twin/tracing/size_laws.py
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import logsumexp

from twin.closed_forms import log_density
from twin.effects.size_law import CONSTANT, SizeLaw
from twin.thresholds import deciding
from twin.tracing.mount_resonance import Mount, Mounts, within_half_turns
from twin.tracing.size_laws import UNIFORM, law_fits
from twin.tracing.transfer_path import THRESHOLDS as PATH
from twin.tracing.transfer_path import Quotient, TransferPathThresholds

WIDE = 10.0  # standard deviation of a line's own level, of which nothing is known


@dataclass(frozen=True, slots=True, kw_only=True)
class GainDriftThresholds:
    """When the gain is taken to drift."""

    line_scatter: float = deciding(
        0.01,
        meaning="of a quotient's logarithm from window to window, beyond noise and what all lines share",
        source="not derived: read off the lines of one campaign, N109 of wide draw 1, which leave 0.005 to 0.01",
    )
    window_scatter: float = deciding(
        0.02,
        meaning="standard deviation of what all quotients of a window share, in logarithm",
        source="measured: 0.002 to 0.03 on thirteen campaigns with a right sensor of wide draws 1 and 2, nine "
        "of them of three windows only",
    )
    least_evidence: float = deciding(
        float(np.log(1000)),
        unit="nat",
        meaning="evidence of a drift over a constant gain",
        source="derivation: where the gain is constant, chance reaches a likelihood ratio of 1000 in at most 1 of 1000 "
        "cases (Markov's inequality)",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MountChangeThresholds:
    """What lines change by besides."""

    modelled_scatter: float = deciding(
        0.2,
        meaning="of a quotient's logarithm from window to window where the model's transmission error is used, as wear "
        "changes the error of the model",
        source="observed: below 0.15 in most lines of five campaigns of the wide evaluation's draw 6, 0.3 at most",
    )


DRIFT = GainDriftThresholds()
MOUNT = MountChangeThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class GainChange:
    """A sensor whose gain has changed while it was watched."""

    gain: float  # at the latest window over before the onset
    std: float  # of its logarithm
    onset: float  # revolutions
    onset_std: float  # the interval between the windows about the onset included [revolutions]
    log_evidence: float  # over a constant gain [nat]
    law: SizeLaw = CONSTANT  # linear where the gain drifts


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fit:
    """The regression of all lines on a step."""

    onset: float
    value: float  # ln g
    information: float  # on ln g, of the lines' own std
    explained: float  # squares
    rest: float  # squares left, over their number

    def evidence(self, prior: float) -> float:
        """ln evidence over a constant gain [nat], with the variances widened to what the lines scatter."""
        w = max(self.rest, 1.0)
        return 0.5 * self.explained / w - 0.5 * float(np.log1p(prior**2 * self.information / w))


def gain_step(
    quotients: Sequence[Quotient], gain_prior: float, limits: TransferPathThresholds = PATH
) -> GainChange | None:
    """The change of gain at one time that all measured lines share; None where there is none.

    gain_prior  standard deviation of ln g
    """
    lines = _lines(_measured(quotients), limits, limits.own_scatter)
    turns = sorted({q.revolutions for q in quotients if not q.modelled})
    fits = [(before, after, _step(lines, 0.5 * (before + after), limits)) for before, after in pairwise(turns)]
    known = [(before, after, f) for before, after, f in fits if f is not None]
    if not known:
        return None
    before, after, best = max(known, key=lambda item: item[2].evidence(gain_prior))
    return GainChange(
        gain=float(np.exp(best.value)),
        std=float(np.sqrt(max(best.rest, 1.0) / best.information)),
        onset=best.onset,
        onset_std=(after - before) * UNIFORM,
        log_evidence=best.evidence(gain_prior),
    )


def gains_by_window(
    quotients: Sequence[Quotient], limits: TransferPathThresholds = PATH, drifting: GainDriftThresholds = DRIFT
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What all lines of a window share: revolutions (W,), ln gain up to a constant (W,), its covariance (W, W)."""
    lines = _lines(_measured(quotients), limits, drifting.line_scatter)
    turns = np.array(sorted({float(n) for line in lines for n in line.revolutions}))
    rows, y, weight = [], [], []
    for k, line in enumerate(lines):
        at = line.revolutions
        row = np.zeros((at.size, turns.size + len(lines)))
        row[np.arange(at.size), np.searchsorted(turns, at)] = 1.0
        row[:, turns.size + k] = 1.0
        rows.append(row)
        y.append(line.log.real)
        weight.append(line.weight)
    if turns.size == 0:
        return turns, np.zeros(0), np.zeros((0, 0))
    A, z, w = np.concatenate(rows), np.concatenate(y), np.concatenate(weight)
    C = np.linalg.inv(A.T @ (w[:, None] * A) + np.eye(A.shape[1]) / WIDE**2)
    own = slice(0, turns.size)
    return turns, (C @ (A.T @ (w * z)))[own], C[own, own] + drifting.window_scatter**2 * np.eye(turns.size)


def gain_drift(
    quotients: Sequence[Quotient],
    gain_prior: float,
    limits: TransferPathThresholds = PATH,
    drifting: GainDriftThresholds = DRIFT,
) -> GainChange | None:
    """The drift that all measured lines share; None where a step, or a constant gain, explains them as well.

    gain_prior  standard deviation of ln g
    """
    turns, gains, covariance = gains_by_window(quotients, limits, drifting)
    if turns.size < 2:
        return None
    fits = law_fits(turns, gains, covariance, gain_prior, level=WIDE, kinds=("constant", "linear"))
    ramp, step = fits.get("linear"), fits["constant"]
    if ramp is None or ramp.log_evidence < max(drifting.least_evidence, step.log_evidence):
        return None
    return GainChange(
        gain=float(np.exp(ramp.sizes[0])),
        std=float(ramp.std[0]),
        onset=ramp.onset,
        onset_std=ramp.onset_std,
        log_evidence=ramp.log_evidence,
        law=SizeLaw(kind="linear", revolutions=(float(turns[-1]),)),
    )


def gain_change(
    quotients: Sequence[Quotient], gain_prior: float, limits: TransferPathThresholds = PATH
) -> GainChange | None:
    """The drift where there is one, else the step; None where neither can be judged."""
    drift = gain_drift(quotients, gain_prior, limits)
    return gain_step(quotients, gain_prior, limits) if drift is None else drift


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeOfLines:
    """How lines changed at one time: ln evidence over no change [nat]."""

    shared: float  # all by one factor, as a sensor's gain changes them
    apart: float  # each by its own, as a structure changes them


def change_of_lines(
    quotients: Sequence[Quotient], onset: float, spread: float, limits: TransferPathThresholds = PATH
) -> ChangeOfLines:
    """Whether measured lines changed together or apart from before to after a time.

    onset   revolutions
    spread  standard deviation of ln of the common factor, and of each line's own

    d_k = mean of ln|q| after less that before:  N(0, s_k² + spread²·11ᵀ) against N(0, s_k² + spread²·I)
    """
    _, changes, variance = _changes(_lines(_measured(quotients), limits, limits.own_scatter), onset)
    change = changes.real
    n = len(change)
    if not n:
        return ChangeOfLines(shared=0.0, apart=0.0)
    noise, own = np.diag(variance), spread**2 * np.eye(n)
    none, shared, apart = (
        float(log_density(np.array(change), noise + more)) for more in (0.0, spread**2 * np.ones((n, n)), own)
    )
    return ChangeOfLines(shared=shared - none, apart=apart - none)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Mounted:
    """A mount that resonates since a time."""

    mount: Mount  # its evidence is that over the best rival
    onset: float  # revolutions
    onset_std: float


def mount_change(
    quotients: Sequence[Quotient],
    top: float,
    gain_prior: float,
    limits: TransferPathThresholds = PATH,
    changing: MountChangeThresholds = MOUNT,
) -> Mounted | None:
    """The resonance that explains best how the lines have changed; None where too few were seen before and after.

    top         upper limit of the analysis band [Hz]
    gain_prior  standard deviation of ln g
    """
    own = [replace(q, std=changing.modelled_scatter) if q.modelled else q for q in quotients]
    lines = _lines(own, limits, limits.own_scatter)
    turns = sorted({q.revolutions for q in quotients})
    found = []
    for before, after in pairwise(turns):
        onset = 0.5 * (before + after)
        mount = _mount_since(onset, lines, top, gain_prior, limits)
        if mount is not None:
            found.append(Mounted(mount=mount, onset=onset, onset_std=(after - before) * UNIFORM))
    return max(found, key=lambda f: f.mount.log_evidence, default=None)


def _mount_since(
    onset: float, lines: Sequence[Line], top: float, gain_prior: float, limits: TransferPathThresholds
) -> Mount | None:
    frequency, change, variance = _changes(lines, onset)
    n = len(frequency)
    if n < limits.least_step_lines:
        return None
    d = within_half_turns(np.concatenate((change.real, change.imag)))
    noise, level = np.tile(variance, 2), np.concatenate((np.ones(n), np.zeros(n)))
    shared = log_density(d, np.diag(noise) + gain_prior**2 * np.outer(level, level))
    own = limits.other_structure_scatter**2
    one = np.array([_ln_density(d, noise + own * np.tile(k, 2)) for k in np.eye(n)])
    apart = (_ln_density(d, noise + s) for s in (0.0, gain_prior**2, own))
    mounts = Mounts.of(top, frequency)
    best = mounts.likeliest(_ln_density(mounts.left_of(d), noise))
    rival = max(float(shared), float(logsumexp(one) - np.log(n)), *(float(value) for value in apart))
    return replace(best, log_evidence=best.log_evidence - rival)


def _ln_density(values: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Of independent normal values (…, n) → (…)."""
    return np.asarray(-0.5 * (values**2 / variance + np.log(2 * np.pi * variance)).sum(axis=-1))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Line:
    """Quotients of one line at one frequency, in the windows that show it (w,)."""

    frequency: float  # [Hz]
    revolutions: np.ndarray
    log: np.ndarray  # complex
    weight: np.ndarray


def _changes(lines: Sequence[Line], onset: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequency [Hz], change of ln q and its variance of every line that was seen before and after a time (n,)."""
    rows = []
    for line in lines:
        late = line.revolutions > onset
        if late.all() or not late.any():
            continue
        sides = [(line.weight[here], line.log[here]) for here in (~late, late)]
        before, after = (complex(w @ y.real / w.sum(), np.angle(w @ np.exp(1j * y.imag))) for w, y in sides)
        rows.append((line.frequency, after - before, sum(1 / w.sum() for w, _ in sides)))
    frequency, change, variance = zip(*rows, strict=True) if rows else ((), (), ())
    return np.array(frequency), np.array(change, dtype=complex), np.array(variance)


def _lines(quotients: Sequence[Quotient], limits: TransferPathThresholds, scatter: float) -> list[Line]:
    """Quotients of one line at one frequency each, those with at least two windows.

    scatter  of a quotient's logarithm beyond its noise
    """
    groups: list[list[Quotient]] = []
    for q in sorted(quotients, key=lambda q: (q.modelled, q.order, q.frequency)):
        last = groups[-1][0] if groups else None
        same = last is not None and (last.modelled, last.order) == (q.modelled, q.order)
        if last is not None and same and abs(q.frequency / last.frequency - 1) < limits.same_frequency:
            groups[-1].append(q)
        else:
            groups.append([q])
    return [
        Line(
            frequency=float(np.mean([q.frequency for q in g])),
            revolutions=np.array([q.revolutions for q in g]),
            log=np.array([q.log for q in g]),
            weight=1 / np.array([np.hypot(q.std, scatter) for q in g]) ** 2,
        )
        for g in groups
        if len(g) >= 2
    ]


def _measured(quotients: Sequence[Quotient]) -> list[Quotient]:
    return [q for q in quotients if not q.modelled]


def _step(lines: Sequence[Line], onset: float, limits: TransferPathThresholds) -> _Fit | None:
    """The regression on a step at an onset; None where the lines are too few, or do not see it."""
    information = total = squares = 0.0
    count = 0
    for line in lines:
        y, weight, h = line.log.real, line.weight, (line.revolutions > onset).astype(float)
        y, h = y - np.average(y, weights=weight), h - np.average(h, weights=weight)
        information += float(weight @ h**2)
        total += float(weight @ (h * y))
        squares += float(weight @ y**2)
        count += len(y) - 1
    if information == 0 or count < limits.least_step_lines:
        return None
    explained = total**2 / information
    return _Fit(
        onset=onset,
        value=total / information,
        information=information,
        explained=explained,
        rest=max(squares - explained, 0.0) / (count - 1),
    )
