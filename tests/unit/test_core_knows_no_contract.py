"""The core computes in SI: the types of its answer declare the contract's keys and units, nothing else knows them."""

import ast
import re
import typing
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pydantic
import pytest

from service.contract.answer import Asset

ROOT = Path(__file__).parents[2]
NOT_SI = re.compile(r"(?:^|_)(?:um|percent|hours|urad|mm|deg|degc|rpm|ms)$", re.IGNORECASE)
RIG_KEY = re.compile(r"^(?:\w+\.)?(?:pressure_angle_deg|contact_angle_deg|min_deg|max_deg|hours_per_day|\w*_degC)$")
SCALING = re.compile(r"^(?:MICRO|PERCENT|MILLI)\w*$")
PLAIN = {  # keys that are plain words or field names of the core, too
    "index", "kind", "name", "value", "unit", "std", "windows", "orders", "bands", "status", "reason", "reasons",
    "level", "levels", "method", "methods", "fused", "rms", "values", "misfit", "profile", "pinion", "gear",
    "combined", "revolutions", "residual", "effects", "parameters", "measured", "predicted", "before", "after",
}  # fmt: skip


@cache
def files() -> tuple[Path, ...]:
    return tuple(sorted((ROOT / "twin").rglob("*.py")))


def computing() -> list[Path]:
    """The files of the core but those that declare what an answer shows."""
    return [file for file in files() if file.parent.name != "assessment"]


def keys_of(model: type[pydantic.BaseModel], seen: set[type] | None = None) -> set[str]:
    """Every key of a model and of the models within it."""
    seen = set() if seen is None else seen
    if model in seen:
        return set()
    seen.add(model)
    found: set[str] = set()
    for name, field in model.model_fields.items():
        found.add(field.alias or name)
        todo = [field.annotation]
        while todo:
            kind = todo.pop()
            todo += typing.get_args(kind)
            if isinstance(kind, type) and issubclass(kind, pydantic.BaseModel):
                found |= keys_of(kind, seen)
    return found


def nodes(file: Path) -> Iterator[ast.AST]:
    """The syntax of a file without the functions that translate its own data for a file or a state."""
    todo: list[ast.AST] = [ast.parse(file.read_text(encoding="utf-8"))]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.FunctionDef) and node.name in ("to_dict", "from_dict"):
            continue
        yield node
        todo += ast.iter_child_nodes(node)


def field_names() -> set[str]:
    """Names of the fields and arguments of the core: its own words."""
    names: set[str] = set()
    for file in files():
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                names.add(node.target.id)
            elif isinstance(node, ast.arg):
                names.add(node.arg)
    return names


def test_contract_has_the_keys_that_this_test_looks_for():
    assert {"k_wear_per_n", "wear_depth_um", "share_percent", "indistinguishable_from"} <= keys_of(Asset)


@pytest.mark.slow
def test_no_part_of_the_core_holds_a_key_of_the_contract():
    keys = (
        keys_of(Asset) - field_names() - PLAIN - {"band_hz", "hours_per_day", "schema_version"}
    )  # the last three are keys of the rig file or of a stored state, too
    assert {"k_wear_per_n", "max_depth_um", "rms_error_percent", "wear_depth_um_before", "rul"} <= keys
    wrong = []
    for file in computing():
        for node in nodes(file):
            if isinstance(node, ast.Constant) and node.value in keys:
                wrong.append(f"{file.relative_to(ROOT)}:{node.lineno} {node.value!r}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_no_name_of_the_core_has_a_unit_other_than_si():
    wrong = []
    for file in computing():
        if file.name in ("rig.py", "rig_schema.py", "rig_consistency.py", "rig_notes.py"):
            continue  # the rig file's own keys are an interface, checked in one place
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and re.fullmatch(r"[\w.]+", node.value):
                names = [node.value.rpartition(".")[2]] if not RIG_KEY.match(node.value) else []
            elif isinstance(node, ast.Name):
                names = [node.id] if node.id.isidentifier() else []
            elif isinstance(node, (ast.Attribute, ast.arg)):
                names = [node.attr if isinstance(node, ast.Attribute) else node.arg]
            wrong += [
                f"{file.relative_to(ROOT)}:{node.lineno} {n}" for n in names if NOT_SI.search(n) or SCALING.match(n)
            ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_no_part_of_the_core_knows_of_the_edge():
    for file in files():
        assert '"not available"' not in file.read_text(encoding="utf-8"), file
        assert "service" not in {
            (node.module or "").partition(".")[0]
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
            if isinstance(node, ast.ImportFrom)
        }
