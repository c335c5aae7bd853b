"""`gear-twin signals`: one view of a window of a recording, as a picture, CSV or JSON; without a service."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.assessing import Asset, Prefix, Recording, RigFile, Shown, answering, prefix_of, windowing
from service.cli.config import configured
from service.errors import InputError
from service.report.words import number


class ViewName(StrEnum):
    """The views of a window's signals."""

    waveform = "waveform"
    spectrum = "spectrum"
    order_spectrum = "order-spectrum"
    envelope_spectrum = "envelope-spectrum"
    synchronous_average = "synchronous-average"
    transmission_error = "transmission-error"
    flank = "flank"


class Shaft(StrEnum):
    """A shaft of the pair."""

    pinion = "pinion"
    gear = "gear"


FORMATS = (".png", ".csv", ".json")
MODEL_VIEWS = (ViewName.flank,)


@configured
@answering
def signals(
    recording: Recording,
    view: Annotated[ViewName, typer.Option(help="What to show of the window.")] = ViewName.spectrum,
    window: Annotated[int, typer.Option(help="Index of the window; -1 is the last one.")] = -1,
    channel: Annotated[
        str | None, typer.Option(help="Such as accel/y6 or transmission-error; default: the reference accelerometer.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File to write: its ending .png, .csv or .json says which. Default: a summary.")
    ] = None,
    shaft: Annotated[Shaft, typer.Option(help="Whose turns a synchronous average is over.")] = Shaft.pinion,
    averaged: Annotated[bool, typer.Option("--averaged", help="Average a spectrum over 15 segments.")] = False,
    rms: Annotated[bool, typer.Option("--rms", help="RMS in place of peak amplitudes.")] = False,
    band_hz: Annotated[
        tuple[float, float] | None, typer.Option(help="Band of the envelope; default: the most impulsive one.")
    ] = None,
    modelled: Annotated[
        bool, typer.Option("--modelled", help="Add what the twin expects: it is run on all windows first.")
    ] = False,
    dark: Annotated[bool, typer.Option("--dark", help="Dark picture.")] = False,
    log: Annotated[bool, typer.Option("--log", help="Logarithmic amplitudes in the picture.")] = False,
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
        modelled=modelled or view in MODEL_VIEWS,
    )  # fmt: skip
    options = ViewOptions(channel=channel, shaft=shaft.value, averaged=averaged, rms=rms, band=band_hz)
    try:
        shown = VIEWS[view.value](subject, options)
    except TwinError as error:
        raise InputError(f"{recording}: window {subject.index}: {error}") from None
    head = {"asset": subject.asset, "window": subject.index, "start_time": subject.started.isoformat()}
    answer = {**head, **as_json(shown, MOST_POINTS)}
    if out is not None:
        WRITERS[out.suffix.lower()](out, shown, answer, ("dark" if dark else "light", log))
    notes = () if out is None else (f"{shown.title} written to {out}",)
    return Shown(answer, lambda: _summary(answer, subject.channels), notes)


def _picture(out: Path, shown: Any, answer: dict[str, Any], look: tuple[str, bool]) -> None:
    from service.signals.pictures import as_png

    heading = f"{answer['asset']}, window {answer['window']}, {answer['start_time']}"
    _write(out, as_png(shown, heading, look[0], look[1], ("mesh", "bearing")))


def _csv(out: Path, shown: Any, answer: dict[str, Any], look: tuple[str, bool]) -> None:
    from service.signals.tables import as_csv

    _write(out, as_csv(shown).encode())


def _json(out: Path, shown: Any, answer: dict[str, Any], look: tuple[str, bool]) -> None:
    from service.json_text import json_text, write_text

    write_text(out, json_text(answer))


WRITERS: dict[str, Callable[[Path, Any, dict[str, Any], tuple[str, bool]], None]] = {
    ".png": _picture,
    ".csv": _csv,
    ".json": _json,
}


def _write(out: Path, content: bytes) -> None:
    try:
        out.write_bytes(content)
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {(error.strerror or 'fault').lower()}") from None


LINES = 8  # of a spectrum that the summary names


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
