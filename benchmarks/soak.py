"""Many machines in real time, one of them being traced all the while: memory, lag and answers of the service.

    python -m benchmarks.soak [--assets 20] [--channels 4] [--minutes 30] [--workers 2] [--json OUT] [--data DIR]

A machine with new gears and one at some wear are simulated at 25.6 kHz. Every channel of acceleration beyond the first
is a copy with its own noise. Each asset first sends the calibration, the new gears and SETTLING in all, as quickly as
the windows are processed: the twin traces the first windows of any machine that the rig file does not describe exactly,
and the soak is to show the years after. Then the time begins: each asset sends 50 s of signal every 52 s, which the
service cuts into windows of 10 s; assets are apart in time. One more asset sends the bundled campaign of a cracked
tooth as soon as the one before is processed, with new gears each time, so that a worker traces all the time. The twin,
the store and the workers are those of `gear-twin serve`, with the setting `worker_cache_bytes` at CACHE.

Printed: windows sent and processed, the backlog of each asset, processor time and memory by minute, and the times of
answers of REST. Ends with 1 where memory grows by more than GROWTH after WARM_UP, the 99th percentile of an answer's
time exceeds SLOWEST, or an asset's backlog is ever more than APART windows above the median of the others.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from prometheus_client.parser import text_string_to_metric_families

from benchmarks.long_recording import bursts, repeated
from benchmarks.long_run.service import Service, serving
from recordings.generator.deliver import simulate_file
from service.stream.frames import NS, Frame, SampleFrame
from service.stream.sources.mcap import RawFrame, Recording
from service.stream.wire.codec import encode
from service.stream.wire.topics import Channel
from service.transport.zenoh import ZenohPublisher, open_publisher

ROOT = Path(__file__).parents[1]
CRACKED = ROOT / "recordings" / "faulty-campaign.mcap"
SPEC = """
schema = "gear-campaign/1"
rig = "{rig}"
asset = "soak"
started = "2026-02-02T08:00:00+00:00"
seed = 5
[wear]
k_m2_per_n = 6.07e-12
from_revolutions = 47
contact_half_width_um = 200
[machine]
mesh_stiffness_scale = 0.9
[[calibration]]
speed_hz = 2.0
torque_nm = 10.0
seconds = 3.0
[[calibration]]
speed_hz = 2.0
torque_nm = 20.0
seconds = 3.0
[[conditions]]
speed_hz = 10.0
torque_nm = 10.0
[sensors]
acceleration_rate_hz = 25600
[windows]
seconds = 50
at_revolutions = [0, 700]
"""
PORT = 17_900
TRACED = "traced"
FIRST = "accel/y6"
BEGIN = 1000 * NS  # of a schedule
PERIOD = 52.0  # of a machine's signal [s]
SETTLING = 220.0  # of signal that each asset sends before the time begins [s]: 22 windows, to the end of a burst
SETTLED_AGO = 3600 * NS  # how long before its sending that signal is dated
WAITING = 4  # windows of all assets that may wait while the machines settle
NOISE = 0.1  # of the copies of the accelerometer [m/s²]
CACHE = 64 * 2**20  # wear curves that a worker keeps [bytes]: full within the warm-up, as the default is after hours
WARM_UP = 1 / 3  # share of the time after which memory is to be flat
GROWTH = 1.05
SLOWEST = 50.0  # [ms]
APART = 2.0  # windows
EACH = 0.25  # between two requests [s]
ROUTES = ("/v1/assets", "/v1/assets/{0}", "/v1/assets/{0}/wear", "/v1/assets/{0}/windows?limit=100",
          "/v1/assets/{0}/trend?resolution=100", "/healthz", "/readyz")  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Minute:
    """What was seen at the end of a minute."""

    minute: float
    memory: float  # of the service with its workers [MB]
    cpu: float  # of one core, since the minute before
    windows: int  # processed, of all assets but the traced one
    backlog: tuple[int, ...]  # by asset
    traced: int  # campaigns of the traced asset


@dataclass(slots=True)
class Outcome:
    """What the whole time was like."""

    assets: int
    channels: int
    minutes: list[Minute] = field(default_factory=list)
    answers: list[float] = field(default_factory=list)  # [ms]
    late: float = 0.0  # how far the sender fell behind at most [s]
    apart: int = 0  # windows that an asset's backlog was above the median at most
    findings: list[str] = field(default_factory=list)


# -- what is sent --------------------------------------------------------------------------------------


def simulated(folder: Path) -> Path:
    """A recording of the machine at 25.6 kHz."""
    spec, path = folder / "soak.toml", folder / "soak.mcap"
    spec.write_text(SPEC.format(rig=ROOT / "recordings" / "rigs" / "unsw.toml"))
    simulate_file(str(spec), str(path), None, lambda share, what: None)
    return path


def _refuse(channel: object, error: Exception) -> None:
    raise error


def of_asset(frame: Frame, asset: str, channels: int, shift: int) -> Iterator[Frame]:
    """The frame as another machine sends it at another time, with its further accelerometers."""
    channel = frame.channel._replace(asset=asset)
    moved = replace(frame, channel=channel, start_time_ns=frame.start_time_ns + shift)
    yield moved
    if isinstance(moved, SampleFrame) and channel.kind == "accel":
        rng = np.random.default_rng([crc32(asset.encode()), frame.sequence % 2**32])
        for number in range(1, channels):
            noise = rng.normal(0.0, NOISE, moved.values.size).astype(np.float32)
            yield replace(moved, channel=channel._replace(name=f"a{number}"), values=moved.values + noise)


def schedule(path: Path, seconds: float) -> list[Frame]:
    """The frames of one machine for so long, the first at BEGIN; pauses of the campaign are shortened."""
    with Recording(path) as recording:
        campaign = bursts(recording.frames(_refuse))
    sent, at = [], BEGIN
    for burst in campaign[:-1]:
        start = burst[0].start_time_ns
        sent += [replace(f, start_time_ns=f.start_time_ns - start + at) for f in burst]
        at = max(f.end_time_ns for f in sent) + 3 * NS
    last = campaign[-1]
    back = at - next(iter(repeated(last, 1.0))).start_time_ns
    sent += [replace(f, start_time_ns=f.start_time_ns + back) for f in repeated(last, seconds)]
    return [f for f in sorted(sent, key=lambda f: f.end_time_ns) if f.end_time_ns < BEGIN + seconds * NS]


@dataclass(frozen=True, slots=True)
class Sender:
    """The machines, and what other processes see of their sending."""

    frames: Sequence[Frame]
    names: Sequence[str]
    channels: int
    sent: Any  # frames of the first channel, by asset
    late: Any  # the most that sending fell behind [s]
    settled: Any  # event: the time has begun

    def publish(self, publisher: ZenohPublisher, k: int, frame: Frame, shift: int) -> None:
        """One frame of one asset, with those of its further accelerometers."""
        for one in of_asset(frame, self.names[k], self.channels, shift):
            publisher.publish(RawFrame(one.channel, one.end_time_ns, encode(one)))
            if one.channel.label == FIRST:
                self.sent[k] += 1

    def settle(self, publisher: ZenohPublisher, address: str) -> None:
        """Sends SETTLING of every asset, a burst of each in turn, so that few windows wait."""
        shift = time.time_ns() - SETTLED_AGO - BEGIN
        for burst in bursts([f for f in self.frames if f.end_time_ns < BEGIN + SETTLING * NS]):
            for k in range(len(self.names)):
                for frame in sorted(burst, key=lambda f: f.end_time_ns):
                    self.publish(publisher, k, frame, shift)
                self.wait(address, WAITING)
        self.wait(address, 0)

    def wait(self, address: str, most: int) -> None:
        """Until all frames that were sent are received, and at most so many windows wait."""
        while True:
            received = _by_asset(address, "gear_twin_frames")
            if all(received.get(name, 0) >= sent for name, sent in zip(self.names, self.sent, strict=True)) and (
                sum(backlog(self.names, address)) <= most
            ):
                return
            time.sleep(0.2)

    def in_real_time(self, publisher: ZenohPublisher) -> None:
        """Sends the frames after SETTLING when they end."""
        apart, begin = PERIOD / len(self.names), BEGIN + round(SETTLING * NS)
        frames = [f for f in self.frames if f.end_time_ns >= begin]
        order = sorted(
            ((f.end_time_ns - begin) / NS + k * apart, k, n)
            for k in range(len(self.names))
            for n, f in enumerate(frames)
        )
        begun, origin = time.monotonic(), time.time_ns()
        for at, k, n in order:
            now = time.monotonic() - begun
            if at > now:
                time.sleep(at - now)
            else:
                self.late.value = max(self.late.value, now - at)
            self.publish(publisher, k, frames[n], origin - begin + round(k * apart * NS))


def send(
    path: Path, endpoint: str, address: str, assets: int, channels: int, seconds: float, rig: bytes,
    sent: Any, late: Any, settled: Any,
) -> None:  # fmt: skip
    """Settles all machines, says so, and publishes their frames in real time."""
    sender = Sender(schedule(path, SETTLING + seconds), asset_names(assets), channels, sent, late, settled)
    labels = {f.channel for f in sender.frames}
    with open_publisher([endpoint]) as publisher:
        for name in sender.names:
            publisher.offer_rig(name, rig)
        publisher.declare(
            Channel(name, c.kind, f"a{n}" if n else c.name)
            for name in sender.names for c in labels for n in range(channels if c.kind == "accel" else 1)
        )  # fmt: skip
        sender.settle(publisher, address)
        settled.set()
        sender.in_real_time(publisher)


def keep_tracing(endpoint: str, address: str, seconds: float, rig: bytes, passes: Any, settled: Any) -> None:
    """Sends the campaign of a cracked tooth again and again, with new gears, as soon as it is processed."""
    settled.wait()
    with Recording(CRACKED) as recording:
        frames = sorted(recording.frames(_refuse), key=lambda f: f.end_time_ns)
    length, count = frames[-1].end_time_ns - frames[0].start_time_ns, len(bursts(frames))
    numbers = {c: sum(f.channel == c for f in frames) for c in {f.channel for f in frames}}
    end = time.monotonic() + seconds
    with open_publisher([endpoint]) as publisher:
        publisher.offer_rig(TRACED, rig)
        publisher.declare(c._replace(asset=TRACED) for c in numbers)
        shift = time.time_ns() - length - frames[0].start_time_ns
        for copy in range(sys.maxsize):
            for frame in frames:
                sequence = frame.sequence + copy * numbers[frame.channel]
                start = frame.start_time_ns + shift + copy * (length + 60 * NS)
                channel = frame.channel._replace(asset=TRACED)
                moved = replace(frame, channel=channel, sequence=sequence, start_time_ns=start)
                publisher.publish(RawFrame(channel, moved.end_time_ns, encode(moved)))
            _await(lambda: _processed(address).get(TRACED, 0) == count, end)
            change = json.dumps({"kind": "gears_replaced", "by": "soak", "revolutions": 0.0}).encode()
            request = urllib.request.Request(
                f"{address}/v1/assets/{TRACED}/changes", change, {"Content-Type": "application/json"}
            )
            urllib.request.urlopen(request, timeout=60).close()
            _await(lambda: _processed(address).get(TRACED, 0) < count, end)
            passes.value += 1


def _await(condition: Callable[[], bool], end: float) -> None:
    while not condition():
        if time.monotonic() > end:
            raise SystemExit
        time.sleep(0.1)


def _processed(address: str) -> dict[str, int]:
    with urllib.request.urlopen(address + "/v1/assets", timeout=60) as answer:
        return {row["asset"]: row["windows"] for row in json.loads(answer.read())}


# -- what is seen --------------------------------------------------------------------------------------


def asset_names(count: int) -> list[str]:
    """Names of so many assets."""
    return [f"asset-{k:03d}" for k in range(count)]


def backlog(names: Sequence[str], address: str) -> tuple[int, ...]:
    """Windows of each asset that are received whole and are not processed."""
    waiting = _by_asset(address, "gear_twin_backlog_windows")
    return tuple(int(waiting.get(name, 0)) for name in names)


def _by_asset(address: str, metric: str) -> dict[str, float]:
    """A metric of every asset; of the first accelerometer, where it has channels."""
    with urllib.request.urlopen(address + "/metrics", timeout=60) as answer:
        families = {family.name: family for family in text_string_to_metric_families(answer.read().decode())}
    samples = families[metric].samples if metric in families else []
    return {s.labels["asset"]: s.value for s in samples if s.labels.get("channel", FIRST) == FIRST}


def watch(service: Service, outcome: Outcome, seconds: float, passes: Any) -> None:
    """Asks the service for so long, and notes what it answers and uses."""
    begun, minutes, cpu = time.monotonic(), 0, service.cpu()
    names, rng = asset_names(outcome.assets), np.random.default_rng(1)
    while (now := time.monotonic() - begun) < seconds:
        route = ROUTES[rng.integers(len(ROUTES))].format(names[rng.integers(len(names))])
        asked = time.perf_counter()
        try:
            with urllib.request.urlopen(service.address + route, timeout=60) as answer:
                answer.read()
        except urllib.error.HTTPError as error:  # an asset that has not sent anything yet
            error.close()
            if error.code != 404:
                outcome.findings.append(f"{route} was answered by {error.code}")
        outcome.answers.append(1e3 * (time.perf_counter() - asked))
        if now >= 60 * (minutes + 1):
            minutes += 1
            behind = backlog(names, service.address)
            outcome.apart = max(outcome.apart, max(behind) - int(np.median(behind)))
            used = service.cpu()
            outcome.minutes.append(Minute(
                minute=now / 60, memory=service.memory(), cpu=(used - cpu) / 60, backlog=behind,
                windows=sum(done for name, done in _processed(service.address).items() if name != TRACED),
                traced=passes.value,
            ))  # fmt: skip
            cpu = used
            print(line_of(outcome.minutes[-1]), flush=True)
        time.sleep(EACH)


def line_of(minute: Minute) -> str:
    """One minute, to be read."""
    return (
        f"{minute.minute:6.1f} min  {minute.memory:7.0f} MB  {minute.cpu:5.2f} cores  {minute.windows:6d} windows, "
        f"backlog {min(minute.backlog)} to {max(minute.backlog)} (median {np.median(minute.backlog):g}), "
        f"{minute.traced} campaigns traced"
    )


def judge(outcome: Outcome) -> None:
    """Adds what misses an aim to the findings."""
    rest = outcome.minutes[int(len(outcome.minutes) * WARM_UP) :]
    if len(rest) >= 4:
        half = len(rest) // 2
        before, after = (np.median([m.memory for m in part]) for part in (rest[:half], rest[half:]))
        print(f"memory after the warm-up: {before:.0f} MB in the first half, {after:.0f} MB in the second")
        if after > GROWTH * before:
            outcome.findings.append(f"memory grew from {before:.0f} to {after:.0f} MB")
    middle, high = np.percentile(outcome.answers, (50, 99))
    print(f"{len(outcome.answers)} answers: median {middle:.1f} ms, 99th percentile {high:.1f} ms")
    if high > SLOWEST:
        outcome.findings.append(f"answers of REST: 99th percentile {high:.0f} ms, more than {SLOWEST:g} ms")
    if outcome.apart > APART:
        outcome.findings.append(f"an asset was {outcome.apart} windows behind the median of the others")
    if outcome.late > 1.0:
        outcome.findings.append(f"the sender fell {outcome.late:.1f} s behind: this machine does not sustain the load")


def main(arguments: list[str] | None = None) -> int:
    """Runs the soak; 1 where an aim is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__.splitlines()[0])
    parser.add_argument("--assets", type=int, default=20)
    parser.add_argument("--channels", type=int, default=4, help="of acceleration, each asset")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--workers", type=int, default=2, help="worker processes of the service")
    parser.add_argument("--no-traced", action="store_true", help="leave out the machine that is traced all the time")
    parser.add_argument("--data", type=Path, help="folder of the service's data and of the recording, kept")
    parser.add_argument("--json", type=Path, help="file for the figures")
    given = parser.parse_args(arguments)
    outcome, seconds = Outcome(assets=given.assets, channels=given.channels), 60 * given.minutes + 5
    context = multiprocessing.get_context("spawn")
    late, passes, sent = context.Value("d", 0.0), context.Value("q", 0), context.Array("q", given.assets)
    settled = context.Event()
    with tempfile.TemporaryDirectory() as folder:
        data = given.data or Path(folder)
        data.mkdir(parents=True, exist_ok=True)
        path = simulated(data)
        with Recording(path) as recording:
            rig = recording.rig_text or b""
        with serving(
            data / "service", PORT, program=("service", "serve"), workers=given.workers, worker_cache_bytes=CACHE
        ) as service:
            machines = (path, service.endpoint, service.address, given.assets, given.channels, seconds, rig)
            senders = [context.Process(target=send, args=(*machines, sent, late, settled))]
            if not given.no_traced:
                traced = (service.endpoint, service.address, seconds, rig, passes, settled)
                senders.append(context.Process(target=keep_tracing, args=traced))
            for each in senders:
                each.start()
            begun = time.monotonic()
            while not settled.wait(1.0):
                if not senders[0].is_alive():
                    raise SystemExit("the sender of the machines ended before they were settled")
            print(f"{given.assets} machines settled in {time.monotonic() - begun:.0f} s", flush=True)
            watch(service, outcome, seconds, passes)
            for each in senders:
                each.terminate()
                each.join()
            outcome.late = late.value
    judge(outcome)
    if given.json:
        given.json.write_text(json.dumps(asdict(outcome), indent=1))
    print(*outcome.findings, sep="\n")
    return bool(outcome.findings)


if __name__ == "__main__":
    sys.exit(main())
