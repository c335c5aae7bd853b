"""Tooth counts, speed and encoders against each other and against the mesh lines.

    height of a comb z   mean over k = 1 … 4 of 10·lg(P(k·z)/median P(k·z + j)), j = ±1 … ±4, at most 30 dB each

P   power of the acceleration against order of the pinion's rotation

The mesh harmonics of the right tooth count stand above the orders beside them; those of a wrong one lie on a sideband
or between the lines. Where the stated comb does not and another one does, that one is named.
"""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.ndimage import median_filter

from twin.assessment import Mistake
from twin.errors import TwinError
from twin.features.resample import on_angle
from twin.features.transforms import hann
from twin.plausibility.context import Examined
from twin.plausibility.thresholds import SpeedThresholds
from twin.windows import Samples

HARMONICS = 4  # of a comb
BESIDE = (-4, -3, -2, -1, 1, 2, 3, 4)  # orders beside a line
LINES = 3  # of another comb that must be clear
CAP = 30.0  # dB that one line counts at most
TEETH = range(8, 151)  # that are tried
FACTORS = {n: f"{n} times the speed: pulses_per_rev (edges_per_rev) is {n} times too large?" for n in (2, 3, 4)}
PARTS = {n: f"1/{n} of the speed: {n} times as many pulses a turn?" for n in (2, 3, 4)}
USABLE = 0.45  # of the sampling rate


class _Spectrum:
    """Power of one accelerometer against order."""

    def __init__(self, samples: Samples, seen: Examined):
        assert seen.track is not None
        signal, per_turn = on_angle(samples, seen.track)
        weight = hann(signal.values.size)
        length = fft.next_fast_len(signal.values.size, real=True)
        self.power = np.abs(fft.rfft(weight * (signal.values - signal.values.mean()), length)) ** 2
        self.step = 2 * np.pi / (length * signal.step)  # orders
        self.highest = USABLE * per_turn
        width = max(9, int(0.8 / self.step)) | 1
        self.floor = median_filter(self.power, width, mode="nearest") / np.log(2)

    def at(self, order: float) -> float:
        """Power of the line nearest an order."""
        i = round(order / self.step)
        return float(self.power[max(i - 2, 0) : i + 3].max(initial=1e-300))

    def over_floor(self, order: float) -> float:
        """Height of a line over the noise floor [dB]."""
        i = min(round(order / self.step), self.floor.size - 1)
        return float(10 * np.log10(max(self.at(order), 1e-300) / max(float(self.floor[i]), 1e-300)))

    def strongest(self) -> tuple[float, float]:
        """Order of the line highest over the noise floor, where a mesh may be, and its height [dB]."""
        over = self.power[1:] / np.maximum(self.floor[1:], 1e-300)
        order = np.arange(1, self.power.size) * self.step
        i = int(np.argmax(np.where((order > min(TEETH)) & (order < self.highest), over, 0.0)))
        return (i + 1) * self.step, float(10 * np.log10(over[i]))

    def height(self, order: float) -> float:
        """Height of a line over the orders beside it [dB], at most the cap."""
        beside = float(np.median([self.at(order + j) for j in BESIDE]))
        return min(CAP, 10 * float(np.log10(self.at(order) / max(beside, 1e-300))))

    def comb(self, z: float) -> list[float]:
        """Height of each line of a comb over the orders beside it [dB]."""
        out = []
        for k in range(1, HARMONICS + 1):
            if k * z + max(BESIDE) > self.highest or k * z + min(BESIDE) <= 0:
                break
            out.append(self.height(k * z))
        return out


def candidates(seen: Examined, _: SpeedThresholds) -> list[Mistake]:
    """Mesh lines that fit two speeds within a per cent, where nothing else tells the speed."""
    if seen.track is None or not seen.track.doubt:
        return []
    return [
        Mistake(
            kind="mesh", channels=tuple(f"accel/{name}" for name in seen.vibrations), evidence=seen.track.doubt,
            remedy="a planetary stage, or a second gear pair? A tachometer tells them apart",
        )
    ]  # fmt: skip


def mesh_lines(seen: Examined, limits: SpeedThresholds) -> list[Mistake]:
    """The mesh lines are not where tooth count and encoder put them, in every accelerometer."""
    if seen.teeth is None or seen.track is None or not seen.by_encoder or seen.is_slow:
        return []
    if _are_exchanged(seen, limits):  # `encoders` says so; lines at a wrong mesh frequency would say nothing more
        return []
    found: dict[str, str] = {}
    spectra: dict[str, _Spectrum] = {}
    for name, samples in seen.vibrations.items():
        try:
            spectra[name] = _Spectrum(samples, seen)
        except TwinError:
            continue
    for name, spectrum in spectra.items():
        likely = _instead(spectrum, seen, limits)
        if likely is None:
            return []
        found[name] = likely
    if not found:
        return []
    z, f = seen.teeth[0], seen.track.speed
    likely = next(iter(found.values()))
    return [
        Mistake(
            kind="mesh", channels=tuple(f"accel/{name}" for name in found),
            evidence=f"no mesh line at {z} teeth × {f:.4g} Hz = {z * f:.5g} Hz or its multiples",
            remedy=likely,
        )
    ]  # fmt: skip


def _instead(spectrum: _Spectrum, seen: Examined, limits: SpeedThresholds) -> str | None:
    """What the lines of one accelerometer suggest in place of the stated mesh; None where that is there."""
    assert seen.teeth is not None and seen.track is not None
    z1, z2 = seen.teeth
    stated = spectrum.comb(z1)
    if not stated:  # above the sampling rate: aliasing says so
        return None
    if float(np.mean(stated)) >= limits.absent:
        return _between(spectrum, z1, seen.track.speed, limits)
    candidates = {float(z): "" for z in TEETH if z % z1} | {float(n * z1): text for n, text in FACTORS.items()}
    heights = {z: spectrum.comb(z) for z in candidates}
    good = {
        z: float(np.mean(h)) for z, h in heights.items()
        if len(h) >= LINES and float(np.mean(h)) >= limits.clear and sum(x >= limits.clear_line for x in h) >= LINES
    }  # fmt: skip
    if good:
        best = max(good, key=lambda z: good[z])
        return _suggestion(best, candidates[best], z1, z2, seen.track.speed)
    lines = [spectrum.over_floor(k * z1) for k in range(1, len(stated) + 1)]
    strongest, height = spectrum.strongest()
    if max(lines) >= limits.no_line or height < limits.tonal:
        return None
    return f"the strongest line is at {strongest * seen.track.speed:.5g} Hz: tooth count, pulses a turn or sample rate?"


def _between(spectrum: _Spectrum, z1: int, speed: float, limits: SpeedThresholds) -> str | None:
    """Whether clear lines lie at halves, thirds or quarters of the stated mesh: the speed is that much lower then."""
    for n, text in PARTS.items():
        between = [k * z1 / n for k in range(1, 2 * n + 2) if k % n][:LINES]
        if between[-1] + max(BESIDE) > spectrum.highest:
            continue
        heights = [spectrum.height(order) for order in between]
        if min(heights) >= limits.clear and spectrum.at(between[0]) >= limits.part_power * spectrum.at(z1):
            return _suggestion(z1 / n, text, z1, 0, speed)
    return None


def _suggestion(order: float, text: str, z1: int, z2: int, speed: float) -> str:
    """What lines at multiples of an order of the measured speed mean."""
    where = f"clear lines at multiples of {order * speed:.5g} Hz"
    if order == z2:
        return f"{where}, the gear's {z2} teeth: the tachometer is on the gear, not on the pinion?"
    if text:
        return f"{where}: {text}"
    return f"{where}: {order:g} teeth, or a speed of {order / z1 * speed:.4g} Hz?"


def _exchanges(seen: Examined) -> tuple[tuple[float, str], ...]:
    """Ratios of the two encoders' speeds (gear's over pinion's) where something of the two is exchanged."""
    assert seen.teeth is not None
    right = seen.teeth[0] / seen.teeth[1]
    counts = seen.window.encoders["pinion"].per_rev / seen.window.encoders["gear"].per_rev
    return (
        (1 / right, "the encoders of pinion and gear are exchanged?"),
        (right * counts**2, "the edges per turn of the two encoders are exchanged?"),
        (1 / right * counts**2, "the columns of the two encoders are exchanged?"),
    )


def _are_exchanged(seen: Examined, limits: SpeedThresholds) -> bool:
    """Whether two encoders are exchanged: the pinion's speed, and any mesh frequency made of it, is then wrong."""
    if seen.teeth is None:
        return False
    pinion, gear = seen.speed_by("pinion"), seen.speed_by("gear")
    if pinion is None or gear is None or abs(gear / pinion * seen.teeth[1] / seen.teeth[0] - 1) < limits.ratio:
        return False
    return any(abs(gear / pinion / value - 1) < limits.ratio for value, _ in _exchanges(seen))


def encoders(seen: Examined, limits: SpeedThresholds) -> list[Mistake]:
    """Two encoders whose ratio is that of a mistake: names exchanged, counts a turn exchanged, or counted twice."""
    if seen.teeth is None:
        return []
    pinion, gear = seen.speed_by("pinion"), seen.speed_by("gear")
    if pinion is None or gear is None:
        return []
    z1, z2 = seen.teeth
    ratio, right = gear / pinion, z1 / z2
    likely = (
        (right, ""),
        *_exchanges(seen),
        (2 * right, "the gear's encoder counts twice as many edges a turn as stated, or the pinion's half?"),
        (right / 2, "the pinion's encoder counts twice as many edges a turn as stated, or the gear's half?"),
        (4 * right, "the gear's encoder counts four times as many edges a turn as stated (quadrature)?"),
        (right / 4, "the pinion's encoder counts four times as many edges a turn as stated (quadrature)?"),
    )
    for value, text in likely:
        if abs(ratio / value - 1) < limits.ratio:
            if not text:
                return []
            return [
                Mistake(
                    kind="swapped", channels=("encoder/pinion", "encoder/gear"),
                    evidence=f"their speeds are {pinion:.5g} and {gear:.5g} Hz, a ratio of {ratio:.4g}, and the teeth "
                    f"{z1}/{z2} give {right:.4g}",
                    remedy=text,
                )
            ]  # fmt: skip
    return []
