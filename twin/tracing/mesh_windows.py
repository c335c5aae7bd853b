"""The windows of one machine, ready to be fitted with effects on the mesh and the wear that these cause.

Flanks wear by the effects, and the effects are fitted to the lines of worn flanks: the two are taken in turns, half-way
each time, since flanks that have worn in more than they should ask for less, and the other way about.

Onset: the last window up to which wear, or what was found before, still explains everything is where a further effect
may set in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects.addition import Addition
from twin.errors import NotConverged
from twin.model import Model
from twin.required_evidence import DEFAULT, RequiredEvidence
from twin.thresholds import deciding
from twin.tracing.joint_fit import JointFit, fit
from twin.tracing.joint_problem import EffectTrial, Problem, Profiles
from twin.tracing.mesh_trials import started
from twin.tracing.mesh_wear import WearWithEffects, rounded_addition, wear_condition, wear_until
from twin.tracing.observed import CHANNELS, Observed
from twin.tracing.scatter import HealthyScatter

ROUNDS = 2  # of fitting and of wearing with what was fitted
FEWEST_WITHOUT_NEW = 3  # worn windows, where none of new flanks is there to compare with


@dataclass(frozen=True, slots=True, kw_only=True)
class OnsetThresholds:
    """When the windows say that something has set in between two of them."""

    explained: float = deciding(
        2.5,
        meaning="misfit of the windows before up to which they count as explained without anything new",
        source="tuned on T01–T58",
    )
    breaks_off: float = deciding(
        0.3,
        meaning="misfit with the next window from which it may break off",
        source="the largest of healthy machines of the rig's structure: they reach 0.1 to 0.3 on T01–T58",
    )
    sharper: float = deciding(
        3.0, meaning="times the misfit of the windows before that the next one must reach", source="tuned on T01–T58"
    )
    least_before: float = deciding(
        0.1,
        meaning="misfit of the windows before that is assumed at least",
        source="the smallest of healthy machines of the rig's structure: they reach 0.1 to 0.3 on T01–T58",
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fitted:
    """A joint fit with the wear that it assumes."""

    fit: JointFit
    wear: WearWithEffects


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeshWindows:
    """The windows of one machine, ready to be explained."""

    model: Model
    windows: tuple[Observed, ...]
    depth: np.ndarray  # of wear (W,) [m], a start
    phase: float  # of the mesh against the zero of the encoder [rad], a start
    factors: Sequence[dict[str, np.ndarray]] | None = None  # of each window's lines, by effects of longer periods
    channels: tuple[str, ...] = CHANNELS
    scatter: HealthyScatter
    onset: OnsetThresholds = OnsetThresholds()
    required: RequiredEvidence = DEFAULT

    def problem(
        self, trials: Sequence[EffectTrial], profiles: Profiles, windows: Sequence[int] | None = None
    ) -> Problem:
        """What is fitted, of all windows or of some."""
        chosen = range(len(self.windows)) if windows is None else windows
        return Problem(
            model=self.model,
            windows=[self.windows[i] for i in chosen],
            profiles=profiles,
            trials=tuple(trials),
            channels=self.channels,
            factors=None if self.factors is None else [self.factors[i] for i in chosen],
            scatter=self.scatter,
        )

    def wear(self, effects: Sequence[Addition] = (), fitted: JointFit | None = None) -> WearWithEffects:
        """Wear with those of the effects that shape it, each stage from the depth reached by then."""
        shaping = tuple(rounded_addition(a) for a in effects if a.effect.facts.shapes_wear)
        depths: dict[float, float] = {}
        known = self.depth if fitted is None else fitted.depth
        for onset in {n for a in shaping for n in a.changes}:
            if onset > 0:
                turns = np.array([w.revolutions for w in self.windows])
                order = np.argsort(turns)
                depths[onset] = float(np.interp(onset, turns[order], known[order]))
        return WearWithEffects(
            model=self.model,
            condition=wear_condition(self.windows),
            until=wear_until(self.model, float(self.depth.max(initial=0.0))),
            with_effects=shaping,
            onset_depth=depths,
        )

    def plain(self) -> Fitted:
        """The fit with wear alone."""
        return self.fitted((), None, 1)

    def fitted(
        self, trials: Sequence[EffectTrial], start: JointFit | None, rounds: int, worn: WearWithEffects | None = None
    ) -> Fitted:
        """Trials fitted together, with the wear that they cause as of the round before; NotConverged.

        worn  the wear of the start; with one round it is taken over, and a trial that sets in later joins it
        """
        shaping = any(t.facts.shapes_wear for t in trials)
        numbers = [_starts(t) for t in trials]
        if start is not None:
            known = {t.name: start.numbers(t)[0] for t in start.trials}
            numbers = [known.get(t.name, u) for t, u in zip(trials, numbers, strict=True)]
            numbers = [u if u.size == len(t.free) else _starts(t) for t, u in zip(trials, numbers, strict=True)]
        late = shaping and trials[-1].facts.shapes_wear and trials[-1].onset > 0  # long run in, as the flanks may be
        if rounds > 1 or late:
            wear = self.wear([t.addition(u) for t, u in zip(trials, numbers, strict=True)], start)
        else:
            wear = worn or self.wear((), start)
        result = fit(self.problem(trials, wear), start, self.phase, self.depth)
        for _ in range(rounds - 1 if shaping else 0):
            numbers = [0.5 * (u + result.numbers(t)[0]) for t, u in zip(result.trials, numbers, strict=True)]
            wear = self.wear([t.addition(u) for t, u in zip(trials, numbers, strict=True)], result)
            again = restarted(result)
            result = fit(self.problem(again, wear), replace(result, trials=again), self.phase, self.depth)
        return Fitted(fit=result, wear=wear)

    def onsets(self, trials: Sequence[EffectTrial], wear: WearWithEffects) -> list[float]:
        """Revolutions at which something may have set in: 0, and just before the first window that breaks off.

        None at all where that is the latest window: what one window shows may be that window's.
        """
        out, limits = [0.0], self.onset
        order = sorted(range(len(self.windows)), key=lambda i: self.windows[i].revolutions)
        worn = [i for i in order if self.windows[i].worn]
        fresh = [i for i in order if not self.windows[i].worn]
        first = 1 if fresh else FEWEST_WITHOUT_NEW
        before = self._misfit([*fresh, *worn[:first]], trials, wear) if len(worn) > first else None
        for count in range(first, len(worn)):
            if before is None or before > limits.explained:
                break
            after = self._misfit([*fresh, *worn[: count + 1]], trials, wear)
            if after is None:
                break
            if after > limits.breaks_off and after > limits.sharper * max(before, limits.least_before):
                if count == len(worn) - 1 and len(worn) > 2:
                    return []
                out.append(0.5 * (self.windows[worn[count - 1]].revolutions + self.windows[worn[count]].revolutions))
                break
            before = after
        return out

    def _misfit(self, chosen: Sequence[int], trials: Sequence[EffectTrial], wear: WearWithEffects) -> float | None:
        """Misfit of some of the windows; None where they have no steady state."""
        try:
            return fit(self.problem(trials, wear, chosen), None, self.phase, self.depth[list(chosen)]).misfit
        except NotConverged:
            return None

    def extrapolated(self, depth: np.ndarray, onset: float) -> np.ndarray:
        """Depths (W,) as they would be had the wear rate of before the onset stayed [m]."""
        turns = np.array([w.revolutions for w in self.windows])
        before = (turns < onset) & np.array([w.worn for w in self.windows])
        if not before.any():
            return depth
        rate = float(np.sum(depth[before] * turns[before]) / np.sum(turns[before] ** 2))
        late = (turns >= onset) & ~before
        return np.where(late, rate * turns, depth)


def _starts(trial: EffectTrial) -> np.ndarray:
    """The free numbers that a trial starts from (n,)."""
    return np.array([f.start for f in trial.free])


def restarted(fitted: JointFit) -> tuple[EffectTrial, ...]:
    """The trials of a fit, starting where they have come to."""
    return tuple(started(t, fitted.numbers(t)[0], t.onset) for t in fitted.trials)
