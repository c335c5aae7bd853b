"""The commands of `gear-twin`; what a command needs is imported when it runs."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from service.cli import alarms, assets, importing, keeping, learning, recordings, rest, setup, signals, what_if
from service.cli.assessing import (
    Asset,
    Data,
    NoTrace,
    Prefix,
    Recording,
    RigFile,
    Shown,
    answering,
    assessed,
    prefix_of,
    settings_of,
    windowing,
)
from service.cli.config import ConfigFile, config, configured
from service.cli.recordings import Connect, Listen
from service.fleet.commands import app as fleet

GROUPS = ("Get started", "Assess a machine", "Learn and calibrate", "Recordings and data", "Look after a service")
START, ANSWER, MODEL, DATA, KEEP = GROUPS


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


Source = Annotated[Path, typer.Argument(metavar="SOURCE", help="Recording (MCAP), or the JSON that `assess` wrote.")]


def serve(
    listen: Listen = None,
    connect: Connect = None,
    http: Annotated[str | None, typer.Option(help="HOST:PORT of REST and the page; default: 127.0.0.1:8080.")] = None,
    rig: Annotated[Path | None, typer.Option(help="Rig file of all assets that no other names.")] = None,
    data: Data = None,
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


@configured
@answering
def assess(
    recording: Recording,
    rig: RigFile = None,
    update: Annotated[
        Update | None,
        typer.Option(
            help="Method that sets the depth: transmission error (fused) or vibration level (rms); default: the "
            "setting, else fused."
        ),
    ] = None,
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
) -> Shown:
    """Evaluate a whole recording, as the service would: wear depth, remaining life, other effects."""
    from service.cli.answer import answer_text
    from service.cli.show import progress_bar, width
    from service.files.results_recording import write_results
    from service.runtime.assess import Unassessable

    try:
        answer = assessed(
            recording, rig, asset, prefix, update=None if update is None else update.value, trace=not no_trace,
            relation=relation, detectability=detectability, false_alarm_rate=false_alarm_rate,
        )  # fmt: skip
    except Unassessable as error:
        return Shown(error.answer, lambda: (), failed=error)
    notes: tuple[str, ...] = ()
    if mcap is not None:
        with progress_bar("writing") as bar:
            layout = write_results(answer, recording, mcap, prefix_of(prefix), bar)
        notes = (f"recording with results written to {mcap}, layout for Foxglove to {layout}",)
    return Shown(answer, lambda: answer_text(answer, width()), notes)


@configured
@answering
def report(
    source: Source,
    out: Annotated[
        list[Path] | None,
        typer.Option(help="Report to write, .html or .pdf; may be given twice. Default: print text."),
    ] = None,
    rig: RigFile = None,
    no_trace: NoTrace = False,
    asset: Asset = None,
    prefix: Prefix = None,
) -> Shown:
    """Summarise an assessment for people: as text, as one HTML page, or as a PDF of two pages."""
    from service.cli.report import load_answer, machine_of, text_report, write_report

    answered = source.suffix == ".json"
    answer = load_answer(source) if answered else assessed(source, rig, asset, prefix, trace=not no_trace)
    for path in out or ():
        write_report(answer, path, machine_of(source, rig, prefix_of(prefix)))
    return Shown(answer, lambda: () if out else text_report(answer), tuple(f"report written to {p}" for p in out or ()))


@configured
@answering
def diagnose(
    source: Source,
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
) -> Shown:
    """Attribute vibration that wear does not explain: effects, their evidence, and what remains unexplained."""
    from service.cli import baseline_figures, baseline_report
    from service.cli.diagnosis import text
    from service.cli.diagnosis_figures import page
    from service.cli.encoder_pair import with_assumed_radii
    from service.cli.report import load_answer
    from service.files.baseline import energy_of
    from service.json_text import write_text

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
    if out is not None:
        write_text(out, page(answer) if baseline is None else baseline_figures.page(answer))
    notes = () if out is None else (f"figures written to {out}",)
    return Shown(answer, lambda: text(answer) if baseline is None else baseline_report.text(answer), notes)


COMMANDS: dict[str, dict[str, Callable[..., Any]]] = {
    START: {
        "serve": serve, "demo": demo, "init": setup.init, "doctor": setup.doctor, "config": answering(config),
        "ready": rest.ready, "audit": alarms.audit,
    },
    ANSWER: {
        "assess": assess, "thresholds": setup.thresholds, "report": report, "diagnose": diagnose,
        "depths": learning.depths, "what-if": what_if.what_if,
    },
    MODEL: {
        "calibrate": learning.calibrate, "baseline": learning.baseline, "relate": learning.relate,
        "detectability": learning.detectability,
    },
    DATA: {
        "replay": recordings.replay, "record": recordings.record, "simulate": recordings.simulate,
        "import": importing.import_, "signals": signals.signals,
    },
    KEEP: {"backup": keeping.backup, "restore": keeping.restore, "export": keeping.export, "check": keeping.check},
}  # fmt: skip
for _panel, _commands in COMMANDS.items():
    for _name, _command in _commands.items():
        app.command(name=_name, rich_help_panel=_panel)(_command)
app.add_typer(keeping.keys, name="keys", rich_help_panel=START)
app.add_typer(assets.app, name="assets", rich_help_panel=START)
app.add_typer(alarms.app, name="alarms", rich_help_panel=ANSWER)
app.add_typer(alarms.effects, name="effects", rich_help_panel=ANSWER)
app.add_typer(recordings.example, name="example", rich_help_panel=DATA)
app.add_typer(fleet, name="fleet", rich_help_panel=KEEP)
