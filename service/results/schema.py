"""The tables of the database, as the newest revision of `migrations` leaves them; for SQLite and PostgreSQL alike.

Times are Unix times [ns]; `done` and `open` are 0 or 1; what is JSON is written by service/results/json_columns.py.
"""

from __future__ import annotations

from sqlalchemy import BigInteger, Column, Double, ForeignKey, Index, Integer, LargeBinary, MetaData, Table, Text, text

REVISION = "0016"
"""The newest revision of `migrations`, which this program works with."""

METADATA = MetaData()

NAME = Text().with_variant(Text(collation="C"), "postgresql")  # ordered by its code points, in both
NUMBER = BigInteger().with_variant(Integer, "sqlite")  # of 64 bits in both


def _key(name: str = "id") -> Column:
    """A number that is given by the database and never used again."""
    return Column(name, NUMBER, primary_key=True, autoincrement=True)


def _asset(primary_key: bool = False) -> Column:
    """The asset that a row belongs to."""
    to = ForeignKey("assets.asset", deferrable=True)
    return Column("asset", Text, to, nullable=False, primary_key=primary_key)


def _text(name: str, *, nullable: bool = False, primary_key: bool = False) -> Column:
    return Column(name, Text, nullable=nullable, primary_key=primary_key)


def _json(name: str, *, nullable: bool = False) -> Column:
    return Column(name, LargeBinary, nullable=nullable)


def _number(name: str, default: str | None = None, *, nullable: bool = False, primary_key: bool = False) -> Column:
    return Column(name, NUMBER, nullable=nullable, server_default=default, primary_key=primary_key, autoincrement=False)


ASSETS = Table(
    "assets",
    METADATA,
    Column("asset", Text, primary_key=True),  # the name under which it began
    Column("label", NAME, nullable=False, unique=True),  # the name that it has now
    _number("share", "0"),  # of a fleet: whose worker it has; one service has them all
    *(
        _json(n, nullable=True)
        for n in ("rig", "state", "report", "assembly", "making", "quality", "question", "retired")
    ),
    *(_number(n, "0") for n in ("windows", "updates", "epoch")),
    _number("received_ns", nullable=True),
    _number("seal", nullable=True),
    _number("deleted", "0"),  # rows that were older than they are kept
    _number("mark", "0"),  # a random number, another one with each job: who began from an earlier one commits nothing
    _number("due", nullable=True),  # since when a job of it can be carried out; 0 for one that people wait for
    _text("worker", nullable=True),  # who has carried out its last job
    *(
        Column(n, Text, nullable=False, server_default="") for n in ("area", "level", "data", "words")
    ),  # see `asset_rows`
    *(_number(n, "0") for n in ("severity", "alarms", "version")),
    Column("summary", Text),
    _json("volatile", nullable=True),
    Index("assets_by_share", "share", "asset"),
    Index("assets_by_severity", text("severity DESC"), "label"),
    Index("assets_by_area", "area", text("severity DESC"), "label"),
    Index("assets_by_version", "version"),
    Index("assets_due", "due", sqlite_where=text("due IS NOT NULL")),  # on a server, too: `migrations`
)
WINDOWS = Table(
    "windows",
    METADATA,
    _asset(primary_key=True),
    _number("start_ns", primary_key=True),
    _json("record"),
    _json("figures"),
    _json("before", nullable=True),  # what its making took from the window before
    _json("stages", nullable=True),  # when each of its stages ended, and how long the twin took: see `journey`
    _number("number", "0"),
    _number("epoch", "0"),
    _number("seal", nullable=True),
    _number("notable", "0"),
    _text("segment", nullable=True),  # name of the file of its signals; none where they are not kept
    _number("segment_bytes", nullable=True),
    Column("revolutions", Double, nullable=True),  # of the pinion
    *(_number(n, "0") for n in ("found", "refused")),  # whether an effect was found at it; whether it was not used
    Index("windows_by_number", "asset", "number"),
    Index("windows_by_epoch", "asset", "epoch", "number"),
    Index(  # all that is asked of windows whose signals are kept: their rows are wide, and theirs alone are looked at
        "windows_with_segment",
        *("asset", "number", "start_ns", "revolutions", "segment_bytes", "found", "refused", "segment"),
        sqlite_where=text("segment IS NOT NULL"),  # on a server, too: `migrations`
    ),
)
EXTREMES = Table(
    "extremes",
    METADATA,
    _asset(primary_key=True),
    *(_number(n, primary_key=True) for n in ("epoch", "level", "part")),
    *(_number(n, nullable=True) for n in ("lowest", "highest", "sharpest")),  # of windows
    *(Column(n, Double, nullable=True) for n in ("lowest_rms", "highest_rms", "highest_kurtosis")),
    sqlite_with_rowid=False,
)
EVENTS = Table(
    "events",
    METADATA,
    _key(),
    _asset(),
    _text("kind"),
    _json("data"),
    _number("start_ns", nullable=True),  # of the window whose record is the data; then `data` is empty
    _number("again_ns", nullable=True),  # the same: a damaged one is not taken for that of a window that was thinned
    Index("events_of_asset", "asset", "id"),
    sqlite_autoincrement=True,
)
FAULT_TOTALS = Table(
    "fault_totals",
    METADATA,
    _asset(primary_key=True),
    *(_text(n, primary_key=True) for n in ("kind", "channel", "action")),
    _number("count"),
    _number("windows"),
    sqlite_with_rowid=False,
)
WINDOW = "window"  # kind of the jobs that are windows
PEOPLES = "done = 0 AND kind <> 'window'"  # what goes before windows, people's jobs and notices: few, whatever waits
ENDED = "done = 1 AND followed = 0"  # jobs that have ended, and were not followed yet
JOBS = Table(  # see `jobs`
    "jobs",
    METADATA,
    _key(),
    _asset(),
    _number("received_ns"),
    _text("kind"),
    _json("given", nullable=True),
    _number("done", "0"),
    _text("refused", nullable=True),
    _json("outcome", nullable=True),
    _text("verb", nullable=True),  # of a decision; what a notice is about
    _number("start_ns", nullable=True),  # of a window
    _number("bytes", nullable=True),  # of a window's file
    _text("file", nullable=True),  # name of that
    _number("held", "0"),  # whether it waits for an answer by people ...
    _number("again", "0"),  # ... or has done so before
    _text("refuse", nullable=True),  # why a window is not to be used
    _number("tries", "0"),  # how often it has ended whoever carried it out ...
    _text("fault", nullable=True),  # ... and how the last time
    _json("stages", nullable=True),  # of what people ask, as those of a window
    _number("followed", "0"),  # whether who receives frames has followed what it led to
    Index("jobs_of_people", "id", sqlite_where=text(PEOPLES)),  # on a server, too: `migrations`
    Index("jobs_to_follow", "id", sqlite_where=text(ENDED)),
    Index("jobs_of_asset", "asset", "kind", "id"),
    sqlite_autoincrement=True,
)
ALARM_RULES = Table("alarm_rules", METADATA, _asset(primary_key=True), _json("rules"), _json("changed"))
ALARM_MEMORY = Table("alarm_memory", METADATA, _asset(primary_key=True), _json("memory"))
ALARMS = Table(
    "alarms",
    METADATA,
    _key(),
    _asset(),
    _text("name"),
    _number("open"),
    _json("record"),
    Index("alarms_open", "asset", "name", unique=True, sqlite_where=text("open = 1")),  # on a server, too: `migrations`
    sqlite_autoincrement=True,
)
ALARM_HISTORY = Table(
    "alarm_history",
    METADATA,
    _key(),
    Column("alarm", NUMBER, ForeignKey("alarms.id", deferrable=True), nullable=False),
    _json("entry"),
    Index("history_of_alarm", "alarm", "id"),
    sqlite_autoincrement=True,
)
WEBHOOK_OUTBOX = Table(
    "webhook_outbox",
    METADATA,
    _key("number"),
    _asset(),
    *(_text(n) for n in ("name", "url", "body")),
    _number("created_ns"),
    _number("next_ns"),
    _number("attempts", "0"),
    sqlite_autoincrement=True,
)
NAMES = Table(  # every name that was ever given: see `names`
    "names", METADATA, _text("name", primary_key=True), _asset(), _text("labelled", nullable=True)
)
OFFERS = Table(  # what comes from the network and waits for people: see `offers`; a row reserves no name
    "offers",
    METADATA,
    *(_text(n, primary_key=True) for n in ("kind", "name")),
    _number("share", "0"),  # of a fleet: whose worker receives it
    *(_number(n) for n in ("first_ns", "last_ns", "frames")),
    _number("dismissed_ns", nullable=True),
    _text("digest", nullable=True),  # of a rig file
    _json("data"),
    Index("offers_by_share", "share", "dismissed_ns"),
)
BASELINES = Table("baselines", METADATA, _asset(primary_key=True), _text("file"), _json("about"))
BASELINE_NUMBERS = Table("baseline_numbers", METADATA, _key(), sqlite_autoincrement=True)
AUDIT = Table(
    "audit",
    METADATA,
    _key(),
    _number("at_ns"),
    *(_text(n) for n in ("kind", "action", "outcome")),
    *(_text(n, nullable=True) for n in ("name", "role", "address", "asset", "note")),
    _number("job", nullable=True),
    _json("what"),
    sqlite_autoincrement=True,
)
FOLDERS = Table("folders", METADATA, _number("one", primary_key=True), _text("id"))  # of segments: one row
COMMITS = Table("commits", METADATA, _text("writer", primary_key=True), _number("number"), _number("written_ns"))
ROLES = Table(  # what each process of the service says of itself: see `roles`
    "roles",
    METADATA,
    *(_text(n, primary_key=n == "id") for n in ("id", "role", "host")),
    _text("node", nullable=True),
    _number("share", nullable=True),  # of a fleet
    *(_number(n) for n in ("began_ns", "beat")),
    _text("not_ready", nullable=True),
    _json("figures"),
)
