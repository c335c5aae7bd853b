"""A partition whose loops hang counts as not served, and one notification ends nothing."""

from __future__ import annotations

import pytest
import sqlalchemy as sa
from service_streams import wait_until

from service.fleet.databases import engine_of, worker_tables
from service.fleet.fence import Fence
from service.fleet.heartbeat import Heartbeat
from service.fleet.layout import PARTITIONS, Layout
from service.operation.health import RECEPTION, Health
from service.results.sql_store import SqlStore

pytestmark = pytest.mark.slow


def test_a_worker_whose_reception_hangs_is_silent_until_it_turns_again(fleet, caplog):
    """It counted as served for ever: nobody asked whether its loops turned."""
    now = [0.0]
    health = Health(limit=60.0, clock=lambda: now[0])
    beat, engine = health.loop(RECEPTION), engine_of(fleet, poolclass=sa.NullPool)

    def seen():
        with engine.connect() as db:
            return db.execute(sa.select(PARTITIONS.c.seen_ns).where(PARTITIONS.c.number == 0)).scalar()

    fence = Fence(partition=0)
    with SqlStore(worker_tables(fleet, fence, Layout(3)), claimed=True):
        heart = Heartbeat(fleet, fence, dict, lambda: None, health.late)
        heart.start()
        before = seen()
        wait_until(lambda: seen() != before)
        now[0] += 61.0
        wait_until(lambda: "is silent until its loops turn again" in caplog.text)
        before = seen()
        assert not heart._stopping.wait(2.5) and seen() == before
        beat()
        wait_until(lambda: seen() != before)
        heart.end()
    assert caplog.text.count("is silent") == 1 and f"{RECEPTION}: no turn since" in caplog.text
