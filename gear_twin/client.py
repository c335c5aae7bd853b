"""A client of a running service: its REST interface as typed calls."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from math import inf
from pathlib import Path
from typing import Any, Literal

from gear_twin.result import Result
from service.access.http_client import HttpClient, path_of
from service.contract.alarms import Alarm
from service.contract.asset_life import AssetChange
from service.contract.parts import AssetBaseline
from service.contract.rest import AssetSummary, DecisionAnswer, InspectionAnswer
from service.contract.signals import Indicators, Signals, SignalView, Waterfall
from service.contract.what_if import WhatIf
from service.contract.window import WindowRecord

Decision = Literal["accept", "reject", "pin", "release"]
Change = Literal[
    "gears_replaced", "sensor_moved", "oil_changed", "counter_reset", "reassembled", "other_machine", "ignore",
    "renamed", "retired", "reinstated",
]  # fmt: skip
PAGE = 1000  # windows or alarms that one call asks for
LONG = 120.0  # for answers that are computed: a wear curve under a new condition takes seconds of a core [s]


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened to a machine: a window, an update, an effect, a fault of the data, …"""

    id: int
    kind: str
    data: Mapping[str, Any]


class Client:
    """Calls of one service, directly, whatever proxy the environment names.

    url, timeout, key, ca, certificate, private_key  as of `service.access.http_client.HttpClient`

    ServiceError has the words of a refusal; OSError says that no service answers.
    """

    def __init__(
        self,
        url: str,
        timeout: float = 30.0,
        *,
        key: str | None = None,
        ca: str | Path | None = None,
        certificate: str | Path | None = None,
        private_key: str | Path | None = None,
    ) -> None:
        self._http = HttpClient(url, timeout, key=key, ca=ca, certificate=certificate, private_key=private_key)
        self._long = max(timeout, LONG)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the client; no connection stays open between two calls."""

    def assets(self) -> list[AssetSummary]:
        """All machines, each with its status."""
        return [AssetSummary.model_validate(entry, extra="ignore") for entry in self.get("/v1/assets")]

    def asset(self, asset: str) -> Result:
        """The whole state of one machine, with its latest windows."""
        return Result(self.get(path_of("assets", asset)))

    def windows(self, asset: str, after: int = -1) -> Iterator[WindowRecord]:
        """The records of all windows with an index above `after`, oldest first, read page by page."""
        while page := self.get(path_of("assets", asset, "windows"), after=after, limit=PAGE):
            yield from (WindowRecord.model_validate(record, extra="ignore") for record in page)
            after = page[-1]["index"]

    def inspect(
        self,
        asset: str,
        *,
        revolutions: float,
        max_depth_um: float,
        std_um: float,
        flank: Literal["combined", "pinion", "gear"] = "combined",
    ) -> InspectionAnswer:
        """Enters a measured wear depth; the answer holds the twin's own figure for comparison."""
        body = {
            "revolutions": float(revolutions),
            "max_depth_um": float(max_depth_um),
            "std_um": float(std_um),
            "flank": flank,
        }
        return InspectionAnswer.model_validate(self.post(path_of("assets", asset, "inspections"), body), extra="ignore")

    def decide(
        self, asset: str, effect: str, decision: Decision, *, by: str | None = None, note: str | None = None
    ) -> DecisionAnswer:
        """Decides on an effect that was found: it is accepted, rejected, pinned or released."""
        body = {"decision": decision, "by": by, "note": note}
        answer = self.post(path_of("assets", asset, "effects", effect), body)
        return DecisionAnswer.model_validate(answer, extra="ignore")

    def decisions(self, asset: str) -> list[DecisionAnswer]:
        """What people have decided on a machine's effects, oldest first."""
        return [
            DecisionAnswer.model_validate(d, extra="ignore") for d in self.get(path_of("assets", asset, "decisions"))
        ]

    # -- alarms --------------------------------------------------------------------------------------

    def alarms(self, asset: str | None = None, *, closed: bool = False) -> Iterator[Alarm]:
        """The open alarms of one machine or of all, by their numbers, read page by page.

        closed  whether to list those that are closed, too
        """
        path, after = "/v1/alarms" if asset is None else path_of("assets", asset, "alarms"), 0
        state = "all" if closed else "open"
        while page := self.get(path, state=state, after=after, limit=PAGE):
            found = sorted((Alarm.model_validate(entry, extra="ignore") for entry in page), key=lambda alarm: alarm.id)
            yield from found
            after = found[-1].id

    def acknowledge(self, asset: str, alarm: int, by: str, note: str = "") -> Alarm:
        """Acknowledges an alarm by name: it stays listed while its quantity is beyond the limit."""
        return self._sign(asset, alarm, "acknowledge", by, note)

    def clear(self, asset: str, alarm: int, by: str, note: str = "") -> Alarm:
        """Clears an alarm by name, after a repair; it is raised again if its cause lasts."""
        return self._sign(asset, alarm, "clear", by, note)

    def _sign(self, asset: str, alarm: int, verb: str, by: str, note: str) -> Alarm:
        answer = self.post(path_of("assets", asset, "alarms", alarm, verb), {"by": by, "note": note})
        return Alarm.model_validate(answer, extra="ignore")

    # -- life of a machine ---------------------------------------------------------------------------

    def changes(self, asset: str) -> list[AssetChange]:
        """What people have changed on a machine, oldest first."""
        return [AssetChange.model_validate(c, extra="ignore") for c in self.get(path_of("assets", asset, "changes"))]

    def change(
        self,
        asset: str,
        kind: Change,
        *,
        by: str | None = None,
        note: str | None = None,
        at: str | None = None,
        sensor: str | None = None,
        revolutions: float | None = None,
        count: float | None = None,
        name: str | None = None,
    ) -> AssetChange:
        """Enters a change of a machine, or answers the question about its data; `done` is false while it is queued.

        at           when it was made, ISO 8601; kept as it is given
        sensor       sensor_moved: the accelerometer
        revolutions  gears_replaced: the encoder's count then; counter_reset: revolutions since new then
        count        counter_reset: what it was set to, in turns
        name         renamed: its new name; other_machine: the new asset's name
        """
        given: dict[str, Any] = {"by": by, "note": note, "at": at, "sensor": sensor, "name": name}
        given |= {"revolutions": revolutions, "count": count}
        answer = self.post(path_of("assets", asset, "changes"), {"kind": kind, **given})
        return AssetChange.model_validate(answer, extra="ignore")

    def baseline(self, asset: str) -> AssetBaseline:
        """A machine's own healthy baseline, and what it suffices for."""
        return AssetBaseline.model_validate(self.get(path_of("assets", asset, "baseline")), extra="ignore")

    def learn_baseline(
        self,
        asset: str,
        windows: Sequence[int],
        *,
        add: bool = False,
        by: str | None = None,
        note: str | None = None,
    ) -> AssetBaseline:
        """Learns a machine's baseline from windows of its own, in place of the earlier one or added to it."""
        body = {"windows": list(windows), "add": add, "by": by, "note": note}
        answer = self.post(path_of("assets", asset, "baseline", "learn"), body, timeout=self._long)
        return AssetBaseline.model_validate(answer, extra="ignore")

    def give_baseline(
        self, asset: str, file: str | Path, *, by: str | None = None, note: str | None = None
    ) -> AssetBaseline:
        """Gives a machine a baseline that `gear-twin baseline` has written."""
        answer = self._http.json(
            path_of("assets", asset, "baseline"),
            Path(file).read_bytes(),
            method="PUT",
            query={"by": by, "note": note},
            timeout=self._long,
        )
        return AssetBaseline.model_validate(answer, extra="ignore")

    def remove_baseline(self, asset: str, *, by: str | None = None) -> AssetBaseline:
        """Leaves a machine without a baseline of its own."""
        answer = self._http.json(path_of("assets", asset, "baseline"), method="DELETE", query={"by": by})
        return AssetBaseline.model_validate(answer, extra="ignore")

    # -- what if -------------------------------------------------------------------------------------

    def what_if(
        self,
        asset: str,
        duty: Sequence[tuple[float, float] | tuple[float, float, float]] | None = None,
        *,
        until: date | str | None = None,
        hours: float | None = None,
        max_depth_um: float | None = None,
        hours_per_day: float | None = None,
    ) -> WhatIf:
        """Remaining life under another duty, and the probability of reaching a date; changes nothing.

        duty           (speed [Hz], torque [N·m], share of the running time) each; None for the present one
        until          date whose probability of being reached is asked for
        hours          or so many hours of operation
        max_depth_um   depth to reach; None for the end of life
        hours_per_day  running time per day; None for the rig file's, or as observed
        """
        points = (
            None if duty is None else [dict(zip(("speed_hz", "torque_nm", "share"), p, strict=False)) for p in duty]
        )
        date_text = until.isoformat() if isinstance(until, date) else until
        body = {"duty": points, "until": date_text, "hours": hours, "hours_per_day": hours_per_day}
        answer = self.post(
            path_of("assets", asset, "what-if"), body | {"max_depth_um": max_depth_um}, timeout=self._long
        )
        return WhatIf.model_validate(answer, extra="ignore")

    # -- signals -------------------------------------------------------------------------------------

    def signals(self, asset: str) -> Signals:
        """Which windows' raw signals are kept, and what can be looked at of the newest."""
        return Signals.model_validate(self.get(path_of("assets", asset, "signals")), extra="ignore")

    def signal(self, asset: str, window: int, view: str, channel: str | None = None, **query: Any) -> SignalView:
        """One view of a window, measured and, where there is a model, modelled.

        view     waveform, spectrum, order-spectrum, envelope-spectrum, synchronous-average, transmission-error, flank
        channel  such as accel/y6; None for the reference accelerometer
        query    further options of the REST call, such as points=2000
        """
        path = path_of("assets", asset, "windows", window, "signals", view)
        answer = self.get(path, timeout=self._long, channel=channel, **query)
        return SignalView.model_validate(answer, extra="ignore")

    def waterfall(self, asset: str, channel: str | None = None, **query: Any) -> Waterfall:
        """Spectra of all windows that are kept, one row a window."""
        answer = self.get(path_of("assets", asset, "waterfall"), timeout=self._long, channel=channel, **query)
        return Waterfall.model_validate(answer, extra="ignore")

    def indicators(self, asset: str, *quantities: str, **query: Any) -> Indicators:
        """Trends of condition indicators, levels, speed, torque and temperatures; all where none is named."""
        answer = self.get(path_of("assets", asset, "indicators"), quantity=list(quantities), **query)
        return Indicators.model_validate(answer, extra="ignore")

    # -- all calls -----------------------------------------------------------------------------------

    def report(self, asset: str, kind: Literal["html", "pdf"] = "pdf") -> bytes:
        """The report for people, as a file's bytes."""
        with self._http.opened(path_of("assets", asset, "report"), query={"format": kind}) as answer:
            return answer.read()

    def events(self, asset: str, after: int | None = None) -> Iterator[Event]:
        """Events as they happen, for as long as the connection lasts.

        after  id of the last event that is known; those since are sent first
        """
        headers = {"Accept": "text/event-stream"} | ({} if after is None else {"Last-Event-ID": str(after)})
        with self._http.opened(path_of("assets", asset, "events"), headers=headers, timeout=inf) as answer:
            fields: dict[str, str] = {}
            for raw in answer:
                line = raw.decode("utf-8").rstrip("\r\n")
                name, _, value = line.partition(":")
                if line:
                    fields[name] = value.removeprefix(" ")
                    continue
                if "data" in fields and "event" in fields:
                    yield Event(int(fields.get("id") or 0), fields["event"], json.loads(fields["data"]))
                fields = {}

    def get(self, path: str, *, timeout: float | None = None, **query: Any) -> Any:
        """The JSON that a path answers; ServiceError where it is refused."""
        return self._http.json(path, query=query, timeout=timeout)

    def post(self, path: str, body: Mapping[str, Any], *, timeout: float | None = None) -> Any:
        """The JSON that a path answers to a body; ServiceError where it is refused."""
        return self._http.json(path, dict(body), timeout=timeout)
