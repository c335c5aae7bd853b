"""What an alarm rule may watch: one line a quantity, with its unit, what to do, and where its limits come from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Basis = Literal["criterion", "learned", "fixed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """One quantity that rules may watch."""

    label: str  # at the start of a sentence
    unit: str = ""
    bases: tuple[Basis, ...]  # what its limits may come from; the first is the default
    direction: Literal["above", "below"] = "above"  # in which it is bad
    places: str = ""  # what tells its instances apart: sensor, sensor/gear, place of the thermometer; "" for one
    action: str = ""  # where the finding does not bring its own


CRITERION: tuple[Basis, ...] = ("criterion",)
LEARNED: tuple[Basis, ...] = ("learned", "fixed")
INSPECT = "Compare the spectra of {place} with earlier ones, and check the mount of the sensor"
INSPECT_GEAR = "Check for a damaged tooth, run-out or a bent shaft: compare the spectra of {place} with earlier ones"

QUANTITIES = {
    "depth": Quantity(
        label="Wear depth",
        unit="µm",
        bases=("criterion", "fixed"),
        action="Plan the replacement of the gear pair and measure the wear depth at the next stop",
    ),
    "life": Quantity(
        label="Remaining life",
        unit="h",
        bases=("criterion", "fixed"),
        direction="below",
        action="Plan the replacement of the gear pair",
    ),
    "effect": Quantity(label="Effect", bases=CRITERION, places="effect"),
    "unexplained": Quantity(label="Unknown effect", bases=CRITERION),
    "modulation": Quantity(label="Modulation of the mesh", bases=CRITERION, places="shaft/times per turn"),
    "wear_rate": Quantity(label="Wear rate", bases=CRITERION),
    "level": Quantity(label="Vibration level", bases=CRITERION, places="sensor"),
    "validity": Quantity(label="Validity of the model", bases=CRITERION),
    "encoder_ratio": Quantity(label="Ratio of the encoders", bases=CRITERION),
    "status": Quantity(label="Status", bases=CRITERION),
    "data": Quantity(label="Data quality", bases=CRITERION),
    "rms": Quantity(label="Vibration level", unit="m/s²", bases=LEARNED, places="sensor", action=INSPECT),
    "kurtosis": Quantity(label="Kurtosis", bases=LEARNED, places="sensor", action=INSPECT),
    "crest_factor": Quantity(label="Crest factor", bases=LEARNED, places="sensor", action=INSPECT),
    "fm0": Quantity(label="FM0", bases=LEARNED, places="sensor/gear", action=INSPECT_GEAR),
    "fm4": Quantity(label="FM4", bases=LEARNED, places="sensor/gear", action=INSPECT_GEAR),
    "na4": Quantity(label="NA4", bases=LEARNED, places="sensor/gear", action=INSPECT_GEAR),
    "energy_ratio": Quantity(label="Energy ratio", bases=LEARNED, places="sensor/gear", action=INSPECT_GEAR),
    "sideband_level_factor": Quantity(
        label="Sideband level factor", bases=LEARNED, places="sensor/gear", action=INSPECT_GEAR
    ),
    "temperature": Quantity(
        label="Temperature",
        unit="°C",
        bases=("fixed",),
        places="place of the thermometer",
        action="Check the oil level and the cooling at {place}",
    ),
}
"""By the name that rules use."""

JUDGED = tuple(name for name, quantity in QUANTITIES.items() if "criterion" in quantity.bases)
"""Those whose alarms rest on findings that are in the status already."""
