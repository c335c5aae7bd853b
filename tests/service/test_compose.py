"""The image and the compose file, brought up by a container engine: replay, kill, answers read in another container.

Needs an engine and the images, so it runs only where the command is named:
    docker compose -f docker/compose.yml build
    GEAR_TWIN_POSTGRES_PASSWORD=- docker compose -f docker/compose.fleet.yml build
    GEAR_TWIN_TEST_COMPOSE='docker compose' .venv/bin/python -m pytest -m slow tests/service/test_compose.py
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import time
import urllib.request
from pathlib import Path

import pytest
from service_streams import free_port

from service.fleet.layout import Layout, partition_of

ROOT = Path(__file__).parents[2]
COMPOSE = shlex.split(os.environ.get("GEAR_TWIN_TEST_COMPOSE", ""))
PROJECT = "gear-twin-test"
READY, REPLAYED = 60.0, 300.0  # [s]
STARTED, RECOVERED = 240.0, 120.0  # a fleet, and its partitions after a host was lost [s]
ASK = """
import sys, urllib.request
for path in sys.argv[2:]:
    print(urllib.request.urlopen(f"http://{sys.argv[1]}:8000{path}", timeout=10).read().decode())
"""

ASSET = "unsw-short"  # of the bundled recording
WINDOWS = 8  # in it
OTHER = "gb-14"  # in the same partition
PARTITIONS = 8  # of docker/compose.fleet.yml

pytestmark = [
    pytest.mark.slow,
    pytest.mark.containers,
    pytest.mark.skipif(not COMPOSE, reason="GEAR_TWIN_TEST_COMPOSE does not name a command such as 'docker compose'"),
]


class Stack:
    """The services of the compose file, under a name and ports of their own."""

    file, serves, image = "compose.yml", "gear-twin", "gear-twin"

    def __init__(self, *profiles: str, **environment: str) -> None:
        self.engine = "podman" if "podman" in COMPOSE[0] else "docker"
        self.port = free_port()
        self.environment = os.environ | environment | {
            "GEAR_TWIN_HTTP_PORT": str(self.port), "GEAR_TWIN_ZENOH_PORT": str(free_port()), "GEAR_TWIN_SPEED": "0",
        }  # fmt: skip
        self.command = [*COMPOSE, "-f", str(ROOT / "docker" / self.file), "-p", PROJECT]
        self.profiles = [word for profile in profiles for word in ("--profile", profile)]

    def __enter__(self) -> Stack:
        self.down()
        self.up()
        return self

    def __exit__(self, *_: object) -> None:
        self.down()

    def compose(self, *arguments: str, check: bool = True) -> str:
        return self._run([*self.command, *self.profiles, *arguments], check=check)

    def call(self, *arguments: str, check: bool = True) -> str:
        return self._run([self.engine, *arguments], check=check)

    def _run(self, command: list[str], *, check: bool) -> str:
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=300, check=False)
        assert not check or done.returncode == 0, f"{shlex.join(command)}: {done.stderr[-2000:]}"
        return done.stdout

    def up(self, *services: str) -> None:
        self.compose("up", "-d", "--no-build", *services)

    def down(self) -> None:
        self.compose("down", "-v", check=False)

    def container(self, service: str) -> str:
        """The name of a service's container."""
        (name,) = self.containers(service)
        return name

    def containers(self, service: str) -> list[str]:
        """The names of a service's containers."""
        labels = [f"--filter=label=com.docker.compose.{key}={value}" for key, value in
                  (("project", PROJECT), ("service", service))]  # fmt: skip
        return self.call("ps", "--all", *labels, "--format", "{{.Names}}").split()

    def ready(self) -> dict:
        """What the service's readiness says, as soon as it is ready."""
        until = time.monotonic() + READY
        while True:
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/readyz", timeout=5) as answer:
                    return json.load(answer)
            except OSError as error:
                assert time.monotonic() < until, f"not ready: {error}; {self.logs(self.serves)}"
                time.sleep(0.3)

    def logs(self, service: str) -> str:
        done = subprocess.run(
            [self.engine, "logs", self.container(service)], capture_output=True, text=True, check=True
        )
        return (done.stdout + done.stderr)[-3000:]

    def ended(self, service: str) -> int:
        """The exit status of a service that ends by itself."""
        until = time.monotonic() + REPLAYED
        while True:
            running, status = json.loads(self.call(
                "inspect", "--format", "[{{.State.Running}}, {{.State.ExitCode}}]", self.container(service)
            ))  # fmt: skip
            if not running:
                return status
            assert time.monotonic() < until, self.logs(service)
            time.sleep(0.5)

    def ask(self, *paths: str) -> list:
        """What the service answers to another container of its network."""
        said = self.call(
            "run", "--rm", "--network", f"{PROJECT}_default", "--entrypoint", "python3", self.image, "-c", ASK,
            self.serves, *paths,
        )  # fmt: skip
        return [json.loads(line) for line in said.splitlines()]

    def answers(self) -> dict[str, list]:
        """All that is known of every machine, read from another container."""
        (listed,) = self.ask("/v1/assets")
        names = [each["asset"] for each in listed]
        parts = ("wear", "rul", "windows?limit=1000", "effects")
        return {name: self.ask(*(f"/v1/assets/{name}/{part}" for part in parts)) for name in names}


def keys_of(partition: int) -> str:
    """The first part of the keys of a partition of the containers' fleet."""
    return Layout(PARTITIONS).prefix_of(partition)


class FleetStack(Stack):
    """The services of a fleet's compose file."""

    file, serves, image = "compose.fleet.yml", "front", "gear-twin-fleet"

    def __init__(self, *profiles: str, **environment: str) -> None:
        super().__init__(*profiles, GEAR_TWIN_POSTGRES_PASSWORD="only-for-this-test", **environment)

    def served(self, seconds: float) -> None:
        """Waits until all partitions are served."""
        until = time.monotonic() + seconds
        while any(self.unserved()) or not self.started():
            assert time.monotonic() < until, self.logs("front")
            time.sleep(1)

    def started(self) -> bool:
        return all(row["served"] for row in self.partitions())

    def unserved(self) -> list[int]:
        return self.ready()["unserved_partitions"]

    def partitions(self) -> list[dict]:
        """What `fleet status` says of each partition."""
        said = self.call(
            "exec", self.container("front"), "gear-twin", "fleet", "status", "--json", "-", check=False
        )  # fmt: skip
        return json.loads(said)["partitions"] if said.strip() else [{"served": False}]

    def replay_as(self, asset: str, partition: int) -> None:
        """The bundled recording is published as that of another machine."""
        recording = ROOT / "recordings" / "short-campaign.mcap"
        self.call(
            "run", "--rm", "--network", f"{PROJECT}_default", "-v", f"{recording}:/recording.mcap:ro", self.image,
            "replay", "/recording.mcap", "--connect", "tcp/router:7447", "--prefix", keys_of(partition),
            "--recorded", "gearbox", "--asset", asset, "--speed", "0",
        )  # fmt: skip

    def assessed(self, asset: str) -> dict[str, list]:
        """The answers as soon as all windows of the recording have been assessed."""
        until = time.monotonic() + REPLAYED
        while {each["asset"]: each["windows"] for each in self.ask("/v1/assets")[0]}.get(asset) != WINDOWS:
            assert time.monotonic() < until, self.logs("front")
            time.sleep(2)
        return settled(self)

    def host_of(self, partition: int) -> str:
        """The container that serves a partition."""
        host = self.partitions()[partition]["worker"].partition(":")[0]
        return next(name for name in self.containers("host") if host == self.call(
            "inspect", "--format", "{{.Config.Hostname}}", name).strip())  # fmt: skip


def settled(stack: Stack) -> dict[str, list]:
    """The answers when nothing waits to be processed any more."""
    before: dict[str, list] = {}
    until = time.monotonic() + REPLAYED
    while time.monotonic() < until:
        answers = stack.answers()
        if answers and answers == before:
            return answers
        before = answers
        time.sleep(3)
    raise AssertionError("the answers did not come to rest")


def test_a_recording_is_replayed_and_the_answers_outlive_a_kill():
    with Stack("replay") as stack:
        assert stack.ready()["status"] == "ready"
        assert stack.ended("replay") == 0, stack.logs("replay")
        before = settled(stack)
        assert before, stack.logs("gear-twin")
        stack.call("kill", "--signal", "KILL", stack.container("gear-twin"))
        stack.up("gear-twin")
        stack.ready()
        assert settled(stack) == before
        name = stack.container("gear-twin")
        begun = time.monotonic()
        stack.call("stop", "--time", "15", name)
        assert time.monotonic() - begun < 12
        assert json.loads(stack.call("inspect", "--format", "{{.State.ExitCode}}", name)) == 0


def test_postgresql_in_place_of_sqlite_gives_the_same_answers_after_a_kill():
    password = "only-for-this-test"
    url = f"postgresql://gear-twin:{password}@postgres/gear-twin"
    with Stack("postgresql", "replay", GEAR_TWIN_POSTGRES_PASSWORD=password, GEAR_TWIN_DATABASE=url) as stack:
        stack.ready()
        assert stack.ended("replay") == 0, stack.logs("replay")
        before = settled(stack)
        assert before, stack.logs("gear-twin")
        for service in ("postgres", "gear-twin"):
            stack.call("kill", "--signal", "KILL", stack.container(service))
        stack.up("postgres", "gear-twin")
        stack.ready()
        assert settled(stack) == before


def test_frames_come_through_a_router_of_its_own():
    with Stack("router", GEAR_TWIN_CONNECT='["tcp/router:7447"]') as stack:
        stack.ready()
        recording = ROOT / "recordings" / "short-campaign.mcap"
        stack.call(
            "run", "--rm", "--network", f"{PROJECT}_default", "-v", f"{recording}:/recording.mcap:ro", "gear-twin",
            "replay", "/recording.mcap", "--connect", "tcp/router:7447", "--speed", "0",
        )  # fmt: skip
        assert settled(stack)


def test_prometheus_scrapes_the_service():
    with Stack("monitoring") as stack:
        stack.ready()
        ask = "import sys, urllib.request; print(urllib.request.urlopen(sys.argv[1], timeout=10).read().decode())"
        until = time.monotonic() + READY
        while True:
            said = stack.call(
                "run", "--rm", "--network", f"{PROJECT}_default", "--entrypoint", "python3", "gear-twin", "-c", ask,
                "http://prometheus:9090/api/v1/query?query=up", check=False,
            )  # fmt: skip
            if said and any(each["value"][1] == "1" for each in json.loads(said)["data"]["result"]):
                break
            assert time.monotonic() < until, said
            time.sleep(2)


def test_a_fleet_goes_on_when_a_host_is_killed_and_keeps_all_windows():
    partition = partition_of(ASSET, PARTITIONS)
    assert partition == partition_of(OTHER, PARTITIONS)
    text = (ROOT / "docker" / FleetStack.file).read_text(encoding="utf-8")
    assert f"GEAR_TWIN_KEY:-{keys_of(partition)}}}" in text
    with FleetStack() as stack:
        stack.served(STARTED)
        assert len(stack.containers("host")) == 2
        stack.compose("--profile", "replay", "up", "-d", "--no-build", "replay")
        assert stack.ended("replay") == 0, stack.logs("replay")
        before = stack.assessed(ASSET)
        victim = stack.host_of(partition)
        stack.call("kill", "--signal", "KILL", victim)
        begun = time.monotonic()
        while partition not in stack.unserved():
            assert time.monotonic() - begun < RECOVERED
            time.sleep(0.5)
        stack.served(RECOVERED)
        print(f"served again {time.monotonic() - begun:.0f} s after a host was killed")
        assert stack.host_of(partition) != victim
        assert stack.answers() == before
        stack.replay_as(OTHER, partition)
        after = stack.assessed(OTHER)
        assert after[ASSET] == before[ASSET] and len(after[OTHER][2]) == len(before[ASSET][2])
        stack.compose("up", "-d", "--no-build", "--no-recreate", "host")  # the one that was killed is there again ...
        until = time.monotonic() + RECOVERED
        while len({row["node"] for row in stack.partitions()}) < 2:  # ... and has its share of the partitions
            assert time.monotonic() < until, stack.logs("front")
            time.sleep(2)
        stack.served(RECOVERED)
