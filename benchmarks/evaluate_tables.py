"""The tables of `benchmarks.evaluate` as lines of text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.trace_campaigns.levels import LEVELS, visible
from benchmarks.trace_campaigns.table import CONTRACT_EFFECTS
from benchmarks.tracing_score import UNKNOWN, Traced

SHORT = {"small": "s", "medium": "m", "large": "l"}


def number(value: float | None, form: str) -> str:
    """A figure, or a dash as wide where there is none."""
    width = int(form.split(".")[0].lstrip("+"))
    return f"{'–':>{width}}" if value is None or value != value else f"{value:{form}}"


def campaign_table(results: Sequence[Traced]) -> list[str]:
    """One line a campaign: truth, named, runner-up; errors before and after."""
    wide = max(len(r.name) for r in results)
    out = [
        f"{'':{wide}}          waveform %     RMS error %           depth µm               life error %     CPU",
        f"{'campaign':{wide}}  right before  after  before  after    true   before    after   before    after      s"
        "  truth → named (runner-up; verdict)",
    ]
    for r in results:
        life = [
            None if not r.life_true or said is None else 100 * (said / r.life_true - 1)
            for said in (r.life_before, r.life_after)
        ]
        out.append(
            f"{r.name:{wide}}  {'yes' if r.right else 'NO':5}{number(r.waveform_before, '7.1f')}"
            f"{number(r.waveform_after, '7.1f')}{number(r.rms_before, '+8.1f')}{number(r.rms_after, '+7.1f')}"
            f"{r.depth_true:8.1f}{number(r.depth_before, '9.1f')}{number(r.depth_after, '9.1f')}"
            f"{number(life[0], '+9.1f')}{number(life[1], '+9.1f')}{r.seconds:7.1f}  {said(r)}"
        )
    return out


def said(r: Traced) -> str:
    """truth → named, and what else was said, in one line."""
    if r.failed:
        return f"no answer: {r.failed}"
    level = "" if r.level == "–" else f" ({'+'.join(SHORT.get(one, one) for one in r.level.split('+'))})"
    line = f"{', '.join(r.expected) or 'clean'}{level} → {', '.join(r.named) or 'nothing'}"
    more = [f"runner-up {r.runner_up}"] if r.runner_up else []
    unclear = sorted({name for others in r.alike for name in others})
    more += [f"indistinguishable from {', '.join(unclear)}"] if unclear else []
    more += [r.verdict]
    if r.foreign_hz:
        more.append(f"{r.lines_found} of {len(r.foreign_hz)} tones found")
    if r.false:
        more.append(f"FALSE: {', '.join(r.false)}")
    return f"{line} ({'; '.join(more)})"


def figure_table(results: Sequence[Traced]) -> list[str]:
    """Parameters and onsets of what was named, against the truth."""
    out = ["parameters of effects named right        true      said       std  error %"]
    for r in results:
        for f in r.figures:
            what = f"{r.name.split('-')[0]} {f.effect} {f.key}"
            out.append(
                f"{what:36s}{f.true:9.4g}{f.said:10.4g}{number(f.std, '10.2g')}{number(f.error_percent, '+9.1f')}"
            )
        for true, told in zip(r.onset_true, r.onset_said, strict=True):
            if told is not None and (true or told):
                what = f"{r.name.split('-')[0]} onset, revolutions"
                out.append(f"{what:36s}{true:9.0f}{told:10.0f}")
    return out if len(out) > 1 else ["no effect was named right: no parameters to compare"]


def size_table(results: Sequence[Traced]) -> list[str]:
    """Of every effect alone: named right of how many, by size."""
    singles = [r for r in results if r.kind == "single"]
    out = [f"{'named right, by size':24s}" + "".join(f"{level:>9s}" for level in LEVELS) + "   named instead"]
    for name in CONTRACT_EFFECTS:
        mine = [r for r in singles if r.expected == (name,)]
        if not mine:
            continue
        cells = [_count([r for r in mine if r.level == level]) for level in LEVELS]
        instead = sorted({wrong for r in mine for wrong in r.false})
        out.append(f"{name:24s}" + "".join(f"{c:>9s}" for c in cells) + f"   {', '.join(instead)}")
    return out if len(out) > 1 else ["no campaign with one effect of the list alone"]


def _count(results: Sequence[Traced]) -> str:
    return f"{sum(r.right for r in results)}/{len(results)}" if results else "–"


SOUND = ("life", "wear", "ramp")


@dataclass(frozen=True, slots=True)
class Aim:
    """One aim: among which campaigns, what must hold, for what share of them [%]."""

    what: str
    among: Callable[[Traced], bool]
    holds: Callable[[Traced], bool]
    percent: float
    most: bool = False  # at most that share instead of at least


AIMS = (
    Aim("single effects named right, all sizes", lambda r: r.kind == "single", lambda r: r.right, 90),
    Aim("  above their limits of visibility", lambda r: _above_limit(r), lambda r: r.right, 95),
    Aim("  above their machine's printed detection limit", lambda r: bool(r.above_limit), lambda r: r.right, 95),
    Aim("  or among those reported as indistinguishable", lambda r: r.kind == "single", lambda r: r.in_class, 90),
    Aim("both of a pair named", lambda r: r.kind == "pair", lambda r: set(r.expected) <= set(r.named), 90),
    Aim("all of three named", lambda r: r.kind == "triple", lambda r: set(r.expected) <= set(r.named), 75),
    Aim("effects that grow or set in twice named", lambda r: r.kind == "growth", lambda r: r.right, 90),
    Aim("effects alike at one speed and load, seen at one", lambda r: "points-1" in r.name, lambda r: r.right, 0),
    Aim("  seen at two operating points", lambda r: "points-2" in r.name, lambda r: r.right, 0),
    Aim("clean campaigns given an effect", lambda r: r.kind == "clean", lambda r: bool(r.false), 1, most=True),
    Aim("sound, worn unevenly, ramps: given an effect", lambda r: r.kind in SOUND, lambda r: bool(r.false), 1, True),
    Aim(
        "unknown effects never given another's name", lambda r: UNKNOWN in r.expected, lambda r: not r.false, 95
    ),
    Aim("  and said to be unknown", lambda r: r.kind == "unknown", lambda r: r.verdict == UNKNOWN, 90),
    Aim("  and their frequency or place named", lambda r: r.located is not None, lambda r: bool(r.located), 95),
    Aim("faults of instruments: no gear effect, and said", lambda r: r.kind == "instrument", lambda r: r.right, 95),
    Aim("explained beyond the limit", lambda r: not r.failed, lambda r: r.explained_beyond_limit, 0, most=True),
    Aim("waveform error halved, visible effects", lambda r: _traceable(r) and r.visible, lambda r: r.halved, 100),
    Aim(
        "depth within 5 % or 2 µm after", lambda r: r.depth_met is not None, lambda r: bool(r.depth_met), 100
    ),
    Aim("depth worse after than before", lambda r: r.depth_met is not None, lambda r: r.depth_worse, 0, most=True),
)  # fmt: skip


def _above_limit(r: Traced) -> bool:
    return r.kind == "single" and r.level in LEVELS and visible(r.expected[0], r.level)


def _traceable(r: Traced) -> bool:
    return r.kind in ("single", "pair", "triple", "growth") and not r.failed


def summary(results: Sequence[Traced]) -> list[str]:
    """What was found beside what is aimed at."""
    out = [f"{'summary':46s}   found            aim"]
    for aim in AIMS:
        counted = [r for r in results if aim.among(r)]
        if not counted:
            continue
        held = sum(aim.holds(r) for r in counted)
        share = 100 * held / len(counted)
        met = share <= aim.percent if aim.most else share >= aim.percent
        wanted = f"{'≤' if aim.most else '≥'} {aim.percent:g} %{'' if met else '   missed'}"
        out.append(f"{aim.what:46s}{share:6.0f} %  ({held:2d} of {len(counted):2d})  {wanted}")
    return out + _levels(results)


def _levels(results: Sequence[Traced]) -> list[str]:
    """Medians, and how far from the floor that clean campaigns show."""
    out = []
    floor = _median(r.waveform_after for r in results if r.kind == "clean")
    traced = [r for r in results if _traceable(r) and r.visible]
    for when in ("before", "after"):
        middle = _median(getattr(r, f"waveform_{when}") for r in traced)
        out.append(f"{f'waveform error {when}, median of visible':46s}{number(middle, '6.1f')} %")
    best = None if floor is None else 1.5 * floor
    out.append(
        f"{'  of clean campaigns':46s}{number(floor, '6.1f')} %  aim after ≤ 1.5 times: {number(best, '5.1f')} %"
    )
    for when in ("before", "after"):
        depth = _median(_relative(r.depth_error(when), r.depth_true) for r in results)
        life = _median(_relative(_off(getattr(r, f"life_{when}"), r.life_true), r.life_true) for r in results)
        out.append(f"{f'depth and life error {when}, medians':46s}{number(depth, '6.1f')} % {number(life, '7.1f')} %")
    false = sum(len(r.false) for r in results)
    out.append(f"{'names given to what is not there':46s}{false:4d} in {len(results)} campaigns")
    tones = sum(len(r.foreign_hz) for r in results)
    if tones:
        out.append(f"{'non-gear tones among the lines left':46s}{sum(r.lines_found for r in results):4d} of {tones}")
    failed = sum(r.failed is not None for r in results)
    if failed:
        out.append(f"{'campaigns without an answer':46s}{failed:4d} of {len(results)}")
    return out


def _off(value: float | None, true: float | None) -> float | None:
    return None if value is None or true is None else abs(value - true)


def _relative(error: float | None, true: float | None) -> float | None:
    return None if error is None or not true else 100 * error / true


def _median(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None and v == v]
    return float(np.median(known)) if known else None
