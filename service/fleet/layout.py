"""Where a fleet keeps what: one PostgreSQL database, a schema of its own for each partition, and one for all.

| schema | holds |
| --- | --- |
| `fleet` | the number of partitions, who serves each and with which fencing token; an asset a row; names; audit log |
| `p000`, `p001`, … | the tables of one service (`service/results/schema.py`), with the assets of one partition |

An asset belongs to the partition that its id hashes to, whatever it is called; one that takes over another one's frames
is in the same partition as that (`naming.py`). The number of partitions is fixed when the fleet is created.
The numbers that a partition's tables give out differ from those of every other partition, so that a decision or an
inspection is found by its number alone.

The tables of a partition are brought to a newer release by the first worker of that release which takes it. Those of
`fleet` are brought there by `create`, that is by `gear-twin fleet up`; older workers and front ends write nothing from
then on, newer ones wait until then.

The keys of a partition's assets begin with `fleet/`, its number and the prefix: a worker subscribes to nothing else. A
fleet of one partition has nothing to tell apart and uses the prefix as it is, so that what publishes to `serve`
publishes to it as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any

import sqlalchemy as sa
from sqlalchemy import BigInteger, Boolean, Column, Connection, Index, Integer, LargeBinary, MetaData, Table, Text
from sqlalchemy.dialects import postgresql

from service.errors import NewerTables, StorageUnavailable, StoreError
from service.results.schema import AUDIT
from service.results.schema import COMMITS as LAST_COMMITS
from service.stream.wire.topics import PREFIX

SCHEMA = "fleet"
MOST_PARTITIONS = 1000
ASSETS_A_PARTITION = 600  # beyond it, Zenoh's recovery of what publishers keep takes longer than a restart
_LOCK = 7_219_433  # of whoever makes the tables; other numbers are in `claims` and `migrate`

REVISION = "revision"  # the fact that says how far the tables below are

SERVER_NOW = sa.cast(sa.func.extract("epoch", sa.func.clock_timestamp()) * 1_000_000_000, BigInteger)
"""Unix time by the server's clock [ns], the same for all machines."""

METADATA = MetaData(schema=SCHEMA)
FACTS = Table("facts", METADATA, Column("name", Text, primary_key=True), Column("value", Text, nullable=False))
PARTITIONS = Table(
    "partitions",
    METADATA,
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("token", BigInteger, nullable=False, server_default="0"),  # of whoever may commit
    Column("worker", Text),  # who that is: host and process
    Column("node", Text),
    Column("taken_ns", BigInteger),  # since when
    Column("seen_ns", BigInteger),  # when it last said that it is at work
    Column("figures", postgresql.JSONB),  # what it said
)
ASSETS = Table(
    "assets",
    METADATA,
    Column("asset", Text, primary_key=True),
    Column("label", Text(collation="C"), nullable=False, unique=True),  # ordered as everywhere: by its code points
    Column("partition", Integer, nullable=False),
    Column("area", Text, nullable=False, server_default=""),  # the part of the plant: the name up to its last separator
    Column("severity", Integer, nullable=False, server_default="0"),  # of the status, the worst highest
    Column("level", Text, nullable=False, server_default=""),
    Column("version", BigInteger, nullable=False, server_default="0"),  # grows with each change
    Column("changed_ns", BigInteger, nullable=False, server_default="0"),
    Column("summary", postgresql.JSONB, nullable=False),  # the row of the list of assets
    Column("words", Text, nullable=False, server_default=""),  # what a search of the list looks at
    Column("volatile", LargeBinary),  # what is shown and is not in the partition's tables (JSON)
    Index("assets_by_severity", sa.text("severity DESC"), "label"),
    Index("assets_by_area", "area", sa.text("severity DESC"), "label"),
    Index("assets_by_partition", "partition"),
)
NAMES = Table(  # every name that was ever given
    "names",
    METADATA,
    Column("name", Text, primary_key=True),
    Column("partition", Integer, nullable=False),
    Column("elsewhere", Boolean, nullable=False),  # whether it hashes to another partition
)
REPORTED = Table(
    "reported",
    METADATA,
    Column("partition", Integer, primary_key=True, autoincrement=False),
    Column("kind", Text, primary_key=True),  # of what waits for people: see `reported`
    Column("asset", Text, primary_key=True),
    Column("data", LargeBinary, nullable=False),  # JSON
)
CURVES = Table(
    "curves",
    METADATA,
    Column("asset", Text, primary_key=True),
    Column("name", Text, primary_key=True),  # of what it was made from
    Column("data", LargeBinary, nullable=False),  # compressed points: see `kept_curves`
)
AUDIT_LOG = AUDIT.to_metadata(METADATA, schema=SCHEMA)
COMMITS = LAST_COMMITS.to_metadata(METADATA, schema=SCHEMA)
PRESENT = sa.select(sa.cast(FACTS.c.value, Integer)).where(FACTS.c.name == REVISION)  # revision of the tables
_HELD, _SHARED = PRESENT.with_for_update(), PRESENT.with_for_update(read=True)


def _names(db: Connection) -> None:
    """To revision 2: kept curves, last commits, and the names of assets that are not where they hash to, or were."""
    curves = "asset text, name text, data bytea NOT NULL, PRIMARY KEY (asset, name)"
    db.exec_driver_sql(f"CREATE TABLE IF NOT EXISTS {SCHEMA}.curves ({curves})")
    db.exec_driver_sql(f"CREATE TABLE {SCHEMA}.names (name text PRIMARY KEY, partition integer NOT NULL)")
    commits = "writer text PRIMARY KEY, number bigint NOT NULL, written_ns bigint NOT NULL"
    db.exec_driver_sql(f"CREATE TABLE IF NOT EXISTS {SCHEMA}.commits ({commits})")
    count = int(db.exec_driver_sql(f"SELECT value FROM {SCHEMA}.facts WHERE name = 'partitions'").scalar_one())
    rows = db.exec_driver_sql(f"SELECT asset, partition FROM {SCHEMA}.assets")
    found: dict[str, int] = {name: number for name, number in rows if number != partition_of(name, count)}
    for partition in range(count):
        if sa.inspect(db).has_table("routes", schema=schema_of(partition)):
            streams = db.exec_driver_sql(f"SELECT stream FROM {schema_of(partition)}.routes").scalars()
            found |= dict.fromkeys(streams, partition)
    for name, partition in found.items():
        given = {"name": name, "partition": partition}
        db.execute(sa.text(f"INSERT INTO {SCHEMA}.names (name, partition) VALUES (:name, :partition)"), given)


STEPS: tuple[Callable[[Connection], object], ...] = (_names,)
"""What brings the tables of `fleet` to the next revision: the first from revision 1 to 2, and so on.

A step changes tables as they were then, by statements of its own, since the tables above are the newest.
"""


@dataclass(frozen=True, slots=True)
class Layout:
    """A fleet's division into partitions."""

    partitions: int

    def partition_of(self, asset: str) -> int:
        """The partition of an asset, or of the stream of this name."""
        return partition_of(asset, self.partitions)

    def partition_of_number(self, number: int) -> int:
        """The partition whose tables have given out a number."""
        return (number - 1) % self.partitions

    def prefix_of(self, partition: int, prefix: str = PREFIX) -> str:
        """The first part of the keys under which the assets of a partition publish."""
        return prefix if self.partitions == 1 else f"{SCHEMA}/{partition:03d}/{prefix}"

    @property
    def all(self) -> range:
        return range(self.partitions)


def partition_of(asset: str, partitions: int) -> int:
    """The partition of an asset; the same on every machine and in every release."""
    digest = blake2b(asset.encode(), digest_size=8, person=b"gear-twin").digest()
    return int.from_bytes(digest, "big") % partitions


def schema_of(partition: int) -> str:
    """The database schema of a partition."""
    return f"p{partition:03d}"


def create(engine: sa.Engine, partitions: int) -> Layout:
    """Makes the tables of all, or finds them and brings them to this release; the layout.

    Raises StoreError where the fleet was created with another number of partitions, or by a newer program.
    """
    if not 1 <= partitions <= MOST_PARTITIONS:
        raise StoreError(f"partitions = {partitions} must be from 1 to {MOST_PARTITIONS}")
    with engine.begin() as db:
        db.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_LOCK})")
        encoding = db.exec_driver_sql("SHOW server_encoding").scalar_one()
        if encoding != "UTF8":
            raise StoreError(f"the database has the encoding {encoding}: a fleet needs one with ENCODING 'UTF8'")
        db.exec_driver_sql(f"CREATE SCHEMA IF NOT EXISTS {SCHEMA}")
        if not sa.inspect(db).has_table(FACTS.name, schema=SCHEMA):
            METADATA.create_all(db)
            db.execute(sa.insert(FACTS), [{"name": "partitions", "value": str(partitions)}])
            db.execute(sa.insert(FACTS), [{"name": REVISION, "value": str(revision())}])
            db.execute(sa.insert(PARTITIONS), [{"number": number} for number in range(partitions)])
            return Layout(partitions)
        facts = _facts(db)
        present = int(facts[REVISION])
        _refuse_newer(present)
        layout = Layout(int(facts["partitions"]))
        if layout.partitions != partitions:
            raise StoreError(
                f"partitions = {partitions}: this fleet was created with {layout.partitions}, and the number stays, "
                "because the assets are divided by it; leave the setting out, or set it to that number"
            )
        if present < revision():
            _upgrade(db, present)
        return layout


def revision() -> int:
    """The revision of the tables of `fleet` that this program knows."""
    return 1 + len(STEPS)


def _upgrade(db: Connection, present: int) -> None:
    """Brings the tables of `fleet` to this program's revision, and takes all partitions from older workers."""
    db.execute(_HELD)
    db.execute(sa.text(f"UPDATE {SCHEMA}.{PARTITIONS.name} SET token = token + 1"))  # no column that a step adds
    for step in STEPS[present - 1 :]:
        step(db)
    db.execute(sa.update(FACTS).where(FACTS.c.name == REVISION).values(value=str(revision())))


def expect_revision(db: Connection) -> None:
    """At the begin of a transaction that writes: the tables of `fleet` are, and stay until its end, of this revision.

    Raises NewerTables where a newer program has upgraded them, StorageUnavailable where they are yet to be upgraded.
    """
    found = db.execute(_SHARED).scalar()
    if found is None:
        raise StoreError("the database holds no fleet")
    refuse_other_fleet(found)


def layout_of(engine: sa.Engine, *, older: bool = False) -> Layout | None:
    """The layout of a fleet; None where the database holds none.

    Raises NewerTables where its tables are of a newer program, StorageUnavailable where they are of an older one.

    older  whether tables of an older program will do, since they are going to be upgraded
    """
    with engine.connect() as db:
        if not sa.inspect(db).has_table(FACTS.name, schema=SCHEMA):
            return None
        facts = _facts(db)
    if not facts:
        return None
    (_refuse_newer if older else refuse_other_fleet)(int(facts[REVISION]))
    return Layout(int(facts["partitions"]))


def separate_numbers(db: Connection, partition: int, partitions: int) -> None:
    """Lets every counter of a partition's tables give out numbers of this partition alone; repeated without effect."""
    schema = schema_of(partition)
    counters: Iterable[Any] = db.execute(
        sa.text("SELECT sequencename, increment_by, last_value FROM pg_sequences WHERE schemaname = :of"),
        {"of": schema},
    ).all()
    for name, step, last in counters:
        if step == partitions and last is not None:
            continue
        if last is not None:
            raise StoreError(f"{schema}.{name} has given out numbers before the fleet was divided")
        db.exec_driver_sql(
            f'ALTER SEQUENCE {schema}."{name}" INCREMENT BY {partitions} MINVALUE 1 RESTART WITH {partition + 1}'
        )


def _facts(db: Connection) -> dict[str, str]:
    return {name: value for name, value in db.execute(sa.select(FACTS.c.name, FACTS.c.value))}


def _refuse_newer(present: int) -> None:
    if present > revision():
        raise NewerTables(
            f"the fleet's tables have revision {present}, this program knows up to {revision()}: they were written "
            "by a newer gear-twin, and this one writes nothing; install that release here, too"
        )


def refuse_other_fleet(present: int) -> None:
    """NewerTables or StorageUnavailable where the tables of `fleet` have another revision than this program's."""
    _refuse_newer(present)
    if present < revision():
        raise StorageUnavailable(
            f"the fleet's tables have revision {present}, this program needs {revision()}: gear-twin fleet up of this "
            "release brings them there",
            reason="another release",
        )
