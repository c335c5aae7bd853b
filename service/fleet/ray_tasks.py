"""Calls carried out by Ray: on this machine, with a Ray that is started and ended here, or by a cluster that is there.

A call whose process ends, because it was killed or the memory was short, is carried out again in another.
"""

from __future__ import annotations

import logging
import os
import secrets
import signal
import socket
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, TypeVar

from service.errors import InputError
from service.results.scratch import scratch
from service.runtime.usable_cores import usable_cores

AHEAD = 2  # calls that are handed over for each core, so that none waits for the next
RETRIES = 4  # how often a call is carried out again whose process ended
CONNECT_WAIT = 5.0  # for a cluster [s]
START_ATTEMPTS = 4  # to start one on this machine
STORE_BYTES = 80 * 2**20  # of shared memory: arguments and answers of calls are small
QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_register_timeout_seconds": "600",  # a process that is loading where cores are short is not killed
    "RAY_DEDUP_LOGS_SKIP_REGEX": ".",  # lines about a process that has ended: its call is carried out again
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",  # else a warning about machines without accelerators
}
ALONE = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}  # every port is of the loopback interface, as on those systems

Item = TypeVar("Item")


class ProcessEnded(Exception):
    """A call that ended its process each time."""


def carried_out(
    call: Callable[..., Any],
    given: Any,
    items: Iterable[Item],
    *,
    workers: int | None = None,
    address: str | None = None,
) -> Generator[tuple[Item, Any], None, None]:
    """`call(given, item)` for each item, as they are done: the item, and the answer, or a ProcessEnded.

    What a call raises is raised here, and ends the others.

    workers  calls at a time; None for the cores of this machine or of the cluster
    address  of a cluster; None for a Ray of this machine alone, which is ended with the iteration
    """
    goes_on = _is_started()
    with started(workers, address) as ray:
        cores = max(int(ray.cluster_resources().get("CPU", 1)), 1)
        most = workers if workers is not None and address is not None else AHEAD * cores
        # a retry is meant for processes that end: what the call raises is a fault of the call
        task = ray.remote(num_cpus=1, max_retries=RETRIES, retry_exceptions=False)(call)
        shared = ray.put(given)
        running: dict[Any, Item] = {}
        coming = iter(items)
        try:
            while True:
                while len(running) < most and (item := next(coming, None)) is not None:
                    running[task.remote(shared, item)] = item
                if not running:
                    return
                for done in ray.wait(list(running), num_returns=1)[0]:
                    yield running.pop(done), _answer(ray, done)
        finally:
            # what runs ends with this process's connection; called off at the same time, Ray may end in an abort
            for left in running if goes_on else ():
                ray.cancel(left, force=True)


def _is_started() -> bool:
    """Whether this process has a Ray already, which is left as it was."""
    return "ray" in sys.modules and bool(sys.modules["ray"].is_initialized())


def _answer(ray: Any, done: Any) -> Any:
    try:
        return ray.get(done)
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, (ray.exceptions.RaySystemError, ImportError)):
            said = str(error.cause).partition("\n")[0]
            raise InputError(f"a Ray node cannot run gear-twin: {said}: install the same version on each") from error
        raise error.cause from None
    except (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError) as error:
        return ProcessEnded(f"its process ended {RETRIES + 1} times ({type(error).__name__}): is there enough memory?")


@contextmanager
def started(workers: int | None, address: str | None) -> Iterator[Any]:
    """Ray, ready for calls; as it was where this process has one already."""
    for name, value in QUIET.items():
        os.environ.setdefault(name, value)
    if address is not None:
        _demand_answer(address)
    else:
        os.environ.update(ALONE)
        os.environ.setdefault("RAY_AUTH_MODE", "token")
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
    import ray

    if ray.is_initialized():
        yield ray
        return
    common: dict[str, Any] = {"logging_level": logging.ERROR, "log_to_driver": False, "configure_logging": False}
    with scratch() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            if address is None:
                _start_here(ray, workers or usable_cores(), _temp_dir=str(folder), **common)
            else:
                ray.init(address=address, **common)
        except (ConnectionError, ValueError) as error:
            said = str(error).partition("\n")[0]
            raise InputError(f"--address {address}: no Ray cluster answers there: {said}") from error
        try:
            with _ended_quietly():
                yield ray
        finally:
            with _standard_error_aside():
                ray.shutdown()


def _start_here(ray: Any, cores: int, **given: Any) -> None:
    """Starts a Ray of this machine alone; InputError where it has not begun after several attempts.

    Ray gives its own processes 30 s, which do not suffice where other programs have all cores.
    """
    for left in reversed(range(START_ATTEMPTS)):
        try:
            ray.init(
                num_cpus=cores, include_dashboard=False, _node_ip_address="127.0.0.1",
                object_store_memory=STORE_BYTES, **given,
            )  # fmt: skip
            return
        except Exception as error:  # Ray raises no narrower one
            ray.shutdown()
            if not left:
                said = str(error).partition("\n")[0]
                raise InputError(
                    f"Ray could not be started here: {said}: are the cores or the memory used up?"
                ) from error


def _demand_answer(address: str) -> None:
    """InputError where nobody listens at HOST:PORT: Ray itself would try for minutes."""
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not port.isdigit():  # such as auto, which Ray looks up
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_WAIT).close()
    except (OSError, OverflowError) as error:
        said = (getattr(error, "strerror", None) or str(error)).lower()
        raise InputError(f"--address {address}: no Ray cluster answers there: {said}") from None


@contextmanager
def _standard_error_aside() -> Iterator[None]:
    """Keeps what Ray's own code prints of calls that it breaks off from whoever ended the program."""
    kept = os.dup(2)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


@contextmanager
def _ended_quietly() -> Iterator[None]:
    """SIGTERM ends the iteration as Ctrl-C does; Ray would print where the program was."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: object) -> NoReturn:
        sys.exit(128 + number)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
