"""A service in a process of its own, and what it costs: processor time, memory, time of answers and of a restart."""

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

import numpy as np
import psutil

STAND_IN = ("benchmarks.long_run.stand_in",)
ASKED = 40  # requests of each route
LONGEST = 1200.0  # that anything is waited for [s]
ROUTES = (
    "/healthz",
    "/readyz",
    "/metrics",
    "/v1/assets",
    "/v1/assets/{asset}",
    "/v1/assets/{asset}/wear",
    "/v1/assets/{asset}/windows?resolution=100",
    "/v1/assets/{asset}/windows?resolution=1000",
    "/v1/assets/{asset}/windows?limit=100",
    "/v1/assets/{asset}/epochs",
    "/v1/assets/{asset}/alarms?state=all",
    "/v1/assets/{asset}/trend?resolution=100",
    "/v1/assets/{asset}/quality",
)


@dataclass(slots=True)
class Service:
    """A running service."""

    process: subprocess.Popen[str]
    address: str
    endpoint: str
    start_wall: float  # from the start of the process until it was ready [s]
    start_cpu: float  # [s]
    log: list[str] = field(default_factory=list)

    def get(self, path: str) -> Any:
        """The JSON of a route."""
        with urllib.request.urlopen(self.address + path, timeout=LONGEST) as answer:
            return json.loads(answer.read())

    def cpu(self) -> float:
        """Processor time of the service and of its workers so far [s]."""
        return sum(sum(p.cpu_times()[:2]) for p in self._processes())

    def memory(self) -> float:
        """Resident memory of the service and of its workers [MB]."""
        return sum(p.memory_info().rss for p in self._processes()) / 1e6

    def latencies(self, asset: str) -> dict[str, tuple[float, float, int]]:
        """By route: median and 99th percentile of the time of an answer [ms], and its size [bytes]."""
        out = {}
        for route in ROUTES:
            times, size = [], 0
            for _ in range(ASKED):
                begun = time.perf_counter()
                with urllib.request.urlopen(self.address + route.format(asset=asset), timeout=LONGEST) as answer:
                    size = len(answer.read())
                times.append(1e3 * (time.perf_counter() - begun))
            out[route] = (float(np.median(times)), float(np.percentile(times, 99)), size)
        return out

    def _processes(self) -> list[psutil.Process]:
        own = psutil.Process(self.process.pid)
        return [own, *own.children(recursive=True)]


@contextmanager
def serving(data: Path, port: int, *, program: Sequence[str] = STAND_IN, **settings: object) -> Iterator[Service]:
    """A service on loopback, with the stand-in twin unless another program is named, ended by SIGTERM."""
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
    service = Service(process, f"http://127.0.0.1:{port + 1}", endpoint, 0.0, 0.0)
    threading.Thread(target=_drain, args=(service,), daemon=True).start()
    try:
        _await_ready(service)
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


def _await_ready(service: Service) -> None:
    deadline = time.monotonic() + LONGEST
    while time.monotonic() < deadline:
        if service.process.poll() is not None:
            raise RuntimeError(f"the service ended with {service.process.returncode}: {''.join(service.log)}")
        try:
            service.get("/readyz")
            return
        except OSError:
            time.sleep(0.02)
    raise RuntimeError("the service did not become ready")
