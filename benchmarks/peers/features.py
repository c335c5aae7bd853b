"""Features of one window of 2.5 s at 25.6 kHz with two encoders."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.long_recording import write_long_recording
from benchmarks.peers.asking import Ask
from benchmarks.peers.programs.exchange import shortest, write_problem
from benchmarks.peers.rows import Row, off, row
from service.stream.sources.mcap import read_windows
from twin.features.angle import angle_track
from twin.features.extract import extract, reference
from twin.features.level import band_rms
from twin.features.lines import mesh_keys, read_lines
from twin.features.orders import synchronous_average
from twin.features.resample import on_angle, spline_response
from twin.features.transmission_error import transmission_error
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.windows import Window

LINES = 10  # mesh harmonics that are compared
TE_LINES = 4  # of transmission error: the others are small
SECONDS = 3.0  # of the recording that the window is taken from


def taken(folder: Path) -> tuple[Rig, Window]:
    """A rig and the last window of a recording at 25.6 kHz."""
    path = folder / "features.mcap"
    write_long_recording(path, SECONDS)
    rig, _, windows = read_windows(path)
    assert rig is not None
    return Rig.from_mapping(rig), windows[-1]


def same_alone(rig: Rig, window: Window) -> None:
    """What the script by hand computes and nothing else: level, mesh lines, averages, transmission error."""
    _, samples = reference(rig, window)
    band_rms(samples, rig.band)
    track, teeth, keys = angle_track(window.encoders["pinion"]), rig.teeth, mesh_keys(LINES, 0)
    signal, per_turn = on_angle(samples, track)
    read_lines(signal, keys, teeth, "m/s²", lambda orders: [(signal.values, spline_response(orders / per_turn))])
    for turns in (1.0, teeth[1] / teeth[0]):
        synchronous_average(signal, turns, int(per_turn * turns))
    error = transmission_error(window.encoders["pinion"], window.encoders["gear"], teeth, _base_radius(rig), track)

    def parts(orders: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        of_pinion, of_gear = error.responses(orders)
        return [(error.pinion.values, of_pinion), (-error.gear.values, of_gear)]

    read_lines(error.signal, keys, teeth, error.unit, parts)


def _base_radius(rig: Rig) -> float:
    return rig.gear_pair().base_radius[0]


def problem(folder: Path, rig: Rig, window: Window) -> Path:
    _, samples = reference(rig, window)
    pinion, gear = window.encoders["pinion"], window.encoders["gear"]
    return write_problem(
        folder / "features.npz", acceleration=samples.values, rate=samples.rate, start=samples.start,
        band=np.array(rig.band), teeth=np.array(rig.teeth), base_radius=_base_radius(rig),
        pinion_times=pinion.times, pinion_first=pinion.first_index, pinion_edges=pinion.per_rev,
        gear_times=gear.times, gear_first=gear.first_index, gear_edges=gear.per_rev,
    )  # fmt: skip


def agreement(own: WindowFeatures, name: str) -> Callable[[Mapping[str, Any]], str]:
    assert own.rms is not None and own.acceleration is not None and own.transmission_error is not None
    level, lines, error = own.rms, own.acceleration, own.transmission_error

    def said(values: Mapping[str, Any]) -> str:
        found = values[name]
        mesh = [found["acceleration"][k - 1] / abs(lines.at(k)) - 1 for k in range(1, LINES + 1)]
        te = [found["transmission_error"][k - 1] / abs(error.at(k)) - 1 for k in range(1, TE_LINES + 1)]
        return (
            f"RMS {off(found['rms'], level)}; mesh lines 1–{LINES} within {100 * max(map(abs, mesh)):.2g} %, those of "
            f"transmission error, 1–{TE_LINES}, within {100 * max(map(abs, te)):.2g} %"
        )

    return said


def rows(ask: Ask, folder: Path) -> list[Row]:
    rig, window = taken(folder)
    answer = ask("scipy", "features", problem(folder, rig, window))
    all_of_them = shortest(lambda: extract(rig, window))
    alone = shortest(lambda: same_alone(rig, window))
    own = extract(rig, window)
    shown = (
        ("all features; four by hand", all_of_them, "cubic"),
        ("four features, cubic splines", alone, "cubic"),
        ("four features, cubic, all edges", alone, "cubic_all"),
        ("four features, straight lines", alone, "linear"),
    )
    seconds = f"window of {window.duration:.1f} s: "
    return [row(seconds + what, time, answer, name, agreement(own, name)) for what, time, name in shown]
