"""The whole of gear-twin at once: a service, two machines replayed into it, and what it says of them.

The service is a process of its own, the replay a client of its Zenoh endpoint, and the figures come from
its REST answers: nothing here differs from real use.
"""

from __future__ import annotations

import itertools
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
import webbrowser
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from service.contract.overview import is_available
from service.errors import DeliveryError, InputError
from service.runtime import SERVES
from service.runtime.reception import assembly_settings
from service.runtime.replay import replay
from service.settings import Settings
from service.stream.sources.mcap import read_windows
from service.stream.wire.topics import PREFIX

BUNDLED = Path(__file__).parents[2] / "recordings"
RECORDINGS = (BUNDLED / "short-campaign.mcap", BUNDLED / "faulty-campaign.mcap")  # a healthy machine and a faulty one
HTTP = "127.0.0.1:8080"  # where it is free
START_WAIT = 60.0  # how long the service may take to start [s]
STALL_WAIT = 180.0  # how long the service may take for one window [s]
STOP_WAIT = 20.0
POLL = 0.2
MOST_SAID = 2**16  # of a service's output that is shown where it does not start [bytes]
PORTS = range(20000, 32768)  # below those that outgoing connections are given
TRIED = 1000  # of them


TERMINATED = 128 + signal.SIGTERM  # exit status of a process that a termination signal has ended


class DemoFailed(Exception):
    """What the demo should have shown and did not."""


class Terminated(BaseException):
    """A termination signal has come."""


def run(
    settings: Settings,
    exit_after: bool = False,
    recordings: Sequence[Path] = RECORDINGS,
    console: Console | None = None,
    command: Sequence[str] = (sys.executable, "-m", "service", "serve"),
    browser: bool = False,
) -> int:
    """Runs the demo; 0 where all went well. Without `exit_after` the service runs on until interrupted.

    Whatever ends the demo, a termination signal included, ends its service first.

    browser  whether to open the page in a browser, where there is one
    """
    console = console or Console()
    for recording in recordings:
        if not Path(recording).exists():
            raise InputError(f"{recording}: there is no such recording to replay")
    try:
        with _termination_raises():
            return _run(settings, exit_after, [Path(r) for r in recordings], console, command, browser)
    except Terminated:
        console.print("ended")
        return TERMINATED


def _run(
    settings: Settings,
    exit_after: bool,
    recordings: Sequence[Path],
    console: Console,
    command: Sequence[str],
    browser: bool,
) -> int:
    with ExitStack() as stack:
        settings = _on_free_ports(settings, stack)
        try:
            service = stack.enter_context(_service(settings, command))
            address = f"http://{settings.http}"
            console.print(f"Page:  {address}/    REST:  {address}/docs", highlight=False)
            if browser:
                _open(f"{address}/")
            for recording in recordings:
                asset, answer = _replayed(settings, address, recording, service, console)
                counts = next(a for a in _get(f"{address}/v1/assets") if a["asset"] == asset)
                console.print(_summary(counts, answer))
                _demand(answer, answer.get("data_quality", {}).get("windows", {}))
        except (DemoFailed, DeliveryError) as error:
            console.print(f"[bold red]failed:[/] {error}", highlight=False)
            return 1
        if not exit_after:
            console.print(f"Service is running at {address}/. Press Ctrl-C to stop.", highlight=False)
            try:
                return service.wait()
            except KeyboardInterrupt:
                console.print("ended")
    return 0


def _open(address: str) -> None:
    """Opens the page in a graphical browser, where there is one; says nothing where there is none."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return
    with suppress(webbrowser.Error):
        webbrowser.open(address)


@contextmanager
def _termination_raises() -> Iterator[None]:
    """Raises Terminated on SIGTERM while inside; only the main thread may ask for that."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def terminate(*_: object) -> None:
        raise Terminated

    before = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _on_free_ports(settings: Settings, stack: ExitStack) -> Settings:
    """The settings with free loopback ports and a directory of its own for what was not given."""
    given = settings.model_fields_set
    changes: dict[str, Any] = {}
    ports = iter(random.sample(PORTS, TRIED))
    if "http" not in given:
        preferred = int(HTTP.rpartition(":")[2])
        changes["http"] = f"127.0.0.1:{free_port(itertools.chain([preferred], ports))}"
    if "listen" not in given:
        changes["listen"] = [f"tcp/127.0.0.1:{free_port(ports)}"]
    if "data" not in given:
        changes["data"] = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="gear-twin-")))
    if "idle_timeout" not in given:
        changes["idle_timeout"] = 1.0
    return settings.model_copy(update=changes)


def free_port(ports: Iterable[int]) -> int:
    """The first of some ports that is free on the loopback; DeliveryError where none is.

    It should lie below the range that outgoing connections are given from, or one of those could take it.
    """
    for port in ports:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise DeliveryError("no free loopback port is left; give --http and --listen")


@contextmanager
def _service(settings: Settings, command: Sequence[str]) -> Iterator[subprocess.Popen]:
    """`gear-twin serve` with the settings, ready, until left."""
    environment = os.environ | {
        f"GEAR_TWIN_{name.upper()}": value if isinstance(value, str) else json.dumps(value)
        for name, value in settings.model_dump(mode="json").items()
        if value is not None
    }
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(list(command), env=environment, stdout=said, stderr=said)
        try:
            _await_start(process, said, settings.http)
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(STOP_WAIT)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


def _await_start(process: subprocess.Popen, said: IO[bytes], http: str) -> None:
    """Returns once this very process says that it serves, and accepts frames: another may hold the address."""
    deadline = time.monotonic() + START_WAIT
    while True:
        output = os.pread(said.fileno(), MOST_SAID, 0).decode(errors="replace")  # leaves the process's own position
        if process.poll() is not None or time.monotonic() > deadline:
            raise DemoFailed(f"the service did not start: {output.strip() or 'it printed nothing'}")
        if SERVES in output and _get(f"http://{http}/readyz") is not None:
            return
        time.sleep(POLL)


def _replayed(
    settings: Settings, address: str, recording: Path, service: subprocess.Popen, console: Console
) -> tuple[str, dict[str, Any]]:
    """The asset and its state after the whole recording has gone through the service."""
    _, metadata, windows = read_windows(recording, assembly_settings(settings))
    expected = len(windows)
    endpoints = settings.connect or settings.listen
    failed: list[Exception] = []

    def deliver() -> None:
        try:
            replay(recording, endpoints, 0, prefix=settings.prefix, recorded=PREFIX)
        except Exception as error:
            failed.append(error)

    delivering = threading.Thread(target=deliver, daemon=True)
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("windows"),
        TimeElapsedColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(f"Replaying {recording.name}", total=expected)
        before = sum(_window_counts(address).values())
        delivering.start()
        newest, since, replayed = 0, time.monotonic(), dict[str, int]()
        while newest < expected:
            time.sleep(POLL)
            if failed:
                raise DemoFailed(f"the replay failed: {failed[0]}")
            if service.poll() is not None:
                raise DemoFailed(f"the service ended with status {service.returncode}")
            replayed = _window_counts(address)
            taken = sum(replayed.values()) - before
            if taken > newest:
                newest, since = taken, time.monotonic()
                progress.update(task, completed=newest)
            elif time.monotonic() - since > STALL_WAIT:
                raise DemoFailed(f"{newest} of {expected} windows after {STALL_WAIT:g} s of waiting")
    delivering.join()
    asset = metadata.get("asset") or sorted(replayed)[0]
    answer = _get(f"{address}/v1/assets/{asset}")
    if answer is None:
        raise DemoFailed(f"the service does not know {asset}")
    return asset, answer


def _window_counts(address: str) -> dict[str, int]:
    """How many windows the service has of each asset."""
    return {a["asset"]: a["windows"] for a in _get(f"{address}/v1/assets") or []}


def _demand(answer: Mapping[str, Any], quality: Mapping[str, int]) -> None:
    """What the demo must show."""
    if quality.get("refused"):
        raise DemoFailed(f"{quality['refused']} windows were refused")
    for part in ("wear", "rul"):
        if not is_available(answer[part]):
            raise DemoFailed(f"{part} is not available: {answer[part].get('reason')}")


def _summary(counts: Mapping[str, Any], answer: Mapping[str, Any]) -> Table:
    """The state of the asset, and its entry in the list of assets, in a few lines."""
    windows, wear, rul = answer["windows"], answer["wear"], answer["rul"]
    last = windows[-1] if windows else {}
    table = Table(title=f"{counts['asset']} after {_number(last.get('revolutions'), 6)} revolutions", show_header=False)
    status = answer["status"]
    table.add_row("status", "\n".join([status["level"].replace("_", " "), *status["reasons"]]))
    table.add_row("windows", str(counts["windows"]))
    table.add_row("updates", str(counts["updates"]))
    if is_available(wear):
        table.add_row("K", f"{_number(wear['k_wear_per_n'])} /N")
        table.add_row("maximum wear depth", _band(wear["max_depth_um"], "combined", "µm"))
    else:
        table.add_row("wear", f"not available: {wear.get('reason')}")
    if is_available(rul):
        table.add_row("remaining life", _band(rul, "hours", "h"))
        table.add_row("", _band(rul, "revolutions", "revolutions"))
    else:
        table.add_row("remaining life", f"not available: {rul.get('reason')}")
    table.add_row("RMS error, latest window", f"{_number(last.get('error_percent'), 2)} %")
    return table


def _band(part: Mapping[str, Any], name: str, unit: str) -> str:
    band = part.get(name)
    if band is None or not is_available(band):
        return "not available"
    return f"{_number(band['median'])} {unit} (5–95 %: {_number(band['p05'])} to {_number(band['p95'])})"


def _number(value: float | None, digits: int = 3) -> str:
    return "–" if value is None else f"{value:.{digits}g}"


def _get(url: str) -> Any:
    """The JSON at an address; None where it is not answered."""
    try:
        with urllib.request.urlopen(url, timeout=10) as answer:
            return json.load(answer)
    except (urllib.error.URLError, ConnectionError, TimeoutError):
        return None
