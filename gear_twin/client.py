"""A client of a running service: its REST interface as typed calls."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal
from urllib.parse import quote

import httpx

from gear_twin.result import Result
from service.api.models import AssetSummary, DecisionAnswer, InspectionAnswer
from service.contract.window import WindowRecord

Decision = Literal["accept", "reject", "pin", "release"]
PAGE = 1000  # windows that one call asks for


class ServiceError(Exception):
    """The service refused a call, in its own words (RFC 9457).

    status  of HTTP
    detail  what was wrong, and what would be right
    """

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(f"{detail} (status {status})")
        self.status, self.detail = status, detail


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened to a machine: a window, an update, an effect, a fault of the data, …"""

    id: int
    kind: str
    data: Mapping[str, Any]


class Client:
    """Calls of one service; use it in a `with` block, or close it.

    url      address of the service, such as http://127.0.0.1:8080
    timeout  how long an answer is waited for [s]
    """

    def __init__(self, url: str, timeout: float = 30.0) -> None:
        self._http = httpx.Client(base_url=url.rstrip("/"), timeout=timeout)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def assets(self) -> list[AssetSummary]:
        """All machines, each with its status."""
        return [AssetSummary.model_validate(entry, extra="ignore") for entry in self.get("/v1/assets")]

    def asset(self, asset: str) -> Result:
        """The whole state of one machine, with its latest windows."""
        return Result(self.get(_path(asset)))

    def windows(self, asset: str, after: int = -1) -> Iterator[WindowRecord]:
        """The records of all windows with an index above `after`, oldest first, read page by page."""
        while page := self.get(f"{_path(asset)}/windows", after=after, limit=PAGE):
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
        """Tells the service a measured wear depth; the answer holds the twin's own figure for comparison."""
        body = {
            "revolutions": float(revolutions),
            "max_depth_um": float(max_depth_um),
            "std_um": float(std_um),
            "flank": flank,
        }
        return InspectionAnswer.model_validate(self.post(f"{_path(asset)}/inspections", body), extra="ignore")

    def decide(self, asset: str, effect: str, decision: Decision) -> DecisionAnswer:
        """Decides on an effect that was found: it is accepted, rejected, pinned or released."""
        answer = self.post(f"{_path(asset)}/effects/{quote(effect, safe='')}", {"decision": decision})
        return DecisionAnswer.model_validate(answer, extra="ignore")

    def report(self, asset: str, kind: Literal["html", "pdf"] = "pdf") -> bytes:
        """The report for people, as a file's bytes."""
        return self._answered(self._http.get(f"{_path(asset)}/report", params={"format": kind})).content

    def events(self, asset: str, after: int | None = None) -> Iterator[Event]:
        """Events as they happen, for as long as the connection lasts.

        after  id of the last event that is known; those since are sent first
        """
        headers = {"Accept": "text/event-stream"} | ({} if after is None else {"Last-Event-ID": str(after)})
        with self._http.stream("GET", f"{_path(asset)}/events", headers=headers, timeout=None) as answer:
            if answer.is_error:
                answer.read()
            self._answered(answer)
            fields: dict[str, str] = {}
            for line in answer.iter_lines():
                name, _, value = line.partition(":")
                if line:
                    fields[name] = value.removeprefix(" ")
                    continue
                if "data" in fields and "event" in fields:
                    yield Event(int(fields.get("id") or 0), fields["event"], json.loads(fields["data"]))
                fields = {}

    def get(self, path: str, **query: Any) -> Any:
        """The JSON that a path answers; ServiceError where it is refused."""
        return self._answered(self._http.get(path, params=query)).json()

    def post(self, path: str, body: Mapping[str, Any]) -> Any:
        """The JSON that a path answers to a body; ServiceError where it is refused."""
        return self._answered(self._http.post(path, json=dict(body))).json()

    @staticmethod
    def _answered(answer: httpx.Response) -> httpx.Response:
        if answer.is_error:
            try:
                detail = answer.json()["detail"]
            except (ValueError, KeyError, TypeError):
                detail = answer.text.strip()[:200] or answer.reason_phrase
            raise ServiceError(answer.status_code, detail)
        return answer


def _path(asset: str) -> str:
    return f"/v1/assets/{quote(asset, safe='')}"
