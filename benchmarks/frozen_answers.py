"""What must not change while the program is rebuilt: answers written to a folder, and compared with those of before.

    python -m benchmarks.frozen_answers write FOLDER
    python -m benchmarks.frozen_answers compare OLD NEW

`write` makes one canonical JSON file an item: `assess/`, the answers of `gear-twin assess` on the bundled recordings, a
long one, and D00 to D13 where ../shared/campaigns is there; `rest/`, after a replay into a real service what people
enter (ENTERED), every GET, and exported tables; of the same service `openapi`, and `metrics` without values; `kills`,
schedules of faults as they are drawn, and each line that states a seed where processes are killed. A recording's
item that is there is not made again. What depends on clock and process is masked by MASKS, the one list of it.
`compare` prints each item that differs with the paths in it, and ends with 1 where there is one.
"""

from __future__ import annotations

import itertools
import json
import re
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

from prometheus_client.parser import text_string_to_metric_families

from benchmarks.long_recording import write_long_recording
from benchmarks.long_run.service import PROGRAM, Service, serving
from service.runtime.demo import free_port

ROOT = Path(__file__).parents[1]
LONG, PATIENCE = 60.0, 1800.0  # signal of the long recording, and limit for the windows of a recording [s]
ABSENT, SHOWN = "(absent)", 100  # in a comparison, and characters of a value
SEEDED = re.compile(r"^ *(.*(?:\bseeds? *= *\d|\bRandom\(|\bdefault_rng\().*)$", re.IGNORECASE | re.MULTILINE)
TODAY = "|".join(time.strftime("%Y-%m-%d", time.gmtime(time.time() - ago)) for ago in (0, -86_400))
MASKS = (
    (rf"({TODAY})[T ][\d:.]+(Z| UTC)", "<time>"),  # recordings are older
    (rf"\b{time.time_ns() // 10**15}\d{{15}}\b", "0"),  # the same in nanoseconds
    (r"; \d+ windows? waits? to be assessed since [\d:]+ UTC", ""),  # as the processor was busy
    (r',\s*(\\?")+waiting(\\?")+:\s*\{[^{}]*\}', ""),
    (r'(?<="instance": ")[0-9a-f]{32}', "<process>"),
    (r"\b[mp][0-9a-f]{10}\b", "<id>"),  # of parts of a drawing, which are drawn by chance
)
"""Parts of the JSON text of an item that depend on clock or process, and what is written in their place."""

BY = {"by": "Ada", "note": "seen"}
ENTERED: Mapping[str, tuple[tuple[str, str, Mapping[str, Any]], ...]] = {
    "faulty-campaign": (
        ("POST", "faulty-campaign/effects/tooth_crack", {"decision": "pin", **BY}),
        ("POST", "faulty-campaign/effects/misalignment", {"decision": "accept", **BY}),
        ("POST", "faulty-campaign/effects/unheard_of", {"decision": "accept", **BY}),
    ),
    "paper-campaign": (
        ("POST", "paper-campaign/inspections", {"revolutions": 18000, "max_depth_um": 490, "std_um": 15}),
        ("POST", "paper-campaign/what-if", {"duty": [{"speed_hz": 8, "torque_nm": 9}], "hours": 10}),
        ("PUT", "paper-campaign/alarm-rules", {"rules": [{"name": "level", "quantity": "rms", "watch": 20}], **BY}),
        ("POST", "paper-campaign/alarms/3/acknowledge", BY),
    ),
    "short-campaign": (
        ("POST", "short-campaign/changes", {"kind": "renamed", "name": "hall.pump-1", **BY}),
        ("POST", "hall.pump-1/changes", {"kind": "gears_replaced", **BY}),
        ("POST", "hall.pump-1/changes", {"kind": "sensor_moved", "sensor": "y6", **BY}),
    ),
    "nobody": (("POST", "", {"asset": "spare", **BY}), ("POST", "", {"asset": "paper-campaign", **BY})),
}
"""What people enter after the replay of a recording; some of it is refused."""

NAMES = {
    "short-campaign": ("short-campaign", "hall.pump-1"),
    "nobody": ("nobody", "spare", ""),
}  # empty: routes of no asset
HISTORY = ("", "?limit=5&after=3", "?every=7", "?resolution=10", "?epoch=0")
ASKED: Mapping[str, tuple[str, ...]] = {
    "/metrics": (),  # an item of its own
    "/v1/assets": ("", "?limit=2", "?search=crack", "?level=alarm&retired=false"),
    "/v1/alarms": ("", "?state=all"),
    "/v1/audit": ("?after=0&limit=1000",),
    "/v1/assets/{asset}/alarms": ("", "?state=all"),
    "/v1/assets/{asset}/windows": HISTORY,
    "/v1/assets/{asset}/trend": HISTORY,
    "/v1/assets/{asset}/events": ("?after=0",),
    "/v1/assets/{asset}/windows/{index}/signals/{view}": ("", "?format=csv"),
    "/v1/assets/{asset}/waterfall": ("?bins=50", "?view=order-spectrum&bins=50"),
    "/v1/assets/{asset}/indicators": ("", "?format=csv"),
}
"""Queries of a route, where it is not asked once without any."""


def write(folder: Path) -> None:
    """Makes all items that are not in the folder yet."""
    with tempfile.TemporaryDirectory() as scratch:
        long = Path(scratch, "long.mcap")
        write_long_recording(long, LONG)
        replayed, campaigns = sorted(ROOT.glob("recordings/*.mcap")), ROOT.glob("../shared/campaigns/D*.mcap")
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda path: assessed(folder, path), (long, *replayed, *sorted(campaigns))))
        if not (folder / "metrics.json").exists():
            served(folder, (*replayed, long), Path(scratch))
    keep(folder, "kills", kills())


def keep(folder: Path, item: str, value: Any) -> None:
    """Writes an item whole."""
    path = folder / f"{item}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(value, indent=1, sort_keys=True, ensure_ascii=False)
    Path(f"{path}.part").write_text(masked(text), encoding="utf-8")
    Path(f"{path}.part").rename(path)


def masked(text: str) -> str:
    """The text of an item without what MASKS names."""
    for pattern, mask in MASKS:
        text = re.sub(pattern, mask, text)
    return text


def command(*arguments: str) -> None:
    """Runs one command of gear-twin."""
    subprocess.run([sys.executable, "-m", "service", *arguments], cwd=ROOT, check=True, capture_output=True)


def assessed(folder: Path, path: Path) -> None:
    """The item of one recording."""
    if (folder / f"assess/{path.stem}.json").exists():
        return
    with tempfile.NamedTemporaryFile(suffix=".json") as out:
        command("assess", str(path), "--json", out.name)
        keep(folder, f"assess/{path.stem}", json.loads(Path(out.name).read_bytes()))


def kills() -> Any:
    """The schedules as they are drawn, and where a seed is stated."""
    sys.path.insert(0, str(ROOT / "tests" / "service"))  # what the schedules are written with
    counts, draw = import_module("tests.chaos.__main__").COUNTS, import_module("tests.chaos.schedules").draw
    files = sorted((*ROOT.glob("tests/**/*.py"), *ROOT.glob("benchmarks/**/*.py")))
    texts = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in files}
    seeds = {path: found for path, text in texts.items() if "kill" in text.lower() and (found := SEEDED.findall(text))}
    return {"counts": counts, "schedules": [asdict(draw(1, number)) for number in range(300)], "seeds": seeds}


def served(folder: Path, recordings: Sequence[Path], scratch: Path) -> None:
    """The items of a service into which recordings are replayed, one after the other, each as an asset of its name."""
    port = free_port(range(21_870, 21_970, 10))
    settings: dict[str, Any] = {
        "mqtt": "mqtt://127.0.0.1:1", "opcua": f"opc.tcp://127.0.0.1:{port + 2}/gear-twin", "http_rate": 10**6,
        "raw_folder": scratch / "raw", "raw_url": (scratch / "segments").as_uri(), "raw_spare_gb": 0,
    }  # fmt: skip
    with serving(scratch / "data", port, program=PROGRAM, **settings) as service:
        schema = service.get("/openapi.json")
        for path in recordings:
            command("replay", str(path), "--connect", service.endpoint, "--speed", "0", "--asset", path.stem)
            windows = json.loads((folder / f"assess/{path.stem}.json").read_bytes())["windows_total"]
            end = time.monotonic() + PATIENCE
            while service.windows().get(path.stem, 0) < windows and time.monotonic() < end:
                time.sleep(0.2)
            told(folder, service, schema["paths"], path.stem)
            name = NAMES.get(path.stem, (path.stem,))[-1]  # out of use before it is silent for so long that it is stale
            asked(service, "POST", f"/v1/assets/{name}/changes", {"kind": "retired", **BY})
        told(folder, service, schema["paths"], "nobody")
        keep(folder, "openapi", schema)
        with urllib.request.urlopen(f"{service.address}/metrics", timeout=60) as answer:
            found = [(f.type, s) for f in text_string_to_metric_families(answer.read().decode()) for s in f.samples]
        keep(folder, "metrics", {f"{kind} {s.name} {sorted(s.labels.items())}": "" for kind, s in found})
    for what in ("windows", "events"):
        command("db", "export", f"{scratch}/{what}.csv", "--what", what, "--data", f"{scratch}/data")
        keep(folder, f"rest/export {what}", Path(scratch, f"{what}.csv").read_text(encoding="utf-8").splitlines())


def told(folder: Path, service: Service, paths: Mapping[str, Any], recording: str) -> None:
    """The items of what people enter about a recording's asset, and of all routes that are read."""
    for number, (method, address, body) in enumerate(ENTERED.get(recording, ())):
        found = asked(service, method, f"/v1/assets/{address}".rstrip("/"), body)
        keep(folder, f"rest/entered {recording} {number}", found)
    for path, calls in ((path, calls["get"]) for path, calls in paths.items() if "get" in calls):
        views = [p["schema"]["enum"] for p in calls.get("parameters", ()) if p["name"] == "view" and "{view}" in path]
        for asset in NAMES.get(recording, (recording,)):
            windows = (5, 99_999) if "{index}" in path else (0,)
            choices = itertools.product(windows, *views or [[""]], ASKED.get(path, ("",)))
            for index, view, query in choices if bool(asset) is ("{asset}" in path) else ():  # no name: no asset's
                address = path.format(asset=asset, index=index, view=view) + query
                keep(folder, f"rest/{address[1:].replace('/', ' ')}", asked(service, "GET", address))


def asked(service: Service, method: str, address: str, body: Mapping[str, Any] | None = None) -> Any:
    """Status, kind, next page and content of an answer."""
    data, head = None if body is None else json.dumps(body).encode(), {"Content-Type": "application/json"}
    request = urllib.request.Request(service.address + address, data, head, method=method)
    try:
        answer = urllib.request.urlopen(request, timeout=120)
    except urllib.error.HTTPError as error:
        answer = error
    with answer:
        kind, content = answer.headers.get_content_type(), ""
        if kind == "text/event-stream":
            last = {row["asset"]: row["last_event_id"] for row in service.get("/v1/assets")}[address.split("/")[3]]
            while f"id: {last}\r\n" not in content or not content.endswith("\r\n\r\n"):
                content += answer.readline().decode()
        else:
            content = answer.read().decode()
        lines = [json.loads(line[6:]) if line.startswith("data: ") else line for line in content.splitlines()]
        head = {"status": answer.status, "kind": kind, "next": answer.headers.get("Link")}
        return {**head, "etag": "ETag" in answer.headers, "content": json.loads(content) if "json" in kind else lines}


def differences(old: Any, new: Any, path: str = "") -> Iterator[str]:
    """Paths at which two values differ, with both."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old, *new}):
            yield from differences(old.get(key, ABSENT), new.get(key, ABSENT), f"{path}/{key}")
    elif isinstance(old, list) and isinstance(new, list):
        for number, (one, other) in enumerate(itertools.zip_longest(old, new, fillvalue=ABSENT)):
            yield from differences(one, other, f"{path}/{number}")
    elif json.dumps(old) != json.dumps(new):
        yield f"{path}: {json.dumps(old)[:SHOWN]} became {json.dumps(new)[:SHOWN]}"


def compare(old: Path, new: Path) -> bool:
    """Prints what differs between two folders; whether nothing does."""
    items = sorted({str(path.relative_to(folder)) for folder in (old, new) for path in folder.rglob("*.json")})
    same = 0
    for item in items:
        found = [json.loads(p.read_bytes()) if (p := folder / item).exists() else ABSENT for folder in (old, new)]
        lines = list(differences(*found))
        same += not lines
        print(*(item, *lines) if lines else (), sep="\n    ", end="\n" if lines else "")
    print(f"{len(items)} items, {len(items) - same} of them differ")
    return same == len(items) > 0


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["write", given]:
            write(Path(given))
        case ["compare", old, new]:
            sys.exit(0 if compare(Path(old), Path(new)) else 1)
        case _:
            sys.exit(__doc__)
