"""Prints the tables of docs/reference from the code that they describe.

    python -m benchmarks.reference commands | settings | rig | rest | json

`python -m benchmarks.figures reference` writes them into the pages.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from twin.wear.laws import LAWS

MEANINGS = {
    "schema": "form of the file",
    "name": "name of the machine",
    "gears.backlash": "along the line of action, total",
    "gears.pinion.bore_radius": "for the foundation's compliance",
    "gears.gear.bore_radius": "for the foundation's compliance",
    "gears.pinion.pitch_radius": "derived; checked where given",
    "gears.gear.pitch_radius": "derived; checked where given",
    "gears.pinion.base_radius": "derived; checked where given",
    "gears.gear.base_radius": "derived; checked where given",
    "mesh.pair_s": "places on the path of contact, from the pitch point",
    "mesh.pair_stiffness": "stiffness of one tooth pair at these places",
    "mesh.stiffness_scale": "factor on the mesh stiffness; calibrated",
    "mesh.relative_damping_time": "τ: contact force = k·max(0, δ + τ·δ′); calibrated",
    "shafts.gear_position_fraction": "distance from the drive-side bearing to the gear, of the span",
    "damping.modal_ratio": "of the structure without its mesh; calibrated",
    "sensors.accelerometer": "coordinate at which the reference accelerometer sits",
    "sensors.band_hz": "band of the vibration level",
    "sensors.temperature": "places of the temperature channels",
    "sensors.ranges.accel": "full scale, one number or one for each sensor",
    "sensors.ranges.torque": "full scale, one number or one for each shaft",
    "operating.pinion_speed_hz": "nominal speed",
    "operating.input_torque": "nominal torque on the pinion's shaft",
    "operating.calibration_points": "speed and torque of low-speed windows, from which the model is calibrated",
    "wear.K": "wear coefficient, dh = K·τ·F·v per passage",
    "wear.dwell_time": "τ of K: time for which the contact stays on a point of the flank",
    "wear.contact_half_width": "half of the width over which the flanks touch",
    "wear.law": "wear law, one of twin/wear/laws; archard where not stated",
    "end_of_life.criterion": "what ends the life",
    "end_of_life.max_depth": "largest wear depth of both flanks together",
} | {f"wear.{law.name}.{p.key}": p.meaning for law in LAWS.values() for p in law.parameters}


def table(heads: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """A Markdown table."""
    cells = [heads, ("---",) * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in cells)


def commands() -> str:
    """Every command with its arguments and options, as its help states them."""
    import typer

    from service.cli.commands import app

    out = []
    for name, command in sorted(_leaves(typer.main.get_command(app), "gear-twin")):
        rows = []
        for parameter in command.params:
            if parameter.name == "help":
                continue
            argument = parameter.param_type_name == "argument"
            label = (parameter.metavar or parameter.human_readable_name) if argument else ", ".join(parameter.opts)
            about = " ".join((getattr(parameter, "help", None) or "").split())
            rows.append((f"`{label}`", about, _default(parameter)))
        out.append(f"### {name}\n\n{' '.join((command.help or '').split())}")
        if rows:
            out.append(table(("argument or option", "meaning", "default"), rows))
    return "\n\n".join(out)


def _leaves(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    """The commands below a group, each with its whole name."""
    for child, found in getattr(command, "commands", {}).items():
        if getattr(found, "commands", None):
            yield from _leaves(found, f"{name} {child}")
        else:
            yield f"{name} {child}", found


def _default(parameter: Any) -> str:
    if parameter.required:
        return "required"
    value = parameter.default
    if value is None or value is False or value == [] or callable(value):
        return ""
    return f"`{getattr(value, 'value', value)}`"


def settings() -> str:
    """Every setting of the service with its variable, default and limits."""
    from service.settings import Settings

    rows = []
    for name, field in Settings.model_fields.items():
        value = field.get_default(call_default_factory=True)
        shown = json.dumps(value) if isinstance(value, (list, bool)) else str(value)
        limits = [f"{sign} {getattr(m, key):g}" for m in field.metadata for key, sign in _SIGNS if hasattr(m, key)]
        rows.append((f"`GEAR_TWIN_{name.upper()}`", f"`{shown}`", ", ".join(limits), field.description or ""))
    return table(("variable", "default", "limits", "meaning"), rows)


_SIGNS = (("ge", "≥"), ("gt", ">"), ("le", "≤"), ("lt", "<"))


def rig() -> str:
    """Every key of a rig file with unit and range."""
    from twin.rig_schema import SCHEMA

    return table(("key", "unit", "range", "meaning"), list(_rig_rows(SCHEMA, "")))


def _rig_rows(schema: Mapping[str, Any], path: str) -> Iterator[tuple[str, str, str, str]]:
    for key, rule in schema.items():
        name = f"{path}{key}"
        if isinstance(rule, Mapping):
            yield from _rig_rows(rule, f"{name}.")
            continue
        rule = getattr(rule, "rule", rule)
        unit = getattr(rule, "unit", "")
        low, high = getattr(rule, "low", None), getattr(rule, "high", None)
        allowed = getattr(rule, "allowed", ())
        if low is not None and hasattr(rule, "closed"):
            bounds = f"{'' if rule.closed else 'above '}{low:g} … {high:g}"
        elif allowed:
            bounds = ", ".join(f"`{a}`" for a in allowed)
        else:
            bounds = {"_Numbers": "list of numbers", "_Names": "list of names"}.get(type(rule).__name__, "text")
        yield f"`{name}`", unit, bounds, MEANINGS.get(name, getattr(rule, "meaning", "") or "")


def _openapi() -> dict[str, Any]:
    from fastapi import FastAPI

    from service.api import assets, effects, events, metrics

    app = FastAPI()
    for module in (metrics, assets, effects, events):
        app.include_router(module.router)
    return app.openapi()


def rest() -> str:
    """Every call of the REST interface."""
    rows = []
    for path, methods in _openapi()["paths"].items():
        for method, call in methods.items():
            about = " ".join(call.get("description", call.get("summary", "")).split())
            codes = ", ".join(sorted(call.get("responses", {})))
            rows.append((f"`{method.upper()} {path}`", about, codes))
    return table(("call", "answer", "status"), rows)


def keys() -> str:
    """Every key of the answers, by the models that also make the OpenAPI page."""
    out = []
    for name, schema in _openapi()["components"]["schemas"].items():
        if not schema.get("properties") or name in ("HTTPValidationError", "ValidationError"):
            continue
        rows = [
            (f"`{key}`", _kind(field), " ".join(field.get("description", "").split()))
            for key, field in schema["properties"].items()
        ]
        out.append(f"### {name}\n\n{' '.join(schema.get('description', '').split())}")
        out.append(table(("key", "type", "meaning"), rows))
    return "\n\n".join(out)


def _kind(field: Mapping[str, Any]) -> str:
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return "any" if name == "JsonValue" else f"[{name}](#{name.lower()})"
    if "anyOf" in field:
        return " or ".join(dict.fromkeys(_kind(f) for f in field["anyOf"]))
    if "enum" in field or "const" in field:
        return ", ".join(f"`{value}`" for value in field.get("enum", [field.get("const")]))
    if field.get("type") == "array":
        return f"list of {_kind(field.get('items', {}))}"
    if field.get("type") == "object" and isinstance(field.get("additionalProperties"), Mapping):
        return f"by name: {_kind(field['additionalProperties'])}"
    return field.get("type", "any")


TABLES = {"commands": commands, "settings": settings, "rig": rig, "rest": rest, "json": keys}


def main() -> None:
    if len(sys.argv) != 2 or sys.argv[1] not in TABLES:
        raise SystemExit(f"usage: python -m benchmarks.reference {' | '.join(TABLES)}")
    print(TABLES[sys.argv[1]]())


if __name__ == "__main__":
    main()
