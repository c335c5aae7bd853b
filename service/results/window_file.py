"""A measurement window as one file: NumPy's archive, which `numpy.load` opens anywhere.

    about.json               start, quality, faults, slow channels, and rate or count of every channel
    accel/y6.npy, …          samples, or edge times

Every number comes back exactly as it was: samples are written as float32 where that loses nothing, which is so for
all that arrived in frames, and as float64 otherwise; edge times are float64. Nothing is compressed: a file would be a
quarter smaller, and writing and reading it take eight times as long.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from service.json_text import plain
from twin.windows import Edges, Fault, Samples, SlowValue, Window

SUFFIX = ".npz"
UNFINISHED = ".part"
ABOUT = "about.json"
KINDS = {"accel": "accelerations", "torque": "torques"}  # channel kinds with samples, and the window's field


def write_window(path: Path, window: Window) -> int:
    """Writes a window, whole or not at all, also where the machine loses its power; the file's size in bytes."""
    unfinished = path.with_suffix(UNFINISHED)
    try:
        with unfinished.open("wb") as file:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
                archive.writestr(ABOUT, json.dumps(_about(window), separators=(",", ":")))
                for label, values in _arrays(window).items():
                    buffer = io.BytesIO()
                    np.lib.format.write_array(buffer, values, allow_pickle=False)
                    archive.writestr(f"{label}.npy", buffer.getbuffer())
            file.flush()
            os.fsync(file.fileno())
        size = unfinished.stat().st_size
        unfinished.replace(path)
    except OSError:
        unfinished.unlink(missing_ok=True)
        raise
    return size


def sync_folder(folder: Path) -> None:
    """Makes the names of a folder's files durable, which those of the files' contents are not by themselves."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def read_window(path: Path) -> Window:
    """The window of a file; OSError, ValueError or KeyError where it cannot be read."""
    try:
        return _read(path)
    except (OSError, ValueError, KeyError, MemoryError):
        raise
    except Exception as error:  # zipfile, zlib, NumPy and its tokenizer raise a dozen kinds for what is damaged
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _read(path: Path) -> Window:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        about = json.loads(archive[ABOUT])
        arrays = {label: archive[label] for label in (*about["samples"], *about["edges"])}
    fields: dict[str, dict[str, Any]] = {"accelerations": {}, "torques": {}, "encoders": {}}
    for label, (rate, start) in about["samples"].items():
        kind, name = label.split("/", 1)
        values = arrays[label].astype(np.float64)
        fields[KINDS[kind]][name] = Samples(rate=rate, start=start, values=values)
    for label, (per_rev, first) in about["edges"].items():
        fields["encoders"][label.split("/", 1)[1]] = Edges(per_rev=per_rev, first_index=first, times=arrays[label])
    return Window(
        start_time_ns=about["start_time_ns"],
        **fields,
        slow={label: SlowValue(**values) for label, values in about["slow"].items()},
        faults=tuple(Fault(**fault) for fault in about["faults"]),
        quality=about["quality"],
    )


def _about(window: Window) -> Mapping[str, Any]:
    return plain(
        {
            "start_time_ns": window.start_time_ns,
            "quality": window.quality,
            "faults": [asdict(fault) for fault in window.faults],
            "slow": {label: asdict(value) for label, value in window.slow.items()},
            "samples": {label: (s.rate, s.start) for label, s in _samples(window).items()},
            "edges": {f"encoder/{shaft}": (e.per_rev, e.first_index) for shaft, e in window.encoders.items()},
        }
    )


def _samples(window: Window) -> dict[str, Samples]:
    return {f"{kind}/{name}": s for kind, field in KINDS.items() for name, s in getattr(window, field).items()}


def _arrays(window: Window) -> dict[str, np.ndarray]:
    out = {label: _smallest(s.values) for label, s in _samples(window).items()}
    return out | {f"encoder/{shaft}": np.asarray(e.times, dtype=np.float64) for shaft, e in window.encoders.items()}


def _smallest(values: np.ndarray) -> np.ndarray:
    """The values as float32 where that loses nothing."""
    with np.errstate(over="ignore"):
        single = np.asarray(values, dtype=np.float32)
    return single if np.array_equal(single.astype(np.float64), values, equal_nan=True) else np.asarray(values)
