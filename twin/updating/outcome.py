"""What an update is asked to do, and what it returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.model import Condition, Model
from twin.quantiles import Z95
from twin.required_evidence import DEFAULT, RequiredEvidence
from twin.updating.depth import DepthEstimate
from twin.updating.depth_band import BAND, BandModel
from twin.updating.memory import Memory
from twin.updating.prediction import Expectation
from twin.updating.rms_update import RmsResult
from twin.wear.curve import MasterCurve

ACTS_ON_DEPTH = ("mesh", "teeth")  # effects on these change the mesh lines of the encoders


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateOptions:
    """How windows update the twin; the fields are those of `twin.step.Options`."""

    threshold: float  # relative error of the RMS above which a window updates the twin
    update: str  # "fused" or "rms": which method sets the depth
    update_until: float  # pinion revolutions after which the twin only predicts
    required: RequiredEvidence = DEFAULT  # evidence that an effect must have before it joins the twin


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateOutcome:
    """What a window did to the twin."""

    memory: Memory
    model: Model
    curve: MasterCurve
    condition: Condition
    kind: str  # "measurement" or "calibration"
    rms_measured: float | None  # [m/s²], None without a usable accelerometer
    rms_predicted: float  # before any update [m/s²]
    rms_after: float
    updated: bool
    depth: float  # combined, by the method in use [m]
    depth_band: tuple[float, float]  # 5 and 95 % [m]
    method: str  # what set the depth: "transmission error", "pinion encoder", "rms", "projection" or "unworn"
    estimate: DepthEstimate | None  # by the encoders, where they were there
    rms_result: RmsResult | None  # by the RMS, where a level was there
    rms_depth: float  # by the RMS alone [m]
    unworn: bool  # whether the flanks are known to be new
    age_known: bool  # whether the revolutions count from new flanks
    expectation: Expectation | None
    lines: np.ndarray  # predicted acceleration lines after the update (LINES,) [m/s²]
    torque_fault: str | None = None  # why the torque is doubtful
    notes: tuple[str, ...] = ()


def stated_std(estimate: DepthEstimate, memory: Memory, band: BandModel = BAND) -> float:
    """Standard deviation [m] that is stated of a depth by the encoders: its own, that of unworn flanks as its zero, and
    what the sizes of effects do to it.

    A band of an estimate that is not symmetric holds all of it already.
    """
    if estimate.band is not None:
        return estimate.std
    moved = any(a.effect.facts.acts_on in ACTS_ON_DEPTH for a in memory.effects)
    by_effects = band.effects * estimate.depth if moved else 0.0
    return float(np.hypot(np.hypot(estimate.stated_std, memory.zero_std), by_effects))


def depth_band(depth: float, std: float) -> tuple[float, float]:
    """5 and 95 % of a depth [m] with its standard deviation [m]."""
    return max(depth - Z95 * std, 0.0), depth + Z95 * std
