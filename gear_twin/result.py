"""The answer about one machine, from a recording or from a service, with its figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.contract.answer import Asset
from service.contract.parts import Band, Rul, Wear
from service.contract.status import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Result:
    """What is known of one machine.

    json  the answer of the interface contract, every key of it
    """

    json: Mapping[str, Any]

    @property
    def answer(self) -> Asset:
        """The answer as typed models; keys that this version does not know are left out."""
        return Asset.model_validate(self.json, extra="ignore")

    @property
    def asset(self) -> str:
        """The machine's name."""
        return self.json["asset"]

    @property
    def status(self) -> Status:
        """What a person should know first."""
        return self.answer.status

    @property
    def depth_um(self) -> Band | None:
        """Largest wear depth of both flanks with its 5–95 % band [µm]; None where it is not available."""
        wear = self.answer.wear
        depth = wear.max_depth_um.combined if isinstance(wear, Wear) else None
        return depth if isinstance(depth, Band) else None

    @property
    def life_hours(self) -> Band | None:
        """Remaining life at the present load with its 5–95 % band [h]; None where it is not available."""
        life = self.answer.rul
        return life.hours if isinstance(life, Rul) else None

    @property
    def windows(self) -> list[dict[str, Any]]:
        """The records of the measurement windows, oldest first: one dict each, ready for a data frame."""
        return [dict(record) for record in self.json["windows"]]

    def plot(self) -> Figure:
        """Wear depth with its limit, and measured and modelled vibration level, over the revolutions.

        Raises ValueError where the answer holds too few windows to draw.
        """
        import matplotlib.pyplot as plt

        from service.report.content import report_of
        from service.report.trends import figure_of

        figure = plt.figure(layout="constrained")
        try:
            return figure_of(report_of(self.json), figure)
        finally:
            plt.close(figure)  # it is drawn where it is shown; a notebook would show an open one twice

    def report(self, path: str | Path) -> None:
        """Writes the report for people, by the name's ending: .html or .pdf."""
        from service.report import write_report

        write_report(self.json, Path(path))

    def _repr_html_(self) -> str:
        """The state and the figures that matter, for a notebook."""
        status = self.json.get("status") or {}
        rows = [("status", " ".join([str(status.get("level")), *(status.get("reasons") or ())]))]
        life = "remaining life, of wear alone" if self.json["rul"].get("of_wear_alone") else "remaining life"
        for name, unit, band in (("wear depth", "µm", self.depth_um), (life, "h", self.life_hours)):
            if band is not None and band.median is not None:
                rows.append((name, f"{band.median:.3g} {unit} (5–95 %: {band.p05:.3g} to {band.p95:.3g} {unit})"))
            else:
                rows.append((name, "not available"))
        cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows)
        return f"<table><caption>{escape(self.asset)}</caption>{cells}</table>"


def assess(
    recording: str | Path, rig: str | Path | None = None, *, asset: str | None = None, trace: bool = True
) -> Result:
    """Evaluates a whole recording (MCAP), as `gear-twin assess` and the service do: by the configuration file and the
    environment.

    rig    rig file; None for the one attached to the recording
    asset  which machine, where the recording holds several
    trace  False: effects besides wear are not searched for

    Raises service.errors.InputError where the recording, the rig file or a setting cannot be used.
    """
    from service.configuration.load import load
    from service.runtime.by_settings import assess_by_settings

    return Result(assess_by_settings(load(), recording, rig, asset=asset, trace=trace))
