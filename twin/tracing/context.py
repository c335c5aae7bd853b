"""What every detector sees of a machine: its windows, the flanks they were recorded with, and what is found so far.

A detector takes a `TracingContext` and gives back `Findings`; it changes nothing. What is dear to compute (worn flanks,
windows turned back to one mounting of the discs) is computed when first asked for, once for all detectors.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from twin.effects.kept import RESPONSES
from twin.errors import NotAvailable
from twin.features.non_gear import NonGearFeatures
from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.required_evidence import DEFAULT, RequiredEvidence
from twin.rig import Rig
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.findings import Findings
from twin.tracing.mesh_wear import plain_curve
from twin.tracing.observed import Observed, observed
from twin.tracing.shaft_lines import without_order
from twin.tracing.shaft_remainder import ShaftLine, orders_of_force, shaft_lines
from twin.updating.history import WindowInput
from twin.updating.model_cache import nominal_model_of
from twin.wear.profile import WornProfile


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowThresholds:
    """Which windows take part in a trace, and how."""

    least_speed_share: float = deciding(
        0.5,
        of="median speed of all windows",
        meaning="slower windows are calibration tests: they are not searched for sidebands and impacts",
        source="not derived: calibration tests run at a fifth of the rated speed",
    )
    held_out_each: int = deciding(
        3, meaning="of so many windows one is kept from all fits", source="not derived: chosen"
    )
    least_to_hold_out: int = deciding(
        4, meaning="measurement windows from which any is held out", source="not derived: chosen"
    )
    disc_moved: float = deciding(
        10.0,
        of="gear once-per-turn error",
        meaning="jump of the mean transmission error from one window to the next that is a moved encoder disc's",
        source="15 µm on the reference rig: half an edge of a disc of 10,000 edges on its gear",
    )


TURNED_BY = (1, 2, 3)  # mesh lines of the transmission error that show by how much a disc was turned
THRESHOLDS = WindowThresholds()
NOTHING = Findings()


def held_out(measurement: Sequence[int], limits: WindowThresholds = THRESHOLDS) -> set[int]:
    """Indices of the windows that are kept from all fits: by their number, so that they stay the same.

    The first is always fitted: where its flanks are unworn, it shows the gears' geometry most clearly.
    """
    if len(measurement) < limits.least_to_hold_out:
        return set()
    each = limits.held_out_each
    return {i for i in measurement[1:] if (i - measurement[0]) % each == each - 1}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TracedWindow:
    """One window as it was given, and its mesh lines."""

    given: WindowInput
    observed: Observed

    @property
    def index(self) -> int:
        return self.observed.index

    @property
    def features(self) -> WindowFeatures:
        return self.given.features

    @property
    def condition(self) -> Condition:
        return self.observed.condition


@dataclass(eq=False, kw_only=True)
class WornWindows:
    """All windows of a history with the flanks that they were recorded with, on one mounting of the discs."""

    model: Model
    windows: tuple[TracedWindow, ...]
    depths: Mapping[int, float]  # by window [m]
    held_out: frozenset[int]
    phase: float  # of the mesh against the encoder's zero [rad]
    least_jump: float  # of the mean transmission error that is a moved disc's [m]

    @cached_property
    def profiles(self) -> dict[int, WornProfile]:
        """Flanks of each window as wear alone would leave them, by index."""
        curve = plain_curve(self.model, [w.observed for w in self.windows if w.index not in self.held_out])
        least = curve.start_depth
        return {
            w.index: curve.profile(max(self.depths.get(w.index, 0.0), least)) if w.observed.worn else self.model.unworn
            for w in self.windows
        }

    @cached_property
    def on_one_mounting(self) -> tuple[TracedWindow, ...]:
        """The windows, with a new mounting from each on whose mean transmission error has jumped as no wear can.

        Whoever moved a disc may have turned it: the mesh lines of every mounting are turned back to the first one's
        phase.
        """
        predicted, mounting = self._mountings()
        count = max(mounting.values(), default=0)
        if count == 0:
            return self.windows
        angles = [self._ahead(predicted, mounting, number) for number in range(count + 1)]
        out = []
        for w in self.windows:
            o, back = w.observed, angles[mounting[w.index]] - angles[0]
            lines = {name: y * np.exp(-1j * back * np.arange(1, y.size + 1)) for name, y in o.lines.items()}
            out.append(replace(w, observed=replace(o, mounting=mounting[w.index], lines=lines)))
        return tuple(out)

    def _mountings(self) -> tuple[dict[int, np.ndarray], dict[int, int]]:
        """Predicted lines of the transmission error and the number of the mounting, by window."""
        predicted, mounting = {}, {}
        last, count = None, 0
        for w in self.windows:
            o = w.observed
            response = RESPONSES.get(self.model, (), self.profiles[w.index], o.condition)
            predicted[w.index] = response.at_mesh(response.structure.transmission_error, max(TURNED_BY))
            if o.mean is not None and o.torque_known:
                offset = o.mean - response.mean_transmission_error
                if last is not None and abs(offset - last) > self.least_jump:
                    count += 1
                last = offset
            mounting[w.index] = count
        return predicted, mounting

    def _ahead(self, predicted: Mapping[int, np.ndarray], mounting: Mapping[int, int], number: int) -> float:
        """By how much the lines of a mounting are ahead of the phase [rad]."""
        seen = [
            w.observed
            for w in self.windows
            if mounting[w.index] == number and w.observed.worn and not w.observed.pinion_only
        ]
        angles = np.linspace(-np.pi, np.pi, 720, endpoint=False)
        score = np.zeros_like(angles)
        for o in seen:
            for k in TURNED_BY:
                z, m = o.lines["encoder"][k - 1], predicted[o.index][k - 1]
                if np.isfinite(z):
                    score += (np.conj(m) * z * np.exp(-1j * k * (self.phase + angles))).real
        return float(angles[np.argmax(score)])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TracingContext:
    """One machine's windows and what is found so far."""

    rig: Rig
    windows: tuple[TracedWindow, ...]  # all that could be read, calibration tests among them
    measurement: frozenset[int]  # indices of those at operating speed
    held_out: frozenset[int]  # indices of those that take no part in any fit
    skipped: tuple[tuple[int, str], ...] = ()  # windows that could not be read: index, and why
    depths: Mapping[int, float]  # wear depth of each window by index, as a start [m]
    phase: float | None  # of the mesh against the encoder's zero [rad]
    rejected: tuple[str, ...] = ()  # effects that an engineer has ruled out
    kept: tuple[AttributedEffect, ...] = ()  # effects that the mesh lines are fitted with from the start
    fixed: tuple[str, ...] = ()  # effects that an engineer has accepted or pinned: they stay, whatever they add
    tolerated: float = 0.0  # misfit of the mesh lines up to which no more effects are sought
    required: RequiredEvidence = DEFAULT  # that an effect must have
    scales: Scales
    worn: WornWindows | None  # None without a mesh phase
    findings: Findings = NOTHING

    @classmethod
    def of(
        cls,
        rig: Rig,
        history: Sequence[WindowInput],
        depths: Mapping[int, float],
        phase: float | None,
        *,
        rejected: Collection[str] = (),
        kept: Sequence[AttributedEffect] = (),
        fixed: Collection[str] = (),
        tolerated: float = 0.0,
        since_ns: int = 0,
        required: RequiredEvidence = DEFAULT,
        limits: WindowThresholds = THRESHOLDS,
    ) -> TracingContext:
        """The context of a history; NotAvailable where fewer than two measurement windows can be read.

        Arguments as in `trace`.
        """
        windows, skipped = _readable(rig, [w for w in history if w.features.start_time_ns >= since_ns])
        usual = np.median([w.condition.speed_hz for w in windows]) if windows else 0.0
        measurement = [w.index for w in windows if w.condition.speed_hz > limits.least_speed_share * usual]
        if len(measurement) < 2:
            unread = "; ".join(f"window {index}: {why}" for index, why in skipped)
            raise NotAvailable(
                "effects are not traced before two measurement windows" + (f" ({unread})" if unread else "")
            )
        out = frozenset(held_out(measurement, limits))
        first = next(w for w in windows if w.index in measurement)
        scales = Scales.of(rig, first.condition)
        worn = None
        if phase is not None:
            worn = WornWindows(
                model=nominal_model_of(rig),
                windows=windows,
                depths=depths,
                held_out=out,
                phase=phase,
                least_jump=limits.disc_moved * scales.once_per_turn[1],
            )
        return cls(
            rig=rig,
            windows=windows,
            measurement=frozenset(measurement),
            held_out=out,
            skipped=skipped,
            depths=depths,
            phase=phase,
            rejected=tuple(rejected),
            kept=tuple(kept),
            fixed=tuple(fixed),
            tolerated=tolerated,
            required=required,
            scales=scales,
            worn=worn,
        )

    @property
    def model(self) -> Model:
        """The rig file's model; NotAvailable where the rig file does not suffice."""
        return nominal_model_of(self.rig)

    @property
    def mesh_phase(self) -> float:
        """The phase of the mesh [rad]; NotAvailable where it is not known."""
        if self.phase is None:
            raise NotAvailable("no mesh phase is known")
        return self.phase

    @property
    def mounted(self) -> tuple[TracedWindow, ...]:
        """All windows, on one mounting of the discs."""
        return self._worn.on_one_mounting

    @property
    def profiles(self) -> dict[int, WornProfile]:
        """Flanks of each window as wear alone would leave them, by index."""
        return self._worn.profiles

    @property
    def fitting(self) -> tuple[TracedWindow, ...]:
        """Measurement windows that take part in fits."""
        return tuple(w for w in self.windows if w.index in self.measurement and w.index not in self.held_out)

    @property
    def fitting_mounted(self) -> tuple[TracedWindow, ...]:
        """The same, on one mounting of the discs."""
        indices = {w.index for w in self.fitting}
        return tuple(w for w in self.mounted if w.index in indices)

    @property
    def features(self) -> list[WindowFeatures]:
        """Of the windows that take part in fits."""
        return [w.features for w in self.fitting]

    @property
    def tooth_features(self) -> list[WindowFeatures]:
        """The same, without the transmission error's line at the order of a suspected ripple of the torque."""
        ripple = self.findings.force("torque")
        return self.free_features if ripple is None else without_order(self.free_features, round(ripple.order))

    @property
    def free_features(self) -> list[WindowFeatures]:
        """The features, without the transmission error's lines that a force on the shaft moves."""
        out = self.features
        for order in sorted(orders_of_force(self.shaft_lines, self.rig.teeth[0])):
            out = without_order(out, order)
        return out

    @property
    def shaft_lines(self) -> tuple[ShaftLine, ...]:
        """Lines at orders of the pinion that no displacement in the mesh makes, in the windows of fits."""
        return shaft_lines(self.model, self.features, self.scales)

    @property
    def non_gear(self) -> list[tuple[float, NonGearFeatures]]:
        """Revolutions and non-gear features of every measurement window that has them."""
        return [
            (w.features.revolutions or 0.0, w.given.non_gear)
            for w in self.windows
            if w.index in self.measurement and w.given.non_gear is not None
        ]

    def with_findings(self, findings: Findings) -> TracingContext:
        """The same machine with what has been found since."""
        return replace(self, findings=findings)

    @property
    def _worn(self) -> WornWindows:
        if self.worn is None:
            raise NotAvailable("no mesh phase is known")
        return self.worn


def _readable(rig: Rig, history: Sequence[WindowInput]) -> tuple[tuple[TracedWindow, ...], tuple[tuple[int, str], ...]]:
    """The windows whose mesh lines can be compared, and those that cannot with the reason."""
    windows, skipped = [], []
    for given in history:
        if given.torque_unknown is not None:
            skipped.append((given.index, f"the torque that its lines depend on is not known: {given.torque_unknown}"))
            continue
        try:
            seen = observed(rig, given.features, given.index, given.level_fault)
        except NotAvailable as reason:
            skipped.append((given.index, str(reason)))
            continue
        windows.append(TracedWindow(given=given, observed=seen))
    return tuple(windows), tuple(skipped)
