"""Pinion speed and angle from the mesh lines of accelerometers, where there is no encoder.

    comb(f) = Σ_sensors Σ_k ln(P(k·f)/floor)            k = 1 … 5, the best f within 3 % of z1·nominal speed
    θ(t)    = Σ_l w_l·arg z_l(t)/(k_l·z1)               z_l the signal around a mesh line, demodulated

P     power spectrum; over its own floor every line counts alike, however the structure passes it on
z_l   complex envelope of line l (a sensor and a harmonic), narrower than the first sideband on either side
w_l   weight: k²·(power over floor)

The comb finds the mesh frequency to a fraction of a hertz, the phase follows it through the window. The
zero of the angle is arbitrary. Whether the fit holds is judged twice: the comb must stand out from every
other comb in the range, and no sidebands round the mesh lines may be spaced by a strange tooth count more
clearly than by the pinion's.

Source   J. Urbanek, T. Barszcz, J. Antoni, Mech. Syst. Signal Process. 38 (2013) 13–30 (two steps);
         F. Combet, L. Gelman, Mech. Syst. Signal Process. 21 (2007) 2590–2606
Holds    nominal speed known to 3 %; speed within the window steady to 0.4/(number of teeth)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter1d

from twin.errors import NotAvailable, WindowError
from twin.features.angle import AngleTrack, fit_track
from twin.features.gaps import filled
from twin.features.mesh_comb import check_comb, comb_search, over_floor
from twin.features.resample import on_angle
from twin.features.transforms import hann
from twin.rig import Rig
from twin.windows import Samples

TURNS_PER_KNOT = 4.0
BEST_LINES = 6
STANDS_OUT = 2.0  # power over the floor of a line that is there; noise gives 1
LEAST_AGREED = 0.6  # share of them that must agree on one speed
FOLLOWED = ((1, 2, 3, 4, 5), (1, 2, 3), (1, 2), (1,))  # high harmonics are sharper but lost sooner
MOST_SENSORS = 6  # whose sidebands are looked at
CLEAR_SIDEBANDS = 2.2  # mean ln(power/floor) from which sidebands speak for their spacing


Phase = tuple[np.ndarray, np.ndarray, tuple[str, ...], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSpeed:
    """Mesh frequency found in a window, and whether to believe it."""

    mesh_hz: float
    mesh_std_hz: float  # scatter of the lines that it is the mean of
    lines: tuple[str, ...]  # the lines that carry the phase: sensor and harmonic
    comb: float  # mean over sensors of Σ_k ln(power/floor)
    runner_up: float  # the next best comb in the range
    track: AngleTrack
    rivals: tuple[float, ...] = ()  # mesh frequencies of other combs within a per cent that fit nearly as well [Hz]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeshLine:
    """One mesh line of one sensor, demodulated."""

    name: str
    harmonic: int
    weight: float
    times: np.ndarray  # [s], (m,)
    phase: np.ndarray  # of the mesh, less 2π·mesh_hz·t [rad], (m,)


def _transform(samples: Samples) -> tuple[np.ndarray, int]:
    """One-sided spectrum of a record without its mean, and how many values it is of."""
    values, _ = filled(samples.values, samples.values.size)
    n = fft.next_fast_len(values.size)
    return fft.rfft(values - values.mean(), n), n


def envelope(
    samples: Samples, spectrum: np.ndarray, n: int, frequency: float, half_width: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """The signal around one frequency, shifted to zero, at a low rate.

    spectrum, n  of `_transform`, (n//2 + 1,) complex
    returns times [s] (m,), complex values (m,), and the power of the line over the floor beside it
    """
    width = samples.rate / n
    centre = round(frequency / width)
    reach = max(4, round(half_width / width))
    if centre - 3 * reach < 0 or centre + 3 * reach >= spectrum.size:
        raise NotAvailable(f"a line at {frequency:g} Hz lies outside what {samples.rate:g} Hz sampling shows")
    inside = spectrum[centre - reach : centre + reach + 1] * np.hanning(2 * reach + 3)[1:-1]
    power = np.abs(spectrum[centre - reach : centre + reach + 1]) ** 2
    floor = np.median(np.abs(spectrum[centre - 3 * reach : centre + 3 * reach + 1]) ** 2) / np.log(2)
    if floor <= 0:
        raise NotAvailable(f"no signal around {frequency:g} Hz")
    m = 8 * reach
    low = np.zeros(m, dtype=complex)
    low[: reach + 1] = inside[reach:]
    low[-reach:] = inside[:reach]
    z = fft.ifft(low)
    times = np.arange(m) * n / samples.rate / m
    keep = times < samples.values.size / samples.rate
    z, times = z[keep], times[keep]
    z = z * np.exp(2j * np.pi * (centre * width - frequency) * times)
    return samples.start + times, z, float(power.sum() / (floor * power.size))


def line_phases(accelerations: Mapping[str, Samples], mesh_hz: float, half_width: float) -> list[MeshLine]:
    """The mesh lines of all sensors with their phases, best first."""
    found = []
    for name, samples in accelerations.items():
        spectrum, n = _transform(samples)
        for k in FOLLOWED[0]:
            try:
                times, z, strength = envelope(samples, spectrum, n, k * mesh_hz, half_width)
            except NotAvailable:
                continue
            phase = np.unwrap(np.angle(z)) / k
            line = MeshLine(
                name=f"accel/{name} mesh {k}", harmonic=k, weight=k**2 * strength, times=times, phase=phase
            )  # fmt: skip
            found.append(line)
    return sorted(found, key=lambda line: -line.weight)


def agreed_phase(lines: Sequence[MeshLine], half_width: float) -> Phase | None:
    """The mesh phase that most lines agree on, as their weighted mean.

    half_width  of the lines' envelopes [Hz]: twice its inverse is left out, half at each end
    returns times [s] (m,), phase less 2π·mesh·t [rad] (m,), the names of the lines that agree, and the
    standard deviation of the mesh frequency [Hz]: their scatter, at least a hundredth of a spectral bin (a
    tenth for one line); None where fewer than 60 % of the lines agree
    """
    times = lines[0].times
    inner = (times > times[0] + 0.5 / half_width) & (times < times[-1] - 0.5 / half_width)
    if inner.sum() < 16:
        raise WindowError(f"{times[-1] - times[0]:.3g} s are too short to follow the phase of the mesh lines")
    t = times[inner]
    bin_width = 1 / (t[-1] - t[0])
    phases = np.array([np.interp(t, line.times, line.phase) for line in lines])
    phases -= phases.mean(axis=1, keepdims=True)
    slopes = np.polyfit(t, phases.T, 1)[0] / (2 * np.pi)
    middle = np.sort(slopes)[slopes.size // 2]
    agree = np.flatnonzero(np.abs(slopes - middle) < 0.1 * bin_width)  # not a non-gear tone, nor a lost phase
    if agree.size < LEAST_AGREED * slopes.size:
        return None
    agreeing = [lines[i] for i in agree.tolist()]
    share = np.array([line.weight for line in agreeing])
    share /= share.sum()
    scatter = float(np.sqrt(share @ (slopes[agree] - share @ slopes[agree]) ** 2))
    std = max(scatter, bin_width * (0.1 if agree.size == 1 else 0.01))
    return t, share @ phases[agree], tuple(line.name for line in agreeing), float(std)


def rival_spacing(
    accelerations: Mapping[str, Samples], track: AngleTrack, teeth: tuple[int, int]
) -> tuple[int, float, float]:
    """The best sideband spacing mesh/n with an n that belongs to neither wheel.

    Sidebands 1 to 3 on both sides of mesh harmonics 1 to 3; a line counts at most 5: none decides alone. An n
    belongs to a wheel if it is a multiple or a divisor of its tooth count.
    returns n, its mean ln(power/floor), and that of the pinion's own spacing
    """
    z1 = teeth[0]
    spacings = np.arange(8, 101)
    k, m, n = np.ix_(np.arange(1, 4), np.array([-3, -2, -1, 1, 2, 3]), spacings)
    place = (k + m / n).reshape(-1, spacings.size)
    score = np.zeros(spacings.size)
    counted = 0
    for samples in list(accelerations.values())[:MOST_SENSORS]:
        signal, per_turn = on_angle(samples, track, samples.values.size)
        if per_turn < 2 * 3.5 * z1:
            continue
        mesh_bin = signal.turns * z1  # bins per mesh order
        power = np.abs(fft.rfft(hann(signal.values.size) * (signal.values - signal.values.mean()))) ** 2
        level = np.minimum(over_floor(power[: int(4 * mesh_bin)], int(2 * signal.turns) | 1), 5.0)
        peak = power[: level.size] >= maximum_filter1d(power[: level.size], 7)  # not a strong line's flank
        level = maximum_filter1d(np.where(peak, level, 0.0), 3)
        score += level[np.clip(np.rint(place * mesh_bin).astype(int), 0, level.size - 1)].mean(axis=0)
        counted += 1
    score /= max(counted, 1)
    strange = np.array([not any(n % z == 0 or z % n == 0 for z in teeth) for n in spacings])
    best = int(np.argmax(np.where(strange, score, -1.0)))
    own = score[z1 - 8] if 8 <= z1 <= 100 else np.inf
    return int(spacings[best]), float(score[best]), float(own)


def mesh_track(rig: Rig, accelerations: Mapping[str, Samples]) -> AngleTrack:
    """The smoothed pinion angle from the mesh lines, with an arbitrary zero, by what the rig file gives."""
    z1, z2, nominal = rig.require(
        "the speed without an encoder",
        "gears.pinion.teeth",
        "gears.gear.teeth",
        "operating.pinion_speed_hz",
    )
    found = mesh_speed(accelerations, (int(z1), int(z2)), nominal)
    rivals = tuple(rival / z1 for rival in found.rivals)
    apart = max((abs(rival - found.track.speed) / 2 for rival in rivals), default=0.0)
    return replace(found.track, speed_std=max(found.mesh_std_hz / z1, apart), rivals=rivals)


def mesh_speed(accelerations: Mapping[str, Samples], teeth: tuple[int, int], nominal_hz: float) -> MeshSpeed:
    """Mesh frequency and smoothed pinion angle of one window from its accelerometers.

    nominal_hz  pinion speed [Hz], known to 3 %
    NotAvailable where no comb stands out.
    """
    z1 = teeth[0]
    wanted = f"{z1 * nominal_hz:.5g} Hz"
    usable = {k: s for k, s in accelerations.items() if np.isfinite(s.values).mean() > 0.9}
    if not usable:
        raise NotAvailable("the speed is not available: no encoder, and no accelerometer with 90 % valid samples")
    if max(s.rate for s in usable.values()) < 2 * 1.1 * z1 * nominal_hz:
        raise NotAvailable(f"the speed is not available: no sampling rate shows the mesh frequency near {wanted}")
    comb = comb_search(usable, z1 * nominal_hz, teeth)
    check_comb(comb, wanted)
    coarse = comb.frequency
    half_width = 0.4 * coarse / max(teeth)
    lines = line_phases(usable, coarse, half_width)
    there = [line for line in lines if line.weight > STANDS_OUT * line.harmonic**2]  # a dead sensor has none
    for among, harmonics in product((lines, there), FOLLOWED):
        followed = [line for line in among if line.harmonic in harmonics]
        agreed = agreed_phase(followed[:BEST_LINES], half_width) if followed else None
        if agreed is not None:
            break
    else:
        raise NotAvailable(
            f"the speed is not available: the mesh lines near {coarse:.2f} Hz do not agree on one speed; "
            f"does it change by more than {100 * half_width / coarse:.2g} % within the window?"
        )
    times, phase, names, std = agreed
    angle = (2 * np.pi * coarse * times + phase) / z1
    source = f"mesh lines of {names[0].split()[0]}"
    track = fit_track(angle, times, float(angle[0]), float(angle[-1]), source, TURNS_PER_KNOT)
    spacing, strength, own = rival_spacing(usable, track, teeth)
    if strength > max(CLEAR_SIDEBANDS, 1.2 * own):
        raise NotAvailable(
            f"the speed is not available: the lines near {wanted} have sidebands at 1/{spacing} of "
            f"{coarse:.2f} Hz, not at 1/{teeth[0]} or 1/{teeth[1]}; wrong tooth counts?"
        )
    return MeshSpeed(
        mesh_hz=track.speed * z1,
        mesh_std_hz=std,
        lines=names,
        comb=comb.score,
        runner_up=comb.next_score,
        track=track,
        rivals=comb.rivals,
    )
