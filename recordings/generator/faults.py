"""What may go wrong between the sensors and the recording: lost, repeated, disordered, spoilt frames.

A fault takes the frames of one channel of one window, as (log time, message) pairs in order, and returns
them as a broken instrument or network would have delivered them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from recordings.generator.schema import Number


@dataclass(frozen=True, slots=True)
class FaultKind:
    parameters: Mapping[str, Number]
    apply: Callable[[list, Mapping[str, Any], np.random.Generator], list]


def _lost(frames, p, rng):
    """Frames that never arrive; their sequence numbers are missing."""
    gone = set(rng.choice(len(frames), min(p["count"], len(frames)), replace=False))
    return [f for i, f in enumerate(frames) if i not in gone]


def _duplicate(frames, p, rng):
    """Frames that arrive twice."""
    twice = set(rng.choice(len(frames), min(p["count"], len(frames)), replace=False))
    return [f for i, frame in enumerate(frames) for f in ([frame, frame] if i in twice else [frame])]


def _disorder(frames, p, rng):
    """Frames that arrive after the one that follows them."""
    out = list(frames)
    for i in sorted(rng.choice(len(out) - 1, min(p["count"], len(out) - 1), replace=False)):
        out[i], out[i + 1] = out[i + 1], out[i]
    return out


def _nan(frames, p, rng):
    """Samples that are not numbers."""
    for _ in range(p["count"]):
        values = frames[rng.integers(len(frames))][1].values
        values[int(rng.integers(len(values)))] = np.nan
    return frames


def _clipping(frames, p, rng):
    """An amplifier that ends at a level [the channel's unit] below what the signal reaches."""
    for _, message in frames:
        values = np.clip(np.array(message.values), -p["level"], p["level"]).tolist()
        del message.values[:]
        message.values.extend(values)
    return frames


_COUNT = Number("", 1, 100000, 1, integer=True)

FAULTS: dict[str, FaultKind] = {
    "lost": FaultKind({"count": _COUNT}, _lost),
    "duplicate": FaultKind({"count": _COUNT}, _duplicate),
    "disorder": FaultKind({"count": _COUNT}, _disorder),
    "nan": FaultKind({"count": _COUNT}, _nan),
    "clipping": FaultKind({"level": Number("", 1e-6, 1e6)}, _clipping),
}
SAMPLES_ONLY = ("nan", "clipping")
