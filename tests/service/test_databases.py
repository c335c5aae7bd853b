"""SQLite and PostgreSQL alike: what stores of single things do, and what becomes of a server that goes away."""

from __future__ import annotations

import threading

import pytest
import service_fakes as fakes
import sqlalchemy as sa
from service_streams import wait_until
from sqlalchemy.exc import DBAPIError

from service.errors import SteppedBack, StorageUnavailable
from service.results import backends, commit_marks
from service.results.backends import Postgresql
from service.results.commit_marks import Mark
from service.results.database import Database
from service.results.jobs import Jobs
from service.results.schema import COMMITS, JOBS, PEOPLES
from service.results.segment_file import read_segment
from service.results.sql_store import SqlStore
from service.results.window_jobs import WindowJobs


def test_a_job_is_carried_out_once_with_all_that_it_changes(each_store):
    fakes.campaign(each_store, None)
    jobs = Jobs(each_store.database)
    number = fakes.inspect(each_store, "unsw", {"revolutions": 10.0}, {"twin": {}})
    (waiting,) = jobs.pending()
    given = {"outcome": {"twin": 1}, "state": {"n": 2}, "report": {}, "events": [("inspection", {"id": number})]}
    assert fakes.carry_out(each_store, waiting, **given) and not fakes.carry_out(each_store, waiting, **given)
    assert jobs.job(number).done and jobs.job(number).outcome == {"twin": 1}
    assert each_store.asset("unsw").state == {"n": 2} and jobs.pending() == ()
    assert [i.id for i in jobs.of("unsw", "inspection")] == [number]
    assert jobs.of("unsw", "inspection", after=number) == () == jobs.of("unsw", "decision")


def test_jobs_of_all_kinds_wait_in_the_order_in_which_they_were_submitted(each_store, tmp_path):
    each_store.note("unsw", [])
    jobs = Jobs(each_store.database)
    numbers = [fakes.decide(each_store, "unsw", "misalignment", "pin"), jobs.add("unsw", "oil_changed", {"by": "Anna"})]
    life = WindowJobs(each_store.database, tmp_path / "segments")
    assert life.add_waiting("unsw", life.write(fakes.SEGMENT))
    numbers += [fakes.inspect(each_store, "unsw", {"revolutions": 10.0}, {}), jobs.add("mill", "retired", {})]
    assert [job.id for job in jobs.pending()] == numbers
    jobs.refuse(jobs.job(numbers[0]), "no window has been processed yet")
    assert [job.id for job in jobs.pending()] == numbers[1:]
    assert [job.kind for job in jobs.changes("unsw")] == ["oil_changed"]


def test_what_people_ask_is_found_among_any_number_of_windows_that_wait(each_store):
    """It is looked for every other second; every window that waits was read each time."""
    fakes.campaign(each_store, None)
    number = fakes.decide(each_store, "unsw", "misalignment", "accept")
    window = {"asset": "unsw", "received_ns": 1, "kind": "window", "start_ns": 1, "bytes": 1}
    with each_store.database.transaction() as db:
        db.execute(sa.insert(JOBS), [window] * 5000)
        if db.dialect.name == "postgresql":
            db.exec_driver_sql("ANALYZE jobs")
    assert [job.id for job in fakes.jobs_of(each_store).pending()] == [number]
    explain = "EXPLAIN" if each_store.path is None else "EXPLAIN QUERY PLAN"
    plan = each_store.database.rows(sa.text(f"{explain} SELECT * FROM jobs WHERE {PEOPLES} ORDER BY id"))
    assert "jobs_of_people" in str(plan)


def test_decisions_are_counted_by_what_became_of_them(each_store):
    fakes.take(each_store, None, "unsw", 0, 100.0)
    jobs = Jobs(each_store.database)
    first = fakes.decide(each_store, "unsw", "misalignment", "pin", "Anna", "measured")
    second = fakes.decide(each_store, "unsw", "tooth_crack", "reject")
    assert fakes.carry_out(each_store, jobs.job(first), state={"n": 2}, report={"wear": {}})
    jobs.refuse(jobs.job(second), "there is no such effect")
    assert jobs.decision_counts() == {"unsw": {"pin": 1}} and jobs.pending() == ()
    assert [(d.given["by"], d.refused) for d in fakes.decisions(each_store, "unsw")] == [
        ("Anna", None), (None, "there is no such effect"),
    ]  # fmt: skip


def test_windows_that_wait_are_given_to_another_asset(each_store, tmp_path):
    life = WindowJobs(each_store.database, tmp_path / "segments")
    each_store.note("unsw", [])
    assert life.add_waiting("unsw", life.write(fakes.SEGMENT))
    life.give_waiting("unsw", "other")
    (waiting,) = life.waiting("other")
    assert life.waiting("unsw") == () and read_segment(life.path_of(waiting)).start_ns == waiting.start_ns
    life.drop_waiting(waiting)
    assert life.waiting("other") == ()


def test_who_writes_alone_asks_once_whether_an_asset_has_a_row(tmp_path):
    with SqlStore(tmp_path / "alone.sqlite", claimed=True) as store:
        database, asked = store.database, []
        sa.event.listen(
            database._writer, "before_cursor_execute",
            lambda *given: asked.append(given[2]) if given[2].startswith("INSERT INTO assets") else None,
        )  # fmt: skip
        with pytest.raises(RuntimeError), database.transaction() as db:
            database.ensure(db, "press")
            raise RuntimeError
        for _ in range(3):
            store.note("press", [("note", {})])
        assert store.assets() == ("press",) and len(asked) == 2


def test_totals_of_faults_add_up(each_store):
    for index in range(3):
        fakes.take(each_store, None, "unsw", index, 100.0 * index, faults=(fakes.FAULT,), quality="degraded")
    assert each_store.asset("unsw").fault_totals == {("gap", "accel/y6", "degraded"): (9, 3)}


# -- a server that goes away ------------------------------------------------------------------------------


@pytest.mark.slow
def test_server_that_was_set_up_without_a_locale_keeps_names_as_they_are(postgresql_server):
    with postgresql_server.new_database("SQL_ASCII") as url, SqlStore(url) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        fakes.decide(store, "unsw", "misalignment", "pin", "Zoë Łącka", "measured: 3 µm")
        (decision,) = fakes.decisions(store, "unsw")
        assert (decision.given["by"], decision.given["note"]) == ("Zoë Łącka", "measured: 3 µm")


def test_connections_that_the_server_dropped_are_replaced(postgresql, postgresql_server):
    with SqlStore(postgresql) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        drop = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'gear-twin'"
        assert postgresql_server.sql(drop)
        assert len(store.windows("unsw")) == 1
        assert postgresql_server.sql(drop)
        assert fakes.take(store, None, "unsw", 1, 200.0)


def test_server_that_is_stopped_is_waited_for_and_nothing_is_half_done(postgresql, postgresql_server):
    with SqlStore(postgresql) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        postgresql_server.stop()
        try:
            for attempt in (lambda: fakes.take(store, None, "unsw", 1, 200.0), lambda: store.windows("unsw")):
                with pytest.raises(StorageUnavailable) as caught:
                    attempt()
                assert caught.value.reason == "connection lost" and "\n" not in str(caught.value)
        finally:
            postgresql_server.start()
        assert [w.record["index"] for w in store.windows("unsw")] == [0]
        assert fakes.take(store, None, "unsw", 1, 200.0)


def test_connection_that_is_lost_within_a_transaction_leaves_nothing_of_it(postgresql, postgresql_server):
    with SqlStore(postgresql) as store:
        with pytest.raises(StorageUnavailable) as caught, store.database.transaction() as db:
            fakes.take(store, None, "unsw", 0, 100.0)
            (pid,) = db.exec_driver_sql("SELECT pg_backend_pid()").one()
            postgresql_server.sql(f"SELECT pg_terminate_backend({pid}, 5000)")
            fakes.take(store, None, "unsw", 1, 200.0)
        assert caught.value.reason == "connection lost" and not caught.value.unknown
        assert store.windows("unsw") == ()
        assert fakes.take(store, None, "unsw", 0, 100.0)


@pytest.mark.parametrize("carried_out", [True, False])
def test_commit_that_was_not_answered_is_found_out(postgresql, postgresql_server, monkeypatch, carried_out):
    """The connection is lost before the commit or, with its answer, after it."""
    with SqlStore(postgresql) as store:
        dialect = store.database._writer.dialect
        commit = dialect.do_commit

        def lost(connection):
            if carried_out:
                commit(connection)
            postgresql_server.sql(f"SELECT pg_terminate_backend({connection.driver_connection.info.backend_pid}, 5000)")
            connection.execute("SELECT 1")

        monkeypatch.setattr(dialect, "do_commit", lost)
        if carried_out:
            assert fakes.take(store, None, "unsw", 0, 100.0)
        else:
            with pytest.raises(StorageUnavailable) as caught:
                fakes.take(store, None, "unsw", 0, 100.0)
            assert caught.value.reason == "connection lost" and not caught.value.unknown
        monkeypatch.setattr(dialect, "do_commit", commit)
        assert len(store.windows("unsw")) == carried_out
        assert fakes.take(store, None, "unsw", 1, 200.0)


@pytest.mark.slow
def test_commit_that_a_crash_has_undone_is_not_taken_for_that_of_another_transaction(
    postgresql, postgresql_server, monkeypatch
):
    """PostgreSQL gives the number of a transaction that it had not written yet to another one after a crash.

    A window was acknowledged and lost, one in some hundred kills of a server that several workers wrote to. The server
    writes its log at commits alone here, so that nothing of the transaction is written before it is killed.
    """
    postgresql_server.sql("ALTER SYSTEM SET wal_writer_delay = '10s'")
    postgresql_server.sql("SELECT pg_reload_conf()")
    with SqlStore(postgresql) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        dialect = store.database._writer.dialect
        commit, given = dialect.do_commit, []

        def crashed(connection):
            with connection.cursor() as cursor:
                cursor.execute("SELECT pg_current_xact_id()::text")
                (own,) = cursor.fetchone()
            monkeypatch.setattr(dialect, "do_commit", commit)
            postgresql_server.kill()
            wait_until(lambda: _starts(postgresql_server), 30)
            while not given or int(given[-1]) < int(own):
                given.extend(number for (number,) in postgresql_server.sql("SELECT pg_current_xact_id()::text"))
            assert own in given and postgresql_server.sql(f"SELECT pg_xact_status('{own}')") == [("committed",)]
            connection.execute("SELECT 1")

        monkeypatch.setattr(dialect, "do_commit", crashed)
        with pytest.raises(StorageUnavailable) as caught:
            fakes.take(store, None, "unsw", 1, 200.0)
        assert caught.value.reason == "connection lost" and not caught.value.unknown
        assert len(store.windows("unsw")) == 1
        assert fakes.take(store, None, "unsw", 1, 200.0)


def _starts(server):
    try:
        server.start()
    except AssertionError:
        return False
    return True


def test_who_writes_leaves_one_row_and_rows_of_the_past_go(postgresql, postgresql_server):
    with SqlStore(postgresql) as store:
        for index in range(3):
            fakes.take(store, None, "unsw", index, 100.0 * (index + 1))
        with store.database.transaction() as db:
            old = sa.insert(COMMITS).values(writer="long ago", number=7, written_ns=0)
            db.execute(old)
        assert sorted(number for (number,) in store.database.rows(sa.select(COMMITS.c.number)))[0] > 3
    with SqlStore(postgresql) as store:
        fakes.take(store, None, "unsw", 3, 400.0)
        writers = [writer for (writer,) in store.database.rows(sa.select(COMMITS.c.writer))]
        assert "long ago" not in writers and len(writers) == 2


@pytest.mark.parametrize("claimed", [True, False])
def test_server_without_what_it_had_confirmed_is_said_by_who_has_the_claim_each_time_and_by_others_once(
    postgresql, postgresql_server, claimed
):
    with SqlStore(Database(postgresql, claimed=claimed, shared=not claimed)) as store:
        store.note("unsw", [])

        def lose():
            postgresql_server.sql("DELETE FROM commits", postgresql.rpartition("/")[2])
            store.database.close()

        lose()
        with pytest.raises(SteppedBack, match="does not have what it had confirmed"):
            store.note("unsw", [])
        if claimed:
            with pytest.raises(SteppedBack):
                store.note("unsw", [])
            return
        store.note("unsw", [])


def test_commit_whose_outcome_nobody_tells_is_said_to_be_unknown(postgresql, monkeypatch):
    monkeypatch.setattr(commit_marks, "OUTCOME_WAIT", 0.0)
    backend = backends.backend_of(postgresql)
    assert isinstance(backend, Postgresql)
    with pytest.raises(StorageUnavailable) as caught:
        backend.was_committed(backend.engines()[1], Mark("nobody", 1, "1"))
    assert caught.value.unknown and caught.value.reason == "connection lost"


def test_program_fault_is_not_taken_for_a_fault_of_the_storage(each_store):
    fakes.take(each_store, None, "unsw", 0, 100.0)
    with pytest.raises(DBAPIError), each_store.database.transaction() as db:
        db.exec_driver_sql("INSERT INTO events (asset, kind, data) VALUES ('nobody', 'x', '1')")
    assert each_store.assets() == ("unsw",)


def test_table_that_another_program_locks_is_given_up_in_time(postgresql, postgresql_server, monkeypatch):
    monkeypatch.setattr(backends, "LOCK_WAIT", 0.2)
    locked, release = threading.Event(), threading.Event()

    def hold():
        engine = backends.backend_of(postgresql).for_migration()
        with engine.connect() as db, db.begin():
            db.exec_driver_sql("LOCK TABLE windows IN ACCESS EXCLUSIVE MODE")
            locked.set()
            release.wait(20)
        engine.dispose()

    with SqlStore(postgresql) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        holder = threading.Thread(target=hold)
        holder.start()
        try:
            assert locked.wait(10)
            with pytest.raises(StorageUnavailable) as caught:
                fakes.take(store, None, "unsw", 1, 200.0)
            assert caught.value.reason == "locked"
        finally:
            release.set()
            holder.join()
        assert fakes.take(store, None, "unsw", 1, 200.0)
