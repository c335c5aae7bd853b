"""Prints the tables of docs/reference from the code that they describe.

    python -m benchmarks.reference commands | settings | rig | rest | json | answers | units | client | plant | opcua
        | metrics | loops | states

The documentation site shows them in the pages (docs/site/hooks.py).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from twin.rig_estimated import PARTS
from twin.wear.laws import LAWS

MEANINGS = {
    "schema": "form of the file",
    "name": "name of the machine",
    "gears.age": "revolutions that the gears had made when the count of the pinion's revolutions was 0, which may be "
    "`unknown`; where it is left out, the count is one since new",
    "gears.backlash": "along the line of action, total",
    "gears.pinion.bore_radius": "for the foundation's compliance",
    "gears.gear.bore_radius": "for the foundation's compliance",
    "gears.pinion.pitch_radius": "derived; checked where given",
    "gears.gear.pitch_radius": "derived; checked where given",
    "gears.pinion.base_radius": "derived; checked where given",
    "gears.gear.base_radius": "derived; checked where given",
    "mesh.pair_s": "places on the path of contact, from the pitch point",
    "mesh.pair_stiffness": "stiffness of one tooth pair at these places",
    "mesh.stiffness_scale": "factor on the mesh stiffness, 1 where it is left out; calibrated",
    "mesh.relative_damping_time": "τ: contact force = k·max(0, δ + τ·δ′); calibrated",
    "shafts.gear_position_fraction": "distance from the drive-side bearing to the gear, of the span",
    "rolling_bearings[].name": "any; shown at its markers",
    "rolling_bearings[].shaft": "on which the inner ring sits; the outer ring is fixed",
    "rolling_bearings[].rolling_elements": "number; for markers in spectra only",
    "rolling_bearings[].element_diameter": "of a ball or roller",
    "rolling_bearings[].pitch_diameter": "of the circle through the elements' centres",
    "rolling_bearings[].contact_angle_deg": "0 where not given",
    "damping.modal_ratio": "of the structure without its mesh; calibrated",
    "sensors.accelerometer": "coordinate at which the reference accelerometer sits",
    "sensors.band_hz": "band of the vibration level",
    "sensors.temperature": "places of the temperature channels",
    "sensors.uncalibrated": "channels whose unit is not known, such as `accel/y6`; `import` writes it",
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
    "end_of_life.horizon_days": "how far ahead the end of life is looked for; 30 where it is left out",
    "description": "for people; not used",
    "gears.module": "m",
    "gears.pressure_angle_deg": "α",
    "gears.face_width": "W",
    "gears.youngs_modulus": "E of both gears and shafts",
    "gears.poisson_ratio": "ν",
    "gears.density": "for mass and inertia of the gears: derived where they are left out, compared where given",
    "gears.addendum": "of both gears, in metres",
    "gears.dedendum": "of both gears, in metres",
    "gears.pinion.teeth": "z1",
    "gears.gear.teeth": "z2",
    "gears.path_of_contact.start": "derived; checked where given",
    "gears.path_of_contact.end": "derived; checked where given",
    "gears.path_of_contact.base_pitch": "derived; checked where given",
    "gears.path_of_contact.contact_ratio": "derived; checked where given",
    "mesh.stiffness_source": "`given`: pair_stiffness is used; `energy`, the default: it is compared only",
    "mesh.mean_stiffness": "compared with the mean of the stiffness in use",
    "mesh.damping": "τ·mean_stiffness: gives τ where it is left out, else compared",
    "mesh.corner_gap_start": "c0, c1, c2 of x²·(c0 + c1·x + c2·x²), before the path; compared",
    "mesh.corner_gap_end": "the same behind the path",
    "layout.degrees_of_freedom": "coordinates of the model; checked",
    "layout.torsion_chain_input": "nodes of the model's chain; checked",
    "layout.torsion_chain_output": "nodes of the model's chain; checked",
    "shafts.length": "compared with the segments",
    "shafts.diameter_min": "compared with the segments",
    "shafts.diameter_max": "compared with the segments",
    "shafts.torsion_segments": "length and diameter of the parts of a shaft half",
    "shafts.torsional_stiffness_half": "of a shaft half without joints: for a k_3_5 and its kind that is left out",
    "shafts.bearing_span": "for bending stiffness and mass: derived where they are left out, compared where given",
    "shafts.bending_diameter_input": "effective, of the stepped shaft; as bearing_span",
    "shafts.bending_diameter_output": "effective, of the stepped shaft; as bearing_span",
    "shafts.bending_stiffness_input": "at the gear, between its bearings",
    "shafts.bending_stiffness_output": "at the gear, between its bearings",
    "couplings.lateral_stiffness": "acts at the bearings next to the couplings to motor and brake, x and y",
    "sensors.encoder_input": "coordinate that the pinion's encoder measures; th7 where not stated",
    "sensors.encoder_output": "coordinate that the gear's encoder measures; th8 where not stated",
    "sensors.torque": "place of the torque meter, such as k_2_3*(th2-th3), or `measured`, which means that one",
    "tolerances.stiffness": "relative half-width of all stiffnesses; 0.03 where not stated",
    "tolerances.mass": "relative half-width of all masses and inertias; 0.01",
    "tolerances.damping": "relative half-width of the modal damping; 0.2",
    "tolerances.pinion_once_per_turn": "std of the disc's error at one cycle a turn, at the base radius; 1.5e-6",
    "tolerances.gear_once_per_turn": "the same of the gear's disc; 1.5e-6",
    "tolerances.pinion_graduation": "std of the disc's error at the next few cycles a turn; 0.6e-6",
    "tolerances.gear_graduation": "the same of the gear's disc; 1.6e-6",
    "tolerances.accelerometer_gain": "std of the logarithm of an accelerometer's gain; 0.2",
    "tolerances.acceleration_floor": "amplitude of a line below which nothing is read from it; 0.002",
    "tolerances.torque_floor": "the same of the torque meter; 5e-4 of the rated torque",
    "estimated.by": "program or person that made the estimates",
    "estimated.parts": f"what of the file is estimated, each with its spread: {', '.join(PARTS)}",
    "estimated.derived": "keys whose values follow from given ones by a formula or a standard",
    "estimated.assumed": "keys whose values are generic",
    "operating.measurement_interval_revs": "planned between measurements; compared with the life that wear.K predicts",
    "operating.hours_per_day": "running time per day, from which the date of the end of life follows",
    "operating.end_revs": "planned end of operation; compared with the life that wear.K predicts",
    "wear.max_depth_at_6000": "of both flanks together; compared with what wear.K predicts",
    "wear.pinion_share": "z2/(z1 + z2); checked where given",
    "encoders.pinion_edges_per_rev": "lines of the disc; frames with another number degrade their window",
    "encoders.gear_edges_per_rev": "lines of the disc; frames with another number degrade their window",
    "reference.natural_frequencies_hz.measured": "origin of the values; not used by the model",
    "reference.natural_frequencies_hz.paper_model": "origin of the values; not used by the model",
    "reference.natural_frequencies_hz.this_model": "origin of the values; not used by the model",
    "reference.natural_frequencies_hz.next_above": "origin of the values; not used by the model",
    "inertias.J1": "motor",
    "inertias.J2": "torque meter",
    "inertias.J3": "coupling hub of the pinion's shaft",
    "inertias.J5": "pinion",
    "inertias.J7": "encoder of the pinion's shaft",
    "inertias.J8": "encoder of the gear's shaft",
    "inertias.J10": "gear",
    "inertias.J12": "coupling hub of the gear's shaft",
    "inertias.J13": "brake",
    "masses.m4": "drive-side bearing of the pinion's shaft",
    "masses.m5": "pinion",
    "masses.m6": "free-side bearing of the pinion's shaft",
    "masses.m9": "free-side bearing of the gear's shaft",
    "masses.m10": "gear",
    "masses.m11": "drive-side bearing of the gear's shaft",
    "torsional_stiffness.k_1_2": "between nodes 1 and 2",
    "torsional_stiffness.k_2_3": "between nodes 2 and 3",
    "torsional_stiffness.k_3_5": "between nodes 3 and 5",
    "torsional_stiffness.k_5_7": "between nodes 5 and 7",
    "torsional_stiffness.k_8_10": "between nodes 8 and 10",
    "torsional_stiffness.k_10_12": "between nodes 10 and 12",
    "torsional_stiffness.k_12_13": "between nodes 12 and 13",
    "bearings.kx_input": "each bearing of the pinion's shaft to the ground, x",
    "bearings.kx_output": "each bearing of the gear's shaft to the ground, x",
    "bearings.ky_input": "each bearing of the pinion's shaft to the ground, y",
    "bearings.ky_output": "each bearing of the gear's shaft to the ground, y",
} | {f"wear.{law.name}.{p.key}": p.meaning for law in LAWS.values() for p in law.parameters}

MEANINGS |= {f"estimated.spread.{part}": f"std of the logarithm of {meaning}" for part, meaning in PARTS.items()}


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
    """Every setting of the service with its place in the file, variable, default and limits."""
    from service.configuration.printed import shown
    from service.configuration.tables import places
    from service.settings import Settings
    from service.toml_text import value_text

    rows = []
    for name, place in places(Settings).items():
        field = Settings.model_fields[name]
        value = shown(field.get_default(call_default_factory=True))
        default = "" if value is None else f"`{value_text(value)}`"
        limits = [f"{sign} {getattr(m, key):g}" for m in field.metadata for key, sign in _SIGNS if hasattr(m, key)]
        rows.append((f"`{place}`", f"`{place.variable}`", default, ", ".join(limits), field.description or ""))
    return table(("in the file", "variable", "default", "limits", "meaning"), rows)


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
        if hasattr(rule, "columns"):
            yield from _rig_rows(rule.columns, f"{name}[].")
            continue
        rule, words = getattr(rule, "rule", rule), getattr(rule, "words", ())
        rule = getattr(rule, "number", rule)
        unit = getattr(rule, "unit", "")
        low, high = getattr(rule, "low", None), getattr(rule, "high", None)
        allowed = getattr(rule, "allowed", ())
        if low is not None and hasattr(rule, "closed"):
            numbers = f"{'' if rule.closed else 'above '}{low:g} … {high:g}"
            bounds = ", ".join([*(f"`{word}`" for word in words), numbers])
        elif allowed:
            bounds = ", ".join(f"`{a}`" for a in allowed)
        else:
            bounds = {"_Numbers": "list of numbers", "_Names": "list of names"}.get(type(rule).__name__, "text")
        yield f"`{name}`", unit, bounds, MEANINGS.get(name, getattr(rule, "meaning", "") or "")


def _openapi() -> dict[str, Any]:
    from fastapi import FastAPI

    from service.api import (
        alarms,
        assets,
        audit,
        effects,
        events,
        guard,
        incoming,
        metrics,
        rig_proposals,
        sessions,
        signals,
        what_if,
    )
    from service.api import asset_life as life_routes
    from service.api import asset_list as list_routes
    from service.api import baselines as baseline_routes

    app = FastAPI()
    for module in (metrics, list_routes, assets, incoming, rig_proposals, effects, alarms, events, signals, what_if):
        app.include_router(module.router)
    for module in (life_routes, baseline_routes, sessions, audit):
        app.include_router(module.router)
    schema = app.openapi()
    guard.described(schema, app)
    return schema


def rest() -> str:
    """Every call of the REST interface."""
    from service.api.guard import REFUSALS

    rows = []
    for path, methods in _openapi()["paths"].items():
        for method, call in methods.items():
            about = " ".join(call.get("description", call.get("summary", "")).split())
            codes = ", ".join(sorted(set(call.get("responses", {})) - {"401", *REFUSALS}))
            rows.append((f"`{method.upper()} {path}`", call.get("x-role", ""), about, codes))
    return table(("call", "role", "answer", "status"), rows)


def keys() -> str:
    """Every key of the answers, by the models that also make the OpenAPI page."""
    return _models(_openapi()["components"]["schemas"])


def plant() -> str:
    """Every key of what bridges publish."""
    from service.contract.plant import MODELS

    found: dict[str, Any] = {}
    for model in MODELS:
        schema = model.model_json_schema()
        found |= {model.__name__: schema, **schema.get("$defs", {})}
    return _models(found)


def opcua() -> str:
    """Every variable that OPC UA clients read of an asset."""
    from service.bridges.readings import UNITS, VARIABLES

    kinds = {"number": "Double", "count": "UInt32", "yes": "Boolean", "text": "String", "lines": "String[]"}
    rows = [
        (f"`{name}`", kinds[v.kind], UNITS[v.unit][0] if v.unit else "", v.meaning) for name, v in VARIABLES.items()
    ]
    return table(("variable", "type", "unit", "meaning"), rows)


def _models(schemas: Mapping[str, Any]) -> str:
    out = []
    for name, schema in schemas.items():
        if not schema.get("properties") or name in ("HTTPValidationError", "ValidationError"):
            continue
        rows = [
            (f"`{key}`", _kind(_resolved(field, schemas)), " ".join(field.get("description", "").split()))
            for key, field in schema["properties"].items()
        ]
        out.append(f"### {name}\n\n{' '.join(schema.get('description', '').split())}")
        out.append(table(("key", "type", "meaning"), rows))
    return "\n\n".join(out)


def _resolved(field: Mapping[str, Any], schemas: Mapping[str, Any]) -> Mapping[str, Any]:
    """A field whose type has no table of its own with the values of that type, such as a role."""
    if "anyOf" in field:
        return {**field, "anyOf": [_resolved(each, schemas) for each in field["anyOf"]]}
    found = schemas.get(field.get("$ref", "").rpartition("/")[2], {})
    return found if "enum" in found else field


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


def answers() -> str:
    """Every key of an answers file of `gear-twin init`."""
    from service.setup.questions import OF_SENSOR, QUESTIONS

    rows = [_answer_row(q, "") for q in QUESTIONS]
    rows += [_answer_row(q, "accelerometers[].") for q in OF_SENSOR]
    rows.append(
        ("`known`", "", "", "table of rig file keys whose values are known, in SI units; they replace generic ones")
    )
    return table(("key", "value", "default", "meaning"), rows)


def _answer_row(question: Any, path: str) -> tuple[str, str, str, str]:
    kinds = {"count": "whole number", "yes": "`yes`, `no`", "text": "text", "number": "number"}
    values = ", ".join(f"`{c}`" for c in question.choices) or kinds.get(question.kind, question.kind)
    example = f", such as `{question.example}`" if question.example and not question.choices else ""
    default = "required" if question.needed else f"`{question.default}`" if question.default is not None else ""
    text = question.text.partition(" (Enter")[0] + (f"; {question.hint}" if question.hint else "")
    return f"`{path}{question.key}`", values + example, default, text


def units() -> str:
    """The units that an answers file may use."""
    from service.setup.questions import UNITS

    return table(("quantity", "units"), [(kind, ", ".join(f"`{u}`" for u in known)) for kind, known in UNITS.items()])


def client() -> str:
    """Every method of the Python client, from its signature and the first line of its docstring."""
    import inspect

    from gear_twin import Client

    rows = []
    for name, method in vars(Client).items():
        if name.startswith("_") or not callable(method):
            continue
        signature = inspect.signature(method)
        parameters = str(_without_types(signature, inspect.Parameter.empty)).removeprefix("(self").removesuffix(")")
        about = inspect.getdoc(method) or ""
        rows.append(
            (f"`{name}({parameters.removeprefix(', ')})`", f"`{signature.return_annotation}`", about.splitlines()[0])
        )
    return table(("call", "result", "what it does"), rows)


def _without_types(signature: Any, empty: Any) -> Any:
    parameters = [p.replace(annotation=empty) for p in signature.parameters.values()]
    return signature.replace(parameters=parameters, return_annotation=empty)


def metrics() -> str:
    """Every metric of /metrics, in groups."""
    from benchmarks import reference_operations

    return _groups(reference_operations.metrics())


def loops() -> str:
    """The loops that /healthz looks at."""
    from service.operation.health import LOOPS

    return table(("loop", "what it does"), [(name, what) for name, what in LOOPS.items()])


def states() -> str:
    """Every status, grade, fault and cause."""
    from benchmarks import reference_operations

    return _groups(reference_operations.states())


def _groups(groups: Sequence[tuple[str, tuple[str, ...], Sequence[tuple[str, ...]]]]) -> str:
    """Tables, each below its title."""
    shown = ((f"### {title}\n\n" if title else "") + table(heads, rows) for title, heads, rows in groups)
    return "\n\n".join(shown)


TABLES = {
    "commands": commands, "settings": settings, "rig": rig, "rest": rest, "json": keys, "answers": answers,
    "units": units, "client": client, "plant": plant, "opcua": opcua, "metrics": metrics,
    "loops": loops, "states": states,
}  # fmt: skip


def main() -> None:
    if len(sys.argv) != 2 or sys.argv[1] not in TABLES:
        raise SystemExit(f"usage: python -m benchmarks.reference {' | '.join(TABLES)}")
    print(TABLES[sys.argv[1]]())


if __name__ == "__main__":
    main()
