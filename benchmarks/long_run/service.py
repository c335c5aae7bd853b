"""A service in a process of its own, and what it costs: processor time, memory, time of answers and of a start."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

STAND_IN = ("benchmarks.long_run.stand_in",)
PROGRAM = ("service", "serve")  # the service as it is installed
LONGEST = 1200.0  # that anything is waited for [s]
LOOK = 0.05  # between two looks whether a service is ready [s]: each costs it some processor time
EVENTS = 100  # that are read of a stream of events
ROUTES = (
    "/healthz",
    "/readyz",
    "/metrics",
    "/v1/assets",
    "/v1/alarms",
    "/v1/audit",
    "/v1/assets/{asset}",
    "/v1/assets/{asset}/wear",
    "/v1/assets/{asset}/quality",
    "/v1/assets/{asset}/windows?resolution=100",
    "/v1/assets/{asset}/windows?resolution=1000",
    "/v1/assets/{asset}/windows?limit=100",
    "/v1/assets/{asset}/windows?limit=100&after={middle}",
    "/v1/assets/{asset}/trend?resolution=100",
    "/v1/assets/{asset}/trend?limit=100&after={middle}",
    "/v1/assets/{asset}/epochs",
    "/v1/assets/{asset}/events?after=0",
    "/v1/assets/{asset}/alarms?state=all",
    "/v1/assets/{asset}/inspections",
    "/v1/assets/{asset}/decisions",
    "/v1/assets/{asset}/changes",
    "/v1/assets/{asset}/report",
)


@dataclass(slots=True)
class Service:
    """A running service."""

    process: subprocess.Popen[str]
    address: str
    endpoint: str
    start_wall: float = 0.0  # from the start of the process until it was ready and listed all assets [s]
    start_cpu: float = 0.0  # [s]
    log: list[str] = field(default_factory=list)

    def get(self, path: str) -> Any:
        """The JSON of a route."""
        with urllib.request.urlopen(self.address + path, timeout=LONGEST) as answer:
            return json.loads(answer.read())

    def windows(self) -> dict[str, int]:
        """How many windows of each asset have been processed."""
        return {row["asset"]: row["windows"] for row in self.get("/v1/assets")}

    def cpu(self) -> float:
        """Processor time of the service and of its workers so far [s]."""
        return sum(sum(p.cpu_times()[:2]) for p in self._processes())

    def memory(self) -> float:
        """Resident memory of the service and of its workers [MB]."""
        return sum(p.memory_info().rss for p in self._processes()) / 1e6

    def asked(self, route: str) -> tuple[float, int]:
        """Time of an answer [ms] and its size [bytes]; of a stream of events, until some have come."""
        begun, size = time.perf_counter(), 0
        with urllib.request.urlopen(self.address + route, timeout=LONGEST) as answer:
            if "/events" in route:
                found = 0
                while found < EVENTS:
                    found += answer.readline().startswith(b"id:")
            else:
                size = len(answer.read())
        return 1e3 * (time.perf_counter() - begun), size

    def _processes(self) -> list[psutil.Process]:
        own = psutil.Process(self.process.pid)
        return [own, *own.children(recursive=True)]


@contextmanager
def serving(
    data: Path, port: int, *, assets: int = 0, program: Sequence[str] = STAND_IN, **settings: object
) -> Iterator[Service]:
    """A service on loopback, with the stand-in twin unless another program is named, ended by SIGTERM.

    assets  how many it lists once it can answer about all
    """
    endpoint = f"tcp/127.0.0.1:{port}"
    given = {"data": data, "listen": json.dumps([endpoint]), "http": f"127.0.0.1:{port + 1}", **settings}
    env = {**os.environ, **{f"GEAR_TWIN_{name.upper()}": str(value) for name, value in given.items()}}
    begun = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", *program],
        env=env,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    service = Service(process, f"http://127.0.0.1:{port + 1}", endpoint)
    threading.Thread(target=_drain, args=(service,), daemon=True).start()
    try:
        _await_ready(service, assets)
        service.start_wall = time.perf_counter() - begun
        service.start_cpu = service.cpu()
        yield service
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()
            raise


def _drain(service: Service) -> None:
    assert service.process.stderr is not None
    for line in service.process.stderr:
        service.log = [*service.log[-200:], line]


def _await_ready(service: Service, assets: int) -> None:
    deadline = time.monotonic() + LONGEST
    while time.monotonic() < deadline:
        if service.process.poll() is not None:
            raise RuntimeError(f"the service ended with {service.process.returncode}: {''.join(service.log)}")
        try:
            service.get("/readyz")
            if len(service.get("/v1/assets")) >= assets:
                return
        except OSError:
            pass
        time.sleep(LOOK)
    raise RuntimeError("the service did not become ready")
