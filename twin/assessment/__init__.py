"""What the twin says of a machine after a window: frozen data in SI, with the key that shows each field.

    state, assessment = step(rig, state, window, options)

Lengths are in metres, times in seconds, angles in radians, errors and shares as fractions of one. A quantity that
cannot be given is `Unavailable` with its reason, or None where the reason is given elsewhere in the same record.
What JSON shows of it, each field declares with its type (`key.py`); `service/contract/shape.py` makes the JSON.

This package imports nothing of the twin, so that every part of it may return these types.
"""

from twin.assessment.attribution import (
    Attribution,
    CalibrationAssessment,
    Candidate,
    DepthPair,
    EffectEvent,
    HeldOutBand,
    HeldOutLine,
    HeldOutResidual,
    SkippedWindow,
)
from twin.assessment.baseline import (
    BaselineAssessment,
    BaselineSufficiency,
    BaselineWindow,
    Compared,
    LeftOut,
    LineSideband,
    NotJudged,
    PossibleCause,
    Range,
    RawLimit,
    RawMeasure,
    SidebandLimit,
    SpectrumExcerpt,
    UnattributedLines,
    UnattributedSearch,
)
from twin.assessment.detectable import Detectable, FalseAlarms, SmallestSize
from twin.assessment.effects import (
    ChannelErrors,
    EffectAssessment,
    Evidence,
    Growth,
    HarmonicBand,
    HealthyErrors,
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
    PairRemainder,
    PairSpeed,
    PairSpeeds,
    RunOut,
    SharpStep,
    StatedRatio,
    Turns,
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
    WearGrowth,
    WearProfile,
)
from twin.assessment.whole import Assessment, CountEvent, Event, LifeEvent, UpdateEvent, WindowEvent
from twin.assessment.window import FusedEstimate, MethodEstimates, RmsEstimate, WindowAssessment
