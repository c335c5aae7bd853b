"""What is told of one log line of the service."""

from __future__ import annotations

from typing import NamedTuple


class Line(NamedTuple):
    """One log line.

    place    the module that writes it
    text     its constant text
    meaning  what has happened; where the text is filled in as a whole, what it says then
    """

    place: str
    text: str
    meaning: str
    action: str = ""


NONE = "None."
REPORT = "Report it, with the lines of the log: it is an internal error."
STORAGE = "Free space, repair the disk or start the database server; it goes on by itself."
