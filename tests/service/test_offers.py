"""The table of offers: what was received follows into it, what people have said comes back, and nobody waits for it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import sqlalchemy as sa

from service.errors import StorageUnavailable
from service.files.rig_difference import differences, digest_of
from service.results.jobs import RIG_REJECTED, Jobs
from service.results.names import Names
from service.results.offers import ASSET, LEFT_OUT, RIG, Offers
from service.results.schema import OFFERS
from service.results.unknown_assets import UnknownAssets
from service.runtime.offer_writer import EVERY, OfferWriter
from service.runtime.rigs import GivenRigs, Rigs
from service.runtime.storage_watch import StorageWatch

NS = 1_000_000_000
EXPIRE = 60.0
PRESENT = {"gears": {"face_width": 0.02}}


class Known:
    """The assets that there are, by what the database says, each with the rig file in use."""

    def __init__(self, store):
        self.names, self.rigs = Names(store.database), {}

    def has(self, name):
        return not self.names.is_free(name)

    def latest(self, name):
        return SimpleNamespace(rig=self.rigs.get(name)) if self.has(name) else None


class Receiver:
    """Whoever receives, from one start on; its clock stands still unless it is moved."""

    def __init__(self, store, now=1000.0, *, asks=True, given=None, **limits):
        self.now, self.store, self.known, self.offers = now, store, Known(store), Offers(store.database)
        clock = {"clock": lambda: self.now, "now_ns": lambda: round(self.now * NS)}
        self.unknown = UnknownAssets(asks=asks, expire=EXPIRE, **limits, **clock)
        self.rigs = Rigs(store, self.known, given or GivenRigs(), asks=asks)
        self.writer = OfferWriter(self.offers, Jobs(store.database), self.unknown, self.rigs, clock=lambda: self.now)
        self.unknown.begin(self.known.has, ())

    def receive(self, *streams, channel="accel/y6"):
        for stream in streams:
            self.unknown.admits(stream, channel)

    def write(self, after=EVERY):
        self.now += after
        self.writer()

    def adopt(self, name, rig=None):
        self.store.note(name, [("change", {"kind": "adopted"})])
        self.known.rigs[name] = rig

    def restarted(self, after=0.0):
        again = Receiver(self.store, self.now + after)
        again.known.rigs = self.known.rigs
        return again


def keys(store):
    return set(
        map(tuple, store.database.rows(sa.select(OFFERS.c.kind, OFFERS.c.name).where(OFFERS.c.kind != LEFT_OUT)))
    )


def listed(store):
    return [each.asset for each in Offers(store.database).unknown()]


@pytest.fixture
def statements(each_store, monkeypatch):
    """How many times the database was asked or told anything."""
    said = []
    for name in ("transaction", "rows"):
        plain = getattr(each_store.database, name)
        monkeypatch.setattr(
            each_store.database, name, lambda *given, plain=plain, name=name: (said.append(name), plain(*given))[1]
        )
    return said


# -- unknown assets --------------------------------------------------------------------------------------


def test_an_unknown_asset_is_a_row_with_what_is_known_of_it_and_reserves_no_name(each_store):
    receiver = Receiver(each_store)
    receiver.receive("new", "new")
    receiver.receive("new", channel="accel/x6")
    receiver.unknown.offered("new", PRESENT, 40)
    receiver.write()
    found = receiver.offers.find("new")
    assert (found.frames, found.channels, found.first_ns) == (3, {"accel/y6", "accel/x6"}, 1000 * NS)
    assert (found.rig, found.digest) == (PRESENT, digest_of(PRESENT)) and receiver.offers.proposals() == []
    assert each_store.assets() == () and Names(each_store.database).is_free("new")
    receiver.receive("new")
    receiver.now += 5
    receiver.write()
    assert (receiver.offers.find("new").frames, receiver.offers.find("new").rig) == (4, PRESENT)


def test_the_table_is_written_once_a_second_at_most_and_only_where_something_has_changed(each_store, statements):
    receiver = Receiver(each_store)
    statements.clear()
    receiver.write()
    assert statements == []  # nothing has ever come
    for _ in range(50):
        receiver.receive("a", "b")
        receiver.write(after=0.1)
    assert statements.count("transaction") <= 6 and listed(each_store) == ["a", "b"]
    statements.clear()
    receiver.receive("a")
    for _ in range(5):
        receiver.write()
    assert statements.count("transaction") == 1


def test_a_dismissed_asset_stays_off_the_list_for_its_time_also_after_a_restart(each_store):
    receiver = Receiver(each_store)
    receiver.receive("a", "b")
    receiver.unknown.offered("b", PRESENT, 40)
    receiver.write()
    receiver.offers.dismiss("b", round(receiver.now * NS))
    assert listed(each_store) == ["a"] and keys(each_store) == {(ASSET, "a"), (ASSET, "b")}
    receiver.receive("a", "b")
    receiver.unknown.offered("b", PRESENT, 40)  # before whoever receives has read it
    receiver.write()
    receiver.receive("a", "b")
    receiver.write()
    assert listed(each_store) == ["a"] and receiver.offers.find("b") is None
    receiver = receiver.restarted(after=EXPIRE - 10)
    receiver.receive("a", "b")
    receiver.write()
    assert listed(each_store) == ["a"] and keys(each_store) == {(ASSET, "a"), (ASSET, "b")}
    receiver.write(after=20.0)
    assert keys(each_store) == {(ASSET, "a")}
    receiver.receive("b")
    receiver.write()
    assert listed(each_store) == ["a", "b"]


def test_an_asset_that_is_listed_as_soon_as_its_dismissal_has_ended_is_listed_for_people_too(each_store):
    receiver = Receiver(each_store)
    receiver.receive("b")
    receiver.write()
    receiver.offers.dismiss("b", round(receiver.now * NS))
    receiver.write()
    receiver.now += EXPIRE + 1
    receiver.receive("another", "b")  # between two looks
    receiver.write()
    assert receiver.offers.find("b").frames == 1


def test_a_restart_begins_with_the_list_as_it_was_written_but_for_what_has_fallen_silent_for_long(each_store):
    first = Receiver(each_store)
    first.receive("a", "b", "b")
    first.unknown.offered("b", PRESENT, 40)
    first.write()
    first.now += 40
    first.receive("b")
    first.write()
    again = first.restarted(after=30.0)
    again.receive("b")
    again.write()
    (entry,) = again.offers.unknown()
    assert (entry.asset, entry.frames, entry.first_ns, entry.rig) == ("b", 4, 1000 * NS, PRESENT)
    assert keys(each_store) == {(ASSET, "b"), (RIG, "b")} and again.unknown.frames == 1  # since the start


def test_a_service_that_adopts_takes_away_what_one_that_asked_has_left(each_store):
    asked = Receiver(each_store)
    asked.receive("a")
    asked.unknown.offered("a", PRESENT, 40)
    asked.write()
    adopts = Receiver(each_store, asked.now, asks=False)
    adopts.write()
    assert keys(each_store) == set()


def test_rows_are_bounded_in_number_and_in_bytes_of_rig_files(each_store):
    receiver = Receiver(each_store, most=20)
    for number in range(300):
        receiver.receive(f"a{number}")
        receiver.unknown.offered(f"a{number}", {"n": number}, 200_000)
        if number % 30 == 0:
            receiver.write()
            receiver.offers.dismiss(receiver.offers.unknown()[0].asset, round(receiver.now * NS))
    receiver.write()
    found = receiver.offers.unknown()
    assert len(found) == 20 and len([name for kind, name in keys(each_store) if kind == ASSET]) <= 40
    assert {name for kind, name in keys(each_store) if kind == RIG} == {u.asset for u in found if u.rig is not None}
    assert sum(u.rig_bytes for u in found) <= 2**21 and receiver.offers.left_out() == (300, receiver.unknown.forgotten)
    assert receiver.offers.figures() == {
        "unknown_assets": 20, "unknown_asset_frames": 300, "unknown_assets_forgotten": receiver.unknown.forgotten,
        "rig_proposals": 0,
    }  # fmt: skip


def test_nobody_who_receives_waits_for_a_storage_that_cannot_be_used_and_nothing_is_lost(each_store, monkeypatch):
    receiver, storage = Receiver(each_store), StorageWatch("here", lambda: receiver.now)
    receiver.receive("a")
    with monkeypatch.context() as away:

        def unavailable(**given):
            raise StorageUnavailable("here cannot be used now (locked)", reason="locked")

        away.setattr(receiver.offers, "write", unavailable)
        receiver.rigs.propose("a", PRESENT)
        for _ in range(3):
            receiver.now += 20
            assert storage.attempt(receiver.writer) == (False, None)
            receiver.receive("a", "b")
    receiver.adopt("a")
    receiver.write(after=20.0)
    assert listed(each_store) == ["b"] and receiver.offers.find("b").frames == 3
    assert [p.rig for p in receiver.offers.proposals()] == [PRESENT]


# -- rig files -------------------------------------------------------------------------------------------


def test_a_rig_file_that_was_offered_for_an_asset_is_its_proposal_from_the_adoption_on(each_store):
    receiver = Receiver(each_store)
    receiver.receive("new")
    receiver.unknown.offered("new", PRESENT, 40)
    receiver.write()
    receiver.adopt("new")
    (proposal,) = receiver.offers.proposals()  # before whoever receives knows it
    assert (proposal.asset, proposal.rig, listed(each_store)) == ("new", PRESENT, [])
    receiver.write()
    assert receiver.offers.proposals() == [proposal] and keys(each_store) == {(RIG, "new")}


@pytest.mark.parametrize("given", [None, GivenRigs(all=({"name": "of the settings"}, "rig"))])
def test_one_that_is_in_use_or_cannot_be_is_none(each_store, given):
    receiver = Receiver(each_store, given=given)
    receiver.receive("new")
    receiver.unknown.offered("new", PRESENT, 40)
    receiver.write()
    receiver.adopt("new", rig=PRESENT if given is None else None)
    receiver.write()
    assert receiver.offers.proposals() == [] and keys(each_store) == set()


def test_an_asset_has_one_proposal_the_newest_and_what_was_rejected_does_not_come_back(each_store):
    receiver, jobs = Receiver(each_store), Jobs(each_store.database)
    receiver.adopt("a", rig=PRESENT)
    jobs.end(jobs.job(jobs.add("a", RIG_REJECTED, {"digest": digest_of({"n": 1})})))
    receiver.rigs.propose("a", {"n": 1})
    receiver.write()
    assert receiver.offers.proposal("a") is None
    for number in (2, 3):
        receiver.rigs.propose("a", {"n": number})
        receiver.write()
    (only,) = receiver.offers.proposals()
    assert only.rig == {"n": 3} and differences(PRESENT, only.rig)
    receiver.offers.end("a", digest_of({"n": 2}))  # decided on too late
    assert receiver.offers.proposal("a") == only
    receiver.rigs.propose("a", {"n": 3})
    receiver.write()
    assert receiver.offers.proposal("a") == only  # received when it came first
    jobs.end(jobs.job(jobs.add("a", RIG_REJECTED, {"digest": only.digest})))
    receiver.offers.end("a", only.digest)
    receiver.rigs.propose("a", {"n": 3})
    receiver.write()
    assert receiver.offers.proposals() == []


def test_a_proposal_is_there_after_a_restart_unless_it_is_none_any_more(each_store):
    first = Receiver(each_store)
    for name in ("a", "b"):
        first.adopt(name, rig=PRESENT)
        first.rigs.propose(name, {"n": 2})
    first.write()
    first.known.rigs["b"] = {"n": 2}
    again = first.restarted()
    again.write()
    assert [proposal.asset for proposal in again.offers.proposals()] == ["a"]
