"""What several commands share: an assessment with its progress, the settings, and where an answer goes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

Prefix = Annotated[
    str | None, typer.Option(help="First part of all keys and topics; default: the setting, else gearbox.")
]


def assessed(
    recording: Path,
    rig: Path | None,
    asset: str | None,
    prefix: str | None,
    **given: Any,
) -> dict[str, Any]:
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


def give(answer: dict[str, Any], json: Path | None) -> None:
    from service.cli.answer import print_answer
    from service.json_text import wrote_json

    if not wrote_json(answer, json):
        print_answer(answer)


def give_recording(answer: dict[str, Any], source: Path, out: Path, prefix: str | None) -> None:
    """The recording with the results in it, and the layout that shows them."""
    from service.cli.show import progress_bar
    from service.files.results_recording import write_results

    with progress_bar("writing") as bar:
        layout = write_results(answer, source, out, prefix_of(prefix), bar)
    tell(f"recording with results written to {out}, layout for Foxglove to {layout}")


def tell(line: str | None) -> None:
    from service.cli.show import say

    if line:
        say(line)


def demand_finite(name: str, value: float) -> None:
    from service.errors import InputError

    if not 0 <= value < float("inf"):
        raise InputError(f"--{name} {value:g} must be a number from 0 up")


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
