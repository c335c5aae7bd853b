"""`gear-twin init`, `doctor` and `thresholds`: files of a machine, what it can tell, and the numbers that decide."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from service.cli.assessing import Asset, Prefix, RigFile, Shown, answering, asked, prefix_of, windowing
from service.cli.config import configured
from service.errors import InputError
from service.json_text import write_text
from service.report.words import table, wrapped


@answering
def init(
    answers: Annotated[
        Path | None, Option("--answers", help="Answers file (TOML) instead of questions.", show_default=False)
    ] = None,
    out: Annotated[Path, Option(help="Directory for rig.toml and mapping.toml.")] = Path("."),
    force: Annotated[bool, Option("--force", help="Replace files that are there.")] = False,
) -> Shown:
    """Make a rig file and a mapping file from a few questions; says what the machine will be able to tell."""
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
    can, more = abilities(equipment), one_more(equipment)
    files = [f"rig file: {rig_path}", f"mapping file: {mapping_path}"]
    return Shown(
        _described(rig_path, mapping_path, draft, can, more),
        lambda: [*files, *_draft_lines(given, draft), *ability_lines(can, more)],
    )


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


def _draft_lines(given: Any, draft: Any) -> list[str]:
    from twin.features.level import USABLE

    rig = draft.rig
    lines = [f"no model of the machine: {reason}" for reason in draft.without_model]
    if given.driver == "gear":
        lines.append("In the files and in every answer `pinion` means the driving gear, here the larger one.")
    if not draft.without_model:
        pair = rig.gear_pair()
        lines += [
            f"module {pair.module * 1e3:.4g} mm, centre distance {pair.centre_distance * 1e3:.4g} mm, "
            f"contact ratio {pair.contact_ratio:.3f}, mesh frequency {pair.teeth[0] * given.speed:.4g} Hz",
            f"{len(rig.estimated.assumed)} values are generic, each marked `assumed` in the rig file.",
        ]
    if given.accelerometers and given.sample_rate is None:
        lines.append(
            f"the vibration level is taken up to {rig.band[1]:.0f} Hz: sample at {rig.band[1] / USABLE:.0f} Hz "
            "or more, or state your sample_rate"
        )
    if "end_of_life.max_depth" in rig.estimated.assumed:
        limit = rig.get("end_of_life.max_depth") * 1e3
        lines.append(f"wear limit: {limit:.3g} mm, 10 % of the tooth's thickness on the pitch circle; state your own")
    return lines


def ability_lines(can: Any, more: tuple[str, ...]) -> list[str]:
    """What a machine can tell as a table, and what one more sensor would add."""
    lines = ["", "What this machine can tell", *table([(a.what, a.level, a.how) for a in can])]
    return [*lines, "", "What one more sensor would add", *(f"- {line}" for line in more)] if more else lines


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
    """One answer as a person types it."""
    from service.setup.answers import read_answer

    said = question.text + (f" ({' / '.join(question.choices)})" if question.choices else "")
    if question.example and question.default is None:
        said += f", such as {question.example}"
    return asked(said, question.default, lambda given: read_answer(question.key, question, given))


@configured
@answering
def doctor(
    recording: Annotated[
        Path | None, Argument(metavar="[RECORDING]", help="Recording (MCAP).", show_default=False)
    ] = None,
    rig: RigFile = None,
    asset: Asset = None,
    prefix: Prefix = None,
) -> Shown:
    """Examine a recording and a rig file: what they support, likely mistakes, and what one more sensor would add."""
    from service.setup.examination import examined

    found = examined(recording, rig, asset, windowing(), prefix_of(prefix))
    return Shown(found.as_json(), lambda: _examined_lines(found))


def _examined_lines(found: Any) -> list[str]:
    lines = [
        f"recording: {found.recording or 'none'}",
        f"rig file: {found.rig or 'none: nothing is known of the machine'}",
    ]
    if found.channels:
        rows = [(row.label, row.rate, f"{row.duration:.4g} s", row.level) for row in found.channels]
        heads = ("channel", "rate", "duration", "level")
        lines += ["", f"Channels, first {found.windows} windows", *table(rows, heads, right=(2,))]
    if found.findings:
        lines += ["", "Findings"]
        order = {"problem": 0, "note": 1, "ok": 2}
        for finding in sorted(found.findings, key=lambda f: order[f.level]):
            lines.append(f"{finding.level:8}{finding.text}")
            lines += [f"{'':8}→ {finding.remedy}"] if finding.remedy else []
    return [*lines, *ability_lines(found.abilities, found.one_more_sensor)]


@answering
def thresholds(
    rig: Annotated[Path | None, Option(help="Rig file: show the sizes on this machine, too.")] = None,
) -> Shown:
    """Print every number that decides a verdict, with its unit, meaning and source."""
    from service.files.rig import load_rig
    from service.stream.clock import ClockThresholds
    from service.stream.samples import RangeThresholds
    from twin.scales import Scales
    from twin.threshold_register import SETS, register

    scales = None if rig is None else Scales.of(load_rig(rig))
    found = list(register(scales, (*SETS, ClockThresholds, RangeThresholds)))
    return Shown([_described_threshold(item) for item in found], lambda: _threshold_lines(found))


def _described_threshold(item: Any) -> dict[str, Any]:
    about = item.row.about
    return {
        "module": item.module,
        "set": item.row.group,
        "name": item.row.name,
        "value": item.row.value,
        "unit": about.unit,
        "share_of": about.of,
        "on_this_rig": item.scaled,
        "on_this_rig_unit": item.scaled_unit,
        "meaning": about.meaning,
        "source": about.source,
    }


def _threshold_lines(found: list[Any]) -> list[str]:
    """Every number under the name of its set, with its meaning and source below it."""
    lines, last = ["Numbers that decide a verdict"], ""
    for item in found:
        group, about = f"{item.module}: {item.row.group}", item.row.about
        if group != last:
            lines += ["", group]
        of = f", share of {about.of}" if about.of else ""
        here = "" if item.scaled is None else f"; on this rig {_short(item.scaled)} {item.scaled_unit}".rstrip()
        lines.append(f"  {item.row.name} = {_short(item.row.value)} {about.unit}".rstrip() + of + here)
        lines += wrapped(f"{about.meaning}. Source: {about.source}", 6)
        last = group
    return lines


def _short(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_short, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)
