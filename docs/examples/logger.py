"""A logger that loses nothing: publishes an accelerometer and an encoder, and keeps every frame until it is stored.

    python docs/examples/logger.py --connect tcp/127.0.0.1:7447 --asset press-7 --seconds 30

Needs the packages eclipse-zenoh and protobuf, and the module that protoc makes from gearbox.proto (here that of
gear-twin itself). In place of `measured` comes the data acquisition. Ends with status 0 once all frames are stored.
"""

import argparse
import json
import math
import sys
import time
from collections import deque

import zenoh
import zenoh.ext

from service.stream.wire import gearbox_pb2

FRAME = 0.5  # [s]
RATE = 2000  # of the accelerometer [Hz]
EDGES, SPEED = 64, 10.0  # of the encoder a turn; of the shaft [Hz]
ASK_EVERY = 2.0  # [s]
ANSWER = 12.0  # longest wait for an answer [s]; the service answers within 10 s
KEEP = 200 * 2**20  # frames kept at most [bytes]; enough for the longest outage that nothing may be lost in
GIVE_UP = 120.0  # how long the end waits while nothing more is stored [s]


class KeptFrames:
    """Publishes the frames of one asset, and keeps them until the service has stored them."""

    def __init__(self, session: zenoh.Session, asset: str):
        self.session, self.asset = session, asset
        self.publishers = {}
        self.kept = deque()  # (label, sequence, start_time_ns, payload), in the order of sending
        self.bytes = self.lost = 0
        self.last = {}  # label: (sequence, start_time_ns) of the newest frame sent
        self.instance = None  # of the service that answered last
        self.probes, self.routers = [], None  # by which a lost link is noticed
        self.lost_link = False  # since then nothing is sent before what is kept has been sent again

    def declare(self, label: str, message: str) -> None:
        """A channel, such as accel/y6. Reliable and blocking: nothing is dropped on a link that is only slow."""
        self.publishers[label] = zenoh.ext.declare_advanced_publisher(
            self.session,
            f"gearbox/{self.asset}/{label}",
            encoding=f"application/protobuf;gearbox.v1.{message}",
            reliability=zenoh.Reliability.RELIABLE,
            congestion_control=zenoh.CongestionControl.BLOCK,
            sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=0.5, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        probe = self.session.declare_publisher(f"gearbox/{self.asset}/{label}")
        self.probes.append((probe, probe.declare_matching_listener(self.note_matching)))
        self.routers = self.session.info.routers_zid()
        self.lost_link |= not probe.matching_status.matching

    def publish(self, label: str, frame) -> None:
        """Sends one frame, and keeps it."""
        payload = frame.SerializeToString()
        self.kept.append((label, frame.sequence, frame.start_time_ns, payload))
        self.bytes += len(payload)
        while self.bytes > KEEP:  # an outage longer than the memory: say so
            self.bytes -= len(self.kept.popleft()[3])
            self.lost += 1
        self.lost_link |= self.session.info.routers_zid() != self.routers
        if self.lost_link:
            self.last[label] = (frame.sequence, frame.start_time_ns)  # sent behind the frames before it, by `settle`
        else:
            self.put(label, frame.sequence, frame.start_time_ns, payload)

    def note_matching(self, status) -> None:
        """The service has come or gone."""
        self.lost_link |= not status.matching

    def put(self, label: str, sequence: int, start: int, payload: bytes) -> None:
        self.publishers[label].put(payload)
        self.last[label] = (sequence, start)

    def settle(self) -> bool:
        """Asks what is stored, and forgets it; sends again what has been lost. Whether everything is stored."""
        answer = self.ask()
        if answer is None or not answer["accepting"] or answer["behind"]:
            return False  # nobody is there, or cannot store anything now: everything is kept
        channels = answer["channels"]
        come = all(
            label in channels and channels[label]["start_time_ns"] >= start for label, (_, start) in self.last.items()
        )
        restarted = self.instance not in (None, answer["instance"])
        self.instance = answer["instance"]
        if restarted or self.lost_link or not come:
            self.send_again()
            return False
        held_from = answer["unsettled_from_ns"]
        self.kept = deque(each for each in self.kept if held_from is not None and each[2] >= held_from)
        self.bytes = sum(len(each[3]) for each in self.kept)
        return not self.kept

    def ask(self):
        """The position of the asset's stream; None where nobody answers."""
        for reply in self.session.get(f"gearbox/{self.asset}/twin/position", timeout=ANSWER):
            if reply.ok is not None:
                return json.loads(reply.ok.payload.to_bytes())
        return None

    def send_again(self) -> None:
        """Sends all that is kept, in order: a service that came back must not get newer frames first."""
        self.routers, self.lost_link = self.session.info.routers_zid(), False
        for each in list(self.kept):
            self.put(*each)


def measured(frame: int, start_ns: int):
    """What the instruments give for one frame: replace by the data acquisition."""
    times = [(frame * round(RATE * FRAME) + i) / RATE for i in range(round(RATE * FRAME))]
    first = math.ceil(frame * FRAME * SPEED * EDGES - 1e-9)
    last = math.ceil((frame + 1) * FRAME * SPEED * EDGES - 1e-9)
    accel = gearbox_pb2.SampleFrame(
        start_time_ns=start_ns,
        sample_rate_hz=RATE,
        sequence=frame,
        values=[5 * math.sin(1193.8 * t) + math.sin(7001 * t * t) for t in times],
    )
    encoder = gearbox_pb2.EncoderFrame(
        start_time_ns=start_ns,
        edges_per_rev=EDGES,
        sequence=frame,
        first_edge_index=first,
        edge_offset_ns=[max(n / (SPEED * EDGES) - frame * FRAME, 0.0) * 1e9 for n in range(first, last)],
    )
    return accel, encoder


def opened(endpoint: str) -> zenoh.Session:
    """A session that comes back by itself after an outage."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "-1")
    config.insert_json5("connect/retry", '{"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}')
    block = "transport/link/tx/queue/congestion_control/block/wait_before_close"
    config.insert_json5(block, "10000000")  # µs; a link that is stuck for longer is opened anew
    return zenoh.open(config)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
    parser.add_argument("--asset", default="logged")
    parser.add_argument("--seconds", type=float, default=30.0)
    given = parser.parse_args()
    with opened(given.connect) as session:
        frames = KeptFrames(session, given.asset)
        frames.declare("accel/y6", "SampleFrame")
        frames.declare("encoder/pinion", "EncoderFrame")
        begun, asked = time.time_ns(), time.monotonic()
        for number in range(round(given.seconds / FRAME)):
            start = begun + round(number * FRAME * 1e9)
            time.sleep(max(start / 1e9 + FRAME - time.time(), 0.0))
            accel, encoder = measured(number, start)
            frames.publish("accel/y6", accel)
            frames.publish("encoder/pinion", encoder)
            if time.monotonic() - asked >= ASK_EVERY:
                frames.settle()
                asked = time.monotonic()
        end = time.monotonic() + GIVE_UP
        while not frames.settle() and time.monotonic() < end:
            time.sleep(0.5)
        if frames.kept or frames.lost:
            print(f"{len(frames.kept) + frames.lost} frames are not known to be stored", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
