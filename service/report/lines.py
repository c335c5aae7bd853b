"""Modulations, lines of no known shaft and what two encoders show of the pair, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from service.report.words import number, reason

TIMES = {1: "once", 2: "twice", 3: "three times"}
MOST = 3  # modulations that are described; the deepest
WHOLE = 100.0  # % of the mesh lines
HARMONICS = 3  # mesh harmonics that are named
MOST_SIDEBANDS = 6
MOST_TEETH = 6  # ratios of tooth counts that are named
CERTAIN = 2.0  # standard deviations from which a run-out is distinguished from none


def modulation_sentences(modulation: Sequence[Mapping[str, Any]] | None) -> list[str]:
    """One paragraph for each modulation, the deepest first, and what it means."""
    if not modulation:
        return []

    def which(found: Mapping[str, Any]) -> tuple[str, int]:
        return found["shaft"], found["per_turn"]

    groups = [list(group) for _, group in groupby(sorted(modulation, key=which), which)]
    groups = [sorted(group, key=lambda m: -m["depth_percent"]) for group in groups]
    groups.sort(key=lambda group: (not group[0].get("new"), -group[0]["depth_percent"]))  # what is new comes first
    out = [_modulation(group) for group in groups[:MOST]]
    if len(groups) > MOST:
        rest = ", ".join(
            f"{g[0]['shaft']} {g[0]['per_turn']}×: {number(g[0]['depth_percent'], 2)} %" for g in groups[MOST:]
        )
        out.append(f"Shallower: {rest}.")
    if not any("healthy_percent" in found for found in modulation):
        out.append(
            "Healthy gears have sidebands, too: whether these are new, a healthy baseline shows (`gear-twin baseline`)."
        )
    return out


def _modulation(group: Sequence[Mapping[str, Any]]) -> str:
    deepest = group[0]
    pairs = sorted(deepest["sidebands"], key=lambda p: -p["mesh_amplitude"])[:HARMONICS]
    harmonics = ", ".join(str(p["mesh_harmonic"]) for p in sorted(pairs, key=lambda p: p["mesh_harmonic"]))
    shaft, n = deepest["shaft"], deepest["per_turn"]
    others = ""
    if len(group) > 1:
        least, most = group[-1]["depth_percent"], group[1]["depth_percent"]
        span = number(most, 2) if least == most else f"{number(least, 2)} to {number(most, 2)}"
        others = f"; {span} % in {len(group) - 1} more"
    size = f"{number(deepest['depth_percent'], 3)} ± {number(deepest['depth_std_percent'], 2)} %"
    what = f"{deepest['kind']} modulation of {size} {TIMES[n]} per {shaft} turn"
    if deepest["depth_percent"] > WHOLE:
        what = f"both together {size} of the mesh lines, more than a modulation can be"
    return (
        f"Sidebands of ±{n} × {shaft} speed ({deepest['frequency_hz']:.4g} Hz) at mesh harmonic {harmonics}: "
        f"{what} ({deepest['channel']}{others}){_against_baseline(deepest)}. "
        f"Possible causes, which cannot be distinguished here: {deepest['possible_causes']}."
    )


def _against_baseline(found: Mapping[str, Any]) -> str:
    """What the recordings of the healthy baseline show of it."""
    if "healthy_percent" not in found:
        return ""
    least, most = (number(depth, 2) for depth in found["healthy_percent"])
    span = f"{least} %" if least == most else f"{least} to {most} %"
    return f", {'new: ' if found['new'] else 'as before: '}{span} in the healthy baseline"


def spacing_sentences(strange: Sequence[Mapping[str, Any]]) -> list[str]:
    """Each spacing in words."""
    return [_spacing(found) for found in strange]


def search_sentences(search: Mapping[str, Any] | None) -> list[str]:
    """What was sought and from which size it would have been found, where nothing was; empty otherwise."""
    if search is None or search["found"]:
        return []
    if not search["detection_limits"]:
        return ["Lines of no known shaft were not searched for: the window is too short for them."]
    first: dict[str, str] = {}
    for limit in search["detection_limits"]:
        if limit["harmonic"] == 1:
            first[limit["channel"]] = number(limit["amplitude"], 2)
    return [
        f"Modulation by a frequency of no known shaft: none found. Sidebands {search['from_hz']:.2f} to "
        f"{search['to_hz']:.0f} Hz from the mesh lines were searched for; at mesh harmonic 1, half of "
        "those with this peak would be found: "
        + ", ".join(f"{value} ({channel})" for channel, value in first.items())
        + "."
    ]


def _spacing(found: Mapping[str, Any]) -> str:
    shown = ", ".join(
        f"{s['channel']} {s['multiple']}× "
        + (f"around mesh harmonic {s['harmonic']}" if s["harmonic"] else "itself")
        + f" {number(s['amplitude'], 3)}"
        + (f" ({100 * s['depth']:.0f} % of it)" if s["depth"] is not None else "")
        for s in found["sidebands"][:MOST_SIDEBANDS]
    )
    slower = (
        ""
        if found["part"] == 1
        else (
            f"There are weaker lines at {found['frequency_hz'] / found['part']:.3f} Hz: the source turns at that "
            f"frequency and acts mainly {found['part']} times per turn. "
        )
    )
    possible = [c["name"] for c in found["causes"] if c["possible"]]
    failed = [c["name"] for c in found["causes"] if not c["possible"]]
    place = f"{found['frequency_hz']:.3f} ± {found['frequency_std_hz']:.3f} Hz (order {found['order']:.4f})"
    if found["geared"] is not None:
        return f"Another shaft turns with the pinion as {found['geared']}: lines spaced by {place}, {shown}."
    healthy = found.get("healthy")
    if healthy or not found.get("new", True):
        shows = f"{len(healthy)} healthy windows show them, too" if healthy else "healthy ones show others as clear"
        return f"Lines of no known shaft, not new: spaced by {place}: {shown}; {shows}."
    seen = f" They stand out on {', '.join(found['channels'])}." if found.get("channels") else ""
    return (
        f"Unknown effect: lines spaced by {place} belong to no known shaft: {shown}.{seen} {slower}"
        f"Ruled out: {'; '.join(failed) or 'none'}. Possible: "
        f"{'; '.join(possible) or 'none of the tested causes'}."
    )


def energies(breakdown: Sequence[Mapping[str, Any]]) -> list[str]:
    """The energy of every channel by its source, as lines of a table; empty where it is not known."""
    if not breakdown:
        return []
    families = list(dict.fromkeys(b["family"] for b in breakdown))
    lines = [
        "Share of the energy, %; in brackets how much of it keeps its phase relative to the shaft angle (1: all), and",
        "how much a tone of fixed frequency would keep; if both are equal, the speed was too steady to decide.",
    ]
    lines.append(f"{'':<10}" + "".join(f"{name:>28}" for name in families))
    for channel in dict.fromkeys(b["channel"] for b in breakdown):
        own = {b["family"]: b for b in breakdown if b["channel"] == channel}
        cells = ""
        for name in families:
            b = own[name]
            steady = "   –,    –" if b["steady"] is None else f"{b['steady']:.2f}, {b['steady_if_fixed']:.2f}"
            cells += f"{b['share_percent']:>9.1f} ± {b['share_std_percent']:.1f} ({steady})"
        lines.append(f"{channel:<10}{cells}")
    return lines


def pair_sentences(pair: Mapping[str, Any] | None) -> list[str]:
    """The section in words; nothing where there is none."""
    if pair is None:
        return []
    if "ratio" not in pair:
        return [f"Gear pair from its two encoders: {reason(pair)}."]
    ratio, rest = pair["ratio"], pair["rest_urad"]
    share = 100 * ratio["std"] / ratio["value"]
    turns, speed = pair["turns"], pair["speed_hz"]
    out = [
        f"Gear pair from its two encoders, window {pair['window']}: {ratio['value']:.4f} ± {ratio['std']:.4f} turns "
        f"of the pinion for one of the gear ({share:.2f} %). {_teeth(pair['teeth_that_fit'])}",
        f"The pinion turned {turns['pinion']:.2f} times, the gear {turns['gear']:.2f}; pinion speed "
        f"{speed['mean']:.3f} Hz from the first edge to the last, {speed['highest']:.3f} Hz at most.",
    ]
    stated = pair["stated"]
    if stated is not None:
        verdict = "contradicted" if stated["contradicted"] else "not contradicted"
        out.append(
            f"The ratio {stated['ratio']:.4f} of {stated['source']} is {verdict}: {stated['deviations']:.1f} standard "
            "deviations away."
        )
    out += [_run_out(term, pair["base_radii"]) for term in pair["run_out"]]
    out.append(
        f"Transmission error, rms as an angle of the pinion: {rest['before']:,.0f} µrad, "
        f"{rest['after']:,.0f} µrad after removal of the run-out."
    )
    out += [
        f"Counts were missed at {step['time_s']:.2f} s: {step['counts']:+.0f} of the pinion's encoder, or as much of "
        "the gear's."
        for step in pair["missed_counts"]
    ]
    out += [_sharp(step) for step in pair["sharp_steps"]]
    if not pair["missed_counts"]:
        out.append("No missed counts were found.")
    return out


def _sharp(step: Mapping[str, Any]) -> str:
    """A sharp step that is not attributed to missed counts."""
    size = f"{step['counts']:+.0f} counts of the pinion's encoder"
    if step["shaft"] is None:
        return (
            f"A sharp step of {size} at {step['time_s']:.2f} s: missed counts, or a mark on a wheel that was "
            "passed only once."
        )
    return (
        f"A sharp step of {size} comes at {step['turn']:.3f} of the {step['shaft']}'s turn, in each of {step['times']} "
        "turns: a tooth, or a mark on its encoder's disc. If they were counts missed in every turn, the ratio would be "
        f"{step['ratio_if_missed']:.4f}."
    )


def _teeth(fit: Sequence[str]) -> str:
    if not fit:
        return "No tooth counts from 10 to 60 fit."
    more = f" and {len(fit) - MOST_TEETH} more" if len(fit) > MOST_TEETH else ""
    return f"Tooth counts of gear and pinion that fit: {', '.join(fit[:MOST_TEETH])}{more}."


def _run_out(term: Mapping[str, Any], radii: Mapping[str, Any] | None) -> str:
    """One term: how large, on which radius, and what it is indistinguishable from."""
    often = TIMES.get(term["multiple"], f"{term['multiple']} times")
    said = (
        f"Run-out {often} a turn of the {term['shaft']}: {term['amplitude_urad']:,.0f} ± {term['std_urad']:,.0f} µrad "
        "of the pinion"
    )
    if radii is not None:
        kind = "an assumed base radius" if radii["assumed"] else "its base radius"
        radius = radii[f"{term['shaft']}_mm"]
        said += f", {term['amplitude_um']:.0f} ± {term['std_um']:.0f} µm on {kind} of {radius:g} mm"
    none = "; not significant" if term["amplitude_urad"] < CERTAIN * term["std_urad"] else ""
    alike = term["indistinguishable_from"]
    return f"{said}; indistinguishable from that of {' or '.join(alike)}{none}."
