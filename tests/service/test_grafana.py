"""The Grafana dashboard asks only for metrics that the service exports, and its provisioning fits together."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import service_fakes as fakes
import yaml
from test_health import MACHINES, get, report_of

from service.operation.metric_catalogue import METRICS, OF_ASSETS

ROOT = Path(__file__).parents[2]
DASHBOARD = json.loads((ROOT / "docker/grafana/dashboards/gear-twin.json").read_text(encoding="utf-8"))
COMPOSE = yaml.safe_load((ROOT / "docker/compose.yml").read_text(encoding="utf-8"))
EXPRESSIONS = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]
EXPRESSIONS += [variable["definition"] for variable in DASHBOARD["templating"]["list"]]
OF_THE_PROCESS = {e.shown: set(e.labels) for e in METRICS.values() if e not in OF_ASSETS}  # of a running service


@pytest.fixture
def exported(store, board):
    """The labels of every metric that is exported."""
    fakes.campaign(store, board)
    for index, (name, (found, _)) in enumerate(MACHINES.items()):
        fakes.take(store, board, name, index, 100.0, report=report_of(found), faults=(fakes.FAULT,))
    found: dict[str, set[str]] = dict(OF_THE_PROCESS)
    for line in get(board, store, "/metrics").text.splitlines():
        match = re.fullmatch(r"(\w+)(?:\{(.*)\})? \S+", line)
        if match:
            found.setdefault(match[1], set()).update(re.findall(r"(\w+)=", match[2] or ""))
    return found


@pytest.mark.parametrize("expression", sorted(set(EXPRESSIONS)))
def test_every_metric_of_the_dashboard_is_exported_with_the_labels_asked_for(expression, exported):
    named = re.findall(r"(gear_twin_\w+)(?:\{([^}]*)\})?", expression)
    assert named
    for metric, labels in named:
        assert metric in exported, metric
        assert set(re.findall(r"(\w+)=", labels)) <= exported[metric]
    grouped = {label for part in re.findall(r"by \(([^)]*)\)", expression) for label in re.split(r",\s*", part)}
    assert all(grouped <= exported[metric] for metric, _ in named)


def test_levels_of_status_and_data_are_those_of_the_contract():
    from service.contract.findings import SEVERITY
    from service.contract.status import DATA_LEVELS

    text = " ".join(EXPRESSIONS)
    for metric, levels in (("gear_twin_status", SEVERITY), ("gear_twin_data", DATA_LEVELS)):
        asked = set(re.findall(metric + r'\{[^}]*level="(\w+)"', text))
        assert asked == set(levels)


def test_provisioned_files_are_where_the_compose_file_mounts_them_and_name_one_another():
    services = COMPOSE["services"]
    for name in ("prometheus", "grafana"):
        assert services[name]["profiles"] == ["monitoring"]
        for mount in services[name]["volumes"]:
            source = mount.partition(":")[0]
            assert source in COMPOSE["volumes"] or (ROOT / "docker" / source).exists(), mount
    provisioning = ROOT / "docker/grafana/provisioning"
    (data,) = yaml.safe_load((provisioning / "datasources/prometheus.yml").read_text())["datasources"]
    uids = {panel["datasource"]["uid"] for panel in DASHBOARD["panels"]}
    assert uids == {data["uid"]} and data["url"].startswith("http://prometheus:")
    (provider,) = yaml.safe_load((provisioning / "dashboards/gear-twin.yml").read_text())["providers"]
    assert any(provider["options"]["path"] in mount for mount in services["grafana"]["volumes"])
    (job,) = yaml.safe_load((ROOT / "docker/prometheus.yml").read_text())["scrape_configs"]
    assert job["static_configs"][0]["targets"] == ["gear-twin:8000"]
    assert all(panel["description"] for panel in DASHBOARD["panels"])
