"""What could make the levels that the twin misses, each tried on its merits.

The start is the twin with a gain for every condition and nothing else. Each cause is one change of it; every one is
judged on the same worn cases, each left out in turn. A cause that has a value of its own (a share, a draw of what is
estimated) takes that from the other cases, and so is the combination of causes chosen: for every case left out anew,
by what leaves out each of the other cases in turn. Neither is then freer on the case left out than the rest.

    contact kept        the teeth stick together: the linear response to the quasi-static transmission error
    sliding wear        depth by the sliding distance alone, without the load's sharing
    even wear           a part of the depth lies evenly over the flank
    uneven teeth        gear teeth are worn deeper and less deep
    other shaft's load  the torque stated was that of the other shaft
    other sensor        the levels are those on the other shaft, where it is not stated of which sensor they are
    lower band          the levels are of a band to 2 kHz, where it is not stated of which they are
    run-in              assemblies with unworn gears have another background
    one gain            the same from the mesh to the sensor at every speed
    other values        of what the rig file estimates: resonances elsewhere, other damping, other width
    assembly            what all conditions of one assembly have in common: one is predicted from the others, too

Straight line and spline are given the other conditions of the assembly, too, where the twin is.

Source   the causes: what is known of such series (README of the data); the judge: twin.levels.left_out
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import log
from typing import Any

import numpy as np

from twin.errors import NotConverged, ParameterError
from twin.levels.curve import LevelCurve, level_curve, linear_curve
from twin.levels.left_out import (
    Errors,
    ExpectedLevel,
    Predict,
    by_curve,
    by_relation,
    each_without,
    interpolated,
    leave_out,
    of_curve,
    score,
    spline,
    straight_line,
)
from twin.levels.relation import Cases, Form, Relation, fit
from twin.levels.wear import Wear, by_load_sharing, by_sliding, with_even_part
from twin.model import Calibration, Condition, Model
from twin.rig import Rig

PLAIN = Form()
Curves = Mapping[str, LevelCurve]
Progress = Callable[[float, str], None]  # share done, what is being done

NUMBERED = " #"  # between the name of a cause and which of several it is
EVEN_WEAR, OTHER_VALUES = "even wear", "other values"
STEP = 50e-6  # between the depths of a curve, closer where wear begins [m]
FIRST = (10e-6, 20e-6, 40e-6, 60e-6, 80e-6)
EVEN_SHARES = (0.25, 0.5)
UNEVENNESS = 0.15  # standard deviation of the depth from tooth to tooth
DURATION = 1.2  # of the motion that is taken at every depth [s]
UNEVEN_DURATION = 2.4  # [s]: the hunting-tooth period of slow gears is long
LEAST_WORN = 12  # cases: a spline through half of them but one must be possible
LEAST_GAIN = 3.0  # a cause joins from so much better a density on the cases left out [nat]
OTHER_SHAFT = {"y4": "y9", "y9": "y4", "y6": "y11", "y11": "y6"}  # bearings of either shaft by the model's coordinates
LOWER_BAND = 2000.0  # upper end of the paper's band [Hz]
BLIND: dict[str, Predict] = {"straight line": straight_line, "spline": spline}  # to gears
WITH_OTHERS = " + assembly"  # with the other conditions of the assembly known
FEW = 4  # cases from which the gain is taken where the rest is to be predicted


@dataclass(frozen=True, eq=False, kw_only=True)
class CauseTrial:
    """One cause with what it makes of the errors."""

    name: str
    said: str
    errors: Errors
    gain: float  # of log density over the twin with its background [nat]
    cause: bool = False  # of what the twin with its background misses


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """A combination of causes."""

    curves: str = "twin"  # name of the cause that makes the curves; these exclude each other
    form: Form = PLAIN
    assembly: bool = False

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of what is more than the twin with its background."""
        named = (
            (self.curves, self.curves != "twin"),
            ("run-in", self.form.run_in),
            ("one gain", self.form.one_gain),
            ("assembly", self.assembly),
        )
        return tuple(name for name, present in named if present)


@dataclass(frozen=True, eq=False, kw_only=True)
class Tried:
    """A series of cases with everything that was tried on it."""

    cases: Cases
    curves: Mapping[str, Curves]  # by name; the twin's own is "twin"
    trials: tuple[CauseTrial, ...]  # beginning with straight line, spline, twin, twin with background
    choice: Choice  # what holds: the combination with the best density on cases left out
    relation: Relation  # by it, of all cases
    choices: tuple[Choice, ...]  # chosen without each worn case
    relations: tuple[Relation, ...]  # by that, fitted without that case
    errors: Errors  # by that, on the case
    gain: float  # of their log density over the twin with its background [nat]
    judged: Mapping[str, Errors]  # chosen and fitted on every other case, on the rest; by way
    few: Mapping[str, Mapping[str, float]]  # mean errors on the rest from `FEW` cases, by way and condition
    spread: Mapping[str, tuple[float, float, float]]  # 10, 50, 90 % of mean errors over draws of what is estimated
    draws: int


def depths_to(deepest: float) -> np.ndarray:
    """Depths of a curve up to and beyond the deepest case [m]."""
    return np.concatenate(([0.0], FIRST, np.arange(FIRST[-1] + 40e-6, deepest + STEP, STEP)))


def drawn(rig: Rig, spreads: Mapping[str, float], rng: np.random.Generator) -> Rig:
    """The rig with every estimated value times a factor between 1/spread and spread, even in its logarithm."""
    for path, spread in spreads.items():
        value = rig.get(path)
        if not spread > 1:
            raise ParameterError(f"estimated.{path} = {spread:g} must be above 1: a factor")
        if not isinstance(value, (int, float)):
            raise ParameterError(f"estimated.{path}: the rig file gives no such number")
        rig = with_value(rig, path, value * float(np.exp(rng.uniform(-1, 1) * log(spread))))
    return rig


def with_value(rig: Rig, path: str, value: Any) -> Rig:
    """The rig with another value at a dotted path."""
    values = deepcopy(dict(rig.values))
    *tables, key = path.split(".")
    node = values
    for table in tables:
        node[table] = dict(node[table])
        node = node[table]
    node[key] = value
    return Rig.from_mapping(values)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Machine:
    """One rig under the conditions of a series."""

    model: Model
    conditions: Mapping[str, Condition]
    depths: np.ndarray

    @classmethod
    def of(cls, rig: Rig, conditions: Mapping[str, Condition], depths: np.ndarray) -> _Machine:
        return cls(model=Model.of(rig, Calibration.prior(rig)), conditions=conditions, depths=depths)

    def worn(self) -> Wear:
        return by_load_sharing(self.model, next(iter(self.conditions.values())), float(self.depths[-1]))

    def curves(self, wear: Wear, unevenness: float = 0.0, duration: float | None = None) -> Curves:
        duration = DURATION if duration is None else duration
        return {
            k: level_curve(
                self.model, c, wear, self.depths, band=self.model.rig.band, unevenness=unevenness, duration=duration
            )
            for k, c in self.conditions.items()
        }

    def closed(self, wear: Wear) -> Curves:
        return {
            k: linear_curve(self.model, c, wear, self.depths, band=self.model.rig.band)
            for k, c in self.conditions.items()
        }


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
    """Unworn assemblies and `FEW` worn cases evenly over the depths (n,) bool."""
    worn = np.flatnonzero(cases.worn)
    by_depth = worn[np.argsort(cases.depth[worn])]
    chosen = by_depth[np.linspace(0, by_depth.size - 1, FEW).round().astype(int)]
    known = ~cases.worn
    known[chosen] = True
    return known


def choose(cases: Cases, fits: Fits) -> Choice:
    """The combination with the best density on cases left out, each cause having to earn `LEAST_GAIN`."""
    worn, found = cases.only(cases.worn), []
    for curves, run_in, one_gain in product(fits.causes(), (False, True), (False, True)):
        form = Form(run_in=run_in, one_gain=one_gain)
        expected = [by_relation(fits.of(others, curves, form), depth) for depth, others in each_without(cases)]
        for assembly in (False, True):
            choice = Choice(curves=curves, form=form, assembly=assembly)
            errors = score(worn, expected, assembly)
            found.append((errors.log_density - LEAST_GAIN * len(choice.causes), choice))
    return max(found, key=lambda f: f[0])[1]


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
        ways: dict[str, Callable[[float], ExpectedLevel]] = {n: by_curve(some, curve) for n, curve in BLIND.items()}
        ways |= {"background": partial(by_relation, background), "chosen": partial(by_relation, chosen)}
        for i in np.flatnonzero(~known).tolist():
            assembly[i] = choice.assembly
            for name, way in ways.items():
                expected.setdefault(name, {})[i] = way(float(cases.depth[i]))
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
        blind = BLIND | {"interpolation": interpolated}
        found = {n: [curve(some.depth, some.level[k], float(d)) for d in rest.depth] for n, curve in blind.items()}
        for name, each in (found | {"background": relation.level(k, rest.depth)}).items():
            out.setdefault(name, {})[k] = float(np.mean(np.abs(np.array(each) / level - 1)))
    return out


def try_all(
    rig: Rig,
    conditions: Mapping[str, Condition],
    cases: Cases,
    *,
    stated: Collection[str] = (),
    spreads: Mapping[str, float] | None = None,
    draws: int = 0,
    seed: int = 1,
    progress: Progress = lambda share, doing: None,
) -> Tried:
    """Everything that is tried on a series of cases.

    conditions  of every label of the cases' levels
    stated      which of "sensor" and "band" of the levels are known and need not be tried
    spreads     estimated numbers of the rig file by dotted path, and the factor by which they may be off
    draws       of them that are tried
    Raises NotAvailable where the rig file lacks what the model needs, ParameterError where worn cases are too few.
    """
    if cases.worn.sum() < LEAST_WORN:
        raise ParameterError(f"{cases.worn.sum()} worn cases are too few: at least {LEAST_WORN}")
    depths = depths_to(float(cases.depth.max()))
    ways = _ways(rig, stated)
    names = [*ways, *(f"{OTHER_VALUES}{NUMBERED}{i + 1}" for i in range(draws))]
    curves: dict[str, Curves] = {}
    machine = _Machine.of(rig, conditions, depths)
    wear = machine.worn()
    rng = np.random.default_rng(seed)
    for i, name in enumerate(names):
        progress(i / (len(names) + 3), name)
        if name in ways:
            curves[name] = ways[name][1](machine, wear)
            continue
        other = _Machine.of(drawn(rig, spreads or {}, rng), conditions, depths)
        try:
            curves[name] = other.curves(other.worn())
        except NotConverged:  # no steady state of the unworn gears to begin with
            continue
    progress(len(names) / (len(names) + 3), "cases left out")
    fits = Fits(curves)
    drawn_names = [name for name in curves if name.startswith(OTHER_VALUES)]
    trials, spread = _singly(cases, fits, {name: said for name, (said, _) in ways.items()}, drawn_names)
    base = next(t.errors.log_density for t in trials if t.name == "background")
    progress((len(names) + 1) / (len(names) + 3), "combinations")
    choice = choose(cases, fits)
    choices, relations, errors = choose_without_each(cases, fits)
    progress((len(names) + 2) / (len(names) + 3), "halves")
    return Tried(
        cases=cases,
        curves=curves,
        trials=tuple(trials),
        choice=choice,
        relation=fits.of(cases, choice.curves, choice.form),
        choices=choices,
        relations=relations,
        errors=errors,
        gain=errors.log_density - base,
        judged=judge(cases, fits),
        few=_few(cases, curves["twin"]),
        spread=spread,
        draws=len(drawn_names),
    )


def _singly(
    cases: Cases, fits: Fits, ways: Mapping[str, str], drawn_names: Sequence[str]
) -> tuple[list[CauseTrial], dict[str, tuple[float, float, float]]]:
    """Every cause by itself beside the twin with its background, and what draws of the estimated values spread by."""

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
    add("background", "what the machine does beside the mesh, one level a speed", base)
    for name, said in ways.items():
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


def _ways(rig: Rig, stated: Collection[str]) -> dict[str, tuple[str, Callable[[_Machine, Wear], Curves]]]:
    """Curves of one rig: what is said of them, and how they are made."""

    def even(share: float) -> Callable[[_Machine, Wear], Curves]:
        return lambda machine, wear: machine.curves(with_even_part(wear, share))

    def sliding(machine: _Machine, wear: Wear) -> Curves:
        return machine.curves(by_sliding(machine.model))

    def uneven(machine: _Machine, wear: Wear) -> Curves:
        return machine.curves(wear, unevenness=UNEVENNESS, duration=UNEVEN_DURATION)

    def seen(path: str, value: Any) -> Callable[[_Machine, Wear], Curves]:
        other = with_value(rig, path, value)
        return lambda machine, wear: replace(machine, model=Model.of(other, machine.model.calibration)).curves(wear)

    ways = {
        "twin": ("as the rig file says", _Machine.curves),
        "contact kept": ("no loss of contact: the linear response", _Machine.closed),
        "sliding wear": ("depth by the sliding distance alone", sliding),
        "uneven teeth": (f"gear teeth differ by {100 * UNEVENNESS:.0f} % of the depth", uneven),
        "other shaft's load": ("the torque stated is the other shaft's", lambda machine, wear: _loaded(machine)),
        **{f"{EVEN_WEAR}{NUMBERED}{q:g}": ("", even(q)) for q in EVEN_SHARES},
    }
    if "sensor" not in stated and rig.accelerometer in OTHER_SHAFT:
        ways["other sensor"] = (
            "the level is that on the other shaft",
            seen("sensors.accelerometer", OTHER_SHAFT[rig.accelerometer]),
        )
    if "band" not in stated and rig.band[1] > LOWER_BAND:
        ways["lower band"] = (
            f"the level is of a band to {LOWER_BAND:g} Hz",
            seen("sensors.band_hz", [rig.band[0], LOWER_BAND]),
        )
    return ways


def _loaded(machine: _Machine) -> Curves:
    """Under the load that the torques would be if they were those of the other shaft."""
    z1, z2 = machine.model.mesh.pair.teeth
    heavier = {k: replace(c, torque=c.torque * z2 / z1) for k, c in machine.conditions.items()}
    other = replace(machine, conditions=heavier)
    return other.curves(other.worn())
