"""What is true of every instance of an effect: declared once on its class, so that nothing else asks for it by name.

Tracing, updating and the reports read these declarations. `tests/claims/test_effects_facts.py` compares those of every
effect of the table with what the model makes of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import exp, inf

from twin.effects.parameter import Parameter
from twin.thresholds import deciding

ACTS_ON = ("nothing", "mesh", "teeth", "shaft", "bearing", "sensor", "unknown")
DETECTORS = (
    "", "rattle", "shaft_forces", "non_gear", "tooth_errors", "crack", "eccentricity", "mesh", "sensor", "unknown",
)  # fmt: skip
CLAIMS = ("lines", "envelope", "swing")
ALARM_CLASSES = ("none", "watch", "alarm")
CHANGES = ("gears_replaced", "sensor_moved", "oil_changed", "counter_reset", "reassembled")  # of a machine, by people


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionThresholds:
    """What an effect must show at least before the mesh search reports it."""

    least_size: float = deciding(
        0.3,
        of="prior spread of the fitted number",
        meaning="size below which the effect is indistinguishable from what sound teeth differ by",
        source="not derived: chosen; effects of the table that were tuned state their own",
    )
    least_gain: float = deciding(
        0.0,
        unit="nat",
        meaning="evidence that this effect must add, where it is more than the mesh search asks of every effect",
        source="not derived: 0 leaves the decision to the mesh search",
    )
    largest_size: float = deciding(
        inf,
        meaning="largest size that is possible on this rig; the model is given no more",
        source="not derived: left to the parameter's bounds",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ShaftLine:
    """The line by which a force that turns with a shaft is found: `size` and `phase` are read from it.

    The line is in proportion to the size, and turns with the phase: X ∝ size·e^{i·phase}.
    """

    channel: str  # that shows it: "torque" or "acceleration"
    size: str  # parameter
    phase: str  # parameter [rad]
    order: str = ""  # parameter that holds the order of the pinion, where it is free; else the shaft's own order
    shaft: str = "pinion"  # whose own order it is: "pinion" or "gear"
    unit: float  # of the size, at which the response is taken: small enough to be linear
    unit_of: str = ""  # quantity of the machine that the unit is a share of (twin/scales.py); "" where it is none


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedNumber:
    """One free number u of the mesh search, and the parameter that it stands for.

    value = centre + scale·u, or centre·exp(scale·u) where `logarithmic`; the prior of u has a standard deviation of 1.
    """

    parameter: Parameter
    scale: float  # in the parameter's unit; of its logarithm where `logarithmic`
    centre: float = 0.0
    logarithmic: bool = False
    start: float = 0.5  # u that a fit starts from
    low: float
    high: float
    sizes: bool = True  # whether it counts where the effect's size is compared with its least

    def value(self, u: float) -> float:
        """The parameter [its unit] for a number u."""
        if self.logarithmic:
            return self.centre * exp(self.scale * float(u))
        return self.centre + self.scale * float(u)


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What an effect acts on and how it is found."""

    label: str  # for people, in a sentence: "tooth friction"
    action: str  # what to do about it: one sentence in the imperative, "Check the lubrication of the gears."
    acts_on: str  # one of ACTS_ON
    periods: tuple[str, ...]  # that an instance may have, of PERIODS (setup.py)
    detector: str  # that finds it: one of DETECTORS; "" for none
    alarm_class: str = "watch"  # one of ALARM_CLASSES: what a machine with this effect deserves
    stated: tuple[str, ...] = ()  # parameters that only shape it, and that a person wants to know all the same
    ended_by: tuple[str, ...] = ("gears_replaced",)  # changes of the machine after which it has to be found again
    changes_mesh_lines: bool = True  # whether the lines at mesh orders change, and with them the estimated wear depth
    shapes_wear: bool = False  # whether flanks wear to another profile under it
    tilts_shaft: bool = False  # whether the mean transmission error moves by an unknown step when it sets in
    synchronous: bool = True  # whether its lines survive averaging over turns of a shaft
    separates_teeth: bool = False  # whether there is no steady mesh from which a wear depth could be estimated
    claims: str = "lines"  # one of CLAIMS: what of a window the effect explains
    slices: int = 1  # across the face that it needs, whatever its size
    shaft_line: ShaftLine | None = None  # for the detector of shaft forces
    fitted: tuple[FittedNumber, ...] = ()  # for the mesh search; from the parameters' priors where none are given
    detection: DetectionThresholds = DetectionThresholds()

    def __post_init__(self) -> None:
        for name, value, known in (
            ("acts_on", self.acts_on, ACTS_ON),
            ("detector", self.detector, DETECTORS),
            ("alarm_class", self.alarm_class, ALARM_CLASSES),
            ("claims", self.claims, CLAIMS),
        ):
            if value not in known:
                raise ValueError(f"{name} = {value!r} must be one of {', '.join(map(repr, known))}")
        if not self.action.endswith(".") or len(self.action) < 2:
            raise ValueError(f"action = {self.action!r} must be a sentence that ends with a full stop")
        for change in self.ended_by:
            if change not in CHANGES:
                raise ValueError(f"ended_by = {change!r} must be one of {', '.join(map(repr, CHANGES))}")

    @property
    def is_torque(self) -> bool:
        """Whether the effect is itself a torque on a shaft."""
        return self.shaft_line is not None and self.shaft_line.channel == "torque"


def numbers_from_priors(parameters: Iterable[Parameter]) -> tuple[FittedNumber, ...]:
    """Every parameter that gives the effect its size, as a number in units of its prior spread."""
    return tuple(
        FittedNumber(
            parameter=p,
            scale=p.prior,
            centre=p.neutral,
            low=(p.low - p.neutral) / p.prior,
            high=(p.high - p.neutral) / p.prior,
        )
        for p in parameters
        if not p.shape and not p.many
    )
