"""Which effects on the mesh explain what all channels show at the mesh orders.

First the windows are fitted with wear alone. Where that leaves more than healthy machines do, every candidate is
tried with the wear it would cause; the one with the best evidence joins; then the rest are tried beside it, and so on,
while the evidence gains more than GAIN. Onset: the last window up to which wear alone, or what was found before, still
explains everything is where later effects may set in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import ceil, log

import numpy as np

from twin.effects import EFFECTS
from twin.effects.extended import extend
from twin.effects.response import Effect
from twin.errors import NotConverged, TwinError
from twin.model import Condition, Model
from twin.tracing.candidates import big_enough, mesh_trials, started
from twin.tracing.joint_fit import EffectTrial, JointFit, Problem, fit
from twin.tracing.observed import CHANNELS, Observed
from twin.wear.curve import MasterCurve
from twin.wear.profile import WornProfile

GAIN = 6.0  # nats that an effect must gain
ALIKE = GAIN  # within which two explanations are one class
OTHER_STRUCTURE = 40.0  # where the structure is not the rig file's and the encoders alone are believed
QUIET = 0.3  # misfit up to which nothing is sought: healthy machines of the rig's structure have 0.1 to 0.3
SOFT = -2.0  # of the calibrated stiffness, in spreads of its prior: something has softened the mesh
WORTH = 2.0  # nats in the first trial from which a candidate is tried with the wear that it causes
HOPELESS, WELL = 6.0, 0.5  # times the best misfit, at least this one, from which a candidate is not pursued
LEAST_UNTIL, UNTIL_STEP = 30e-6, 1.25  # [m], ratio
MOST_EFFECTS = 3
ROUNDS = 2  # of fitting and of wearing with what was fitted
JUMP = 2.5  # misfit of a window by itself from which something has set in
SHARPER = 3.0  # times the misfit of the windows before


@lru_cache(maxsize=12)  # of a sliced face some 10 MB each
def _curve(model: Model, effects: tuple[Effect, ...], condition: Condition, start: tuple, until: float) -> MasterCurve:
    """Wear with effects, from new flanks or from those of an earlier curve at a depth."""
    worn = extend(model, effects)
    begin = worn.unworn
    if start:
        before, depth = start
        begin = before.profile(depth)
    return MasterCurve.build(worn, condition, begin, until)


def wear_condition(windows: Sequence[Observed]) -> Condition:
    """The condition that the flanks are taken to have worn under: that of the first worn window."""
    return next((w.condition for w in windows if w.worn), windows[0].condition)


def wear_until(depth: float) -> float:
    """How deep curves are made where the deepest window has so much [m]: in steps, so that they serve later windows."""
    return LEAST_UNTIL * UNTIL_STEP ** max(0, ceil(log(1.4 * max(depth, 1e-9) / LEAST_UNTIL, UNTIL_STEP)))


def plain_curve(model: Model, windows: Sequence[Observed], depth: float) -> MasterCurve:
    """The wear without effects that a block of these windows starts from, to a depth [m] and beyond."""
    return _curve(model, (), wear_condition(windows), (), wear_until(depth))


def _rounded(effect: Effect) -> Effect:
    """The effect with its numbers to two digits: flanks worn by it are the same, and are computed once."""
    values = {}
    for parameter in effect.parameters:
        v = getattr(effect, parameter.name)
        values[parameter.name] = float(f"{v:.2g}") if isinstance(v, float) else v
    return replace(effect, **values)  # type: ignore[type-var]


@dataclass(eq=False)
class WearWithEffects:
    """Profiles by depth for whatever effects are in the twin, as `joint_fit.Profiles`."""

    model: Model
    condition: Condition
    until: float
    with_effects: tuple[tuple[Effect, float], ...] = ()  # that shape the wear, with their onsets
    onset_depth: dict[float, float] = field(default_factory=dict)

    def __call__(
        self, depth: float, effects: tuple[Effect, ...], window: Observed
    ) -> WornProfile | Sequence[WornProfile]:
        shaping = tuple((e, onset) for e, onset in self.with_effects if onset <= window.revolutions)
        if not window.worn:
            return self.model.unworn
        early = tuple(e for e, onset in shaping if onset == 0)
        curve = _curve(self.model, early, self.condition, (), self.until)
        late = [(e, onset) for e, onset in shaping if onset > 0]
        for effect, onset in late:
            start = min(self.onset_depth.get(onset, 0.0), depth)
            early = (*early, effect)
            curve = _curve(self.model, early, self.condition, (curve, float(f"{start:.2g}")), self.until)
        return curve.profile(max(depth, float(curve.depth[0]))).slices


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Candidate:
    """One effect tried."""

    trial: EffectTrial
    fit: JointFit
    wear: WearWithEffects
    gain: float  # ln evidence over the fit without it
    worn_with: bool = False  # whether the wear is that which the effect causes

    @property
    def big_enough(self) -> bool:
        return big_enough(self.trial.name, self.fit.numbers(self.trial)[0])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeshFindings:
    """What the mesh lines say."""

    model: Model
    windows: tuple[Observed, ...]
    base: JointFit  # wear alone
    best: JointFit  # with what was found
    found: tuple[Candidate, ...]  # in the order found
    table: tuple[tuple[str, float], ...]  # every candidate's gain over what was there when it was tried first
    runner_up: dict[str, tuple[str, float]]  # of each one found: the next best, and how far behind [nat]
    alike: dict[str, tuple[str, ...]] = field(default_factory=dict)  # of each one found: what it is hardly told from
    waiting: bool = False  # whether only the latest window breaks off: one more must show it


class MeshBlock:
    """The windows of one machine, ready to be explained."""

    def __init__(
        self,
        model: Model,
        windows: Sequence[Observed],
        depth: np.ndarray,
        phase: float,
        factors: Sequence[dict[str, np.ndarray]] | None = None,
        channels: tuple[str, ...] = CHANNELS,
    ) -> None:
        self.model, self.windows, self.depth, self.phase = model, tuple(windows), depth, phase
        self.factors, self.channels = factors, channels
        self.condition = wear_condition(windows)
        self.until = wear_until(float(depth.max(initial=0.0)))

    def least_gain(self, name: str) -> float:
        """Evidence that an effect needs [nat]: more where it is hardly visible, and of another structure."""
        own = EFFECTS[name].facts.detection.least_gain
        return max(GAIN, own, 0.0 if self.channels == CHANNELS else OTHER_STRUCTURE)

    def problem(
        self, trials: Sequence[EffectTrial], wear: WearWithEffects, windows: Sequence[int] | None = None
    ) -> Problem:
        chosen = range(len(self.windows)) if windows is None else windows
        return Problem(
            model=self.model,
            windows=[self.windows[i] for i in chosen],
            profiles=wear,
            trials=tuple(trials),
            channels=self.channels,
            factors=None if self.factors is None else [self.factors[i] for i in chosen],
        )

    def wear(self, effects: Sequence[tuple[Effect, float]] = (), fitted: JointFit | None = None) -> WearWithEffects:
        shaping = tuple((_rounded(e), onset) for e, onset in effects if e.facts.shapes_wear)
        depths: dict[float, float] = {}
        known = self.depth if fitted is None else fitted.depth
        for _, onset in shaping:
            if onset > 0:
                turns = np.array([w.revolutions for w in self.windows])
                order = np.argsort(turns)
                depths[onset] = float(np.interp(onset, turns[order], known[order]))
        return WearWithEffects(
            model=self.model, condition=self.condition, until=self.until, with_effects=shaping, onset_depth=depths
        )

    def fitted(
        self, trials: Sequence[EffectTrial], start: JointFit | None, rounds: int, worn: WearWithEffects | None = None
    ) -> tuple[JointFit, WearWithEffects]:
        """Trials fitted together, with the wear that they cause as of the round before, and that wear.

        worn  the wear of the start; with one round it is taken over, and a trial that sets in later joins it
        """
        shaping = any(t.facts.shapes_wear for t in trials)
        numbers = [np.array([f.start for f in t.free]) for t in trials]
        if start is not None:
            known = {t.name: start.numbers(t)[0] for t in start.trials}
            numbers = [known.get(t.name, u) for t, u in zip(trials, numbers, strict=True)]
        late = shaping and trials[-1].facts.shapes_wear and trials[-1].onset > 0  # long run in, as the flanks may be
        if rounds > 1 or late:
            wear = self.wear([(t.make(u), t.onset) for t, u in zip(trials, numbers, strict=True)], start)
        else:
            wear = worn or self.wear((), start)
        result = fit(self.problem(trials, wear), start, self.phase, self.depth)
        for _ in range(rounds - 1 if shaping else 0):
            # flanks that have worn in more than they should ask for less, and the other way about: half-way is closer
            numbers = [0.5 * (u + result.numbers(t)[0]) for t, u in zip(result.trials, numbers, strict=True)]
            wear = self.wear([(t.make(u), t.onset) for t, u in zip(trials, numbers, strict=True)], result)
            again = tuple(started(t, result.numbers(t)[0], t.onset) for t in result.trials)
            result = fit(self.problem(again, wear), replace(result, trials=again), self.phase, self.depth)
        return result, wear

    def onsets(self, trials: Sequence[EffectTrial], wear: WearWithEffects) -> list[float]:
        """Revolutions at which something may have set in: 0, and just before the first window that breaks off.

        None at all where that is the latest window: what one window shows may be that window's.
        """
        out = [0.0]
        order = sorted(range(len(self.windows)), key=lambda i: self.windows[i].revolutions)
        worn = [i for i in order if self.windows[i].worn]
        fresh = [i for i in order if not self.windows[i].worn]
        for count in range(1 if fresh else 3, len(worn)):
            prefix = [*fresh, *worn[:count]]
            following = [*prefix, worn[count]]
            try:
                before = self._misfit(prefix, trials, wear)
                after = self._misfit(following, trials, wear)
            except NotConverged:
                continue
            if before > JUMP:
                break
            if after > QUIET and after > SHARPER * max(before, 0.1):
                if count == len(worn) - 1 and len(worn) > 2:
                    return []
                out.append(0.5 * (self.windows[worn[count - 1]].revolutions + self.windows[worn[count]].revolutions))
                break
        return out

    def _misfit(self, chosen: Sequence[int], trials: Sequence[EffectTrial], wear: WearWithEffects) -> float:
        problem = self.problem(trials, wear, chosen)
        return fit(problem, None, self.phase, self.depth[list(chosen)]).misfit

    @cached_property
    def plain(self) -> tuple[JointFit, WearWithEffects]:
        """The fit with wear alone."""
        return self.fitted((), None, 1)

    def explained(
        self, skip: Sequence[str] = (), quiet: float = QUIET, kept: Sequence[EffectTrial] = ()
    ) -> MeshFindings:
        """The greedy search, until the misfit is below `quiet`; `kept` trials are in from the start.

        The gain of those kept is over wear alone, of all of them together.
        """
        base, wear = self.plain
        best = base
        if kept:
            best, wear = self.fitted(kept, base, ROUNDS)
        gain = best.log_evidence - base.log_evidence
        found: list[Candidate] = [Candidate(trial=t, fit=best, wear=wear, gain=gain) for t in best.trials]
        table: dict[str, float] = {}
        runner_up: dict[str, tuple[str, float]] = {}
        alike: dict[str, tuple[str, ...]] = {}
        waiting = False
        while len(found) < MOST_EFFECTS and (best.misfit > quiet or best.shared[0] < SOFT):
            present = tuple(best.trials)
            onsets = self.onsets(present, wear)
            if not onsets:
                waiting = True
                break
            tried: list[Candidate] = []
            for name, trial in mesh_trials().items():
                if name in skip or any(t.name == name for t in present):
                    continue
                for onset in onsets:
                    rival = min((c.fit.misfit for c in tried), default=best.misfit)
                    candidate = self._tried(replace(trial, onset=onset), present, best, wear, 1, rival)
                    if candidate is not None:
                        tried.append(candidate)
            refined: list[Candidate] = []
            leading = min((c.fit.misfit for c in tried), default=best.misfit)
            for candidate in sorted(tried, key=lambda c: -c.gain)[:4]:
                better = None
                promising = candidate.gain > WORTH and candidate.fit.misfit < HOPELESS * max(leading, WELL)
                if candidate.trial.facts.shapes_wear and promising and not candidate.worn_with:
                    numbers, _ = candidate.fit.numbers(candidate.fit.trials[-1])
                    again = started(candidate.trial, numbers, candidate.trial.onset)
                    better = self._tried(again, present, best, wear, ROUNDS, leading)
                # one that sets in has worn with the effect from its first round on: there the better fit stands
                late = candidate.trial.onset > 0 and better is not None and better.gain < candidate.gain
                refined.append(candidate if better is None or late else better)
            refined.sort(key=lambda c: -c.gain)
            for candidate in (*tried, *refined):
                name = candidate.trial.name
                table[name] = (
                    max(table.get(name, -np.inf), candidate.gain) if not found else table.get(name, candidate.gain)
                )
            usable = [c for c in refined if c.gain > self.least_gain(c.trial.name) and c.big_enough]
            if not usable:
                break
            chosen = usable[0]
            behind, alike[chosen.trial.name] = rivals(chosen, refined)
            if behind is not None:
                runner_up[chosen.trial.name] = behind
            found.append(chosen)
            best, wear = chosen.fit, chosen.wear
        return MeshFindings(
            model=self.model,
            windows=self.windows,
            base=base,
            best=best,
            found=tuple(found),
            table=tuple(sorted(table.items(), key=lambda item: -item[1])),
            runner_up=runner_up,
            alike=alike,
            waiting=waiting,
        )

    def _tried(
        self,
        trial: EffectTrial,
        present: Sequence[EffectTrial],
        best: JointFit,
        worn: WearWithEffects,
        rounds: int,
        rival: float,
    ) -> Candidate | None:
        """The trial beside those present; an effect that sets in also from the depths that would have gone on.

        rival  misfit of the best one tried before
        """
        starts = [(trial, best, rounds)]
        if trial.onset > 0 and rounds == 1:
            starts.append((trial, replace(best, depth=self._went_on(best.depth, trial.onset)), rounds))
        elif trial.facts.shapes_wear and rounds == 1:
            new = self._when_new(trial, present, best, HOPELESS * max(rival, WELL))
            if new is not None:
                starts.append((new, best, ROUNDS))
        results = []
        for first, start, count in starts:
            try:
                result, wear = self.fitted((*present, first), start, count, worn)
                results.append((result, wear, count > 1))
            except TwinError:
                continue
        if not results:
            return None
        result, wear, worn_with = max(results, key=lambda r: r[0].log_evidence)
        gain = result.log_evidence - best.log_evidence
        return Candidate(trial=result.trials[-1], fit=result, wear=wear, gain=gain, worn_with=worn_with)

    def _when_new(
        self, trial: EffectTrial, present: Sequence[EffectTrial], best: JointFit, worst: float
    ) -> EffectTrial | None:
        """The trial with the numbers that windows of new flanks ask for, whatever the wear.

        None where they are too small, or miss those windows by more than `worst`.
        """
        fresh = [i for i, w in enumerate(self.windows) if not w.worn]
        if not fresh:
            return None
        start = replace(best, depth=best.depth[fresh])
        try:
            result = fit(self.problem((*present, trial), self.wear(), fresh), start, self.phase, self.depth[fresh])
        except TwinError:
            return None
        if result.misfit > worst:
            return None
        numbers, _ = result.numbers(result.trials[-1])
        return started(trial, numbers, trial.onset) if big_enough(trial.name, numbers) else None

    def _went_on(self, depth: np.ndarray, onset: float) -> np.ndarray:
        """Depths (W,) as they would be had the wear rate of before the onset stayed [m]."""
        turns = np.array([w.revolutions for w in self.windows])
        before = (turns < onset) & np.array([w.worn for w in self.windows])
        if not before.any():
            return depth
        rate = float(np.sum(depth[before] * turns[before]) / np.sum(turns[before] ** 2))
        late = (turns >= onset) & ~before
        return np.where(late, rate * turns, depth)


def rivals(chosen: Candidate, tried: Sequence[Candidate]) -> tuple[tuple[str, float] | None, tuple[str, ...]]:
    """The best of all others and how far it is behind [nat]; the names that the chosen one is hardly told from."""
    others = sorted((c for c in tried if c.trial.name != chosen.trial.name), key=lambda c: -c.gain)
    alike = {c.trial.name for c in others if c.gain > chosen.gain - ALIKE and c.big_enough}
    behind = (others[0].trial.name, chosen.gain - others[0].gain) if others else None
    return behind, tuple(sorted(alike))
