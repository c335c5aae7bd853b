"""What commands share: their options, the settings, an assessment with its progress, and where an answer goes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from typer import Argument, Option

Prefix = Annotated[str | None, Option(help="First part of all keys and topics; default: the setting, else gearbox.")]
JsonFile = Annotated[Path | None, Option("--json", help="Write the answer as JSON to this file; - is standard output.")]
Recording = Annotated[Path, Argument(metavar="RECORDING", help="Recording (MCAP).")]
RigFile = Annotated[Path | None, Option("--rig", help="Rig file; default: the one attached to the recording.")]
Asset = Annotated[str | None, Option(help="The asset, if a recording contains several.")]
NoTrace = Annotated[bool, Option("--no-trace", help="Model wear alone: do not search for other effects.")]
Data = Annotated[Path | None, Option(help="Data directory of the service; default: .gear-twin.")]


class Shown(NamedTuple):
    """What a command answers."""

    data: Any  # as JSON; None: nothing
    text: Callable[[], str | Iterable[str]]  # for people; made where it is printed
    notes: tuple[str, ...] = ()  # on standard error
    failed: Exception | None = None  # with which the command ends


def with_options(
    command: Callable[..., Any],
    options: Mapping[str, tuple[Any, Any]],
    run: Callable[..., Any],
    without: frozenset[str] = frozenset(),
) -> Callable[..., Any]:
    """A command with further options, which calls `run` with all that was given.

    options  by name: annotation and default
    without  parameters of the command that are no options: `run` gives them
    """
    signature = inspect.signature(command, eval_str=True)
    own = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in signature.parameters.values()]
    parameters = [p for p in own if p.name not in without] + [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=kind, default=default)
        for name, (kind, default) in options.items()
    ]

    def extended(**given: Any) -> Any:
        return run(**given)

    extended.__name__, extended.__doc__ = command.__name__, command.__doc__
    extended.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    extended.__annotations__ = {p.name: p.annotation for p in parameters}
    return extended


def answering(command: Callable[..., Shown]) -> Callable[..., Any]:
    """Gives a command the option --json; what it answers is written there, or printed as text."""

    def run(*, json: Path | None, **given: Any) -> None:
        from service.json_text import wrote_json

        shown = command(**given)
        if shown.data is None or not wrote_json(shown.data, json):
            text = shown.text()
            lines = text if isinstance(text, str) else "\n".join(text)
            if lines:
                print(lines)
        for note in shown.notes:
            tell(note)
        if shown.failed is not None:
            raise shown.failed

    return with_options(command, {"json": (JsonFile, None)}, run)


def assessed(recording: Path, rig: Path | None, asset: str | None, prefix: str | None, **given: Any) -> dict[str, Any]:
    """An assessment, with its progress and one line for each fault of the data on standard error.

    given  as in `service.runtime.by_settings.assess_by_settings`
    """
    from service.cli.show import progress_bar
    from service.runtime.assess import warnings
    from service.runtime.by_settings import assess_by_settings

    with progress_bar("assessing") as bar:
        answer = assess_by_settings(
            settings_of(prefix=prefix), recording, rig, asset=asset,
            progress=lambda share, windows: bar(share, f"{windows} windows"), **given,
        )  # fmt: skip
    for line in warnings(recording, answer):
        tell(line)
    return answer


def asked(question: str, default: str | None, check: Callable[[str], Any]) -> str:
    """What a person at a terminal answers; what does not pass the check is refused with the reason and asked again."""
    from service.errors import InputError

    while True:
        given = str(typer.prompt(question, default=default or "", show_default=default is not None))
        try:
            check(given)
        except InputError as error:
            typer.echo(str(error), err=True)
            continue
        return given


def tell(line: str | None) -> None:
    """One line on standard error."""
    from service.cli.show import say

    if line:
        say(line)


def prefix_of(given: str | None) -> str:
    """First part of all keys and topics: as given, or by the settings; InputErrors where it is none."""
    return settings_of(prefix=given).prefix


def windowing() -> Any:
    """How every command cuts a recording into windows: by the settings, as the service does."""
    from service.runtime.reception import assembly_settings

    return assembly_settings(settings_of())


def settings_of(**given: Any) -> Any:
    """Settings from the configuration file, the environment and what was given; InputErrors names the wrong ones."""
    from service.configuration.load import load

    return load(**given)
