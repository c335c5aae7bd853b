"""Delays of an accelerometer against the encoder that change within a window: lost samples, and a clock that runs off.

    coh_k(τ) = |Σ_b c_k(b)·exp(i·ω_k·τ(b))|²/(n·Σ_b |c_k(b)|²),    u(τ) = mean over k of 1 − coh_k

    clock          τ(b) = r·t_b                  r  rate of the accelerometer's clock against the encoder's [s/s]
    lost samples   τ(b) = −J for turns behind b  J  length of what is missing, in whole samples [s]

A rate is believed where it leaves less than `left` of what is unexplained without it; a jump where the lines before and
behind it agree on one J. Of delays that are a whole number of mesh periods apart, the one nearest to what the record is
shorter than the encoder's is taken, so that mesh lines are put right, and shaft lines nearly. Lost samples become a
gap; the turn in which they are missing goes with them. Where the lines do not go on behind the gap as before, the
channel is used up to there only.

Holds    steady speed (twin/instruments/seen.py); teeth mesh, so that no machine's mesh lines can leave the encoder
Limits   whose clock is wrong, the accelerometer's or the encoder's, cannot be told: the accelerometer's is corrected
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from twin.instruments.seen import MeshPhases, Seen, with_channels
from twin.thresholds import deciding
from twin.windows import Fault, Samples, Window


@dataclass(frozen=True, slots=True, kw_only=True)
class DelayThresholds:
    """When a delay has changed within a window."""

    left: float = deciding(
        0.3, of="unexplained power of the mesh lines", meaning="what a rate may leave of it",
        source="not derived: chosen; sound channels keep 0.97 and more",
    )  # fmt: skip
    least_phase: float = deciding(
        0.6, unit="rad", meaning="phase by which a rate turns the highest line within the window",
        source="derivation: the line is then read 1.5 % too low",
    )  # fmt: skip
    largest_rate: float = deciding(
        2e-3, unit="s/s", meaning="rate that is tried", source="not derived: ten times that of a poor quartz, and more"
    )  # fmt: skip
    agree: float = deciding(
        0.9, meaning="mean cosine of the lines' phases about one jump, from which they agree on it",
        source="derivation: 0.45 rad for each line",
    )  # fmt: skip
    apart: float = deciding(
        0.5, meaning="mean coherence of the lines before and behind a place, below which they have jumped there",
        source="derivation: phases before and behind the place differ by 1 rad or more",
    )  # fmt: skip
    goes_on: float = deciding(
        0.1, meaning="unexplained power of the mesh lines up to which they keep one phase",
        source="not derived: chosen; most of it is left to run-out, which turns the phases of sound windows",
    )  # fmt: skip
    longest: float = deciding(
        0.5, unit="s", meaning="longest piece that may be missing", source="not derived: a fifth of a window of 2.5 s"
    )  # fmt: skip


DEFAULT = DelayThresholds()
REFINED = 3  # times that the length of one is corrected
MOST_JUMPS = 8  # of one channel in a window
SIDE = 3  # turns on either side of a place that are held against one another
PER_RADIAN = 4  # rates and delays that are tried within a radian of the highest line


def with_clocks(seen: Seen, limits: DelayThresholds = DEFAULT) -> Window:
    """The window with accelerometers whose clock runs off at the rate that it has."""
    corrected, faults = {}, []
    for name, samples in seen.window.accelerations.items():
        phases = seen.phases(samples)
        rate = None if phases is None else _rate(phases, limits)
        if rate is None:
            continue
        corrected[name] = replace(samples, rate=samples.rate * (1 + rate))
        detail = (
            f"its clock runs {abs(rate) * 1e6:.0f} ppm {'fast' if rate > 0 else 'slow'} against the encoder: "
            f"{abs(rate) * samples.duration * 1e3:.2g} ms within the window; put right"
        )
        faults.append(Fault(kind="clock_rate", channel=f"accel/{name}", count=1, action="repaired", detail=detail))
    return with_channels(seen.window, corrected, faults) if corrected else seen.window


def _unexplained(p: MeshPhases, delay: np.ndarray) -> np.ndarray:
    """u of delays (m, n) [s]; (m,)."""
    out = np.zeros(len(delay))
    for c, omega, power in zip(p.phasors, p.omega, p.power, strict=True):
        together = np.abs(np.exp(1j * omega * delay) @ c) ** 2
        out += 1 - together / (c.size * power)
    return out / len(p.omega)


def _rate(p: MeshPhases, limits: DelayThresholds) -> float | None:
    """How much faster than the encoder's the channel's clock runs [s/s]; None where it does not."""
    t = p.times - p.times.mean()
    span, highest = float(np.ptp(t)), float(p.omega.max())
    step = 1 / (PER_RADIAN * highest * span)
    count = ceil(limits.largest_rate / step)
    best, least = 0.0, _unexplained(p, np.zeros((1, t.size)))[0]
    limit = limits.left * least
    for size in (step, step / 20, step / 400):
        rates = best + size * np.arange(-count, count + 1)
        found = _unexplained(p, rates[:, None] * t)
        best, least = float(rates[np.argmin(found)]), float(found.min())
        count = 30
    if least > limit or abs(best) * span * highest < limits.least_phase:
        return None
    return best  # what is seen later and later was sampled more often than was said


def with_lost_samples(seen: Seen, limits: DelayThresholds = DEFAULT) -> Window:
    """The window with gaps where accelerometers have lost samples without a word."""
    corrected, faults = {}, []
    for name, samples in seen.window.accelerations.items():
        whole, places = _whole(seen, samples, limits)
        if not places:
            continue
        sound = _goes_on(seen, whole, limits)
        corrected[name] = whole if sound else _first_piece(whole)
        lost = (whole.values.size - samples.values.size) / samples.rate
        said = ", ".join(f"{at:.2f} s" for at in places)
        detail = (
            f"{abs(lost) * 1e3:.3g} ms of samples {'are missing' if lost > 0 else 'are there twice'} near {said} of "
            "the window, by the mesh lines against the encoder; "
        )
        detail += "a gap is put in" if sound else "how many is not certain: what comes behind is left out"
        action = "repaired" if sound else "degraded"
        faults.append(
            Fault(kind="lost_samples", channel=f"accel/{name}", count=len(places), action=action, detail=detail)
        )
    return with_channels(seen.window, corrected, faults) if corrected else seen.window


def _goes_on(seen: Seen, samples: Samples, limits: DelayThresholds) -> bool:
    """Whether the mesh lines of a channel keep one phase through the window."""
    phases = seen.phases(samples)
    if phases is None:
        return False
    whole = np.flatnonzero(np.abs(phases.phasors).min(axis=0) > 0)  # turns without a gap
    kept = replace(phases, phasors=phases.phasors[:, whole])
    return bool(_unexplained(kept, np.zeros((1, whole.size)))[0] <= limits.goes_on)


def _first_piece(samples: Samples) -> Samples:
    """A channel up to its first gap: what comes behind is known to be late, and not by how much."""
    known = np.isfinite(samples.values)
    first = int(np.argmax(known))
    lost = np.flatnonzero(~known[first:])
    values = samples.values.copy()
    values[first + int(lost[0]) :] = np.nan
    return replace(samples, values=values)


def _whole(seen: Seen, samples: Samples, limits: DelayThresholds) -> tuple[Samples, list[float]]:
    """A channel with gaps where samples are missing, and where [s]; one after the other, since each moves the rest."""
    places: list[float] = []
    for _ in range(MOST_JUMPS):
        phases = seen.phases(samples)
        assert phases is None or seen.track is not None
        if phases is None or seen.track is None:
            break
        missing = max(0.0, seen.track.ends[1] - (samples.start + samples.duration))
        jump = _first_jump(phases, missing, samples.rate, limits)
        if jump is None or (places and phases.times[jump[0]] <= places[-1]):
            break
        turn, lost = jump
        places.append(float(phases.times[turn]))
        samples = _filled(seen, samples, phases.starts[turn : turn + 2], turn, lost, limits)
    return samples, places


def _filled(seen: Seen, samples: Samples, ends: np.ndarray, turn: int, lost: int, limits: DelayThresholds) -> Samples:
    """A channel with a gap in place of one turn and what is missing in it.

    The length is found at the window's mean speed first, then by what is left beside the gap.
    """
    for _ in range(REFINED):
        whole = replace(samples, values=_with_gap(samples.values, ends, lost))
        phases = seen.phases(whole)
        if phases is None or turn + SIDE >= phases.phasors.shape[1]:
            break
        left = _length(np.angle(_across(phases, np.array([turn]))[:, 0]), phases.omega, 0.0, samples.rate, limits)
        if left == 0:
            break
        lost += left
    return replace(samples, values=_with_gap(samples.values, ends, lost))


def _across(p: MeshPhases, turns: np.ndarray) -> np.ndarray:
    """Lines behind some turns over those before, as products with the conjugate (K, m)."""
    before = np.stack([p.phasors[:, b - SIDE : b].mean(axis=1) for b in turns], axis=1)
    behind = np.stack([p.phasors[:, b + 1 : b + 1 + SIDE].mean(axis=1) for b in turns], axis=1)
    return np.asarray(behind * before.conj())


def _first_jump(p: MeshPhases, missing: float, rate: float, limits: DelayThresholds) -> tuple[int, int] | None:
    """The first turn in which the delay jumps, and the samples that are missing there; None where it keeps its place.

    missing  how much earlier than the encoder's edges the channel ends [s]
    """
    turns = np.arange(SIDE, p.phasors.shape[1] - SIDE)
    if turns.size == 0:
        return None
    product = _across(p, turns)
    same = (product.real / np.maximum(np.abs(product), 1e-300)).mean(axis=0)
    for i in np.flatnonzero(same < limits.apart).tolist():
        near = slice(max(i - SIDE, 0), i + SIDE + 1)
        if same[i] > same[near].min():
            continue
        b = int(turns[i])
        faster = float(np.diff(p.starts).mean() / np.diff(p.starts[b : b + SIDE + 1]).mean())
        lost = _length(np.angle(product[:, i]), p.omega * faster, missing, rate, limits)
        if lost:
            return b, lost
    return None


def _length(turned: np.ndarray, omega: np.ndarray, missing: float, rate: float, limits: DelayThresholds) -> int:
    """Samples that are missing where lines turn by these phases (K,); 0 where they agree on no length."""
    tried = np.arange(-ceil(limits.longest * rate), ceil(limits.longest * rate) + 1)
    agreed = np.cos(turned[:, None] - omega[:, None] * tried / rate).mean(axis=0)
    good = np.flatnonzero(agreed >= max(limits.agree, float(agreed.max()) - 0.5 * (1 - limits.agree)))
    if good.size == 0:
        return 0
    peaks = [j for j in good.tolist() if agreed[j] >= agreed[max(j - 1, 0) : j + 2].max()]
    return int(min(tried[peaks], key=lambda n: abs(n / rate - missing)))


def _with_gap(values: np.ndarray, turn: np.ndarray, lost: int) -> np.ndarray:
    """Values with a gap in place of one turn (first sample, end) and what is missing in it; (n,) → (m,)."""
    first, last = (int(place) for place in turn)
    gap = last - first + lost
    return np.concatenate([values[:first], np.full(max(gap, 0), np.nan), values[last + max(0, -gap) :]])
