"""`gear-twin init`: a rig file and a mapping file from a few questions, and what the machine will be able to tell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

AnswersFile = Annotated[
    Path | None, typer.Option("--answers", help="Answers file (TOML) instead of questions.", show_default=False)
]


def init(
    answers: AnswersFile = None,
    out: Annotated[Path, typer.Option(help="Directory for rig.toml and mapping.toml.")] = Path("."),
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there.")] = False,
    json: Annotated[
        Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
    ] = None,
) -> None:
    """Make a rig file and a mapping file from a few questions; says what the machine will be able to tell."""
    from service.errors import InputError
    from service.json_text import write_text, wrote_json
    from service.setup.abilities import abilities, equipment_of, one_more
    from service.setup.answers import checked_answers, load_answers
    from service.setup.mapping_file import mapping_text
    from service.setup.rig_file import draft_of, rig_text

    rig_path, mapping_path = out / "rig.toml", out / "mapping.toml"
    for path in (rig_path, mapping_path):
        if path.exists() and not force:
            raise InputError(f"{path} is there already; --force replaces it, --out names another directory")
    given = load_answers(answers) if answers is not None else checked_answers(_asked(), "answers")
    draft = draft_of(given)
    out.mkdir(parents=True, exist_ok=True)
    write_text(rig_path, rig_text(draft))
    write_text(mapping_path, mapping_text(given, draft, rig_path.name))
    equipment = equipment_of(given, draft)
    if wrote_json(_described(rig_path, mapping_path, draft, abilities(equipment), one_more(equipment)), json):
        return
    print(f"rig file: {rig_path}\nmapping file: {mapping_path}")
    _print_draft(given, draft)
    print_abilities(abilities(equipment), one_more(equipment))


def _described(rig_path: Path, mapping_path: Path, draft: Any, can: Any, more: tuple[str, ...]) -> dict[str, Any]:
    return {
        "rig": str(rig_path),
        "mapping": str(mapping_path),
        "derived": list(draft.rig.estimated.derived),
        "assumed": list(draft.rig.estimated.assumed),
        "without_model": list(draft.without_model),
        "abilities": [{"what": a.what, "level": a.level, "how": a.how} for a in can],
        "one_more_sensor": list(more),
    }


def _print_draft(given: Any, draft: Any) -> None:
    from twin.features.level import USABLE

    rig = draft.rig
    for reason in draft.without_model:
        print(f"no model of the machine: {reason}")
    if given.driver == "gear":
        print("In the files and in every answer `pinion` means the driving gear, here the larger one.")
    if not draft.without_model:
        pair = rig.gear_pair()
        print(
            f"module {pair.module * 1e3:.4g} mm, centre distance {pair.centre_distance * 1e3:.4g} mm, "
            f"contact ratio {pair.contact_ratio:.3f}, mesh frequency {pair.teeth[0] * given.speed:.4g} Hz"
        )
        print(f"{len(rig.estimated.assumed)} values are generic, each marked `assumed` in the rig file.")
    if given.accelerometers and given.sample_rate is None:
        print(
            f"the vibration level is taken up to {rig.band[1]:.0f} Hz: sample at {rig.band[1] / USABLE:.0f} Hz "
            "or more, or state your sample_rate"
        )
    if "end_of_life.max_depth" in rig.estimated.assumed:
        limit = rig.get("end_of_life.max_depth") * 1e3
        print(f"wear limit: {limit:.3g} mm, 10 % of the tooth's thickness on the pitch circle; state your own")


def print_abilities(can: Any, more: tuple[str, ...]) -> None:
    """The table of what a machine can tell, and what one more sensor would add."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="What this machine can tell", title_justify="left", box=None, pad_edge=False)
    for head in ("", "", "how, or what it needs"):
        table.add_column(head, overflow="fold")
    for ability in can:
        table.add_row(ability.what, ability.level, ability.how)
    console = Console(highlight=False)
    console.print()
    console.print(table)
    if more:
        console.print("\nWhat one more sensor would add")
        for line in more:
            console.print(f"- {line}", soft_wrap=False)


def _asked() -> dict[str, Any]:
    """The answers to the questions, asked one after the other; a wrong one is asked again."""
    from service.setup.questions import QUESTIONS

    found: dict[str, Any] = {}
    for question in QUESTIONS:
        superseded = question.without and found.get(question.without)
        needless = question.where and found.get(question.where) in (None, "", "0", "no", "n")
        if not superseded and not needless:
            found[question.key] = _ask(question)
    found["accelerometers"] = _accelerometers()
    return {key: value for key, value in found.items() if value not in (None, "")}


def _accelerometers() -> list[dict[str, Any]]:
    from service.setup.questions import OF_SENSOR

    out: list[dict[str, Any]] = []
    while typer.confirm("Is there another accelerometer" if out else "Is there an accelerometer", default=not out):
        sensor: dict[str, Any] = {}
        for question in OF_SENSOR:
            if question.key != "sensitivity" or sensor["unit"] == "V":
                sensor[question.key] = _ask(question)
        out.append({key: value for key, value in sensor.items() if value not in (None, "")})
    return out


def _ask(question: Any) -> Any:
    """One answer as a person types it; one that cannot be is refused with the reason and asked again."""
    from service.errors import InputError
    from service.setup.answers import read_answer

    said = question.text + (f" ({' / '.join(question.choices)})" if question.choices else "")
    if question.example and question.default is None:
        said += f", such as {question.example}"
    while True:
        given = typer.prompt(said, default=question.default or "", show_default=question.default is not None)
        try:
            read_answer(question.key, question, given)
        except InputError as error:
            typer.echo(str(error), err=True)
            continue
        return given
