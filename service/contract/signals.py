"""What the resources of signals answer, for OpenAPI's description."""

from __future__ import annotations

from pydantic import Field

from service.contract.base import AnswerModel


class KeptWindow(AnswerModel):
    """A window whose raw signals are kept."""

    index: int
    start_time: str
    revolutions: float | None
    bytes: int = Field(description="on disk")
    found: bool = Field(description="whether an effect was found, changed or dropped at this window")
    refused: bool


class Signals(AnswerModel):
    """What is kept of an asset."""

    asset: str
    windows: list[KeptWindow]
    channels: list[str] = Field(description="of the newest window, the reference accelerometer first")
    views: list[str]
    bytes: int = Field(description="on disk, together")
    reason: str | None = Field(description="why nothing can be looked at; null where something can")


class Axis(AnswerModel):
    """What lies along x."""

    label: str
    unit: str
    values: list[float | None]


class Series(AnswerModel):
    """One curve."""

    name: str = Field(description="`measured`, `modelled`, …")
    unit: str
    kind: str = Field(description="`curve`, or `lines` for single spectral lines")
    x: list[float | None] | None = Field(None, description="absent where the view's axis holds")
    values: list[float | None]
    points_total: int = Field(description="before thinning")


class Marker(AnswerModel):
    """Where something is expected."""

    kind: str = Field(description="`mesh`, `sideband`, `shaft` or `bearing`")
    label: str
    x: float


class SignalView(AnswerModel):
    """One view of a window's signals."""

    asset: str
    window: int
    start_time: str | None
    view: str
    channel: str
    title: str
    x: Axis
    series: list[Series]
    markers: list[Marker]
    figures: dict[str, float] = Field(description="RMS, resolution, speed and what else one number says")
    equal_axes: bool = Field(description="whether x and the values are lengths on one scale")
    notes: list[str]


class LeftOut(AnswerModel):
    """A window without the spectrum, and why."""

    index: int
    reason: str


class Waterfall(AnswerModel):
    """Amplitudes of windows over frequency or order."""

    asset: str
    view: str
    channel: str
    unit: str
    x: Axis
    windows: list[KeptWindow]
    values: list[list[float | None]] = Field(description="one row a window, as far as all windows reach")
    markers: list[Marker]
    left_out: list[LeftOut]
    notes: list[str]


class Quantity(AnswerModel):
    """One quantity over the windows."""

    name: str
    label: str
    unit: str
    group: str
    values: list[float | None]


class Indicators(AnswerModel):
    """Trends of an asset's windows."""

    asset: str
    index: list[int]
    start_time: list[str]
    revolutions: list[float | None]
    quality: list[str]
    quantities: list[Quantity]
