"""What the settings say of the twin and of the network: the same for the service, the commands and Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.runtime.reception import assembly_settings
from service.runtime.twin_port import Twin, gear_twin
from service.settings import Settings
from service.transport.protocol import OpenTransport
from service.transport.zenoh_links import ZenohLinks

if TYPE_CHECKING:  # options are made where they are used: the service's own process computes nothing
    from twin.options import Options

CONNECT_WAIT = 2.0  # how long one attempt to reach an external router takes [s]


def twin_of(settings: Settings) -> Twin:
    """The twin itself with the options of the settings."""
    return gear_twin(options_of(settings))


def options_of(
    settings: Settings,
    *,
    update: str | None = None,
    trace: bool = True,
    relation: Path | None = None,
    detectability: Path | None = None,
    false_alarm_rate: float | None = None,
) -> Options:
    """The options of the twin by the settings, and what is given in place of them.

    trace          False: effects are not searched for, whatever the settings say
    detectability  a file besides those of the settings

    Raises service.errors.InputError where a file cannot be used.
    """
    from service.files.detectability import read_nulls
    from twin.options import Options

    baseline, known, relation = None, None, relation or settings.relation
    if settings.baseline is not None:
        from service.files.baseline import read_baseline

        baseline = read_baseline(settings.baseline)
    if relation is not None:
        from service.files.relation import read_relation

        known = read_relation(relation)
    return Options(
        update=update or settings.update,
        error_threshold=settings.error_threshold,
        trace=settings.trace and trace,
        false_alarm_rate=settings.false_alarm_rate if false_alarm_rate is None else false_alarm_rate,
        nulls=dict(map(read_nulls, detectability_files(settings, detectability))),
        baseline=baseline,
        relation=known,
        status_limits=settings.status_limits,
    )


def detectability_files(settings: Settings, given: Path | None) -> list[Path]:
    """The files about simulated healthy machines: those of the settings, and the one that was given."""
    return [*settings.detectability, *([] if given is None else [given])]


def assess_by_settings(
    settings: Settings,
    recording: str | Path,
    rig: str | Path | None = None,
    *,
    asset: str | None = None,
    progress: Callable[[float, int], None] = lambda share, windows: None,
    enough: Callable[[Any], bool] = lambda records: False,
    **given: Any,
) -> dict[str, Any]:
    """The answer about a recording's asset as a service with these settings gives it.

    given  options in place of those of the settings, as in `options_of`

    Raises service.errors.InputError where the recording or a file cannot be used.
    """
    from service.runtime.assess import assess

    return assess(
        recording, rig, options_of(settings, **given), progress, asset=asset, prefix=settings.prefix,
        assembly=assembly_settings(settings), enough=enough,
    )  # fmt: skip


def zenoh_of(settings: Settings, within: Path | None = None) -> OpenTransport:
    """Zenoh at the endpoints of the settings.

    within  a folder of this service's alone, in which an embedded router listens for the service's other processes
    """
    from service.transport.zenoh import open_zenoh

    links, listen = settings.zenoh_links, list(settings.listen)
    if within is not None and not settings.connect:
        listen.append(socket_in(within))
    return partial(open_zenoh, listen, settings.connect, settings.prefix, CONNECT_WAIT, links, answers_alone=True)


def client_of(settings: Settings, within: Path) -> OpenTransport:
    """Zenoh for another process of a service, as a client of the service's router, or of that which it is a client of.

    The embedded router lets it in as the first of the users whom it knows.
    """
    from service.transport.zenoh import open_zenoh

    if settings.connect:
        return partial(open_zenoh, (), settings.connect, settings.prefix, CONNECT_WAIT, settings.zenoh_links)
    links, users = ZenohLinks(), settings.zenoh_users
    if users is not None and users.is_file():
        user, _, password = users.read_text(encoding="utf-8").strip().partition("\n")[0].strip().partition(":")
        links = ZenohLinks(user=user, password=password)
    return partial(open_zenoh, (), (socket_in(within),), settings.prefix, CONNECT_WAIT, links)


def socket_in(folder: Path) -> str:
    """The endpoint of a folder."""
    from service.transport.zenoh_session import WITHIN

    return f"{WITHIN}/{folder}/zenoh"
