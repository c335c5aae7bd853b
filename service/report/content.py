"""What a report says, from the answer of the contract; nothing is computed here that the answer does not hold."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from service import __version__
from service.printable import all_printable
from service.report.findings import Finding, findings, number

LEVELS = {"normal": "Normal", "no_verdict": "No verdict", "watch": "Watch", "alarm": "Alarm", "end_of_life": "Stop"}
MOST_REASONS = 5
MOST_WINDOWS = 10
Row = tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A report's content; every text is a sentence or a figure with its unit."""

    asset: str
    made: str  # date and time, UTC
    latest: str  # of the measurement that it rests on
    level: str  # key of LEVELS
    action: str
    reasons: tuple[str, ...]
    since: str
    data: str  # quality of the data, in one sentence
    figures: tuple[tuple[str, str, str], ...]  # name, value, detail
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
    life = rul.get("revolutions") if isinstance(rul.get("revolutions"), Mapping) else None
    return Report(
        asset=answer["asset"],
        made=(made or datetime.now(UTC)).strftime("%Y-%m-%d %H:%M UTC"),
        latest=_latest(status, records),
        level=status.get("level") or "no_verdict",
        action=status.get("action") or "",
        reasons=tuple((status.get("reasons") or ())[:MOST_REASONS]),
        since=_since(since),
        data=_data(answer),
        figures=(*_depth(answer), *_life(answer), *_level(records)),
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
    """When the window began that the state rests on; of a state that names none, the latest."""
    if not records:
        return "no measurement yet"
    start = (status.get("verdict") or {}).get("start_time")
    return _moment(start or records[-1].get("start_time"))


def _again(answer: Mapping[str, Any]) -> tuple[tuple[float, float], ...]:
    """The depth of the whole history with the effects that were found; empty where none were."""
    tracing = answer.get("tracing") or {}
    if not answer.get("effects") or not available(tracing):
        return ()
    rows = [(d.get("revolutions"), d.get("wear_depth_um_after")) for d in tracing.get("depths") or ()]
    return tuple(sorted((n, depth) for n, depth in rows if n is not None and depth is not None))


def available(part: Any) -> bool:
    """Whether a part of the answer holds figures."""
    return bool(part) and not (isinstance(part, Mapping) and part.get("status") == "not available")


def _moment(text: Any) -> str:
    return f"{text[:10]} {text[11:16]} UTC" if isinstance(text, str) and len(text) > 16 else "time not recorded"


def _since(since: Mapping[str, Any]) -> str:
    parts = []
    if since.get("time"):
        parts.append(_moment(since["time"]))
    if since.get("revolutions") is not None:
        parts.append(f"{since['revolutions']:,.0f} pinion revolutions")
    return f"since {' and '.join(parts)}" if parts else ""


def _data(answer: Mapping[str, Any]) -> str:
    data = answer.get("data") or {}
    if data.get("level"):
        return f"{data['level']}: {data.get('reason', '')}".rstrip(": ")
    counts = answer["data_quality"].get("windows") or {}
    return ", ".join(f"{count} {grade}" for grade, count in counts.items() if count) or "no window"


def _band(band: Mapping[str, Any], unit: str) -> str:
    low, high = band.get("p05"), band.get("p95")
    if high is None:
        return f"at least {number(low)} {unit} (95 % confidence)" if low is not None else "no band"
    return f"5–95 %: {number(low)} to {number(high)} {unit}"


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
    return [("Wear depth", f"{number(depth.get('median'))} µm", f"{_preliminary(wear)}{_band(depth, 'µm')}{share}")]


def _life(answer: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    rul = answer["rul"]
    if not available(rul):
        return []
    hours, turns = rul["hours"], rul["revolutions"]
    name = "Remaining life, of wear alone" if rul.get("of_wear_alone") else "Remaining life"
    if hours.get("median") is None:
        return [(name, f"at least {number(hours['p05'])} h", _sentence(rul.get("reason") or ""))]
    detail = f"{_preliminary(rul)}{_band(hours, 'h')}; {number(turns['median'])} revolutions of the pinion{_date(rul)}"
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


PARTS = {"wear": "wear depth", "rul": "remaining life", "residual": "residual", "calibration": "calibration"}


def _limits(answer: Mapping[str, Any]) -> list[str]:
    """What the answer cannot say, each reason once, then what is preliminary and what would settle it."""
    missing: dict[str, list[str]] = {}
    for key, name in PARTS.items():
        part = answer.get(key)
        if isinstance(part, Mapping) and part.get("status") == "not available":
            missing.setdefault(part["reason"], []).append(name)
    out = [f"Not available: {', '.join(names)}. {_sentence(reason)}" for reason, names in missing.items()]
    said: set[str] = set()
    for key in ("wear", "rul"):
        preliminary = (answer.get(key) or {}).get("preliminary") or {}
        for kind, start in (("reasons", "Preliminary"), ("remedies", "What would settle it")):
            for text in preliminary.get(kind) or ():
                if text not in said:
                    said.add(text)
                    out.append(f"{start}: {_sentence(text)}")
    sufficiency = (answer.get("baseline") or {}).get("sufficiency") or {}
    out += [f"Not judged: {item['what']}. {_sentence(item['reason'])}" for item in sufficiency.get("not_judged") or ()]
    left = answer.get("unexplained") or {}
    if left.get("verdict") == "insufficient_data" and left.get("reason") and left["reason"] not in missing:
        out.append(f"The residual could not be judged: {_sentence(left['reason'], capital=False)}")
    if left.get("verdict") == "explained" and left.get("reason"):
        out.append(f"Small, and of no known effect: {_sentence(left['reason'], capital=False)}")
    found, *sizes = (answer.get("detectable") or {}).get("said") or ("",)
    return [*out, f"{found} {'; '.join(sizes)}."] if sizes else out


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
    out.append(
        "A 5–95 % band contains the true value nine times in ten if the model holds. "
        "Errors are computed on held-out measurements, which no fit used."
    )
    left = answer.get("unexplained") or {}
    if left.get("share_percent") is not None and left["share_percent"] <= 100:  # else the reason says by how much
        limit = (
            ""
            if left.get("limit_percent") is None
            else f" (limit of the held-out error: {left['limit_percent']:.0f} %)"
        )
        verdict = str(left.get("verdict", "")).replace("_", " ")
        out.append(f"Unexplained: {number(left['share_percent'])} % of the measured energy; verdict: {verdict}{limit}.")
    calibration = answer.get("calibration") or {}
    if available(calibration) and calibration.get("misfit") is not None:
        doubts = "; ".join(calibration.get("doubts") or ()) or "none"
        out.append(
            f"Misfit of the calibration: {number(calibration['misfit'])} (1 or less is a good fit); doubts: {doubts}."
        )
    return out


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


WINDOW_COLUMNS = (
    ("time", "start_time"),
    ("revolutions", "revolutions"),
    ("speed Hz", "speed_hz"),
    ("torque N·m", "torque_nm"),
    ("RMS m/s²", "rms_measured"),
    ("model m/s²", "rms_predicted"),
    ("depth µm", "wear_depth_um"),
    ("data", "quality"),
)


def _windows(records: Sequence[Mapping[str, Any]]) -> list[Row]:
    """The latest measurements with the columns that hold anything."""
    latest = [r for r in records if r.get("kind") != "calibration"][-MOST_WINDOWS:]
    columns = [(title, key) for title, key in WINDOW_COLUMNS if any(r.get(key) is not None for r in latest)]
    if not latest:
        return []
    return [tuple(title for title, _ in columns), *(tuple(_cell(r.get(k), k) for _, k in columns) for r in latest)]


def _cell(value: Any, key: str) -> str:
    if key == "start_time":
        return _moment(value).removesuffix(" UTC")
    if key == "revolutions" and value is not None:
        return f"{value:,.0f}"
    if key == "wear_depth_um" and value is not None:
        return f"{value:.1f}"
    return value if isinstance(value, str) else number(value)


def _sentence(text: str, capital: bool = True) -> str:
    text = text[:1].upper() + text[1:] if capital else text
    return text if not text or text.endswith(".") else f"{text}."
