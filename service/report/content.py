"""What is said of an asset, from the answer of the contract; nothing is computed here that the answer does not hold."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from service import __version__
from service.contract.base import spoken_time
from service.printable import all_printable
from service.report.findings import Finding, findings, verdict
from service.report.words import available, band, moment, number, sentence, spread

LEVELS = {"normal": "Normal", "no_verdict": "No verdict", "watch": "Watch", "alarm": "Alarm", "end_of_life": "Stop"}
MOST_REASONS = 5
MOST_WINDOWS = 10
MOST_NOTES = 6
Row = tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A report's content; every text is a sentence or a figure with its unit."""

    asset: str
    made: str  # date and time, UTC
    latest: str  # of the measurement that it rests on
    level: str  # key of LEVELS
    summary: str  # of the state, in one sentence
    action: str
    reasons: tuple[str, ...]
    since: str
    data: str  # quality of the data, in one sentence
    figures: tuple[tuple[str, str, str], ...]  # name, value, detail
    details: tuple[str, ...]  # of the wear depth, which is the first figure where there are any
    conclusions: tuple[str, ...]  # which effects are in the model, and what is unexplained
    findings: tuple[Finding, ...]
    limits: tuple[str, ...]  # what cannot be said, and what would cure it
    method: tuple[str, ...]
    quality: tuple[Row, ...]  # name, value
    machine: tuple[Row, ...]
    windows: tuple[Row, ...]  # the first row holds the headings
    versions: tuple[Row, ...]
    records: tuple[Mapping[str, Any], ...]  # window records, for the trends
    depths: tuple[tuple[float, float], ...]  # revolutions and depth [µm], evaluated again with the effects found
    limit_um: float | None  # wear depth at the end of life
    life_revolutions: Mapping[str, Any] | None  # median, p05, p95 left


def report_of(
    answer: Mapping[str, Any], machine: Mapping[str, Any] | None = None, made: datetime | None = None
) -> Report:
    """The report about the asset of an answer.

    machine  mapping of the rig file, where it is known
    made     when the report is made; now where it is not given
    """
    answer = all_printable(answer)
    status, rul = answer.get("status") or {}, answer["rul"]
    records = tuple(answer["windows"])
    since = status.get("since") or {}
    reasons = tuple(status.get("reasons") or ())[:MOST_REASONS]
    life = rul.get("revolutions") if isinstance(rul.get("revolutions"), Mapping) else None
    return Report(
        asset=answer["asset"],
        made=(made or datetime.now(UTC)).strftime("%Y-%m-%d %H:%M UTC"),
        latest=_latest(status, records),
        level=status.get("level") or "no_verdict",
        summary=status.get("summary") or " ".join(reasons[:1]),
        action=status.get("action") or "",
        reasons=reasons,
        since=_since(since),
        data=_data(answer),
        figures=(*_depth(answer), *_life(answer), *_level(records)),
        details=tuple(_details(answer)),
        conclusions=tuple(verdict(answer)),
        findings=tuple(findings(answer)),
        limits=tuple(_limits(answer)),
        method=tuple(_method(answer)),
        quality=tuple(_quality(answer["data_quality"])),
        machine=tuple(_machine(answer, all_printable(machine))),
        windows=tuple(_windows(records)),
        versions=(
            ("gear-twin", __version__),
            ("Python", platform.python_version()),
            ("schema of the answer", str(answer.get("schema_version", 1))),
        ),
        records=records,
        depths=_again(answer),
        limit_um=_limit(answer, machine),
        life_revolutions=life,
    )


def _latest(status: Mapping[str, Any], records: Sequence[Mapping[str, Any]]) -> str:
    """When the window began that the state rests on, and how long before the latest; of none named, the latest."""
    if not records:
        return "no measurement yet"
    rests_on = status.get("verdict") or {}
    start = moment(rests_on.get("start_time") or records[-1].get("start_time"))
    return f"{start}, {spoken_time(rests_on['age_s'])} before the latest window" if rests_on.get("age_s") else start


def _again(answer: Mapping[str, Any]) -> tuple[tuple[float, float], ...]:
    """The depth of the whole history with the effects that were found; empty where none were."""
    tracing = answer.get("tracing") or {}
    if not answer.get("effects") or not available(tracing):
        return ()
    rows = [(d.get("revolutions"), d.get("wear_depth_um_after")) for d in tracing.get("depths") or ()]
    return tuple(sorted((n, depth) for n, depth in rows if n is not None and depth is not None))


def _since(since: Mapping[str, Any]) -> str:
    parts = []
    if since.get("time"):
        parts.append(moment(since["time"]))
    if since.get("revolutions") is not None:
        parts.append(f"{since['revolutions']:,.0f} pinion revolutions")
    return f"since {' and '.join(parts)}" if parts else ""


def _data(answer: Mapping[str, Any]) -> str:
    data = answer.get("data") or {}
    if data.get("level"):
        return f"{data['level']}: {data.get('reason', '')}".rstrip(": ")
    counts = answer["data_quality"].get("windows") or {}
    return ", ".join(f"{count} {grade}" for grade, count in counts.items() if count) or "no window"


def _preliminary(part: Any) -> str:
    return "Preliminary. " if isinstance(part, Mapping) and part.get("preliminary") else ""


def _limit(answer: Mapping[str, Any], machine: Mapping[str, Any] | None) -> float | None:
    stated = answer["rul"].get("max_depth_um")
    if stated is not None:
        return stated
    depth = ((machine or {}).get("end_of_life") or {}).get("max_depth")
    return None if depth is None else depth * 1e6


def _depth(answer: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    wear = answer["wear"]
    if not available(wear):
        return []
    depth, limit = wear["max_depth_um"]["combined"], answer["rul"].get("max_depth_um")
    share = (
        ""
        if limit is None or depth.get("median") is None
        else f"; {100 * depth['median'] / limit:.0f} % of {limit:.0f} µm"
    )
    return [("Wear depth", f"{number(depth.get('median'))} µm", f"{_preliminary(wear)}{band(depth, 'µm')}{share}")]


def _life(answer: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    rul = answer["rul"]
    if not available(rul):
        return []
    hours, turns = rul["hours"], rul["revolutions"]
    name = "Remaining life, of wear alone" if rul.get("of_wear_alone") else "Remaining life"
    if hours.get("median") is None:
        detail = f"{number(turns.get('p05'))} revolutions of the pinion (95 % confidence)"
        why = f"; {rul['reason']}" if rul.get("reason") else ""
        return [(name, f"at least {number(hours['p05'])} h", f"{detail}{why}")]
    detail = f"{_preliminary(rul)}{band(hours, 'h')}; {number(turns['median'])} revolutions of the pinion{_date(rul)}"
    if rul.get("of_wear_alone"):
        detail += "; the damage found is not counted in"
    return [(name, f"{number(hours['median'])} h", detail)]


def _date(rul: Mapping[str, Any]) -> str:
    date = rul.get("date")
    if not isinstance(date, Mapping) or not date.get("median"):
        return ""
    return f"; on {str(date['median'])[:10]} (5–95 %: {str(date.get('p05'))[:10]} to {str(date.get('p95'))[:10]})"


def _level(records: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    latest = next((r for r in reversed(records) if r.get("rms_measured") is not None), None)
    if latest is None:
        return []
    error = latest.get("error_percent")
    if error is not None:
        detail = f"the model predicted {number(latest['rms_predicted'])} m/s² ({error:+.0f} %)"
    else:
        detail = "no prediction: this machine has no model"
    return [("Vibration level (RMS)", f"{number(latest['rms_measured'])} m/s²", detail)]


def _details(answer: Mapping[str, Any]) -> list[str]:
    """What belongs to the wear depth: either wheel, its growth, the coefficient, and where the model does not hold."""
    wear, rig = answer["wear"], answer.get("rig") or {}
    if not available(wear) or not isinstance(wear.get("max_depth_um"), Mapping):
        return []
    wheels = wear["max_depth_um"]
    out = [f"pinion {spread(wheels.get('pinion'), 'µm')}; gear {spread(wheels.get('gear'), 'µm')}"]
    if growth := wear.get("growth"):
        since = f"{growth['since_revolutions']:,.0f} revolutions"
        out.append(f"grown since the first window that measured it ({since}): {spread(growth['max_depth_um'], 'µm')}")
    out += [text for text in (wear.get("reason"), (wear.get("relation") or {}).get("note")) if text]
    if wear.get("k_wear_per_n") is not None:
        rate = number(wear.get("specific_wear_rate_m2_per_n"), 4)
        out.append(f"wear coefficient K = {number(wear['k_wear_per_n'], 4)} 1/N; specific wear rate k = {rate} m²/N")
        out += [f"mesh stiffness: {rig['mesh_stiffness']}"] if rig.get("mesh_stiffness") else []
    validity = wear.get("validity")
    if not isinstance(validity, Mapping) or validity.get("valid") is not False:
        return out
    why, loss = validity.get("reason"), validity.get("contact_loss_from_um")
    if not why:
        why = "the depth lies beyond the last computed steady state, the wear rate is extrapolated"
        if loss is not None:
            why += f"; the teeth lose contact for part of the mesh cycle from {number(loss, 4)} µm on"
    return [*out, f"Warning: outside the validity of the model: {why}"]


PARTS = {"wear": "wear depth", "rul": "remaining life", "residual": "residual", "calibration": "calibration"}


def _limits(answer: Mapping[str, Any]) -> list[str]:
    """What the answer cannot say, each reason once, then what is preliminary and what would settle it."""
    missing: dict[str, list[str]] = {}
    for key, name in PARTS.items():
        part = answer.get(key)
        if isinstance(part, Mapping) and part.get("status") == "not available":
            missing.setdefault(part["reason"], []).append(name)
    out = [f"Not available: {', '.join(names)}. {sentence(why)}" for why, names in missing.items()]
    said: set[str] = set()
    for key in ("wear", "rul"):
        preliminary = (answer.get(key) or {}).get("preliminary") or {}
        for kind, start in (("reasons", "Preliminary"), ("remedies", "What would settle it")):
            for text in preliminary.get(kind) or ():
                if text not in said:
                    said.add(text)
                    out.append(f"{start}: {sentence(text)}")
    sufficiency = (answer.get("baseline") or {}).get("sufficiency") or {}
    out += [f"Not judged: {item['what']}. {sentence(item['reason'])}" for item in sufficiency.get("not_judged") or ()]
    return [*out, *((answer.get("detectable") or {}).get("said") or ())]


def _method(answer: Mapping[str, Any]) -> list[str]:
    wear = answer["wear"]
    out = []
    if available(wear) and wear.get("method") == "level":
        out.append("The wear depth comes from a relation of vibration level and measured depths of this machine.")
    elif available(wear):
        source = wear.get("method") or "model"
        out.append(
            "A model of the gearbox with 21 degrees of freedom and Archard wear of the tooth flanks is compared with "
            f"every measurement and updated where they disagree; here the depth comes from the {source}."
        )
    elif answer.get("baseline"):
        out.append(
            "The machine has no model: its spectral lines are compared with recordings of its own healthy state."
        )
    elif available(answer.get("pair")):
        out.append("The machine has no model: two shaft encoders show its gear ratio, run-out and missed counts.")
    else:
        out.append("The machine has no model and no healthy baseline: only measured features are reported.")
    out += _details(answer)
    out.append(
        "A 5–95 % band contains the true value nine times in ten if the model holds. "
        "Errors are computed on held-out measurements, which no fit used."
    )
    out += unexplained_sentences(answer)
    calibration = answer.get("calibration") or {}
    if available(calibration) and calibration.get("misfit") is not None:
        doubts = "; ".join(calibration.get("doubts") or ()) or "none"
        out.append(
            f"Misfit of the calibration: {number(calibration['misfit'])} (1 or less is a good fit); doubts: {doubts}."
        )
    return out


def unexplained_sentences(answer: Mapping[str, Any]) -> list[str]:
    """How much of the measured energy no part of the model explains."""
    left = answer.get("unexplained") or {}
    if left.get("share_percent") is None or left["share_percent"] > 100:  # then the reason says by how much
        return []
    verdict = str(left.get("verdict", "")).replace("_", " ")
    limit = left.get("limit_percent")
    held_out = "" if limit is None else f" (limit of the held-out error: {limit:.0f} %)"
    return [f"Unexplained: {number(left['share_percent'])} % of the measured energy; verdict: {verdict}{held_out}."]


def _quality(quality: Mapping[str, Any]) -> list[Row]:
    counts = ", ".join(f"{n} {grade}" for grade, n in (quality.get("windows") or {}).items() if n) or "none"
    rows: list[Row] = [("measurements", counts)]
    for name, kinds in (quality.get("channels") or {}).items():
        wrong = ", ".join(f"{n} {kind.replace('_', ' ')}" for kind, n in kinds.items() if kind != "frames" and n)
        rows.append((name, f"{kinds.get('frames', 0):,} frames" + (f"; {wrong}" if wrong else "")))
    if quality.get("missing_channels"):
        rows.append(("never received", ", ".join(quality["missing_channels"])))
    return rows


def _machine(answer: Mapping[str, Any], machine: Mapping[str, Any] | None) -> list[Row]:
    rows: list[Row] = []
    short, rig = answer.get("rig") or {}, machine or {}
    name = rig.get("name") or short.get("name")
    if name:
        rows.append(("rig file", str(name)))
    gears = rig.get("gears") or {}
    teeth = [(gears.get(shaft) or {}).get("teeth") for shaft in ("pinion", "gear")]
    if None not in teeth:
        rows.append(("teeth of pinion and gear", f"{teeth[0]} and {teeth[1]}"))
    if gears.get("module") is not None:
        rows.append(("module", f"{1e3 * gears['module']:g} mm"))
    operating = rig.get("operating") or {}
    if operating.get("pinion_speed_hz") is not None:
        rows.append(("rated speed of the pinion", f"{operating['pinion_speed_hz']:g} Hz"))
    if operating.get("input_torque") is not None:
        rows.append(("rated torque", f"{operating['input_torque']:g} N·m"))
    limit = _limit(answer, machine)
    if limit is not None:
        rows.append(("wear depth at the end of life", f"{limit:.0f} µm"))
    if (rig.get("estimated") or {}).get("parts"):
        rows.append(("estimated, not measured", ", ".join(rig["estimated"]["parts"])))
    if short.get("mesh_stiffness"):
        rows.append(("mesh stiffness", short["mesh_stiffness"]))
    return [*rows, *(("note", note) for note in short.get("notes") or ())]


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table of windows."""

    title: str
    key: str
    rank: int  # the higher, the sooner it is left out where there is little room
    report: bool = False  # whether a report has it


WINDOW_COLUMNS = (
    Column("time", "start_time", 7, report=True),
    Column("#", "index", 0),
    Column("kind", "kind", 3),
    Column("revolutions", "revolutions", 0, report=True),
    Column("speed Hz", "speed_hz", 5, report=True),
    Column("torque N·m", "torque_nm", 5, report=True),
    Column("RMS meas.", "rms_measured", 0, report=True),
    Column("RMS pred.", "rms_predicted", 1, report=True),
    Column("error %", "error_percent", 2),
    Column("RMS after", "rms_after", 6),
    Column("K 1/N", "k_wear_per_n", 6),
    Column("depth µm", "wear_depth_um", 0, report=True),
    Column("updated", "updated", 4),
    Column("data", "quality", 1, report=True),
)


def window_rows(records: Sequence[Mapping[str, Any]], columns: Sequence[Column] = WINDOW_COLUMNS) -> list[Row]:
    """The cells of a table of windows."""
    return [tuple(_cell(record.get(column.key), column.key) for column in columns) for record in records]


def used_columns(records: Sequence[Mapping[str, Any]], report: bool = False) -> list[Column]:
    """The columns that hold anything."""
    shown = [c for c in WINDOW_COLUMNS if c.report or not report]
    return [c for c in shown if any(_cell(r.get(c.key), c.key) not in ("", "–") for r in records)]


def _windows(records: Sequence[Mapping[str, Any]]) -> list[Row]:
    """The latest measurements under their headings."""
    latest = [r for r in records if r.get("kind") != "calibration"][-MOST_WINDOWS:]
    columns = used_columns(latest, report=True)
    return [tuple(c.title for c in columns), *window_rows(latest, columns)] if latest else []


def _cell(value: Any, key: str) -> str:
    if key == "start_time":
        return "" if value is None else moment(value).removesuffix(" UTC")
    if key == "updated":
        return "yes" if value else ""
    if key == "revolutions" and isinstance(value, (int, float)):
        return f"{value:,.0f}"
    return number(value, 4)


def notes_of(records: Sequence[Mapping[str, Any]], known: str | None) -> list[str]:
    """The notes of windows, each once, without the one that is the reason given already."""
    noted: dict[str, list[str]] = {}
    for record in records:
        for note in record.get("notes") or ():
            if note != known:
                noted.setdefault(str(note), []).append(str(record.get("index")))
    lines = []
    for note, at in noted.items():
        where = ", ".join(at) if len(at) <= MOST_NOTES else f"{at[0]} to {at[-1]} ({len(at)} windows)"
        lines.append(f"Note on window {where}: {note}")
    more = len(lines) - MOST_NOTES
    return lines if more <= 0 else [*lines[:MOST_NOTES], f"and {more} more notes (see windows[].notes in the JSON)"]
