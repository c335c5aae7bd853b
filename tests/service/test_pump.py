"""A window is closed in silence, and without a channel only where that channel is really late."""

from __future__ import annotations

from streams import CHANNELS, LENGTH, TORQUE, frame

from service.runtime.pump import _Rhythm


def rhythm_of(frames, idle=0.2, pace=0.01):
    """The rhythm of frames that came one after another."""
    rhythm, now = _Rhythm(idle, 0.0), 100.0
    for f in frames:
        rhythm.note(f, now, 0.0)
        now += pace
    return rhythm, now


def stream(bursts, but=()):
    return [frame(c, n, n * LENGTH) for n in range(bursts) for c in CHANNELS if (n, c) not in but]


def test_a_whole_window_is_closed_after_the_idle_timeout():
    rhythm, now = rhythm_of(stream(20))
    assert rhythm.patience(now) == rhythm.limit < 1.0


def test_a_window_that_lacks_a_channel_is_not_closed_for_a_mere_delay():
    """With idle timeouts below a second, a busy machine once closed windows without channels, for good."""
    rhythm, now = rhythm_of(stream(20, but={(n, TORQUE) for n in range(12, 20)}))
    assert rhythm.patience(now) == 3.0
    assert TORQUE.label in rhythm.heard(now + 1.0, 0.0)
    assert TORQUE.label not in rhythm.heard(now + 4.0, 0.0)


def test_a_channel_that_ended_long_ago_is_not_waited_for_again():
    rhythm, _ = rhythm_of(stream(20, but={(n, TORQUE) for n in range(12, 20)}))
    assert rhythm.patience(100.0 + 90.0) == rhythm.limit


def test_a_stream_that_has_just_been_joined_may_have_more_channels():
    rhythm = _Rhythm(0.2, 50.0)
    for f in stream(3, but={(n, TORQUE) for n in range(3)}):
        rhythm.note(f, 50.1, 0.0)
    assert rhythm.patience(51.0) == 3.0
