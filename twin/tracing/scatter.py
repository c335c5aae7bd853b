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

from twin.rig import Rig
from twin.rig_tolerances import Tolerances
from twin.thresholds import deciding

MODELLED = 0.08  # relative std of a fitted number of an effect, for what the structure of the twin is off


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


PERTURBED = "spread of predicted lines over 21 degrees of freedom perturbed by ±3 %, and one finite-element machine"
ESTIMATE = "an estimate, not derived; the tracing was tuned on T01–T58 with it"


@dataclass(frozen=True, slots=True, kw_only=True)
class LineScatter:
    """What healthy machines differ by in their mesh lines; a tuple goes by mesh harmonic."""

    common: float = deciding(0.05e-6, unit="m", meaning="β: graduation and mean tooth form", source=ESTIMATE)
    each: float = deciding(0.03e-6, unit="m", meaning="φ: what real teeth do that no model has", source=ESTIMATE)
    teeth: float = deciding(
        0.25,
        meaning="τ: share of what pitch errors or a crack make of a mesh line that is not known",
        source="pinion and gear one after the other agree with both together within it: test_tracing_teeth.py",
    )
    encoder_structure: tuple[float, ...] = deciding(
        (0.03, 0.06, 0.12, 0.25, 0.25), meaning="ρ of the transmission error", source=PERTURBED
    )
    torque_structure: tuple[float, ...] = deciding((0.15, 0.3, 0.5), meaning="ρ of the torque meter", source=PERTURBED)
    acceleration_structure: tuple[float, ...] = deciding((0.6,), meaning="ρ of the accelerometer", source=PERTURBED)
    encoder_windows: tuple[float, ...] = deciding(
        (0.008, 0.02, 0.04, 0.08), meaning="κ of the transmission error on new flanks", source=ESTIMATE
    )
    torque_windows: tuple[float, ...] = deciding(
        (0.03, 0.06, 0.1), meaning="κ of the torque meter on new flanks", source=ESTIMATE
    )
    acceleration_windows: tuple[float, ...] = deciding(
        (0.03, 0.03, 0.03, 0.05), meaning="κ of the accelerometer on new flanks", source=ESTIMATE
    )
    per_depth: float = deciding(
        200.0, unit="1/m", meaning="growth of κ with depth, times the harmonic", source=ESTIMATE
    )
    acceleration_per_depth: float = deciding(
        400.0, unit="1/m", meaning="the same of the accelerometer", source=ESTIMATE
    )
    torque_floor: float = deciding(2e-3, unit="N·m", meaning="added to φ of the torque meter", source=ESTIMATE)
    acceleration_floor: float = deciding(0.01, unit="m/s²", meaning="added to φ of the accelerometer", source=ESTIMATE)

    @classmethod
    def of_rig(cls, rig: Rig) -> LineScatter:
        """The scatter of machines within the rig file's tolerances: what the structure adds grows with their stiffness.

        The sizes above hold for the default tolerance; to first order the lines move in proportion to it.
        """
        wider = rig.tolerances.stiffness / Tolerances().stiffness
        usual = cls()
        if wider == 1:
            return usual
        return cls(
            encoder_structure=tuple(wider * ρ for ρ in usual.encoder_structure),
            torque_structure=tuple(wider * ρ for ρ in usual.torque_structure),
            acceleration_structure=tuple(wider * ρ for ρ in usual.acceleration_structure),
        )

    def of(self, channel: str) -> ChannelScatter:
        """The sizes of one channel."""
        on_housing = channel == "acceleration"
        return ChannelScatter(
            structure=getattr(self, f"{channel}_structure"),
            windows=getattr(self, f"{channel}_windows"),
            per_depth=self.acceleration_per_depth if on_housing else self.per_depth,
            floor=0.0 if channel == "encoder" else getattr(self, f"{channel}_floor"),
        )


DEFAULT = LineScatter()


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
    transfer: np.ndarray,
    group: np.ndarray,
    by_teeth: np.ndarray | float = 0.0,
    sizes: LineScatter = DEFAULT,
) -> Weight:
    """Weight of line k (from 1) of a channel.

    predicted  m (W,)
    std        σ (W,)
    depth      of wear (W,) [m]
    transfer   P_k (W,), 1 for the encoders
    group      number of the speed that each window was taken at (W,): each has a factor of its own
    by_teeth   what teeth that differ from one another add to the prediction (W,)
    sizes      what healthy machines differ by
    """
    scatter = sizes.of(channel)
    ρ, κ = (size[k - 1] for size in scatter.sizes(k))
    κ = κ + scatter.per_depth * k * depth
    each = 2 * std**2 + (κ * np.abs(predicted)) ** 2 + scatter.floor**2 + (sizes.each * transfer) ** 2
    C = np.diag(each + (sizes.teeth * np.abs(by_teeth)) ** 2).astype(complex)
    C += sizes.common**2 * np.outer(transfer, transfer)
    for g in np.unique(group):
        m = np.where(group == g, predicted, 0.0)
        C += ρ**2 * np.outer(m, m.conj())
    L = np.linalg.cholesky(C)
    root = np.linalg.inv(L)
    return Weight(root=root, log_det=float(2 * np.log(L.diagonal().real).sum()))
