"""numpy and scipy alone: the features of a window, written by hand as a script for one machine would have them.

RMS in the band by one Fourier transform; acceleration on an even grid of the encoder's angle, by cubic splines or by
straight lines; its order spectrum over whole turns; synchronous averages of both gears; transmission error of the two
encoders and its order spectrum. No gap, no lost edge, no uncertainty of a line, no other line than the mesh's.

The angle for the acceleration is taken from one edge a turn, as with a tachometer: taken from all edges it holds the
transmission error of every tooth, which bends the grid at the very orders that are read from it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from exchange import Found, serve, shortest
from scipy.fft import rfft
from scipy.interpolate import CubicSpline

Interpolation = Callable[[np.ndarray, np.ndarray], Callable[[np.ndarray], np.ndarray]]
LINES = 10


def straight(x: np.ndarray, y: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda at: np.interp(at, x, y)


def band_rms(x: np.ndarray, rate: float, band: np.ndarray) -> float:
    lines = rfft(x - x.mean())
    low, high = (int(np.ceil(edge * x.size / rate)) for edge in band)
    return float(np.sqrt(2 * np.sum(np.abs(lines[low : high + 1]) ** 2)) / x.size)


def mesh_lines(values: np.ndarray, turns: int, teeth: int) -> np.ndarray:
    """Amplitudes of the mesh's first harmonics in a signal over whole turns."""
    spectrum = np.abs(rfft(values)) * (2 / values.size)
    return spectrum[teeth * turns * np.arange(1, LINES + 1)]


def features(problem: dict[str, Any], interpolation: Interpolation, every: int) -> dict[str, Any]:
    """All of them; the angle is taken from every so many edges of the pinion's encoder."""
    x, rate, start = problem["acceleration"], problem["rate"], problem["start"]
    z1, z2 = (int(z) for z in problem["teeth"])
    t1, t2 = problem["pinion_times"], problem["gear_times"]
    edges1, edges2 = problem["pinion_edges"], problem["gear_edges"]
    angle1 = 2 * np.pi * (problem["pinion_first"] + np.arange(t1.size)) / edges1
    angle2 = 2 * np.pi * (problem["gear_first"] + np.arange(t2.size)) / edges2
    ends = start, start + (x.size - 1) / rate
    inside = np.flatnonzero((t1 >= ends[0]) & (t1 <= ends[1]))
    first, last = angle1[inside[0]], angle1[inside[0] + (inside.size - 1) // every * every]
    time_at = interpolation(angle1[inside[0] :: every], t1[inside[0] :: every])
    signal = interpolation(start + np.arange(x.size) / rate, x)
    per_turn = int(rate * (t1[-1] - t1[0]) / (angle1[-1] - angle1[0]) * 2 * np.pi)

    def resampled(ratio: float, count: int) -> tuple[np.ndarray, int]:
        """The acceleration over whole turns of a gear that turns once in `ratio` turns of the pinion."""
        turns = int((last - first) / (2 * np.pi * ratio))
        return signal(time_at(first + 2 * np.pi * ratio / count * np.arange(turns * count))), turns

    of_pinion, turns = resampled(1.0, per_turn)
    of_gear, gear_turns = resampled(z2 / z1, round(per_turn * z2 / z1))
    common = np.flatnonzero((t1 >= t2[0]) & (t1 <= t2[-1]))
    whole = common.size // edges1
    common = common[: whole * edges1]
    error = problem["base_radius"] * (angle1[common] - interpolation(t2, angle2)(t1[common]) * z2 / z1)
    return {
        "rms": band_rms(x, rate, problem["band"]),
        "acceleration": mesh_lines(of_pinion, turns, z1),
        "transmission_error": mesh_lines(error - error.mean(), whole, z1),
        "pinion_average": of_pinion.reshape(turns, -1).mean(axis=0),
        "gear_average": of_gear.reshape(gear_turns, -1).mean(axis=0),
    }


def both(problem: dict[str, Any]) -> Found:
    times, values = {}, {}
    a_turn = int(problem["pinion_edges"])
    for name, by, every in (
        ("cubic", CubicSpline, a_turn),
        ("cubic_all", CubicSpline, 1),
        ("linear", straight, a_turn),
    ):
        times[name] = shortest(lambda by=by, every=every: features(problem, by, every))  # type: ignore[misc]
        found = features(problem, by, every)
        values[name] = {key: found[key] for key in ("rms", "acceleration", "transmission_error")}
    return times, values


if __name__ == "__main__":
    serve("scipy", {"features": both})
