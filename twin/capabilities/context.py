"""What every capability is given, and the draft of the answer that they complete one after another."""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.assessment import (
    Assessment,
    CountEvent,
    EncoderPair,
    Event,
    Unavailable,
    Unexplained,
    WindowAssessment,
)
from twin.features.extract import WindowSignals
from twin.features.window_features import WindowFeatures
from twin.options import Options
from twin.rig import Rig
from twin.state import LatestParts, State
from twin.tracing.summary import attribution_of, effects_of
from twin.updating.conditions import kind_of
from twin.updating.history import WindowInput
from twin.windows import Window


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Context:
    """One window with all that is known of its machine."""

    rig: Rig
    state: State
    window: Window
    options: Options
    signals: WindowSignals  # of the window, computed where they are asked for
    input: WindowInput  # the window's features
    pair: EncoderPair | Unavailable | None  # motion of the encoder pair; None where it was not asked for
    restarted: CountEvent | None = None  # where the window's revolution count had begun again

    @property
    def features(self) -> WindowFeatures:
        return self.input.features

    @property
    def mesh_frequency(self) -> float | None:
        """Frequency of tooth engagement [Hz]; None without a speed or tooth count."""
        teeth, speed = self.rig.get("gears.pinion.teeth"), self.features.speed_hz
        return None if speed is None or teeth is None else speed * teeth


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Draft:
    """The state and the answer as the capabilities so far have left them."""

    state: State
    assessment: Assessment
    modelled: bool = False  # whether the twin of the machine was updated by this window
    judged: bool = False  # whether this window was assessed by what the machine is judged by

    @property
    def record(self) -> WindowAssessment:
        """The window's own record."""
        assert self.assessment.window is not None
        return self.assessment.window

    def with_parts(self, *, events: tuple[Event, ...] = (), **parts) -> Draft:
        """The draft with other parts of the answer, and more events."""
        return replace(
            self, assessment=replace(self.assessment, **parts, events=(*self.assessment.events, *events))
        )  # fmt: skip

    def with_latest(self, **parts) -> Draft:
        """The draft with other parts remembered for later windows."""
        return replace(self, state=replace(self.state, latest=replace(self.state.latest, **parts)))

    def noted(self, *notes: str) -> Draft:
        """The draft with more notes on the window."""
        return self.with_parts(window=replace(self.record, notes=(*self.record.notes, *notes)))


def carried_over(context: Context, reason: str) -> Draft:
    """The measured features of a window, with everything else as of the latest window that said something about it.

    reason  why the twin of the machine is not available, for parts that no window has said anything about yet
    """
    assessment = replace(answer_as_of(context.rig, context.state, reason), window=_measured(context, reason))
    return Draft(state=context.state, assessment=assessment)


def answer_as_of(rig: Rig, state: State, reason: str) -> Assessment:
    """The answer as the latest windows have left it, without a window's record; `reason` as in `carried_over`."""
    latest, tracing = state.latest, state.tracing
    missing = Unavailable(reason=reason)
    compared = latest.baseline
    return Assessment(
        window=None,
        wear=latest.wear or missing,
        life=latest.life or missing,
        residual=latest.residual or (missing if compared is None else compared.residual),
        effects=effects_of(rig, tracing) if compared is None else compared.effects,
        unexplained=_unexplained(latest, reason),
        calibration=latest.calibration or missing,
        attribution=attribution_of(tracing),
        baseline=None if compared is None else compared.baseline,
        encoder_pair=latest.encoder_pair,
        unattributed_lines=None if compared is None else compared.unattributed_lines,
        detectable=latest.detectable,
        verdict=state.rhythm.verdict_window(),
    )


def _unexplained(latest: LatestParts, reason: str) -> Unexplained:
    if latest.unexplained is not None:
        return latest.unexplained
    if latest.baseline is not None:
        return latest.baseline.unexplained
    return Unexplained(verdict="insufficient_data", reason=reason)


def _measured(context: Context, reason: str) -> WindowAssessment:
    """The record of a window by its features alone, with the reason why there is nothing more."""
    features = context.features
    calibrated = context.rig.calibrated(f"accel/{features.sensor}")
    raw = {} if calibrated else {"rms": f"the unit of accel/{features.sensor} is not known"}
    return WindowAssessment(
        index=context.state.windows_seen,
        kind=kind_of(features, context.rig),
        start_time_ns=features.start_time_ns,
        revolutions=features.revolutions,
        speed=features.speed_hz,
        torque=features.torque_nm,
        rms_measured=features.rms if calibrated else None,
        modelled=False,
        speed_std=features.speed_std_hz,
        speed_source=features.angle_from,
        mesh_frequency=context.mesh_frequency,
        mesh_bands=features.mesh_bands if calibrated else None,
        notes=(reason,),
        unavailable={**features.unavailable, **raw},
    )
