"""Tables of what must hold beyond names: false alarms, bands, errors of every added effect, places and onsets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benchmarks.bands import Band, binomial_interval, diagram
from benchmarks.evaluate_tables import number
from benchmarks.tracing_score import Gain, Traced

CHOSEN_RATE = 0.01  # of clean campaigns that are given an effect


def claim_tables(results: Sequence[Traced]) -> list[list[str]]:
    """All tables that have a line to show."""
    tables = (
        kind_table(results), false_alarm_table(results), gain_table(results), explained_table(results),
        place_table(results), onset_table(results), *band_tables(results),
    )  # fmt: skip
    return [table for table in tables if table]


def kind_table(results: Sequence[Traced]) -> list[str]:
    """Of every kind and machine: right of how many."""
    benches = sorted({r.bench for r in results})
    if len(benches) < 2:
        return []
    out = [f"{'right, by kind':24s}" + "".join(f"{bench:>12s}" for bench in benches) + f"{'all':>12s}"]
    for kind in dict.fromkeys(r.kind for r in results):
        mine = [r for r in results if r.kind == kind]
        cells = [[r for r in mine if r.bench == bench] for bench in benches] + [mine]
        out.append(
            f"{kind:24s}" + "".join(f"{f'{sum(r.right for r in c)}/{len(c)}' if c else '–':>12s}" for c in cells)
        )
    return out


def false_alarm_table(results: Sequence[Traced]) -> list[str]:
    """Share of clean campaigns that were given an effect, with its binomial 95 % interval."""
    clean = [r for r in results if r.kind == "clean"]
    if not clean:
        return []
    out = [f"{'clean campaigns':36s}{'given an effect':>18s}{'95 % interval':>16s}   which"]
    groups: dict[str, list[Traced]] = {}
    for r in clean:
        groups.setdefault("clean" + r.name.partition("-clean")[2], []).append(r)
    for name, mine in [*sorted(groups.items()), ("all", clean)]:
        hits = [r for r in mine if r.false]
        low, high = binomial_interval(len(hits), len(mine))
        which = "" if name == "all" else ", ".join(f"{r.name.split('-')[0]} {'+'.join(r.false)}" for r in hits)
        out.append(f"{name:36s}{f'{len(hits)} of {len(mine)}':>18s}{100 * low:8.1f} – {100 * high:4.1f} %   {which}")
    where = "within" if low <= CHOSEN_RATE <= high else "outside"
    return [*out, f"the chosen rate of {100 * CHOSEN_RATE:g} % lies {where} the interval"]


def gain_table(results: Sequence[Traced]) -> list[str]:
    """Held-out errors before and after every effect that was added; rows in which one rises are marked.

    First of whole channels, then of the lines that the effect moves.
    """
    rows = [(r, gain) for r in results for gain in r.gains]
    if not rows:
        return []
    out = [f"{'':46s}{'waveform %':>18s}{'transmission error %':>24s}   lines that it moves, %"]
    out.append(
        f"{'held-out error with every added effect':46s}{'before':>9s}{'after':>9s}{'before':>12s}{'after':>12s}"
    )
    out += [_gain_line(r.name, gain) for r, gain in rows]
    rising = sum(gain.rises for _, gain in rows)
    own = [gain for _, gain in rows if gain.moved]
    return [
        *out,
        f"{rising} of {len(rows)} rows in which the error of a whole channel rises (aim: none)",
        f"{sum(gain.moved_rises for gain in own)} of {len(own)} in which that of the lines moved rises (aim: none)",
    ]


def _gain_line(name: str, gain: Gain) -> str:
    return (
        f"{name.partition('-')[0] + ' ' + gain.effect:46s}{number(gain.waveform_before, '9.1f')}"
        f"{number(gain.waveform_after, '9.1f')}{number(gain.transmission_before, '12.1f')}"
        f"{number(gain.transmission_after, '12.1f')}   {_moved(gain)}"
        f"{'   RISES' if gain.rises else ''}{'   RISES ON ITS LINES' if gain.moved_rises else ''}"
    )


SHORT = {"acceleration": "a", "transmission_error": "TE", "pinion_motion": "pinion", "torque": "T"}


def _moved(gain: Gain) -> str:
    """Channel by channel, without → with the effect."""
    return ", ".join(f"{SHORT[channel]} {before:.0f} → {after:.0f}" for channel, before, after in gain.moved) or "–"


def explained_table(results: Sequence[Traced]) -> list[str]:
    """Verdicts by kind, and the campaigns said to be explained that should not be."""
    verdicts = sorted({r.verdict for r in results})
    out = [f"{'verdicts by kind':24s}" + "".join(f"{v:>20s}" for v in verdicts)]
    for kind in dict.fromkeys(r.kind for r in results):
        mine = [r for r in results if r.kind == kind]
        out.append(f"{kind:24s}" + "".join(f"{sum(r.verdict == v for r in mine):20d}" for v in verdicts))
    beyond = [r.name for r in results if r.explained_beyond_limit]
    wrongly = [r.name for r in results if r.explained_wrongly]
    out.append(f"explained although a held-out error exceeds the limit (aim: none): {', '.join(beyond) or 'none'}")
    out.append(f"explained although something is missing or false: {', '.join(wrongly) or 'none'}")
    return out


def place_table(results: Sequence[Traced]) -> list[str]:
    """Of unknown effects and faults of instruments: named falsely, said to be unknown, frequency or place named."""
    mine = [r for r in results if r.kind in ("unknown", "instrument")]
    if not mine:
        return []
    out = [f"{'unknown, by kind':34s}{'n':>4s}{'right':>7s}{'located':>9s}   false names; verdicts"]
    groups: dict[str, list[Traced]] = {}
    for r in mine:
        groups.setdefault(_what(r), []).append(r)
    for name, rows in groups.items():
        false = ", ".join(f"{r.name.split('-')[0]} {'+'.join(r.false)}" for r in rows if r.false)
        verdicts = ", ".join(r.failed or r.verdict for r in rows)
        located = sum(bool(r.located) for r in rows)
        out.append(f"{name:34s}{len(rows):4d}{sum(r.right for r in rows):7d}{located:9d}   {false or '–'}; {verdicts}")
    return out


def _what(r: Traced) -> str:
    parts = r.name.split("-")
    return parts[2] if len(parts) > 2 else r.name


def onset_table(results: Sequence[Traced]) -> list[str]:
    """Errors of onsets [revolutions]."""
    out = [f"{'onset, revolutions':46s}{'true':>9s}{'said':>9s}"]
    for r in results:
        for true, said in zip(r.onset_true, r.onset_said, strict=True):
            if r.kind == "growth" or (true and said is not None):
                out.append(f"{r.name:46s}{true:9.0f}{number(said, '9.0f')}")
    return out if len(out) > 1 else []


def band_tables(results: Sequence[Traced]) -> list[list[str]]:
    """Reliability of depth and life by how the machines wear and are run."""
    grouped: dict[str, list[Band]] = {}
    for r in results:
        grouped.setdefault(r.group or r.kind, []).extend(r.bands)
    shown = (("depth", "window"), ("pinion", "end"), ("gear", "end"), ("life", "half"), ("life", "end"))
    return [diagram(_filled(grouped), what, when) for what, when in shown]


def _filled(grouped: Mapping[str, Sequence[Band]]) -> dict[str, Sequence[Band]]:
    return {name: bands for name, bands in grouped.items() if bands}
