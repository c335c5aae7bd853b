"""Remaining life with its 5–95 % band, and one step of the filter that follows the wear rate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench_dynamics import CONDITION, reference_model
from benchmarks.peers.asking import Ask
from benchmarks.peers.programs.exchange import shortest, write_problem
from benchmarks.peers.rows import Row, off, row, within
from twin.updating.remaining_life import RemainingLife, remaining_life
from twin.updating.tracker import WearTrack
from twin.wear.curve import MasterCurve

INTERVAL, WINDOWS, BEGUN = 600.0, 22, 2  # revolutions between windows; windows; those before the filters are compared
SCATTER = 0.02  # of a measured work, of the last one
COMMON = 0.04  # relative standard deviation of what all depths are off by together
SAMPLES = PARTICLES = 1000
SEED = 15


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """Windows of a machine that wears at the rig file's coefficient."""

    revolutions: np.ndarray  # (n,)
    work: np.ndarray  # measured, (n,) [rad/N]
    std: float  # of each [rad/N]
    rate: float  # expected before the first [rad/N per revolution]

    def track(self, windows: int) -> WearTrack:
        """After so many windows."""
        track = WearTrack.unworn(self.rate)
        for n, x in zip(self.revolutions[:windows], self.work[:windows], strict=True):
            track = track.followed(float(n), float(x), self.std)
        return track


def measured(rate: float) -> Measured:
    revolutions = INTERVAL * np.arange(1, WINDOWS + 1)
    std = SCATTER * rate * revolutions[-1]
    work = rate * revolutions + 0.5 * std * np.random.default_rng(SEED).standard_normal(WINDOWS)
    return Measured(revolutions=revolutions, work=work, std=std, rate=rate)


def filter_problem(folder: Path, windows: Measured) -> Path:
    """The windows after the first ones, and what the Kalman filter adds to the covariance before each."""
    track, noises = windows.track(BEGUN), []
    start = track
    for n, x in zip(windows.revolutions[BEGUN:], windows.work[BEGUN:], strict=True):
        wander, steps = track.predicted(float(n)).var_rate - track.var_rate, float(n) - track.revolutions
        noises.append(wander * np.array([[steps**2, steps], [steps, 1.0]]))
        track = track.followed(float(n), float(x), windows.std)
    return write_problem(
        folder / "filters.npz", revolutions=windows.revolutions[BEGUN:], measured=windows.work[BEGUN:],
        std=windows.std, noises=np.array(noises), start_revolutions=start.revolutions,
        mean=np.array([start.work, start.rate]), particles=PARTICLES,
        covariance=np.array([[start.var_work, start.cov], [start.cov, start.var_rate]]),
    )  # fmt: skip


def band_agreement(life: RemainingLife, name: str) -> Callable[[Mapping[str, Any]], str]:
    own = (life.median, life.p05, life.p95)

    def said(values: Mapping[str, Any]) -> str:
        median, p05, p95 = (off(theirs, ours) for ours, theirs in zip(own, values[name], strict=True))
        return f"median {median}, p05 {p05}, p95 {p95}"

    return said


def state_agreement(track: WearTrack, name: str) -> Callable[[Mapping[str, Any]], str]:
    def said(values: Mapping[str, Any]) -> str:
        x, k = values[name]
        return f"work {within(x, track.work)}, rate {within(k, track.rate)}"

    return said


def rows(ask: Ask, folder: Path) -> list[Row]:
    model = reference_model(1024)
    K, dwell, end = model.rig.require("a life", "wear.K", "wear.dwell_time", "end_of_life.max_depth")
    curve = MasterCurve.build(model, CONDITION, model.unworn, end)
    windows = measured(K * dwell * 2 * np.pi * CONDITION.speed_hz)
    track, begun = windows.track(WINDOWS), windows.track(BEGUN)

    def lived() -> RemainingLife:
        found = remaining_life(track, curve, 0.0, end, COMMON)
        assert found.p05 < found.median < found.p95
        return found

    def followed() -> WearTrack:
        now = begun
        for n, x in later:
            now = now.followed(n, x, windows.std)
        return now

    later = list(zip(windows.revolutions[BEGUN:].tolist(), windows.work[BEGUN:].tolist(), strict=True))
    life = lived()
    problem = write_problem(
        folder / "life.npz", to_go=life.to_go, rate=life.rate, spread=life.spread, samples=SAMPLES
    )  # fmt: skip
    lives = ask("progpy", "life", problem)
    filters = ask("progpy", "filters", filter_problem(folder, windows))
    closed, step = shortest(lived, count=200), shortest(followed, count=20) / len(later)
    return [
        row(f"remaining life: MonteCarlo, {SAMPLES} samples in 60 steps", closed, lives, "steps",
            band_agreement(life, "steps")),
        row(f"remaining life: MonteCarlo, {SAMPLES} samples in one step", closed, lives, "one_step",
            band_agreement(life, "one_step")),
        row(f"remaining life: direct model, {SAMPLES} samples at once", closed, lives, "direct",
            band_agreement(life, "direct")),
        row("filter step: Kalman", step, filters, "kalman", state_agreement(track, "kalman")),
        row("filter step: unscented Kalman", step, filters, "unscented", state_agreement(track, "unscented")),
        row(f"filter step: {PARTICLES} particles", step, filters, "particles", state_agreement(track, "particles")),
    ]  # fmt: skip
