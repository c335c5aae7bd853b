"""`gear-twin report`: one answer as plain text, or as a report for people (service/report)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.cli.answer import answer_text
from service.cli.diagnosis import sentence
from service.errors import InputError
from service.files.rig import load_mapping
from service.stream.sources.mcap import Recording


def load_answer(path: Path) -> dict[str, Any]:
    """The answer that `assess --json` wrote."""
    try:
        answer = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not an answer of gear-twin assess --json: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {(error.strerror or 'fault').lower()}") from None
    needed = ("asset", "windows", "wear", "rul", "effects", "data_quality", "tracing", "unexplained")
    missing = [key for key in needed if key not in answer] if isinstance(answer, dict) else list(needed)
    if missing:
        raise InputError(f"{path}: not an answer of gear-twin assess --json: {', '.join(missing)} missing")
    return dict(answer)


def text_report(answer: Mapping[str, Any]) -> str:
    """The answer as plain text."""
    effects = [f"  {sentence(effect)}" for effect in answer["effects"]]
    return "\n".join([answer_text(answer), *(["", "Effects", *effects] if effects else [])])


def machine_of(source: Path, rig: Path | None, prefix: str) -> Mapping[str, Any] | None:
    """The mapping of the rig file in use: the one given, else that of the recording; None for an answer without."""
    if rig is not None:
        return load_mapping(rig)
    if source.suffix == ".json":
        return None
    with Recording(source, prefix) as recording:
        return recording.rig()


def write_report(answer: Mapping[str, Any], path: Path, machine: Mapping[str, Any] | None) -> None:
    """The answer as a report for people: HTML or PDF, by the file's name.

    machine  mapping of the rig file, where it is known
    """
    from service.report import FORMATS, rendered, report_of

    kind = path.suffix.lower().lstrip(".")
    if kind not in FORMATS:
        raise InputError(f"{path}: a report is written as {' or '.join(f'.{name}' for name in FORMATS)}")
    try:
        path.write_bytes(rendered(report_of(answer, machine), kind))
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {(error.strerror or 'fault').lower()}") from None
