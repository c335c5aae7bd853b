"""Questions that only people can answer, and what they do to the status while they are open."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field

from service.contract.base import ContractModel
from service.contract.finding import Finding
from service.contract.status import Added

ANSWER = "Answer the open question: windows wait for it."
HIDDEN = ("rig", "settings")  # what the service keeps with a question for itself


class Question(ContractModel):
    """A question that only people can answer. While it is open, the asset is never `normal`."""

    kind: Literal["count_fell", "gears_differ", "frames_repeat"]
    text: str
    detail: str = Field(description="what raised it")
    since: str = Field(description="ISO 8601, by the stream's clock")
    answers: list[str] = Field(description="kinds of change that answer it (`POST /v1/assets/{asset}/changes`)")
    waiting: int = Field(description="windows that are kept until it is answered, and processed then")
    left_out: int | None = Field(default=None, description="windows for which there was no room to wait")
    differences: list[str] | None = Field(default=None, description="of the rig files")


class Retired(ContractModel):
    """An asset that is out of use."""

    since: str
    by: str | None = None
    note: str | None = None


def asked(question: Mapping[str, Any] | None) -> tuple[Added, ...]:
    """The finding that an open question is: nothing is `normal` until it is answered."""
    if question is None:
        return ()
    reason = f"{question['text']} {question['detail']}"
    finding = Finding(subject="question", level="no_verdict", reason=reason, action=ANSWER)
    return (Added(finding=finding, since=question["since"]),)


def shown_question(question: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """The question as it is shown."""
    return None if question is None else {k: v for k, v in question.items() if k not in HIDDEN}
