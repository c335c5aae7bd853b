"""The commands of `gear-twin`; what a command needs is imported when it runs."""

from __future__ import annotations

import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.effects import app as effects
from service.cli.example import app as example

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Digital twin of gear wear: vibration in, wear depth and remaining life out.",
)


app.add_typer(effects, name="effects")
app.add_typer(example, name="example")


class Update(StrEnum):
    """What sets the wear depth."""

    fused = "fused"
    rms = "rms"


Recording = Annotated[Path, typer.Argument(metavar="RECORDING", help="MCAP recording by the contract.")]
RigFile = Annotated[Path | None, typer.Option("--rig", help="Rig file; without it, the recording's attachment.")]
Asset = Annotated[str | None, typer.Option(help="The asset to look at, where a recording holds several.")]
Prefix = Annotated[str, typer.Option(help="First part of all keys and topics.", envvar="GEAR_TWIN_PREFIX")]
UpdateMethod = Annotated[Update, typer.Option(help="What sets the depth: transmission error (fused) or the RMS (rms).")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - prints it.")]
NoTrace = Annotated[bool, typer.Option("--no-trace", help="Wear alone: seek no effects that the model lacks.")]
JsonFlag = Annotated[bool, typer.Option("--json", help="Print what was done as JSON.")]
Connect = Annotated[list[str] | None, typer.Option(help="Endpoint of the service or router: tcp/127.0.0.1:7447.")]
Listen = Annotated[list[str] | None, typer.Option(help="Endpoint at which to open a router of its own.")]


@app.command()
def assess(
    recording: Recording,
    rig: RigFile = None,
    json: JsonFile = None,
    update: UpdateMethod = Update.fused,
    no_trace: NoTrace = False,
    relation: Annotated[
        Path | None, typer.Option(help="Relation of level and wear depth, where the rig file gives no model.")
    ] = None,
    asset: Asset = None,
    prefix: Prefix = "gearbox",
) -> None:
    """Run a whole recording through the twin, as the service would."""
    from service.json_text import json_text, write_text
    from service.runtime.assess import Unassessable

    try:
        answer = _assess(recording, rig, update, asset, prefix, trace=_tracing(no_trace), relation=relation)
    except Unassessable as error:
        if json is not None:
            write_text(json, json_text(error.answer))
        raise
    _give(answer, json)


@app.command()
def calibrate(
    recording: Recording,
    rig: RigFile = None,
    json: JsonFile = None,
    unworn: Annotated[int, typer.Option(min=1, help="Measurement windows, from the first, used as unworn.")] = 3,
    asset: Asset = None,
    prefix: Prefix = "gearbox",
) -> None:
    """Fit mesh stiffness, damping and contact width to low-speed and unworn windows."""
    from service.cli.show import say
    from service.json_text import json_text, write_text

    def enough(records: Any) -> bool:
        return sum(r["kind"] == "measurement" and r["quality"] != "refused" for r in records) >= unworn

    answer = _assess(recording, rig, Update.fused, asset, prefix, enough, trace=False)
    used = [r["index"] for r in answer["windows"] if r["quality"] != "refused"]
    found = {"asset": answer["asset"], "windows": used, "calibration": answer["calibration"]}
    write_text(json or "-", json_text(found))
    if json is not None and str(json) != "-":
        say(f"calibration from {len(used)} windows written to {json}")


@app.command()
def replay(
    recording: Recording,
    connect: Connect = None,
    speed: Annotated[
        float,
        typer.Option(min=0.0, help="Times as fast as recorded; 0: as fast as it is taken, without pauses."),
    ] = 1.0,
    max_pause: Annotated[
        float, typer.Option(min=0.0, help="Longest pause between frames that is kept [s of the recording].")
    ] = float("inf"),
    wait: Annotated[float, typer.Option(min=0.1, help="How long to wait for a router and a subscriber [s].")] = 30.0,
    prefix: Prefix = "gearbox",
    json: JsonFlag = False,
) -> None:
    """Publish a recording as it was recorded; done when all of it has been delivered."""
    from service.cli.show import progress_bar
    from service.json_text import json_text
    from service.runtime.replay import replay as run

    _finite("speed", speed)
    settings = _settings()
    begun = time.monotonic()
    with progress_bar("replaying") as bar:
        delivered = run(
            recording,
            connect or settings.connect or settings.listen,
            speed,
            max_pause=max_pause,
            prefix=prefix,
            wait=wait,
            progress=lambda share, frames: bar(share, f"{frames} frames"),
            on_fault=_tell,
        )
    taken = time.monotonic() - begun
    print(
        json_text({"frames": delivered, "seconds": taken}) if json else f"{delivered} frames delivered in {taken:.2f} s"
    )


@app.command()
def record(
    out: Annotated[Path, typer.Option(help="MCAP file to write.", show_default=False)],
    connect: Connect = None,
    listen: Listen = None,
    duration: Annotated[float, typer.Option(min=0.0, help="Stop after this time [s]; else with Ctrl-C.")] = float(
        "inf"
    ),
    rig: RigFile = None,
    description: Annotated[str, typer.Option(help="Text for the recording's metadata.")] = "recorded live",
    prefix: Prefix = "gearbox",
    json: JsonFlag = False,
) -> None:
    """Record a live stream."""
    from service.cli.live import record_live
    from service.json_text import json_text

    frames, refused = record_live(out, connect, listen, duration, rig, description, prefix)
    print(
        json_text({"recording": str(out), "frames": frames, "refused": refused})
        if json
        else f"{frames} frames recorded, {refused} refused: {out}"
    )


@app.command()
def simulate(
    spec: Annotated[Path, typer.Argument(metavar="SPEC", help="Campaign spec (TOML).")],
    out: Annotated[Path, typer.Option(help="MCAP file to write.", show_default=False)],
    truth: Annotated[Path | None, typer.Option(help="File for the truth about the campaign (JSON).")] = None,
    json: JsonFlag = False,
) -> None:
    """Simulate a wear campaign into a recording."""
    from recordings import simulate_file
    from recordings.generator.errors import SpecError
    from service.cli.show import progress_bar
    from service.errors import InputError
    from service.json_text import json_text

    with progress_bar("simulating") as bar:
        try:
            simulate_file(spec, out, truth, bar)
        except SpecError as error:
            raise InputError(str(error)) from None
        except OSError as error:
            raise InputError(f"{error.filename}: {(error.strerror or 'fault').lower()}") from None
    print(json_text({"recording": str(out), "truth": str(truth) if truth else None}) if json else f"simulated: {out}")


@app.command(name="import")
def import_(
    mapping: Annotated[Path, typer.Argument(metavar="MAPPING", help="Mapping file (TOML) of columns to channels.")],
    out: Annotated[Path, typer.Option(help="MCAP file to write.", show_default=False)],
    source: Annotated[Path | None, typer.Option(help="Data file (CSV, NPZ), instead of the mapping's.")] = None,
    json: JsonFlag = False,
) -> None:
    """Bring measured columns (CSV, NPZ) into a recording."""
    from service.cli.show import progress_bar
    from service.files.import_recording import import_recording
    from service.json_text import json_text

    with progress_bar("importing") as bar:
        found = import_recording(mapping, out, lambda done, total: bar(done / max(total, 1), f"{done} frames"), source)
    print(json_text(found) if json else f"{found['frames']} frames of {found['duration']:g} s imported: {out}")
    for label, counts in found["encoders"].items():
        if counts["illegal_transitions"] or counts["reversals"]:
            _tell(f"{label}: {found['notes'][label]}")


@app.command()
def serve(
    listen: Listen = None,
    connect: Connect = None,
    http: Annotated[str | None, typer.Option(help="HOST:PORT of REST and the page.")] = None,
    rig: RigFile = None,
    data: Annotated[Path | None, typer.Option(help="Directory of the database.")] = None,
    update: Annotated[Update | None, typer.Option(help="What sets the depth: fused or rms.")] = None,
    no_trace: NoTrace = False,
    baseline: Annotated[Path | None, typer.Option(help="Baseline of machines whose rig file gives no model.")] = None,
    relation: Annotated[
        Path | None, typer.Option(help="Relation of level and wear depth, of machines whose rig file gives no model.")
    ] = None,
    prefix: Annotated[str | None, typer.Option(help="First part of all keys.")] = None,
) -> int:
    """Run the service: Zenoh in, REST, page and Zenoh out. Every setting also as GEAR_TWIN_... variable."""
    from service.runtime.serve import run

    given = {"listen": listen, "connect": connect, "http": http, "rig": rig, "data": data, "update": update}
    given |= {"baseline": baseline, "relation": relation}
    return run(_settings(**given, prefix=prefix, trace=False if no_trace else None))


@app.command()
def demo(
    exit_after: Annotated[
        bool, typer.Option("--exit", help="End after the summary; non-zero if anything failed.")
    ] = False,
    http: Annotated[str | None, typer.Option(help="HOST:PORT of REST and the page.")] = None,
) -> int:
    """Start the service, replay the bundled campaign into it, print what came out."""
    from service.runtime.demo import run

    return run(_settings(http=http), exit_after=exit_after)


@app.command()
def report(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="Recording, or the JSON of an assess.")],
    out: Annotated[Path | None, typer.Option(help="HTML page to write; else text is printed.")] = None,
    rig: RigFile = None,
    no_trace: NoTrace = False,
    asset: Asset = None,
    prefix: Prefix = "gearbox",
    json: JsonFlag = False,
) -> None:
    """Sum up an assessment as text or as one HTML page."""
    from service.cli.report import html_report, load_answer, text_report
    from service.json_text import json_text, write_text

    answered = source.suffix == ".json"
    trace = _tracing(no_trace)
    answer = load_answer(source) if answered else _assess(source, rig, Update.fused, asset, prefix, trace=trace)
    if out is not None:
        write_text(out, html_report(answer))
    if json:
        print(json_text(answer))
    elif out is None:
        print(text_report(answer))
    else:
        print(f"report: {out}")


@app.command()
def baseline(
    recordings: Annotated[list[Path], typer.Argument(metavar="RECORDING…", help="Recordings of the healthy machine.")],
    out: Annotated[Path, typer.Option(help="Baseline file to write.")],
    rig: RigFile = None,
    json: JsonFlag = False,
) -> None:
    """Learn what a machine without a rig model does when it is well: every line against load and speed."""
    from service.cli.baseline_report import learned_text
    from service.files.baseline import learned, save
    from service.json_text import json_text
    from twin.baseline.reporting import described

    found = learned(recordings, rig)
    save(found, out)
    print(json_text(described(found)) if json else learned_text(described(found)))
    _tell(f"baseline written to {out}")


@app.command()
def relate(
    series: Annotated[Path, typer.Argument(metavar="SERIES", help="Series file (TOML): levels at known wear depths.")],
    source: Annotated[
        Path | None, typer.Option(help="Table of the records (CSV), instead of the series file's.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="HTML page with figures to write.")] = None,
    relation: Annotated[Path | None, typer.Option(help="Relation file to write, for `serve --relation`.")] = None,
    draws: Annotated[int, typer.Option(min=0, max=200, help="Draws of what the rig file estimates.")] = 12,
    json: JsonFile = None,
) -> None:
    """Calibrate the relation of level and wear depth on measured depths, and try what could make what is missed."""
    from service.cli import relation_report as shown
    from service.cli.show import progress_bar
    from service.errors import InputError
    from service.files import relation as relating
    from service.files.series import load_series
    from service.json_text import json_text, write_text
    from twin.errors import TwinError
    from twin.levels.trials import try_all

    known = load_series(series, source)
    with progress_bar("relating") as bar:
        try:
            tried = try_all(
                known.rig,
                known.conditions,
                known.cases,
                stated=known.stated,
                spreads=known.estimated,
                draws=draws,
                progress=bar,
            )
        except TwinError as error:
            raise InputError(f"{series}: {error}") from None
    answer = relating.answer(known, tried)
    if json is not None:
        write_text(json, json_text(answer))
    if relation is not None:
        relating.save_relation(known, tried, relation)
    if out is not None:
        write_text(out, shown.page(answer))
    if str(json) != "-":
        print(shown.text(answer))
    for path, what in ((out, "figures"), (relation, "relation")):
        if path is not None:
            _tell(f"{what} written to {path}")


@app.command()
def diagnose(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="Recording, or the JSON of an assess.")],
    out: Annotated[Path | None, typer.Option(help="HTML page with figures to write.")] = None,
    rig: RigFile = None,
    baseline: Annotated[
        Path | None, typer.Option(help="Baseline file: what the machine does beyond it, where no rig model is known.")
    ] = None,
    base_radii_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Assumed base radii of pinion and gear, for run-out in µm where the rig file has none."),
    ] = None,
    asset: Asset = None,
    prefix: Prefix = "gearbox",
    json: JsonFile = None,
) -> None:
    """Say which effects the machine has beside wear, how sure that is, and what is left unexplained."""
    from service.cli import baseline_figures as beside_figures
    from service.cli import baseline_report as beside_baseline
    from service.cli.diagnosis import text
    from service.cli.diagnosis_figures import page
    from service.cli.encoder_pair import with_assumed_radii
    from service.cli.report import load_answer
    from service.files.baseline import energy_of
    from service.json_text import json_text, write_text

    if baseline is not None:
        answer = beside_baseline.answered(source, baseline, rig)
    elif source.suffix == ".json":
        answer = load_answer(source)
    else:
        answer = _assess(source, rig, Update.fused, asset, prefix)
        if answer.get("strange"):
            answer["energy_breakdown"] = energy_of(source, rig)
    if base_radii_mm is not None:
        answer = with_assumed_radii(answer, base_radii_mm)
    if json is not None:
        write_text(json, json_text(answer))
    if out is not None:
        write_text(out, page(answer) if baseline is None else beside_figures.page(answer))
    if str(json) != "-":
        print(text(answer) if baseline is None else beside_baseline.text(answer))
    if out is not None:
        _tell(f"figures written to {out}")


def _tracing(no_trace: bool) -> bool:
    """Whether effects are sought: not where the option or the environment says no."""
    return _settings().trace and not no_trace


def _assess(
    recording: Path,
    rig: Path | None,
    update: Update,
    asset: str | None,
    prefix: str,
    enough: Any = None,
    trace: bool = True,
    relation: Path | None = None,
) -> dict[str, Any]:
    """An assessment with progress shown and faults of the data told, one line each."""
    from service.cli.show import progress_bar
    from service.runtime.assess import assess as run
    from service.runtime.assess import warnings
    from service.runtime.pipeline import assembly_settings
    from twin.step import Options

    known = None
    if relation is not None:
        from service.files.relation import read_relation

        known = read_relation(relation)
    options = Options(update=update.value, trace=trace, relation=known)
    with progress_bar("assessing") as bar:
        answer = run(
            recording,
            rig,
            options,
            lambda share, windows: bar(share, f"{windows} windows"),
            asset=asset,
            prefix=prefix,
            assembly=assembly_settings(_settings()),
            **({"enough": enough} if enough else {}),
        )
    for line in warnings(recording, answer):
        _tell(line)
    return answer


def _give(answer: dict[str, Any], json: Path | None) -> None:
    from service.cli.show import print_answer
    from service.json_text import json_text, write_text

    if json is not None:
        write_text(json, json_text(answer))
    if str(json) != "-":
        print_answer(answer)


def _tell(line: str | None) -> None:
    from service.cli.show import say

    if line:
        say(line)


def _finite(name: str, value: float) -> None:
    from service.errors import InputError

    if not 0 <= value < float("inf"):
        raise InputError(f"--{name} {value:g} must be a number from 0 up")


def _settings(**given: Any) -> Any:
    """Settings from the environment and what was given; InputError names the first wrong one."""
    from pydantic import ValidationError
    from pydantic_settings import SettingsError

    from service.errors import InputError
    from service.settings import Settings

    values = {key: value for key, value in given.items() if value not in (None, [])}
    try:
        return Settings(**values)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        raise InputError(f"setting {name} = {first['input']!r}: {first['msg']}") from None
    except SettingsError as error:
        raise InputError(f"environment: {error}") from None
