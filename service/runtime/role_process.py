"""The process of a role, as its supervisor forks it: what it says, what it learns of the other roles, how it ends."""

from __future__ import annotations

import ctypes
import logging
import os
import pickle
import signal
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NoReturn

from service.errors import ServiceError
from service.logs import count_anew
from service.operation.systemd import notify

BEAT = b"."
MOST_SAID = 200_000  # at a time [bytes]
END_WAIT = 8.0  # how long one may take to end before it is killed: with the rest, less than systemd waits [s]
BEAT_EVERY = 1.0  # at most: a turn may be short [s]
_PARENT_DEATH, _NAME = 1, 15  # of prctl: which signal comes once the parent has ended; what the process is called
_channel: socket.socket | None = None  # of this process, and of those that it forks


@dataclass(frozen=True, slots=True)
class Notify:
    """Lines for systemd, which listens to the supervisor's process alone."""

    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Failed:
    """What has ended a role."""

    error: Exception


@dataclass(frozen=True, slots=True, kw_only=True)
class RoleState:
    """How the process of a role is, by its supervisor.

    process    None where there is none
    lives      whether it beats
    unstarted  why none has begun since the last one, as far as that is known
    replaced   how many of its processes were silent, and were killed for that
    """

    process: int | None = None
    lives: bool = False
    unstarted: str | None = None
    replaced: int = 0


class Others:
    """What the other roles of a service have said last, and how their processes are; for any thread."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[RoleState, Any]] = {}
        self._changed = threading.Condition()

    def take(self, role: str, state: RoleState, said: Any) -> None:
        """A role's state, and what it has said last."""
        with self._changed:
            self._known[role] = state, said
            self._changed.notify_all()

    def state(self, role: str) -> RoleState:
        """How the process of a role is."""
        return self._known.get(role, (RoleState(), None))[0]

    def said(self, role: str) -> Any:
        """What a role has said last; None for nothing."""
        return self._known.get(role, (None, None))[1]

    def wait(self, seconds: float) -> None:
        """Waits until something is said, for so long at most [s]."""
        with self._changed:
            self._changed.wait(seconds)

    def wait_for(self, holds: Callable[[], bool], seconds: float) -> bool:
        """Waits until something holds, for so long at most [s]; whether it does."""
        with self._changed:
            return self._changed.wait_for(holds, seconds)


class Context:
    """A role's way to the rest of the service.

    stop    set when the role is to end
    others  what the other roles have said
    """

    def __init__(self, role: str, stop: threading.Event, others: Others) -> None:
        self.role, self.stop, self.others = role, stop, others

    def beat(self) -> None:
        """Says that the role lives; called with each turn of its loop."""

    def say(self, what: object) -> None:
        """Says how the role is to those that listen to it, in place of what was said before."""
        self.others.take(self.role, RoleState(process=os.getpid(), lives=True), what)

    def notify(self, *lines: str) -> None:
        """Passes lines on to systemd."""
        notify(*lines)


class ProcessContext(Context):
    """The same in a process of its own, under a supervisor."""

    def __init__(self, role: str, stop: threading.Event) -> None:
        super().__init__(role, stop, Others())
        self._due = 0.0

    def beat(self) -> None:
        if (now := time.monotonic()) >= self._due:
            self._due = now + BEAT_EVERY
            _send(BEAT)

    def say(self, what: object) -> None:
        say(what)

    def notify(self, *lines: str) -> None:
        say(Notify(lines))

    def listen(self) -> None:
        """Takes what is said, in a thread of its own, and ends this process with its supervisor."""
        threading.Thread(target=self._listen, name="supervisor", daemon=True).start()

    @property
    def channel(self) -> socket.socket:
        """Where what is said can be read; for a process of one thread, which waits for it and takes it."""
        assert _channel is not None
        return _channel

    def take(self) -> None:
        """Takes what has been said, without waiting."""
        with suppress(OSError):
            while said := self.channel.recv(MOST_SAID, socket.MSG_DONTWAIT):
                self.others.take(*pickle.loads(said))

    def _listen(self) -> None:
        with suppress(OSError):
            while said := self.channel.recv(MOST_SAID):
                self.others.take(*pickle.loads(said))
        self.stop.set()
        time.sleep(END_WAIT)
        os._exit(1)


def become(
    role: str, work: Callable[[Context], object], channel: socket.socket, parent: int, *, threads: bool,
    unused: Iterable[socket.socket],
) -> NoReturn:  # fmt: skip
    """Makes the present process, which has been forked, that of a role.

    threads  whether the role may have threads; else it takes what is said by itself, and can fork
    unused   channels of other roles
    """
    global _channel
    status, _channel = 1, channel
    try:
        for other in unused:
            other.close()
        _name(role)
        count_anew()
        stop = threading.Event()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for number in (signal.SIGINT, signal.SIGHUP):  # of a terminal come to all: the supervisor ends this
            signal.signal(number, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, lambda *_: stop.set())
        if ends_with(parent):
            context = ProcessContext(role, stop)
            if threads:
                context.listen()
            work(context)
            status = 0
    except Exception as error:
        say(_failed(error))
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        logging.shutdown()
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # nobody reads it
                stream.flush()
        os._exit(status)  # at once: threads of a network may need the interpreter while it is torn down


def ends_with(parent: int) -> bool:
    """Has the kernel kill this process with the one that has made it, also while suspended; whether that lives."""
    ctypes.CDLL(None).prctl(_PARENT_DEATH, signal.SIGKILL)
    return os.getppid() == parent


def say(what: object) -> None:
    """Says something to the supervisor, also from a forked process; what is too long is left out."""
    data = pickle.dumps(what)
    if len(data) <= MOST_SAID:
        _send(data)


def _failed(error: Exception) -> Failed:
    """An error with where it came from, as another process can have it."""
    trace = "".join(traceback.format_tb(error.__traceback__))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # of a library
        error = RuntimeError(f"{type(error).__name__}: {error}")
    if not isinstance(error, ServiceError):  # which says itself what is wrong
        error.add_note(f"in its own process:\n{trace}")
    return Failed(error)


def _name(role: str) -> None:
    """What `ps -o comm` and the like call this process."""
    ctypes.CDLL(None).prctl(_NAME, role.encode()[:15])


def _send(data: bytes) -> None:
    assert _channel is not None
    with suppress(OSError):  # who has started this is suspended, or has ended
        _channel.send(data, socket.MSG_DONTWAIT)
