"""Between pump and pipeline: a new asset's channels are learned before its first window."""

from __future__ import annotations

from dataclasses import replace

from service_streams import Sink
from streams import ACCEL, ASSET, CHANNELS, bursts

from service.errors import FrameError, StorageUnavailable
from service.runtime.intake import Intake
from service.runtime.learning_phase import LearningPhase
from service.runtime.pipeline import Pipeline
from service.runtime.reception import Reception
from service.runtime.storage_watch import StorageWatch
from service.runtime.twin_port import Answer, Twin
from twin.rig import Rig


def numbered(rig, state, window, options):
    return state, Answer(record={}, report={}, events=())


def make(outcomes, shown, now, **learning):
    twin = Twin(step=numbered, new_state=dict, load_state=dict)
    pipeline = Pipeline(lambda asset: Rig.from_mapping({}), twin, Sink(outcomes))
    return Intake(pipeline, shown.append, learning=LearningPhase(**learning), clock=lambda: now[0])


def by_channel(frames):
    """The channels of a machine one after the other: the last begins when the first has ended."""
    return [f for channel in CHANNELS for f in frames if f.channel == channel]


def test_first_window_has_the_channels_that_begin_last():
    outcomes, shown, now = [], [], [0.0]
    intake = make(outcomes, shown, now)
    frames = bursts(2)
    for frame in by_channel(frames[: len(frames) // 2]):
        intake.feed(frame)
    assert outcomes == [] and intake.waiting(ASSET)
    now[0] = 1.0
    for frame in frames[len(frames) // 2 :]:
        intake.feed(frame)
    intake.flush(ASSET)
    assert len(outcomes) == 2
    assert set(outcomes[0].window.encoders) == {"pinion", "gear"} and outcomes[0].window.torques


def test_frames_that_are_held_to_learn_the_channels_have_come():
    """A gateway was told that they had not, and held up all its other machines for 1.5 s."""
    intake = Intake(
        Reception(lambda asset: Rig.from_mapping({}), lambda closed: None), lambda asset: None, clock=lambda: 0.0
    )
    frames = bursts(2)
    for frame in frames:
        intake.feed(frame)
    found = intake.position(ASSET)
    assert found.unsettled_from_ns == frames[0].start_time_ns
    assert {label: (each.sequence, each.start_ns) for label, each in found.channels.items()} == {
        frame.channel.label: (frame.sequence, frame.start_time_ns) for frame in frames
    }


def test_held_frames_of_an_asset_are_bounded():
    outcomes, shown = [], []
    intake = make(outcomes, shown, [0.0], wait=3600.0, most_bytes=20_000)
    for frame in bursts(8):
        intake.feed(frame)
    assert outcomes


def test_silence_ends_the_learning_phase_with_the_window():
    outcomes, shown = [], []
    intake = make(outcomes, shown, [0.0])
    for frame in bursts(1):
        intake.feed(frame)
    intake.flush(ASSET)
    assert len(outcomes) == 1


def test_counters_are_shown_once_a_second_while_frames_come_and_once_more_in_silence():
    outcomes, shown, now = [], [], [0.0]
    intake = make(outcomes, shown, now, wait=0.0)
    frames = bursts(1)
    for n, frame in enumerate(frames):
        now[0] = 0.125 * n
        intake.feed(frame)
    assert len(shown) == 3  # at 0, 1.125 and 2.25 s
    intake.flush(ASSET)
    assert not intake.waiting(ASSET) and not intake.waiting(ASSET)
    assert len(shown) == 4
    intake.reject(ACCEL, FrameError("values = nothing"))
    assert len(shown) == 5


def test_channels_announced_for_a_new_asset_while_the_storage_cannot_be_used_end_nothing():
    """Once the service ended: the rig file of the new asset could not be kept, and was asked for again."""
    outcomes, full = [], [True]

    def rig_of(asset):
        if full[0]:
            raise StorageUnavailable("the database cannot be used now (no space)", reason="no space")
        return Rig.from_mapping({})

    twin, now = Twin(step=numbered, new_state=dict, load_state=dict), [0.0]
    storage = StorageWatch("the database", clock=lambda: now[0])
    reception = Pipeline(rig_of, twin, Sink(outcomes))
    intake = Intake(reception, lambda asset: None, storage=storage, clock=lambda: now[0])
    frames = bursts(2)
    for frame in frames[:5]:
        intake.feed(frame)
    intake.expect(ASSET, [channel.label for channel in CHANNELS])
    assert storage.reason is not None and not intake.waiting(ASSET) and intake.position(ASSET) is None
    full[0], now[0] = False, 60.0
    for frame in frames[5:]:
        intake.feed(frame)
    intake.expect(ASSET, [channel.label for channel in CHANNELS])
    intake.flush(ASSET)
    assert len(outcomes) == 2 and intake.left_out == 0
    first = next(f for f in frames if f.channel == ACCEL)  # a window without its first frames was once committed
    assert outcomes[0].window.start_time_ns == first.start_time_ns
    assert [len(o.window.accelerations["y6"].values) for o in outcomes[:1]] == [
        len(o.window.accelerations["y6"].values) for o in outcomes[1:]
    ]


def test_first_frames_of_a_new_asset_are_held_within_a_bound_while_the_storage_cannot_be_used():
    def rig_of(asset):
        raise StorageUnavailable("the database cannot be used now (no space)", reason="no space")

    storage = StorageWatch("the database", clock=lambda: 0.0)
    reception = Pipeline(rig_of, Twin(step=numbered, new_state=dict, load_state=dict), Sink([]))
    intake = Intake(reception, lambda asset: None, storage=storage, held_bytes=20_000)
    frames = bursts(8)
    for frame in frames:
        intake.feed(frame)
    kept = len(frames) - intake.left_out
    assert 0 < kept < len(frames) and kept * min(frame.nbytes for frame in frames) <= 20_000


def test_first_frames_that_wait_for_the_storage_go_with_their_asset_to_another_name():
    """They were lost, and the room that they took was taken for good."""
    outcomes, full, now = [], [True], [0.0]

    def rig_of(asset):
        if full[0]:
            raise StorageUnavailable("the database cannot be used now (no space)", reason="no space")
        return Rig.from_mapping({})

    frames = bursts(2)
    storage = StorageWatch("the database", clock=lambda: now[0])
    reception = Pipeline(rig_of, Twin(step=numbered, new_state=dict, load_state=dict), Sink(outcomes))
    room = sum(frame.nbytes for frame in frames[:5])
    intake = Intake(reception, lambda asset: None, storage=storage, held_bytes=room, clock=lambda: now[0])

    def named(asset, some):
        return [replace(frame, channel=frame.channel._replace(asset=asset)) for frame in some]

    for frame in frames[:5]:
        intake.feed(frame)
    full[0], now[0] = False, 60.0
    for frame in frames[5:]:
        intake.feed(frame)
    intake.flush(ASSET)
    assert [o.asset for o in outcomes] == [ASSET] * 2
    assert outcomes[0].window.start_time_ns == frames[0].start_time_ns
    assert not any(outcome.window.faults for outcome in outcomes)
    full[0], now[0] = True, 120.0
    for frame in named("other", frames[:5]):
        intake.feed(frame)
    assert intake.left_out == 0  # there is room again
