"""Leaves of an environment what a service needs:   python3 slim.py ENVIRONMENT RECORDING FOUND [EXTRA]

Packages' own tests, stubs, static libraries and debugging symbols are removed, and the installer with them. Byte code
is kept of those modules alone that a service imports: a recording is assessed, a report is written, and the service's
modules are imported, which also shows that nothing is missing. The standard library's byte code that was in use is
listed in the file FOUND.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

INSTALLER = (
    "pip",
    "pip-*",
    "setuptools",
    "setuptools-*",
    "pkg_resources",
    "_distutils_hack",
    "distutils-precedence.pth",
)
AVIF = ("PIL/_avif*", "pillow.libs/libavif*")  # a format of pictures that nobody asks for
RAY = ("ray/jars", "ray/rllib", "ray/llm", "ray/cpp", "ray/dashboard/client")  # other languages, learning, its own page
FOLDERS = ("tests", "test", "sample_data", "include")
FILES = ("*.pyi", "*.a", "*.pyx", "*.pxd", "*.c", "*.h", "*.hpp")
PROOF = """
import sys, pathlib
sys.dont_write_bytecode = False
from service.cli import run
assert run(["--help"]) == 0
assert run(["assess", sys.argv[1], "--json", "answer.json"]) == 0
assert run(["report", "answer.json", "--out", "report.pdf"]) == 0
import service.runtime.serve, service.transport.zenoh, service.runtime.replay, service.runtime.record
import service.runtime.raw_recorder
if sys.argv[3:] == ["fleet"]:
    import ray.scripts.scripts, ray.dashboard.agent, ray._private.log_monitor, ray._private.workers.setup_worker
    import service.fleet.up, service.fleet.front, service.fleet.engine, service.fleet.assess_task
import psycopg, paho.mqtt.client
import uvicorn.protocols.http.h11_impl, uvicorn.lifespan.on, uvicorn.loops.auto, anyio._backends._asyncio
from importlib.util import find_spec
assert all(map(find_spec, ("asyncua", "opentelemetry.sdk")))
used = (getattr(m, "__cached__", None) for m in list(sys.modules.values()))
pathlib.Path(sys.argv[2]).write_text("\\n".join(sorted({c for c in used if c and c.startswith("/usr/lib/")})))
"""


def main(environment: Path, recording: Path, found: Path, *extra: str) -> None:
    packages = next((environment / "lib").glob("python*")) / "site-packages"
    for pattern in (*INSTALLER, *AVIF, *RAY):
        for path in packages.glob(pattern):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    for folder in [p for p in packages.rglob("*") if p.is_dir() and p.name in FOLDERS and p.parent != packages]:
        shutil.rmtree(folder, ignore_errors=True)
    for pattern in FILES:
        for path in packages.rglob(pattern):
            path.unlink()
    for library in (p for p in packages.rglob("*.so*") if p.is_file() and ".libs" not in p.parent.name):
        subprocess.run(["strip", "--strip-unneeded", str(library)], check=False, stderr=subprocess.DEVNULL)
    for script in (environment / "bin").glob("pip*"):
        script.unlink()
    with tempfile.TemporaryDirectory() as folder:
        command = [str(environment / "bin" / "python3"), "-c", PROOF, str(recording), str(found), *extra]
        subprocess.run(command, check=True, cwd=folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]).resolve(), Path(sys.argv[3]).resolve(), *sys.argv[4:])
