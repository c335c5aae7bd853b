"""A service process fed over Zenoh TCP answers what `assess` answers on the file, to the last digits."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest
from service_streams import free_port

from service.runtime.replay import replay
from tests.streams import shuffled, twice

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "recordings" / "short-campaign.mcap"
COMMAND = [sys.executable, "-m", "service"]
TOLERANCE = 1e-9
PATIENCE = 180.0  # for the twin to take the whole campaign [s]


def fetch(address: str):
    with urllib.request.urlopen(address, timeout=10.0) as response:
        return json.load(response)


@contextmanager
def service(data: Path, **settings: str):
    """A service process with settings by their names: its Zenoh endpoint, its address and the process."""
    endpoint, http = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    arguments = ["serve", "--listen", endpoint, "--http", http, "--data", str(data)]
    environment = os.environ | {f"GEAR_TWIN_{name.upper()}": value for name, value in settings.items()}
    process = subprocess.Popen(
        [*COMMAND, *arguments], cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        deadline = time.monotonic() + 60.0
        while True:
            assert process.poll() is None and time.monotonic() < deadline, "the service did not start"
            try:
                urllib.request.urlopen(f"http://{http}/readyz", timeout=1.0).close()
                break
            except (urllib.error.URLError, TimeoutError, ConnectionError):
                time.sleep(0.1)
        yield endpoint, f"http://{http}", process
    finally:
        process.terminate()
        process.wait(20.0)


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    """What `gear-twin assess` answers on the file."""
    out = tmp_path_factory.mktemp("assess") / "answer.json"
    subprocess.run(
        [*COMMAND, "assess", str(RECORDING), "--json", str(out)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL
    )
    return json.loads(out.read_text())


def answer_of(address: str, asset: str, windows: int, patience: float = PATIENCE):
    """The service's answer once it has so many windows."""
    deadline = time.monotonic() + patience
    while True:
        try:
            found = fetch(f"{address}/v1/assets/{asset}")
        except urllib.error.HTTPError as error:
            error.close()
            found = {"windows": []}
        if len(found["windows"]) >= windows:
            return found
        assert time.monotonic() < deadline, f"{len(found['windows'])} of {windows} windows after {patience} s"
        time.sleep(0.2)


def differences(a, b, path=""):
    """Where two answers differ by more than the tolerance."""
    if isinstance(a, dict) and isinstance(b, dict):
        keys = sorted(set(a) | set(b))
        return [d for k in keys for d in differences(a.get(k), b.get(k), f"{path}/{k}")]
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        return [d for i, (x, y) in enumerate(zip(a, b, strict=True)) for d in differences(x, y, f"{path}/{i}")]
    numbers = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in (a, b))
    same = math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=1e-12) if numbers else a == b
    return [] if same else [f"{path}: {a!r} against {b!r}"]


def assert_same(found, answer):
    for part in ("windows", "wear", "rul", "residual", "effects", "unexplained"):
        assert differences(answer[part], found[part], part) == []


@pytest.mark.slow
def test_the_replay_command_gives_the_answer_of_the_file(answer, tmp_path):
    with service(tmp_path) as (endpoint, address, _):
        done = subprocess.run([*COMMAND, "replay", str(RECORDING), "--connect", endpoint, "--speed", "0"], cwd=ROOT)
        assert done.returncode == 0
        assert_same(answer_of(address, answer["asset"], len(answer["windows"])), answer)
        with urllib.request.urlopen(f"{address}/metrics") as said:  # the twin says when it traces
            count, seconds = re.findall(rb"^gear_twin_trace_seconds_(?:count|sum) (\S+)$", said.read(), re.MULTILINE)
        assert float(count) >= 1 and float(seconds) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("speed", "disturb"),
    [
        (1.0, lambda frames: frames),
        (50.0, lambda frames: frames),
        (0.0, lambda frames: shuffled(twice(frames), 200, seed=2)),
    ],
    ids=["1 times as fast, pauses shortened", "50 times as fast", "as fast as taken, twice and shuffled"],
)
def test_any_delivery_gives_the_answer_of_the_file(answer, tmp_path, speed, disturb):
    with service(tmp_path) as (endpoint, address, _):
        replay(RECORDING, [endpoint], speed, max_pause=2.0 if speed == 1.0 else math.inf, disturb=disturb)
        assert_same(answer_of(address, answer["asset"], len(answer["windows"])), answer)


@pytest.mark.slow
def test_a_service_killed_in_mid_campaign_loses_and_doubles_nothing(answer, tmp_path):
    with service(tmp_path) as (endpoint, address, process):
        replay(RECORDING, [endpoint], 0.0)
        acknowledged = answer_of(address, answer["asset"], 3)["windows"]
        process.kill()
    with service(tmp_path) as (endpoint, address, _):
        kept = answer_of(address, answer["asset"], len(acknowledged))["windows"]
        assert differences(acknowledged, kept[: len(acknowledged)]) == []
        replay(RECORDING, [endpoint], 0.0)
        assert_same(answer_of(address, answer["asset"], len(answer["windows"])), answer)
