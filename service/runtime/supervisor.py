"""The supervisor of a service's roles: each is done by a process, which is forked, watched and started again.

    Supervisor([Role(name="ingest", work=receive), Role(name="answer", work=answer)]).run(stop)

It has one thread and opens nothing, so that it can fork at any time, and shares with the roles what it has loaded. A
role's process beats with each turn of its loop, and says how it is, which the other roles learn. One that is silent is
killed, and one that has ended is started again, after pauses that grow while it does not live long; where an error has
ended a role without which there is no service, all of it ends. Processes end with this one, whatever ends that: the
kernel kills them, also those that are suspended.
"""

from __future__ import annotations

import logging
import os
import pickle
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from service.errors import ServiceError, SteppedBack
from service.logs import figures as log_figures
from service.operation.systemd import notify
from service.results.storage_faults import is_away
from service.runtime.role_process import BEAT, END_WAIT, MOST_SAID, Context, Failed, Notify, RoleState, become

log = logging.getLogger(__name__)

SILENT = 10.0  # time without a beat after which a process is killed [s]
START_LIMIT = 60.0  # the same until its first beat [s]
PAUSES = (0.1, 30.0)  # shortest and longest pause before a process is started again [s]
LIVED = 10.0  # how long it must live for the next pause to be the shortest [s]
LOOK = 1.0  # whether one is silent [s]
SUSPENDED = 5.0  # longer than any turn [s]
BUFFER = 2**22  # of what has been said and not taken yet [bytes]
SUPERVISOR = "supervisor"  # in place of a role: what its process itself has logged
ENDED_EARLY = "it ended before it had begun, and what it printed is on the standard error of the service"


@dataclass(frozen=True, slots=True, kw_only=True)
class Role:
    """One role of the service.

    work       called within its process with what connects it to the rest of the service; it calls `beat` with each
               turn, and returns once `stop` is set
    silent     time without a beat after which its process is killed [s]
    threads    whether it may have threads; else it can fork
    essential  whether there is no service where an error ends it
    hears      the roles of which it learns what they say
    """

    name: str
    work: Callable[[Context], object]
    silent: float = SILENT
    threads: bool = True
    essential: bool = False
    hears: tuple[str, ...] = ()


@dataclass(slots=True, eq=False)
class _Child:
    """The process of a role.

    leaves  whether the role is done no more, once its process has ended
    """

    role: Role
    leaves: bool = False
    process: int | None = None
    channel: socket.socket | None = None  # on which it beats
    started: bool = False  # whether one has been
    began: float = 0.0  # when it was started, on the monotonic clock [s]
    beaten: float | None = None  # when it beat last
    start_at: float = 0.0  # when the next one is started
    pause: float = PAUSES[0]
    said: Any = None  # last
    state: RoleState = field(default_factory=RoleState)

    @property
    def limit(self) -> float:
        """How long it may be silent [s]."""
        return START_LIMIT if self.beaten is None else self.role.silent

    def is_silent(self, now: float) -> bool:
        """Whether it has been silent for too long."""
        return now - (self.began if self.beaten is None else self.beaten) > self.limit


class Supervisor:
    """Has each role done by a process of its own.

    heard  called with a role and what it has said last, whenever it beats
    """

    def __init__(self, roles: Iterable[Role], heard: Callable[[str, Any], object] = lambda role, said: None) -> None:
        self._children, self._heard = [_Child(role) for role in roles], heard
        self._first, self._wanted = len(self._children), dict[str, Role]()
        self._failure: Exception | None = None
        self._ending, self._turned = False, time.monotonic()
        self._logged: dict[str, Any] = {}

    def run(self, stop: threading.Event) -> None:
        """Works until `stop` is set, in the main thread, and passes SIGHUP on to the roles.

        Raises what has ended an essential role.
        """
        with _woken(self._renew) as woken:
            try:
                while not stop.is_set() and self._failure is None:
                    self._turn(woken)
            finally:
                self._end(woken)
        if self._failure is not None:
            raise self._failure

    def _renew(self, *_: object) -> None:
        for child in self._children:
            _send(child, signal.SIGHUP)

    def want(self, roles: Iterable[Role]) -> None:
        """Has these roles done from the next turn on, beside those from the begin, and no others."""
        self._wanted = {role.name: role for role in roles}

    def _change(self) -> None:
        """Ends roles that are wanted no more, and has those that are."""
        for child in self._children[self._first :]:
            if not child.leaves and child.role.name not in self._wanted:
                child.leaves, child.start_at = True, time.monotonic() + END_WAIT
                _send(child, signal.SIGTERM)
            elif child.leaves and child.process is not None and time.monotonic() > child.start_at:
                _send(child, signal.SIGKILL)
        self._children = [child for child in self._children if not child.leaves or child.process is not None]
        there = {child.role.name for child in self._children}
        self._children += [_Child(role) for name, role in self._wanted.items() if name not in there]

    def _turn(self, woken: int) -> None:
        now = time.monotonic()
        self._change()
        for child in self._children:
            if child.process is None and now >= child.start_at:
                self._start(child)
        dues = [child.start_at for child in self._children if child.process is None]
        self._take(woken, max(0.0, min([LOOK, *(due - now for due in dues)])))
        if (logged := log_figures()) != self._logged:
            self._logged = logged
            for child in self._children:
                self._catch_up(child, SUPERVISOR)
        now, before = time.monotonic(), self._turned
        self._turned = now
        for child in self._children:
            if now - before > SUSPENDED:  # this process was, and the others may have been
                child.began, child.beaten = now, child.beaten and now
            if child.process is not None and child.is_silent(now):
                log.error(
                    "%s: process %d is silent for %g s: it is killed", child.role.name, child.process, child.limit
                )
                self._show(child, replaced=child.state.replaced + 1)
                _send(child, signal.SIGKILL)
                self._reap(child, END_WAIT)

    def _start(self, child: _Child) -> None:
        channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for each in (channel, theirs):
            each.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        parent, role = os.getpid(), child.role
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # nobody reads it
                stream.flush()
        try:
            process = os.fork()
        except OSError as error:
            channel.close()
            theirs.close()
            why = f"{type(error).__name__}: {error}"
            log.error("%s: no process can be started now: %s", role.name, why)
            self._pause(child)
            self._show(child, unstarted=why)
            return
        if process == 0:
            unused = [channel, *(each.channel for each in self._children if each.channel is not None)]
            become(role.name, role.work, theirs, parent, threads=role.threads, unused=unused)
        theirs.close()
        child.process, child.channel, child.began, child.beaten = process, channel, time.monotonic(), None
        level = logging.INFO if child.started else logging.DEBUG  # a start of the service is not worth a line a role
        log.log(level, "%s: process %d is started", role.name, process)
        child.started = True
        self._show(child, process=process)
        for name in role.hears:
            self._catch_up(child, name)

    def _take(self, woken: int, seconds: float) -> None:
        """Takes what is said within a time [s], and notes which processes have ended."""
        by_channel = {child.channel.fileno(): child for child in self._children if child.channel is not None}
        for ready in select.select([woken, *by_channel], (), (), seconds)[0]:
            if ready in by_channel:
                self._hear(by_channel[ready])
        with suppress(BlockingIOError):
            os.read(woken, 4096)
        for child in self._children:
            self._reap(child)
        if os.getpid() == 1:  # of a container: what a killed role has left ends as a child of this process
            with suppress(ChildProcessError):
                while (found := _ended()) is not None and found not in {child.process for child in self._children}:
                    os.waitpid(found, 0)

    def _hear(self, child: _Child) -> None:
        """Beats, and what the process says, as far as it is there."""
        assert child.channel is not None
        with suppress(OSError):
            while data := child.channel.recv(MOST_SAID, socket.MSG_DONTWAIT):
                said = None if data == BEAT else pickle.loads(data)
                if not isinstance(said, Failed | logging.LogRecord):
                    child.beaten = time.monotonic()
                    if not child.state.lives:
                        self._show(child, lives=True, unstarted=None)
                if said is not None:
                    self._said(child, said)
                elif child.said is not None:
                    self._heard(child.role.name, child.said)

    def _said(self, child: _Child, said: Any) -> None:
        if isinstance(said, logging.LogRecord):
            logging.getLogger(said.name).handle(said)
        elif isinstance(said, Notify):
            notify(*said.lines)
        elif isinstance(said, Failed):
            back = isinstance(said.error, SteppedBack)
            if is_away(said.error) and not back:
                log.error("%s: %s", child.role.name, said.error)  # it goes on once that is back
            elif child.role.essential or back:
                self._failure = self._failure or said.error
            elif isinstance(said.error, ServiceError):  # which says itself what is wrong
                log.error("%s: %s", child.role.name, said.error)
            else:
                sys.excepthook(type(said.error), said.error, None)
        else:
            child.said = said
            self._heard(child.role.name, said)
            self._tell(child)

    def _reap(self, child: _Child, seconds: float = 0.0) -> None:
        """Notes the end of a process, within a time [s]; one that hangs in the kernel is left to it."""
        if child.process is None:
            return
        until = time.monotonic() + seconds
        while not (found := os.waitpid(child.process, os.WNOHANG))[0]:
            if time.monotonic() >= until:
                return
            time.sleep(0.01)
        process, status = child.process, os.waitstatus_to_exitcode(found[1])
        self._hear(child)
        assert child.channel is not None
        child.channel.close()
        child.process = child.channel = None
        early = child.beaten is None
        if time.monotonic() - child.began > LIVED:
            child.pause = PAUSES[0]
        if not (self._ending or child.leaves) and self._failure is None:
            log.warning(
                "%s: process %d has ended with status %d: it is started again in %g s",
                child.role.name, process, status, child.pause,
            )  # fmt: skip
        self._pause(child)
        self._show(child, process=None, lives=False, unstarted=ENDED_EARLY if early else None)

    def _end(self, woken: int) -> None:
        """Ends all processes: in good order, as far as they do so in time."""
        self._ending, until = True, time.monotonic() + END_WAIT
        for child in self._children:
            _send(child, signal.SIGTERM)
        while any(child.process is not None for child in self._children) and time.monotonic() < until:
            self._take(woken, 0.1)
        for child in self._children:
            _send(child, signal.SIGKILL)
            self._reap(child, 1.0)

    def _pause(self, child: _Child) -> None:
        child.start_at = time.monotonic() + child.pause
        child.pause = min(2 * child.pause, PAUSES[1])

    def _show(self, child: _Child, **changed: Any) -> None:
        """Has the other roles learn how a process is."""
        given = {name: getattr(child.state, name) for name in RoleState.__slots__}
        child.state = RoleState(**given | changed)
        self._tell(child)

    def _tell(self, child: _Child) -> None:
        for other in self._children:
            self._catch_up(other, child.role.name)

    def _catch_up(self, to: _Child, name: str) -> None:
        """How a role is, and what it has said last, for another that hears it; left out where that takes nothing."""
        if to.channel is None or name not in to.role.hears:
            return
        known = {child.role.name: (child.state, child.said) for child in self._children}
        known[SUPERVISOR] = RoleState(process=os.getpid(), lives=True), self._logged
        if name in known:
            with suppress(OSError):
                to.channel.send(pickle.dumps((name, *known[name])), socket.MSG_DONTWAIT)


def _ended() -> int | None:
    """A child of this process that has ended, and is left as it is; None for none. ChildProcessError without any."""
    found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    return None if found is None else found.si_pid


def _send(child: _Child, number: int) -> None:
    if child.process is not None:
        with suppress(ProcessLookupError):
            os.kill(child.process, number)


@contextmanager
def _woken(renew: Callable[..., None]) -> Iterator[int]:
    """Where each signal of this process can be read, also that of an ended child; SIGHUP calls `renew`."""
    woken, waking = os.pipe()
    os.set_blocking(waking, False)
    os.set_blocking(woken, False)
    before = [(number, signal.signal(number, handler)) for number, handler in
              ((signal.SIGCHLD, lambda *_: None), (signal.SIGHUP, renew))]  # fmt: skip
    woken_before = signal.set_wakeup_fd(waking, warn_on_full_buffer=False)
    try:
        yield woken
    finally:
        for number, handler in before:
            signal.signal(number, handler)
        signal.set_wakeup_fd(woken_before)
        os.close(woken)
        os.close(waking)
