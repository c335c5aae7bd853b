"""What reception costs: frames of many assets from the inbox to closed windows, without the twin and the store.

    python -m benchmarks.bench_ingest [--assets 20] [--channels 4] [--rate 25600] [--seconds 60]

Prints the processor time for one second of all streams, by part: the callbacks' share (putting payloads into the
queues), decoding, and the assembly with its windows, with the share of one core that they take in real time.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from benchmarks.bench_pipeline import Figure
from service.runtime.intake import Intake
from service.runtime.outcomes import ClosedWindow
from service.runtime.pump import Pump
from service.runtime.reception import Reception
from service.stream.assembly import AssemblySettings
from service.stream.frames import NS, SampleFrame
from service.stream.inbox import Inbox
from service.stream.wire.codec import decode, encode
from service.stream.wire.topics import Channel, topic_of
from twin.rig import Rig

FRAME = 0.25  # [s]
START = 1_700_000_000 * NS
AIM = 0.5  # of one core, in real time


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Processor time for one second of all streams [s]."""

    queueing: float
    decoding: float
    whole: float  # from the queue to closed windows, decoding included
    windows: int


def payloads(assets: int, channels: int, rate: float, step: int) -> list[tuple[str, Channel, bytes]]:
    """What all assets send in one frame's time."""
    rng = np.random.default_rng(step)
    values = rng.standard_normal(round(rate * FRAME)).astype(np.float32)
    sent = []
    for asset in range(assets):
        for number in range(channels):
            channel = Channel(f"asset-{asset}", "accel", f"a{number}")
            frame = SampleFrame(
                channel=channel,
                start_time_ns=START + round(step * FRAME * NS),
                sequence=step,
                sample_rate=rate,
                values=values,
            )
            sent.append((topic_of(channel), channel, encode(frame)))
    return sent


def measured(assets: int, channels: int, rate: float, seconds: float) -> Cost:
    """The cost of a stream of so many seconds."""
    closed: list[int] = []

    def close(window: ClosedWindow) -> None:
        closed.append(window.segment.start_ns)

    reception = Reception(lambda asset: Rig.from_mapping({}), close, assembly=AssemblySettings(clocked=True))
    now = [0.0]
    inbox = Inbox(frames=10**6, max_bytes=2**34)
    pump = Pump(inbox, Intake(reception, lambda asset: None), clock=lambda: now[0])
    queueing = decoding = whole = 0.0
    for step in range(round(seconds / FRAME)):
        sent = payloads(assets, channels, rate, step)
        begun = time.process_time()
        for topic, _, payload in sent:
            inbox.offer(topic, payload)
        queued = time.process_time()
        for _, channel, payload in sent:
            decode(channel, payload)
        decoded = time.process_time()
        now[0] += FRAME
        while (item := inbox.take(0.0)) is not None:
            pump.turn(item)
        pump.turn(None)
        queueing += queued - begun
        decoding += decoded - queued
        whole += time.process_time() - decoded
    return Cost(queueing=queueing / seconds, decoding=decoding / seconds, whole=whole / seconds, windows=len(closed))


def figures(cost: Cost) -> list[Figure]:
    """The cost and what is aimed at."""
    share = cost.queueing + cost.whole
    return [Figure(what="reception of 20 assets of 4 channels at 25.6 kHz", value=share, unit="core", aim=AIM)]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_ingest", description=__doc__.splitlines()[0])
    parser.add_argument("--assets", type=int, default=20)
    parser.add_argument("--channels", type=int, default=4)
    parser.add_argument("--rate", type=float, default=25600.0, help="samples a second of each channel")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the streams")
    given = parser.parse_args()
    cost = measured(given.assets, given.channels, given.rate, given.seconds)
    print(f"{given.assets} assets, {given.channels} channels each, {given.rate:g} Hz: {cost.windows} windows")
    for name, value in (("queueing", cost.queueing), ("decoding", cost.decoding), ("queue to windows", cost.whole)):
        print(f"{name:18} {1000 * value:8.1f} ms of processor a second of stream")
    print(f"share of one core in real time: {cost.queueing + cost.whole:.2f} (aim {AIM})")


if __name__ == "__main__":
    main()
