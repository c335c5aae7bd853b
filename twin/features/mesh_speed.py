"""Pinion speed and angle from the mesh lines of accelerometers, where there is no encoder.

    comb(f) = Σ_sensors Σ_k ln(P(k·f)/floor)            k = 1 … 5, the best f within 3 % of z1·nominal speed
    θ(t)    = Σ_l w_l·arg z_l(t)/(k_l·z1)               z_l the signal around a mesh line, demodulated

P     power spectrum; over its own floor every line counts alike, however the structure passes it on
z_l   complex envelope of line l (a sensor and a harmonic), narrower than the first sideband on either side
w_l   weight: k²·(power over floor)

The comb finds the mesh frequency to a fraction of a hertz, the phase follows it through the window. The
zero of the angle is arbitrary. Whether the fit holds is judged twice: the comb must stand out from every
other comb in the range, and where sidebands stand around the mesh lines, the spacing mesh/n that fits them
best must be one of a given wheel (n a multiple or a divisor of its tooth count).

Source   J. Urbanek, T. Barszcz, J. Antoni, Mech. Syst. Signal Process. 38 (2013) 13–30 (two steps);
         F. Combet, L. Gelman, Mech. Syst. Signal Process. 21 (2007) 2590–2606
Holds    nominal speed known to 3 %; steady speed; a rigid ratio of speed and mesh (no slip)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter1d, median_filter

from twin.errors import NotAvailable, WindowError
from twin.features.angle import AngleTrack, fit_track
from twin.features.gaps import filled
from twin.features.orders import hann
from twin.features.resample import on_angle
from twin.rig import Rig
from twin.windows import Samples

HARMONICS = 5
SEARCH = 0.03  # the mesh frequency is looked for this far from nominal, relative
SEGMENT = 2.0  # spectra are averaged over segments of this length [s]
STANDS_OUT = 1.7  # least ratio of the best comb to the next one
LEAST_COMB = 3.0  # least mean ln(power/floor) of one sensor's harmonics together
TURNS_PER_KNOT = 4.0
BEST_LINES = 6
MOST_SENSORS = 6  # whose sidebands are looked at
CLEAR_SIDEBANDS = 2.0  # mean ln(power/floor) from which sidebands speak for their spacing


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSpeed:
    """Mesh frequency found in a window, and whether to believe it."""

    mesh_hz: float
    mesh_std_hz: float  # scatter of the lines that it is the mean of
    lines: tuple[str, ...]  # the lines that carry the phase: sensor and harmonic
    comb: float  # mean over sensors of Σ_k ln(power/floor)
    runner_up: float  # the next best comb in the range
    track: AngleTrack


def averaged_power(samples: Samples) -> tuple[np.ndarray, float]:
    """Hann power spectrum averaged over overlapping segments, and its bin width [Hz]; → (n,), float."""
    values, _ = filled(samples.values, samples.values.size)
    n = min(values.size, round(SEGMENT * samples.rate))
    starts = range(0, values.size - n + 1, max(1, n // 2))
    values = values - values.mean()
    power = sum(np.abs(fft.rfft(hann(n) * values[a : a + n])) ** 2 for a in starts)
    return power, samples.rate / n


def over_floor(power, bins: int) -> np.ndarray:
    """ln(power/floor), at least 0, the floor being the median over `bins` neighbours; (n,) → (n,)."""
    floor = median_filter(power, size=bins, mode="reflect")
    return np.log(np.maximum(power / np.maximum(floor, 1e-300), 1.0))


def comb_search(accelerations: Mapping[str, Samples], nominal: float) -> tuple[float, float, float]:
    """The mesh frequency [Hz] near a nominal one [Hz] with the best comb, its score, and the next best score.

    The next best is taken outside twice the spectral resolution around the best.
    """
    total, frequency, width = None, None, 0.0
    for samples in accelerations.values():
        power, width = averaged_power(samples)
        if frequency is None:
            frequency = np.arange(nominal * (1 - SEARCH), nominal * (1 + SEARCH), width / (2 * HARMONICS))
            total = np.zeros(frequency.size)
        level = over_floor(power, 201)
        for k in range(1, HARMONICS + 1):
            if k * frequency[-1] < samples.rate / 2:
                total += np.interp(k * frequency / width, np.arange(level.size), level)
    total /= len(accelerations)
    best = int(np.argmax(total))
    others = np.abs(frequency - frequency[best]) > 4 * width
    return float(frequency[best]), float(total[best]), float(total[others].max(initial=0.0))


def envelope(samples: Samples, frequency: float, half_width: float) -> tuple[np.ndarray, np.ndarray, float]:
    """The signal around one frequency, shifted to zero, at a low rate.

    returns times [s] (m,), complex values (m,), and the power of the line over the floor beside it
    """
    values, _ = filled(samples.values, samples.values.size)
    n = fft.next_fast_len(values.size)
    spectrum = fft.rfft(values - values.mean(), n)
    width = samples.rate / n
    centre = round(frequency / width)
    reach = max(4, round(half_width / width))
    if centre - 3 * reach < 0 or centre + 3 * reach >= spectrum.size:
        raise NotAvailable(f"a line at {frequency:g} Hz lies outside what {samples.rate:g} Hz sampling shows")
    inside = spectrum[centre - reach : centre + reach + 1] * np.hanning(2 * reach + 3)[1:-1]
    power = np.abs(spectrum[centre - reach : centre + reach + 1]) ** 2
    floor = np.median(np.abs(spectrum[centre - 3 * reach : centre + 3 * reach + 1]) ** 2) / np.log(2)
    m = 8 * reach
    low = np.zeros(m, dtype=complex)
    low[: reach + 1] = inside[reach:]
    low[-reach:] = inside[:reach]
    z = fft.ifft(low)
    times = np.arange(m) * n / samples.rate / m
    keep = times < values.size / samples.rate
    z, times = z[keep], times[keep]
    z = z * np.exp(2j * np.pi * (centre * width - frequency) * times)
    return samples.start + times, z, float(power.sum() / (floor * power.size))


def line_phases(
    accelerations, mesh_hz: float, half_width: float
) -> list[tuple[float, str, np.ndarray, np.ndarray]]:
    """Weight, name, times and mesh phase (less 2π·mesh_hz·t) of the best lines, best first."""
    found = []
    for name, samples in accelerations.items():
        for k in range(1, HARMONICS + 1):
            try:
                times, z, strength = envelope(samples, k * mesh_hz, half_width)
            except NotAvailable:
                continue
            phase = np.unwrap(np.angle(z)) / k
            found.append((k**2 * strength, f"accel/{name} mesh {k}", times, phase))
    return sorted(found, key=lambda line: -line[0])[:BEST_LINES]


def best_spacing(accelerations: Mapping[str, Samples], track: AngleTrack, z1: int) -> tuple[int, float]:
    """The whole number n for which sidebands spaced mesh/n stand out best, and their mean ln(power/floor).

    Sidebands 1 to 3 on both sides of mesh harmonics 1 to 3; a line counts at most 5: none decides alone.
    """
    spacings = np.arange(8, 101)
    k, m, n = np.ix_((1, 2, 3), (-3, -2, -1, 1, 2, 3), spacings)
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
        level = maximum_filter1d(level, 3)
        score += level[np.clip(np.rint(place * mesh_bin).astype(int), 0, level.size - 1)].mean(axis=0)
        counted += 1
    best = int(np.argmax(score))
    return int(spacings[best]), float(score[best] / max(counted, 1))


def mesh_track(rig: Rig, accelerations: Mapping[str, Samples]) -> AngleTrack:
    """The smoothed pinion angle from the mesh lines, with an arbitrary zero, by what the rig file gives."""
    z1, z2, nominal = rig.require(
        "the speed without an encoder",
        "gears.pinion.teeth",
        "gears.gear.teeth",
        "operating.pinion_speed_hz",
    )
    found = mesh_speed(accelerations, (int(z1), int(z2)), nominal)
    return replace(found.track, speed_std=found.mesh_std_hz / z1)


def mesh_speed(accelerations: Mapping[str, Samples], teeth: tuple[int, int], nominal_hz: float) -> MeshSpeed:
    """Mesh frequency and smoothed pinion angle of one window from its accelerometers.

    nominal_hz  pinion speed [Hz], known to 3 %
    NotAvailable where no comb stands out.
    """
    z1 = teeth[0]
    wanted = f"{z1 * nominal_hz:.5g} Hz"
    usable = {k: s for k, s in accelerations.items() if np.isfinite(s.values).mean() > 0.9}
    if not usable:
        raise NotAvailable(
            "the speed is not available: no encoder, and no accelerometer with 90 % valid samples"
        )
    if max(s.rate for s in usable.values()) < 2 * 1.1 * z1 * nominal_hz:
        raise NotAvailable(
            f"the speed is not available: no sampling rate shows the mesh frequency near {wanted}"
        )
    coarse, comb, runner_up = comb_search(usable, z1 * nominal_hz)
    if comb < LEAST_COMB or comb < STANDS_OUT * runner_up:
        raise NotAvailable(
            f"the speed is not available: no comb of mesh lines stands out within "
            f"{100 * SEARCH:g} % of {wanted} (best {comb:.1f} at {coarse:.2f} Hz, next {runner_up:.1f}, "
            f"needed {STANDS_OUT:g} times that and {LEAST_COMB:g}); wrong tooth count or nominal speed?"
        )
    half_width = 0.4 * coarse / max(teeth)
    lines = line_phases(usable, coarse, half_width)
    times, phase, slopes, weights, names = lines[0][2], 0.0, [], [], []
    inner = (times > times[0] + 0.5 / half_width) & (times < times[-1] - 0.5 / half_width)
    if inner.sum() < 16:
        raise WindowError(f"{times[-1] - times[0]:.3g} s are too short to follow the phase of the mesh lines")
    for weight, name, line_times, line_phase in lines:
        p = np.interp(times, line_times, line_phase)[inner]
        slope = np.polyfit(times[inner], p, 1)[0] / (2 * np.pi)
        if slopes and abs(slope - slopes[0]) > 1e-3 * coarse:
            continue  # lost its phase on the way
        slopes.append(slope)
        weights.append(weight)
        names.append(name)
        phase = phase + weight * (p - p.mean())
    share = np.array(weights) / sum(weights)
    phase = phase / sum(weights)
    mean = float(share @ np.array(slopes))
    scatter = float(np.sqrt(share @ (np.array(slopes) - mean) ** 2))
    t = times[inner]
    angle = (2 * np.pi * coarse * t + phase) / z1
    track = fit_track(
        angle, t, float(angle[0]), float(angle[-1]), f"mesh lines of {names[0].split()[0]}", TURNS_PER_KNOT
    )
    bin_width = 1 / (t[-1] - t[0])
    std = max(
        scatter, bin_width * (0.1 if len(slopes) == 1 else 0.01)
    )  # lines of one machine share their wander
    spacing, strength = best_spacing(usable, track, z1)
    if strength > CLEAR_SIDEBANDS and not any(spacing % z == 0 or z % spacing == 0 for z in teeth):
        raise NotAvailable(
            f"the speed is not available: the lines near {wanted} have sidebands at 1/{spacing} of "
            f"{coarse:.2f} Hz, not at 1/{teeth[0]} or 1/{teeth[1]}; wrong tooth counts?"
        )
    return MeshSpeed(
        mesh_hz=track.speed * z1,
        mesh_std_hz=std,
        lines=tuple(names),
        comb=comb,
        runner_up=runner_up,
        track=track,
    )
