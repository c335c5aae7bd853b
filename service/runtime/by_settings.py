"""What the settings say of the twin and of the network."""

from __future__ import annotations

from functools import partial

from service.runtime.twin_port import Twin, gear_twin
from service.settings import Settings
from service.transport.protocol import OpenTransport

CONNECT_WAIT = 2.0  # how long one attempt to reach an external router takes [s]


def twin_of(settings: Settings) -> Twin:
    """The twin itself with the options of the settings."""
    from service.files.detectability import nulls_of
    from twin.options import Options

    baseline = relation = None
    if settings.baseline is not None:
        from service.files.baseline import read_baseline

        baseline = read_baseline(settings.baseline)
    if settings.relation is not None:
        from service.files.relation import read_relation

        relation = read_relation(settings.relation)
    return gear_twin(
        Options(
            update=settings.update,
            error_threshold=settings.error_threshold,
            trace=settings.trace,
            false_alarm_rate=settings.false_alarm_rate,
            nulls=nulls_of(settings.detectability),
            baseline=baseline,
            relation=relation,
            status_limits=settings.status_limits,
        )
    )


def zenoh_of(settings: Settings) -> OpenTransport:
    """Zenoh at the endpoints of the settings."""
    from service.transport.zenoh import open_zenoh

    links = settings.zenoh_links
    return partial(open_zenoh, settings.listen, settings.connect, settings.prefix, CONNECT_WAIT, links)
