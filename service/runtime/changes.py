"""Changes of assets are carried out between two windows of their asset.

| kind | what it does |
| --- | --- |
| gears_replaced, sensor_moved, oil_changed, counter_reset, reassembled | ends what twin/machine_changes.py says |
| other_machine | answers a question: the windows that wait, and the stream, are those of a new asset |
| ignore | answers a question: the windows of the fallen count are not used; the earlier rig file is kept |
| renamed | the asset has another name; frames under this and the earlier ones are its |
| baseline_given, baseline_removed | the asset has a healthy baseline of its own, or that of the settings again |
| retired, reinstated | no frames are expected, and those that come are left out; and the reverse |

Each is one transaction with all that it changes. The windows that waited for its answer are processed afterwards, one
transaction each; those that a kill leaves are processed by the next start.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.contract.base import iso_time
from service.errors import InputError
from service.files.rig import checked_rig
from service.files.rig_difference import differences
from service.results.baseline_store import BaselineStore
from service.results.board import Board
from service.results.jobs import Job, Jobs
from service.results.names import Names
from service.results.present_machine import demand_present
from service.results.rig_proposals import ACCEPTED, REJECTED, RigProposals
from service.results.sparkline import Sparkline
from service.results.sql_store import SqlStore
from service.results.status_events import status_events
from service.results.window_jobs import WindowJobs
from service.runtime.computing import Ask, Made
from service.runtime.intake import Intake
from service.runtime.job_worker import JobKind, once
from service.runtime.lane import Lane
from service.runtime.lanes import Lanes
from service.runtime.questions import GEARS_DIFFER, REPEATED, gears_differ
from service.runtime.reception import Reception
from service.runtime.rigs import MOST_NAMED, other_gears
from service.runtime.spool import Spool
from service.runtime.state_publication import StatePublication
from service.runtime.streams import Streams
from service.runtime.twin_port import Events
from service.stream.quality import Quality
from twin.machine_change import MachineChange

IGNORED = "windows of this revolution count are not used, as decided when it had fallen"


class Changes:
    """How changes of an asset are carried out: `kinds`."""

    def __init__(
        self,
        jobs: Jobs,
        windows: WindowJobs,
        reception: Reception,
        lanes: Lanes,
        store: SqlStore,
        board: Board,
        publication: StatePublication,
        *,
        names: Names,
        streams: Streams,
        intake: Intake,
        spool: Spool,
        alarms: AlarmKeeper | None,
        baselines: BaselineStore,
        proposals: RigProposals,
    ) -> None:
        self._names, self._proposals = names, proposals
        self._jobs, self._windows, self._reception, self._lanes = jobs, windows, reception, lanes
        self._store = store
        self._board, self._publication = board, publication
        self._streams, self._intake, self._spool = streams, intake, spool
        self._alarms, self._baselines = alarms, baselines
        machine = JobKind(self._machine, self._ask_machine)
        self.kinds: Mapping[str, JobKind] = {
            **dict.fromkeys(("gears_replaced", "sensor_moved", "oil_changed", "counter_reset", "reassembled"), machine),
            "other_machine": JobKind(self._other_machine, self._ask_other_machine, begins=True),
            "ignore": JobKind(self._ignore, self._ask_ignore, begins=True),
            "renamed": JobKind(self._rename, begins=True),
            "retired": JobKind(self._retire, begins=True),
            "reinstated": JobKind(self._retire, begins=True),
            "baseline_given": JobKind(self._baseline, begins=True),
            "baseline_removed": JobKind(self._baseline, begins=True),
            ACCEPTED: JobKind(self._accept_rig, begins=True),
            REJECTED: JobKind(self._reject_rig, begins=True),
        }

    # -- the kinds -----------------------------------------------------------------------------------

    def _ask_machine(self, lane: Lane, change: Job) -> Ask:
        given = change.given
        made = MachineChange(
            kind=change.kind, sensor=given.get("sensor"), at=given.get("revolutions"), began=given.get("count") or 0.0
        )
        if made.sensor is not None:
            self._demand_sensor(change.asset, made.sensor)
        return Ask("change", made)

    def _machine(self, lane: Lane, change: Job, made: Made) -> None:
        """A change of the machine: what it ends of the twin's memory begins again."""
        asset, question = change.asset, lane.question
        answers = question is not None and change.kind in question["answers"]
        outcome = lane.decided(made, self._reception.ended_ns(asset))
        present = self._store.asset(asset).epoch
        epoch = present + (change.kind == "gears_replaced")
        effect = {"epoch": epoch, "revolutions": self._revolutions(asset), "from_window": lane.index}
        rig = question.get("rig") if answers and question is not None and change.kind == "gears_replaced" else None
        with once(self._jobs, change, effect) as first:
            if first:
                parts = {"question": None} if answers else {}
                self._store.keep(asset, state=outcome.state.to_dict(), report=outcome.report, epoch=epoch, **parts)
                if rig is not None:
                    self._store.keep_rig(asset, rig)
                opened, alarms = self._alarms_after(asset, change, outcome.report)
                then = {"report": outcome.report, "question": None if answers else question, "alarms": opened}
                events = (*outcome.events, *alarms, *self._status_events(asset, **then))
                self._store.note(asset, [_event(change, effect), *events])
            else:
                epoch, opened = present, self._alarms.open(asset) if self._alarms else ()
        if rig is not None:
            self._reception.reopen(asset)
            self._lanes.reopen(asset)
        last = self._store.last_event_id(asset)
        lane.accept(outcome)
        blank = {"records": (), "latest": {}, "windows_total": 0, "updates": 0, "sparkline": Sparkline()}
        shown = blank if change.kind == "gears_replaced" else {}
        if answers:
            self._answered(lane)
        self._show(asset, last, report=outcome.report, alarms=opened, epoch=epoch, **shown)

    def _ask_other_machine(self, lane: Lane, change: Job) -> Ask:
        self._open_question(change)
        return Ask("forget")

    def _other_machine(self, lane: Lane, change: Job, made: Made) -> None:
        """The stream is another machine's from now on, with the windows that wait.

        Where its frames repeat times that have passed, none of them has been used, and the windows stay.
        """
        asset, name = change.asset, change.given["name"]
        question = self._open_question(change)
        fresh = question["kind"] == REPEATED
        rig = question.get("rig") or self._store.asset(asset).rig
        effect = {"asset": name}
        with once(self._jobs, change, effect) as first:
            if first:
                self._names.demand_free(name)
                self._store.keep(asset, question=None, state=made.state.to_dict())
                self._store.note(name, [("change", {"kind": "created", "from": asset})])
                if rig is not None:
                    self._store.keep_rig(name, rig)
                if not fresh and lane.assembly:
                    self._store.keep(name, assembly=lane.assembly, quality=Quality().to_dict({}))
                if not fresh:
                    self._windows.give_waiting(asset, name)
                self._names.give_streams(asset, name)
                self._store.note(asset, [_event(change, effect), *self._status_events(asset, question=None)])
        self._streams.reload()
        self._lanes.of(name)
        last, last_of_new = self._store.last_event_id(asset), self._store.last_event_id(name)
        lane.question, lane.state = None, made.state
        self._show(asset, last)
        if fresh:
            self._reception.flush(asset)
        else:
            self._spool.give(asset, name)
        self._reception.split(asset, name, fresh=fresh)
        self._intake.know(name)
        self._board.update(name, rig=rig, last_event_id=last_of_new)
        self._publication.publish(name)
        self._lanes.give(asset, name, fresh=fresh)

    def _ask_ignore(self, lane: Lane, change: Job) -> Ask | None:
        question = self._open_question(change)
        return Ask("ignore") if question["kind"] not in (GEARS_DIFFER, REPEATED) else None

    def _ignore(self, lane: Lane, change: Job, made: Made) -> None:
        """The question is closed without a change."""
        asset, question = change.asset, self._open_question(change)
        state = made.state
        effect = {"question": question["kind"], "differences": question.get("differences", [])}
        with once(self._jobs, change, effect) as first:
            if first:
                self._store.keep(asset, question=None, **({} if state is None else {"state": state.to_dict()}))
                self._store.note(asset, [_event(change, effect), *self._status_events(asset, question=None)])
        last = self._store.last_event_id(asset)
        if question["kind"] == REPEATED:
            self._reception.ignore_repeats(asset)
        if state is not None:
            lane.state = state
            lane.release(refuse=IGNORED)
        self._answered(lane)
        self._show(asset, last)

    def _rename(self, lane: Lane, change: Job, made: Made) -> None:
        """The asset has another name."""
        asset, name = change.asset, change.given["name"]
        effect = {"asset": name, "was": self._names.label(asset)}
        with once(self._jobs, change, effect) as first:
            if first:
                self._names.rename(asset, name)
                self._store.note(asset, [_event(change, effect)])
        self._streams.reload()
        opened = () if self._alarms is None else self._alarms.open(asset)
        self._show(asset, self._store.last_event_id(asset), label=name, alarms=opened)

    def _retire(self, lane: Lane, change: Job, made: Made) -> None:
        """The asset is out of use, or in use again."""
        asset, retired = change.asset, None
        if change.kind == "retired":
            retired = {"since": iso_time(change.received_ns)} | {k: change.given.get(k) for k in ("by", "note")}
        with once(self._jobs, change, {}) as first:
            if first:
                self._store.keep(asset, retired=retired)
                self._store.note(asset, [_event(change, {})])
        self._show(asset, self._store.last_event_id(asset), retired=retired)

    def _baseline(self, lane: Lane, change: Job, made: Made) -> None:
        """The asset has another healthy baseline of its own, or none."""
        asset, given = change.asset, change.given
        before = self._baselines.path(asset)
        file = given.get("file")
        if file is not None and not self._baselines.exists(file):
            raise InputError("the baseline that was to be used has been deleted meanwhile: learn it again")
        demand_present(asset, given.get("windows") or (), self._jobs)  # the machine may have been changed meanwhile
        about = {name: given[name] for name in ("by", "note", "windows", "added") if given.get(name) is not None}
        with once(self._jobs, change, about) as first:
            if first:
                if file is None:
                    self._baselines.remove(asset)
                else:
                    self._baselines.use(asset, file, {**about, "at": iso_time(change.received_ns)})
                self._store.note(asset, [("change", {"id": change.id, "kind": change.kind, **about})])
        self._lanes.reopen(asset)
        if before != self._baselines.path(asset):
            self._baselines.delete(before)
        self._show(asset, self._store.last_event_id(asset))

    def _accept_rig(self, lane: Lane, change: Job, made: Made) -> None:
        """A person accepts a rig file that came on the stream; whose gears others are is asked as before."""
        asset, rig, digest = change.asset, change.given["rig"], change.given["digest"]
        checked_rig(rig, f"rig of {asset}")
        stored = self._store.asset(asset)
        identity = other_gears(stored, rig)
        if identity:
            self._ask_about_gears(asset, rig, identity)
        changed = len(differences(stored.rig or {}, rig))
        effect = {"digest": digest, "values": changed, "question": GEARS_DIFFER if identity else None}
        with once(self._jobs, change, effect) as first:
            if first and not identity:
                self._store.keep_rig(asset, rig)
            if first:
                self._store.note(asset, [_event(change, effect)])
        last = self._store.last_event_id(asset)
        if not identity:
            self._reception.reopen(asset)
            self._lanes.reopen(asset)
        self._proposals.drop(asset, digest)
        self._show(asset, last, **({} if identity else {"rig": rig}))

    def _ask_about_gears(self, asset: str, rig: Mapping[str, Any], identity: tuple[str, ...]) -> None:
        """Opens the question, unless that has been done before the service was killed."""
        question = self._lanes.question(asset)
        if question is not None and question.get("rig") != rig:
            raise InputError("the open question must be answered first")
        if question is None:
            found = gears_differ(identity[:MOST_NAMED], "accepted rig file", self._reception.ended_ns(asset))
            self._lanes.ask(asset, {**found, "rig": dict(rig), "settings": False})

    def _reject_rig(self, lane: Lane, change: Job, made: Made) -> None:
        """A person rejects a rig file that came on the stream: the present one stays."""
        asset, effect = change.asset, {"digest": change.given["digest"]}
        with once(self._jobs, change, effect) as first:
            if first:
                self._store.note(asset, [_event(change, effect)])
        last = self._store.last_event_id(asset)
        self._proposals.reject(asset, change.given["digest"])
        self._show(asset, last)

    # -- within --------------------------------------------------------------------------------------

    def _answered(self, lane: Lane) -> None:
        """Closes the question; what waited for its answer goes on."""
        lane.question = None
        lane.release()

    def _show(self, asset: str, last: int, **parts: Any) -> None:
        """Shows an asset with its newest event."""
        question = self._lanes.question(asset)
        self._board.update(asset, last_event_id=last, question=question, **parts)
        self._publication.publish(asset)

    def _alarms_after(
        self, asset: str, change: Job, report: Mapping[str, Any]
    ) -> tuple[tuple[Mapping[str, Any], ...], Events]:
        """Open alarms after a change, and their events; limits that were learned before it are learned again."""
        if self._alarms is None:
            return (), ()
        events: Events = ()
        if change.kind in ("gears_replaced", "reassembled", "sensor_moved"):
            reason = f"The limits are learned anew after the change {change.kind}."
            events = self._alarms.learn_anew(asset, change.given.get("sensor") or "", reason)
        events = (*events, *self._alarms.decision(asset, report))
        return self._alarms.open(asset), events

    def _status_events(self, asset: str, **changes: Any) -> Events:
        """The event where a change of what is shown changes the status."""
        before = self._board.get(asset)
        return () if before is None else status_events(before, *replace(before, **changes).health())

    def _open_question(self, change: Job) -> Mapping[str, Any]:
        question = self._lanes.question(change.asset)
        if question is None or change.kind not in question["answers"]:
            raise InputError(f"{change.kind} answers a question, and none that it answers is open")
        return question

    def _demand_sensor(self, asset: str, sensor: str) -> None:
        channels = self._reception.quality(asset).get("channels") or {}
        known = sorted(label.partition("/")[2] for label in channels if label.startswith("accel/"))
        if known and sensor not in known:
            raise InputError(f"no accelerometer {sensor!r} has sent a frame; known: {', '.join(known)}")

    def _revolutions(self, asset: str) -> float | None:
        snapshot = self._board.get(asset)
        return None if snapshot is None else snapshot.latest.get("revolutions")


def _event(change: Job, effect: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    given = {name: value for name, value in change.given.items() if name != "rig"}
    return "change", {"id": change.id, "kind": change.kind, **given, "effect": dict(effect)}
