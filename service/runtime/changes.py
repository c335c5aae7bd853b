"""Changes of assets are carried out between two windows of their asset.

| kind | what it does |
| --- | --- |
| gears_replaced, sensor_moved, oil_changed, counter_reset, reassembled | ends what twin/machine_changes.py says |
| other_machine | answers a question: the windows that wait, and the stream, are those of a new asset |
| ignore | answers a question: the windows of the fallen count are not used; the earlier rig file is kept |
| renamed | the asset has another name; frames under this and the earlier ones are its |
| baseline_given, baseline_removed | the asset has a healthy baseline of its own, or that of the settings again |
| retired, reinstated | no frames are expected, and those that come are left out; and the reverse |

The windows that waited for its answer are processed afterwards, one transaction each; those that a kill leaves are
processed by the next start.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.contract.base import iso_time
from service.contract.status import shown_question
from service.errors import InputError
from service.files.rig import checked_rig
from service.files.rig_difference import differences
from service.results.asset_table import AssetTable
from service.results.baseline_store import BaselineStore
from service.results.jobs import RIG_ACCEPTED, RIG_REJECTED, Job, Jobs
from service.results.names import Names
from service.results.offers import Offers
from service.results.present_machine import demand_present
from service.results.sparkline import Sparkline
from service.results.sql_store import SqlStore
from service.results.window_jobs import WindowJobs
from service.runtime.computing import Ask, Made
from service.runtime.decisions import decided
from service.runtime.outcomes import Outcome
from service.runtime.place import JobKind, Place
from service.runtime.questions import GEARS_DIFFER, REPEATED, gears_differ
from service.runtime.rigs import MOST_NAMED, other_gears
from service.runtime.twin_port import Events
from service.stream.quality import Counts
from twin.machine_change import MachineChange

NEW_GEARS = {"records": (), "latest": {}, "windows_total": 0, "updates": 0, "sparkline": Sparkline()}
LEARNED_ANEW = ("gears_replaced", "reassembled", "sensor_moved")  # changes after which limits are learned again
IGNORED = "windows of this revolution count are not used, as decided when it had fallen"


class Changes:
    """How changes of an asset are carried out: `kinds`."""

    def __init__(
        self,
        jobs: Jobs,
        windows: WindowJobs,
        store: SqlStore,
        table: AssetTable,
        *,
        names: Names,
        baselines: BaselineStore,
    ) -> None:
        self._jobs, self._windows, self._store, self._table = jobs, windows, store, table
        self._names, self._baselines, self._offers = names, baselines, Offers(store.database)
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
            RIG_ACCEPTED: JobKind(self._accept_rig, begins=True),
            RIG_REJECTED: JobKind(self._reject_rig, begins=True),
        }

    # -- the kinds -----------------------------------------------------------------------------------

    def _ask_machine(self, place: Place, change: Job) -> Ask:
        given = change.given
        made = MachineChange(
            kind=change.kind, sensor=given.get("sensor"), at=given.get("revolutions"), began=given.get("count") or 0.0
        )
        if made.sensor is not None:
            self._demand_sensor(change.asset, made.sensor)
        return Ask("change", made)

    def _machine(self, place: Place, change: Job, made: Made) -> Outcome:
        """A change of the machine: what it ends of the twin's memory begins again."""
        asset, question, shown = change.asset, place.question, self._table.get(change.asset)
        assert made.answer is not None
        epoch, revolutions = (0, None) if shown is None else (shown.epoch, shown.latest.get("revolutions"))
        changed: dict[str, Any] = {}
        if question is not None and change.kind in question["answers"]:
            changed["question"] = None
        if change.kind == "gears_replaced":
            epoch += 1
            changed |= {"epoch": epoch, **NEW_GEARS}
            if "question" in changed and question is not None and question.get("rig") is not None:
                changed["rig"] = question["rig"]
        effect = {"epoch": epoch, "revolutions": revolutions, "from_window": place.index}
        outcome = decided(place, made, self._store.ended_ns(asset))

        def judge(alarms: AlarmKeeper, data: Mapping[str, Any]) -> Events:
            events: Events = ()
            if change.kind in LEARNED_ANEW:  # before: limits that hold no more raise no alarm
                reason = f"The limits are learned anew after the change {change.kind}."
                events = alarms.learn_anew(asset, change.given.get("sensor") or "", reason)
            return (*events, *outcome.judge(alarms, data))

        return replace(
            outcome,
            changed=changed,
            events=(_event(change, effect), *made.answer.events),
            led_to=effect,
            judge=judge,
        )

    def _ask_other_machine(self, place: Place, change: Job) -> Ask:
        _open_question(place, change)
        return Ask("forget")

    def _other_machine(self, place: Place, change: Job, made: Made) -> Outcome:
        """The stream is another machine's from now on, with the windows that wait.

        Where its frames repeat times that have passed, none of them has been used, and the windows stay.
        """
        asset, name = change.asset, change.given["name"]
        question = _open_question(place, change)
        fresh = question["kind"] == REPEATED
        rig = question.get("rig") or self._store.asset(asset).rig

        def give() -> None:
            self._names.begin(name, beside=asset)
            self._store.note(name, [("change", {"kind": "created", "from": asset})])
            if rig is not None:
                self._store.keep_rig(name, rig)
            if not fresh:
                counts = Counts(found=place.counts.copy().found)
                making = {**place.encoders.to_dict(), **counts.to_dict()}
                self._store.keep(name, assembly=self._store.shown_asset(asset).assembly or {}, making=making)
                self._windows.give_waiting(asset, name)
            self._names.give_streams(asset, name)

        outcome = _outcome(change, {"asset": name}, question=None)
        return replace(outcome, state=made.state, also=give)

    def _ask_ignore(self, place: Place, change: Job) -> Ask | None:
        question = _open_question(place, change)
        return Ask("ignore") if question["kind"] not in (GEARS_DIFFER, REPEATED) else None

    def _ignore(self, place: Place, change: Job, made: Made) -> Outcome:
        """The question is closed without a change."""
        question = _open_question(place, change)
        effect = {"question": question["kind"], "differences": question.get("differences", [])}
        outcome = replace(_outcome(change, effect, question=None), state=made.state)
        if made.state is not None:
            outcome = replace(outcome, refuse=IGNORED)
        return outcome

    def _rename(self, place: Place, change: Job, made: Made) -> Outcome:
        """The asset has another name."""
        asset, name = change.asset, change.given["name"]
        outcome = _outcome(change, {"asset": name, "was": self._names.label(asset)}, label=name)
        return replace(outcome, also=partial(self._names.rename, asset, name))

    def _retire(self, place: Place, change: Job, made: Made) -> Outcome:
        """The asset is out of use, or in use again."""
        if change.kind == "reinstated":
            return _outcome(change, {}, retired=None)
        retired = {"since": iso_time(change.received_ns)} | {k: change.given.get(k) for k in ("by", "note")}
        shown = self._table.get(change.asset)
        if shown is None or shown.stale is None:
            return _outcome(change, {}, retired=retired)
        outcome = _outcome(change, {}, retired=retired, stale=None)  # nothing is expected of it any more
        return replace(outcome, judge=lambda alarms, data: alarms.data(change.asset, data))

    def _baseline(self, place: Place, change: Job, made: Made) -> Outcome:
        """The asset has another healthy baseline of its own, or none."""
        asset, given = change.asset, change.given
        before, file = self._baselines.path(asset), given.get("file")
        if file is not None and not self._baselines.exists(file):
            raise InputError("the baseline that was to be used has been deleted meanwhile: learn it again")
        demand_present(asset, given.get("windows") or (), self._jobs)  # the machine may have been changed meanwhile
        about = {name: given[name] for name in ("by", "note", "windows", "added") if given.get(name) is not None}

        def keep() -> None:
            if file is None:
                self._baselines.remove(asset)
            else:
                self._baselines.use(asset, file, {**about, "at": iso_time(change.received_ns)})

        def use() -> None:
            present = self._baselines.path(asset)
            if before != present:
                self._baselines.delete(before)

        event = ("change", {"id": change.id, "kind": change.kind, **about})
        return Outcome(asset=asset, events=(event,), led_to=about, also=keep, after=use)

    def _accept_rig(self, place: Place, change: Job, made: Made) -> Outcome:
        """A person accepts a rig file that came on the stream; whose gears others are is asked as before."""
        asset, rig, digest = change.asset, change.given["rig"], change.given["digest"]
        checked_rig(rig, f"rig of {asset}")
        stored = self._store.asset(asset)
        identity = other_gears(stored, rig)
        asked = self._question_about_gears(place, rig, identity) if identity else None
        effect = {
            "digest": digest,
            "values": len(differences(stored.rig or {}, rig)),
            "question": GEARS_DIFFER if identity else None,
        }

        outcome = _outcome(change, effect, **({"question": asked} if asked else {} if identity else {"rig": rig}))
        if asked is not None:
            outcome = replace(outcome, events=(("question", shown_question(asked) or {}), *outcome.events))
        return replace(outcome, also=partial(self._offers.end, asset, digest))

    def _question_about_gears(
        self, place: Place, rig: Mapping[str, Any], identity: tuple[str, ...]
    ) -> Mapping[str, Any] | None:
        """The question to be opened; None where it is open."""
        question = place.question
        if question is not None and question.get("rig") != rig:
            raise InputError("the open question must be answered first")
        if question is not None:
            return None
        found = gears_differ(identity[:MOST_NAMED], "accepted rig file", self._store.ended_ns(place.asset))
        return {**found, "rig": dict(rig), "settings": False}

    def _reject_rig(self, place: Place, change: Job, made: Made) -> Outcome:
        """A person rejects a rig file that came on the stream: the present one stays."""
        digest = change.given["digest"]
        return replace(_outcome(change, {"digest": digest}), also=partial(self._offers.end, change.asset, digest))

    # -- within --------------------------------------------------------------------------------------

    def _demand_sensor(self, asset: str, sensor: str) -> None:
        channels = (self._store.shown_asset(asset).assembly or {}).get("channels", ())
        known = sorted(label.partition("/")[2] for label in channels if label.startswith("accel/"))
        if known and sensor not in known:
            raise InputError(f"no accelerometer {sensor!r} has sent a frame; known: {', '.join(known)}")


def _open_question(place: Place, change: Job) -> Mapping[str, Any]:
    question = place.question
    if question is None or change.kind not in question["answers"]:
        raise InputError(f"{change.kind} answers a question, and none that it answers is open")
    return question


def _outcome(change: Job, effect: Mapping[str, Any], **changed: Any) -> Outcome:
    """What a change leads to: its event, its effect, and other parts of the asset's snapshot."""
    return Outcome(asset=change.asset, changed=changed, events=(_event(change, effect),), led_to=effect)


def _event(change: Job, effect: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    given = {name: value for name, value in change.given.items() if name != "rig"}
    return "change", {"id": change.id, "kind": change.kind, **given, "effect": dict(effect)}
