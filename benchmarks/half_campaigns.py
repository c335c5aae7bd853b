"""Campaigns assessed up to their middle, and the truth of what comes after.

States are kept by what they depend on, so that several evaluations read the same ones: the folder of the recordings
has states/NAME-DIGEST.json, the digest over the recording's name, the options and the sources of the twin.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.scoring import ROOT, read_truth, truth_beside, windows_of
from benchmarks.trace_campaigns.table import Row, spec_of
from twin.errors import TwinError
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.step import step
from twin.what_if import DutyPoint, Phase
from twin.windows import Window

STEPPED = (
    (1.0, 1.3),
    (1.0, 1.6),
    (1.0, 0.7),
    (1.25, 1.0),
    (1.2, 1.3),
    (0.8, 0.8),
)  # speed, torque


@dataclass(frozen=True, slots=True, kw_only=True)
class Half:
    """A campaign at one of its windows."""

    name: str
    rig: Rig
    state: State
    truth: dict[str, Any]
    revolutions: float  # of the latest window

    @property
    def wear(self) -> tuple[np.ndarray, np.ndarray]:
        """True combined depth [m] by revolutions since new, beyond the campaign under its last condition."""
        windows = measured(self.truth)
        counts = [w["revolutions"] for w in windows]
        depths = [w["depth"]["combined_um"] for w in windows]
        for depth, count in self.truth["end_of_life"].get("revolutions_to_depth_um", {}).items():
            if float(depth) > depths[-1]:
                counts.append(count)
                depths.append(float(depth))
        order = np.argsort(counts)
        return np.array(counts)[order], 1e-6 * np.array(depths)[order]

    def phases(self) -> tuple[Phase, ...]:
        """The duty to come: each condition until the middle between two windows, the last without end."""
        conditions = self.truth["conditions"]
        counts = [w["revolutions"] for w in measured(self.truth)]
        if len(conditions) != len(counts):  # they last for several windows each
            conditions = [_nearest(conditions, w) for w in measured(self.truth)]
        ends = [0.5 * (a + b) for a, b in pairwise(counts)]
        phases: list[Phase] = []
        begun = self.revolutions
        for (speed, torque), end in zip(conditions, [*ends, inf], strict=True):
            if end > begun:
                points = (DutyPoint(speed=speed, torque=torque),)
                last = phases[-1] if phases else None
                if last is not None and last.points == points:
                    phases[-1] = replace(last, duration=last.duration + (end - begun) / speed)
                else:
                    phases.append(Phase(points=points, duration=(end - begun) / speed))
                begun = end
        return tuple(phases)

    def time_to(self, revolutions: float) -> float:
        """Running time from the latest window to a count since new [s]."""
        left, time = revolutions - self.revolutions, 0.0
        for phase in self.phases():
            here = min(left, phase.duration * phase.speed)
            left, time = left - here, time + here / phase.speed
        return time


def _nearest(conditions: Sequence[Sequence[float]], window: dict[str, Any]) -> Sequence[float]:
    """The condition, speed [Hz] and torque [N·m], under which a window was measured."""
    here = window["speed_hz"], window["torque_nm"]
    return min(conditions, key=lambda c: sum(abs(value / at - 1) for value, at in zip(c, here, strict=True)))


def measured(truth: dict[str, Any]) -> list[dict[str, Any]]:
    """The truth of the measurement windows."""
    return [w for w in truth["windows"] if w["kind"] in ("wear", "measurement")]


def stepped_rows() -> tuple[Row, ...]:
    """Campaigns whose load or speed changes at their middle, and stays so."""
    rows = []
    for i, (fast, heavy) in enumerate(STEPPED, start=1):
        row = Row(name=f"S{i:02d}-step", seed=1_790_000 + 37 * i, kind="clean", windows=7)
        spec = spec_of(row)
        at, (condition,) = spec["windows"]["at_revolutions"], spec["conditions"]
        after = {
            "speed_hz": round(fast * condition["speed_hz"], 2), "torque_nm": round(heavy * condition["torque_nm"], 2)
        }  # fmt: skip
        ends = [0.5 * (a + b) for a, b in pairwise(at)]
        last = _middle(len(at))
        each = [{**(condition if j <= last else after), "until_revolutions": end} for j, end in enumerate(ends)]
        rows.append(replace(row, extra={"conditions": [*each, after]}))
    return tuple(rows)


def _middle(windows: int) -> int:
    """Number of the measurement window at which a campaign is cut, from 0."""
    return windows // 2


def half(path: Path, *, trace: bool = True, whole: bool = False, update: str = "fused") -> Half | None:
    """A campaign up to its middle, or to its end; None where no window of it could be used."""
    beside = truth_beside(path)
    assert beside is not None
    truth = read_truth(beside)
    rig, windows = windows_of(path)
    counts = [w["revolutions"] for w in measured(truth)]
    last = counts[-1] if whole else counts[_middle(len(counts))]
    taken = [w for w, own in zip(windows, truth["windows"], strict=True) if own["revolutions"] <= last]
    kept = path.parent / "states" / f"{path.stem}-{_digest(trace, update, len(taken))}.json"
    if kept.is_file():
        state = State.from_dict(json.loads(kept.read_text()))
    else:
        state = _assessed(rig, taken, Options(trace=trace, update=update))
        kept.parent.mkdir(exist_ok=True)
        kept.write_text(json.dumps(state.to_dict()))
    if not state.running:
        return None
    return Half(name=path.stem, rig=rig, state=state, truth=truth, revolutions=state.running[-1].revolutions)


def _assessed(rig: Rig, windows: Sequence[Window], options: Options) -> State:
    state = State()
    for window in windows:
        try:
            state, _ = step(rig, state, window, options)
        except TwinError:
            continue
    return state


@cache
def _sources() -> bytes:
    return hashlib.sha256(b"".join(p.read_bytes() for p in sorted((ROOT / "twin").rglob("*.py")))).digest()


def _digest(trace: bool, update: str, windows: int) -> str:
    return hashlib.sha256(_sources() + f"{trace} {update} {windows}".encode()).hexdigest()[:10]
