"""Stored answers of version 1 of the contract in the names of version 2, until the next window writes one anew."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.contract.status import RENEW, without_verdict
from service.json_text import JsonText

RENAMED = {
    "not_told_from": "indistinguishable_from",
    "ways": "methods",
    "depth_from": "method",
    "strange": "unattributed_lines",
}
EARLIER = "The figures are those of an earlier version of gear-twin; the next window renews them."


def current_report(report: Mapping[str, Any]) -> dict[str, Any]:
    """A report in the names of version 2; one without a status gets one that gives no verdict."""
    if "status" in report:
        return dict(report)
    out = _renamed(report)
    wear = out.get("wear")
    if isinstance(wear, dict) and "from" in wear:
        wear["method"] = wear.pop("from")
    return {"status": without_verdict(EARLIER, RENEW), **out}


def current_record(record: JsonText) -> Mapping[str, Any]:
    """A window's record in the names of version 2; one that has them is not parsed here."""
    written = '"ways"' in record.text or '"depth_from"' in record.text  # as a key, or within some text
    return _renamed(record) if written and ("ways" in record or "depth_from" in record) else record


def _renamed(value: Any) -> Any:
    if isinstance(value, Mapping):
        out = {RENAMED.get(key, key): _renamed(item) for key, item in value.items()}
        methods = out.get("methods")
        if isinstance(methods, dict) and "paper" in methods:
            methods["rms"] = methods.pop("paper")
        return out
    return [_renamed(item) for item in value] if isinstance(value, (list, tuple)) else value
