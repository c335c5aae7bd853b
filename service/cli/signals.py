"""`gear-twin signals`: one view of a window of a recording, as a picture, CSV or JSON; without a service."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Option

from service.cli.assessing import Asset, Prefix, Recording, RigFile, Shown, answering, prefix_of, windowing
from service.cli.config import configured
from service.errors import InputError
from service.json_text import json_text, write_bytes
from service.report.words import number

ViewName = Literal[
    "waveform", "spectrum", "order-spectrum", "envelope-spectrum", "synchronous-average", "transmission-error", "flank"
]
FORMATS = (".png", ".csv", ".json")
LINES = 8  # of a spectrum that the summary names


@configured
@answering
def signals(
    recording: Recording,
    view: Annotated[ViewName, Option(help="What to show of the window.")] = "spectrum",
    window: Annotated[int, Option(help="Index of the window; -1 is the last one.")] = -1,
    channel: Annotated[
        str | None, Option(help="Such as accel/y6 or transmission-error; default: the reference accelerometer.")
    ] = None,
    out: Annotated[
        Path | None, Option(help="File to write: its ending .png, .csv or .json says which. Default: a summary.")
    ] = None,
    shaft: Annotated[Literal["pinion", "gear"], Option(help="Whose turns a synchronous average is over.")] = "pinion",
    averaged: Annotated[bool, Option("--averaged", help="Average a spectrum over 15 segments.")] = False,
    rms: Annotated[bool, Option("--rms", help="RMS in place of peak amplitudes.")] = False,
    band_hz: Annotated[
        tuple[float, float] | None, Option(help="Band of the envelope; default: the most impulsive one.")
    ] = None,
    modelled: Annotated[
        bool, Option("--modelled", help="Add what the twin expects: it is run on all windows first.")
    ] = False,
    dark: Annotated[bool, Option("--dark", help="Dark picture.")] = False,
    log: Annotated[bool, Option("--log", help="Logarithmic amplitudes in the picture.")] = False,
    rig: RigFile = None,
    asset: Asset = None,
    prefix: Prefix = None,
) -> Shown:
    """Show signals of one window: waveform, spectra, synchronous average, transmission error or the worn flank."""
    from service.signals.recorded import recorded_subject
    from service.signals.view import MOST_POINTS, ViewOptions, as_json
    from service.signals.views import VIEWS
    from twin.errors import TwinError

    if out is not None and out.suffix.lower() not in FORMATS:
        raise InputError(f"{out}: the ending must be one of {', '.join(FORMATS)}")
    subject = recorded_subject(
        recording, window, rig_path=rig, asset=asset, prefix=prefix_of(prefix), assembly=windowing(),
        modelled=modelled or view == "flank",
    )  # fmt: skip
    options = ViewOptions(channel=channel, shaft=shaft, averaged=averaged, rms=rms, band=band_hz)
    try:
        shown = VIEWS[view](subject, options)
    except TwinError as error:
        raise InputError(f"{recording}: window {subject.index}: {error}") from None
    head = {"asset": subject.asset, "window": subject.index, "start_time": subject.started.isoformat()}
    answer = {**head, **as_json(shown, MOST_POINTS)}
    if out is not None:
        write_bytes(out, _file(out.suffix.lower(), shown, answer, dark, log))
    notes = () if out is None else (f"{shown.title} written to {out}",)
    return Shown(answer, lambda: _summary(answer, subject.channels), notes)


def _file(kind: str, shown: Any, answer: dict[str, Any], dark: bool, log: bool) -> bytes:
    """A view as a picture, a table or JSON."""
    if kind == ".png":
        from service.signals.pictures import as_png

        heading = f"{answer['asset']}, window {answer['window']}, {answer['start_time']}"
        return as_png(shown, heading, "dark" if dark else "light", log, ("mesh", "bearing"))
    if kind == ".csv":
        from service.signals.tables import as_csv

        return as_csv(shown).encode()
    return f"{json_text(answer)}\n".encode()


def _summary(answer: dict[str, Any], channels: tuple[str, ...]) -> list[str]:
    """Title, figures, the strongest lines of a spectrum, and notes."""
    lines = [f"{answer['title']}, window {answer['window']} of {answer['asset']}, {answer['start_time']}"]
    lines += [f"  {name.replace('_', ' ')}: {number(value, 5)}" for name, value in answer["figures"].items()]
    if "spectrum" in answer["view"]:
        x, measured = answer["x"], answer["series"][0]
        lines.append("Strongest lines:")
        for place, value in strongest(x["values"], measured["values"], LINES):
            near = min(answer["markers"], key=lambda m: abs(m["x"] - place), default=None)
            reach = 1.5 * answer["figures"].get("resolution", x["values"][1] - x["values"][0])
            name = near["label"] if near is not None and abs(near["x"] - place) <= reach else ""
            figures = f"  {number(place, 6):>10} {x['unit']}  {number(value, 4):>10} {measured['unit']}"
            lines.append(f"{figures}  {name}".rstrip())
    return [*lines, *(f"{note}." for note in answer["notes"]), f"Channels: {', '.join(channels)}."]


def strongest(x: list[float], values: list[float], count: int) -> list[tuple[float, float]]:
    """The largest points that are larger than both neighbours, largest first."""
    tops = [(values[i], x[i]) for i in range(1, len(values) - 1) if values[i - 1] <= values[i] > values[i + 1]]
    return [(place, value) for value, place in sorted(tops, reverse=True)[:count]]
