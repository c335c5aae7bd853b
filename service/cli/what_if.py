"""`gear-twin what-if`: the remaining life under another duty."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.assessing import NoTrace, Prefix, RigFile, Shown, answering, prefix_of, settings_of, tell, windowing
from service.cli.config import configured
from service.cli.rest import Service, with_service


@configured
@answering
@partial(with_service, url=False)
def what_if(
    service: Service,
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help="Recording (MCAP), or address of a service: http://HOST:PORT.")
    ],
    duty: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SPEED_HZ,TORQUE_NM[,SHARE]",
            help="An operating condition and its share of the running time; may be repeated. Default: the present one.",
        ),
    ] = None,
    until: Annotated[str | None, typer.Option(metavar="DATE", help="Date to reach, ISO 8601.")] = None,
    hours: Annotated[float | None, typer.Option(help="Hours of operation to reach.")] = None,
    depth: Annotated[
        float | None, typer.Option(metavar="UM", help="Depth to reach in µm; default: the rig file's end of life.")
    ] = None,
    hours_per_day: Annotated[
        float | None, typer.Option(help="Running time per day; default: the rig file's, or as observed.")
    ] = None,
    rig: RigFile = None,
    no_trace: NoTrace = False,
    asset: Annotated[str | None, typer.Option(help="The asset, if there is more than one.")] = None,
    prefix: Prefix = None,
) -> Shown:
    """Remaining life under another duty, and the probability of reaching a date."""
    body = {
        "duty": [_point(text) for text in duty] if duty else None,
        "until": until,
        "hours": hours,
        "hours_per_day": hours_per_day,
        "max_depth_um": depth,
    }
    asked = {key: value for key, value in body.items() if value is not None}
    if source.startswith(("http://", "https://")):
        found = _of_service(service.at(source), asset, asked)
    else:
        found = _of_recording(Path(source), rig, asset, prefix, asked, trace=not no_trace)
    return Shown(found, lambda: text(found))


def _point(text: str) -> dict[str, float]:
    from service.errors import InputError

    parts = text.split(",")
    try:
        values = [float(part) for part in parts]
    except ValueError:
        values = []
    if len(values) not in (2, 3):
        raise InputError(f"--duty {text}: must be SPEED_HZ,TORQUE_NM or SPEED_HZ,TORQUE_NM,SHARE, such as 10,12.5,0.7")
    return dict(zip(("speed_hz", "torque_nm", "share"), values, strict=False))


def _of_recording(
    recording: Path, rig: Path | None, asset: str | None, prefix: str | None, asked: dict[str, Any], *, trace: bool
) -> dict[str, Any]:
    """The answer from a recording, assessed now."""
    from pydantic import ValidationError

    from service.cli.show import progress_bar
    from service.contract.what_if import WhatIfIn
    from service.contract.what_if_answer import answer
    from service.errors import InputError
    from service.runtime.assess import assess_with_state, warnings
    from service.runtime.by_settings import options_of
    from twin.errors import NotAvailable, ParameterError

    try:
        given = WhatIfIn(**asked)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"]) or "question"
        raise InputError(f"{name}: {first['msg'].removeprefix('Value error, ')}") from None
    options = options_of(settings_of(), trace=trace)
    with progress_bar("assessing") as bar:
        assessed_rig, state, found = assess_with_state(
            recording, rig, options, lambda share, windows: bar(share, f"{windows} windows"),
            asset=asset, prefix=prefix_of(prefix), assembly=windowing(),
        )  # fmt: skip
    for line in warnings(recording, found):
        tell(line)
    try:
        return answer(found["asset"], assessed_rig, state, given)
    except (NotAvailable, ParameterError) as reason:
        raise InputError(str(reason)) from None


def _of_service(service: Service, asset: str | None, asked: dict[str, Any]) -> dict[str, Any]:
    """The answer of a running service."""
    from service.errors import InputError

    if asset is None:
        known = [one["asset"] for one in service.ask("assets")]
        if len(known) != 1:
            raise InputError(f"{service.url} knows {', '.join(known) or 'no asset'}: choose one with --asset")
        (asset,) = known
    return service.ask("assets", asset, "what-if", body=asked)


def text(found: dict[str, Any]) -> str:
    """The answer for people."""
    limit = f"{found['max_depth_um']:.0f} µm"
    lines = [f"{found['asset']}: life to {limit} under this duty"]
    if found["reached"]:
        lines.append("  the end of life is reached")
    lines.append(f"  {_band(found['hours'])} h of operation, {_band(found['revolutions'])} revolutions")
    lines.append(f"  present duty: {_band(found['present_hours'])} h")
    date = found["date"]
    if "reason" in date:
        lines.append(f"  date: {date['reason']}")
    else:
        running = found["running"]
        days = [("–" if date[key] is None else date[key][:10]) for key in ("median", "p05", "p95")]
        lines.append(
            f"  until {days[0]} ({days[1]} … {days[2]}) at {running['hours_per_day']:.3g} h a day ({running['source']})"
        )
    target = found["target"]
    if target is not None:
        when = f"{target['hours']:.4g} h" + (f" ({target['date'][:10]})" if target["date"] else "")
        chance = "not known" if target["probability"] is None else f"{100 * target['probability']:.0f} %"
        lines.append(f"  probability of reaching {when}: {'at least ' if target['at_least'] else ''}{chance}")
    if found["preliminary"]:
        lines += [f"  preliminary: {reason}" for reason in found["preliminary"]["reasons"]]
        lines.append(f"  to settle it: {'; '.join(found['preliminary']['remedies'])}")
    lines += [f"  {note}" for note in (*found["notes"], *([found["reason"]] if found["reason"] else []))]
    return "\n".join(lines)


def _band(band: dict[str, float | None]) -> str:
    median, low, high = ("–" if band[key] is None else f"{band[key]:,.4g}" for key in ("median", "p05", "p95"))
    return f"{median} ({low} … {high})"
