"""Ray on this machine alone: its head and so many nodes, as processes that end with the one that started them.

A plant's own cluster is set up by its own means (`ray start`, the operator for Kubernetes); `gear-twin fleet up
--address` then only joins it, by a node without room for partitions where its machine has none.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path
from typing import IO

from service.errors import DeliveryError

log = logging.getLogger(__name__)

LOOPBACK = "127.0.0.1"
TOKEN = "ray.token"  # file in the fleet's folder
STARTED_WITHIN = 120.0  # a node of Ray [s]; half a minute where the machine is busy
ENDED_WITHIN = 10.0  # before a node is killed [s]
OBJECT_STORE = 80 * 2**20  # shared memory of a node [bytes]: nothing large travels through Ray
NODE = "service.fleet.loopback_node"
AGENT_PORTS = (
    "--dashboard-agent-grpc-port", "--dashboard-agent-listen-port", "--metrics-export-port", "--runtime-env-agent-port",
)  # fmt: skip
"""Of the programs that Ray starts on each node: see `loopback_node`."""
NO_MORE = ("--include-dashboard=false", "--no-monitor")
"""What a head need not start: nobody looks at Ray's own page, and it finds no machines by itself."""
ROOM = "partition"  # the resource of which a node has one for each partition that it may serve
QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_DEDUP_LOGS_SKIP_REGEX": ".",
    "RAY_raylet_start_wait_time_s": str(int(STARTED_WITHIN)),
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    "RAY_memory_monitor_refresh_ms": "1000",
    "RAY_health_check_initial_delay_ms": "5000",
    "RAY_health_check_period_ms": "1000",
    "RAY_health_check_timeout_ms": "3000",
    "RAY_health_check_failure_threshold": "5",
}
"""No report to Ray's makers, none of its own lines among those of `fleet up`, time enough for a start on a busy
machine, a look at a node's memory each second, and a node that is gone is known after 5 s.

A node that was only slow is replaced as well: its partitions are given to others, and it commits nothing more.
"""
LOOPBACK_ONLY = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}  # Ray keeps the loopback address then: `loopback_node`
AUTHENTICATION = {"RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"}  # who sets one of them has said it


def environment(folder: Path) -> dict[str, str]:
    """What Ray's programs are told of a cluster of this machine alone: who does not know its token is refused."""
    token = folder / TOKEN
    if not token.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(token, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(secrets.token_hex(32))
    return QUIET | LOOPBACK_ONLY | _known_by(token)


def environment_to_join(folder: Path) -> dict[str, str]:
    """What Ray's programs are told of a plant's cluster: nothing that its own environment says otherwise.

    The token is that of the environment, or of the fleet's folder where there is one.
    """
    token = folder / TOKEN
    known = _known_by(token) if token.exists() and not AUTHENTICATION & set(os.environ) else {}
    return {name: value for name, value in QUIET.items() if name not in os.environ} | known


def _known_by(token: Path) -> dict[str, str]:
    return {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN_PATH": str(token.resolve())}


@dataclass(slots=True, eq=False)
class Node:
    """One node of Ray on this machine."""

    name: str
    process: subprocess.Popen[bytes]
    output: IO[bytes]
    said: Path

    @property
    def group(self) -> int:
        """The number of its process group."""
        return self.process.pid

    @classmethod
    def started(
        cls,
        folder: Path,
        name: str,
        arguments: Sequence[str],
        given: Mapping[str, str],
        *,
        room: int = 0,
        cores: int = 0,
        program: str = "ray.scripts.scripts",
    ) -> Node:
        """Begins to start a node; what it says is written to the folder.

        given    its environment, in addition to that of this process
        room     partitions that it may serve
        cores    on which it carries out tasks
        program  the module that is Ray's own, or the one that keeps it on the loopback interface
        """
        said = folder / f"ray-{name}.log"
        command = [
            sys.executable, "-m", program, "start", *arguments, "--block", f"--node-name={name}",
            "--disable-usage-stats", "--include-log-monitor=false", f"--object-store-memory={OBJECT_STORE}",
            f"--num-cpus={cores}",
            f"--resources={json.dumps({ROOM: room} if room else {})}",
        ]  # fmt: skip
        output = said.open("wb")
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, **given},
            start_new_session=True,  # so that Ctrl-C reaches this process first
        )
        return cls(name, process, output, said)

    def wait(self) -> None:
        """Until the node is at work; DeliveryError where it does not start."""
        end = time.monotonic() + STARTED_WITHIN
        while b"Ray runtime started" not in self.said.read_bytes():
            if self.process.poll() is not None or time.monotonic() > end:
                self.end()
                raise DeliveryError(f"{self.name} of the fleet did not start; {self.said} says why")
            time.sleep(0.1)

    def end(self, *, at_once: bool = False) -> None:
        """Ends the node with all that runs on it."""
        if self.process.poll() is None and not at_once:
            self.process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(ENDED_WITHIN)
        _kill_group(self.group)
        self.process.wait()
        self.output.close()


@dataclass(slots=True)
class LocalCluster:
    """Head and nodes of Ray on this machine, reachable on the loopback interface only.

    folder  of the fleet: token, and what Ray says
    room    partitions that each node may serve
    cores   on which each node carries out tasks
    """

    folder: Path
    room: int
    cores: int
    port: int = 0
    nodes: list[Node] = field(default_factory=list)
    head: Node | None = None
    _count: int = 0

    @property
    def address(self) -> str:
        return f"{LOOPBACK}:{self.port}"

    def start(self, nodes: int) -> None:
        """Starts the head, and so many nodes."""
        self.port = self.port or _free_port()
        self.head = self._start("head", ["--head", f"--port={self.port}", *NO_MORE])
        self.head.wait()
        self.scale(nodes)

    def scale(self, nodes: int) -> None:
        """Starts nodes until there are so many."""
        while len(self.nodes) < nodes:  # one after the other: nodes that start at the same time wait for each other
            self._count += 1
            node = self._start(f"node-{self._count}", [f"--address={self.address}"], self.room, self.cores)
            self.nodes.append(node)
            node.wait()

    def clear(self) -> int:
        """Clears away nodes that have ended; how many there were."""
        dead = [node for node in self.nodes if node.process.poll() is not None]
        for node in dead:
            log.error("%s of the fleet has ended, and is replaced", node.name)
            node.end()
            self.nodes.remove(node)
        return len(dead)

    @property
    def groups(self) -> list[int]:
        """The process groups of head and nodes."""
        return [node.group for node in (*self.nodes, *([] if self.head is None else [self.head]))]

    @property
    def lost(self) -> bool:
        """Whether there is no head, and with it no cluster: it knows where everything is, in its memory."""
        return self.head is None or self.head.process.poll() is not None

    def end(self) -> None:
        """Ends all nodes, and the head last; at once where that is lost, and nothing can end in good order."""
        lost = self.lost
        for node in (*self.nodes, *([] if self.head is None else [self.head])):
            node.end(at_once=lost)
        self.nodes, self.head = [], None

    def _start(self, name: str, arguments: list[str], room: int = 0, cores: int = 0) -> Node:
        given = [*arguments, f"--node-ip-address={LOOPBACK}", *(f"{port}={_free_port()}" for port in AGENT_PORTS)]
        if "--head" in arguments:
            given.append(f"--temp-dir={_short(self.folder)}")
        known = environment(self.folder)
        return Node.started(self.folder, name, given, known, room=room, cores=cores, program=NODE)


def end_left(groups: Iterable[int]) -> int:
    """Ends nodes that a killed `fleet up` has left behind, so that no partition is fought for; how many there were.

    groups  numbers of their process groups; those that are other programs by now are left alone
    """
    found = 0
    for group in groups:
        with suppress(OSError):
            if NODE.encode() in Path(f"/proc/{group}/cmdline").read_bytes():
                _kill_group(group)
                found += 1
    return found


@contextmanager
def node_here(folder: Path, address: str) -> Iterator[Node | None]:
    """A node of a plant's cluster on this machine while inside: Ray is joined through a node of the same machine only.

    It has no room for partitions. None where the machine has a node of the cluster already.
    """
    if _has_node(address):
        yield None
        return
    folder.mkdir(parents=True, exist_ok=True)
    name = f"fleet-{socket.gethostname()}-{os.getpid()}"
    node = Node.started(folder, name, [f"--address={address}"], environment_to_join(folder))
    try:
        node.wait()
        yield node
    finally:
        node.end()
        node.said.unlink(missing_ok=True)


def _has_node(address: str) -> bool:
    """Whether a node of the cluster at an address runs on this machine."""
    host, _, port = address.rpartition(":")
    known = {address}
    with suppress(OSError):
        known.add(f"{socket.gethostbyname(host.strip('[]'))}:{port}")
    wanted = {f"--gcs-address={each}".encode() for each in known}
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            words = process.read_bytes().split(b"\0")
            if words[0].endswith(b"/raylet") and wanted & set(words):
                return True
    return False


NAMESPACE = "gear-twin"  # of the actors' names


def _short(folder: Path) -> Path:
    """A folder for Ray's sockets, whose paths may have about a hundred characters."""

    return (
        Path(tempfile.gettempdir()) / f"gear-twin-{blake2b(str(folder.resolve()).encode(), digest_size=5).hexdigest()}"
    )


def _free_port() -> int:
    with socket.socket() as free:
        free.bind((LOOPBACK, 0))
        return int(free.getsockname()[1])


def _kill_group(leader: int) -> None:
    """Kills what a node has left behind."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, signal.SIGKILL)


def said_by(node: Mapping[str, object]) -> str:
    """A node of Ray by its name, or the begin of its number."""
    return str(node.get("NodeName") or str(node["NodeID"])[:12])
