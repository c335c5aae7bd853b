"""`status.verdict`: the window that the verdict rests on, its age, and what is said where it no longer holds.

A verdict belongs to the windows that it was made from. Where windows have come since that were not assessed, for longer
than 3 times the machine's usual time between assessed windows (twin/verdict_window.py), there is no verdict at present;
before that the status says so beside its level. Either way an alarm that stands stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from service.contract.base import spoken_time
from service.contract.finding import Finding, cause, sentence
from service.contract.shape import Made, made_of
from twin import assessment
from twin.verdict_age import outdated

SUBJECT = "verdict"
ACTION = "Record a window under the load, direction and steady speed of those that were assessed."


@made_of(assessment.VerdictWindow)
class Verdict(Made):
    """The window that the verdict rests on."""

    def with_records(self, records: Sequence[Mapping[str, Any]]) -> Verdict:
        """The same as of the latest of the window records, which may be refused or wait unseen by the twin."""
        if self.window is None or self.start_time is None:
            return self
        later = [r for r in records if (r.get("index") or 0) > self.window]
        times = [t for t in (seconds_between(self.start_time, r.get("start_time")) for r in later) if t is not None]
        if not later or len(later) < self.not_assessed:
            return self
        return self.model_copy(
            update={
                "not_assessed": len(later),
                "age_s": max((0.0, *times)),
                "reason": later[-1].get("reason") or next(iter(later[-1].get("notes") or ()), None) or self.reason,
            }
        )

    @property
    def is_outdated(self) -> bool:
        """Whether it no longer holds."""
        return self.window is not None and outdated(self.age_s, self.usual_s, self.not_assessed)

    def finding(self) -> Finding | None:
        """That there is no verdict on the latest windows; None where the verdict holds."""
        if not self.is_outdated:
            return None
        return Finding(subject=SUBJECT, level="no_verdict", reason=self.sentence(), action=ACTION)

    @property
    def _later(self) -> str:
        many = self.not_assessed > 1
        return f"latest {self.not_assessed} windows were not assessed" if many else "latest window was not assessed"

    @property
    def _moment(self) -> str:
        return f"{(self.start_time or '')[:16].replace('T', ' ')} UTC"

    def summary(self) -> str:
        """In a few words, as of when a state is that has not been assessed since."""
        return f"As of {self._moment}, window {self.window}; the {self._later}."

    def sentence(self) -> str:
        """Which windows were not assessed and why, and which window the verdict rests on; empty where all were."""
        if not self.not_assessed or self.window is None:
            return ""
        span = f" ({spoken_time(self.age_s)} earlier)" if self.age_s else ""
        why = f": {cause(self.reason).removesuffix('.')}" if self.reason else ""
        return sentence(f"The {self._later}{why}; the verdict is of window {self.window}, {self._moment}{span}")


def seconds_between(first: str, second: str | None) -> float | None:
    """Time between two moments in ISO 8601 [s]; None where the second is not known."""
    if second is None:
        return None
    try:
        return (datetime.fromisoformat(second) - datetime.fromisoformat(first)).total_seconds()
    except ValueError:
        return None
