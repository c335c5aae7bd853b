"""Measured mesh lines of several windows, arranged as they are compared with predicted ones.

L lines of all channels, one below the other, over W windows; the means of the transmission error beside them, as
differences between windows of one load and one mounting: their zero, its drift and what load adds are free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from twin.tracing.observed import CHANNELS, HARMONIC, HARMONICS, Observed
from twin.tracing.scatter import HealthyScatter


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ComparedLines:
    """Lines that at least one of the windows has."""

    kept: np.ndarray  # which of the lines of all channels (L,)
    channel: tuple[str, ...]  # of each line (L,)
    harmonic: np.ndarray  # of the mesh, from 1 (L,)
    measured: np.ndarray  # complex (L, W), 0 where a window lacks the line
    std: np.ndarray  # of the real and of the imaginary part (L, W), NaN where a window lacks the line
    parts: np.ndarray  # which windows have the line, for real and imaginary part (L, 2, W)

    @classmethod
    def of(cls, windows: Sequence[Observed], channels: tuple[str, ...]) -> ComparedLines:
        """The lines of these channels."""
        z = np.array([np.concatenate([w.lines[c] for c in CHANNELS]) for w in windows]).T
        σ = np.array([np.concatenate([w.std[c] for c in CHANNELS]) for w in windows]).T
        names = np.repeat(CHANNELS, [HARMONICS[c] for c in CHANNELS])
        there = np.isfinite(z) & np.isfinite(σ) & np.isin(names, channels)[:, None]
        kept = np.flatnonzero(there.any(axis=1))
        there = there[kept]
        return cls(
            kept=kept,
            channel=tuple(names[kept].tolist()),
            harmonic=HARMONIC[kept],
            measured=np.where(there, z[kept], 0.0),
            std=np.where(there, σ[kept], np.nan),
            parts=np.repeat(there[:, None, :], 2, axis=1),
        )

    @property
    def shape(self) -> tuple[int, int]:
        """L, W."""
        lines, windows = self.measured.shape
        return lines, windows

    def turned(self, phase: float) -> np.ndarray:
        """The measured lines (L, W) from the mesh's own zero, which is ahead of the encoder's by a phase [rad]."""
        return self.measured * np.exp(-1j * self.harmonic * phase)[:, None]

    def rows(self, lines: np.ndarray) -> np.ndarray:
        """Real and imaginary parts of whitened lines (L, W, c) for those windows that have them (n, c), times √2."""
        both = np.stack((lines.real, lines.imag), axis=1)
        return np.sqrt(2.0) * both[self.parts]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ComparedMeans:
    """Means of the transmission error."""

    measured: np.ndarray  # (W,) [m], 0 where there is none
    there: np.ndarray  # indices of the windows that are compared (V,)
    matrix: np.ndarray  # whitened differences between them (q, V)

    @classmethod
    def of(cls, windows: Sequence[Observed], load: np.ndarray, scatter: HealthyScatter) -> ComparedMeans:
        """Of windows with a known torque; load: their number of load and mounting (W,). None of no windows."""
        known = [w.mean if w.torque_known else None for w in windows] or [None] * load.size
        there = np.array([i for i, mean in enumerate(known) if mean is not None], dtype=int)
        measured = np.array([0.0 if mean is None else mean for mean in known])
        nothing = cls(measured=measured, there=there, matrix=np.empty((0, there.size)))
        if there.size < 2:
            return nothing
        turns = np.array([windows[i].revolutions for i in there])
        drift = scatter.mean_drift * (turns - turns.mean()) / max(float(np.ptp(turns)), 1.0)
        C = scatter.mean_std**2 * np.eye(turns.size) + np.outer(drift, drift)
        zeros = load[there][:, None] == np.unique(load[there])  # one unknown zero for each load
        contrasts = null_space(zeros.T.astype(float))
        if contrasts.shape[1] == 0:
            return nothing
        root = np.linalg.cholesky(contrasts.T @ C @ contrasts)
        return cls(measured=measured, there=there, matrix=np.linalg.solve(root, contrasts.T))

    def rows(self, means: np.ndarray) -> np.ndarray:
        """Whitened differences (q, c) of means (W, c) [m]."""
        if not self.matrix.size:
            return np.empty((0, means.shape[1]))
        seen = means[self.there]
        return self.matrix @ (seen - seen[0])
