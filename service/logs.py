"""Log lines on standard error: as text for people or as JSON for machines, with a limit for each cause.

    with logging_by(settings):        the whole of a command
        with about(asset=…, window=…):   lines from here on carry both

Lines come from the standard library's logging, those of other packages and warnings too, and are formatted by
structlog. A cause is a place in the code with its message, without what varies in it: so many lines of it a minute are
written, then one line says how many were left out. Nothing that logging meets ends the service.
"""

from __future__ import annotations

import logging
import re
import sys
import threading
import time
import warnings
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator, MutableMapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TextIO

import structlog

from service.printable import printable

OWN = ("service", "twin", "gear_twin", "recordings")  # loggers that the level of the settings is for
PERIOD = 60.0  # within which the lines of a cause are counted [s]
MOST_CAUSES = 500  # that are counted one by one; all others are one cause together
SHOWN = ("asset", "window", "left_out")  # that a line may carry besides its message
VARIES = re.compile(r"%[-+#0-9.]*[a-zA-Z]")  # what a message puts in
LEVELS = ("debug", "info", "warning", "error", "critical")
LONGEST = 4000  # of a message [characters]

Format = Literal["text", "json"]
Event = MutableMapping[str, Any]


class LogSettings(Protocol):
    """What the settings say of log lines."""

    @property
    def log_format(self) -> Format: ...

    @property
    def log_level(self) -> str: ...

    @property
    def log_lines(self) -> int: ...


@contextmanager
def logging_by(settings: LogSettings) -> Iterator[None]:
    """Writes what is logged, and warnings, to standard error while inside."""
    root, level = logging.getLogger(), settings.log_level.upper()
    handler = LimitedLines(formatter(settings.log_format), settings.log_lines)
    own = [logging.getLogger(name) for name in OWN]
    before = [(logger, logger.level) for logger in (root, *own)]
    hooks = warnings.showwarning, threading.excepthook
    root.addHandler(handler)
    root.setLevel("DEBUG" if level == "DEBUG" else max(logging.WARNING, logging.getLevelName(level)))
    for logger in own:
        logger.setLevel(level)
    warnings.showwarning, threading.excepthook = _warned, _thread_failed  # type: ignore[assignment]
    try:
        yield
    finally:
        warnings.showwarning, threading.excepthook = hooks  # type: ignore[assignment]
        root.removeHandler(handler)
        handler.close()
        for logger, was in before:
            logger.setLevel(was)


def figures() -> dict[str, Any]:
    """Figures for /metrics: lines written by level, and lines left out."""
    found = next((h for h in logging.getLogger().handlers if isinstance(h, LimitedLines)), None)
    lines = dict.fromkeys(LEVELS, 0) | ({} if found is None else dict(found.lines))
    return {"log_lines": lines, "log_lines_left_out": 0 if found is None else found.left_out}


def count_anew() -> None:
    """Forgets what has been counted; for a process that has been forked."""
    for handler in logging.getLogger().handlers:
        if isinstance(handler, LimitedLines):
            handler.count_anew()


def about(**bound: Any) -> AbstractContextManager[Any]:
    """Lines that are logged inside, in this thread, carry these values."""
    return structlog.contextvars.bound_contextvars(**bound)


def carry(record: logging.LogRecord) -> None:
    """Makes a record ready for another process, with its cause and what is bound here."""
    record.cause = template_of(record)
    record.bound = {**structlog.contextvars.get_contextvars(), **getattr(record, "bound", {})}
    record.msg, record.args = record.getMessage(), None
    if record.exc_info:
        record.exc_text = logging.Formatter().formatException(record.exc_info)
        record.exc_info = None


def template_of(record: logging.LogRecord) -> str:
    """A record's message without what varies in it."""
    return str(getattr(record, "cause", record.msg))[:LONGEST]


# -- limit -------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Cause:
    """The lines of one cause in its present period."""

    logger: str
    level: int
    template: str
    until: float  # end of the period, on the monotonic clock [s]
    written: int = 0
    left_out: int = 0


class LimitedLines(logging.Handler):
    """Writes records to standard error, so many of each cause within a minute; 0: all."""

    def __init__(
        self,
        lines_by: logging.Formatter,
        most: int,
        *,
        clock: Callable[[], float] = time.monotonic,
        stream: TextIO | None = None,
    ) -> None:
        super().__init__()
        self.setFormatter(lines_by)
        self._most, self._clock, self._stream = most, clock, stream
        self._causes: OrderedDict[tuple[str, int, str], _Cause] = OrderedDict()  # by the end of their periods
        self._timer: threading.Timer | None = None
        self.lines: Counter[str] = Counter()  # written, by level
        self.left_out = 0

    def count_anew(self) -> None:
        """Forgets the lines that have been written or left out."""
        self.lines, self.left_out, self._timer = Counter(), 0, None
        self._causes.clear()

    def emit(self, record: logging.LogRecord) -> None:
        """Writes a record, or counts it."""
        now = self._clock()
        self._end_periods(now)
        cause = self._cause(record, now)
        if self._most and cause.written >= self._most:
            cause.left_out += 1
            self.left_out += 1
            self._look_again(cause.until - now)
            return
        cause.written += 1
        self._write(record)

    def close(self) -> None:
        """Says what was left out so far."""
        with self.lock or threading.RLock():
            self._end_periods(float("inf"))
            if self._timer is not None:
                self._timer.cancel()
        super().close()

    def _cause(self, record: logging.LogRecord, now: float) -> _Cause:
        key = (record.name, record.lineno, template_of(record))
        if key not in self._causes and len(self._causes) >= MOST_CAUSES:
            key = ("", 0, "lines of many causes")
        if key not in self._causes:
            logger, _, template = key
            self._causes[key] = _Cause(logger or record.name, record.levelno, template, now + PERIOD)
        return self._causes[key]

    def _end_periods(self, now: float) -> None:
        while self._causes:
            key, cause = next(iter(self._causes.items()))
            if cause.until > now:
                return
            del self._causes[key]
            if cause.left_out:
                self._write(_summary(cause))

    def _look_again(self, seconds: float) -> None:
        """What was left out is said at the end of the period, also where nothing is logged any more."""
        if self._timer is None or not self._timer.is_alive():
            self._timer = threading.Timer(max(seconds, 0.0) + 0.1, self._due)
            self._timer.daemon = True
            self._timer.start()

    def _due(self) -> None:
        with self.lock or threading.RLock():
            self._timer = None
            self._end_periods(self._clock())
            waiting = [cause.until for cause in self._causes.values() if cause.left_out]
            if waiting:
                self._look_again(min(waiting) - self._clock())

    def _write(self, record: logging.LogRecord) -> None:
        try:
            stream = self._stream or sys.stderr
            stream.write(self.format(record) + "\n")
            stream.flush()
            self.lines[record.levelname.lower()] += 1
        except Exception:  # nobody reads it, or an argument does not fit its message: no reason to fail
            return


def _summary(cause: _Cause) -> logging.LogRecord:
    text = f"{cause.left_out} more lines within {PERIOD:g} s were left out: {VARIES.sub('…', cause.template)}"
    record = logging.LogRecord(cause.logger, cause.level, "", 0, text, None, None)
    record.left_out = cause.left_out
    return record


# -- format ------------------------------------------------------------------------------------------------


def formatter(form: Format) -> logging.Formatter:
    """Lines as text or as JSON."""
    render: list[Any] = [structlog.stdlib.ProcessorFormatter.remove_processors_meta]
    if form == "json":
        render += [
            structlog.processors.format_exc_info,
            structlog.processors.EventRenamer("message"),
            structlog.processors.JSONRenderer(ensure_ascii=False, default=str),
        ]
    else:
        render += [structlog.processors.format_exc_info, _text]
    return structlog.stdlib.ProcessorFormatter(
        processors=render,
        foreign_pre_chain=[
            structlog.contextvars.merge_contextvars,
            _carried,
            structlog.stdlib.add_log_level,
            structlog.stdlib.add_logger_name,
            structlog.processors.TimeStamper(fmt="%Y-%m-%dT%H:%M:%S.%fZ", utc=True, key="time"),
        ],
    )


def _carried(logger: Any, method: str, event: Event) -> Event:
    """What the record itself carries: from another process, or given with the line."""
    record: logging.LogRecord = event["_record"]
    event.update(getattr(record, "bound", {}))
    event.update({name: getattr(record, name) for name in SHOWN if hasattr(record, name)})
    if len(event["event"]) > LONGEST:
        event["event"] = event["event"][:LONGEST] + " …"
    if record.exc_text and not record.exc_info:
        event["exception"] = record.exc_text
    return event


def _text(logger: Any, method: str, event: Event) -> str:
    """A line for people: when, how grave, what; the asset and the window where the message does not name them."""
    message = printable(" ".join(event["event"].split()))
    named = [f"{key}={event[key]}" for key in ("asset", "window") if key in event and str(event[key]) not in message]
    line = f"{event['time']} {event['level']}: {message}" + (f" ({', '.join(named)})" if named else "")
    return f"{line}\n{event['exception']}" if event.get("exception") else line


# -- what else there is ------------------------------------------------------------------------------------


def _warned(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    """A warning, of this program, a library or numpy, as a line."""
    place = "/".join(filename.replace("\\", "/").split("/")[-3:])
    logging.getLogger("warnings").warning(f"{category.__name__}: {message} ({place}, line {lineno})")


def _thread_failed(failed: Any) -> None:
    """A thread that has ended with an exception that nobody expected."""
    if failed.exc_type is SystemExit:
        return
    name = failed.thread.name if failed.thread else "a thread"
    given = (failed.exc_type, failed.exc_value, failed.exc_traceback)
    logging.getLogger("service.threads").critical("the thread %s ended with an internal error", name, exc_info=given)
