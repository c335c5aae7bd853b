"""Every fault, grade, status and cause that answers of the service name: what it means, and what to do.

The operations page is made from these tables; tests hold them against what the code can say.
"""

from __future__ import annotations

from typing import NamedTuple


class Named(NamedTuple):
    """What a name means, and what to do where it is not as it should be."""

    meaning: str
    action: str = ""


FAULTS: dict[str, Named] = {
    # of frames
    "invalid": Named("a frame that breaks the contract; the newest faults state where", "Correct the publisher."),
    "duplicate": Named(
        "a frame that had been received before; it is left out",
        "None: publishers send again after a loss.",
    ),
    "late": Named(
        "a frame of a window that had been closed without it",
        "Check the network; raise `[stream] channel_wait` or `[windows] patience`.",
    ),
    "lost": Named(
        "frames that were numbered and never received",
        "Check the network; let loggers keep frames until they are stored.",
    ),
    "disorder": Named("a frame that was received after later ones, and was put in its place"),
    "conflict": Named(
        "a frame whose number or time is that of another frame; it is left out",
        "Do two publishers send on this key?",
    ),
    "two_publishers": Named(
        "two publishers send on the key in turn, by the identities that the network says; nothing is left out for that",
        "Stop one of them; a key has one publisher.",
    ),
    "overlap": Named(
        "a frame or samples of a time that had been received already; they are left out",
        "Check the clock and the sampling rate of the logger.",
    ),
    "clock": Named(
        "a frame whose time contradicts the frames before it, or the clock of this host",
        "Check the clock of the logger.",
    ),
    "past": Named(
        "a frame of a recording that was made before what is stored; it is left out",
        "Replay recordings in the order in which they were made, or under another asset's name.",
    ),
    "time_jump": Named("a single frame far ahead of all others; it is left out", "Check the clock of the logger."),
    "sequence_jump": Named(
        "a number far ahead of the one before; no frames are missing",
        "The logger was restarted, or it numbers wrongly.",
    ),
    "too_many_channels": Named(
        "a frame of a channel beyond the 256 of an asset; it is left out",
        "Does a publisher invent names of channels?",
    ),
    "shed": Named(
        "frames or windows left out for want of room; the window is refused",
        "See `gear_twin_windows_shed_total`.",
    ),
    "left_out": Named(
        "frames that came while their asset was retired or not adopted yet, for which there was no room while storage "
        "could not be used, or whose stream was another asset's; a window that lacks some is refused",
        "Retire, reinstate and adopt between two windows, or let loggers keep frames until they are stored.",
    ),
    # of windows
    "gap": Named("samples or edges that are missing", "As for `lost`."),
    "missing_channel": Named(
        "a channel that the rig file or earlier windows name and the window lacks",
        "Check the sensor and its logger; correct the rig file.",
    ),
    "nothing_usable": Named("no channel of the window can be used", "The other faults of the window say why."),
    "nan": Named("samples that are not finite", "Check the logger."),
    "out_of_range": Named(
        "values that the sensor cannot measure",
        "Check the unit, the sensor, and its range in the rig file.",
    ),
    "spike": Named("single samples far beyond all others", "Check cables and earthing."),
    "drift": Named(
        "the zero of an accelerometer moves within the window, as one that settles or warms up; it is taken out",
        "Let the sensor settle before a measurement; check its cable and its temperature.",
    ),
    "clock_rate": Named(
        "the clock of an accelerometer runs off against the encoder within the window, by the mesh lines; its rate is "
        "put right",
        "Use one clock for all channels, or correct the sampling rate.",
    ),
    "lost_samples": Named(
        "samples that are missing, or there twice, without a gap in the frames, by the mesh lines against the encoder; "
        "a gap is put in",
        "Check the buffers of the logger.",
    ),
    "interference": Named(
        "an accelerometer and the torque meter are struck at the same moments, at no angle of a shaft; these are left "
        "out",
        "Check screens and earthing of the cables.",
    ),
    "lost_contact": Named(
        "the samples of an accelerometer rest at one value for moments, as where a cable loses contact; these are left "
        "out",
        "Check the cable and its plugs.",
    ),
    "stuck": Named("all samples of the channel are equal", "Check the sensor and its cable."),
    "clipping": Named(
        "samples at the end of the sensor's range",
        "Lower the gain, or correct the range in the rig file.",
    ),
    "rate_change": Named("the sampling rate changed within the window", "Do not reconfigure a logger within a window."),
    "too_large": Named(
        "frames that exceed the room of one window",
        "Fewer channels, a lower rate, or a larger `[windows] window_bytes`.",
    ),
    "standstill": Named("the shaft did not turn"),
    "edge_order": Named("edges of an encoder that are not in the order of time", "Check the encoder's input card."),
    "edge_count": Named(
        "edges of an encoder that were not counted, or counted twice; they are put right, or the window is refused",
        "Clean or exchange the encoder's disc; check its cable and supply.",
    ),
    "reversed": Named(
        "the shaft turned backwards, or the encoder counts down",
        "Exchange the encoder's tracks; check the rig file.",
    ),
    "counter_reset": Named(
        "the edge counter has begun again; the revolutions go on by themselves where the transmission error of the "
        "flanks does, or where every recording begins its own count",
        "Answer the question of the asset where one is asked; make the counter durable.",
    ),
    "edges_per_rev": Named(
        "the encoder has another number of edges than the rig file says",
        "Correct the rig file or the logger.",
    ),
    "operating_range": Named(
        "the torque is outside of the operating points of the rig file",
        "Correct the rig file, or expect figures of less certainty.",
    ),
    "stored_window": Named(
        "the file in which the window waited cannot be read", "Check the disk; `gear-twin db check`."
    ),
    # of assets
    "stale": Named(
        "no whole window for longer than the service allows",
        "Check data acquisition, cable and clock; retire the asset if nothing is to come.",
    ),
    "rig_changed": Named(
        "another rig file than the one that the stored state was learned with",
        "Correct the rig file, or enter the change of the machine.",
    ),
}
"""By `kind`: of `data_quality`, of `gear_twin_frame_faults_total` and `gear_twin_data_faults_total`."""

GRADES: dict[str, Named] = {
    "good": Named("all channels are whole"),
    "repaired": Named("a small part was missing or wrong, and the rest is used", "None, if it is rare."),
    "degraded": Named(
        "something essential is missing or not to be trusted; what does not need it is computed",
        "See the faults of the window.",
    ),
    "refused": Named("nothing is computed from the window; it is recorded with its reason", "See its reason."),
}
"""By `quality` of a window."""

STATUSES: dict[str, Named] = {
    "normal": Named("the twin explains the vibration, and wear is far from its limit"),
    "no_verdict": Named(
        "nothing can be said: no usable data, an open question, or storage that cannot be used",
        "Follow `action`.",
    ),
    "watch": Named("something is to be observed: the reasons say what", "Follow `action`."),
    "alarm": Named("something calls for a decision of people", "Follow `action`."),
    "end_of_life": Named("the criterion of the end of life is reached or near", "Follow `action`."),
}
"""By `status.level` of an asset."""

DATA: dict[str, Named] = {
    "waiting": Named("no window has been received yet", "Send one."),
    "ok": Named("the newest window is usable"),
    "degraded": Named("the newest window is degraded or refused", "See its faults."),
    "stale": Named("no whole window for longer than the service allows", "Check data acquisition, cable and clock."),
}
"""By `data.level` of an asset."""

ALARMS: dict[str, Named] = {
    "active_unacknowledged": Named("beyond its limit, and nobody has said that he looks after it", "Acknowledge it."),
    "active_acknowledged": Named("beyond its limit, and somebody looks after it"),
    "returned_unacknowledged": Named("within its limit again, and nobody has acknowledged it", "Acknowledge it."),
    "closed": Named("over"),
}
"""By `state` of an alarm."""

QUESTIONS: dict[str, Named] = {
    "count_fell": Named(
        "the revolution count fell: new gears, or a counter that began again",
        "Answer it on the page, or by `gear-twin remote assets change`.",
    ),
    "gears_differ": Named(
        "a rig file with other gears than those of the stored state",
        "Say whether the gears were replaced, or which file is right.",
    ),
    "frames_repeat": Named(
        "only frames of passed times are received: another machine under this name, or a replay",
        "Say what they are.",
    ),
}
"""By `question.kind` of an asset; its windows may wait for the answer."""

STORAGE: dict[str, Named] = {
    "no space": Named("the disk or a quota is full", "Free space; the service goes on by itself."),
    "read-only": Named(
        "the file system or the database does not permit writing",
        "Mount it for writing; check the owner of the files.",
    ),
    "locked": Named(
        "another program holds the database, or it did not answer in time",
        "End that program; do not open the database for writing by hand.",
    ),
    "connection lost": Named("the database server does not answer", "Start it, or check the network."),
    "input or output": Named("the disk fails, or the file was removed", "Check the disk; restore a backup."),
    "damaged": Named(
        "the stored state of an asset is not what was written",
        "`gear-twin db check`, then restore a backup.",
    ),
}
"""By cause of storage that cannot be used, in `/readyz`, the log, and `storage` of an asset."""
