"""An environment of its own for every peer: made where it is missing or its requirements have changed, else kept.

They lie in the user's cache folder (XDG_CACHE_HOME, else ~/.cache), and are filled by pip from whatever index the user
has. The requirements that an environment was made from are written into it last, so that one that was left half made is
made again.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

REQUIREMENTS: Mapping[str, tuple[str, ...]] = {
    "exudyn": ("exudyn==1.13.6", "numba==0.68.1", "numpy==2.4.6"),
    "mcap": ("mcap==1.6.0", "numpy==2.4.6", "protobuf==7.36.2"),
    "progpy": ("progpy==1.9.0", "numpy==2.4.6", "scipy==1.17.1"),
    "ross": ("ross-rotordynamics==2.3.0", "numba==0.68.1", "numpy==2.4.6", "plotly==5.24.1", "scipy==1.17.1"),
    "scipy": ("numpy==2.4.6", "scipy==1.17.1"),
}
MADE_FROM = "made-from.txt"
LONGEST = 1800.0  # an installation may take [s]

Run = Callable[[Sequence[str]], None]


class Unavailable(Exception):
    """A peer cannot be had, or its program failed; the message says why."""


def default_folder() -> Path:
    """Where environments are kept."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "gear-twin" / "peers"


def run_quietly(command: Sequence[str]) -> None:
    """Runs a command; Unavailable with the last thing that it said where it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=False)
    except subprocess.TimeoutExpired:
        raise Unavailable(f"installation took more than {LONGEST:g} s") from None
    if done.returncode:
        said = [line for line in (done.stderr + done.stdout).splitlines() if line.startswith("ERROR")]
        raise Unavailable(said[-1].removeprefix("ERROR: ") if said else f"{command[1]} ended with {done.returncode}")


def python_of(name: str, folder: Path, run: Run = run_quietly) -> Path:
    """The interpreter of a peer's environment, which is made if need be; Unavailable where that fails."""
    home, requirements = folder / name, REQUIREMENTS[name]
    python = home / "bin" / "python"
    made_from = "\n".join((f"python {sys.version_info.major}.{sys.version_info.minor}", *requirements, ""))
    kept = home / MADE_FROM
    if python.exists() and kept.is_file() and kept.read_text(encoding="utf-8") == made_from:
        return python
    shutil.rmtree(home, ignore_errors=True)
    pip = (str(python), "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-input")
    try:
        run((sys.executable, "-m", "venv", str(home)))
        run((*pip, "--retries", "1", *requirements))
    except Unavailable:
        shutil.rmtree(home, ignore_errors=True)
        raise
    kept.write_text(made_from, encoding="utf-8")
    return python
