"""The mapping file of `gear-twin import` for a machine's data, from the same answers as its rig file."""

from __future__ import annotations

from typing import Any

from service.setup.answers import Answers
from service.setup.rig_file import RigDraft
from service.toml_text import lines_of


def mapping_text(answers: Answers, draft: RigDraft, rig_name: str) -> str:
    """The mapping file, which names the rig file that lies next to it."""
    head = {"schema": "gear-import/1", "asset": answers.asset, "rig": rig_name, "age": age_text(answers.age)}
    own = answers.data_file
    file = {"path": own or "data.csv", "sample_rate_hz": answers.sample_rate}
    lines = [f"# Mapping of {answers.asset}, written by gear-twin init: which column is which channel."]
    lines += lines_of(head, {"age": "of the gears when the file begins"})
    lines += ["", "[file]", *lines_of(file, {} if own else {"path": "replace: your data file"})]
    if answers.sample_rate is None:
        lines.append("# sample_rate_hz = 25600  # of a file without a time column")
    for name, sensor in zip(draft.accelerometers, answers.accelerometers, strict=True):
        lines += _channel(name, sensor.column, name, unit=sensor.unit, sensitivity=sensor.sensitivity)
    if answers.torque_meter:
        lines += _channel("torque.pinion", answers.torque_column, "torque", unit="Nm")
    for shaft, edges, column in zip(("pinion", "gear"), answers.edges, answers.encoder_columns, strict=True):
        if edges:
            lines += _encoder(answers.encoder_signal, shaft, edges, column)
    return "\n".join(lines)


def age_text(age: str | float) -> str:
    """The age of the gears as a mapping file states it."""
    return age if isinstance(age, str) else f"{age:.0f} rev"


def _channel(name: str, column: str | None, assumed: str, **more: Any) -> list[str]:
    about = {} if column else {"column": "replace: header of the column"}
    return ["", f"[channels.{name}]", *lines_of({"column": column or assumed, **more}, about)]


def _encoder(signal: str, shaft: str, edges: int, column: str | None) -> list[str]:
    if signal == "pulses":
        return _channel(f"tachometer.{shaft}", column, f"tachometer_{shaft}", unit="V", pulses_per_rev=edges)
    if signal == "quadrature":
        values = {"columns": [f"{shaft}_a", f"{shaft}_b"], "unit": "quadrature", "edges_per_rev": edges}
        about = {"columns": "replace: headers of both levels"}
        return ["", f"[channels.encoder.{shaft}]", *lines_of(values, about)]
    return _channel(f"encoder.{shaft}", column, f"{shaft}_edges", unit="s", edges_per_rev=edges)
