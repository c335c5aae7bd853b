"""Ray as this process uses it: a cluster that is there, or one of this machine alone, which ends with the process."""

from __future__ import annotations

import logging
import os
import secrets
import signal
import socket
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from service.errors import InputError
from service.results.scratch import scratch
from service.runtime.usable_cores import usable_cores

CONNECT_WAIT = 5.0  # for a cluster [s]
START_ATTEMPTS = 4  # to start one on this machine
STORE_BYTES = 80 * 2**20  # of shared memory: nothing large travels through Ray
NAMESPACE = "gear-twin"  # of the actors' names
ROOM = "host"  # the resource of which a node has one that is to be a host
QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_raylet_start_wait_time_s": "120",  # nor is a node given up that starts slowly,
    "RAY_worker_register_timeout_seconds": "600",  # or a process that is loading where cores are short
    "RAY_DEDUP_LOGS_SKIP_REGEX": ".",  # lines about a process that has ended: its work is begun again
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",  # else a warning about machines without accelerators
}
"""No report to Ray's makers, none of its own lines among those of the program, and patience on a busy machine."""
ALONE = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # every port is of the loopback interface, as on those systems
    "RAY_gcs_rpc_server_reconnect_timeout_s": "20",  # after its head has ended, Ray ends all of it
}


def is_started() -> bool:
    """Whether this process uses a Ray already."""
    return "ray" in sys.modules and bool(sys.modules["ray"].is_initialized())


@contextmanager
def ray_session(address: str | None, cores: int | None = None) -> Iterator[Any]:
    """Ray, ready for calls; as it was where this process uses one already.

    Ray reads its environment when it is imported, and nothing that imports it may be loaded before.

    address  of a cluster with a node on this machine; None for a Ray of this machine alone, whose token nobody else has
    cores    of that one; None for those of this machine

    Raises InputError where the cluster does not answer, or Ray cannot be started.
    """
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
    common: dict[str, Any] = {
        "logging_level": logging.ERROR, "log_to_driver": False, "configure_logging": False, "namespace": NAMESPACE,
    }  # fmt: skip
    with scratch() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            if address is None:
                _start_here(ray, cores or usable_cores(), _temp_dir=str(folder), **common)
            else:
                ray.init(address=address, **common)
        except (ConnectionError, RuntimeError, ValueError) as error:
            said = str(error).partition("\n")[0]
            raise InputError(
                f"--address {address}: no Ray cluster answers there, or it has no node on this machine "
                f"(ray start --address={address} --num-cpus=0): {said}"
            ) from error
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
    """SIGTERM ends the program as Ctrl-C does; Ray would print where the program was."""
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
