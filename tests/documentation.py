"""The commands of the documentation, read from its pages so that tests can run them.

A fence marked `bash` holds commands. A `text` fence right after it shows what they print; `…` stands for anything.
Comments before a fence say how to treat it:

    <!-- not run: REASON -->     it is not run
    <!-- background -->          it goes on (a service) until the page is done
    <!-- prepare: COMMANDS -->   commands that a reader does not need, run first
    <!-- slow -->                the page is tested with the longer proofs

The commands of a page are run in order in one folder, in which `recordings/` and `docs/` are those of the project.
Addresses are exchanged for free ones.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path

from forked_processes import connection

ROOT = Path(__file__).parents[1]
COMMAND = ROOT / "tests" / "service" / "forked_command.py"
PAGES = sorted(
    [ROOT / "README.md", ROOT / "ARCHITECTURE.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "twin").rglob("*.md")]
)
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMENT = re.compile(r"<!-- (not run|background|prepare|slow)(?:: ((?:(?!-->).)*))? -->\s*$", re.DOTALL)
AWAIT_WINDOWS = """#!/usr/bin/env python3
import json, os, sys, time, urllib.request
wanted, deadline = int(sys.argv[1]), time.monotonic() + 300
while time.monotonic() < deadline:
    with urllib.request.urlopen(os.environ["GEAR_TWIN_URL"] + "/v1/assets", timeout=30) as answer:
        if any(asset["windows"] >= wanted for asset in json.load(answer)):
            sys.exit(0)
    time.sleep(0.5)
sys.exit(f"no asset has {wanted} windows after 300 s")
"""
HTTP, ZENOH = "127.0.0.1:8080", "127.0.0.1:7447"
START_WAIT = 60.0  # [s]


@dataclass(frozen=True)
class Block:
    """One fence of commands."""

    commands: str
    printed: str | None = None
    marks: dict[str, str] = field(default_factory=dict)

    @property
    def is_run(self) -> bool:
        return "not run" not in self.marks


def blocks_of(text: str) -> list[Block]:
    """The fences of commands of a page, in order."""
    fences = list(FENCE.finditer(text))
    found = []
    for i, fence in enumerate(fences):
        if fence[1] != "bash":
            continue
        marks, before = {}, text[: fence.start()]
        while mark := COMMENT.search(before):
            marks[mark[1]] = mark[2] or ""
            before = before[: mark.start()]
        printed = None
        if i + 1 < len(fences) and fences[i + 1][1] == "text" and not text[fence.end() : fences[i + 1].start()].strip():
            printed = fences[i + 1][2]
        found.append(Block(fence[2], printed, marks))
    return found


def is_slow(text: str) -> bool:
    return any("slow" in block.marks for block in blocks_of(text))


def free_address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


def prepared(folder: Path) -> dict[str, str]:
    """The environment in which commands are run: `gear-twin` and `python` are those of this test.

    The first begins without the two seconds of imports that each command takes: see `forked_processes`.
    """
    tools = folder / ".tools"
    tools.mkdir()
    command = f"-I -S {shlex.quote(str(COMMAND))} {connection().fileno()} "
    for name, arguments in (("gear-twin", command), ("python", "")):
        shim = tools / name
        shim.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {arguments}"$@"\n')
        shim.chmod(0o755)
    (tools / "await-windows").write_text(AWAIT_WINDOWS)  # for fences that ask a service about what was replayed into it
    (tools / "await-windows").chmod(0o755)
    for name in ("recordings", "docs", "benchmarks"):
        (folder / name).symlink_to(ROOT / name)
    return os.environ | {
        "PATH": f"{tools}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "COLUMNS": "100",
        "GEAR_TWIN_IDLE_TIMEOUT": "3",
    }


def run_page(text: str, folder: Path) -> None:
    """Runs a page's commands; AssertionError with what was printed where one fails or prints something else."""
    environment, services = prepared(folder), []
    for address in (HTTP, ZENOH):
        text = text.replace(address, free_address())
    http = re.search(r"--http (127\.0\.0\.1:\d+)", text)
    if http:
        environment["GEAR_TWIN_URL"] = f"http://{http[1]}"
    try:
        for block in blocks_of(text):
            if not block.is_run:
                continue
            if "background" in block.marks:
                services.append(start(block.commands, folder, environment))
                continue
            run_block(block, folder, environment)
    finally:
        for process in services:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(20)


def run_block(block: Block, folder: Path, environment: dict[str, str]) -> None:
    if "prepare" in block.marks:
        shell(block.marks["prepare"], folder, environment)
    said = shell(block.commands, folder, environment)
    if block.printed is not None:
        pattern = r".*?".join(re.escape(part.strip()) for part in re.split(r"…", spaced(block.printed)))
        assert re.search(pattern, spaced(said), re.DOTALL), f"{block.commands}\nprinted\n{said}\nnot\n{block.printed}"


def spaced(text: str) -> str:
    return " ".join(text.split())


def shell(commands: str, folder: Path, environment: dict[str, str]) -> str:
    done = subprocess.run(
        ["bash", "-e", "-u", "-o", "pipefail", "-c", commands],
        cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        pass_fds=[connection().fileno()],
    )  # fmt: skip
    assert done.returncode == 0, f"{commands}\nended with status {done.returncode}:\n{done.stdout}"
    return done.stdout


def start(commands: str, folder: Path, environment: dict[str, str]) -> subprocess.Popen:
    """Starts a service and waits until it answers."""
    with (folder / ".service.log").open("w") as log:
        process = subprocess.Popen(
            ["bash", "-e", "-c", commands], cwd=folder, env=environment, stdout=log, stderr=log, start_new_session=True,
            pass_fds=[connection().fileno()],
        )  # fmt: skip
    deadline = time.monotonic() + START_WAIT
    url = f"{environment.get('GEAR_TWIN_URL', 'http://' + HTTP)}/readyz"
    while time.monotonic() < deadline and process.poll() is None:
        try:
            with urllib.request.urlopen(url, timeout=2):
                return process
        except OSError:
            time.sleep(0.3)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    raise AssertionError(f"{commands}\ndid not become ready:\n{(folder / '.service.log').read_text()}")
