"""Every log line of the service: what it means and what to do.

A line is known by where it is written and by its constant text, in which `%s` and its like are filled in. The
operations page is made from this list; a test finds every line of the code in it.
"""

from __future__ import annotations

from service.operation.fleet_log_catalogue import FLEET_LINES
from service.operation.log_line import NONE, REPORT, STORAGE, Line

LINES: tuple[Line, ...] = (
    Line(
        "service.results.rig_proposals",
        "%s: a rig file has come that is not the one in use: it is kept as a proposal (gear-twin assets rig)",
        "A publisher offers a rig file that differs from the one in use.",
        "Accept or reject it: `gear-twin assets rig`, or the page.",
    ),
    Line(
        "service.results.signal_store",
        "the raw signals of %s stay under its former name %s: %s",
        "An asset was renamed, but the folder of its raw signals was not, nor now. Its results are complete.",
        "Look after the folder that is named by the reason; the next start moves the signals.",
    ),
    Line(
        "service.runtime.changes",
        "the raw signals of %s stay under its former name %s until the next start: %s",
        "An asset was renamed, but the folder of its raw signals was not. Its results are complete.",
        "Look after the folder that is named by the reason; the next start moves the signals.",
    ),
    Line(
        "service.runtime.worker_processes",
        "a worker process cannot be started now: %s",
        "Windows wait; it is tried again after 1 s, then each time after twice as long, up to a minute.",
        "Look for lack of memory or of processes (`ulimit -u`, `TasksMax=`), and for a damaged installation.",
    ),
    Line(
        "service.runtime.worker_processes",
        "%s: the process that makes them does not answer, and is replaced",
        "That process was stopped, or hangs; what workers computed at that time is computed again.",
        "Do not stop processes of the service; look for a machine that hangs or swaps.",
    ),
    Line(
        "service.runtime.first_frames",
        "%s: frames %d to %d of %s have not come: their publishers are asked once more",
        "After a start, a key did not go on at what is stored of it; what lies behind the gap waits for the answer.",
        "None. What no publisher has any more is a fault of its window.",
    ),
    Line(
        "service.runtime.first_frames",
        "%s: nothing of %s has come since the start: its publishers are asked once more",
        "After a start, the other channels of the machine have gone on without this one.",
        "None; a channel that stays away shows in the windows. Look at its sensor and its publisher then.",
    ),
    Line(
        "service.stream.inbox",
        "a frame could not be received, %d such errors since the start: %r",
        "An exception in a callback of the network; said once a minute, counted in callback_errors.",
        REPORT,
    ),
    Line(
        "service.results.asset_life",
        "%s: the database is older than the files of its windows: from %s on, %d windows that had been received are "
        "not stored, and are stored when they are sent again",
        "The database was put back, or its server has lost what it had confirmed: it names windows whose files went "
        "when they were processed.",
        "Send the recordings from that time on again; publishers that keep their frames do so by themselves.",
    ),
    Line(
        "service.runtime.storage_watch",
        "%s, and it is tried again",
        "The database or the disk cannot be used; received windows wait in memory.",
        STORAGE,
    ),
    Line(
        "service.runtime.storage_watch",
        "%s can be used again: what waited has been kept",
        "The storage is back.",
        NONE,
    ),
    Line(
        "service.runtime.storage_wait",
        "%s: the service waits for it",
        "The server of the database did not answer at the start; HTTP answers 503 meanwhile.",
        "Start the database server; it goes on by itself.",
    ),
    Line("service.runtime.storage_wait", "the database can be used now", "The start goes on.", NONE),
    Line(
        "service.runtime.spool",
        "%s: %s",
        "A window was left out, because more windows waited in memory than are kept there while the storage "
        "cannot be used.",
        STORAGE,
    ),
    Line(
        "service.runtime.retention_job",
        "nothing old could be deleted: %s",
        "The storage cannot be used; it is tried again after minutes.",
        STORAGE,
    ),
    Line(
        "service.results.json_columns",
        "%s; it is left out, and a backup would have it",
        "Something stored is damaged; everything else is read.",
        "`gear-twin check`; restore a backup where it matters.",
    ),
    Line(
        "service.runtime.service_sink",
        "%s: window %s had been committed before",
        "A window was processed twice and is counted once: two services may use one database.",
        "Is a second service running? Otherwise report it.",
    ),
    Line(
        "service.runtime.lanes",
        "%s",
        "The stored state of an asset cannot be read: it is of another version, or damaged. Its windows wait.",
        "Use the version named, or restore a backup.",
    ),
    Line(
        "service.runtime.streams",
        "%s: %d frames left out: they come faster than they can be used",
        "The queue of a stream was full; whole windows of it are refused.",
        "Look for a publisher that floods; see `gear_twin_windows_shed_total`.",
    ),
    Line(
        "service.runtime.staleness",
        "%s: %s",
        "No whole window of an asset for longer than the service allows.",
        "Check data acquisition, cable and clock.",
    ),
    Line(
        "service.runtime.waiting_windows",
        "%s: %s",
        "A question about an asset is open; its windows may wait for the answer.",
        "Answer it on the page, or by `gear-twin assets change`.",
    ),
    Line(
        "service.runtime.asset_twins",
        "%s: its baseline cannot be used: %s",
        "The healthy baseline of an asset is damaged; it is assessed without.",
        "Learn it again, or put the file back.",
    ),
    Line(
        "service.runtime.rigs",
        "no rig file is known for %s: only what needs none will be available",
        "A new asset came without a rig file.",
        "Give it one: settings, page, or `gear-twin assets create`.",
    ),
    Line(
        "service.runtime.rigs",
        "%s: %s",
        "The rig file of an asset is another one than its stored state was learned with.",
        "Correct the rig file, or enter the change.",
    ),
    Line(
        "service.runtime.rigs",
        "the rig file offered for %s cannot be used: %s",
        "A rig file from the network is not one, or contradicts itself.",
        "Correct the file that the publisher offers.",
    ),
    Line(
        "service.results.unknown_assets",
        "asset %s is unknown: its frames are left out until a person adopts it (gear-twin assets unknown)",
        "Frames of an asset that nobody has declared.",
        "Adopt it, dismiss it, or stop the publisher.",
    ),
    Line(
        "service.results.unknown_assets",
        "frames are left out: %s",
        "They were published under the keys of another partition of the fleet than their asset's.",
        "Publish them under the keys that the line names.",
    ),
    Line(
        "service.runtime.begun",
        "new assets: %s%s",
        "Whether assets that nobody has declared are adopted or asked for, and why.",
        NONE,
    ),
    Line(
        "service.runtime.worker_processes",
        "%s: what the twin was asked (%s) %s",
        "A worker process ended or took too long; the window is tried once more, then refused.",
        "Look for lack of memory; otherwise report it.",
    ),
    Line(
        "service.runtime.twin_port",
        "a window or decision was refused because of an internal error",
        "The traceback follows; the window is recorded as refused.",
        REPORT,
    ),
    Line(
        "service.runtime.streams",
        "%s: two publishers send on the key of %s: %s and %s",
        "Frames of both are received in turn; which are used is decided by their content.",
        "Stop one of them; a key has one publisher.",
    ),
    Line(
        "service.runtime.raw_recorder",
        "raw recordings in %s cannot be written: %s; it is tried again in %g s",
        "Nothing is added to the raw recordings; windows and results are not affected.",
        "Free space, or repair the disk; it goes on by itself.",
    ),
    Line("service.runtime.raw_recorder", "raw recordings in %s go on", "They can be written again.", NONE),
    Line(
        "service.runtime.raw_recorder",
        "frames are left out of the raw recordings: %s",
        "The recordings lack frames; windows do not.",
        "Record to a faster disk, or free space.",
    ),
    Line(
        "service.runtime.curves",
        "a wear curve that was kept cannot be read, and is computed again: %s",
        "A window takes longer; results are the same.",
        NONE,
    ),
    Line(
        "service.results.raw_recordings",
        "%s was left behind by an earlier run: it is complete with %d frames",
        "A service that was killed had not completed it; its last seconds are missing.",
        NONE,
    ),
    Line(
        "service.results.raw_recordings",
        "%s was left behind by an earlier run and holds nothing: it is deleted (%s)",
        "A service was killed within seconds of beginning the file.",
        NONE,
    ),
    Line(
        "service.runtime.signal_writer",
        "%s: the raw signals of window %d are not kept: %s",
        "The window's results are stored, its signals cannot be viewed.",
        "Free space; a faster disk.",
    ),
    Line(
        "service.runtime.signal_writer",
        "%s cannot be deleted: %s",
        "A file that is not needed any more stays until the next start.",
        "Check the owner of the data directory.",
    ),
    Line(
        "service.runtime.webhooks",
        "webhooks wait: %s",
        "Messages wait because the storage cannot be used.",
        STORAGE,
    ),
    Line(
        "service.runtime.webhooks",
        "webhook %s: %s",
        "A message about an alarm could not be delivered; it is tried again.",
        "Check the receiver.",
    ),
    Line(
        "service.runtime.webhooks",
        "webhook %s: a message was given up after %d attempts",
        "It was three days old.",
        "Inform those concerned; repair the receiver.",
    ),
    Line(
        "service.runtime.http_server",
        "the certificate stays as it was: %s",
        "After SIGHUP: the new files cannot be used.",
        "Correct the files and send SIGHUP again.",
    ),
    Line("service.runtime.http_server", "certificate and key were read again: %s", "After SIGHUP.", NONE),
    Line(
        "service.access.access",
        "a request from %s was refused: %s",
        "A wrong credential, a role that does not suffice, or a page of another origin.",
        "See `/v1/audit`.",
    ),
    Line(
        "service.access.keys",
        "%s: no API key is accepted any more: %s",
        "The file of keys is damaged or gone.",
        "Restore it, or make keys anew: `gear-twin keys`.",
    ),
    Line(
        "service.access.tokens",
        "the keys of the issuer %s cannot be fetched: %s",
        "Tokens are checked by the keys that are known for a time, then refused.",
        "Check the issuer and the network.",
    ),
    Line("service.api.problems", "%s %s failed", "A request was answered by 500; the traceback follows.", REPORT),
    Line(
        "service.transport.guard",
        "a callback of the network failed",
        "What it was about is left out; the traceback follows.",
        REPORT,
    ),
    Line(
        "service.threads",
        "the thread %s ended with an internal error",
        "`/healthz` says what no longer works; the traceback follows.",
        "Restart the service; report it with the log lines.",
    ),
    Line("service.bridges.bridge", "%s: %s is connected%s", "A bridge (MQTT, OPC UA) works.", NONE),
    Line(
        "service.bridges.bridge",
        "%s: %s: %s; it is tried again with growing pauses",
        "A bridge does not work; everything else does.",
        "The cause is in the line: broker, certificate, password, port.",
    ),
    Line(
        "service.bridges.slow_inputs",
        "slow values: %s: a value was left out (%s): %s",
        "The first value of a topic that could not be used, by its cause.",
        "Compare the topic with the file of inputs.",
    ),
    Line(
        "service.bridges.kept",
        "%s cannot be written: %s",
        "Numbers of a bridge are kept in memory only: after a restart some messages are sent again.",
        "Free space; check the owner of the data directory.",
    ),
    Line("service.bridges.kept", "%s cannot be read and is begun again: %s", "As above, after a damage.", NONE),
    Line(
        "warnings",
        "…: … (…, line …)",
        "A warning of a library.",
        "None; report it if it comes often.",
    ),
    Line(
        "service.logs",
        "… more lines within … s were left out: …",
        "Lines of one cause beyond `[log] lines` a minute.",
        "As for the line named.",
    ),
    *FLEET_LINES,
)
