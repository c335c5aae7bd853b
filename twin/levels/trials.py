"""What could make the levels that the twin misses, each tried on its merits.

The start is the twin with a gain for every condition and nothing else. Each cause is one change of it; every one is
judged on the same worn cases, each left out in turn. A cause that has a value of its own (a share, a draw of what is
estimated) takes that from the other cases, so that it is no freer on the case left out than the rest.

    contact kept        the teeth stick together: the linear response to the quasi-static transmission error
    sliding wear        depth by the sliding distance alone, without the load's sharing
    even wear           a part of the depth lies evenly over the flank
    uneven teeth        gear teeth are worn deeper and less deep
    other shaft's load  the torque stated was that of the other shaft
    run-in              assemblies with unworn gears have another background
    one gain            the same from the mesh to the sensor at every speed
    other values        of what the rig file estimates: resonances elsewhere, other damping, other width
    assembly            what all conditions of one assembly have in common

Source   the causes: what is known of such series (README of the data); the judge: twin.levels.left_out
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from math import log

import numpy as np

from twin.errors import NotConverged, ParameterError
from twin.levels.curve import LevelCurve, level_curve, linear_curve
from twin.levels.left_out import Errors, leave_out, of_curve, of_twin, spline, straight_line
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
LEAST_WORN = 10  # cases: a spline through half of them must be possible
LEAST_GAIN = 3.0  # a cause joins from so much better a density on the cases left out [nat]
FEW = 4  # cases from which the gain is taken where the rest is to be predicted


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """One cause with what it makes of the errors."""

    name: str
    said: str
    errors: Errors
    gain: float | None = None  # of log density over the twin with its background [nat]


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """A combination of causes."""

    curves: str = "twin"  # name of the curves, which exclude each other
    form: Form = PLAIN
    assembly: bool = False

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of what is more than the twin with its background."""
        named = (
            (self.curves.partition(NUMBERED)[0], self.curves != "twin"),
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
    trials: tuple[Trial, ...]  # beginning with straight line, spline, twin, twin with background
    choice: Choice  # what holds: the combination with the best density on cases left out
    relation: Relation  # by it, of all cases
    errors: Errors  # by it, on cases left out
    judged: Mapping[str, Errors]  # chosen and fitted on every other case, on the rest; by way
    few: Mapping[str, Mapping[str, float]]  # mean errors on the rest from `FEW` cases, by way and condition
    spread: Mapping[str, tuple[float, float, float]]  # 10, 50, 90 % of mean errors over draws of what is estimated
    draws: int


def depths_to(deepest: float) -> np.ndarray:
    """Depths of a curve up to and beyond the deepest case [m]."""
    return np.concatenate(([0.0], FIRST, np.arange(FIRST[-1] + 40e-6, deepest + STEP, STEP)))


def drawn(rig: Rig, spreads: Mapping[str, float], rng: np.random.Generator) -> Rig:
    """The rig with every estimated value times a factor between 1/spread and spread, even in its logarithm."""
    values = deepcopy(dict(rig.values))
    for path, spread in spreads.items():
        if not spread > 1:
            raise ParameterError(f"estimated.{path} = {spread:g} must be above 1: a factor")
        if not isinstance(rig.get(path), (int, float)):
            raise ParameterError(f"estimated.{path}: the rig file gives no such number")
        *tables, key = path.split(".")
        node = values
        for table in tables:
            node[table] = dict(node[table])
            node = node[table]
        node[key] *= float(np.exp(rng.uniform(-1, 1) * log(spread)))
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


def loss(relation: Relation, cases: Cases) -> float:
    """Mean square of what is left in ln(level)."""
    off = [np.log(cases.level[k]) - np.log(relation.level(k, cases.depth)) for k in cases.level]
    return float(np.mean(np.square(off)))


def best(cases: Cases, among: Sequence[Curves], form: Form) -> Relation:
    """The relation of the curves that leave least of the cases."""
    fitted = [fit(cases, curves, form) for curves in among]
    return min(fitted, key=lambda r: loss(r, cases))


def few_of(cases: Cases) -> np.ndarray:
    """Unworn assemblies and `FEW` worn cases evenly over the depths (n,) bool."""
    worn = np.flatnonzero(cases.worn)
    by_depth = worn[np.argsort(cases.depth[worn])]
    chosen = by_depth[np.linspace(0, by_depth.size - 1, FEW).round().astype(int)]
    known = ~cases.worn
    known[chosen] = True
    return known


def choose(cases: Cases, curves: Mapping[str, Curves]) -> Choice:
    """The combination with the best density on cases left out, each cause having to earn `LEAST_GAIN`."""
    forms = [Form(run_in=r, one_gain=g) for r in (False, True) for g in (False, True)]
    choices = [Choice(curves=c, form=f, assembly=a) for c in curves for f in forms for a in (False, True)]

    def earned(choice: Choice) -> float:
        errors = of_twin(cases, curves[choice.curves], choice.form, assembly=choice.assembly)
        return errors.log_density - LEAST_GAIN * len(choice.causes)

    return max(choices, key=earned)


def halves(cases: Cases) -> tuple[np.ndarray, np.ndarray]:
    """Every other worn case by depth, and the rest, each with the unworn assemblies; (n,) bool."""
    worn = np.flatnonzero(cases.worn)
    by_depth = worn[np.argsort(cases.depth[worn])]
    first, second = ~cases.worn, ~cases.worn
    first[by_depth[::2]] = True
    second[by_depth[1::2]] = True
    return first, second


def judge(cases: Cases, curves: Mapping[str, Curves]) -> dict[str, Errors]:
    """Chosen and fitted on one half of the cases, errors on the other, and the other way round."""
    ways: dict[str, dict[str, list[float]]] = {
        name: {k: [] for k in cases.level} for name in ("straight line", "spline", "twin", "background", "chosen")
    }
    for known in halves(cases):
        some, rest = cases.only(known), np.flatnonzero(~known)
        choice = choose(some, curves)
        relations = {
            "twin": (fit(some, curves["twin"], Form(background=False)), False),
            "background": (fit(some, curves["twin"]), False),
            "chosen": (fit(some, curves[choice.curves], choice.form), choice.assembly),
        }
        for i in rest:
            depth = float(cases.depth[i])
            for k in cases.level:
                measured, other = float(cases.level[k][i]), {j: float(v[i]) for j, v in cases.level.items() if j != k}
                for name, curve in (("straight line", straight_line), ("spline", spline)):
                    found = curve(some.depth[some.worn], some.level[k][some.worn], depth)
                    ways[name][k].append(found / measured - 1)
                for name, (relation, assembly) in relations.items():
                    a = relation.assembly(depth, other) if assembly else 0.0
                    ways[name][k].append(float(relation.level(k, depth)) * float(np.exp(a)) / measured - 1)
    return {
        name: Errors(relative={k: np.array(v) for k, v in by_condition.items()}) for name, by_condition in ways.items()
    }


def _few(cases: Cases, twin: Curves) -> dict[str, dict[str, float]]:
    """Mean absolute relative errors on the other worn cases, of what the few give."""
    known = few_of(cases)
    some, rest = cases.only(known), cases.only(~known)
    relation = fit(some, twin)
    out: dict[str, dict[str, float]] = {"straight line": {}, "background": {}}
    for k, level in rest.level.items():
        line = [straight_line(some.depth, some.level[k], float(d)) for d in rest.depth]
        out["straight line"][k] = float(np.mean(np.abs(np.array(line) / level - 1)))
        out["background"][k] = float(np.mean(np.abs(relation.level(k, rest.depth) / level - 1)))
    return out


def try_all(
    rig: Rig,
    conditions: Mapping[str, Condition],
    cases: Cases,
    *,
    spreads: Mapping[str, float] | None = None,
    draws: int = 0,
    seed: int = 1,
    progress: Progress = lambda share, doing: None,
) -> Tried:
    """Everything that is tried on a series of cases.

    conditions  of every label of the cases' levels
    spreads     estimated numbers of the rig file by dotted path, and the factor by which they may be off
    draws       of them that are tried
    Raises NotAvailable where the rig file lacks what the model needs, ParameterError where worn cases are too few.
    """
    if cases.worn.sum() < LEAST_WORN:
        raise ParameterError(f"{cases.worn.sum()} worn cases are too few: at least {LEAST_WORN}")
    depths = depths_to(float(cases.depth.max()))
    names = [*_ways(), *(f"{OTHER_VALUES}{NUMBERED}{i + 1}" for i in range(draws))]
    curves: dict[str, Curves] = {}
    machine = _Machine.of(rig, conditions, depths)
    wear = machine.worn()
    rng = np.random.default_rng(seed)
    for i, name in enumerate(names):
        progress(i / (len(names) + 3), name)
        if name in _ways():
            curves[name] = _ways()[name][1](machine, wear)
            continue
        other = _Machine.of(drawn(rig, spreads or {}, rng), conditions, depths)
        try:
            curves[name] = other.curves(other.worn())
        except NotConverged:  # no steady state of the unworn gears to begin with
            continue
    progress(len(names) / (len(names) + 3), "cases left out")
    drawn_curves = [c for name, c in curves.items() if name.startswith(OTHER_VALUES)]
    trials, spread = _singly(cases, curves, drawn_curves)
    progress((len(names) + 1) / (len(names) + 3), "combinations")
    choice = choose(cases, curves)
    relation = fit(cases, curves[choice.curves], choice.form)
    progress((len(names) + 2) / (len(names) + 3), "halves")
    return Tried(
        cases=cases,
        curves=curves,
        trials=tuple(trials),
        choice=choice,
        relation=relation,
        errors=of_twin(cases, curves[choice.curves], choice.form, assembly=choice.assembly),
        judged=judge(cases, curves),
        few=_few(cases, curves["twin"]),
        spread=spread,
        draws=len(drawn_curves),
    )


def _singly(
    cases: Cases, curves: Mapping[str, Curves], drawn_curves: Sequence[Curves]
) -> tuple[list[Trial], dict[str, tuple[float, float, float]]]:
    """Every cause by itself beside the twin with its background, and what draws of the estimated values spread by."""
    twin, form = curves["twin"], Form()
    base = of_twin(cases, twin, form)
    trials = [
        Trial(name="straight line", said="knows nothing of gears", errors=of_curve(cases, straight_line)),
        Trial(name="spline", said="knows nothing of gears", errors=of_curve(cases, spline)),
        Trial(name="twin", said="one gain a speed", errors=of_twin(cases, twin, Form(background=False))),
        Trial(name="background", said="what the machine does beside the mesh, one level a speed", errors=base),
    ]

    def against(name: str, said: str, errors: Errors) -> None:
        trials.append(Trial(name=name, said=said, errors=errors, gain=errors.log_density - base.log_density))

    for name, (said, _) in _ways().items():
        if name != "twin" and NUMBERED not in name:
            against(name, said, of_twin(cases, curves[name], form))
    even = [c for name, c in curves.items() if name.startswith(EVEN_WEAR)]
    against(
        EVEN_WEAR,
        f"{', '.join(f'{100 * q:.0f}' for q in EVEN_SHARES)} % of the depth evenly over the flank, or none",
        leave_out(cases, lambda others: best(others, [twin, *even], form)),
    )
    against("run-in", "unworn assemblies with a background of their own", of_twin(cases, twin, Form(run_in=True)))
    against("one gain", "the same gain at every speed", of_twin(cases, twin, Form(one_gain=True)))
    spread: dict[str, tuple[float, float, float]] = {}
    if drawn_curves:
        each = [of_twin(cases, c, form) for c in drawn_curves]
        for k in cases.level:
            low, middle, high = np.quantile([e.mean(k) for e in each], [0.1, 0.5, 0.9])
            spread[k] = float(low), float(middle), float(high)
        against(
            OTHER_VALUES,
            f"of what the rig file estimates, the best of {len(drawn_curves)} draws or its own",
            leave_out(cases, lambda others: best(others, [twin, *drawn_curves], form)),
        )
    against("assembly", "what the other speeds of the same assembly show", of_twin(cases, twin, form, assembly=True))
    return trials, spread


def _ways() -> dict[str, tuple[str, Callable[[_Machine, Wear], Curves]]]:
    """Curves of one rig: what is said of them, and how they are made."""

    def even(share: float) -> Callable[[_Machine, Wear], Curves]:
        return lambda machine, wear: machine.curves(with_even_part(wear, share))

    def sliding(machine: _Machine, wear: Wear) -> Curves:
        return machine.curves(by_sliding(machine.model))

    def uneven(machine: _Machine, wear: Wear) -> Curves:
        return machine.curves(wear, unevenness=UNEVENNESS, duration=UNEVEN_DURATION)

    return {
        "twin": ("as the rig file says", _Machine.curves),
        "contact kept": ("no loss of contact: the linear response", _Machine.closed),
        "sliding wear": ("depth by the sliding distance alone", sliding),
        "uneven teeth": (f"gear teeth differ by {100 * UNEVENNESS:.0f} % of the depth", uneven),
        "other shaft's load": ("the torque stated is the other shaft's", lambda machine, wear: _loaded(machine)),
        **{f"{EVEN_WEAR}{NUMBERED}{q:g}": ("", even(q)) for q in EVEN_SHARES},
    }


def _loaded(machine: _Machine) -> Curves:
    """Under the load that the torques would be if they were those of the other shaft."""
    z1, z2 = machine.model.mesh.pair.teeth
    heavier = {k: replace(c, torque=c.torque * z2 / z1) for k, c in machine.conditions.items()}
    other = replace(machine, conditions=heavier)
    return other.curves(other.worn())
