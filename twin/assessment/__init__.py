"""What the twin says of a machine after a window: frozen data in SI, without the names or units of any interface.

    state, assessment = step(rig, state, window, options)

Lengths are in metres, times in seconds, angles in radians, errors and shares as fractions of one. A quantity that
cannot be given is `Unavailable` with its reason, or None where the reason is given elsewhere in the same record.
`service/contract/` turns an assessment into the names and units of the interface contract.

This package imports nothing of the twin, so that every part of it may return these types.
"""

from twin.assessment.attribution import (
    Attribution,
    CalibrationAssessment,
    DepthPair,
    EffectEvent,
    HeldOutBand,
    HeldOutLine,
    HeldOutResidual,
)
from twin.assessment.baseline import (
    BaselineAssessment,
    BaselineSufficiency,
    BaselineWindow,
    LineSideband,
    NotJudged,
    PossibleCause,
    SidebandLimit,
    SpectrumExcerpt,
    UnattributedLines,
    UnattributedSearch,
)
from twin.assessment.effects import (
    ChannelErrors,
    EffectAssessment,
    Evidence,
    Growth,
    HarmonicBand,
    HeldOutErrors,
    MovedLines,
    Residual,
    Unexplained,
)
from twin.assessment.encoder_pair import (
    BaseRadii,
    EncoderPair,
    MissedCount,
    PairCurve,
    PairSpeeds,
    RunOut,
    SharpStep,
    StatedRatio,
)
from twin.assessment.indicators import GearIndicators, SensorIndicators
from twin.assessment.mistake import Mistake
from twin.assessment.modulation import Modulation, SidebandPair
from twin.assessment.values import FLANKS, Interval, ParameterValue, SpectralLine, Unavailable
from twin.assessment.verdict import LevelExcess, VerdictWindow
from twin.assessment.wear import (
    EstablishedBefore,
    FlankProfile,
    InspectedDepth,
    InspectionResult,
    LevelReading,
    LevelWear,
    Life,
    LifeDate,
    ModelValidity,
    Preliminary,
    RateChange,
    RelationOrigin,
    Wear,
    WearProfile,
)
from twin.assessment.whole import Assessment, Event, LifeEvent, UpdateEvent, WindowEvent
from twin.assessment.window import FusedEstimate, MethodEstimates, RmsEstimate, WindowAssessment

__all__ = [
    "FLANKS",
    "Assessment",
    "Attribution",
    "BaseRadii",
    "BaselineAssessment",
    "BaselineSufficiency",
    "BaselineWindow",
    "CalibrationAssessment",
    "ChannelErrors",
    "DepthPair",
    "EffectAssessment",
    "EffectEvent",
    "EncoderPair",
    "EstablishedBefore",
    "Event",
    "Evidence",
    "FlankProfile",
    "FusedEstimate",
    "GearIndicators",
    "Growth",
    "HarmonicBand",
    "HeldOutBand",
    "HeldOutErrors",
    "HeldOutLine",
    "HeldOutResidual",
    "InspectedDepth",
    "InspectionResult",
    "Interval",
    "LevelExcess",
    "LevelReading",
    "LevelWear",
    "Life",
    "LifeDate",
    "LifeEvent",
    "LineSideband",
    "MethodEstimates",
    "MissedCount",
    "Mistake",
    "ModelValidity",
    "Modulation",
    "MovedLines",
    "NotJudged",
    "PairCurve",
    "PairSpeeds",
    "ParameterValue",
    "PossibleCause",
    "Preliminary",
    "RateChange",
    "RelationOrigin",
    "Residual",
    "RmsEstimate",
    "RunOut",
    "SensorIndicators",
    "SharpStep",
    "SidebandLimit",
    "SidebandPair",
    "SpectralLine",
    "SpectrumExcerpt",
    "StatedRatio",
    "UnattributedLines",
    "UnattributedSearch",
    "Unavailable",
    "Unexplained",
    "UpdateEvent",
    "VerdictWindow",
    "Wear",
    "WearProfile",
    "WindowAssessment",
    "WindowEvent",
]
