"""Questions that only people can answer: whether gears were replaced, or whether the data are of another machine.

While a question is open, the windows that it concerns are kept and not used, and the asset is never `normal`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from service.contract.base import iso_time

TEXT = "Gears replaced, or another machine?"
COUNT_FELL, GEARS_DIFFER, REPEATED = "count_fell", "gears_differ", "frames_repeat"
ANSWERS = {
    COUNT_FELL: ("gears_replaced", "counter_reset", "other_machine", "ignore"),
    GEARS_DIFFER: ("gears_replaced", "other_machine", "ignore"),
    REPEATED: ("other_machine", "ignore"),
}
ALL_WAIT = (GEARS_DIFFER,)  # kinds during which no window can be assigned; else those that continue the count are used


def count_fell(seen: float, now: float, time_ns: int) -> dict[str, Any]:
    """The question where a revolution count has fallen."""
    detail = (
        f"The pinion had made {seen:,.0f} revolutions, and has made {now:,.0f} by a later window: the gears "
        "may have been replaced, the counter may have been reset, or this may be another machine."
    )
    return _question(COUNT_FELL, detail, time_ns)


def gears_differ(differences: Sequence[str], where: str, time_ns: int) -> dict[str, Any]:
    """The question where a rig file describes other gears than those that the asset's state was learned with."""
    detail = f"The {where} describes other gears than those so far: {', '.join(differences)}."
    return _question(GEARS_DIFFER, detail, time_ns) | {"differences": list(differences)}


def frames_repeat(frames: int, differ: bool, time_ns: int) -> dict[str, Any]:
    """The question where nothing but frames of times that have passed is received.

    differ  whether they have been compared with the used frames, and are others
    """
    compared = "differ from those" if differ else "could not be recognised as the same ones"
    detail = (
        f"The latest {frames} frames lie at times for which frames have already been used, and {compared}: "
        "they may be of another machine, or of a recording made earlier. They are not used; send them again under the "
        "name of the machine that they belong to."
    )
    return _question(REPEATED, detail, time_ns)


def one_left_out(question: Mapping[str, Any]) -> dict[str, Any]:
    """The question after one more of the windows that waited for its answer has been left out."""
    return {**question, "left_out": question.get("left_out", 0) + 1}


def _question(kind: str, detail: str, time_ns: int) -> dict[str, Any]:
    return {
        "kind": kind,
        "text": TEXT,
        "detail": detail,
        "since": iso_time(time_ns),
        "answers": list(ANSWERS[kind]),
        "waiting": 0,
    }
