"""Causes of the difference between measured and predicted levels, each compared on cases left out.

The start is the twin with a gain for every condition and nothing else. Each cause is one change of it (twin.levels.
causes); every one is judged on the same worn cases, each left out in turn. A cause that has a value of its own (a
share, a draw of estimated values) is fitted to the other cases, and so is the combination of causes chosen: for every
case left out anew, by leaving out each of the other cases in turn. No cause is then freer on the case left out than the
others.

What the best combination of so many is worth by itself is flattered by the search for it. It is kept where choosing
anew for each case left out predicts that case better than the twin with its background (`kept`); else that is kept.

    run-in      assemblies with unworn gears have another background
    one gain    the same from the mesh to the sensor at every speed
    assembly    what all conditions of one assembly have in common: one is predicted from the others as well

Straight line, spline and monotone cubic are given the other conditions of the assembly wherever the twin is. Where the
monotone cubic through the cases predicts cases left out better than what is kept of the model, the relation is that
cubic, and indicators that the model does not predict join it one by one while they tell depths left out better.

Source   causes: twin.levels.causes; comparison: twin.levels.left_out
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from twin.errors import NotConverged, ParameterError
from twin.levels.basis import ByCases, by_cases
from twin.levels.causes import (
    EVEN_SHARES,
    EVEN_WEAR,
    NUMBERED,
    OTHER_VALUES,
    Curves,
    Machine,
    causes_of,
    depths_to,
    drawn,
)
from twin.levels.left_out import (
    Errors,
    ExpectedLevel,
    Predict,
    by_curve,
    by_relation,
    each_without,
    leave_out,
    monotone_cubic,
    of_curve,
    score,
    spline,
    straight_line,
)
from twin.levels.relation import CASES, MODEL, Cases, Form, Quantity, Relation, fit
from twin.levels.wear import Wear
from twin.model import Condition
from twin.rig import Rig
from twin.thresholds import deciding

PLAIN = Form()
Progress = Callable[[float, str], None]  # share done, what is being done

BLIND: dict[str, Predict] = {  # curves that know nothing of gears
    "straight line": straight_line,
    "spline": spline,
    CASES: monotone_cubic,
}
WITH_OTHERS = " + assembly"  # with the other conditions of the assembly known


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialLimits:
    """When a series of cases can be judged, and when a cause is accepted."""

    least_worn: int = deciding(
        12,
        unit="cases",
        meaning="worn cases that a series needs",
        source="derivation: a spline through half of them but one must be possible",
    )
    least_gain: float = deciding(
        3.0,
        unit="nat",
        meaning="gain of log density on cases left out from which a cause is accepted",
        source="not derived: odds of twenty to one",
    )
    few: int = deciding(
        4,
        unit="cases",
        meaning="cases from which the gain is estimated where the others are to be predicted",
        source="not derived: as few as somebody may have measured",
    )


LIMITS = TrialLimits()
LEAST_WORN, LEAST_GAIN = LIMITS.least_worn, LIMITS.least_gain


@dataclass(frozen=True, eq=False, kw_only=True)
class CauseTrial:
    """One cause with the errors that it leaves."""

    name: str
    said: str
    errors: Errors
    gain: float  # of log density over the twin with its background [nat]
    cause: bool = False  # whether it is a cause of what the twin with its background does not explain


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """A combination of causes."""

    curves: str = "twin"  # name of the cause that makes the curves; these exclude each other
    form: Form = PLAIN
    assembly: bool = False

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of what is added to the twin with its background."""
        named = (
            (self.curves, self.curves != "twin"),
            ("run-in", self.form.run_in),
            ("one gain", self.form.one_gain),
            ("assembly", self.assembly),
        )
        return tuple(name for name, present in named if present)


@dataclass(frozen=True, eq=False, kw_only=True)
class Tried:
    """A series of cases with every cause that was compared on it."""

    cases: Cases
    curves: Mapping[str, Curves]  # by name; the twin's own is "twin"
    trials: tuple[CauseTrial, ...]  # beginning with straight line, spline, twin, twin with background
    best: Choice  # the combination with the best density on cases left out
    choices: tuple[Choice, ...]  # chosen without each worn case
    errors: Errors  # by that, fitted without that case, on the case
    gain: float  # of their log density over the twin with its background [nat]
    choice: Choice  # what holds of the model (`kept`)
    modelled: Errors  # by that, fitted without each worn case, on the case
    basis: str  # which predicts cases left out better: MODEL, or CASES without it
    relation: Relation  # on that basis, of all cases
    relations: tuple[Relation, ...]  # the same, fitted (a combination chosen, too) without each worn case
    left: Errors  # of these on that case
    cubic: ByCases  # on the cases alone
    every: Cases  # with the indicators that the model does not predict
    judged: Mapping[str, Errors]  # chosen and fitted on every other case, on the rest; by method
    few: Mapping[str, Mapping[str, float]]  # mean errors on the rest from few cases, by method and condition
    spread: Mapping[str, tuple[float, float, float]]  # 10, 50, 90 % of mean errors over draws of what is estimated
    draws: int


class Fits:
    """Relations by the names of their curves, each fitted once to the same cases."""

    def __init__(self, curves: Mapping[str, Curves]) -> None:
        self._curves = curves
        self._known: dict[tuple[str, Form, bytes], tuple[Relation, float]] = {}

    def causes(self) -> tuple[str, ...]:
        """Names of the causes that make curves, "twin" among them."""
        return tuple(dict.fromkeys(name.partition(NUMBERED)[0] for name in self._curves))

    def of(self, cases: Cases, cause: str, form: Form) -> Relation:
        """The relation of a cause; where it has several curves, of those that leave least, or of the twin's own."""
        numbered = [name for name in self._curves if name.startswith(cause + NUMBERED)]
        names = ["twin", *numbered] if numbered else [cause]
        return min((self._one(cases, name, form) for name in names), key=lambda found: found[1])[0]

    def _one(self, cases: Cases, name: str, form: Form) -> tuple[Relation, float]:
        """The relation of one curve, and the mean square of what it leaves of ln(level)."""
        key = name, form, b"".join(v.tobytes() for v in (cases.depth, *cases.level.values()))
        if key not in self._known:
            relation = fit(cases, self._curves[name], form)
            off = [np.log(cases.level[k]) - np.log(relation.level(k, cases.depth)) for k in cases.level]
            self._known[key] = relation, float(np.mean(np.square(off)))
        return self._known[key]


def few_of(cases: Cases) -> np.ndarray:
    """Unworn assemblies and a few worn cases evenly over the depths (n,) bool."""
    worn = np.flatnonzero(cases.worn)
    by_depth = worn[np.argsort(cases.depth[worn])]
    chosen = by_depth[np.linspace(0, by_depth.size - 1, LIMITS.few).round().astype(int)]
    known = ~cases.worn
    known[chosen] = True
    return known


def choose(cases: Cases, fits: Fits) -> Choice:
    """The combination with the best density on cases left out, each cause having to gain LIMITS.least_gain."""
    worn, found = cases.only(cases.worn), []
    for curves, run_in, one_gain in product(fits.causes(), (False, True), (False, True)):
        form = Form(run_in=run_in, one_gain=one_gain)
        expected = [by_relation(fits.of(others, curves, form), depth) for depth, others in each_without(cases)]
        for assembly in (False, True):
            choice = Choice(curves=curves, form=form, assembly=assembly)
            errors = score(worn, expected, assembly)
            found.append((errors.log_density - LEAST_GAIN * len(choice.causes), choice))
    return max(found, key=lambda f: f[0])[1]


def kept(best: Choice, gain: float) -> Choice:
    """The best combination where choosing earned LIMITS.least_gain [nat] on cases that had no say in it, else none."""
    return best if gain >= LEAST_GAIN else Choice()


def choose_without_each(cases: Cases, fits: Fits) -> tuple[tuple[Choice, ...], tuple[Relation, ...], Errors]:
    """Chosen and fitted without each worn case in turn, and the errors on that case."""
    without = each_without(cases)
    choices = tuple(choose(others, fits) for _, others in without)
    relations = tuple(fits.of(others, c.curves, c.form) for (_, others), c in zip(without, choices, strict=True))
    expected = [by_relation(relation, depth) for (depth, _), relation in zip(without, relations, strict=True)]
    return choices, relations, score(cases.only(cases.worn), expected, [c.assembly for c in choices])


def halves(cases: Cases) -> tuple[np.ndarray, np.ndarray]:
    """Every other worn case by depth, and the rest, each with the unworn assemblies; (n,) bool."""
    worn = np.flatnonzero(cases.worn)
    by_depth = worn[np.argsort(cases.depth[worn])]
    first, second = ~cases.worn, ~cases.worn
    first[by_depth[::2]] = True
    second[by_depth[1::2]] = True
    return first, second


def judge(cases: Cases, fits: Fits) -> dict[str, Errors]:
    """Chosen and fitted on one half of the cases, errors on the other, and the other way round."""
    expected: dict[str, dict[int, ExpectedLevel]] = {}
    assembly: dict[int, bool] = {}
    for known in halves(cases):
        some = cases.only(known)
        choice = choose(some, fits)
        background, chosen = fits.of(some, "twin", PLAIN), fits.of(some, choice.curves, choice.form)
        methods: dict[str, Callable[[float], ExpectedLevel]] = {n: by_curve(some, curve) for n, curve in BLIND.items()}
        methods |= {"background": partial(by_relation, background), "chosen": partial(by_relation, chosen)}
        for i in np.flatnonzero(~known).tolist():
            assembly[i] = choice.assembly
            for name, method in methods.items():
                expected.setdefault(name, {})[i] = method(float(cases.depth[i]))
    worn = np.flatnonzero(cases.worn).tolist()

    def scored(name: str, known: bool | Sequence[bool]) -> Errors:
        return score(cases.only(cases.worn), [expected[name][i] for i in worn], known)

    same = [*BLIND, "background"]
    judged = {name: scored(name, False) for name in same}
    judged |= {name + WITH_OTHERS: scored(name, True) for name in same}
    return judged | {"chosen": scored("chosen", [assembly[i] for i in worn])}


def _few(cases: Cases, twin: Curves) -> dict[str, dict[str, float]]:
    """Mean absolute relative errors on the other worn cases, of what the few give."""
    known = few_of(cases)
    some, rest = cases.only(known), cases.only(~known)
    relation = fit(some, twin)
    out: dict[str, dict[str, float]] = {}
    for k, level in rest.level.items():
        known_depths = some.only(some.worn)
        found = {
            n: [curve(known_depths.depth, known_depths.level[k], float(d)) for d in rest.depth]
            for n, curve in BLIND.items()
        }
        for name, each in (found | {"background": relation.level(k, rest.depth)}).items():
            out.setdefault(name, {})[k] = float(np.mean(np.abs(np.array(each) / level - 1)))
    return out


def _curves(
    rig: Rig,
    conditions: Mapping[str, Condition],
    causes: Mapping[str, tuple[str, Callable[[Machine, Wear], Curves]]],
    deepest: float,
    spreads: Mapping[str, float],
    names: Sequence[str],
    rng: np.random.Generator,
    progress: Progress,
) -> dict[str, Curves]:
    """The curves of causes and of draws of estimated values, by name, to a depth [m]."""
    depths = depths_to(deepest)
    machine = Machine.of(rig, conditions, depths)
    wear = machine.worn()
    curves: dict[str, Curves] = {}
    for i, name in enumerate(names):
        progress(i / (len(names) + 3), name)
        if name in causes:
            curves[name] = causes[name][1](machine, wear)
            continue
        other = Machine.of(drawn(rig, spreads, rng), conditions, depths)
        try:
            curves[name] = other.curves(other.worn())
        except NotConverged:  # no steady state of the unworn gears to begin with
            continue
    return curves


def try_all(
    rig: Rig,
    conditions: Mapping[str, Condition],
    cases: Cases,
    *,
    quantities: Mapping[str, Quantity] | None = None,
    stated: Collection[str] = (),
    spreads: Mapping[str, float] | None = None,
    draws: int = 0,
    seed: int = 1,
    progress: Progress = lambda share, doing: None,
) -> Tried:
    """Compares every cause on a series of cases.

    conditions  of every label of the cases' levels
    quantities  what the levels are; all of them vibration levels where they are not given
    stated      which of "sensor" and "band" of the levels are known and need not be tried
    spreads     estimated numbers of the rig file by dotted path, and the factor by which they may be off
    draws       number of draws of them
    Raises NotAvailable where the rig file lacks what the model needs, ParameterError where worn cases are too few.
    """
    if cases.worn.sum() < LEAST_WORN:
        raise ParameterError(f"{cases.worn.sum()} worn cases are too few: at least {LEAST_WORN}")
    quantities = quantities or {}
    every = cases
    modelled = {k: c for k, c in conditions.items() if k not in quantities or quantities[k].modelled}
    cases = every.under(modelled)
    causes = causes_of(rig, stated)
    names = [*causes, *(f"{OTHER_VALUES}{NUMBERED}{i + 1}" for i in range(draws))]
    rng = np.random.default_rng(seed)
    curves = _curves(rig, modelled, causes, float(cases.depth.max()), spreads or {}, names, rng, progress)
    progress(len(names) / (len(names) + 3), "cases left out")
    fits = Fits(curves)
    drawn_names = [name for name in curves if name.startswith(OTHER_VALUES)]
    trials, spread = _singly(cases, fits, {name: said for name, (said, _) in causes.items()}, drawn_names)
    base = next(t.errors.log_density for t in trials if t.name == "background")
    progress((len(names) + 1) / (len(names) + 3), "combinations")
    best = choose(cases, fits)
    choices, relations, errors = choose_without_each(cases, fits)
    gain = errors.log_density - base
    choice, left = kept(best, gain), errors
    if choice == Choice():
        relations = tuple(fits.of(others, choice.curves, choice.form) for _, others in each_without(cases))
        left = next(t.errors for t in trials if t.name == "background")
    cubic = by_cases(every, conditions, modelled, next(iter(curves["twin"].values())).teeth, LEAST_GAIN)
    better = cubic.errors.log_density > left.log_density
    relation = cubic.relation if better else fits.of(cases, choice.curves, choice.form)
    progress((len(names) + 2) / (len(names) + 3), "halves")
    return Tried(
        cases=cases,
        every=every,
        curves=curves,
        trials=tuple(trials),
        best=best,
        choices=choices,
        errors=errors,
        gain=gain,
        choice=choice,
        modelled=left,
        basis=CASES if better else MODEL,
        cubic=cubic,
        relation=replace(relation, quantities={k: quantities[k] for k in relation.curves if k in quantities}),
        relations=cubic.relations if better else relations,
        left=cubic.errors if better else left,
        judged=judge(cases, fits),
        few=_few(cases, curves["twin"]),
        spread=spread,
        draws=len(drawn_names),
    )


def _singly(
    cases: Cases, fits: Fits, causes: Mapping[str, str], drawn_names: Sequence[str]
) -> tuple[list[CauseTrial], dict[str, tuple[float, float, float]]]:
    """Every cause by itself against the twin with its background, and the spread over draws of estimated values."""

    def errors(cause: str, form: Form = PLAIN, *, assembly: bool = False) -> Errors:
        return leave_out(cases, lambda others: fits.of(others, cause, form), assembly=assembly)

    base = errors("twin")
    trials: list[CauseTrial] = []

    def add(name: str, said: str, errors: Errors, cause: bool = False) -> None:
        trials.append(
            CauseTrial(name=name, said=said, errors=errors, gain=errors.log_density - base.log_density, cause=cause)
        )

    blind = {name: of_curve(cases, curve) for name, curve in BLIND.items()}
    for name, (alone, _) in blind.items():
        add(name, "knows nothing of gears", alone)
    add("twin", "one gain a speed", errors("twin", Form(background=False)))
    add("background", "level that does not come from the mesh, one for each speed", base)
    for name, said in causes.items():
        if name != "twin" and NUMBERED not in name:
            add(name, said, errors(name), cause=True)
    shares = ", ".join(f"{100 * q:.0f}" for q in EVEN_SHARES)
    add(EVEN_WEAR, f"{shares} % of the depth evenly over the flank, or none", errors(EVEN_WEAR), cause=True)
    add("run-in", "unworn assemblies with a background of their own", errors("twin", Form(run_in=True)), cause=True)
    add("one gain", "the same gain at every speed", errors("twin", Form(one_gain=True)), cause=True)
    spread: dict[str, tuple[float, float, float]] = {}
    if drawn_names:
        each = [errors(name) for name in drawn_names]
        for k in cases.level:
            low, middle, high = np.quantile([e.mean(k) for e in each], [0.1, 0.5, 0.9])
            spread[k] = float(low), float(middle), float(high)
        said = f"of what the rig file estimates, the best of {len(drawn_names)} draws or its own"
        add(OTHER_VALUES, said, errors(OTHER_VALUES), cause=True)
    said = "what the other speeds of the same assembly show"
    add("assembly", said, errors("twin", assembly=True), cause=True)
    for name, (_, known) in blind.items():
        add(name + WITH_OTHERS, said, known)
    return trials, spread
