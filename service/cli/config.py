"""`gear-twin config`: the settings in effect, each with where it comes from, and a file with all of them."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

ConfigFile = Annotated[
    Path | None, typer.Option("--config", help="Configuration file (TOML).", envvar="GEAR_TWIN_CONFIG")
]


def configured(command: Callable[..., Any]) -> Callable[..., Any]:
    """Gives a command that reads settings the option --config; its settings then come from that file, too."""
    signature = inspect.signature(command, eval_str=True)
    option = inspect.Parameter("config", inspect.Parameter.KEYWORD_ONLY, annotation=ConfigFile, default=None)

    def with_file(*, config: Path | None = None, **given: Any) -> Any:
        with _file_in_use(config):
            return command(**given)

    with_file.__name__, with_file.__doc__ = command.__name__, command.__doc__
    parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in (*signature.parameters.values(), option)]
    with_file.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    with_file.__annotations__ = {p.name: p.annotation for p in parameters}
    return with_file


@contextmanager
def _file_in_use(config: Path | None) -> Iterator[None]:
    """The configuration file of whatever reads settings inside, in processes that it starts too."""
    from service.configuration.sources import CONFIG

    before = os.environ.get(CONFIG)
    if config is not None:
        os.environ[CONFIG] = str(config)
    try:
        yield
    finally:
        os.environ.pop(CONFIG, None)
        if before is not None:
            os.environ[CONFIG] = before


def config(
    config: ConfigFile = None,
    example: Annotated[
        bool, typer.Option("--example", help="Print a commented file with every setting instead.")
    ] = False,
    json: Annotated[
        Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
    ] = None,
) -> None:
    """Print the settings in effect, each with where it comes from; secrets are masked."""
    from service.configuration.load import load, origins
    from service.configuration.printed import effective, effective_text, example_text
    from service.json_text import wrote_json

    if example:
        print(example_text(), end="")
        return
    settings = load(config=config)
    where = origins({"config": config})
    if not wrote_json(effective(settings, where), json):
        print(effective_text(settings, where))
