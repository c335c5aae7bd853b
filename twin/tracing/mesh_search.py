"""Which effects on the mesh explain what all channels show at the mesh orders.

First the windows are fitted with wear alone. Where that leaves more than healthy machines do, every effect that the
search knows is tried with the wear it would cause; the one with the most evidence joins; then the rest are tried
together with it, and so on, while the evidence gains enough. At last all is pruned backward (mesh_pruning.py), so
that what was taken for want of something better goes again.

How a set of effects is fitted is a matter of the teeth: mesh_fits.py.

Source   D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 28 (evidence, Occam factors)
Limits   effects that act over one mesh period; at most three together
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin.errors import TwinError
from twin.model import Model
from twin.tracing.joint_fit import JointFit
from twin.tracing.joint_problem import EffectTrial
from twin.tracing.mesh_fits import ALIKE, Candidate, Fits, MeshSearchThresholds, least_gain
from twin.tracing.mesh_laws import LawFound, changed_twice, law_found
from twin.tracing.mesh_pruning import pruned
from twin.tracing.mesh_trials import big_enough, mesh_trials
from twin.tracing.mesh_windows import Fitted, MeshWindows
from twin.tracing.observed import Observed
from twin.tracing.size_laws import LawFit

PASSES = 2  # of adding and pruning: what was pruned may have kept another effect out


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
    alike: dict[str, tuple[str, ...]] = field(default_factory=dict)  # of each one found: what it is not told from
    waiting: bool = False  # whether only the latest window breaks off: one more must show it
    pruned: tuple[str, ...] = ()  # found at first, and explained by the rest as well
    laws: dict[str, LawFit] = field(default_factory=dict)  # of those whose size changes after their onset


@dataclass(slots=True, eq=False, kw_only=True)
class _Progress:
    """What a search has come to."""

    base: Fitted
    best: Fitted
    found: list[Candidate]
    table: dict[str, float] = field(default_factory=dict)
    runner_up: dict[str, tuple[str, float]] = field(default_factory=dict)
    alike: dict[str, tuple[str, ...]] = field(default_factory=dict)
    waiting: bool = False
    gone: tuple[str, ...] = ()
    laws: dict[str, LawFit] = field(default_factory=dict)

    def note(self, candidates: Sequence[Candidate]) -> None:
        """The gains over what was there when each was tried first."""
        for candidate in candidates:
            name = candidate.trial.name
            first = self.table.get(name, -np.inf)
            if not self.found or name not in self.table:
                self.table[name] = max(first, candidate.gain)

    def findings(self, windows: MeshWindows) -> MeshFindings:
        return MeshFindings(
            model=windows.model,
            windows=windows.windows,
            base=self.base.fit,
            best=self.best.fit,
            found=tuple(self.found),
            table=tuple(sorted(self.table.items(), key=lambda item: -item[1])),
            runner_up=self.runner_up,
            alike=self.alike,
            waiting=self.waiting,
            pruned=self.gone,
            laws=self.laws,
        )


def search_mesh(
    fits: Fits,
    *,
    skip: Sequence[str] = (),
    tolerated: float = 0.0,
    kept: Sequence[EffectTrial] = (),
    fixed: Collection[str] = (),
    base: Fitted | None = None,
) -> MeshFindings:
    """The effects on the mesh that the windows show.

    skip       names that are not tried
    tolerated  misfit up to which nothing is sought, where it is more than the thresholds say
    kept       trials that are in from the start
    fixed      names of those that stay, whatever they add
    base       the fit with wear alone, where it is known
    """
    base = fits.windows.plain() if base is None else base
    best = _with_kept(fits, kept, base)
    gain = best.fit.log_evidence - base.fit.log_evidence
    found = [Candidate(trial=t, fitted=best, gain=gain) for t in best.fit.trials]
    progress = _Progress(base=base, best=best, found=found)
    quiet = max(fits.thresholds.quiet_misfit, tolerated)
    for trial in best.fit.trials:
        _change(fits, progress, trial.name, quiet)
    for _ in range(PASSES):
        _add(fits, progress, skip, quiet)
        _merge(fits, progress, fixed)
        if not _prune(fits, progress, fixed):
            break
    return progress.findings(fits.windows)


def _add(fits: Fits, progress: _Progress, skip: Sequence[str], quiet: float) -> None:
    """Adds one effect after the other until nothing is left to explain, or none is believed."""
    limits = fits.thresholds
    while len(progress.found) < limits.most_effects and (
        progress.best.fit.misfit > quiet or progress.best.fit.shared[0] < limits.softened
    ):
        if not _joined_by_one(fits, progress, skip):
            break
        _change(fits, progress, progress.found[-1].trial.name, quiet)


def _change(fits: Fits, progress: _Progress, name: str, quiet: float) -> None:
    """Gives an effect a size that changes, where that is needed to explain the windows."""
    trial = next((t for t in progress.best.fit.trials if t.name == name), None)
    if trial is None or progress.best.fit.misfit <= quiet:
        return
    if any(t.onset < trial.onset for t in progress.best.fit.trials):  # it may be a second change of that one: _merge
        return
    better = law_found(fits, progress.best, trial)
    if better is not None:
        _take(progress, better)


def _merge(fits: Fits, progress: _Progress, fixed: Collection[str]) -> None:
    """Leaves out an effect that is a second change of another one."""
    better = changed_twice(fits, progress.best, fixed)
    if better is not None:
        law, gone = better
        progress.found = [c for c in progress.found if c.trial.name != gone]
        progress.runner_up.pop(gone, None)
        progress.alike.pop(gone, None)
        progress.gone = (*progress.gone, gone)
        _take(progress, law)


def _take(progress: _Progress, better: LawFound) -> None:
    """The fit with a size that changes in place of the one before."""
    by_name = {t.name: t for t in better.fitted.fit.trials}
    name, progress.best = better.trial.name, better.fitted
    progress.laws[name] = better.law
    progress.found = [
        replace(
            c,
            trial=by_name[c.trial.name],
            fitted=better.fitted,
            gain=c.gain + (better.gain if c.trial.name == name else 0.0),
        )
        for c in progress.found
    ]


def _prune(fits: Fits, progress: _Progress, fixed: Collection[str]) -> bool:
    """Leaves what is needed, and says whether anything went.

    Where several effects are, the gain of each becomes what leaving it out would lose.
    """
    progress.best, losses, gone = pruned(fits, progress.base, progress.best, fixed)
    progress.gone = (*progress.gone, *gone)
    by_name = {t.name: t for t in progress.best.fit.trials}
    progress.found = [
        replace(
            c,
            trial=by_name[c.trial.name],
            fitted=progress.best,
            gain=losses[c.trial.name] if len(by_name) > 1 and c.trial.name in losses else c.gain,
        )
        for c in progress.found
        if c.trial.name in by_name
    ]
    for name in gone:
        progress.runner_up.pop(name, None)
        progress.alike.pop(name, None)
    return bool(gone)


def _with_kept(fits: Fits, kept: Sequence[EffectTrial], base: Fitted) -> Fitted:
    """The fit with all that is kept; wear alone where that has no steady state."""
    try:
        return fits.together(kept, base) if kept else base
    except TwinError:
        return base


def _joined_by_one(fits: Fits, progress: _Progress, skip: Sequence[str]) -> bool:
    """Whether one more effect has joined what was found."""
    present = progress.best
    onsets = fits.onsets(present)
    if not onsets:
        progress.waiting = True
        return False
    there = {t.name for t in present.fit.trials}
    trials = [t for name, t in mesh_trials().items() if name not in skip and name not in there]
    screened = fits.screened([replace(t, onset=onset) for t in trials for onset in onsets], present)
    refined = sorted(fits.refined(screened, present), key=lambda c: -c.gain)
    progress.note((*screened, *refined))
    explained = present.fit.log_evidence - progress.base.fit.log_evidence
    usable = [c for c in refined if c.gain > least_gain(fits, c.trial.name, explained) and c.big_enough]
    if not usable:
        return not progress.found and _joined_growing(fits, progress, (*refined, *screened), explained)
    chosen = usable[0]
    rest = sorted(screened, key=lambda c: -c.gain)[fits.thresholds.most_refined :]
    behind, progress.alike[chosen.trial.name] = rivals(chosen, (*refined, *rest), fits.thresholds)
    if behind is not None:
        progress.runner_up[chosen.trial.name] = behind
    progress.found.append(chosen)
    progress.best = chosen.fitted
    return True


def _joined_growing(fits: Fits, progress: _Progress, tried: Sequence[Candidate], explained: float) -> bool:
    """Whether an effect whose size changes has joined, where none of constant size explains enough."""
    by_name: dict[str, Candidate] = {}
    for candidate in sorted(tried, key=lambda c: -c.gain):
        by_name.setdefault(candidate.trial.name, candidate)
    found: list[tuple[float, Candidate, LawFound]] = []
    for name, candidate in by_name.items():
        law = law_found(fits, candidate.fitted, candidate.trial)
        gain = -np.inf if law is None else candidate.gain + law.gain
        if law is not None and gain > least_gain(fits, name, explained) and big_enough(name, law.numbers):
            found.append((gain, replace(candidate, trial=law.trial, fitted=law.fitted, gain=gain), law))
    if not found:
        return False
    gain, chosen, law = max(found, key=lambda f: f[0])
    others = [c for _, c, _ in found if c is not chosen] + [c for c in tried if c.trial.name != chosen.trial.name]
    behind, progress.alike[chosen.trial.name] = rivals(chosen, (chosen, *others), fits.thresholds)
    if behind is not None:
        progress.runner_up[chosen.trial.name] = behind
    progress.found.append(chosen)
    progress.best, progress.laws[chosen.trial.name] = law.fitted, law.law
    return True


def rivals(
    chosen: Candidate, tried: Sequence[Candidate], limits: MeshSearchThresholds = ALIKE
) -> tuple[tuple[str, float] | None, tuple[str, ...]]:
    """The best of all others and how far it is behind [nat]; the names that the chosen one is hardly told from."""
    others = sorted((c for c in tried if c.trial.name != chosen.trial.name), key=lambda c: -c.gain)
    within = chosen.gain - limits.indistinguishable_within
    alike = {c.trial.name for c in others if c.gain > within and c.big_enough}
    behind = (others[0].trial.name, chosen.gain - others[0].gain) if others else None
    return behind, tuple(sorted(alike))
