"""What the operations page explains is all that the program says: faults, statuses, causes, alert rules."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest
import yaml

from service.bridges.slow_inputs import CAUSES as INPUT_CAUSES
from service.contract.alarms import State
from service.contract.finding import Level
from service.contract.question import Question
from service.contract.status import DataLevel
from service.errors import StorageFault
from service.operation import state_catalogue as states
from service.operation.metric_catalogue import METRICS
from service.runtime.worker_figures import CAUSES
from service.stream import inbox, left_out, order
from service.stream.faults import GRADES

ROOT = Path(__file__).parents[2]
TABLES = [table for name, table in vars(states).items() if name.isupper()]
RULES = ROOT / "docker" / "prometheus" / "rules.yml"


@pytest.mark.parametrize(
    ("table", "names"),
    [
        (states.STATUSES, get_args(Level)),
        (states.DATA, get_args(DataLevel)),
        (states.GRADES, tuple(GRADES.values())),
        (states.ALARMS, get_args(State)),
        (states.QUESTIONS, get_args(Question.model_fields["kind"].annotation)),
        (states.STORAGE, get_args(StorageFault)),
    ],
    ids=["status", "data", "grade", "alarm", "question", "storage"],
)
def test_every_status_and_cause_is_in_the_catalogue_and_no_other_is(table, names):
    assert set(table) == set(names)


def fault_kinds():
    """Every kind of a fault that the code makes, with the place."""
    for file in (*(ROOT / "service").rglob("*.py"), *(ROOT / "twin").rglob("*.py")):
        module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for function in (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)):
            for node in ast.walk(function):
                for kind in kinds_of(node, module):
                    if kind is not None:
                        yield kind, module
                    elif not any(a.arg == "kind" for a in function.args.args):  # one of those that it loops over
                        for each in ast.walk(function):
                            if isinstance(each, ast.Constant) and re.fullmatch(r"[a-z_]{2,}", str(each.value)):
                                yield each.value, module
    for name, value in vars(order).items():
        if name.isupper() and isinstance(value, str) and value != order.QUEUED:
            yield value, "service.stream.order"


def kinds_of(node, module):
    """The kind that a call or a mapping names; None where it is in a variable."""
    if isinstance(node, ast.Call):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name == "Fault":
            yield from (value_of(k.value, module) for k in node.keywords if k.arg == "kind")
        elif name == "count" and len(node.args) in (2, 3) and "stream" in module:
            yield from (v for v in [value_of(node.args[1], module)] if v is not None)
    elif isinstance(node, ast.Dict):
        keys = {k.value: v for k, v in zip(node.keys, node.values, strict=True) if isinstance(k, ast.Constant)}
        if {"kind", "action", "channel"} <= set(keys) and isinstance(keys["kind"], ast.Constant):
            yield keys["kind"].value


def value_of(expression, module):
    if isinstance(expression, ast.Constant):
        return expression.value
    if isinstance(expression, (ast.Name, ast.Attribute)):
        found = import_module(module)
        for part in ast.unparse(expression).split("."):
            found = getattr(found, part, None)
        return found if isinstance(found, str) else None
    return None


@pytest.mark.slow
def test_every_kind_of_fault_is_in_the_catalogue_and_no_other_is():
    made = {kind: place for kind, place in fault_kinds() if kind != "frames"}  # which counts all of them
    assert set(made) - set(states.FAULTS) == set(), made
    assert set(states.FAULTS) - set(made) == set()


def test_causes_of_frames_that_are_left_out_are_named_where_they_are_counted():
    known = {left_out.NO_ROOM, inbox.BAD_KEY, left_out.MANY_STREAMS, inbox.CLOSED}
    assert known <= set(CAUSES)
    assert all(f"`{cause}`" in METRICS["frames_left_out"].meaning for cause in CAUSES)
    guide = (ROOT / "docs/how-to/connect-mqtt-and-opcua.md").read_text(encoding="utf-8")
    assert all(f"`{cause}`" in guide or cause.replace("_", " ") in guide for cause in INPUT_CAUSES)


def test_everything_says_what_it_means_in_one_line():
    assert len(TABLES) == 7
    for name, entry in (item for table in TABLES for item in table.items()):
        assert entry.meaning and "\n" not in entry.meaning, name
    assert all(entry.meaning for entry in METRICS.values())


def test_alert_rules_ask_for_metrics_that_exist_with_their_labels_and_say_what_to_do():
    (group,) = yaml.safe_load(RULES.read_text(encoding="utf-8"))["groups"]
    exported = {entry.shown: entry for entry in METRICS.values()}
    histograms = [entry for entry in METRICS.values() if entry.type == "histogram"]
    exported |= {f"{entry.shown}_{part}": entry for entry in histograms for part in ("bucket", "count", "sum")}
    for rule in group["rules"]:
        named = re.findall(r"(gear_twin_\w+)(?:\{([^}]*)\})?", rule["expr"])
        assert named or "up{" in rule["expr"], rule["alert"]
        for metric, labels in named:
            assert metric in exported, metric
            assert set(re.findall(r"(\w+)=", labels)) <= {*exported[metric].labels, "le"}, rule["alert"]
        assert rule["annotations"]["summary"] and rule["annotations"]["action"] and rule["labels"]["severity"]
        assert re.fullmatch(r"\d+[smhd]", rule.get("for", "0s"))
    config = yaml.safe_load((ROOT / "docker/prometheus.yml").read_text(encoding="utf-8"))
    compose = yaml.safe_load((ROOT / "docker/compose.yml").read_text(encoding="utf-8"))
    mounted = [mount.split(":")[:2] for mount in compose["services"]["prometheus"]["volumes"]]
    assert [f"./{RULES.relative_to(ROOT / 'docker')}", *config["rule_files"]] in mounted
