"""The commands of `gear-twin`; what a command needs is imported when it runs."""

from __future__ import annotations

import time
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from service.cli import database
from service.cli.alarms import app as alarms
from service.cli.assessing import (
    Prefix,
    assessed,
    demand_finite,
    give,
    prefix_of,
    settings_of,
    tell,
    windowing,
)
from service.cli.assets import app as assets
from service.cli.audit import audit
from service.cli.config import ConfigFile, config, configured
from service.cli.detectability import detectability
from service.cli.doctor import doctor
from service.cli.effects import app as effects
from service.cli.example import app as example
from service.cli.importing import import_
from service.cli.init import init
from service.cli.keys import app as keys
from service.cli.levels import depths, relate
from service.cli.ready import ready
from service.cli.rest import asking
from service.cli.signals import signals
from service.cli.what_if import what_if
from service.errors import DeliveryError
from service.fleet.commands import app as fleet
from service.json_text import write_text, wrote_json

CLOCKS_DIFFER = 60.0  # by which a logger's clock may be ahead of this computer's [s]
GROUPS = ("Get started", "Assess a machine", "Learn and calibrate", "Recordings and data", "Look after a service")


class Grouped(TyperGroup):
    """Commands in the order in which people meet them."""

    def list_commands(self, ctx: Any) -> list[str]:
        """The names of the commands, by group and then in the order in which they were registered."""
        names = super().list_commands(ctx)
        return sorted(names, key=lambda name: GROUPS.index(getattr(self.commands[name], "rich_help_panel", DATA)))


app = typer.Typer(
    cls=Grouped,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Digital twin of gear wear: vibration in, wear depth and remaining life out.",
)
START, ANSWER, MODEL, DATA, KEEP = GROUPS


def _version(wanted: bool) -> None:
    if wanted:
        from service import __version__

        print(f"gear-twin {__version__}")
        raise typer.Exit()


@app.callback()
def gear_twin(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")] = (
        False
    ),
) -> None:
    """Digital twin of gear wear: vibration in, wear depth and remaining life out."""


class Update(StrEnum):
    """The method that sets the wear depth."""

    fused = "fused"
    rms = "rms"


Recording = Annotated[Path, typer.Argument(metavar="RECORDING", help="Recording (MCAP).")]
RigFile = Annotated[Path | None, typer.Option("--rig", help="Rig file; default: the one attached to the recording.")]
Asset = Annotated[str | None, typer.Option(help="The asset, if a recording contains several.")]
UpdateMethod = Annotated[
    Update | None,
    typer.Option(
        help="Method that sets the depth: transmission error (fused) or vibration level (rms); default: the setting, "
        "else fused."
    ),
]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
]
NoTrace = Annotated[bool, typer.Option("--no-trace", help="Model wear alone: do not search for other effects.")]
Connect = Annotated[list[str] | None, typer.Option(help="Endpoint of a service or router, such as tcp/127.0.0.1:7447.")]
Listen = Annotated[list[str] | None, typer.Option(help="Endpoint at which to open a Zenoh router.")]


@app.command(rich_help_panel=ANSWER)
@configured
def assess(
    recording: Recording,
    rig: RigFile = None,
    json: JsonFile = None,
    update: UpdateMethod = None,
    no_trace: NoTrace = False,
    relation: Annotated[
        Path | None, typer.Option(help="Relation of level and depth (from `relate`), for machines without a model.")
    ] = None,
    detectability: Annotated[
        Path | None, typer.Option(help="What simulated healthy machines of the rig show (from `detectability`).")
    ] = None,
    false_alarm_rate: Annotated[
        float | None,
        typer.Option(help="Share of campaigns of healthy machines in which an effect may be reported; default 0.01."),
    ] = None,
    asset: Asset = None,
    prefix: Prefix = None,
    mcap: Annotated[
        Path | None,
        typer.Option(help="Write a copy of the recording with the results in it, and a layout file for Foxglove."),
    ] = None,
) -> None:
    """Evaluate a whole recording, as the service would: wear depth, remaining life, other effects."""
    from service.cli.assessing import give_recording
    from service.runtime.assess import Unassessable

    try:
        answer = assessed(
            recording, rig, asset, prefix, update=None if update is None else update.value, trace=not no_trace,
            relation=relation, detectability=detectability, false_alarm_rate=false_alarm_rate,
        )  # fmt: skip
    except Unassessable as error:
        wrote_json(error.answer, json)
        raise
    give(answer, json)
    if mcap is not None:
        give_recording(answer, recording, mcap, prefix)


@app.command(rich_help_panel=MODEL)
@configured
def calibrate(
    recording: Recording,
    rig: RigFile = None,
    json: JsonFile = None,
    unworn: Annotated[
        int, typer.Option(min=1, help="Number of measurement windows, from the first, that are taken as unworn.")
    ] = 3,
    asset: Asset = None,
    prefix: Prefix = None,
) -> None:
    """Fit mesh stiffness, damping and contact width to low-speed and unworn windows."""
    from service.cli.calibration import calibration_text

    def enough(records: Any) -> bool:
        return sum(r["kind"] == "measurement" and r["quality"] != "refused" for r in records) >= unworn

    answer = assessed(recording, rig, asset, prefix, enough=enough, trace=False)
    used = [r["index"] for r in answer["windows"] if r["quality"] != "refused"]
    found = {"asset": answer["asset"], "windows": used, "calibration": answer["calibration"]}
    if not wrote_json(found, json):
        print(calibration_text(found))


@app.command(rich_help_panel=ANSWER)
def thresholds(
    rig: Annotated[Path | None, typer.Option(help="Rig file: show the sizes on this machine, too.")] = None,
    json: JsonFile = None,
) -> None:
    """Print every number that decides a verdict, with its unit, meaning and source."""
    from service.cli.thresholds import described, print_table, rows

    found = rows(rig)
    if not wrote_json(described(found), json):
        print_table(found, with_rig=rig is not None)


@app.command(rich_help_panel=DATA)
def replay(
    recording: Recording,
    connect: Connect = None,
    speed: Annotated[
        float,
        typer.Option(
            min=0.0, help="Factor on the recorded speed; 0: as fast as subscribers receive it, without pauses."
        ),
    ] = 1.0,
    max_pause: Annotated[
        float, typer.Option(min=0.0, help="Longest pause between frames that is kept, in seconds of the recording.")
    ] = float("inf"),
    wait: Annotated[float, typer.Option(min=0.1, help="Seconds to wait for a router and a subscriber.")] = 30.0,
    asset: Annotated[
        str | None, typer.Option(help="Publish under this asset's name in place of the recording's.")
    ] = None,
    prefix: Prefix = None,
    recorded: Annotated[
        str | None, typer.Option(metavar="PREFIX", help="First part of the recording's topics, where it is another.")
    ] = None,
    future: Annotated[
        bool, typer.Option("--future", help="Take a recording that is dated in the future, such as a simulated one.")
    ] = False,
    config: ConfigFile = None,
    json: JsonFile = None,
) -> None:
    """Publish a recording on Zenoh as it was recorded, or faster; ends when the service has stored all of it."""
    from service.cli.show import progress_bar
    from service.logs import logging_by
    from service.runtime.replay import replay as run
    from service.transport.zenoh import open_publisher

    demand_finite("speed", speed)
    settings = settings_of(config=config, prefix=prefix)
    begun = time.monotonic()
    with logging_by(settings), progress_bar("replaying") as bar:
        delivered = run(
            recording,
            connect or settings.connect or settings.listen,
            speed,
            max_pause=max_pause,
            prefix=settings.prefix,
            wait=wait,
            progress=lambda share, frames: bar(share, f"{frames} frames"),
            on_fault=tell,
            asset=asset,
            recorded=recorded,
            until=float("inf") if future else time.time() + CLOCKS_DIFFER,
            publish_to=partial(open_publisher, links=settings.zenoh_links),
        )
    seconds = time.monotonic() - begun
    if not wrote_json({"frames": delivered, "seconds": seconds}, json):
        print(f"{delivered} frames stored in {seconds:.2f} s")


@app.command(rich_help_panel=DATA)
def record(
    out: Annotated[Path, typer.Option(help="MCAP file to write.", show_default=False)],
    connect: Connect = None,
    listen: Listen = None,
    duration: Annotated[float, typer.Option(min=0.0, help="Stop after this many seconds; default: at Ctrl-C.")] = float(
        "inf"
    ),
    rig: RigFile = None,
    description: Annotated[str, typer.Option(help="Text for the recording's metadata.")] = "recorded live",
    prefix: Prefix = None,
    config: ConfigFile = None,
    json: JsonFile = None,
) -> None:
    """Record a live stream into a file (MCAP)."""
    from service.cli.live import record_live
    from service.logs import logging_by

    settings = settings_of(config=config, prefix=prefix)
    with logging_by(settings):
        source = connect or ([] if listen else settings.connect)
        links = settings.zenoh_links
        done = record_live(out, source, listen, duration, rig, description, settings.prefix, links)
    if not wrote_json({"recording": str(out), **done._asdict()}, json):
        print(f"{done.frames} frames recorded: {out}")
    if unwritten := done.missed + done.left_out + done.refused:
        raise DeliveryError(
            f"{unwritten} frames are not in {out}: {done.missed} were lost on the way, {done.left_out} came faster "
            f"than they could be written, and {done.refused} break the contract"
        )


@app.command(rich_help_panel=DATA)
def simulate(
    spec: Annotated[Path, typer.Argument(metavar="SPEC", help="Specification of the campaign (TOML).")],
    out: Annotated[Path, typer.Option(help="MCAP file to write.", show_default=False)],
    truth: Annotated[Path | None, typer.Option(help="File for the true wear and effects (JSON).")] = None,
    json: JsonFile = None,
) -> None:
    """Simulate a wear campaign into a recording, with an independent simulator."""
    from recordings import simulate_file
    from recordings.generator.errors import SpecError
    from service.cli.show import progress_bar
    from service.errors import InputError

    with progress_bar("simulating") as bar:
        try:
            simulate_file(spec, out, truth, bar)
        except SpecError as error:
            raise InputError(str(error)) from None
        except OSError as error:
            raise InputError(f"{error.filename}: {(error.strerror or 'fault').lower()}") from None
    if not wrote_json({"recording": str(out), "truth": str(truth) if truth else None}, json):
        print(f"simulated: {out}")


@app.command(rich_help_panel=START)
def serve(
    listen: Listen = None,
    connect: Connect = None,
    http: Annotated[str | None, typer.Option(help="HOST:PORT of REST and the page; default: 127.0.0.1:8080.")] = None,
    rig: Annotated[Path | None, typer.Option(help="Rig file of all assets that no other names.")] = None,
    data: Annotated[Path | None, typer.Option(help="Directory of the database; default: .gear-twin.")] = None,
    update: Annotated[Update | None, typer.Option(help="Method that sets the depth; default: fused.")] = None,
    no_trace: NoTrace = False,
    baseline: Annotated[Path | None, typer.Option(help="Healthy baseline, for machines without a model.")] = None,
    relation: Annotated[
        Path | None, typer.Option(help="Relation of level and depth, for machines without a model.")
    ] = None,
    prefix: Prefix = None,
    config: ConfigFile = None,
) -> int:
    """Run the service: streams in over Zenoh; REST, page and Zenoh out. All settings: `gear-twin config`."""
    from service.long_lived import long_lived

    with long_lived():
        from service.logs import logging_by
        from service.runtime.serve import run

    given = {"listen": listen, "connect": connect, "http": http, "rig": rig, "data": data, "update": update}
    given |= {"baseline": baseline, "relation": relation, "prefix": prefix, "config": config}
    settings = settings_of(**given, trace=False if no_trace else None)
    with logging_by(settings):
        return run(settings)


@app.command(rich_help_panel=START)
@configured
def demo(
    exit_after: Annotated[
        bool, typer.Option("--exit", help="End after the summary; the exit status is 1 if anything failed.")
    ] = False,
    http: Annotated[
        str | None,
        typer.Option(help="HOST:PORT of REST and the page; default: 127.0.0.1:8080, or a free port if it is in use."),
    ] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open the page in a browser.")] = False,
) -> int:
    """Start the service, replay a healthy and a faulty machine into it, and print what it says of them."""
    from service.runtime.demo import run

    return run(settings_of(http=http), exit_after=exit_after, browser=not (no_browser or exit_after))


@app.command(rich_help_panel=ANSWER)
@configured
def report(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="Recording (MCAP), or the JSON that `assess` wrote.")
    ],
    out: Annotated[
        list[Path] | None,
        typer.Option(help="Report to write, .html or .pdf; may be given twice. Default: print text."),
    ] = None,
    rig: RigFile = None,
    no_trace: NoTrace = False,
    asset: Asset = None,
    prefix: Prefix = None,
    json: JsonFile = None,
) -> None:
    """Summarise an assessment for people: as text, as one HTML page, or as a PDF of two pages."""
    from service.cli.report import load_answer, machine_of, text_report, write_report

    answered = source.suffix == ".json"
    answer = load_answer(source) if answered else assessed(source, rig, asset, prefix, trace=not no_trace)
    for path in out or ():
        write_report(answer, path, machine_of(source, rig, prefix_of(prefix)))
        tell(f"report written to {path}")
    if not wrote_json(answer, json) and not out:
        print(text_report(answer))


@app.command(rich_help_panel=MODEL)
@configured
def baseline(
    recordings: Annotated[list[Path], typer.Argument(metavar="RECORDING…", help="Recordings of the healthy machine.")],
    out: Annotated[Path, typer.Option(help="Baseline file to write.")],
    rig: RigFile = None,
    prefix: Prefix = None,
    json: JsonFile = None,
) -> None:
    """Learn a healthy baseline for a machine without a model: every spectral line against load and speed."""
    from service.cli.baseline_report import learned_text
    from service.contract.parts import json_of
    from service.files.baseline import learned, save
    from twin.baseline.comparison import described

    found = learned(recordings, rig, windowing(), prefix_of(prefix))
    save(found, out)
    said = json_of(described(found))
    if not wrote_json(said, json):
        print(learned_text(said))
    tell(f"baseline written to {out}")


@app.command(rich_help_panel=ANSWER)
@configured
def diagnose(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="Recording (MCAP), or the JSON that `assess` wrote.")
    ],
    out: Annotated[Path | None, typer.Option(help="HTML page with figures to write.")] = None,
    rig: RigFile = None,
    baseline: Annotated[
        Path | None, typer.Option(help="Healthy baseline to compare with, for machines without a model.")
    ] = None,
    base_radii_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Assumed base radii of pinion and gear in mm, for run-out in µm if the rig file has none."),
    ] = None,
    asset: Asset = None,
    prefix: Prefix = None,
    json: JsonFile = None,
) -> None:
    """Attribute vibration that wear does not explain: effects, their evidence, and what remains unexplained."""
    from service.cli import baseline_figures, baseline_report
    from service.cli.diagnosis import text
    from service.cli.diagnosis_figures import page
    from service.cli.encoder_pair import with_assumed_radii
    from service.cli.report import load_answer
    from service.files.baseline import energy_of

    if baseline is not None:
        answer = baseline_report.answered(source, baseline, rig, prefix_of(prefix))
    elif source.suffix == ".json":
        answer = load_answer(source)
    else:
        answer = assessed(source, rig, asset, prefix)
        if answer.get("unattributed_lines"):
            answer["energy_breakdown"] = energy_of(source, rig, windowing(), prefix_of(prefix))
    if base_radii_mm is not None:
        answer = with_assumed_radii(answer, base_radii_mm)
    printed = wrote_json(answer, json)
    if out is not None:
        write_text(out, page(answer) if baseline is None else baseline_figures.page(answer))
    if not printed:
        print(text(answer) if baseline is None else baseline_report.text(answer))
    if out is not None:
        tell(f"figures written to {out}")


app.command(name="import", rich_help_panel=DATA)(configured(import_))
app.command(name="init", rich_help_panel=START)(init)
app.command(name="doctor", rich_help_panel=START)(configured(doctor))
app.command(name="config", rich_help_panel=START)(config)
app.command(name="ready", rich_help_panel=START)(asking(ready))
app.command(name="relate", rich_help_panel=MODEL)(relate)
app.command(name="detectability", rich_help_panel=MODEL)(detectability)
app.command(name="depths", rich_help_panel=ANSWER)(depths)
app.command(name="what-if", rich_help_panel=ANSWER)(configured(asking(what_if)))
app.command(name="audit", rich_help_panel=START)(asking(audit))
app.add_typer(keys, name="keys", rich_help_panel=START)
app.add_typer(assets, name="assets", rich_help_panel=START)
app.add_typer(alarms, name="alarms", rich_help_panel=ANSWER)
app.command(name="signals", rich_help_panel=DATA)(configured(signals))
app.add_typer(effects, name="effects", rich_help_panel=ANSWER)
app.add_typer(example, name="example", rich_help_panel=DATA)
app.add_typer(fleet, name="fleet", rich_help_panel=KEEP)
for _command in (database.backup, database.restore, database.export, database.check):
    app.command(rich_help_panel=KEEP)(_command)
