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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.rig import Rig
from twin.rig_tolerances import Tolerances
from twin.scales import Scales
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


PITCH = "base pitch"  # errors of gears and discs grow with their size, not with their load
PERTURBED = "spread of predicted lines over 21 degrees of freedom perturbed by ±3 %, and one finite-element machine"
ESTIMATE = "an estimate, not derived; attribution was tuned on T01–T58 with it"


@dataclass(frozen=True, slots=True, kw_only=True)
class LineScatter:
    """What healthy machines differ by in their mesh lines, in shares of the machine; a tuple goes by mesh harmonic."""

    common: float = deciding(
        8.4684e-6, of=PITCH, meaning="β: graduation and mean tooth form", source=f"{ESTIMATE}: 0.05 µm"
    )
    each: float = deciding(
        5.0811e-6, of=PITCH, meaning="φ: what real teeth do that no model has", source=f"{ESTIMATE}: 0.03 µm"
    )
    mean_std: float = deciding(
        8.4684e-5,
        of=PITCH,
        meaning="scatter of the mean transmission error from window to window: torque wander, depth",
        source=f"{ESTIMATE}: 0.5 µm",
    )
    mean_drift: float = deciding(
        1.69369e-3,
        of=PITCH,
        meaning="drift of the discs' zeros over the whole campaign: heat, creep of a mounting",
        source=f"{ESTIMATE}: 10 µm",
    )
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
        1.18085,
        meaning="growth of κ with wear depth over base pitch, times the harmonic",
        source=f"{ESTIMATE}: 200 1/m",
    )
    acceleration_per_depth: float = deciding(
        2.36171, meaning="the same of the accelerometer", source=f"{ESTIMATE}: 400 1/m"
    )
    torque_floor: float = deciding(
        0.4, of="torque noise floor", meaning="added to φ of the torque meter", source=f"{ESTIMATE}: 2 mN·m"
    )
    acceleration_floor: float = deciding(
        5.0, of="acceleration noise floor", meaning="added to φ of the accelerometer", source=f"{ESTIMATE}: 0.01 m/s²"
    )

    def on(self, rig: Rig, scales: Scales) -> HealthyScatter:
        """The sizes on one machine; NotAvailable where its rig file does not suffice for the scales.

        What the structure adds holds for the default tolerance of stiffness and grows in proportion to the rig file's.
        """
        p, wider = scales.base_pitch, rig.tolerances.stiffness / Tolerances().stiffness
        floors = {
            "encoder": 0.0,
            "torque": self.torque_floor * scales.torque_noise,
            "acceleration": self.acceleration_floor * scales.acceleration,
        }
        return HealthyScatter(
            common=self.common * p,
            each=self.each * p,
            mean_std=self.mean_std * p,
            mean_drift=self.mean_drift * p,
            teeth=self.teeth,
            channels={
                channel: ChannelScatter(
                    structure=tuple(wider * ρ for ρ in getattr(self, f"{channel}_structure")),
                    windows=getattr(self, f"{channel}_windows"),
                    per_depth=(self.acceleration_per_depth if channel == "acceleration" else self.per_depth) / p,
                    floor=floor,
                )
                for channel, floor in floors.items()
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthyScatter:
    """The same for one machine, in SI."""

    common: float  # β [m]
    each: float  # φ [m]
    mean_std: float  # of the mean transmission error [m]
    mean_drift: float  # of its zero over a campaign [m]
    teeth: float  # τ
    channels: Mapping[str, ChannelScatter]

    @classmethod
    def of_rig(cls, rig: Rig, scales: Scales | None = None) -> HealthyScatter:
        """Of machines within the rig file's tolerances."""
        return LineScatter().on(rig, Scales.of(rig) if scales is None else scales)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Weights:
    """The inverse roots of the covariance of L lines over W windows."""

    root: np.ndarray  # L⁻¹ (L, W, W) with C = L·Lᴴ; that of an identity where a window lacks the line
    log_det: float  # Σ ln det C


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LineSizes:
    """What healthy machines differ by in each of L lines over W windows, as far as no prediction decides it."""

    there: np.ndarray  # which windows have the line (L, W)
    structure: np.ndarray  # ρ, squared, between windows of one speed, else 0 (L, W, W)
    windows: np.ndarray  # κ on new flanks (L, 1)
    per_depth: np.ndarray  # its growth with depth (L, 1) [1/m]
    fixed: np.ndarray  # what does not depend on the prediction: noise, graduation, floors (L, W, W)
    teeth: float  # τ

    @classmethod
    def of(
        cls,
        sizes: HealthyScatter,
        channel: Sequence[str],
        harmonic: np.ndarray,
        std: np.ndarray,
        transfer: np.ndarray,
        group: np.ndarray,
    ) -> LineSizes:
        """Of lines `harmonic` (L,) of channels (L,).

        std       σ (L, W), NaN where a window lacks the line
        transfer  P_k (L, W), 1 for the encoders
        group     number of the speed that each window was taken at (W,): each has a factor of its own
        """
        there = np.isfinite(std)
        scatter = [sizes.channels[name] for name in channel]
        both = [[size[k - 1] for size in s.sizes(k)] for s, k in zip(scatter, harmonic, strict=True)]
        ρ, κ = np.array(both).T
        floor = np.array([s.floor for s in scatter])[:, None]
        each = np.where(there, 2 * std**2 + floor**2 + (sizes.each * transfer) ** 2, 1.0)
        pairs = there[:, :, None] & there[:, None, :]
        shared = np.where(pairs, sizes.common**2 * (transfer[:, :, None] * transfer[:, None, :]), 0.0)
        same = pairs & (group[:, None] == group)
        return cls(
            there=there,
            structure=np.where(same, (ρ**2)[:, None, None], 0.0),
            windows=κ[:, None],
            per_depth=(np.array([s.per_depth for s in scatter]) * harmonic)[:, None],
            fixed=shared + each[:, :, None] * np.eye(group.size),
            teeth=sizes.teeth,
        )

    def weights(self, predicted: np.ndarray, depth: np.ndarray, by_teeth: np.ndarray) -> Weights:
        """The weights about a prediction.

        predicted  m (L, W)
        depth      of wear (W,) [m]
        by_teeth   what teeth that differ from one another add to the prediction (L, W)
        """
        κ = self.windows + self.per_depth * depth
        each = np.where(self.there, (κ * np.abs(predicted)) ** 2 + (self.teeth * np.abs(by_teeth)) ** 2, 0.0)
        C = self.structure * (predicted[:, :, None] * predicted.conj()[:, None, :])
        C += self.fixed
        C += each[:, :, None] * np.eye(depth.size)
        L = np.linalg.cholesky(C)
        diagonal = np.einsum("lii->li", L).real
        return Weights(root=np.linalg.inv(L), log_det=float(2 * np.log(diagonal).sum()))
