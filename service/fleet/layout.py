"""Where a fleet keeps what: in one schema of one PostgreSQL database, with the tables of a service and some of its own.

An asset belongs to the partition that its id hashes to, whatever it is called; one that takes over another one's frames
is in the same partition as that. Its row says so (`assets.share`). The number of partitions is fixed when the fleet is
created. A partition is the share of the assets whose frames one process receives; which host has it is leased
(`lease`).

All tables of a fleet are of one revision. Hosts and front ends of a program with another one write nothing.

The keys of a partition's assets begin with `fleet/`, its number and the prefix: whoever receives it subscribes to
nothing else. A fleet of one partition has nothing to tell apart and uses the prefix as it is, so that what publishes to
`serve` publishes to it as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import blake2b

import sqlalchemy as sa
from sqlalchemy import BigInteger, Column, Connection, Integer, LargeBinary, MetaData, Table, Text

from service.errors import NewerTables, StoreError
from service.results.migrate import VERSION_TABLE, make_tables
from service.results.schema import ASSETS, NAMES, REVISION
from service.results.store import Tables
from service.stream.wire.topics import PREFIX

SCHEMA = "fleet"
NEW_PARTITIONS, MOST_PARTITIONS = 8, 1000  # of a new fleet where nobody says, and of any
END_WAIT = 20.0  # for the end of a host in good order [s]
ASSETS_A_PARTITION = 600  # beyond it, Zenoh's recovery of what publishers keep takes longer than a restart
_LOCK = 7_219_433  # of whoever makes the tables; other numbers are in `claims` and `migrate`

METADATA = MetaData()
PARTITIONS = Table(
    "partitions",
    METADATA,
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("token", BigInteger, nullable=False, server_default="0"),  # of whoever may commit
    Column("host", Text),  # that serves it; null for none
    Column("prefix", Text, nullable=False),  # of the fleet's keys: the same in all rows
)
CURVES = Table(
    "curves",
    METADATA,
    Column("asset", Text, primary_key=True),
    Column("name", Text, primary_key=True),  # of what it was made from
    Column("data", LargeBinary, nullable=False),  # compressed points: see `kept_curves`
)
_PRESENT: sa.Select = sa.select(sa.column("version_num", Text)).select_from(sa.table(VERSION_TABLE))  # revision
_SHARED = _PRESENT.with_for_update(read=True)
_SHARE = (
    sa.select(ASSETS.c.share).join(NAMES, NAMES.c.asset == ASSETS.c.asset).where(NAMES.c.name == sa.bindparam("of"))
)


@dataclass(frozen=True, slots=True)
class Layout:
    """A fleet's division into partitions.

    prefix  the first part of its keys, where it has one partition
    """

    partitions: int
    prefix: str = PREFIX

    def partition_of(self, asset: str) -> int:
        """The partition of an asset, or of the stream of this name."""
        return partition_of(asset, self.partitions)

    def prefix_of(self, partition: int) -> str:
        """The first part of the keys under which the assets of a partition publish."""
        return self.prefix if self.partitions == 1 else f"{SCHEMA}/{partition:03d}/{self.prefix}"

    def demand(self, partitions: int | None, prefix: str | None) -> Layout:
        """The layout itself; StoreError where the fleet was created with others than those that are set."""
        for name, is_set, own, why in (
            ("partitions", partitions, self.partitions, "the assets are divided by it"),
            ("prefix", prefix, self.prefix, "its publishers send under it"),
        ):
            if is_set not in (None, own):
                raise StoreError(
                    f"{name} = {is_set}: this fleet was created with {own}, which stays, because {why}; leave the "
                    "setting out, or set it to that"
                )
        return self

    @property
    def all(self) -> range:
        return range(self.partitions)


def partition_of(asset: str, partitions: int) -> int:
    """The partition of an asset; the same on every machine and in every release."""
    digest = blake2b(asset.encode(), digest_size=8, person=b"gear-twin").digest()
    return int.from_bytes(digest, "big") % partitions


def folder_of(partition: int) -> str:
    """The name of a partition's folder within the fleet's."""
    return f"p{partition:03d}"


def share_of(database: Tables, name: str, layout: Layout) -> int:
    """The partition of an asset, or of the stream of a name: where it is, and for a new one that of its hash."""
    found = database.rows(_SHARE, {"of": name})
    return found[0][0] if found else layout.partition_of(name)


def create(engine: sa.Engine, partitions: int | None = None, prefix: str | None = None) -> Layout:
    """Makes the tables, or finds them; the layout.

    partitions, prefix  None: those that the fleet has, or for a new one 8 and `gearbox`

    Raises StoreError where the fleet was created with others, or by another program.
    """
    new = Layout(NEW_PARTITIONS if partitions is None else partitions, prefix or PREFIX)
    if not 1 <= new.partitions <= MOST_PARTITIONS:
        raise StoreError(f"partitions = {partitions} must be from 1 to {MOST_PARTITIONS}")
    with engine.begin() as db:
        db.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_LOCK})")
        encoding = db.exec_driver_sql("SHOW server_encoding").scalar_one()
        if encoding != "UTF8":
            raise StoreError(f"the database has the encoding {encoding}: a fleet needs one with ENCODING 'UTF8'")
        db.exec_driver_sql(f"CREATE SCHEMA IF NOT EXISTS {SCHEMA}")
        layout = _layout(db)
        if layout is None:
            make_tables(db)
            METADATA.create_all(db)
            db.execute(sa.insert(PARTITIONS), [{"number": number, "prefix": new.prefix} for number in new.all])
            return new
    return layout.demand(partitions, prefix)


def layout_of(engine: sa.Engine) -> Layout | None:
    """The layout of a fleet; None where the database holds none. StoreError where another program made it."""
    with engine.connect() as db:
        return _layout(db)


def _layout(db: Connection) -> Layout | None:
    tables = sa.inspect(db)
    if tables.has_table("facts"):  # a fleet with a schema for each partition
        refuse_other("0")
    if not tables.has_table(PARTITIONS.name):
        return None
    refuse_other(db.execute(_PRESENT).scalar())
    return Layout(*db.execute(sa.select(sa.func.count(), sa.func.min(PARTITIONS.c.prefix))).one())


def expect_revision(db: Connection) -> None:
    """At the begin of a transaction that writes: the fleet's tables are, and stay until its end, of this revision."""
    refuse_other(db.execute(_SHARED).scalar())


def look(database: Tables) -> None:
    """StoreError where the fleet's tables are of another release."""
    refuse_other(database.rows(_PRESENT)[0][0])


def refuse_other(present: str | None) -> None:
    """StoreError where a fleet's tables are not of this program's revision; NewerTables where a newer one made them."""
    if present is None:
        raise StoreError("the database holds no fleet")
    if int(present) > int(REVISION):
        raise NewerTables(
            f"the fleet's tables have revision {present}, this program knows up to {REVISION}: they were written by a "
            "newer gear-twin, and this one writes nothing; install that release here, too"
        )
    if present != REVISION:
        raise StoreError(
            "the fleet's tables are from before the first release, which no program reads any more: begin with an "
            "empty database, and assess the recordings anew (gear-twin replay)"
        )
