"""The log lines of fleets, as those of log_catalogue.py."""

from __future__ import annotations

from service.operation.log_line import NONE, REPORT, STORAGE, Line

FLEET_LINES: tuple[Line, ...] = (
    Line(
        "service.fleet.heartbeat",
        "partition %d is silent until its loops turn again: %s",
        "A loop of the partition's worker hangs or has ended; it counts as not served meanwhile.",
        "Look at what it waits for: the database, a disk. Where it does not go on, end its process: another begins.",
    ),
    Line(
        "service.fleet.listener",
        "a notification of partition %d could not be followed: %r",
        "An exception while what a front end has written was taken up; all is looked at with the next connection.",
        REPORT,
    ),
    Line(
        "service.results.raw_segments",
        "%s stays in the spool: the object store takes others, but not this one: %s",
        "A raw recording cannot be moved, for its name or what it holds; it is tried again every five minutes.",
        "Look at the reason; move the file by hand, or delete it.",
    ),
    Line(
        "service.fleet.actor",
        "partition %d cannot go on: its process ends, and is started again",
        "The worker of a partition met an error that it cannot go on from; the lines after it say which.",
        "Where it does not end by itself: the database, the folder of the fleet, then report it.",
    ),
    Line(
        "service.fleet.actor",
        "partition %d cannot be served by this release: %s",
        "Its tables, or those of the fleet, were upgraded by a newer release, or cannot be used; nothing is written.",
        "Upgrade the node, or drain it; where the database is damaged, restore a backup.",
    ),
    Line(
        "service.fleet.front_database",
        "%s; its assets are answered for later",
        "A front end has met a partition with tables of another release, and answers 503 for its assets.",
        "None, where its worker is being upgraded; else upgrade the front end.",
    ),
    Line(
        "service.fleet.cluster",
        "%s of the fleet has ended, and is replaced",
        "A node of Ray on this machine was killed or had no memory; its partitions go on elsewhere.",
        "Look for lack of memory; none where it was ended on purpose.",
    ),
    Line(
        "service.fleet.engine",
        "partition %d did not end in good order: %s",
        "A partition that is moved was killed instead; it goes on from what is committed.",
        NONE,
    ),
    Line(
        "service.fleet.up",
        "the partitions did not end in good order: %s",
        "`fleet up` ended while the engine was lost: they go on from what is committed with its next start.",
        NONE,
    ),
    Line("service.fleet.engine", "%s is closed for new partitions (%.1f s)", "`fleet drain` or `fleet scale`.", NONE),
    Line(
        "service.fleet.heartbeat",
        "the heartbeat of partition %d: %s",
        "The worker could not say that it is at work; the database is away.",
        STORAGE,
    ),
    Line(
        "service.fleet.heartbeat",
        "partition %d could not be given back: %s",
        "The worker ended while the database was away; the partition is taken from it after ten seconds.",
        NONE,
    ),
    Line(
        "service.fleet.listener",
        "the notifications of partition %d: %s",
        "The connection for notifications was lost; what people decide is found within five seconds all the same.",
        STORAGE,
    ),
    Line(
        "service.fleet.partition",
        "the partition has been given to another worker: this process ends",
        "It was suspended, cut off or slow, and another worker took its partition; it can commit nothing more.",
        "Look for a machine that hangs or swaps, or a network that was cut.",
    ),
    Line(
        "service.fleet.partition",
        "%s: it is waited for",
        "The database is away at the start of a worker, or not upgraded yet.",
        STORAGE,
    ),
    Line(
        "service.fleet.rows",
        "the rows of partition %d wait: %s",
        "The list of assets shows the state before; the database is away.",
        STORAGE,
    ),
    Line(
        "service.fleet.searches",
        "a search for effects was not made by the engine, and is made here: %s",
        "The windows of the partition's other assets wait for it; results are the same.",
        "The reason is in the line; `gear-twin fleet status` shows the engine's nodes.",
    ),
    Line(
        "service.fleet.kept_curves",
        "wear curves cannot be read now: %s",
        "They are computed, which takes longer; the database is away.",
        STORAGE,
    ),
    Line(
        "service.fleet.kept_curves",
        "the wear curves of %s wait: %s",
        "They are written later; the database is away.",
        STORAGE,
    ),
    Line(
        "service.fleet.up",
        "%d processes of an engine that an earlier fleet up has left behind were ended",
        "That `fleet up` was killed; its partitions go on from what is committed.",
        NONE,
    ),
    Line(
        "service.fleet.up",
        "%s: it is tried again",
        "Ray on this machine did not answer, or its head or a node did not start; nodes that are there go on.",
        "None for the first time; then look at the file that it names, and for lack of memory.",
    ),
    Line(
        "service.fleet.up",
        "%s: the partitions wait for it",
        "The database of the fleet is away; frames wait with their publishers and with the workers.",
        STORAGE,
    ),
    Line(
        "service.fleet.assess_task",
        "%s is not assessed because of an internal error",
        "A recording of `fleet assess` is refused; the others are not affected.",
        "Report it, with the recording.",
    ),
    Line(
        "service.results.raw_segments",
        "raw recordings cannot be moved to the object store: %s; it is tried again in %g s",
        "They wait in their folder, up to `[raw] spool_gb`; windows and results are not affected.",
        "Check the store, its credentials and the network; it goes on by itself.",
    ),
    Line("service.results.raw_segments", "raw recordings are moved to %s again", "The store can be used again.", NONE),
    Line(
        "service.results.raw_segments",
        "%s holds no frame and is not moved to the object store: it is deleted (%s)",
        "The file was damaged.",
        "Check the disk.",
    ),
    Line(
        "service.fleet.reported",
        "what waits for people in partition %d is written later: %s",
        "Unknown assets and proposed rig files are shown late, as the database cannot be used.",
        STORAGE,
    ),
    Line(
        "service.fleet.listener",
        "what was announced of %s waits: %s",
        "What a front end has written is taken up later, as the database cannot be used.",
        STORAGE,
    ),
    Line(
        "service.fleet.listener",
        "the assets of partition %d are looked for later: %s",
        "As above, of assets that were created at a front end.",
        STORAGE,
    ),
    Line(
        "service.fleet.front_watch",
        "the notifications of the fleet: %s",
        "The connection on which a front end learns of changes was lost; `/readyz` answers 503 until it is made again.",
        STORAGE,
    ),
)
