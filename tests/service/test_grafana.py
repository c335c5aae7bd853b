"""The Grafana dashboard and the alert rules ask only for metrics that the service exports, the dashboard shows all of
them, and the provisioning fits together. What Prometheus itself says of them: test_prometheus.py.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

from service.operation.metric_catalogue import METRICS

ROOT = Path(__file__).parents[2]
DASHBOARD = json.loads((ROOT / "docker/grafana/dashboards/gear-twin.json").read_text(encoding="utf-8"))
COMPOSE = yaml.safe_load((ROOT / "docker/compose.yml").read_text(encoding="utf-8"))
RULES = yaml.safe_load((ROOT / "docker/prometheus/rules.yml").read_text(encoding="utf-8"))
PANELS = [panel for panel in DASHBOARD["panels"] if panel["type"] != "row"]
EXPRESSIONS = [target["expr"] for panel in PANELS for target in panel["targets"]]
EXPRESSIONS += [variable["definition"] for variable in DASHBOARD["templating"]["list"]]
ALERTS = [rule["expr"] for group in RULES["groups"] for rule in group["rules"]]
OF_PROMETHEUS = ["up"]  # series of its own


def asked_for(entry):
    """The name by which a query asks for a metric."""
    return f"{entry.shown}_bucket" if entry.type == "histogram" else entry.shown


LABELS = {asked_for(e): {*e.labels, *(["le"] if e.type == "histogram" else [])} for e in METRICS.values()}


@pytest.mark.parametrize("expression", sorted({*EXPRESSIONS, *ALERTS}))
def test_every_metric_of_dashboard_and_alerts_is_in_the_catalogue_with_the_labels_asked_for(expression):
    named = re.findall(r"(gear_twin_\w+)(?:\{([^}]*)\})?", expression)
    assert named or expression.partition("{")[0] in OF_PROMETHEUS
    for metric, labels in named:
        assert metric in LABELS, metric
        assert set(re.findall(r"(\w+)=", labels)) <= LABELS[metric]
    grouped = {label for part in re.findall(r"by \(([^)]*)\)", expression) for label in re.split(r",\s*", part)}
    assert all(grouped <= LABELS[metric] for metric, _ in named)


def test_panels_have_numbers_and_places_of_their_own():
    assert len({panel["id"] for panel in DASHBOARD["panels"]}) == len(DASHBOARD["panels"])
    taken = set()
    for panel in DASHBOARD["panels"]:
        at = panel["gridPos"]
        cells = {(x, y) for x in range(at["x"], at["x"] + at["w"]) for y in range(at["y"], at["y"] + at["h"])}
        assert at["x"] + at["w"] <= 24 and not cells & taken, panel["title"]
        taken |= cells
    for panel in PANELS:
        names = [target["refId"] for target in panel["targets"]]
        assert len(set(names)) == len(names) and all(t["legendFormat"] for t in panel["targets"]), panel["title"]


def test_levels_of_status_and_data_are_those_of_the_contract():
    from service.contract.finding import SEVERITY
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
    sources = [panel["datasource"] for panel in PANELS] + [
        t["datasource"] for panel in PANELS for t in panel["targets"]
    ]
    uids = {source["uid"] for source in (*sources, *(v["datasource"] for v in DASHBOARD["templating"]["list"]))}
    assert {source["type"] for source in sources} == {data["type"]}
    assert uids == {data["uid"]} and data["url"].startswith("http://prometheus:")
    (provider,) = yaml.safe_load((provisioning / "dashboards/gear-twin.yml").read_text())["providers"]
    assert any(provider["options"]["path"] in mount for mount in services["grafana"]["volumes"])
    (job,) = yaml.safe_load((ROOT / "docker/prometheus.yml").read_text())["scrape_configs"]
    assert job["static_configs"][0]["targets"] == ["gear-twin:8000"]
    assert all(panel["description"] for panel in PANELS)
