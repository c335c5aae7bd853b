"""What a real Prometheus says: the files of `docker/` are valid, and it answers every query of dashboard and alerts
from a running service.

Needs its programs, so it runs only where their folder is named:
    GEAR_TWIN_TEST_PROMETHEUS=/usr/bin .venv/bin/python -m pytest -m slow tests/service/test_prometheus.py
"""

from __future__ import annotations

import json
import os
import subprocess
import time
import urllib.error
import urllib.parse
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
from service_streams import free_port, service, wait_until, write_recording
from test_grafana import ALERTS, EXPRESSIONS, METRICS, ROOT

from service.operation.metric_catalogue import RAW
from service.runtime.replay import replay

FOLDER = Path(os.environ.get("GEAR_TWIN_TEST_PROMETHEUS", ""))
RULES = ROOT / "docker/prometheus/rules.yml"
GRAFANA = {"$asset": ".*"}  # what Grafana puts in the place of its variables
SCRAPES = 1  # [s]
DID_NOT_OCCUR = (
    "frame_faults_total",
    "held_windows",
    "decisions_total",
    "data_faults_total",
    "http_refused_total",
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.prometheus,
    pytest.mark.skipif(not (FOLDER / "promtool").is_file(), reason="GEAR_TWIN_TEST_PROMETHEUS names no folder of it"),
]


def query_of(expression: str) -> str:
    for name, value in GRAFANA.items():
        expression = expression.replace(name, value)
    return expression


def conditional(expression: str) -> bool:
    """Whether a query asks for a metric that is not always exported, or that has no series before something occurs."""
    sometimes = {entry.shown for entry in METRICS.values() if entry.only not in ("", RAW)}
    sometimes |= {f"gear_twin_{name}" for name in DID_NOT_OCCUR}
    return any(name in expression for name in sometimes)


def test_promtool_accepts_configuration_and_rules(tmp_path):
    config = yaml.safe_load((ROOT / "docker/prometheus.yml").read_text(encoding="utf-8"))
    config["rule_files"] = [str(RULES)]
    given = tmp_path / "prometheus.yml"
    given.write_text(yaml.safe_dump(config), encoding="utf-8")
    for command in (["rules", "--lint-fatal", str(RULES)], ["config", str(given)]):
        done = subprocess.run([FOLDER / "promtool", "check", *command], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr + done.stdout


@contextmanager
def prometheus(folder: Path, target: str):
    """Prometheus with the rules of `docker/`, that reads one service; its address."""
    config = yaml.safe_load((ROOT / "docker/prometheus.yml").read_text(encoding="utf-8"))
    config["global"]["scrape_interval"] = f"{SCRAPES}s"
    config["rule_files"] = [str(RULES)]
    config["scrape_configs"][0]["static_configs"][0]["targets"] = [target]
    (folder / "prometheus.yml").write_text(yaml.safe_dump(config), encoding="utf-8")
    address = f"127.0.0.1:{free_port()}"
    words = [f"--config.file={folder}/prometheus.yml", f"--storage.tsdb.path={folder}/tsdb"]
    with (folder / "prometheus.log").open("wb") as log:
        process = subprocess.Popen(
            [FOLDER / "prometheus", *words, f"--web.listen-address={address}"], stdout=log, stderr=log
        )
        try:
            yield address
        finally:
            process.terminate()
            process.wait(20)


def asked(address: str, path: str, **query: str) -> dict:
    url = f"http://{address}/api/v1/{path}?{urllib.parse.urlencode(query)}"
    deadline = time.monotonic() + 20
    while True:
        try:
            with urllib.request.urlopen(url, timeout=5) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            return json.load(error)
        except OSError:
            assert time.monotonic() < deadline
            time.sleep(0.2)


def test_every_query_is_answered_from_a_running_service(tmp_path):
    recording = write_recording(tmp_path / "short.mcap", 3)
    raw = {"RAW_FOLDER": str(tmp_path / "raw"), "RAW_SPARE_GB": "0"}
    with service(tmp_path / "data", **raw) as running, prometheus(tmp_path, running.http) as address:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(3)
        wait_until(lambda: asked(address, "query", query="gear_twin_windows_total > 0")["data"]["result"])
        time.sleep(3 * SCRAPES)  # rates need several scrapes
        empty = []
        for expression in sorted({*EXPRESSIONS, *ALERTS}):
            if "label_values" in expression:
                continue
            said = asked(address, "query", query=query_of(expression))
            assert said["status"] == "success", f"{expression}: {said}"
            if not said["data"]["result"] and expression not in ALERTS and not conditional(expression):
                empty.append(expression)
        assert not empty, empty
        (group,) = asked(address, "rules")["data"]["groups"]
        assert len(group["rules"]) == len(ALERTS) and not [r["name"] for r in group["rules"] if r.get("lastError")]
