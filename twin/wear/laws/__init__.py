"""The family of wear laws: one file a law, one line of this table, parameters under `[wear.<law>]` of the rig file."""

from __future__ import annotations

from twin.wear.laws.archard import Archard
from twin.wear.laws.law import WearLaw
from twin.wear.laws.running_in import RunningIn

LAWS: dict[str, type[WearLaw]] = {law.name: law for law in (Archard, RunningIn)}
