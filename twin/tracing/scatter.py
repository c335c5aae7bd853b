"""How far a machine may differ from its rig file without anything being wrong with it: covariance of the mesh lines.

For one line of one channel over W windows of one speed, measured z and predicted m, both (W,):

    z = (1 + g)·m + b + ε        C = E[r·rᴴ] = ρ²·m·mᴴ + β²·1·1ᵀ + diag(2σ² + (κ·|m|)² + φ² + (τ·|m − m′|)²)

g, ρ   the machine's structure against the rig file's: one complex factor for all windows, and its size
b, β   the same in every window: the discs' graduation, the mean form of real teeth, and its size
κ      departure from window to window: speed and torque off their mean, the worn shape; grows with depth
φ      what unworn and slightly worn teeth do that no model has
τ      share of what teeth that differ make of the line, m′ without it, that is not known
σ      noise of the real and of the imaginary part

b and φ are stated as transmission error; the torque meter and the accelerometer hear them through the structure, P_k in
their unit per metre. With C the likelihood of a line is that of a circular complex Gaussian: −rᴴ·C⁻¹·r − ln det C.

The sizes: transmission error within 2, 5, 12 % for 21 degrees of freedom perturbed by ± 3 %, 3–8 % for a finite-element
machine of the same frequencies; the acceleration by half and more there, so that its own level says nothing until many
windows share the factor; the torque meter's line lies between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

COMMON = 0.05e-6  # β [m]
EACH = 0.03e-6  # φ [m]
TEETH = 0.25  # of what pitch errors or a crack make of a mesh line: they are fitted to the lines between
MODELLED = 0.08  # relative std of a fitted number of an effect, for what the twin's structure is off


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelScatter:
    """Sizes for one channel, by mesh harmonic; the last holds for all above."""

    structure: tuple[float, ...]  # ρ
    windows: tuple[float, ...]  # κ
    per_depth: float  # added to κ per metre of depth, times the harmonic [1/m]
    floor: float  # added to φ, in the channel's unit

    def sizes(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """ρ and κ of the first harmonics, (count,) each."""
        return _extended(self.structure, count), _extended(self.windows, count)


def _extended(values: tuple[float, ...], count: int) -> np.ndarray:
    return np.array([values[min(k, len(values) - 1)] for k in range(count)])


SCATTER = {
    "encoder": ChannelScatter(
        structure=(0.03, 0.06, 0.12, 0.25, 0.25), windows=(0.008, 0.02, 0.04, 0.08), per_depth=200.0, floor=0.0
    ),
    "torque": ChannelScatter(structure=(0.15, 0.3, 0.5), windows=(0.03, 0.06, 0.1), per_depth=200.0, floor=2e-3),
    "acceleration": ChannelScatter(structure=(0.6,), windows=(0.03, 0.03, 0.03, 0.05), per_depth=400.0, floor=0.01),
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Weight:
    """The inverse root of one line's covariance over the windows that have it."""

    root: np.ndarray  # L⁻¹ (W, W) with C = L·Lᴴ
    log_det: float

    def whitened(self, rest: np.ndarray) -> np.ndarray:
        """Real vector (2W,) of unit variance from a residual (W,)."""
        u = self.root @ rest
        return np.sqrt(2.0) * np.concatenate((u.real, u.imag))


def weight(
    channel: str,
    k: int,
    predicted: np.ndarray,
    std: np.ndarray,
    depth: np.ndarray,
    path: np.ndarray,
    group: np.ndarray,
    by_teeth: np.ndarray | float = 0.0,
) -> Weight:
    """Weight of line k (from 1) of a channel.

    predicted  m (W,)
    std        σ (W,)
    depth      of wear (W,) [m]
    path       P_k (W,), 1 for the encoders
    group      number of the speed that each window was taken at (W,): each has a factor of its own
    by_teeth   what teeth that differ from one another add to the prediction (W,)
    """
    scatter = SCATTER[channel]
    ρ, κ = (size[k - 1] for size in scatter.sizes(k))
    κ = κ + scatter.per_depth * k * depth
    each = 2 * std**2 + (κ * np.abs(predicted)) ** 2 + scatter.floor**2 + (EACH * path) ** 2
    C = np.diag(each + (TEETH * np.abs(by_teeth)) ** 2).astype(complex)
    C += COMMON**2 * np.outer(path, path)
    for g in np.unique(group):
        m = np.where(group == g, predicted, 0.0)
        C += ρ**2 * np.outer(m, m.conj())
    L = np.linalg.cholesky(C)
    root = np.linalg.inv(L)
    return Weight(root=root, log_det=float(2 * np.log(L.diagonal().real).sum()))
