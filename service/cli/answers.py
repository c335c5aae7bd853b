"""`gear-twin assess`, `report`, `diagnose` and `what-if`: answers about a machine from a recording."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, Option

from service.cli.assessing import (
    Asset,
    NoTrace,
    Prefix,
    Recording,
    RigFile,
    Shown,
    answering,
    assessed,
    prefix_of,
    settings_of,
    tell,
    windowing,
)
from service.cli.config import configured
from service.cli.rest import Service, with_service
from service.cli.show import progress_bar
from service.errors import InputError
from service.file_faults import json_of_file
from service.json_text import write_text

NEEDED = ("asset", "windows", "wear", "rul", "effects", "data_quality", "tracing", "unexplained")  # of an answer
RADII_MM = (0.5, 5000.0)  # of a wheel


Update = Literal["fused", "rms"]  # the method that sets the wear depth
Source = Annotated[Path, Argument(metavar="SOURCE", help="Recording (MCAP), or the JSON that `assess` wrote.")]


@configured
@answering
def assess(
    recording: Recording,
    rig: RigFile = None,
    update: Annotated[
        Update | None,
        Option(
            help="Method that sets the depth: transmission error (fused) or vibration level (rms); default: the "
            "setting, else fused."
        ),
    ] = None,
    no_trace: NoTrace = False,
    relation: Annotated[
        Path | None, Option(help="Relation of level and depth (from `relate`), for machines without a model.")
    ] = None,
    detectability: Annotated[
        Path | None, Option(help="What simulated healthy machines of the rig show (from `detectability`).")
    ] = None,
    false_alarm_rate: Annotated[
        float | None,
        Option(help="Share of campaigns of healthy machines in which an effect may be reported; default 0.01."),
    ] = None,
    asset: Asset = None,
    prefix: Prefix = None,
    mcap: Annotated[
        Path | None,
        Option(help="Write a copy of the recording with the results in it, and a layout file for Foxglove."),
    ] = None,
) -> Shown:
    """Evaluate a whole recording, as the service would: wear depth, remaining life, other effects."""
    from service.files.results_recording import write_results
    from service.report.text import answer_text
    from service.runtime.assess import Unassessable

    try:
        answer = assessed(
            recording, rig, asset, prefix, update=update, trace=not no_trace,
            relation=relation, detectability=detectability, false_alarm_rate=false_alarm_rate,
        )  # fmt: skip
    except Unassessable as error:
        return Shown(error.answer, lambda: (), failed=error)
    notes: tuple[str, ...] = ()
    if mcap is not None:
        with progress_bar("writing") as bar:
            layout = write_results(answer, recording, mcap, prefix_of(prefix), bar)
        notes = (f"recording with results written to {mcap}, layout for Foxglove to {layout}",)
    return Shown(answer, lambda: answer_text(answer), notes)


@configured
@answering
def report(
    source: Source,
    out: Annotated[
        list[Path] | None, Option(help="Report to write, .html or .pdf; may be given twice. Default: print text.")
    ] = None,
    rig: RigFile = None,
    no_trace: NoTrace = False,
    asset: Asset = None,
    prefix: Prefix = None,
) -> Shown:
    """Summarise an assessment for people: as text, as one HTML page, or as a PDF of two pages."""
    from service.report import write_report
    from service.report.text import report_text

    answered = source.suffix == ".json"
    answer = load_answer(source) if answered else assessed(source, rig, asset, prefix, trace=not no_trace)
    for path in out or ():
        write_report(answer, path, machine_of(source, rig, prefix_of(prefix)))
    return Shown(answer, lambda: () if out else report_text(answer), tuple(f"report written to {p}" for p in out or ()))


@configured
@answering
def diagnose(
    source: Source,
    out: Annotated[Path | None, Option(help="HTML page with figures to write.")] = None,
    rig: RigFile = None,
    baseline: Annotated[
        Path | None, Option(help="Healthy baseline to compare with, for machines without a model.")
    ] = None,
    base_radii_mm: Annotated[
        tuple[float, float] | None,
        Option(help="Assumed base radii of pinion and gear in mm, for run-out in µm if the rig file has none."),
    ] = None,
    asset: Asset = None,
    prefix: Prefix = None,
) -> Shown:
    """Attribute vibration that wear does not explain: effects, their evidence, and what remains unexplained."""
    from service.files.baseline import answer as answer_of
    from service.files.baseline import compared, energy_of, read_baseline
    from service.report.baseline import comparison_text
    from service.report.text import diagnosis_text

    if baseline is not None:
        known = read_baseline(baseline)
        loaded, found = compared(known, source, rig, windowing(), prefix_of(prefix))
        answer = answer_of(loaded, known, found)
    elif source.suffix == ".json":
        answer = load_answer(source)
    else:
        answer = assessed(source, rig, asset, prefix)
        if answer.get("unattributed_lines"):
            answer["energy_breakdown"] = energy_of(source, rig, windowing(), prefix_of(prefix))
    if base_radii_mm is not None:
        answer = with_assumed_radii(answer, base_radii_mm)
    if out is not None:
        from service.report.pages import comparison_page, diagnosis_page

        write_text(out, diagnosis_page(answer) if baseline is None else comparison_page(answer))
    notes = () if out is None else (f"figures written to {out}",)
    return Shown(answer, lambda: diagnosis_text(answer) if baseline is None else comparison_text(answer), notes)


def load_answer(path: Path) -> dict[str, Any]:
    """The answer that `assess --json` wrote."""
    answer = json_of_file(path, "an answer of gear-twin assess --json")
    missing = [key for key in NEEDED if key not in answer] if isinstance(answer, dict) else list(NEEDED)
    if missing:
        raise InputError(f"{path}: not an answer of gear-twin assess --json: {', '.join(missing)} missing")
    return dict(answer)


def machine_of(source: Path, rig: Path | None, prefix: str) -> Mapping[str, Any] | None:
    """The mapping of the rig file in use: the one given, else that of the recording; None for an answer without."""
    from service.files.rig import load_mapping
    from service.stream.sources.mcap import Recording

    if rig is not None:
        return load_mapping(rig)
    if source.suffix == ".json":
        return None
    with Recording(source, prefix) as recording:
        return recording.rig()


def with_assumed_radii(answer: Mapping[str, Any], radii_mm: tuple[float, float]) -> dict[str, Any]:
    """The answer with run-out in µm on assumed base radii of pinion and gear [mm].

    Raises InputError where a radius cannot be, the answer has no pair, or the rig file has base radii.
    """
    from service.contract.parts import with_assumed_radii as on_assumed_radii
    from service.report.words import reason

    low, high = RADII_MM
    for shaft, radius in zip(("pinion", "gear"), radii_mm, strict=True):
        if not low <= radius <= high:  # NaN fails too
            raise InputError(
                f"--base-radii-mm: {radius:g} mm of the {shaft} is outside [{low:g}, {high:g}] mm; metres?"
            )
    pair = answer.get("pair")
    if pair is None or "ratio" not in pair:
        why = "the answer has no pair of encoders" if pair is None else reason(pair)
        raise InputError(f"--base-radii-mm: there is no run-out to be given in µm: {why}")
    known = pair["base_radii"]
    if known is not None:
        raise InputError(
            f"--base-radii-mm: the rig file gives {known['pinion_mm']:g} and {known['gear_mm']:g} mm: leave it out"
        )
    return {**answer, "pair": on_assumed_radii(pair, (radii_mm[0] / 1e3, radii_mm[1] / 1e3))}


@configured
@answering
@partial(with_service, url=False)
def what_if(
    service: Service,
    source: Annotated[
        str, Argument(metavar="SOURCE", help="Recording (MCAP), or address of a service: http://HOST:PORT.")
    ],
    duty: Annotated[
        list[str] | None,
        Option(
            metavar="SPEED_HZ,TORQUE_NM[,SHARE]",
            help="An operating condition and its share of the running time; may be repeated. Default: the present one.",
        ),
    ] = None,
    until: Annotated[str | None, Option(metavar="DATE", help="Date to reach, ISO 8601.")] = None,
    hours: Annotated[float | None, Option(help="Hours of operation to reach.")] = None,
    depth: Annotated[
        float | None, Option(metavar="UM", help="Depth to reach in µm; default: the rig file's end of life.")
    ] = None,
    hours_per_day: Annotated[
        float | None, Option(help="Running time per day; default: the rig file's, or as observed.")
    ] = None,
    rig: RigFile = None,
    no_trace: NoTrace = False,
    asset: Annotated[str | None, Option(help="The asset, if there is more than one.")] = None,
    prefix: Prefix = None,
) -> Shown:
    """Remaining life under another duty, and the probability of reaching a date."""
    body = {
        "duty": [_point(text) for text in duty] if duty else None,
        "until": until,
        "hours": hours,
        "hours_per_day": hours_per_day,
        "max_depth_um": depth,
    }
    asked = {key: value for key, value in body.items() if value is not None}
    if source.startswith(("http://", "https://")):
        there = service.at(source)
        found = there.ask("assets", asset or there.only_asset(), "what-if", body=asked)
    else:
        found = _of_recording(Path(source), rig, asset, prefix, asked, trace=not no_trace)
    return Shown(found, lambda: what_if_text(found))


def _point(text: str) -> dict[str, float]:
    parts = text.split(",")
    try:
        values = [float(part) for part in parts]
    except ValueError:
        values = []
    if len(values) not in (2, 3):
        raise InputError(f"--duty {text}: must be SPEED_HZ,TORQUE_NM or SPEED_HZ,TORQUE_NM,SHARE, such as 10,12.5,0.7")
    return dict(zip(("speed_hz", "torque_nm", "share"), values, strict=False))


def _of_recording(
    recording: Path, rig: Path | None, asset: str | None, prefix: str | None, asked: dict[str, Any], *, trace: bool
) -> dict[str, Any]:
    """The answer from a recording, assessed now."""
    from pydantic import ValidationError

    from service.contract.what_if import WhatIfIn
    from service.contract.what_if_answer import answer
    from service.runtime.assess import assess_with_state, warnings
    from service.runtime.by_settings import options_of
    from twin.errors import NotAvailable, ParameterError

    try:
        given = WhatIfIn(**asked)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"]) or "question"
        raise InputError(f"{name}: {first['msg'].removeprefix('Value error, ')}") from None
    options = options_of(settings_of(), trace=trace)
    with progress_bar("assessing") as bar:
        assessed_rig, state, found = assess_with_state(
            recording, rig, options, lambda share, windows: bar(share, f"{windows} windows"),
            asset=asset, prefix=prefix_of(prefix), assembly=windowing(),
        )  # fmt: skip
    for line in warnings(recording, found):
        tell(line)
    try:
        return answer(found["asset"], assessed_rig, state, given)
    except (NotAvailable, ParameterError) as reason:
        raise InputError(str(reason)) from None


def what_if_text(found: dict[str, Any]) -> str:
    """The answer for people."""
    limit = f"{found['max_depth_um']:.0f} µm"
    lines = [f"{found['asset']}: life to {limit} under this duty"]
    if found["reached"]:
        lines.append("  the end of life is reached")
    lines.append(f"  {_band(found['hours'])} h of operation, {_band(found['revolutions'])} revolutions")
    lines.append(f"  present duty: {_band(found['present_hours'])} h")
    date = found["date"]
    if "reason" in date:
        lines.append(f"  date: {date['reason']}")
    else:
        running = found["running"]
        days = [("–" if date[key] is None else date[key][:10]) for key in ("median", "p05", "p95")]
        lines.append(
            f"  until {days[0]} ({days[1]} … {days[2]}) at {running['hours_per_day']:.3g} h a day ({running['source']})"
        )
    target = found["target"]
    if target is not None:
        when = f"{target['hours']:.4g} h" + (f" ({target['date'][:10]})" if target["date"] else "")
        chance = "not known" if target["probability"] is None else f"{100 * target['probability']:.0f} %"
        lines.append(f"  probability of reaching {when}: {'at least ' if target['at_least'] else ''}{chance}")
    if found["preliminary"]:
        lines += [f"  preliminary: {reason}" for reason in found["preliminary"]["reasons"]]
        lines.append(f"  to settle it: {'; '.join(found['preliminary']['remedies'])}")
    lines += [f"  {note}" for note in (*found["notes"], *([found["reason"]] if found["reason"] else []))]
    return "\n".join(lines)


def _band(band: Mapping[str, float | None]) -> str:
    median, low, high = ("–" if band[key] is None else f"{band[key]:,.4g}" for key in ("median", "p05", "p95"))
    return f"{median} ({low} … {high})"
