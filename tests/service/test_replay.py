"""A stream over Zenoh TCP gives the windows of the file, however it is delivered, and the replay knows what arrived."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace
from unittest.mock import patch

import pytest
from fake_twin import JOINED
from service_streams import Sink, free_port, go_on
from streams import ASSET, bursts, content

from service.errors import DeliveryError, InputError
from service.runtime import pump
from service.runtime.pipeline import Pipeline
from service.runtime.positions import Positions
from service.runtime.record import record
from service.runtime.replay import paced, replay
from service.runtime.twin_port import Twin
from service.stream.inbox import BAD_KEY, SAY_ERRORS_EVERY, Inbox
from service.stream.sources.mcap import RawFrame, Recording, read_windows
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.windows import Windows
from service.stream.wire.codec import encode, encoding_of
from service.stream.wire.topics import topic_of
from service.transport.zenoh import ZenohTransport, open_publisher, open_session
from tests.streams import shuffled, twice
from twin.rig import Rig

IDLE = 0.7  # silence that ends a window [s]
WAIT = 3.0  # for a channel that the others have gone on without [s]


@pytest.fixture
def endpoint():
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings") / "small.mcap"
    with RecordingWriter(path) as writer:
        for frame in bursts(8, frames=10):
            writer.write(frame.channel, frame.end_time_ns, encode(frame))
    return path


def count_windows(rig, state, window, options):
    """Stands in for the twin: numbers the windows."""
    estimate = SimpleNamespace(record={"kind": "measurement", "seen": state["n"]}, report={"n": state["n"]}, events=())
    return {"n": state["n"] + 1}, estimate


MACHINE = {
    "sensors": {"accelerometer": "y6", "torque": "k_2_3*(th2-th3)"},
    "encoders": {"pinion_edges_per_rev": 64, "gear_edges_per_rev": 128},
}


def make_pipeline(outcomes):
    """A pipeline that knows the machine's channels: keys of a stream may arrive one after the other."""
    twin = Twin(step=count_windows, new_state=lambda: {"n": 0}, load_state=dict)
    return Pipeline(lambda asset: Rig.from_mapping(MACHINE), twin, Sink(outcomes))


@contextmanager
def receiving(endpoint, pipeline):
    """A router with a pipeline behind it, in this process."""
    inbox, stop = Inbox(), threading.Event()
    pipeline.refusal = lambda stream: None
    with (
        open_session(listen=[endpoint]) as session,
        ZenohTransport(session) as transport,
        Positions(inbox, transport, pipeline) as positions,
        transport.subscribe(inbox),
        patch.object(pump, "JOINED", JOINED),
    ):
        taking = pump.Pump(inbox, pipeline, IDLE, positions, channel_wait=WAIT)
        thread = threading.Thread(target=taking.run, args=(stop,))
        thread.start()
        try:
            yield inbox
        finally:
            stop.set()
            thread.join()


def until(condition, timeout=15.0):
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


@pytest.mark.parametrize(
    ("speed", "disturb"),
    [
        (0, lambda frames: frames),
        (0, twice),
        (0, lambda frames: shuffled(frames, 80)),
        pytest.param(0, lambda frames: shuffled(frames, 10**6, seed=3), marks=pytest.mark.slow),
        pytest.param(0, lambda frames: shuffled(twice(frames), 300), marks=pytest.mark.slow),
        (50, lambda frames: frames),
    ],
    ids=["once", "twice", "shuffled", "wholly shuffled", "twice and shuffled", "50 times as fast"],
)
def test_a_stream_gives_the_windows_of_the_file(recording, endpoint, speed, disturb):
    windows = read_windows(recording)[2]
    outcomes = []
    with receiving(endpoint, make_pipeline(outcomes)) as inbox:
        sent = replay(recording, [endpoint], speed, disturb=disturb)
        assert sent >= 320
        until(lambda: inbox.received >= sent and len(outcomes) >= 8)
        time.sleep(0.3)
    assert content([o.window for o in outcomes]) == content(windows)
    assert [o.index for o in outcomes] == list(range(8))
    assert (inbox.refused_frames, inbox.errors) == (0, 0)


@pytest.mark.slow
def test_a_receiver_that_goes_away_and_comes_back_misses_nothing(recording, endpoint):
    outcomes, sent = [], []
    sender = threading.Thread(target=lambda: sent.append(replay(recording, [endpoint], 20.0, max_pause=1.0)))
    first = make_pipeline(outcomes)
    with receiving(endpoint, first):
        sender.start()
        until(lambda: len(outcomes) >= 3)
    last = outcomes[-1]
    pipeline = make_pipeline(outcomes)
    go_on(pipeline, last, first.assemblies[ASSET])
    with receiving(endpoint, pipeline):
        sender.join()
        until(lambda: len(outcomes) >= 8)
        time.sleep(0.3)
    assert sent and sent[0] >= 320
    assert content([o.window for o in outcomes]) == content(read_windows(recording)[2])
    assert [o.record["seen"] for o in outcomes] == list(range(8))


@pytest.mark.slow
def test_a_plain_publisher_is_understood(endpoint):
    outcomes = []
    with receiving(endpoint, make_pipeline(outcomes)), open_session(connect=[endpoint]) as session:
        time.sleep(0.3)
        for frame in bursts(2):
            session.put(topic_of(frame.channel), encode(frame), encoding=encoding_of(frame.channel))
        until(lambda: len(outcomes) >= 2)
    assembler = Windows()
    windows = [w for frame in bursts(2) for w in assembler.add(frame)] + assembler.flush()
    assert content([o.window for o in outcomes]) == content(windows)


def test_channels_of_a_publisher_are_announced_while_it_is_there(recording, endpoint):
    with receiving(endpoint, make_pipeline([])) as inbox:
        with open_publisher([endpoint]) as publisher, Recording(recording) as source:
            publisher.declare(source.channels.values())
            until(lambda: len(inbox.announced(ASSET)) == 4)
        until(lambda: inbox.announced(ASSET) == ())


@pytest.mark.slow
def test_frames_that_break_the_contract_are_counted_and_told(endpoint):
    outcomes = []
    pipeline = make_pipeline(outcomes)
    with receiving(endpoint, pipeline), open_session(connect=[endpoint]) as session:
        time.sleep(0.3)
        frames = bursts(1)
        session.put(topic_of(frames[0].channel), b"\xff\xff")
        for frame in frames:
            session.put(topic_of(frame.channel), encode(frame))
        until(lambda: outcomes)
    quality = pipeline.quality(ASSET)
    assert quality["channels"]["accel/y6"]["invalid"] == 1
    assert "is no gearbox.v1.SampleFrame" in quality["faults"][0]["detail"]


@pytest.mark.slow
def test_a_replay_without_a_subscriber_fails_in_time_and_says_so(recording, endpoint):
    with open_session(listen=[endpoint]), pytest.raises(DeliveryError, match="no subscriber for gearbox/"):
        replay(recording, [endpoint], 0, wait=5.0)


def test_a_replay_without_a_router_fails_in_time_and_says_so(recording, endpoint):
    with pytest.raises(DeliveryError, match="no router answers at tcp/127"):
        replay(recording, [endpoint], 0, wait=0.5)


def test_an_endpoint_that_is_none_is_named(recording):
    with pytest.raises(InputError, match="endpoint nonsense is not one"):
        replay(recording, ["nonsense"], 0, wait=0.5)


def test_a_recorded_stream_has_the_windows_of_what_was_replayed(recording, endpoint, tmp_path):
    out, stop, inbox = tmp_path / "out.mcap", threading.Event(), Inbox()
    with open_session(listen=[endpoint]) as session:
        written = []
        thread = threading.Thread(
            target=lambda: written.append(
                record(ZenohTransport(session), inbox, out, stop=stop, rig_text=b"name = 'a'\n")
            )
        )
        thread.start()
        replay(recording, [endpoint], 0)
        stop.set()
        thread.join()
    assert written == [(320, 0, 0, 0)]
    rig, metadata, windows = read_windows(out)
    assert content(windows) == content(read_windows(recording)[2])
    assert rig == {"name": "a"} and metadata["asset"] == ASSET


def test_keys_that_break_the_contract_and_faults_in_callbacks_are_counted():
    inbox = Inbox()
    inbox.guarded(lambda: "gearbox/a/torque/motor", lambda: b"")
    inbox.guarded(lambda: "gearbox/a/accel/y6", lambda: 1 / 0)
    assert (inbox.refused, inbox.errors, inbox.depth) == ({BAD_KEY: 1}, 1, 0)


def test_exceptions_of_callbacks_are_logged_once_in_a_while_and_all_counted(caplog):
    now = [100.0]
    inbox = Inbox(clock=lambda: now[0])
    for _ in range(1000):
        inbox.guarded(lambda: "gearbox/a/accel/y6", lambda: 1 / 0)
    assert [("ZeroDivisionError" in r.getMessage(), r.exc_info is not None) for r in caplog.records] == [(True, True)]
    now[0] += SAY_ERRORS_EVERY
    inbox.guarded(lambda: "gearbox/a/accel/y6", lambda: b"", lambda: 1 / 0)
    assert inbox.errors == 1001 and "1001 such errors" in caplog.records[-1].getMessage()
    assert len(caplog.records) == 2


def test_a_paced_replay_keeps_the_time_of_the_recording():
    frames = [RawFrame(None, round(t * 1e9), b"") for t in (5.0, 5.1, 5.3, 25.3)]
    now = [100.0]

    def sleep(seconds):
        now[0] += seconds

    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=sleep)
    with patch("service.runtime.replay.time", clock):
        sent = [now[0] - 100.0 for _ in paced(frames, 2.0, max_pause=0.4)]
    assert sent == pytest.approx([0.0, 0.05, 0.15, 0.35], abs=1e-9)  # 0.1, 0.2 and 0.4 s at twice the pace
