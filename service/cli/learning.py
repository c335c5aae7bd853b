"""`gear-twin calibrate`, `baseline`, `relate`, `depths` and `detectability`: what is learned of a machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from service.cli.assessing import Asset, Prefix, Recording, RigFile, Shown, answering, assessed, prefix_of, windowing
from service.cli.config import configured
from service.cli.show import progress_bar
from service.errors import InputError
from service.json_text import write_text
from service.report.words import number
from service.runtime.usable_cores import usable_cores

CHANNELS = ("torque", "encoder/pinion", "encoder/gear")
UNITS = {"damping_time": "s", "contact_half_width": "m"}
LABELS = {
    "stiffness_scale": "mesh stiffness, of the computed",
    "modal_damping": "modal damping ratio",
    "damping_time": "mesh damping over mesh stiffness",
    "contact_half_width": "half-width of the contact",
}


@configured
@answering
def calibrate(
    recording: Recording,
    rig: RigFile = None,
    unworn: Annotated[
        int, Option(min=1, help="Number of measurement windows, from the first, that are taken as unworn.")
    ] = 3,
    asset: Asset = None,
    prefix: Prefix = None,
) -> Shown:
    """Fit mesh stiffness, damping and contact width to low-speed and unworn windows."""

    def enough(records: Any) -> bool:
        return sum(r["kind"] == "measurement" and r["quality"] != "refused" for r in records) >= unworn

    answer = assessed(recording, rig, asset, prefix, enough=enough, trace=False)
    used = [r["index"] for r in answer["windows"] if r["quality"] != "refused"]
    found = {"asset": answer["asset"], "windows": used, "calibration": answer["calibration"]}
    return Shown(found, lambda: calibration_text(found))


def calibration_text(found: Mapping[str, Any]) -> str:
    """The calibration as a table, with the misfit and the doubts that it leaves."""
    calibration = found["calibration"]
    if "values" not in calibration:
        return f"Calibration of {found['asset']}: not available: {calibration.get('reason')}"
    spread = calibration.get("std_percent") or {}
    lines = [f"Calibration of {found['asset']} from windows {', '.join(map(str, found['windows']))}", ""]
    for name, value in calibration["values"].items():
        std = "" if spread.get(name) is None else f" ± {number(spread[name], 2)} %"
        shown = f"{number(value)} {UNITS.get(name, '')}".rstrip()
        lines.append(f"  {LABELS.get(name, name.replace('_', ' ')):<34}{shown}{std}")
    lines += ["", *_fit(calibration)]
    return "\n".join(lines)


def _fit(calibration: Mapping[str, Any]) -> list[str]:
    """How well the calibrated model fits the windows it was calibrated with."""
    if calibration["from"] != "windows":
        return ["No window could be used: these are the values that the rig file states or implies."]
    misfit, doubts = calibration.get("misfit"), calibration.get("doubts") or []
    meaning = "mean squared residual over its expected spread; about 1 or less where the model fits"
    lines = [f"Misfit: {number(misfit, 3)} ({meaning})."]
    lines += [f"Doubt: {doubt}." for doubt in doubts]
    if not doubts:
        lines.append("No doubt: the calibrated values are within the spreads of the rig file.")
    return lines


@configured
@answering
def baseline(
    recordings: Annotated[list[Path], Argument(metavar="RECORDING…", help="Recordings of the healthy machine.")],
    out: Annotated[Path, Option(help="Baseline file to write.")],
    rig: RigFile = None,
    prefix: Prefix = None,
) -> Shown:
    """Learn a healthy baseline for a machine without a model: every spectral line against load and speed."""
    from service.contract.parts import json_of
    from service.files.baseline import learned, save
    from service.report.baseline import learned_text
    from twin.baseline.comparison import described

    found = learned(recordings, rig, windowing(), prefix_of(prefix))
    save(found, out)
    said = json_of(described(found))
    return Shown(said, lambda: learned_text(said), (f"baseline written to {out}",))


@answering
def relate(
    series: Annotated[Path, Argument(metavar="SERIES", help="Series file (TOML): levels at measured wear depths.")],
    source: Annotated[
        Path | None, Option(help="Table of records (CSV) instead of the one that the series file names.")
    ] = None,
    out: Annotated[Path | None, Option(help="HTML page with figures to write.")] = None,
    relation: Annotated[Path | None, Option(help="Relation file to write, for `serve --relation`.")] = None,
    draws: Annotated[int, Option(min=0, max=200, help="Number of draws of the estimated values.")] = 12,
) -> Shown:
    """Calibrate the relation of vibration level and wear depth on measured depths, and test causes of its error."""
    from service.files import relation as relating
    from service.files.series import load_series
    from service.report.relation import relation_text
    from twin.errors import TwinError

    known = load_series(series, source)
    with progress_bar("relating") as bar:
        try:
            tried = relating.tried_on(known, draws, bar)
        except TwinError as error:
            raise InputError(f"{series}: {error}") from None
    answer = relating.answer(known, tried)
    if relation is not None:
        relating.save_relation(known, tried, relation)
    if out is not None:
        from service.report.pages import relation_page

        write_text(out, relation_page(answer))
    written = ((out, "figures"), (relation, "relation"))
    notes = tuple(f"{what} written to {path}" for path, what in written if path is not None)
    return Shown(answer, lambda: relation_text(answer), notes)


@answering
def depths(
    relation: Annotated[Path, Argument(metavar="RELATION", help="Relation file (from `relate`).")],
    table: Annotated[Path, Argument(metavar="TABLE", help="Levels (CSV), a row a record, columns as `relate`.")],
    delimiter: Annotated[str, Option(help="Between the columns of the table.")] = ",",
    out: Annotated[Path | None, Option(help="CSV file to write.")] = None,
) -> Shown:
    """Wear depths of a table of vibration levels, by a relation of level and depth."""
    from service.files.relation import read_relation
    from service.files.series import as_csv, depths_of
    from service.report.relation import depths_text

    found = depths_of(read_relation(relation), table, delimiter)
    if out is not None:
        write_text(out, as_csv(found))
    notes = () if out is None else (f"{len(found)} depths written to {out}",)
    return Shown(found, lambda: depths_text(found) if out is None else (), notes)


@answering
def detectability(
    rig: Annotated[Path, Argument(metavar="RIG", help="Rig file (TOML).")],
    false_alarm_rate: Annotated[
        float, Option(help="Share of campaigns of healthy machines in which an effect may be reported.")
    ] = 0.01,
    speed_hz: Annotated[float | None, Option(help="Speed of the pinion; default: the rig file's.")] = None,
    torque_nm: Annotated[float | None, Option(help="Torque on the pinion; default: the rig file's.")] = None,
    depth_um: Annotated[
        float | None, Option(help="Wear depth of the last window; default: a tenth of the end-of-life depth.")
    ] = None,
    windows: Annotated[int, Option(min=4, max=60, help="Measurement windows of a campaign.")] = 6,
    seconds: Annotated[float, Option(min=0.5, max=60, help="Length of a window.")] = 2.5,
    without: Annotated[
        list[str] | None, Option(help=f"Channel that the machine lacks, of {', '.join(CHANNELS)}; repeatable.")
    ] = None,
    healthy: Annotated[int, Option(min=20, max=10_000, help="Healthy machines that are simulated.")] = 100,
    machines: Annotated[int, Option(min=1, max=100, help="Machines that are simulated for each effect.")] = 2,
    processes: Annotated[int, Option(min=1, help="Processes; default: as many as cores.")] = usable_cores(),
    out: Annotated[Path | None, Option(help="File to write, for `assess --detectability`.")] = None,
) -> Shown:
    """Simulate machines of a rig file, and tell from which size each effect is found at a rate of false alarms."""
    from service.files.detectability import answer, save
    from service.files.rig import load_rig
    from twin.detectability.study import study
    from twin.errors import TwinError

    known = load_rig(rig)
    try:
        campaign = _campaign(known, speed_hz, torque_nm, depth_um, windows, seconds, without or [])
        with progress_bar("simulating") as bar, _mapping(processes) as mapped:
            found = study(
                known, campaign, rate=false_alarm_rate, healthy=healthy, machines=machines, mapped=mapped, progress=bar
            )
    except TwinError as error:
        raise InputError(f"{rig}: {error}") from None
    data = answer(known, found)
    if out is not None:
        save(known, found, out)
    notes = () if out is None else (f"thresholds and detection limits written to {out}",)
    return Shown(data, lambda: _limits_text(data), notes)


def _campaign(
    rig: Any,
    speed: float | None,
    torque: float | None,
    depth: float | None,
    windows: int,
    seconds: float,
    without: list[str],
) -> Any:
    """The windows that are simulated."""
    from dataclasses import replace

    from twin.detectability.windows import Campaign, instruments_of
    from twin.model import Condition

    unknown = [name for name in without if name not in CHANNELS]
    if unknown:
        raise InputError(f"--without {unknown[0]}: must be one of {', '.join(CHANNELS)}")
    if speed is None:
        (speed,) = rig.require("the speed", "operating.pinion_speed_hz")
    if torque is None:
        (torque,) = rig.require("the torque", "operating.input_torque")
    if depth is None:
        (end,) = rig.require("the wear depth of the last window", "end_of_life.max_depth")
        depth = 1e6 * end / 10
    instruments = instruments_of(rig, seconds)
    kept = tuple(name for name in instruments.channels if name not in without)
    return Campaign(
        conditions=(Condition(speed_hz=float(speed), torque=float(torque)),) * windows,
        depth=1e-6 * float(depth),
        instruments=replace(instruments, channels=kept),
    )


@contextmanager
def _mapping(processes: int) -> Iterator[Any]:
    """A map over so many processes."""
    if processes == 1:
        yield map
        return
    from concurrent.futures import ProcessPoolExecutor

    with ProcessPoolExecutor(processes) as pool:
        yield pool.map


def _limits_text(data: dict[str, Any]) -> list[str]:
    """The sizes from which effects are found, and the evidence that healthy machines give for them."""
    from service.report.words import label, size, table

    first, healthy = data["conditions"][0], data["healthy_campaigns"]
    rows = []
    for limit in data["detection_limits"]:
        found, tried = (
            size({"value": limit[k], "unit": limit["unit"], "std": None}) for k in ("value", "largest_tried")
        )
        value = "–" if limit["value"] is None else f"{limit['parameter'].replace('_', ' ')} {found}"
        note = limit["note"] if limit["largest_tried"] is None else f"{limit['note']}: {tried}"
        factor = "" if limit["value"] is None else f"{limit['within_factor']:.2f}"
        rows.append((label(limit["name"]), value, factor, note))
    alarms = [
        f"{name}: {len(known['evidence'])} of {healthy} healthy machines give it some evidence, at most "
        f"{max(known['evidence']):.1f} nat; {known['required_evidence']:.1f} nat are required"
        for name, known in data["false_alarms"].items()
    ]
    none = (
        f"None of {healthy} healthy machines gives evidence for any effect, even with thresholds lowered; the "
        "thresholds are those of the register."
    )
    return [
        f"{data['rig']}: {len(data['conditions'])} windows of {data['window_seconds']:g} s at {first['speed_hz']:g} Hz "
        f"and {first['torque_nm']:g} N·m, worn to {data['wear_depth_um']:g} µm; {', '.join(data['channels'])}",
        *table(rows, ("effect", "found from", "within a factor of", "note")),
        *(alarms or [none]),
        f"Rate of false alarms asked for: {data['false_alarm_rate']:g} of the campaigns. The simulated machines have "
        "the structure of the rig file within its tolerances; a machine of another structure may do worse.",
    ]
