"""A link between two ends of UDP that loses, repeats and delays datagrams, drawn from a seed."""

from __future__ import annotations

import heapq
import random
import selectors
import socket
import threading
import time

DATAGRAM = 65_535
LATE = 0.02  # a delayed datagram comes so much later at most [s]


class LossyLink:
    """Passes datagrams on between whoever sends to `endpoint` and the UDP port behind.

    loss, repeated, late   shares of the datagrams, both ways, that are dropped, sent twice and overtaken by others
    """

    def __init__(self, behind: int, port: int, *, loss: float, repeated: float, late: float, seed: int) -> None:
        self.endpoint = f"udp/127.0.0.1:{port}"
        self._behind, self._rng = ("127.0.0.1", behind), random.Random(seed)
        self._chances = loss, repeated, late
        self._front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._front.bind(("127.0.0.1", port))
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._front, selectors.EVENT_READ)
        self._clients: dict[tuple[str, int], socket.socket] = {}
        self._waiting: list[tuple[float, int, socket.socket, bytes, tuple[str, int]]] = []
        self._ends, self._thread = threading.Event(), threading.Thread(target=self._run, daemon=True)
        self.bad = False  # the link is good until this is set, so that the ends can find each other
        self.passed = self.dropped = 0

    def __enter__(self) -> LossyLink:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()
        for each in (self._front, *self._clients.values()):
            each.close()

    def _run(self) -> None:
        while not self._ends.is_set():
            for key, _ in self._selector.select(0.002 if self._waiting else 0.1):
                try:
                    data, address = key.fileobj.recvfrom(DATAGRAM)
                except OSError:  # the other end is not there
                    continue
                if key.fileobj is self._front:
                    self._pass(self._client(address), data, self._behind)
                else:
                    self._pass(self._front, data, key.data)
            while self._waiting and self._waiting[0][0] <= time.monotonic():
                *_, by, data, to = heapq.heappop(self._waiting)
                self._send(by, data, to)

    def _client(self, address: tuple[str, int]) -> socket.socket:
        if address not in self._clients:
            self._clients[address] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._selector.register(self._clients[address], selectors.EVENT_READ, address)
            self._clients[address].bind(("127.0.0.1", 0))
        return self._clients[address]

    def _pass(self, by: socket.socket, data: bytes, to: tuple[str, int]) -> None:
        loss, repeated, late = self._chances if self.bad else (0.0, 0.0, 0.0)
        self.passed += 1
        if self._rng.random() < loss:
            self.dropped += 1
            return
        for _ in range(1 + (self._rng.random() < repeated)):
            if self._rng.random() < late:
                at = time.monotonic() + self._rng.uniform(0, LATE)
                heapq.heappush(self._waiting, (at, self.passed, by, data, to))
            else:
                self._send(by, data, to)

    def _send(self, by: socket.socket, data: bytes, to: tuple[str, int]) -> None:
        try:
            by.sendto(data, to)
        except OSError:
            self.dropped += 1
