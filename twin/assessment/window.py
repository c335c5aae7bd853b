"""One measurement window: what was measured, predicted and updated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated

from twin.assessment.indicators import SensorIndicators
from twin.assessment.key import FILLED, HIDDEN, MICROMETRE, OPTIONAL, PERCENT, Key
from twin.assessment.values import Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class FusedEstimate:
    """Depth by the encoders, wear coefficient by the slope of depth over revolutions."""

    wear_coefficient: Annotated[float, Key("k_wear_per_n", null=True)]
    depth: Annotated[float, Key("wear_depth_um", MICROMETRE, "combined", null=True)]
    depth_std: Annotated[float | None, Key("std_um", MICROMETRE, "null where the lines do not bound the depth")]
    depth_from_lines: Annotated[
        float, Key("from_lines_um", MICROMETRE, "depth by the mesh lines alone [µm]", null=True)
    ]
    misfit: Annotated[float, Key(meaning="of the mesh lines, chi-square per line", null=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RmsEstimate:
    """Wear coefficient by the RMS of one accelerometer."""

    wear_coefficient: Annotated[float, Key("k_wear_per_n", null=True)]
    depth: Annotated[float, Key("wear_depth_um", MICROMETRE, "combined", null=True)]
    rms_predicted: Annotated[float, Key(null=True)]  # [m/s²]
    rms_after: Annotated[float, Key(null=True)]
    updated: bool
    converged: bool
    iterations: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodEstimates:
    """Both methods of updating; a method is absent where the window did not allow it."""

    fused: Annotated[FusedEstimate | None, Key(shown=FILLED)] = None
    rms: Annotated[RmsEstimate | None, Key(shown=FILLED)] = None


_key = partial(Key, shown=OPTIONAL)  # the record of a window that could not be used has few
_by_model = partial(Key, shown=lambda window: window.modelled)
_without_model = partial(Key, shown=lambda window: not window.modelled)
_ERROR = _key("error_percent", PERCENT, "100·(predicted − measured)/measured", after="rms_predicted")
_DEPTH = _key("wear_depth_um", MICROMETRE, "largest combined depth [µm]", after="k_wear_per_n")


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowAssessment:
    """One measurement window."""

    index: int
    kind: Annotated[str, Key(meaning="`measurement` or `calibration`")]
    start_time_ns: Annotated[int, _key(meaning="Unix time [ns]")]
    revolutions: Annotated[float | None, _key(meaning="of the pinion since new, at the window's middle")]
    speed: Annotated[float | None, _key("speed_hz", meaning="pinion speed [Hz]")]
    torque: Annotated[float | None, _key("torque_nm", meaning="input torque [N·m]")]
    rms_measured: Annotated[float | None, _key(meaning="reference accelerometer, in the rig's band [m/s²]")]
    rms_predicted: Annotated[float | None, _key(meaning="before any update in this window [m/s²]")] = None
    updated: Annotated[bool, _key(meaning="true where the error passed the threshold")] = False
    rms_after: Annotated[float | None, _key(meaning="predicted again after the update [m/s²]")] = None
    wear_coefficient: Annotated[float | None, _key("k_wear_per_n", meaning="Archard coefficient K [1/N]")] = None
    depth: Annotated[Interval | None, HIDDEN] = None  # combined [m]
    method: Annotated[str | None, _by_model(meaning="what set the depth")] = None  # "rms", "projection", …
    methods: Annotated[MethodEstimates | None, _by_model()] = None
    contact_loss: Annotated[
        float | None, _by_model("contact_loss_percent", PERCENT, "share of the mesh period without contact")
    ] = None
    modelled: Annotated[bool, HIDDEN] = True  # whether the twin of the machine was updated by this window
    speed_std: Annotated[float | None, _without_model("speed_std_hz")] = None
    speed_source: Annotated[str | None, _without_model("speed_from", meaning="the channel that gave the angle")] = None
    mesh_frequency: Annotated[float | None, _without_model("mesh_frequency_hz")] = None
    mesh_bands: Annotated[
        tuple[float | None, ...] | None,
        Key(
            meaning="RMS of the mesh harmonics' bands [m/s²]",
            shown=lambda window: not window.modelled or window.mesh_bands is not None,
        ),
    ] = None
    indicators: Annotated[Mapping[str, SensorIndicators], Key(meaning="by accelerometer", shown=FILLED)] = field(
        default_factory=dict
    )
    notes: Annotated[tuple[str, ...], _key()] = ()
    unavailable: Annotated[
        Mapping[str, str], _key("not_available", meaning="what the window does not have, and why")
    ] = field(default_factory=dict)

    @property
    def error(self) -> Annotated[float | None, _ERROR]:
        """(predicted − measured)/measured of the RMS before any update."""
        return _relative(self.rms_predicted, self.rms_measured)

    @property
    def error_after(self) -> Annotated[float | None, _by_model("error_after_percent", PERCENT, after="rms_after")]:
        """The same after the update."""
        return _relative(self.rms_after, self.rms_measured)

    @property
    def depth_median(self) -> Annotated[float | None, _DEPTH]:
        """The largest combined depth [m]."""
        return None if self.depth is None else self.depth.median

    @property
    def depth_p05(self) -> Annotated[float | None, _key("wear_depth_p05_um", MICROMETRE, after="wear_depth_um")]:
        """Its 5th percentile."""
        return None if self.depth is None else self.depth.p05

    @property
    def depth_p95(self) -> Annotated[float | None, _key("wear_depth_p95_um", MICROMETRE, after="wear_depth_p05_um")]:
        """Its 95th percentile."""
        return None if self.depth is None else self.depth.p95


def _relative(predicted: float | None, measured: float | None) -> float | None:
    return None if predicted is None or not measured else predicted / measured - 1
