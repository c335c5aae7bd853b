"""Which effects on the mesh explain the mesh lines of gears whose teeth differ from one another.

    m_w = m′_w(effects)·f_w(effects, teeth)

m′  lines that the effects of the mesh's period make of teeth that are all alike
f   what pitch errors or a crack make of them: unworn lines double, and how much depends on all else that is there

So every candidate is fitted with the f that goes with it, in turns: its numbers, then f, then its numbers. On the way
f is that of pinion and gear one after the other, whose departures add up within some per cent; the best candidates get
that of both together, over the hunting-tooth period, and pitch errors fitted anew beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.effects.addition import Addition
from twin.effects.extended import WindowLines, extend, window_lines
from twin.effects.pitch_error import PitchError
from twin.effects.response import Effect
from twin.errors import TwinError
from twin.model import Model
from twin.tracing.candidates import mesh_trials, plain, started
from twin.tracing.joint_fit import EffectTrial, JointFit
from twin.tracing.mesh_block import MOST_EFFECTS, ROUNDS, Candidate, MeshBlock, MeshFindings, rivals
from twin.tracing.observed import Observed
from twin.wear.profile import WornProfile

QUIET_BESIDE_TEETH = 1.3  # misfit that pitch errors alone leave; another effect beside them leaves 2.3 and more
LEAST_GAIN = 12.0  # nats that an effect beside them must gain: twice what it needs alone
LARGE = 0.1  # number of a candidate, in units of its prior, that is worth starting from
REFINED = 2  # candidates that are fitted with all that teeth do
MODEL_SHARE = 0.03  # of the evidence explained before: an effect is known to a sixth of its lines

Factors = list[dict[str, np.ndarray]]
Teeth = Callable[[Sequence[Addition]], list[Addition]]


def factors_of(
    model: Model,
    windows: Sequence[Observed],
    profiles: Mapping[int, WornProfile],
    teeth: Sequence[Addition],
    beside: Sequence[Addition] = (),
    together: bool = True,
) -> Factors | None:
    """What effects of longer periods make of each window's mesh lines; None where there are none.

    beside    effects of the mesh's own period
    together  whether pinion and gear are solved over the period of both
    """
    if not teeth:
        return None
    out: Factors = []
    for o in windows:
        there = tuple(a.effect for a in teeth if a.onset_revolutions <= o.revolutions)
        mesh = tuple(a.effect for a in beside if a.onset_revolutions <= o.revolutions)
        if not there:
            out.append({})
            continue
        try:
            part = _seen(o, window_lines(extend(model, mesh), profiles[o.index], o.condition))
            groups = [there] if together else _one_by_one(there)
            wholes = [
                _seen(o, window_lines(extend(model, (*group, *mesh)), profiles[o.index], o.condition))
                for group in groups
            ]
        except TwinError:
            out.append({})
            continue
        out.append({c: 1 + sum(whole[c] / part[c] - 1 for whole in wholes) for c in part})
    return out


def _one_by_one(effects: Sequence[Effect]) -> list[tuple[Effect, ...]]:
    """Pitch errors of pinion and gear apart, and all else as it is."""
    out: list[tuple[Effect, ...]] = []
    for effect in effects:
        if isinstance(effect, PitchError) and effect.pinion and effect.gear:
            out += [(PitchError(pinion=effect.pinion),), (PitchError(gear=effect.gear),)]
        else:
            out.append((effect,))
    return out


def _seen(window: Observed, found: WindowLines) -> dict[str, np.ndarray]:
    error = found.lines.pinion_motion if window.pinion_only else found.lines.transmission_error
    return {"encoder": error[:5], "torque": error[:3], "acceleration": found.lines.acceleration[:10]}


def _additions(trials: Sequence[EffectTrial], effects: Sequence[Effect]) -> list[Addition]:
    return [Addition(effect=plain(e), onset_revolutions=t.onset) for t, e in zip(trials, effects, strict=True)]


class _Search:
    """One search, with what all its fits share."""

    def __init__(self, block: MeshBlock, profiles: Mapping[int, WornProfile], teeth: Teeth) -> None:
        self.block, self.profiles, self.teeth = block, profiles, teeth

    def beside(self, trials: Sequence[EffectTrial], start: JointFit, together: bool) -> MeshBlock:
        """The windows with what the teeth make beside trials as they start."""
        effects = [t.make(np.array([f.start for f in t.free])) for t in trials]
        beside = _additions(trials, effects)
        teeth = self.teeth(beside if together else ())
        factors = factors_of(self.block.model, self.block.windows, self.profiles, teeth, beside, together)
        return MeshBlock(self.block.model, self.block.windows, start.depth, start.phase, factors, self.block.channels)

    def fitted(self, trials: Sequence[EffectTrial], start: JointFit, together: bool, rounds: int) -> JointFit | None:
        """Trials with what the teeth make beside them; None without a steady state."""
        try:
            return self.beside(trials, start, together).fitted(trials, None, rounds)[0]
        except TwinError:
            return None

    def screened(self, trial: EffectTrial, present: Sequence[EffectTrial], best: JointFit) -> Candidate | None:
        """A trial beside those present, pinion and gear one after the other."""
        trials: Sequence[EffectTrial] = (*present, trial)
        first = self.fitted(trials, best, False, 1)
        if first is None:
            return None
        trials = again(first)
        if trial.facts.shapes_wear and not _large(first.numbers(first.trials[-1])[0]):
            trials = (*present, trial)  # flanks that do not yet wear with it pull it to nothing
        return self._better(self.fitted(trials, first, False, ROUNDS), first, best)

    def refined(self, candidate: Candidate, best: JointFit) -> Candidate:
        """The candidate with all that the teeth do beside it."""
        found = self.fitted(again(candidate.fit), candidate.fit, True, ROUNDS)
        return candidate if found is None else self._better(found, None, best)

    def _better(self, found: JointFit | None, other: JointFit | None, best: JointFit) -> Candidate:
        fits = [f for f in (found, other) if f is not None]
        fit = max(fits, key=lambda f: f.log_evidence)
        gain = fit.log_evidence - best.log_evidence
        return Candidate(trial=fit.trials[-1], fit=fit, wear=self.block.wear((), fit), gain=gain, worn_with=True)


def again(fit: JointFit) -> tuple[EffectTrial, ...]:
    """Its trials, starting where they have come to."""
    return tuple(started(t, fit.numbers(t)[0], t.onset) for t in fit.trials)


def _large(numbers: np.ndarray) -> bool:
    return float(np.abs(numbers).max()) > LARGE


def explained_beside_teeth(
    block: MeshBlock,
    kept: Sequence[EffectTrial],
    profiles: Mapping[int, WornProfile],
    teeth: Teeth,
    skip: Sequence[str],
    quiet: float,
) -> MeshFindings:
    """As `MeshBlock.explained`, with what the teeth make of the lines following all that is found.

    profiles  of each window, by index
    teeth     the teeth's effects, fitted anew beside others
    """
    base, wear = block.plain
    search, best = _Search(block, profiles, teeth), base
    if kept:
        best = search.fitted(kept, base, True, ROUNDS) or base
    gain = best.log_evidence - base.log_evidence
    found = [Candidate(trial=t, fit=best, wear=wear, gain=gain) for t in best.trials]
    table: dict[str, float] = {}
    runner_up: dict[str, tuple[str, float]] = {}
    alike: dict[str, tuple[str, ...]] = {}
    waiting = False
    quiet = max(quiet, QUIET_BESIDE_TEETH)
    while len(found) < MOST_EFFECTS and best.misfit > quiet:
        present = again(best)
        current = search.beside(present, best, True) if present else block
        onsets = current.onsets(present, current.wear((), best))
        if not onsets:
            waiting = True
            break
        trials = mesh_trials()
        names = [n for n in trials if n not in skip and all(t.name != n for t in present)]
        tried = [
            c
            for name in names
            for onset in onsets
            if (c := search.screened(replace(trials[name], onset=onset), present, best)) is not None
        ]
        tried.sort(key=lambda c: -c.gain)
        refined = [search.refined(c, best) for c in tried[:REFINED] if c.gain > 0]
        refined.sort(key=lambda c: -c.gain)
        for candidate in (*tried, *refined):
            if not found:
                table[candidate.trial.name] = max(table.get(candidate.trial.name, -np.inf), candidate.gain)
        least = max(LEAST_GAIN, MODEL_SHARE * (best.log_evidence - base.log_evidence))
        usable = [c for c in refined if c.gain > max(block.least_gain(c.trial.name), least) and c.big_enough]
        if not usable:
            break
        chosen = usable[0]
        behind, alike[chosen.trial.name] = rivals(chosen, (*refined, *tried[REFINED:]))
        if behind is not None:
            runner_up[chosen.trial.name] = behind
        best = chosen.fit
        found.append(chosen)
    return MeshFindings(
        model=block.model,
        windows=block.windows,
        base=base,
        best=best,
        found=tuple(found),
        table=tuple(sorted(table.items(), key=lambda item: -item[1])),
        runner_up=runner_up,
        alike=alike,
        waiting=waiting,
    )
