"""What the windows of two recordings cost, in counts that no other load of the machine can move.

    python -m tests.golden.work_of_windows        writes tests/golden/work_of_windows.json anew

By window: calls of functions of twin/, solutions of the balance and the operator products in them; by recording, bytes
of frames decoded and calls of functions of service/. Run it after a change that is meant to move them, and say in the
commit why they moved.
"""

from __future__ import annotations

import gc
import json
import os
import platform
import sys
from collections import Counter
from collections.abc import Callable
from cProfile import Profile
from pathlib import Path
from types import CodeType
from typing import Any

from service.files.rig import rig_of
from service.stream.sources import mcap
from twin.compiled import CompiledBalance
from twin.options import Options
from twin.state import State
from twin.step import step

FILE = Path(__file__).with_suffix(".json")
ROOT = Path(__file__).parents[2]
RECORDINGS = {"paper-campaign": (8, Options(trace=False)), "short-campaign": (5, Options())}  # windows of each
SOLVERS = ("newton", "carry_on")
spent: Counter[str] = Counter()  # in solutions and in decoding, so far


def _counted(name: str, amount: Callable[..., int], function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, whose amounts of work are added up; `amount` is of its result and its arguments."""

    def counted(*arguments: Any, **named: Any) -> Any:
        result = function(*arguments, **named)
        spent[name] += amount(result, *arguments)
        spent[f"calls for {name}"] += 1
        return result

    return counted


def _calls(profile: Profile, part: str) -> int:
    """Calls of functions of one folder; a comprehension is no call, in any version of Python."""
    codes = [(entry.code, entry.callcount) for entry in profile.getstats() if isinstance(entry.code, CodeType)]
    folder = str(ROOT / part) + os.sep
    return sum(n for code, n in codes if code.co_filename.startswith(folder) and not code.co_name.startswith("<"))


def figures() -> dict[str, Any]:
    """Of a process that has computed nothing else: what is kept from one window to the next counts."""
    gc.disable()
    for name in SOLVERS:
        plain = getattr(CompiledBalance, name)
        setattr(CompiledBalance, name, _counted("products", lambda done, *_: done.progress.products, plain))
    mcap.decode = _counted("bytes", lambda _, channel, payload: len(payload), mcap.decode)
    return {
        "python": [*sys.version_info[:2], _processor()],
        **{name: _of(name, *how) for name, how in RECORDINGS.items()},
    }


def _processor() -> str:
    """The processor's model: libraries round by the instructions that it has."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    model = next(names, platform.machine())
    return f"{model}, {'with' if any('avx512f' in line for line in lines) else 'without'} AVX-512"


def _of(name: str, most: int, options: Options) -> dict[str, Any]:
    path = ROOT / "recordings" / f"{name}.mcap"
    spent.clear()
    with Profile(builtins=False) as reading:
        windows = mcap.read_windows(path)[2]
    size = spent["bytes"]
    with mcap.Recording(path) as recording:
        rig = rig_of(recording, None)
    state, work = State(), []
    for window in windows[:most]:
        spent.clear()
        with Profile(builtins=False) as profile:
            state, _ = step(rig, state, window, options)
        work.append(
            {"calls": _calls(profile, "twin"), "solves": spent["calls for products"], "products": spent["products"]}
        )
    return {"bytes": size, "calls": _calls(reading, "service"), "windows": work}


if __name__ == "__main__":
    found = json.dumps(figures(), indent=1)
    if sys.argv[1:] == ["--print"]:
        print(found)
    else:
        FILE.write_text(found + "\n", encoding="utf-8")
