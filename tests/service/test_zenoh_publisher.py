"""A publisher of many streams: what it asks, and what it notices, on real sessions of Zenoh."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager

import zenoh
from service_streams import free_port, wait_until

from service.runtime.delivery import ASKED_TOGETHER
from service.stream.channels import CHANNEL_KINDS
from service.stream.wire.topics import Channel
from service.transport.topics import position_topic
from service.transport.zenoh import open_publisher
from service.transport.zenoh_session import open_session

STREAMS = [f"machine-{number}" for number in range(ASKED_TOGETHER)]
CHANNELS = [Channel(stream, "accel", "y6") for stream in STREAMS]


@contextmanager
def subscribed(session):
    """Somebody listens to the keys of all streams."""
    subscribers = [session.declare_subscriber(f"gearbox/*/{kind}/*", lambda sample: None) for kind in CHANNEL_KINDS]
    yield
    for subscriber in subscribers:
        subscriber.undeclare()


@contextmanager
def publishing():
    """A router with a subscriber, and a publisher of all channels."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_session([endpoint]) as router, subscribed(router), open_publisher([endpoint], wait=20.0) as publisher:
        publisher.declare(CHANNELS)
        yield router, publisher


def test_streams_are_asked_about_together():
    held: list[zenoh.Query] = []

    def asked(query):
        held.append(query)
        if len(held) == len(STREAMS):  # nobody is answered before all have been asked about
            for each in held:
                with each:
                    each.reply(each.key_expr, str(each.key_expr))

    with publishing() as (router, publisher):
        queryable = router.declare_queryable(position_topic("*", "gearbox"), asked)
        answers = [publisher.ask(stream, 10.0) for stream in STREAMS]
        assert [list(each) for each in answers] == [[position_topic(s, "gearbox").encode()] for s in STREAMS]
        queryable.undeclare()


def test_everyone_who_stores_a_stream_is_heard():
    """The newest answer was the only one, or that of a queryable that calls itself complete."""
    key, endpoint = position_topic(STREAMS[0], "gearbox"), f"tcp/127.0.0.1:{free_port()}"
    with open_session([endpoint]), open_publisher([endpoint], wait=20.0) as publisher, ExitStack() as stack:
        for number in range(3):
            session = stack.enter_context(open_session((), [endpoint], 20.0))
            session.declare_queryable(key, lambda q, n=number: q.reply(key, f"service {n}"), complete=number == 1)
        wait_until(lambda: sorted(publisher.ask(STREAMS[0], 10.0)) == [b"service 0", b"service 1", b"service 2"], 5.0)


def test_a_subscriber_that_has_been_away_is_noticed_for_whatever_channel_is_looked_at():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_session([endpoint]) as router, open_publisher([endpoint], wait=20.0) as publisher:
        with subscribed(router):
            publisher.declare(CHANNELS)
            assert publisher.linked() and all(publisher.linked(channel) for channel in CHANNELS)
        wait_until(lambda: not publisher.linked())  # Zenoh may say nothing of those that come back at once
        with subscribed(router):  # another one, that has not been sent what came before
            wait_until(lambda: not publisher.linked(CHANNELS[0]))
            assert not any(publisher.linked(channel) for channel in CHANNELS) and not publisher.linked()

            def linked_again():  # a key's notice may come late: then once more
                publisher.relink(20.0)
                return publisher.linked() and publisher.linked(CHANNELS[-1])

            wait_until(linked_again)
