"""Mesh lines folded at half the sampling rate, channels shifted in time, and mains hum.

    c_k(t) = 2·x(t)·exp(−i·k·z1·θ(t)), averaged over blocks; its mean is mesh harmonic k, also where k·z1·f lies above
             half the sampling rate: the samples of such a line are those of its image, and keep its phase law

    φ_k(t) = arg c_k(t) = φ_0 − 2π·k·z1·τ·f(t)        of a channel that comes τ late, where the speed f varies

θ   pinion angle by the encoder [rad]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import median_filter

from twin.assessment import Mistake
from twin.features.transforms import hann
from twin.plausibility.context import Examined, listed
from twin.plausibility.thresholds import SamplingThresholds
from twin.windows import Samples

BLOCKS = 2048  # of a demodulated signal
NEAR, FAR = 4, 24  # bins of its spectrum that are noise
WIDER = 4.0  # standard deviations of the speed that a line is widened by
MOST_FOLDED = 40  # harmonics above half the sampling rate that are examined
SMOOTH_TURNS = 2.0  # over which a mesh phase is averaged
MAINS = (50.0, 60.0)  # [Hz]
MULTIPLES = 4  # of the mains frequency


def _demodulated(x: np.ndarray, angle: np.ndarray, order: float, blocks: int = BLOCKS) -> np.ndarray:
    """Block means of 2·x·exp(−i·order·θ), with a Hann window over the whole (blocks,)."""
    size = x.size // blocks
    product = 2 * x[: size * blocks] * np.exp(-1j * order * angle[: size * blocks])
    return product.reshape(blocks, size).mean(axis=1)


def _line(c: np.ndarray) -> tuple[float, float]:
    """Amplitude of the line at the middle, and the noise beside it."""
    weight = hann(c.size)
    spectrum = np.abs(np.fft.fft(c * weight)) / weight.sum()
    around = np.concatenate((spectrum[NEAR:FAR], spectrum[-FAR:-NEAR]))
    return float(spectrum[0]), float(np.sqrt(np.median(around**2) / np.log(2)))


def aliasing(seen: Examined, limits: SamplingThresholds) -> list[Mistake]:
    """Mesh harmonics above half the sampling rate that appear below it: no filter before the converter."""
    if seen.teeth is None or seen.track is None or not seen.by_encoder:
        return []
    out = []
    for name, samples in seen.vibrations.items():
        angle, inside = seen.angle_at(samples)
        x = samples.values[inside]
        if x.size < BLOCKS * 2:
            continue
        mesh, half = seen.teeth[0] * seen.track.speed, samples.rate / 2
        first = int(half / mesh) + 1
        strongest = max(
            (_line(_demodulated(x, angle, k * seen.teeth[0]))[0] for k in range(1, min(first, 9))), default=0.0
        )
        folded = []
        for k in range(first, min(first + MOST_FOLDED, int(4 * half / mesh) + 1)):
            image = abs(k * mesh - samples.rate * round(k * mesh / samples.rate))
            if _is_hidden(image, mesh, seen, samples):
                continue
            amplitude, noise = _line(_demodulated(x, angle, k * seen.teeth[0]))
            if amplitude > max(limits.folded * noise, limits.folded_share * strongest):
                folded.append((k * mesh, image))
        if len(folded) >= limits.least_folded:
            lines = listed([f"{frequency:.5g} Hz at {image:.5g} Hz" for frequency, image in folded])
            out.append(
                Mistake(
                    kind="aliasing", channels=(f"accel/{name}",),
                    evidence=f"mesh harmonics above half the sampling rate ({half:.5g} Hz) appear below it: {lines}",
                    remedy="the converter has no anti-aliasing filter, or the record was thinned without one: record "
                    "again with a filter, or at a higher rate",
                )
            )  # fmt: skip
    return out


def _is_hidden(image: float, mesh: float, seen: Examined, samples: Samples) -> bool:
    """Whether a folded line lies too near to a shaft's line, or to a mesh line, widened by the speed's variation.

    The angle that makes a folded line sharp widens the true lines: by the sampling rate times the speed's variation.
    """
    assert seen.track is not None
    width = NEAR / samples.duration + WIDER * seen.track.speed_variation * samples.rate
    near_mesh = abs(image - mesh * round(image / mesh)) < width
    return near_mesh or _is_shaft_line(image, seen, samples.duration)


def _is_shaft_line(frequency: float, seen: Examined, duration: float) -> bool:
    """Whether a multiple of either shaft's speed lies too near to be distinguished."""
    assert seen.teeth is not None and seen.track is not None
    for speed in (seen.track.speed, seen.track.speed * seen.teeth[0] / seen.teeth[1]):
        if abs(frequency - speed * round(frequency / speed)) < NEAR / duration:
            return True
    return False


def shifted(seen: Examined, limits: SamplingThresholds) -> list[Mistake]:
    """Accelerometers that come late or early against the encoder, by their mesh phase under a varying speed."""
    if seen.teeth is None or seen.track is None or not seen.by_encoder:
        return []
    out = []
    for name, samples in seen.vibrations.items():
        found = [s for k in (1, 2, 3) if (s := _shift(seen, samples, k, limits)) is not None]
        if len(found) < 2:
            continue
        shift = float(np.median([s for s, _ in found]))
        if all(abs(s - shift) < limits.shift_deviations * std + 0.1 * abs(shift) for s, std in found):
            when = "later" if shift > 0 else "earlier"
            out.append(
                Mistake(
                    kind="shifted", channels=(f"accel/{name}", seen.track.source),
                    evidence=f"the vibration follows the speed {abs(shift):.3g} s {when} than {seen.track.source}",
                    remedy="their clocks or trigger times differ: record them on one device, or shift one of them",
                )
            )  # fmt: skip
    return out


def _shift(seen: Examined, samples: Samples, k: int, limits: SamplingThresholds) -> tuple[float, float] | None:
    """How much later a channel comes by mesh harmonic k, with its standard deviation [s]; None where unclear."""
    assert seen.teeth is not None and seen.track is not None
    order = k * seen.teeth[0]
    if order * seen.track.speed > 0.45 * samples.rate:
        return None
    angle, inside = seen.angle_at(samples)
    x = samples.values[inside]
    blocks = int((angle[-1] - angle[0]) / (2 * np.pi) / SMOOTH_TURNS) if angle.size else 0
    if blocks < 12:
        return None
    size = x.size // blocks
    c = _demodulated(x, angle, order, blocks)
    speed = np.diff(angle[: size * blocks + 1 : size][: blocks + 1]) / (2 * np.pi * size / samples.rate)
    if speed.size < blocks:
        c = c[: speed.size]
    if np.min(np.abs(c)) < 0.2 * np.median(np.abs(c)):  # the phase is lost where the line is
        return None
    phase = np.unwrap(np.angle(c))
    design = np.stack((np.ones(speed.size), speed - speed.mean(), np.arange(speed.size) - speed.size / 2), axis=1)
    if np.ptp(speed) == 0 or np.linalg.matrix_rank(design) < 3:
        return None
    fitted, *_ = np.linalg.lstsq(design, phase, rcond=None)
    rest = phase - design @ fitted
    without = phase - design[:, [0, 2]] @ np.linalg.lstsq(design[:, [0, 2]], phase, rcond=None)[0]
    variance = rest @ rest / (speed.size - 3)
    std = float(np.sqrt(variance * np.linalg.inv(design.T @ design)[1, 1])) / (2 * np.pi * order)
    shift = -float(fitted[1]) / (2 * np.pi * order)
    explained = 1 - (rest @ rest) / max(without @ without, 1e-300)
    clear = abs(shift) > max(limits.least_shift, limits.shift_deviations * std) and explained > limits.shift_explains
    return (shift, std) if clear else None


@dataclass(frozen=True, slots=True, eq=False)
class _Tones:
    """Low end of one channel's spectrum."""

    amplitude: np.ndarray  # peak (n,)
    floor: np.ndarray  # of the noise (n,)
    step: float  # [Hz]
    resolution: float  # up to which two tones are one [Hz]
    least: float  # height over the floor from which a tone is there [dB]

    def near(self, frequency: float, reach: float) -> tuple[float, float] | None:
        """Frequency and amplitude of the tone within a reach of a frequency [Hz]; None where there is none."""
        width = max(3, int(reach / self.step))
        middle = round(frequency / self.step)
        beside = width + int(self.resolution / self.step)  # the flank of a line beyond is no tone of its own
        if middle - beside < 0 or middle + beside >= self.floor.size:
            return None
        at = middle - beside + int(np.argmax(self.amplitude[middle - beside : middle + beside + 1]))
        if abs(at - middle) > width:
            return None
        if 20 * np.log10(self.amplitude[at] / max(float(self.floor[at]), 1e-300)) < self.least:
            return None
        return at * self.step, float(self.amplitude[at])


def _tones_of(samples: Samples, limits: SamplingThresholds) -> _Tones:
    x = samples.values
    weight = hann(x.size)
    length = fft.next_fast_len(x.size, real=True)
    amplitude = 2 * np.abs(fft.rfft(x * weight, length)) / weight.sum()
    step = samples.rate / length
    floor = np.sqrt(median_filter(amplitude[: int(300 / step)] ** 2, max(9, int(4 / step)) | 1) / np.log(2))
    return _Tones(amplitude, floor, step, NEAR / samples.duration, limits.hum_line)


def hum(seen: Examined, limits: SamplingThresholds) -> list[Mistake]:
    """Tones at the frequency of the mains, 50 or 60 Hz, and its multiples, which nothing that turns makes."""
    out = []
    for name, samples in seen.vibrations.items():
        tones, rms = _tones_of(samples, limits), float(np.sqrt(np.mean(samples.values**2)))
        for mains in MAINS:
            first = tones.near(mains, limits.mains)
            if first is None or _turns(first[0], tones, seen, limits):
                continue
            lines = [first]
            lines += [
                t for n in range(2, MULTIPLES + 1) if (t := tones.near(n * first[0], tones.resolution)) is not None
            ]
            if float(np.sqrt(sum(a**2 for _, a in lines))) > limits.hum * rms:
                said = listed([f"{a:.3g} m/s² at {f:.1f} Hz" for f, a in lines])
                out.append(
                    Mistake(
                        kind="hum", channels=(f"accel/{name}",),
                        evidence=f"tones at multiples of {mains:.0f} Hz: {said}",
                        remedy="mains hum? Check the earth of sensor and cable (a ground loop)",
                    )
                )  # fmt: skip
    return out


def _turns(frequency: float, tones: _Tones, seen: Examined, limits: SamplingThresholds) -> bool:
    """Whether a shaft may make a tone: one of known or stated speed, or any whose other multiples are there, too."""
    reach = max(3 * tones.step, tones.resolution)
    for speed, doubt in _speeds(seen, limits):
        n = max(1, round(frequency / speed))
        if (doubt == 0 or n <= limits.stated_multiples) and abs(frequency - n * speed) < reach + doubt * n * speed:
            return True
    for part in range(2, limits.most_parts + 1):
        others = [j for j in range(1, 2 * part) if j % part]
        there = [j for j in others if tones.near(j * frequency / part, 2 * tones.step) is not None]
        if len(there) > limits.comb * len(others):
            return True
    return False


def _speeds(seen: Examined, limits: SamplingThresholds) -> list[tuple[float, float]]:
    """Speeds of the shafts [Hz], each with its relative doubt: 0 where it was measured."""
    stated = seen.rig.get("operating.pinion_speed_hz")
    if seen.track is None and not stated:
        return []
    speed, doubt = (float(stated), limits.stated_speed) if seen.track is None else (seen.track.speed, 0.0)
    gear = [] if seen.teeth is None else [speed * seen.teeth[0] / seen.teeth[1]]
    return [(one, doubt) for one in (speed, *gear)]
