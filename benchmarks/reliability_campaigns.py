"""Depth and life of recorded campaigns, window by window, against their truth."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.half_campaigns import Half
from benchmarks.reliability_scores import Scored, reached, scored
from benchmarks.scoring import read_truth, truth_beside, windows_of
from twin.assessment import Interval, Life, Wear
from twin.errors import TwinError
from twin.gear_age import NEWNESS
from twin.options import Options
from twin.quantiles import Z95
from twin.rig import Rig
from twin.state import State
from twin.step import step
from twin.updating.remaining_life import NORMAL
from twin.what_if import what_if

MARKS = {"half-life": 0.5, "end": 0.9}  # share of the life that is behind the machine
LEAST_WINDOWS = 3  # worn windows before a life is looked at
EARLY = 15e-6  # depths below it are also counted apart [m]
NEAR = 0.05, 2e-6  # aim: relative, absolute [m]
ASKED = (0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)


def kind_of(truth: dict[str, Any]) -> str:
    """Class of a campaign."""
    if truth["effects"]:
        return "with effects"
    if len({tuple(c) for c in truth["conditions"]}) > 1:
        return "changing conditions"
    return "running-in" if truth["wear"]["running_in_factor"] != 1 else "constant"


def of_campaign(path: Path) -> list[Scored]:
    """All scores of one recording, traced."""
    beside = truth_beside(path)
    assert beside is not None
    truth = read_truth(beside)
    rig, windows = windows_of(path)
    out: list[Scored] = []
    state = State()
    for window, own in zip(windows, truth["windows"], strict=True):
        try:
            state, _ = step(rig, state, window, Options(trace=True))
        except TwinError:
            continue
        if own["kind"] in ("wear", "measurement") and own["revolutions"] >= NEWNESS.revolutions:
            out += _of_window(path.stem, rig, state, truth, own)
    return out


def _of_window(name: str, rig: Rig, state: State, truth: dict[str, Any], own: dict[str, Any]) -> Iterator[Scored]:
    wear, true = state.latest.wear, 1e-6 * own["depth"]["combined_um"]
    if not isinstance(wear, Wear) or wear.method == "rms" or not true > 0:
        return
    named: dict[str, Any] = {"group": name[0], "kind": kind_of(truth), "campaign": name, "by": "gear-twin"}
    yield from _depth(wear, true, named)
    if isinstance(state.latest.life, Life) and state.memory.track.windows >= LEAST_WINDOWS:
        now = Half(name=name, rig=rig, state=state, truth=truth, revolutions=own["revolutions"])
        for what, share in MARKS.items():
            found = _life(now, state.latest.life, share)
            if found is not None:
                quantiles, left = found
                yield scored(
                    partial(_between, quantiles), left, reached(quantiles, ASKED, left), what=what,
                    preliminary=state.latest.life.preliminary is not None, **named,
                )  # fmt: skip


def _between(quantiles: list[float], probability: float) -> float:
    return float(np.interp(probability, ASKED, quantiles))


def _depth(wear: Wear, true: float, named: dict[str, Any]) -> Iterator[Scored]:
    """The depth of a window, normal on either side of its median; those near new once more."""
    depth = wear.depth["combined"]
    for what in ("depth", *(["depth below 15 µm"] if true < EARLY else [])):
        yield scored(
            lambda p: _normal(depth, p), true, _reached(depth, true), what=what,
            near=abs(_median(depth) - true) <= max(NEAR[0] * true, NEAR[1]),
            preliminary=wear.preliminary is not None, **named,
        )  # fmt: skip


def _median(band: Interval) -> float:
    assert band.median is not None
    return band.median


def _half_widths(band: Interval) -> tuple[float, float]:
    assert band.p95 is not None
    return max(_median(band) - band.p05, 1e-12) / Z95, max(band.p95 - _median(band), 1e-12) / Z95


def _normal(band: Interval, probability: float) -> float:
    z = NORMAL.inv_cdf(probability)
    return _median(band) + z * _half_widths(band)[z > 0]


def _reached(band: Interval, true: float) -> float:
    return NORMAL.cdf((true - _median(band)) / _half_widths(band)[true > _median(band)])


def _life(now: Half, life: Life, share: float) -> tuple[list[float], float] | None:
    """Stated quantiles and truth of the time to the depth at 1/share of the revolutions; None beyond the truth."""
    counts, depths = now.wear
    at = now.revolutions / share
    if at > counts[-1]:
        return None
    limit, left = float(np.interp(at, counts, depths)), now.time_to(at)
    wear = now.state.latest.wear
    assert isinstance(wear, Wear)
    if not _median(wear.depth["combined"]) < limit <= life.limit:
        return [0.0] * len(ASKED), left  # said to be reached already
    try:
        stated = what_if(now.rig, now.state, now.phases(), limit=limit)
    except TwinError:
        return None
    if stated.reason is not None:
        return None
    found = [stated.quantile(p) for p in ASKED]
    return [inf if q is None else q for q in found], left
