"""`gear-twin detectability`: which effects a rig's instruments can show, from which size, and how often by mistake."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.assessing import tell
from service.json_text import wrote_json
from service.runtime.usable_cores import usable_cores

CHANNELS = ("torque", "encoder/pinion", "encoder/gear")


def detectability(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML).")],
    false_alarm_rate: Annotated[
        float, typer.Option(help="Share of campaigns of healthy machines in which an effect may be reported.")
    ] = 0.01,
    speed_hz: Annotated[float | None, typer.Option(help="Speed of the pinion; default: the rig file's.")] = None,
    torque_nm: Annotated[float | None, typer.Option(help="Torque on the pinion; default: the rig file's.")] = None,
    depth_um: Annotated[
        float | None, typer.Option(help="Wear depth of the last window; default: a tenth of the end-of-life depth.")
    ] = None,
    windows: Annotated[int, typer.Option(min=4, max=60, help="Measurement windows of a campaign.")] = 6,
    seconds: Annotated[float, typer.Option(min=0.5, max=60, help="Length of a window.")] = 2.5,
    without: Annotated[
        list[str] | None, typer.Option(help=f"Channel that the machine lacks, of {', '.join(CHANNELS)}; repeatable.")
    ] = None,
    healthy: Annotated[int, typer.Option(min=20, max=10_000, help="Healthy machines that are simulated.")] = 100,
    machines: Annotated[int, typer.Option(min=1, max=100, help="Machines that are simulated for each effect.")] = 2,
    processes: Annotated[int, typer.Option(min=1, help="Processes; default: as many as cores.")] = usable_cores(),
    out: Annotated[Path | None, typer.Option(help="File to write, for `assess --detectability`.")] = None,
    json: Annotated[
        Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
    ] = None,
) -> None:
    """Simulate machines of a rig file, and tell from which size each effect is found at a rate of false alarms."""
    from service.cli.show import progress_bar
    from service.errors import InputError
    from service.files.detectability import answer, save
    from service.files.rig import load_rig
    from twin.detectability.study import study
    from twin.errors import TwinError

    known = load_rig(rig)
    try:
        campaign = _campaign(known, speed_hz, torque_nm, depth_um, windows, seconds, without or [])
        with progress_bar("simulating") as bar, _mapping(processes) as mapped:
            found = study(
                known,
                campaign,
                rate=false_alarm_rate,
                healthy=healthy,
                machines=machines,
                mapped=mapped,
                progress=bar,
            )
    except TwinError as error:
        raise InputError(f"{rig}: {error}") from None
    data = answer(known, found)
    if out is not None:
        save(known, found, out)
    if not wrote_json(data, json):
        _print(data)
    if out is not None:
        tell(f"thresholds and detection limits written to {out}")


def _campaign(
    rig: Any,
    speed: float | None,
    torque: float | None,
    depth: float | None,
    windows: int,
    seconds: float,
    without: list[str],
) -> Any:
    """The windows that are simulated."""
    from dataclasses import replace

    from service.errors import InputError
    from twin.detectability.windows import Campaign, instruments_of
    from twin.model import Condition

    unknown = [name for name in without if name not in CHANNELS]
    if unknown:
        raise InputError(f"--without {unknown[0]}: must be one of {', '.join(CHANNELS)}")
    if speed is None:
        (speed,) = rig.require("the speed", "operating.pinion_speed_hz")
    if torque is None:
        (torque,) = rig.require("the torque", "operating.input_torque")
    if depth is None:
        (end,) = rig.require("the wear depth of the last window", "end_of_life.max_depth")
        depth = 1e6 * end / 10
    instruments = instruments_of(rig, seconds)
    kept = tuple(name for name in instruments.channels if name not in without)
    return Campaign(
        conditions=(Condition(speed_hz=float(speed), torque=float(torque)),) * windows,
        depth=1e-6 * float(depth),
        instruments=replace(instruments, channels=kept),
    )


@contextmanager
def _mapping(processes: int) -> Iterator[Any]:
    """A map over so many processes."""
    if processes == 1:
        yield map
        return
    from concurrent.futures import ProcessPoolExecutor

    with ProcessPoolExecutor(processes) as pool:
        yield pool.map


def _print(data: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    from service.cli.diagnosis import label

    console = Console()
    first = data["conditions"][0]
    console.print(
        f"{data['rig']}: {len(data['conditions'])} windows of {data['window_seconds']:g} s at {first['speed_hz']:g} Hz "
        f"and {first['torque_nm']:g} N·m, worn to {data['wear_depth_um']:g} µm; {', '.join(data['channels'])}"
    )
    table = Table("effect", "found from", "within a factor of", "note")
    for limit in data["detection_limits"]:
        size, tried = (_size(limit[which], limit["unit"]) for which in ("value", "largest_tried"))
        value = "–" if limit["value"] is None else f"{limit['parameter'].replace('_', ' ')} {size}"
        note = limit["note"] if limit["largest_tried"] is None else f"{limit['note']}: {tried}"
        factor = "" if limit["value"] is None else f"{limit['within_factor']:.2f}"
        table.add_row(label(limit["name"]), value, factor, note)
    console.print(table)
    healthy = data["healthy_campaigns"]
    if data["false_alarms"]:
        for name, known in data["false_alarms"].items():
            console.print(
                f"{name}: {len(known['evidence'])} of {healthy} healthy machines give it some evidence, at most "
                f"{max(known['evidence']):.1f} nat; {known['required_evidence']:.1f} nat are required"
            )
    else:
        console.print(
            f"None of {healthy} healthy machines gives evidence for any effect, even with thresholds lowered; the "
            "thresholds are those of the register."
        )
    console.print(
        f"Rate of false alarms asked for: {data['false_alarm_rate']:g} of the campaigns. The simulated machines have "
        "the structure of the rig file within its tolerances; a machine of another structure may do worse."
    )


def _size(value: float | None, unit: str) -> str:
    """A size in the unit that workshops use."""
    from service.cli.diagnosis import figure

    return figure({"value": value, "unit": unit, "std": None})
