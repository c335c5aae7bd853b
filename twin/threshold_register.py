"""All deciding numbers of the program: every set of thresholds, in one tuple (twin/thresholds.py).

A set that is new has its line here; `tests/unit/test_threshold_register.py` finds one that has not, and numbers that
are compared with and are in no set.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from twin.attention import StatusLimits
from twin.baseline.causes import CauseThresholds
from twin.baseline.energy_breakdown import EnergyThresholds
from twin.baseline.findings import BaselineThresholds
from twin.baseline.learned import LearningThresholds
from twin.baseline.load_direction import LoadDirectionThresholds
from twin.baseline.low_frequency import LowFrequencyThresholds
from twin.baseline.modulation import NewModulationThresholds
from twin.baseline.off_line_changes import OffLineThresholds
from twin.baseline.operating import OperatingThresholds as BaselineOperatingThresholds
from twin.baseline.reading import ReadingThresholds
from twin.baseline.recordings import RecordingThresholds
from twin.baseline.repeats import RepeatThresholds
from twin.baseline.sensor_timing import TimingThresholds
from twin.baseline.spacing import SpacingThresholds
from twin.baseline.spacing_search import SpacingSearchThresholds
from twin.baseline.sufficiency import SufficiencyLimits
from twin.baseline.transfer_path import PathThresholds
from twin.baseline.turn_impacts import TurnImpactThresholds
from twin.baseline.usable import UsableThresholds
from twin.baseline.verdict import DiagnosisThresholds
from twin.detectability.machines import HealthySpread
from twin.detectability.nulls import NullThresholds
from twin.detectability.visible import SimulatedBlows
from twin.detectability.windows import NoiseOfFloor
from twin.effects.eccentricity import EccentricityDetection
from twin.effects.facts import DetectionThresholds
from twin.effects.mass_unbalance import MassUnbalanceDetection
from twin.effects.mesh_damping import MeshDampingDetection
from twin.effects.mesh_stiffness_loss import MeshStiffnessLossDetection
from twin.effects.misalignment import MisalignmentDetection
from twin.effects.profile_error import ProfileErrorDetection
from twin.effects.tooth_friction import ToothFrictionDetection
from twin.encoder_pair.assessing import RatioThresholds
from twin.encoder_pair.jumps import JumpThresholds
from twin.encoder_pair.motion import PairThresholds
from twin.established import EstablishedLimits, HysteresisLimits
from twin.fallen_count import FallenCountThresholds
from twin.features.baseline_drift import DriftThresholds
from twin.features.despike import SpikeThresholds
from twin.features.edge_counts import EdgeCountThresholds
from twin.features.edge_timing import EdgeTimingThresholds
from twin.features.end_of_range import RailThresholds
from twin.features.modulation import ModulationThresholds
from twin.features.non_gear import NonGearFeatureThresholds
from twin.features.off_orders import OffOrderThresholds
from twin.features.plausible import OperatingThresholds as PlausibleOperatingThresholds
from twin.features.pulses import PulseThresholds
from twin.gear_age import Newness
from twin.held_level import LevelHysteresis
from twin.inspected import InspectionLimits
from twin.instruments.bursts import BurstThresholds
from twin.instruments.delays import DelayThresholds
from twin.instruments.lost_contact import LostContactThresholds
from twin.instruments.seen import MeshPhaseThresholds
from twin.learned_limits import LearnedLimits
from twin.level_record import LevelAlarm
from twin.levels.relation import RelationLimits
from twin.levels.trials import TrialLimits
from twin.levels.wear_by_level import LevelLimits
from twin.plausibility.thresholds import LevelThresholds, SamplingThresholds, SpeedThresholds
from twin.required_evidence import NullTail, StatedRate
from twin.rig_notes import NoteLimits
from twin.same_flanks import SameFlanksThresholds
from twin.scales import UNITS, Scales
from twin.suitability import SuitabilityLimits
from twin.thresholds import ThresholdRow, rows_of
from twin.tracing.accelerometer_fault import AccelerometerFaultThresholds
from twin.tracing.change_detection import ChangeLimits
from twin.tracing.content_left import ContentLeftThresholds
from twin.tracing.context import WindowThresholds
from twin.tracing.crack_growth import CrackGrowthThresholds
from twin.tracing.detectors.crack import CrackThresholds
from twin.tracing.detectors.eccentricity import EccentricityThresholds
from twin.tracing.detectors.mesh import MeshThresholds
from twin.tracing.detectors.non_gear import NonGearThresholds
from twin.tracing.detectors.rattle import RattleThresholds
from twin.tracing.detectors.sensor import SensorThresholds
from twin.tracing.detectors.shaft_forces import ShaftForceThresholds
from twin.tracing.detectors.tooth_errors import ToothErrorThresholds
from twin.tracing.detectors.unknown import UnknownThresholds
from twin.tracing.earned import EarnedLimits
from twin.tracing.gain_change import GainDriftThresholds, MountChangeThresholds
from twin.tracing.healthy_lines import HealthyLimits
from twin.tracing.joining import JoiningLimits
from twin.tracing.joint_problem import JointFitThresholds
from twin.tracing.mean_step import MeanStepThresholds
from twin.tracing.mesh_fits import MeshSearchThresholds, MeshSearchWithDifferingTeethThresholds
from twin.tracing.mesh_laws import MeshLawThresholds
from twin.tracing.mesh_pruning import PruningThresholds
from twin.tracing.mesh_windows import OnsetThresholds
from twin.tracing.mount_resonance import MountThresholds
from twin.tracing.moved_lines import MovedLineLimits
from twin.tracing.phase_lock import PhaseLockThresholds
from twin.tracing.remounts import RemountLimits
from twin.tracing.scatter import LineScatter
from twin.tracing.schedule import ScheduleLimits
from twin.tracing.shaft_remainder import ShaftRemainderThresholds
from twin.tracing.size_laws import SizeLawThresholds
from twin.tracing.state import SearchStart
from twin.tracing.tooth_patterns import PatternThresholds
from twin.tracing.transfer_path import TransferPathThresholds
from twin.tracing.unexplained import VerdictLimits
from twin.tracing.unknown_entry import EntryThresholds
from twin.tracing.unknown_lines import UnknownLineThresholds
from twin.tracing.unnamed_content import UnnamedThresholds
from twin.updating.calibration import CalibrationFit, RigFilePrior
from twin.updating.carried_over import CarriedOver
from twin.updating.changing_speed import ChangingSpeed
from twin.updating.conditions import ConditionMatch, LevelComparison, RevolutionCount, SteadyTorque
from twin.updating.depth import DepthModel
from twin.updating.depth_band import BandModel
from twin.updating.depth_search import DepthSearch
from twin.updating.disc_remount import DiscRemount
from twin.updating.encoders import EncoderScatter
from twin.updating.half_width import HalfWidthFit
from twin.updating.inspected_wear import InspectionFaults
from twin.updating.joint_gauge import JointScatter
from twin.updating.life import LifeSpread
from twin.updating.measurement import DepthScatter
from twin.updating.model_cache import CurveDepths
from twin.updating.prediction import LearnedFactors
from twin.updating.rate_change import RateChangeLimits
from twin.updating.rate_histories import RateHistories
from twin.updating.remaining_life import LifeScatter
from twin.updating.running_time import RunningLimits
from twin.updating.segments import SegmentLimits
from twin.updating.tracker import RateDrift
from twin.updating.update import CalibrationWindows
from twin.verdict_age import VerdictAge
from twin.what_if import DutyLimits

SETS: tuple[type, ...] = (
    StatusLimits,
    VerdictAge,
    LevelHysteresis,
    DutyLimits,
    LearnedLimits,
    LevelAlarm,
    CauseThresholds,
    DiagnosisThresholds,
    EnergyThresholds,
    BaselineThresholds,
    LearningThresholds,
    NewModulationThresholds,
    BaselineOperatingThresholds,
    ReadingThresholds,
    RecordingThresholds,
    RepeatThresholds,
    RailThresholds,
    UsableThresholds,
    LoadDirectionThresholds,
    LowFrequencyThresholds,
    OffLineThresholds,
    TurnImpactThresholds,
    TimingThresholds,
    SpacingThresholds,
    SpacingSearchThresholds,
    SufficiencyLimits,
    PathThresholds,
    HealthySpread,
    SimulatedBlows,
    NullThresholds,
    NoiseOfFloor,
    StatedRate,
    NullTail,
    DetectionThresholds,
    EccentricityDetection,
    MassUnbalanceDetection,
    MeshDampingDetection,
    MeshStiffnessLossDetection,
    MisalignmentDetection,
    ProfileErrorDetection,
    ToothFrictionDetection,
    RatioThresholds,
    JumpThresholds,
    PairThresholds,
    SpikeThresholds,
    DriftThresholds,
    EdgeCountThresholds,
    EdgeTimingThresholds,
    ModulationThresholds,
    NonGearFeatureThresholds,
    OffOrderThresholds,
    PlausibleOperatingThresholds,
    PulseThresholds,
    RelationLimits,
    TrialLimits,
    LevelLimits,
    EstablishedLimits,
    HysteresisLimits,
    NoteLimits,
    LevelThresholds,
    SpeedThresholds,
    SamplingThresholds,
    ChangeLimits,
    EarnedLimits,
    MovedLineLimits,
    HealthyLimits,
    WindowThresholds,
    CrackThresholds,
    EccentricityThresholds,
    MeshThresholds,
    NonGearThresholds,
    RattleThresholds,
    SensorThresholds,
    ShaftForceThresholds,
    ToothErrorThresholds,
    AccelerometerFaultThresholds,
    UnknownThresholds,
    UnknownLineThresholds,
    EntryThresholds,
    ContentLeftThresholds,
    PhaseLockThresholds,
    ShaftRemainderThresholds,
    UnnamedThresholds,
    MeanStepThresholds,
    JoiningLimits,
    JointFitThresholds,
    MeshSearchThresholds,
    MeshSearchWithDifferingTeethThresholds,
    PruningThresholds,
    OnsetThresholds,
    RemountLimits,
    LineScatter,
    ScheduleLimits,
    SearchStart,
    PatternThresholds,
    GainDriftThresholds,
    MountChangeThresholds,
    MountThresholds,
    MeshLawThresholds,
    CrackGrowthThresholds,
    SizeLawThresholds,
    TransferPathThresholds,
    VerdictLimits,
    RigFilePrior,
    CalibrationFit,
    CarriedOver,
    ConditionMatch,
    Newness,
    RevolutionCount,
    LevelComparison,
    SteadyTorque,
    ChangingSpeed,
    FallenCountThresholds,
    SameFlanksThresholds,
    BurstThresholds,
    LostContactThresholds,
    DelayThresholds,
    MeshPhaseThresholds,
    DepthModel,
    BandModel,
    DepthSearch,
    DiscRemount,
    EncoderScatter,
    HalfWidthFit,
    InspectionFaults,
    InspectionLimits,
    JointScatter,
    SuitabilityLimits,
    LifeSpread,
    DepthScatter,
    CurveDepths,
    LearnedFactors,
    LifeScatter,
    RunningLimits,
    SegmentLimits,
    RateDrift,
    RateChangeLimits,
    RateHistories,
    CalibrationWindows,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class RegisterRow:
    """One deciding number with the module that uses it, and its size on one machine."""

    module: str
    row: ThresholdRow
    scaled: Any = None  # in SI; None where it is no share of a quantity of the machine, or that is not known
    scaled_unit: str = ""


def register(scales: Scales | None = None, sets: Iterable[type] = SETS) -> Iterator[RegisterRow]:
    """Every deciding number, set by set; with the sizes on one machine where its scales are given."""
    for kind in sets:
        module = kind.__module__.removeprefix("twin.")
        for row in rows_of(kind):
            scale = None if scales is None else scales.get(row.about.of)
            scaled = None if scale is None else _times(row.value, scale)
            unit = "" if scaled is None else UNITS[row.about.of]
            yield RegisterRow(module=module, row=row, scaled=scaled, scaled_unit=unit)


def _times(value: Any, scale: float) -> Any:
    return tuple(v * scale for v in value) if isinstance(value, tuple) else value * scale
