"""`gear-twin config`: the settings in effect, each with where it comes from, and a file with all of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from service.cli.assessing import Shown, with_options

ConfigFile = Annotated[Path | None, Option("--config", help="Configuration file (TOML).", envvar="GEAR_TWIN_CONFIG")]


def configured(command: Callable[..., Any]) -> Callable[..., Any]:
    """Gives a command that reads settings the option --config; its settings then come from that file, too."""

    def run(*, config: Path | None, **given: Any) -> Any:
        with _file_in_use(config):
            return command(**given)

    return with_options(command, {"config": (ConfigFile, None)}, run)


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
    example: Annotated[bool, Option("--example", help="Print a commented file with every setting instead.")] = False,
) -> Shown:
    """Print the settings in effect, each with where it comes from; secrets are masked."""
    from service.configuration.load import load, origins
    from service.configuration.printed import effective, effective_text, example_text

    if example:
        return Shown(None, lambda: example_text().rstrip("\n"))
    settings, where = load(config=config), origins({"config": config})
    return Shown(effective(settings, where), lambda: effective_text(settings, where))
