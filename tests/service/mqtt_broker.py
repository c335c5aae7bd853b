"""An MQTT broker within the process, on loopback, that can be stopped and started again; and a plain client of it."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import threading
import time
import warnings
from contextlib import contextmanager

import paho.mqtt.client as paho
from amqtt.broker import Broker
from paho.mqtt.enums import CallbackAPIVersion
from service_streams import free_port, wait_until

logging.getLogger("amqtt").setLevel(logging.CRITICAL)
logging.getLogger("transitions").setLevel(logging.CRITICAL)


class TestBroker:
    """One address; retained messages are gone after a stop."""

    __test__ = False

    def __init__(self, *, tls=None, passwords=None):
        """tls  certificate and key files; passwords  file of `amqtt.plugins.authentication.FileAuthPlugin`"""
        self.port = free_port()
        listener = {"type": "tcp", "bind": f"127.0.0.1:{self.port}"}
        if tls is not None:
            listener |= {"ssl": True, "certfile": str(tls[0]), "keyfile": str(tls[1])}
        plugins = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": passwords is None}}
        if passwords is not None:
            plugins = {"amqtt.plugins.authentication.FileAuthPlugin": {"password_file": str(passwords)}}
        self.config = {"listeners": {"default": listener}, "plugins": plugins}
        self.url = f"mqtt{'s' if tls else ''}://127.0.0.1:{self.port}"
        self.loop = self.broker = self.thread = None

    def start(self):
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()

        async def begin():
            self.broker = Broker(self.config)
            await self.broker.start()

        asyncio.run_coroutine_threadsafe(begin(), self.loop).result(10)
        return self

    def stop(self):
        if self.loop is None:
            return

        async def idle():
            for server in self.broker._servers.values():
                server.instance.close()
            for _, handler in self.broker._sessions.values():  # as a broker that is killed: nobody is waited for
                handler.writer._writer.transport.abort()
            others = [t for t in asyncio.all_tasks() if t is not asyncio.current_task()]
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            await asyncio.sleep(0.02)

        asyncio.run_coroutine_threadsafe(idle(), self.loop).result(10)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(10)
        self.loop.close()
        self.loop = self.broker = None
        with warnings.catch_warnings():  # connections that clients lost are left to the collector by the broker
            warnings.simplefilter("ignore", ResourceWarning)
            gc.collect()


@contextmanager
def broker_at_work(**given):
    broker = TestBroker(**given).start()
    try:
        yield broker
    finally:
        broker.stop()


class Reader:
    """A client that keeps what it receives."""

    def __init__(self, port, topics="#", *, user=None, password=None, ca=None):
        self.messages, self.ready = [], threading.Event()
        self.client = paho.Client(CallbackAPIVersion.VERSION2, reconnect_on_failure=False)
        if user:
            self.client.username_pw_set(user, password)
        if ca:
            self.client.tls_set(ca_certs=str(ca))
        self.client.on_message = lambda c, u, m: self.messages.append(m)
        self.client.on_subscribe = lambda *_: self.ready.set()
        self.client.connect("127.0.0.1", port)
        self.client.loop_start()
        time.sleep(0.05)
        self.client.subscribe(topics, 1)
        assert self.ready.wait(10)

    def payloads(self, topic):
        """What came at a topic, as JSON; None for an empty payload."""
        return [json.loads(m.payload) if m.payload else None for m in list(self.messages) if m.topic == topic]

    def latest(self, topic):
        return (self.payloads(topic) or [None])[-1]

    def publish(self, topic, payload, retain=False):
        text = payload if isinstance(payload, (str, bytes)) else json.dumps(payload)
        self.client.publish(topic, text, qos=1, retain=retain).wait_for_publish(10)

    def close(self):
        self.client.disconnect()
        self.client.loop_stop()


@contextmanager
def reading(port, *topics, **given):
    reader = Reader(port, *topics, **given)
    try:
        yield reader
    finally:
        reader.close()


__all__ = ["Reader", "TestBroker", "broker_at_work", "reading", "wait_until"]
