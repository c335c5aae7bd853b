"""What the tracing said of a recording against the truth beside it: names, parameters, errors, depth, life.

Truth is for scoring only: nothing here feeds back into an estimate.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.bands import DEPTH_AIM, Band, depth_bands, gear_bands, life_bands
from benchmarks.scoring import life_left

UNKNOWN = "unknown_effect"
UNDECIDED = "insufficient_data"
VISIBLE = 31.6  # waveform error before, from which the residual holds a tenth of the energy [%]
LINE_WIDTH = 1.0  # within which an unexplained line is the non-gear tone [Hz]
HIGHEST_ORDER = 3  # of the shaft, up to which the lines of a coupling or a loose foot are looked for
TO_UM, TO_G_MM = 1e6, 1e6  # from m and from kg·m

Known = tuple[str, tuple[str, ...], float]  # truth's key, the twin's names for it, factor from the twin's SI unit

SAME: Mapping[str, tuple[Known, ...]] = {
    "pinion_eccentricity": (("e_um", ("eccentricity",), TO_UM),),
    "gear_eccentricity": (("e_um", ("eccentricity",), TO_UM),),
    "misalignment": (("lead_um", ("lead_gap",), TO_UM),),
    "tooth_friction": (("mu", ("coefficient",), 1.0),),
    "pitch_error": (
        ("pinion_um", ("pinion", "pinion_rms", "pinion_std"), TO_UM),
        ("gear_um", ("gear", "gear_rms", "gear_std"), TO_UM),
        ("p1_um", ("pinion", "pinion_rms", "pinion_std"), TO_UM),
        ("p2_um", ("gear", "gear_rms", "gear_std"), TO_UM),
    ),
    "profile_error": (
        ("tip_relief_um", ("pinion_relief", "tip_relief"), TO_UM),
        ("gear_tip_relief_um", ("gear_relief",), TO_UM),
        ("slope_um", ("slope",), TO_UM),
    ),
    "tooth_crack": (("loss", ("stiffness_loss",), 1.0),),
    "mass_unbalance": (("pinion_g_mm", ("pinion",), TO_G_MM), ("gear_g_mm", ("gear",), TO_G_MM)),
    "torque_ripple": (("amplitude_nm", ("amplitude",), 1.0), ("order", ("order",), 1.0)),
    "bearing_defect": (("force_n", ("blow",), 1.0), ("order", ("order",), 1.0)),
    "backlash_rattle": (("load_ripple_nm", ("load_ripple",), 1.0), ("order", ("order",), 1.0)),
    "mesh_stiffness_loss": (("loss", ("loss",), 1.0),),
    "mesh_damping": (("factor", ("factor",), 1.0),),
    "sensor_gain": (("gain", ("gain",), 1.0),),
    "sensor_resonance": (("frequency_hz", ("frequency",), 1.0),),
}
UNSIGNED = ("lead_um",)  # neither end of the face is the first
SMALL_UNITS = {"um": 1e-6, "µm": 1e-6, "mm": 1e-3, "g·mm": 1e-6, "g_mm": 1e-6, "%": 1e-2, "kHz": 1e3}


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One parameter of one effect that was named: the truth and what was said, in the truth's unit."""

    effect: str
    key: str
    true: float
    said: float
    std: float | None

    @property
    def error_percent(self) -> float | None:
        return 100 * (self.said / self.true - 1) if self.true else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Gain:
    """Errors on held-out windows before and after one added effect, as the answer states them [%]."""

    effect: str
    waveform_before: float | None
    waveform_after: float | None
    transmission_before: float | None
    transmission_after: float | None
    moved: tuple[tuple[str, float, float], ...] = ()  # of the lines that it moves: channel, error before and after

    @property
    def moved_rises(self) -> bool:
        """Whether the error of a channel rises on the lines that the effect moves, by more than rounding."""
        return any(after > before + 0.05 for _, before, after in self.moved)

    @property
    def rises(self) -> bool:
        """Whether either error is larger with the effect than without, by more than rounding."""
        both = ((self.waveform_before, self.waveform_after), (self.transmission_before, self.transmission_after))
        return any(b is not None and a is not None and a > b + 0.05 for b, a in both)


@dataclass(frozen=True, slots=True, kw_only=True)
class Traced:
    """The score of one recording; errors in percent, depths in µm, lives in revolutions."""

    name: str
    kind: str  # single, pair, triple, growth, unknown, instrument, wear, life, ramp, points or clean
    level: str
    expected: tuple[str, ...]
    named: tuple[str, ...]  # in the order found
    tolerated: tuple[str, ...]
    alike: tuple[tuple[str, ...], ...]  # of each one named: what it is indistinguishable from
    runner_up: str | None
    verdict: str
    lines_hz: tuple[float, ...]  # that are left unexplained, strongest first
    foreign_hz: tuple[float, ...]  # tones that are truly there and no effect of the list
    figures: tuple[Figure, ...]
    onset_true: tuple[float, ...]  # of each expected name, in their order [revolutions]
    onset_said: tuple[float | None, ...]
    waveform_before: float | None
    waveform_after: float | None
    rms_before: float | None
    rms_after: float | None
    depth_true: float
    depth_before: float | None
    depth_after: float | None
    life_true: float | None
    life_before: float | None
    life_after: float | None
    seconds: float = field(default=0.0)
    failed: str | None = None  # why there is no answer
    bench: str = ""  # the machine
    group: str = ""  # how it wears and is run, for the bands
    foreign_width_hz: tuple[float, ...] = ()  # within which each tone is found
    place_named: bool | None = None  # None where the truth names no place
    data_fault: bool = False  # a window was refused or degraded
    refused: bool = False  # the recording was refused with a reason
    bands: tuple[Band, ...] = ()  # of depth and life
    gains: tuple[Gain, ...] = ()  # of every effect that was added
    held_out: tuple[float | None, float | None] = (None, None)  # waveform and transmission error, in the end [%]
    limit: float | None = None  # up to which they count as explained [%]
    above_limit: bool | None = None  # whether a single effect is above its machine's printed detection limit

    @property
    def false(self) -> tuple[str, ...]:
        """Names given to what is not there."""
        return tuple(n for n in self.named if n not in self.expected and n not in self.tolerated)

    @property
    def right(self) -> bool:
        """All that is there named, nothing else; of an unknown effect: no name, and the verdict says so."""
        if self.kind == "instrument" and self.refused:
            return True
        if self.failed or self.false:
            return False
        if self.kind == "instrument":
            sensed = any(name in self.tolerated for name in self.named)
            return self.verdict in (UNKNOWN, UNDECIDED) or sensed or self.data_fault
        if UNKNOWN in self.expected:
            return self.verdict == UNKNOWN
        return set(self.expected) <= set(self.named)

    @property
    def in_class(self) -> bool:
        """Right, or wrong only in which of the indistinguishable names comes first."""
        if self.right or self.failed or UNKNOWN in self.expected:
            return self.right
        classes = [{name, *others} for name, others in zip(self.named, self.alike, strict=True)]
        covered = set[str]().union(*classes)
        needed = [c for c in classes if not c & {*self.expected, *self.tolerated}]
        return set(self.expected) <= covered and not needed

    @property
    def visible(self) -> bool:
        return self.waveform_before is not None and self.waveform_before >= VISIBLE

    @property
    def halved(self) -> bool:
        """The waveform error after is at most half of that before."""
        after, before = self.waveform_after, self.waveform_before
        return after is not None and before is not None and after <= before / 2

    @property
    def lines_found(self) -> int:
        """How many of the non-gear tones are among the lines said to be left."""
        widths = self.foreign_width_hz or (LINE_WIDTH,) * len(self.foreign_hz)
        return sum(
            any(abs(line - f) <= width for line in self.lines_hz)
            for f, width in zip(self.foreign_hz, widths, strict=True)
        )

    @property
    def located(self) -> bool | None:
        """Whether a frequency or the place of what is foreign was named; None where there is neither."""
        if not self.foreign_hz and self.place_named is None:
            return None
        return bool(self.lines_found) or bool(self.place_named)

    @property
    def explained_beyond_limit(self) -> bool:
        """Said to be explained although an error on held-out windows is above the limit."""
        over = [e for e in self.held_out if e is not None and self.limit is not None and e > self.limit]
        return self.verdict == "explained" and bool(over)

    @property
    def explained_wrongly(self) -> bool:
        """Said to be explained although something is there that was not named, or named that is not there."""
        missing = self.kind not in ("clean", "life", "wear", "ramp") and not self.right
        return self.verdict == "explained" and (missing or bool(self.false))

    def depth_error(self, when: str) -> float | None:
        """|error| of the depth at the last window [µm], `before` or `after` tracing."""
        said = getattr(self, f"depth_{when}")
        return None if said is None else abs(said - self.depth_true)

    @property
    def depth_met(self) -> bool | None:
        error = self.depth_error("after")
        percent, least = DEPTH_AIM
        return None if error is None else error <= max(percent / 100 * self.depth_true, least)

    @property
    def depth_worse(self) -> bool:
        """Further off than before by more than rounding."""
        after, before = self.depth_error("after"), self.depth_error("before")
        return after is not None and before is not None and after > before + 0.01

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe, with what the tables show."""
        shown: tuple[str, ...] = (
            "false",
            "right",
            "in_class",
            "visible",
            "halved",
            "lines_found",
            "depth_met",
            "depth_worse",
        )
        shown += ("located", "explained_beyond_limit", "explained_wrongly")
        out = asdict(self) | {name: getattr(self, name) for name in shown}
        out["figures"] = [asdict(f) | {"error_percent": f.error_percent} for f in self.figures]
        return out


def score_tracing(
    truth: Mapping[str, Any],
    answer: Mapping[str, Any],
    without: Mapping[str, Any] | None = None,
    *,
    name: str,
    lives: Sequence[Mapping[str, Any]] = (),
) -> Traced:
    """The score of an answer of `assess`; `without`: the answer to the same recording without tracing.

    Where there is no answer without tracing, the depth before is the first effect's own figure of it, or the
    answer's where nothing was added. lives: `rul` after every window, for the life at half-life.
    """
    effects = list(answer["effects"])
    residual, unexplained = answer["residual"], answer["unexplained"]
    expected = expected_names(truth)
    said = {e["name"]: e for e in effects}
    true = {e["name"]: e for e in reversed(truth["effects"])}
    tones = non_gear_tones(truth)
    before, after = (_errors(effects, residual, which) for which in ("before", "after"))
    orders = unexplained.get("orders") or ()
    return Traced(
        name=name,
        kind=kind_of(truth, expected),
        level="+".join(truth.get("levels", ())) or "–",
        expected=expected,
        named=tuple(e["name"] for e in effects),
        tolerated=tuple(truth.get("tolerated_names", ())),
        alike=tuple(tuple(e["evidence"].get("indistinguishable_from") or ()) for e in effects),
        runner_up=runner_up(effects),
        verdict=str(unexplained.get("verdict", unexplained.get("status"))),
        lines_hz=tuple(line["frequency_hz"] for line in orders if line.get("frequency_hz") is not None),
        foreign_hz=tuple(f for f, _ in tones),
        foreign_width_hz=tuple(width for _, width in tones),
        figures=tuple(f for n in expected if n in said and n in true for f in figures(true[n], said[n])),
        onset_true=tuple(true[n]["onset_revolutions"] for n in expected if n in true),
        onset_said=tuple(said[n]["onset_revolutions"] if n in said else None for n in expected if n in true),
        waveform_before=before[0],
        waveform_after=after[0],
        rms_before=before[1],
        rms_after=after[1],
        depth_true=truth["windows"][-1]["depth"]["combined_um"],
        depth_before=_depth_before(effects, answer, without),
        depth_after=_depth_now(answer),
        life_true=life_left(truth),
        life_before=_life(without if without is not None else answer),
        life_after=_life(answer),
        bench=str(truth.get("bench", "unsw")),
        group=str(truth.get("group", "")),
        place_named=_place_named(truth, answer),
        data_fault=any(w.get("quality") in ("refused", "degraded") for w in answer.get("windows", ())),
        bands=(
            *depth_bands(truth, answer.get("windows", ())),
            *gear_bands(truth, answer),
            *life_bands(truth, lives),
        ),
        gains=tuple(_gain(e) for e in effects),
        held_out=_held_out(answer, effects),
        limit=unexplained.get("limit_percent"),
    )


def _place_named(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> bool | None:
    """Whether what is said of the unexplained part has one of the words for its place."""
    words = truth.get("place")
    if not words:
        return None
    said = [answer["unexplained"], answer.get("status") or {}, [w.get("faults") for w in answer.get("windows", ())]]
    return re.search(words, json.dumps(said, ensure_ascii=False), re.IGNORECASE) is not None


def _gain(effect: Mapping[str, Any]) -> Gain:
    before, after = effect["error_before"], effect["error_after"]
    return Gain(
        effect=effect["name"],
        waveform_before=before["waveform_percent"],
        waveform_after=after["waveform_percent"],
        transmission_before=before.get("transmission_error_percent"),
        transmission_after=after.get("transmission_error_percent"),
        moved=tuple((m["channel"], m["before_percent"], m["after_percent"]) for m in effect.get("moved_lines") or ()),
    )


def _held_out(answer: Mapping[str, Any], effects: Sequence[Mapping]) -> tuple[float | None, float | None]:
    """Waveform and transmission error on held-out windows after all, as the answer states them [%]."""
    errors = (answer.get("tracing") or {}).get("errors") or (effects[-1]["error_after"] if effects else {})
    return errors.get("waveform_percent"), errors.get("transmission_error_percent")


def no_answer(truth: Mapping[str, Any], why: str, *, name: str) -> Traced:
    """The score of a recording that could not be assessed."""
    empty = {"effects": [], "residual": {}, "unexplained": {"verdict": "–"}, "wear": {}, "rul": {}}
    return replace(score_tracing(truth, empty, name=name), failed=why)


def expected_names(truth: Mapping[str, Any]) -> tuple[str, ...]:
    """Names that should be given, sorted."""
    return tuple(sorted(set(truth["expected_names"])))


def kind_of(truth: Mapping[str, Any], expected: Sequence[str]) -> str:
    if "kind" in truth:
        return str(truth["kind"])
    return "unknown" if UNKNOWN in expected else ("clean", "single", "pair")[min(len(expected), 2)]


def non_gear_tones(truth: Mapping[str, Any]) -> list[tuple[float, float]]:
    """Frequencies [Hz] of tones in the recording that are no effect of the list, and within what each is found."""
    out: list[tuple[float, float]] = []
    speed = truth["windows"][-1]["speed_hz"]
    for effect in truth["effects"]:
        p, name = effect["parameters"], effect["name"]
        out += [(f, LINE_WIDTH) for f in p.get("frequencies_hz", p.get("freqs", ()))]
        if name == "order_tone":
            out.append((p["order"] * speed, LINE_WIDTH))
        elif name == "drifting_tone":
            f = p["frequency_hz"]
            out.append((f, LINE_WIDTH + f * (p["between"] + abs(p["within"]) / 2)))
        elif name == "second_mesh":
            f = p["teeth"] * p["shaft_hz"]
            out.append((f * (1 - p["slip"] / 2), LINE_WIDTH + 0.65 * f * p["slip"]))
        elif name in ("coupling_misalignment", "loose_foot"):
            parts = 2 if name == "loose_foot" else 1  # a foot lifts off at every other turn, too
            out += [(k / parts * speed, LINE_WIDTH) for k in range(1, parts * HIGHEST_ORDER + 1)]
    return out


def runner_up(effects: Sequence[Mapping[str, Any]]) -> str | None:
    """The first effect's closest rival, as its evidence names it."""
    return next((e["evidence"]["runner_up"] for e in effects if e["evidence"].get("runner_up")), None)


def figures(true: Mapping[str, Any], said: Mapping[str, Any]) -> list[Figure]:
    """The parameters that truth and answer both give."""
    known: dict[str, Any] = dict(true["parameters"])
    if true["name"] == "tooth_crack":
        known["loss"] = 1 - known.get("remaining_stiffness", known.get("factor", 1.0))
    if true["name"] == "profile_error" and known.get("gear_tip_relief_um") is None:
        known["gear_tip_relief_um"] = known.get("tip_relief_um")
    out = []
    for key, names, factor in SAME[true["name"]]:
        mine = next((said["parameters"][n] for n in names if n in said["parameters"]), None)
        if mine is None or mine.get("value") is None or known.get(key) is None:
            continue
        value, truly = _si(mine["value"], mine["unit"]) * factor, float(known[key])
        std = None if mine.get("std") is None else _si(mine["std"], mine["unit"]) * factor
        if key in UNSIGNED:
            value, truly = abs(value), abs(truly)
        out.append(Figure(effect=true["name"], key=key, true=truly, said=value, std=std))
    return out


def _si(value: float | Sequence[float], unit: str) -> float:
    """One figure in SI: a value a tooth counts by its standard deviation."""
    one = float(np.std(value)) if isinstance(value, Sequence) else float(value)
    return one * SMALL_UNITS.get(unit, 1.0)


def _errors(effects: Sequence[Mapping], residual: Mapping, which: str) -> tuple[float | None, float | None]:
    """Waveform and RMS error [%] before the first effect or after the last; of the residual where there is none."""
    if effects:
        errors = effects[0]["error_before"] if which == "before" else effects[-1]["error_after"]
        return errors["waveform_percent"], errors["rms_percent"]
    return residual.get("waveform_error_percent"), residual.get("rms_error_percent")


def _depth_now(answer: Mapping[str, Any]) -> float | None:
    deepest = answer["wear"].get("max_depth_um")
    return None if deepest is None else deepest["combined"]["median"]


def _depth_before(effects: Sequence[Mapping], answer: Mapping, without: Mapping | None) -> float | None:
    if without is not None:
        return _depth_now(without)
    return effects[0]["wear_depth_um_before"] if effects else _depth_now(answer)


def _life(answer: Mapping[str, Any]) -> float | None:
    left = answer["rul"].get("revolutions")
    return None if left is None else left["median"]
