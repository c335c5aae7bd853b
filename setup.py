"""Compiles the kernels of twin/compiled when the package is built; all else is in pyproject.toml.

The compiler is $CC, or the machine's `cc`; where there is none, the one in the package `ziglang`, which is then fetched
for the build alone.
"""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py

KERNELS = Path(__file__).parent / "twin" / "compiled"
# Sums may be taken in any order; NaN and infinity stay what they are.
FLAGS = [
    "-std=c11",
    "-O3",
    "-fPIC",
    "-shared",
    "-fassociative-math",
    "-fno-signed-zeros",
    "-fno-trapping-math",
    "-freciprocal-math",
    "-fno-math-errno",
    "-pthread",
]
OWN = shlex.split(os.environ.get("CC", "")) or (["cc"] if shutil.which("cc") else [])


def compile_kernels() -> None:
    """Writes twin/compiled/kernels.so, at once for whoever runs it meanwhile."""
    compiler = OWN or [sys.executable, "-m", "ziglang", "cc"]
    sources = sorted(str(path) for path in (KERNELS / "source").glob("*.c"))
    made = KERNELS / f"kernels.{os.getpid()}.so"
    command = [*compiler, *FLAGS, *sources, "-lm", "-o", str(made)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"the kernels of gear-twin do not compile:\n{shlex.join(command)}\n{done.stderr}")
    made.replace(KERNELS / "kernels.so")


class BuildWithKernels(build_py):
    """Python modules, after the kernels."""

    def run(self) -> None:
        compile_kernels()
        super().run()


class Compiled(Distribution):
    """A distribution for one kind of machine."""

    def has_ext_modules(self) -> bool:
        return True


setup(
    distclass=Compiled,
    cmdclass={"build_py": BuildWithKernels},
    setup_requires=[] if OWN else ["ziglang"],
)
