"""Cores that this process may use: those of its affinity, or fewer where a control group has a quota of processor time.

    cores of a quota = quota / period, of cpu.max (cgroup v2) or cpu.cfs_quota_us and cpu.cfs_period_us (v1)

The quota of every group above holds, too. A container that cannot see its group's own folder has it at the mount.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

GROUPS, MOUNT = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")


def usable_cores(groups: Path = GROUPS, mount: Path = MOUNT) -> int:
    """Whole cores, at least one.

    groups  file that names the process's control groups
    mount   folder of the control groups
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(int(min([cores, *_quotas(groups, mount)])), 1)


def _quotas(groups: Path, mount: Path) -> Iterator[float]:
    """The quotas that hold for the process, in cores."""
    for folder in dict.fromkeys(_folders(groups, mount)):
        quota = _read(folder / "cpu.max") or [*_read(folder / "cpu.cfs_quota_us"), *_read(folder / "cpu.cfs_period_us")]
        if len(quota) == 2 and quota[0].isdigit() and int(quota[1]) > 0:  # "max" and -1 are none
            yield int(quota[0]) / int(quota[1])


def _folders(groups: Path, mount: Path) -> Iterator[Path]:
    """The folders of the process's groups and of those above, up to where they are mounted."""
    for line in groups.read_text().splitlines() if groups.exists() else ():
        _, controllers, path = line.split(":", 2)
        if controllers and "cpu" not in controllers.split(","):
            continue
        for top in (mount / controllers, mount / "cpu") if controllers else (mount,):
            folder = top / path.lstrip("/")
            yield from (folder, *(above for above in folder.parents if above.is_relative_to(top)))


def _read(file: Path) -> list[str]:
    try:
        return file.read_text().split()
    except OSError:
        return []
