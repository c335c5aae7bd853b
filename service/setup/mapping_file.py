"""The mapping file of `gear-twin import` for a machine's data, from the same answers as its rig file."""

from __future__ import annotations

from service.setup.answers import Answers
from service.setup.rig_file import RigDraft
from service.setup.toml_text import value_text


def mapping_text(answers: Answers, draft: RigDraft, rig_name: str) -> str:
    """The mapping file, which names the rig file that lies next to it."""
    path = answers.data_file or "data.csv"
    lines = [
        f"# Mapping of {answers.asset}, written by gear-twin init: which column is which channel.",
        'schema = "gear-import/1"',
        f"asset = {value_text(answers.asset)}",
        f"rig = {value_text(rig_name)}",
        f"age = {value_text(age_text(answers.age))}  # of the gears when the file begins",
        "",
        "[file]",
        f"path = {value_text(path)}" + ("" if answers.data_file else "  # replace: your data file"),
        "# sample_rate_hz = 25600  # of a file without a time column"
        if answers.sample_rate is None
        else f"sample_rate_hz = {value_text(answers.sample_rate)}",
    ]
    for name, sensor in zip(draft.accelerometers, answers.accelerometers, strict=True):
        lines += ["", f"[channels.{name}]", *_column(sensor.column, name), f"unit = {value_text(sensor.unit)}"]
        if sensor.sensitivity is not None:
            lines.append(f"sensitivity = {value_text(sensor.sensitivity)}")
    if answers.torque_meter:
        lines += ["", "[channels.torque.pinion]", *_column(answers.torque_column, "torque"), 'unit = "Nm"']
    for shaft, edges, column in zip(("pinion", "gear"), answers.edges, answers.encoder_columns, strict=True):
        if edges:
            lines += ["", *_encoder(answers.encoder_signal, shaft, edges, column)]
    return "\n".join(lines)


def age_text(age: str | float) -> str:
    """The age of the gears as a mapping file states it."""
    return age if isinstance(age, str) else f"{age:.0f} rev"


def _column(column: str | None, name: str) -> list[str]:
    if column is not None:
        return [f"column = {value_text(column)}"]
    return [f"column = {value_text(name)}  # replace: header of the column"]


def _encoder(signal: str, shaft: str, edges: int, column: str | None) -> list[str]:
    if signal == "pulses":
        return [
            f"[channels.tachometer.{shaft}]",
            *_column(column, f"tachometer_{shaft}"),
            'unit = "V"',
            f"pulses_per_rev = {edges}",
        ]
    head = f"[channels.encoder.{shaft}]"
    if signal == "quadrature":
        columns = value_text([f"{shaft}_a", f"{shaft}_b"])
        return [
            head,
            f"columns = {columns}  # replace: headers of both levels",
            'unit = "quadrature"',
            f"edges_per_rev = {edges}",
        ]
    return [head, *_column(column, f"{shaft}_edges"), 'unit = "s"', f"edges_per_rev = {edges}"]
