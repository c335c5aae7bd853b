"""Processes of a service under fault, and a disk that can be filled."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil


@contextmanager
def own_disk(data: Path) -> Iterator[None]:
    """A small disk of its own for a data directory, which can be filled."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", str(data)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(data)], check=False)


def children_of(pid: int) -> list[psutil.Process]:
    """The processes that a process has made, and theirs; none where it has ended."""
    try:
        return psutil.Process(pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def does(process: psutil.Process, role: str) -> bool:
    """Whether a process does a role of a service, or was forked by the one that does."""
    with suppress(psutil.Error):
        return process.name() == role
    return False


def ended(process: psutil.Process, seconds: float) -> bool:
    try:
        process.wait(seconds)
    except psutil.TimeoutExpired:
        return False
    return True
