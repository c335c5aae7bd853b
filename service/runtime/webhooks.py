"""Messages about alarms, sent to the addresses of the settings: JSON by HTTP POST, at least once each.

A message waits in the database from the transaction that changed its alarm until an address has answered 2xx, so that
neither a killed process nor an address that is down loses one. Messages to one address keep their order. Whoever
receives one twice knows it by its `id`, which is in the header `Idempotency-Key`, too. Nothing waits for this thread.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache
from typing import TYPE_CHECKING, Any

from service.errors import StorageUnavailable, StoreError
from service.results.alarm_store import AlarmStore
from service.steady_clock import later_time_ns

if TYPE_CHECKING:  # loaded with the first message
    import httpx

log = logging.getLogger(__name__)

NS = 1_000_000_000
TIMEOUT = 10.0  # of one attempt [s]
TRIES = 2  # in a row, before other addresses have their turn
FIRST_PAUSE, LONGEST_PAUSE = 5.0, 900.0  # between turns; it doubles [s]
GIVE_UP = 3 * 86_400.0  # age from which a message is given up [s]
LOOK_EVERY = 1.0  # how often messages that are due again are looked for [s] ...
LOOK_SELDOM = 10.0  # ... how often where none waits ...
SAID = 5.0  # ... and nobody has said for so long that there is one: it is there once its transaction has ended [s]
STOP_WAIT = 2.0  # how long a message in progress is waited for at the end [s]


class WebhookSender(threading.Thread):
    """Sends what waits in the outbox, until ended."""

    def __init__(
        self,
        store: AlarmStore,
        waiting: threading.Event,
        *,
        clock: Callable[[], int] = later_time_ns,
        first_pause: float = FIRST_PAUSE,
    ) -> None:
        """waiting  set by whoever puts a message into the outbox"""
        super().__init__(name="webhooks", daemon=True)
        self._store, self._waiting, self._clock, self._first_pause = store, waiting, clock, first_pause
        self._stopping = threading.Event()
        self._delivered = self._failures = self._given_up = 0

    def run(self) -> None:
        """Works until ended."""
        with ExitStack() as stack:

            @cache
            def client() -> httpx.Client:
                import httpx

                return stack.enter_context(httpx.Client(timeout=TIMEOUT, follow_redirects=False))

            pause, said = LOOK_EVERY, time.monotonic()
            while not self._stopping.is_set():
                if self._waiting.wait(pause):
                    said = time.monotonic()
                self._waiting.clear()
                pause = LOOK_EVERY
                try:
                    while not self._stopping.is_set() and self.turn(client):
                        pass
                    if time.monotonic() - said > SAID and not self._store.waiting():
                        pause = LOOK_SELDOM
                except StorageUnavailable as error:
                    log.debug(
                        "webhooks wait: %s", error
                    )  # said by whoever keeps windows; tried again with the next look

    def end(self) -> None:
        """Ends the thread; what has not been delivered waits for the next start."""
        self._stopping.set()
        self._waiting.set()
        if self.is_alive():
            self.join(STOP_WAIT)

    def turn(self, client: Callable[[], httpx.Client]) -> bool:
        """One attempt for the oldest message of each address; whether any was delivered.

        client  opened when there is a message
        """
        delivered = False
        for number, name, url, body, created_ns, attempts in self._store.due(self._clock()):
            if self._stopping.is_set():
                break
            if self._post(client(), url, name, body):
                self._delivered += 1
                self._store.sent(number)
                delivered = True
            else:
                self._failures += 1
                self._later(number, url, created_ns, attempts)
        return delivered

    def figures(self) -> dict[str, Any]:
        """Figures for /metrics."""
        try:
            waiting = {"webhooks_waiting": self._store.waiting()}
        except StoreError:
            waiting = {}
        return {
            **waiting,
            "webhooks_delivered": self._delivered,
            "webhook_failures": self._failures,
            "webhooks_given_up": self._given_up,
        }

    def _post(self, client: httpx.Client, url: str, name: str, body: str) -> bool:
        import httpx
        from tenacity import RetryError, Retrying, retry_if_exception_type, stop_after_attempt, wait_exponential

        headers = {"Content-Type": "application/json", "Idempotency-Key": name}
        retrying = Retrying(
            stop=stop_after_attempt(TRIES),
            wait=wait_exponential(multiplier=0.2, max=1.0),
            retry=retry_if_exception_type(httpx.HTTPError),
            sleep=self._pause,
        )
        try:
            for attempt in retrying:
                with attempt:
                    client.post(url, content=body, headers=headers).raise_for_status()
        except RetryError as error:
            log.warning("webhook %s: %s", url, error.last_attempt.exception())
            return False
        except (httpx.InvalidURL, ValueError) as error:
            log.warning("webhook %s: %s", url, error)
            return False
        return True

    def _pause(self, seconds: float) -> None:
        self._stopping.wait(seconds)

    def _later(self, number: int, url: str, created_ns: int, attempts: int) -> None:
        now = self._clock()
        if now - created_ns > GIVE_UP * NS:
            self._given_up += 1
            self._store.sent(number)
            log.error("webhook %s: a message was given up after %d attempts", url, attempts + 1)
            return
        pause = min(self._first_pause * 2.0 ** min(attempts, 20), LONGEST_PAUSE)
        self._store.postpone(number, now + round(pause * NS))
