"""The commands of `gear-twin`; what a command needs is imported when it runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option
from typer.core import TyperGroup

from service.cli import alarms, answers, assets, importing, keeping, learning, recordings, rest, setup, signals
from service.cli.answers import Update
from service.cli.assessing import Data, NoTrace, Prefix, answering, settings_of
from service.cli.config import ConfigFile, config, configured
from service.cli.recordings import Connect, Listen
from service.fleet.commands import app as fleet

GROUPS = ("Get started", "Assess a machine", "Learn and calibrate", "Recordings and data", "Look after a service")
START, ANSWER, MODEL, DATA, KEEP = GROUPS


class Grouped(TyperGroup):
    """Commands in the order in which people meet them; one of a group is said where it is asked for without that."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command of the arguments; UsageError where there is none, with its group where one has it."""
        for name, group in self.commands.items() if args[0] not in self.commands else ():
            if args[0] in getattr(group, "commands", ()):
                ctx.fail(f"{args[0]} is a command of {name}: gear-twin {name} {' '.join(args)}")
        return super().resolve_command(ctx, args)

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
    version: Annotated[bool, Option("--version", callback=_version, is_eager=True, help="Show the version.")] = (False),
) -> None:
    """Digital twin of gear wear: vibration in, wear depth and remaining life out."""


def serve(
    listen: Listen = None,
    connect: Connect = None,
    http: Annotated[str | None, Option(help="HOST:PORT of REST and the page; default: 127.0.0.1:8080.")] = None,
    rig: Annotated[Path | None, Option(help="Rig file of all assets that no other names.")] = None,
    data: Data = None,
    update: Annotated[Update | None, Option(help="Method that sets the depth; default: fused.")] = None,
    no_trace: NoTrace = False,
    baseline: Annotated[Path | None, Option(help="Healthy baseline, for machines without a model.")] = None,
    relation: Annotated[Path | None, Option(help="Relation of level and depth, for machines without a model.")] = None,
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
        bool, Option("--exit", help="End after the summary; the exit status is 1 if anything failed.")
    ] = False,
    http: Annotated[
        str | None,
        Option(help="HOST:PORT of REST and the page; default: 127.0.0.1:8080, or a free port if it is in use."),
    ] = None,
    no_browser: Annotated[bool, Option("--no-browser", help="Do not open the page in a browser.")] = False,
) -> int:
    """Start the service, replay a healthy and a faulty machine into it, and print what it says of them."""
    from service.runtime.demo import run

    return run(settings_of(http=http), exit_after=exit_after, browser=not (no_browser or exit_after))


COMMANDS: dict[str, dict[str, Callable[..., Any]]] = {
    START: {
        "serve": serve, "demo": demo, "init": setup.init, "doctor": setup.doctor, "config": answering(config),
    },
    ANSWER: {
        "assess": answers.assess, "thresholds": setup.thresholds, "report": answers.report,
        "diagnose": answers.diagnose, "depths": learning.depths, "what-if": answers.what_if,
    },
    MODEL: {
        "calibrate": learning.calibrate, "baseline": learning.baseline, "relate": learning.relate,
        "detectability": learning.detectability,
    },
    DATA: {
        "replay": recordings.replay, "record": recordings.record, "simulate": recordings.simulate,
        "import": importing.import_, "signals": signals.signals,
    },
}  # fmt: skip
for _panel, _commands in COMMANDS.items():
    for _name, _command in _commands.items():
        app.command(name=_name, rich_help_panel=_panel)(_command)
app.add_typer(recordings.example, name="example", rich_help_panel=DATA)
remote = typer.Typer(no_args_is_help=True, help="Ask a running service: machines, alarms, effects; and decide on them.")
remote.command()(rest.ready)
remote.add_typer(assets.app, name="assets")
remote.add_typer(alarms.app, name="alarms")
remote.add_typer(alarms.effects, name="effects")
remote.command()(alarms.audit)
app.add_typer(remote, name="remote", rich_help_panel=KEEP)
app.add_typer(keeping.app, name="db", rich_help_panel=KEEP)
app.add_typer(fleet, name="fleet", rich_help_panel=KEEP)
