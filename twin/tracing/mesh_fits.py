"""How a set of effects on the mesh is fitted to the windows, where teeth are all alike and where they differ.

Where all teeth are alike the lines are those of one mesh period (`AlikeTeeth`). Where they differ, pitch errors or a
crack multiply the lines by factors that depend on all else that is there (tooth_factors.py): a fit, then its factors,
then the fit again (`DifferingTeeth`). On the way the factors are those of pinion and gear one after the other; the most
promising effects get those of both together, over the hunting-tooth period, and the teeth fitted anew with them.

Source   D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 28 (evidence, Occam factors)
Limits   effects that act over one mesh period
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.errors import TwinError
from twin.thresholds import deciding
from twin.tracing.joint_fit import JointFit, fit
from twin.tracing.joint_problem import EffectTrial
from twin.tracing.mesh_trials import big_enough, plain, started
from twin.tracing.mesh_windows import ROUNDS, Fitted, MeshWindows, restarted
from twin.tracing.observed import CHANNELS
from twin.tracing.tooth_factors import factors_of
from twin.wear.profile import WornProfile

TUNED = "tuned on T01–T58"


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSearchThresholds:
    """When the search goes on, and when an effect is believed."""

    quiet_misfit: float = deciding(
        0.3,
        meaning="misfit up to which no effect is searched for",
        source="the largest of healthy machines of the rig's structure: they reach 0.1 to 0.3 on T01–T58",
    )
    least_gain: float = deciding(6.0, unit="nat", meaning="evidence that an effect must add", source=TUNED)
    share_of_explained: float = deciding(
        0.0,
        of="evidence explained before",
        meaning="evidence that an effect must add where much is explained already",
        source="not derived: not asked for where teeth are alike",
    )
    other_structure_gain: float = deciding(
        40.0,
        unit="nat",
        meaning="evidence that an effect must add where the structure is not the rig file's and only encoders are used",
        source=TUNED,
    )
    indistinguishable_within: float = deciding(
        6.0,
        unit="nat",
        meaning="evidence within which two explanations are indistinguishable",
        source="equal to least_gain: as much as an effect must add to be believed",
    )
    softened: float = deciding(
        -2.0,
        of="spread of the calibrated stiffness over healthy machines",
        meaning="calibrated stiffness below which something has softened the mesh, whatever the misfit",
        source="derivation: two standard deviations",
    )
    promising_gain: float = deciding(
        2.0, unit="nat", meaning="evidence from which an effect is tried with the wear that it causes", source=TUNED
    )
    hopeless_misfit: float = deciding(
        6.0, of="best misfit of the effects tried", meaning="misfit from which an effect is not pursued", source=TUNED
    )
    least_best_misfit: float = deciding(
        0.5, meaning="best misfit that is assumed at least where hopeless_misfit is applied", source=TUNED
    )
    large_number: float = deciding(
        0.1,
        of="prior spread of the fitted number",
        meaning="number that is worth starting from with the wear that it causes",
        source=TUNED,
    )
    most_effects: int = deciding(
        3, meaning="effects on the mesh that are searched for together", source="not derived: chosen"
    )
    most_refined: int = deciding(
        4, meaning="effects of each round that are fitted with all that they cause", source="not derived: chosen"
    )


ALIKE = MeshSearchThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSearchWithDifferingTeethThresholds(MeshSearchThresholds):
    """The same where teeth differ from one another: what they make of the lines is not known as well."""

    quiet_misfit: float = deciding(
        1.3,
        meaning="misfit up to which no effect is searched for",
        source="between two observed values on T01–T58: pitch errors leave less, another effect 2.3 and more",
    )
    least_gain: float = deciding(
        12.0,
        unit="nat",
        meaning="evidence that an effect must add",
        source="not derived: chosen as twice what it needs where teeth are alike",
    )
    share_of_explained: float = deciding(
        0.0625,
        of="evidence explained before",
        meaning="evidence that an effect must add where much is explained already",
        source="derivation: what teeth make of lines that an effect explains is known to a quarter (τ in scatter.py), "
        "and a quarter squared of their energy is 0.0625. On wide draw 1, next to friction and pitch errors, a profile "
        "error that is not there reaches 0.035 and a misalignment 0.048",
    )
    softened: float = deciding(
        -np.inf,
        of="spread of the calibrated stiffness over healthy machines",
        meaning="not used: the factors of the teeth move the calibrated stiffness, too",
        source="not derived: chosen",
    )
    most_refined: int = deciding(
        2, meaning="effects of each round that are fitted over the hunting-tooth period", source="not derived: chosen"
    )


DIFFERING = MeshSearchWithDifferingTeethThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Candidate:
    """One effect tried."""

    trial: EffectTrial
    fitted: Fitted
    gain: float  # ln evidence over the fit without it
    worn_with: bool = False  # whether the wear is that which the effect causes

    @property
    def fit(self) -> JointFit:
        return self.fitted.fit

    @property
    def numbers(self) -> np.ndarray:
        return self.fit.numbers(self.trial)[0]

    @property
    def big_enough(self) -> bool:
        return big_enough(self.trial.name, self.numbers)


class Fits(Protocol):
    """How sets of effects are fitted to the windows of a machine."""

    @property
    def windows(self) -> MeshWindows: ...

    @property
    def thresholds(self) -> MeshSearchThresholds: ...

    def together(self, trials: Sequence[EffectTrial], start: Fitted) -> Fitted:
        """Trials fitted together with all that they cause, from where they start; NotConverged."""
        ...

    def onsets(self, present: Fitted) -> list[float]:
        """Revolutions at which something more may have set in; none where only the latest window says so."""
        ...

    def screened(self, trials: Sequence[EffectTrial], present: Fitted) -> list[Candidate]:
        """Each of the trials together with what is present, quickly."""
        ...

    def refined(self, screened: Sequence[Candidate], present: Fitted) -> list[Candidate]:
        """The most promising with all that they cause."""
        ...


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AlikeTeeth:
    """Fits where all teeth are alike, or where what they differ by is given by fixed factors."""

    windows: MeshWindows
    thresholds: MeshSearchThresholds = ALIKE

    def together(self, trials: Sequence[EffectTrial], start: Fitted) -> Fitted:
        return self.windows.fitted(trials, start.fit, ROUNDS)

    def onsets(self, present: Fitted) -> list[float]:
        return self.windows.onsets(present.fit.trials, present.wear)

    def screened(self, trials: Sequence[EffectTrial], present: Fitted) -> list[Candidate]:
        found = {id(t): self._tried(t, present, 1) for t in trials}
        fresh = [f for t in trials if (f := self._of_new_flanks(t, present.fit)) is not None]
        for trial, start, misfit in sorted(fresh, key=lambda f: f[2]):  # whatever the order of the trials
            others = [c.fit.misfit for key, c in found.items() if c is not None and key != id(trial)]
            if misfit <= self._worst(min(others, default=present.fit.misfit)):
                again, first = self._tried(start, present, ROUNDS), found[id(trial)]
                if again is not None and (first is None or again.gain > first.gain):
                    found[id(trial)] = again
        return [c for c in found.values() if c is not None]

    def refined(self, screened: Sequence[Candidate], present: Fitted) -> list[Candidate]:
        out: list[Candidate] = []
        leading = min((c.fit.misfit for c in screened), default=present.fit.misfit)
        for candidate in sorted(screened, key=lambda c: -c.gain)[: self.thresholds.most_refined]:
            promising = candidate.gain > self.thresholds.promising_gain and candidate.fit.misfit < self._worst(leading)
            better = None
            if candidate.trial.facts.shapes_wear and promising and not candidate.worn_with:
                again = started(candidate.trial, candidate.numbers, candidate.trial.onset)
                better = self._tried(again, present, ROUNDS)
            # one that sets in has worn with the effect from its first round on: there the better fit is kept
            late = candidate.trial.onset > 0 and better is not None and better.gain < candidate.gain
            out.append(candidate if better is None or late else better)
        return out

    def _worst(self, leading: float) -> float:
        """Misfit from which an effect is not pursued, where the best one tried leaves `leading`."""
        return self.thresholds.hopeless_misfit * max(leading, self.thresholds.least_best_misfit)

    def _tried(self, trial: EffectTrial, present: Fitted, rounds: int) -> Candidate | None:
        """The trial with those present; one that sets in also from the depths that would have gone on."""
        best = present.fit
        starts = [best]
        if trial.onset > 0 and rounds == 1:
            starts.append(replace(best, depth=self.windows.extrapolated(best.depth, trial.onset)))
        results: list[Fitted] = []
        for start in starts:
            try:
                results.append(self.windows.fitted((*best.trials, trial), start, rounds, present.wear))
            except TwinError:
                continue
        if not results:
            return None
        fitted = max(results, key=lambda r: r.fit.log_evidence)
        gain = fitted.fit.log_evidence - best.log_evidence
        return Candidate(trial=fitted.fit.trials[-1], fitted=fitted, gain=gain, worn_with=rounds > 1)

    def _of_new_flanks(self, trial: EffectTrial, best: JointFit) -> tuple[EffectTrial, EffectTrial, float] | None:
        """A trial that shapes the wear, the same with the numbers that windows of new flanks ask for, and their misfit.

        None where the flanks of no window are new, or the numbers are too small.
        """
        windows = self.windows
        fresh = [i for i, w in enumerate(windows.windows) if not w.worn]
        if not fresh or not trial.facts.shapes_wear or trial.onset > 0:
            return None
        start = replace(best, depth=best.depth[fresh], predictions=tuple(best.predictions[i] for i in fresh))
        try:
            problem = windows.problem((*best.trials, trial), windows.wear(), fresh)
            result = fit(problem, start, windows.phase, windows.depth[fresh])
        except TwinError:
            return None
        numbers, _ = result.numbers(result.trials[-1])
        if not big_enough(trial.name, numbers):
            return None
        return trial, started(trial, numbers, trial.onset), result.misfit


Teeth = Callable[[Sequence[Addition]], list[Addition]]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DifferingTeeth:
    """Fits where teeth differ from one another: their factors follow all that is fitted."""

    windows: MeshWindows
    profiles: Mapping[int, WornProfile]  # of each window, by index
    teeth: Teeth  # the effects of the teeth, fitted anew together with effects of the mesh
    thresholds: MeshSearchThresholds = DIFFERING

    def together(self, trials: Sequence[EffectTrial], start: Fitted) -> Fitted:
        return self._with_factors(trials, start.fit, together=True).fitted(trials, None, ROUNDS)

    def onsets(self, present: Fitted) -> list[float]:
        trials = restarted(present.fit)
        current = self._with_factors(trials, present.fit, together=True) if trials else self.windows
        return current.onsets(trials, current.wear((), present.fit))

    def screened(self, trials: Sequence[EffectTrial], present: Fitted) -> list[Candidate]:
        out = [self._screened(trial, present.fit) for trial in trials]
        return [c for c in out if c is not None]

    def refined(self, screened: Sequence[Candidate], present: Fitted) -> list[Candidate]:
        best = sorted(screened, key=lambda c: -c.gain)[: self.thresholds.most_refined]
        return [self._refined(c, present.fit) for c in best if c.gain > 0]

    def _with_factors(self, trials: Sequence[EffectTrial], start: JointFit, together: bool) -> MeshWindows:
        """The windows with what the teeth make, given trials as they start."""
        mesh = [
            replace(a, effect=plain(a.effect))
            for a in (t.addition(np.array([f.start for f in t.free])) for t in trials)
        ]
        windows = self.windows
        teeth = self.teeth(mesh if together else ())
        factors = factors_of(windows.model, windows.windows, self.profiles, teeth, mesh, together)
        return replace(windows, depth=start.depth, phase=start.phase, factors=factors)

    def _fitted(self, trials: Sequence[EffectTrial], start: JointFit, together: bool, rounds: int) -> Fitted | None:
        """Trials with what the teeth make given them; None without a steady state."""
        try:
            return self._with_factors(trials, start, together).fitted(trials, None, rounds)
        except TwinError:
            return None

    def _screened(self, trial: EffectTrial, best: JointFit) -> Candidate | None:
        """A trial with those present, pinion and gear one after the other."""
        present = restarted(best)
        first = self._fitted((*present, trial), best, False, 1)
        if first is None:
            return None
        trials: Sequence[EffectTrial] = restarted(first.fit)
        small = float(np.abs(first.fit.numbers(first.fit.trials[-1])[0]).max()) <= self.thresholds.large_number
        if trial.facts.shapes_wear and small:
            trials = (*present, trial)  # flanks that do not yet wear with it pull it to nothing
        return self._better([self._fitted(trials, first.fit, False, ROUNDS), first], best)

    def _refined(self, candidate: Candidate, best: JointFit) -> Candidate:
        """The candidate with all that the teeth do together with it."""
        found = self._fitted(restarted(candidate.fit), candidate.fit, True, ROUNDS)
        return candidate if found is None else self._better([found], best)

    def _better(self, fits: Sequence[Fitted | None], best: JointFit) -> Candidate:
        fitted = max((f for f in fits if f is not None), key=lambda f: f.fit.log_evidence)
        gain = fitted.fit.log_evidence - best.log_evidence
        return Candidate(trial=fitted.fit.trials[-1], fitted=fitted, gain=gain, worn_with=True)


def least_gain(fits: Fits, name: str, explained: float) -> float:
    """Evidence that an effect needs [nat]: more where it is hardly visible, and of another structure.

    explained  evidence of what is there already over wear alone [nat]
    """
    limits = fits.thresholds
    other = 0.0 if fits.windows.channels == CHANNELS else limits.other_structure_gain
    own = EFFECTS[name].facts.detection.least_gain
    asked = max(limits.least_gain, own, other, limits.share_of_explained * explained)
    return fits.windows.required.least(name, asked)
