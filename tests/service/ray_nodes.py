"""Nodes of a cluster of Ray on this machine, as `ray start` of several machines: each can be added and killed."""

from __future__ import annotations

import json
import os
import secrets
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil
from service_streams import ROOT, free_port, wait_until

HERE = Path(__file__).parent
STARTED_WITHIN = 120.0  # [s]
HEALTH = {  # a node that is gone is known after 5 s, as in docker/compose.fleet.yml, and a head after 10 s
    "RAY_gcs_rpc_server_reconnect_timeout_s": "10",
    "RAY_health_check_initial_delay_ms": "5000", "RAY_health_check_period_ms": "1000",
    "RAY_health_check_timeout_ms": "3000", "RAY_health_check_failure_threshold": "5",
}  # fmt: skip


class RayNodes:
    """A head that is no host, and nodes by name; `environment` is what joins them."""

    def __init__(self, folder: Path, cores: int = 1) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.cores = folder, cores
        self.port = free_port()
        self.address = f"127.0.0.1:{self.port}"
        self.environment = HEALTH | {
            "RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32), "RAY_USAGE_STATS_ENABLED": "0",
            "PYTHONPATH": f"{ROOT}{os.pathsep}{HERE}",
        }  # fmt: skip
        self._temporary = TemporaryDirectory(prefix="gt-", ignore_cleanup_errors=True)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> RayNodes:
        self.start_head()
        return self

    def __exit__(self, *_: object) -> None:
        for name in list(self.processes):
            self.kill(name)
        self._temporary.cleanup()

    def start_head(self) -> None:
        """Starts the head, anew where it was killed."""
        given = ["--head", f"--port={self.port}", "--include-dashboard=false", f"--temp-dir={self._temporary.name}"]
        self._start("head", given, hosts=0, cores=0)

    def add(self, name: str) -> None:
        """Starts a node."""
        self._start(name, [f"--address={self.address}"], 1, self.cores)

    def stop(self, name: str) -> None:
        """Ends a node in good order, as where its machine is shut down."""
        self.processes[name].terminate()
        self.processes[name].wait(STARTED_WITHIN)
        self.kill(name)

    def kill(self, name: str) -> None:
        """Kills a node with all that runs on it, as where a machine's power goes."""
        process = self.processes.pop(name)
        with suppress(psutil.Error):
            top = psutil.Process(process.pid)
            all_of_it = [top, *top.children(recursive=True)]
            for each in all_of_it:
                with suppress(psutil.Error):
                    each.kill()
            psutil.wait_procs(all_of_it[1:], STARTED_WITHIN)
        process.wait()

    def _start(self, name: str, given: list[str], hosts: int, cores: int) -> None:
        said = self.folder / f"ray-{name}.log"
        command = [
            sys.executable, "-m", "ray.scripts.scripts", "start", *given, "--block", "--node-ip-address=127.0.0.1",
            f"--node-name={name}", f"--num-cpus={cores}",
            f"--resources={json.dumps({'host': hosts} if hosts else {})}",
            "--object-store-memory=83886080", "--include-log-monitor=false", "--disable-usage-stats",
        ]  # fmt: skip
        with said.open("wb") as out:
            process = self.processes[name] = subprocess.Popen(
                command, stdout=out, stderr=out, start_new_session=True, env=os.environ | self.environment
            )
        wait_until(lambda: process.poll() is not None or b"Ray runtime started" in said.read_bytes(), STARTED_WITHIN)
        assert process.poll() is None, said.read_text()
