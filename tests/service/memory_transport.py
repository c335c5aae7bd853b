"""A network within the process: another transport is this one file."""

from __future__ import annotations

import threading
from contextlib import contextmanager

from service.errors import NotReachable
from service.stream.left_out import UNKNOWN
from service.stream.wire.topics import topic_of


class MemoryNetwork:
    """What both sides share; `reachable` says whether a connection can be opened."""

    def __init__(self, reachable=True):
        self.reachable = reachable
        self.inbox = self.source = self.on_rig = None
        self.published, self.announced, self.rigs = [], set(), {}
        self.alarms, self.positions, self.made = [], [], []
        self.subscribed = threading.Event()

    @contextmanager
    def open(self):
        """A connection of the service: a `Transport`."""
        if not self.reachable:
            raise NotReachable("the network in memory is off")
        try:
            yield self
        finally:
            self.announced.clear()

    # -- the service's side --------------------------------------------------------------------------

    @contextmanager
    def subscribe(self, inbox):
        self.inbox = inbox
        self.subscribed.set()
        try:
            yield self
        finally:
            self.subscribed.clear()
            inbox.close()

    def publish_made(self, topic, payload):
        self.made.append((topic, payload))

    @contextmanager
    def subscribe_made(self, inbox):
        yield

    def ask_again(self, channel, seconds, done):
        done()

    @contextmanager
    def answer_states(self, source):
        self.source = source
        yield

    def publish_state(self, asset, text):
        self.published.append((asset, text))

    def publish_alarms(self, asset, text):
        self.alarms.append((asset, text))

    def publish_position(self, stream, text):
        self.positions.append((stream, text))

    @contextmanager
    def answer_positions(self, ask):
        self.on_position = ask
        yield

    def announce(self, asset):
        self.announced.add(asset)

    def withdraw(self, asset):
        self.announced.discard(asset)

    @contextmanager
    def watch_rigs(self, received):
        self.on_rig = received
        yield

    def ask_rig(self, asset, seconds):
        return [self.rigs[asset]] if asset in self.rigs else []

    def interrupted(self):
        return False

    def lost(self):
        return None

    def counters(self):
        return {"missed_frames": 0, "callback_errors": 0}

    # -- the other side: a `FramePublisher` ----------------------------------------------------------

    @contextmanager
    def open_publisher(self, connect, prefix, wait):
        """A connection of a replay."""
        yield self

    def offer_rig(self, asset, text):
        self.rigs[asset] = text

    def declare(self, channels):
        assert self.subscribed.wait(10)

    def publish(self, frame):
        taken = self.inbox.offer(topic_of(frame.channel), frame.payload)
        assert taken or self.inbox.refused[UNKNOWN]

    def linked(self, channel=None):
        return True

    def relink(self, seconds):
        pass

    def ask(self, stream, seconds, *, sending=False):
        answered, texts = threading.Event(), []

        def reply(text):
            texts.append(text)
            answered.set()

        self.on_position(stream, reply)
        answered.wait(seconds)
        return texts
