"""What is said of an asset as plain text: the state and its figures first, then tables and the evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from service.report.content import Report, notes_of, report_of, unexplained_sentences, used_columns, window_rows
from service.report.findings import effect_finding, verdict
from service.report.lines import energies, modulation_sentences, pair_sentences, search_sentences, spacing_sentences
from service.report.words import GAP, number, reason, size, spread, table, width

STRONGEST = 6  # unexplained lines that are named
EFFECT_COLUMNS = (
    "effect", "status", "since rev.", "ln evidence", "runner-up", "waveform %", "RMS %", "depth µm", "parameters",
)  # fmt: skip
SENSOR = (("RMS m/s²", "rms"), ("kurtosis", "kurtosis"), ("crest", "crest_factor"))
GEAR = (
    ("turns", "turns"), ("FM0", "fm0"), ("FM4", "fm4"), ("NA4", "na4"), ("M6A", "m6a"), ("M8A", "m8a"),
    ("energy ratio", "energy_ratio"), ("sideband level", "sideband_level_factor"),
)  # fmt: skip


def answer_text(answer: Mapping[str, Any]) -> str:
    """Summary, what signals show of the pair, the table of windows and the latest condition indicators."""
    report = report_of(answer)
    lines = [f"Asset {report.asset}", "", *summary_lines(report, answer)]
    lines += [*modulation_sentences(answer.get("modulation")), *pair_sentences(answer.get("pair"))]
    for part in (window_table(answer["windows"]), indicator_lines(answer["windows"])):
        lines += ["", *part] if part else []
    return "\n".join(lines)


def report_text(answer: Mapping[str, Any]) -> str:
    """The same with every finding in full."""
    found = [f"  {finding}" for finding in report_of(answer).findings]
    return "\n".join([answer_text(answer), *(["", "Effects", *found] if found else [])])


def summary_lines(report: Report, answer: Mapping[str, Any]) -> list[str]:
    """A report in a few sentences, the most important first."""
    lines = []
    if (answer.get("status") or {}).get("level"):
        lines.append(f"Status: {report.level.replace('_', ' ')}. {report.summary}".rstrip())
        lines += [f"Action: {report.action}"] if report.action else []
        lines += [f"  {text}" for text in report.reasons if text != report.summary]
        lines += [f"  as of {report.latest}", f"Data: {report.data}"]
    figures = [f"{name}: {value}; {detail}" for name, value, detail in report.figures]
    lines += [*figures[:1], *(f"  {detail}" for detail in report.details), *figures[1:]]
    lines += [*report.conclusions, *report.limits, f"Windows: {report.quality[0][1]}"]
    return [*lines, *notes_of(report.records, answer["wear"].get("reason"))]


def window_table(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """The windows as a table that fits the terminal: what matters least is left out."""
    columns = used_columns(records)
    while True:
        rows = [tuple(c.title for c in columns), *window_rows(records, columns)]
        widths = [max(len(row[i]) for row in rows) for i in range(len(columns))]
        if sum(widths) + len(GAP) * (len(columns) - 1) <= width() or not any(c.rank for c in columns):
            break
        columns.remove(max(columns, key=lambda c: c.rank))
    return [GAP.join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in rows] if records else []


def indicator_lines(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Condition indicators of the latest window that has any: a line for each gear and accelerometer."""
    record = next((r for r in reversed(records) if r.get("indicators")), None)
    if record is None:
        return []
    raw = [name for name, sensor in record["indicators"].items() if sensor.get("unit")]
    rows = []
    for name, sensor in record["indicators"].items():
        own = [name, *(number(sensor.get(key)) for _, key in SENSOR)]
        gears = sensor.get("gears") or {"–": {}}
        rows += [[*own, gear, *(number(found.get(key)) for _, key in GEAR)] for gear, found in gears.items()]
    heads = ["sensor", *(title for title, _ in SENSOR), "gear", *(title for title, _ in GEAR)]
    if raw:  # a level without a unit is none in m/s²
        heads[1] = "RMS"
    doubt = next((f" ({s['doubt']})" for s in record["indicators"].values() if s.get("doubt")), "")
    lines = [f"Condition indicators, window {record['index']}{doubt}", *table(rows, heads, right=range(len(heads)))]
    return [*lines, f"The unit of {', '.join(raw)} is not known: RMS of raw values."] if raw else lines


def effect_lines(asset: str, effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """The effects in the twin of an asset as a table."""
    rows = effect_rows(effects)
    return (
        [f"Effects in the twin of {asset}", *table(rows, EFFECT_COLUMNS)]
        if rows
        else [f"{asset}: no effect besides wear"]
    )


def effect_rows(effects: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """What tables show of each effect, in the order of EFFECT_COLUMNS."""
    rows = []
    for e in effects:
        evidence, before, after = e["evidence"], e["error_before"], e["error_after"]
        next_best = f"{evidence['runner_up']} −{number(evidence.get('over_runner_up'))}"
        rows.append(
            (
                e["name"],
                e.get("status", ""),
                turns(e["onset_revolutions"]),
                turns(evidence["log_evidence"]),
                next_best if evidence.get("runner_up") else "–",
                *(
                    f"{number(before.get(key))} → {number(after.get(key))}"
                    for key in ("waveform_percent", "rms_percent")
                ),
                f"{number(e['wear_depth_um_before'])} → {number(e['wear_depth_um_after'])}",
                ", ".join(f"{name} {size(value)}" for name, value in e["parameters"].items()),
            )
        )
    return rows


def turns(value: float | None) -> str:
    """A number of revolutions or nats, whole."""
    return "–" if value is None else f"{value:.0f}"


# -- diagnosis -------------------------------------------------------------------------------------------


def diagnosis_text(answer: Mapping[str, Any]) -> str:
    """The diagnosis as plain text: sentences first, then the evidence."""
    tracing = answer["tracing"]
    lines = [f"Diagnosis of {answer['asset']}", "", *diagnosis_sentences(answer)]
    if tracing.get("candidates"):
        lines += ["", "Candidates on the mesh, ln evidence over wear alone:"]
        lines += [f"  {c['name']:<22}{c['log_evidence']:>10.1f}" for c in tracing["candidates"]]
    if tracing.get("residual"):
        lines += ["", *_bands(tracing["residual"])]
    breakdown = answer.get("energy_breakdown")
    if isinstance(breakdown, list):
        lines += ["", *energies(breakdown)]
    elif breakdown:
        lines += ["", f"The energy is not attributed to shafts: {breakdown['reason']}."]
    if tracing.get("log"):
        lines += ["", "Changes of the model:", *(f"  {change(entry)}" for entry in tracing["log"])]
    return "\n".join(lines)


def diagnosis_sentences(answer: Mapping[str, Any]) -> list[str]:
    """What an engineer may quote."""
    tracing, effects, left = answer["tracing"], answer["effects"], answer["unexplained"]
    out = [*modulation_sentences(answer.get("modulation")), *verdict(answer)]
    out += [str(effect_finding(effect)) for effect in effects]
    if answer["wear"].get("reason"):
        out.append(f"Wear depth: {reason(answer['wear'])}.")
    if effects:
        out.append(_together(answer))
    out += unexplained_sentences(answer)
    if left.get("orders"):
        listed = ", ".join(f"{o['frequency_hz']:.2f} Hz (order {o['order']:.3f})" for o in left["orders"][:STRONGEST])
        out.append(f"Its strongest lines: {listed}.")
    if tracing.get("other_structure"):
        out.append(
            "The transfer path from the mesh to the accelerometer differs from that of the rig file (another housing "
            "or mounting), so a changed gain or resonance of the sensor cannot be identified."
        )
    if held := tracing.get("held_out"):
        out.append(f"Errors are computed on held-out windows, which no fit used: windows {', '.join(map(str, held))}.")
    out += [
        *spacing_sentences(answer.get("unattributed_lines") or ()),
        *search_sentences(answer.get("unattributed_search")),
    ]
    return out + pair_sentences(answer.get("pair"))


def _together(answer: Mapping[str, Any]) -> str:
    """Depth and life with all effects, compared with wear alone."""
    depth = (answer["wear"].get("max_depth_um") or {}).get("combined")
    alone = answer["effects"][0]["wear_depth_um_before"]
    beside = "" if alone is None else f"; with wear alone {alone:.1f} µm"
    alone_too = " of wear alone" if answer["rul"].get("of_wear_alone") else ""
    life = spread(answer["rul"].get("revolutions"), "revolutions")
    return f"Wear depth with all effects: {spread(depth, 'µm')}{beside}. Remaining life{alone_too}: {life}."


def change(entry: Mapping[str, Any]) -> str:
    """One entry of the log."""
    at = "" if entry.get("revolutions") is None else f" at {entry['revolutions']:.0f} revolutions"
    why = "" if entry.get("log_evidence") is None else f", ln evidence {entry['log_evidence']:.0f}"
    return f"window {entry.get('window')}{at}: {entry['name']} {entry['action']}{why}"


def _bands(residual: Mapping[str, Any]) -> list[str]:
    keys = ("measured", "before", "after", "residual_before", "residual_after")
    rows = [(b["harmonic"], turns(b["frequency_hz"]), *(f"{b[key]:.3g}" for key in keys)) for b in residual["bands"]]
    heads = ("harmonic", "Hz", "measured", "before", "after", "res. before", "res. after")
    title = f"Window {residual['window']}, held out, by mesh harmonic (RMS m/s², ± 2 shaft orders):"
    return [title, *(f"  {line}" for line in table(rows, heads, right=range(len(heads))))]
