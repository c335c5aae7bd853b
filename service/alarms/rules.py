"""Alarm rules: two levels for one quantity, with hysteresis and a duration; those of an asset, and the defaults.

| basis | where the limits come from |
| --- | --- |
| `criterion` | the rig file's end-of-life criterion, the life horizon, the class of an effect |
| `learned` | the asset's own first healthy windows under each operating condition (twin/learned_limits.py) |
| `fixed` | the rule's own `watch` and `alarm` |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from service.alarms.quantities import QUANTITIES, Basis
from service.errors import InputError
from service.files.documents import load_document
from twin.learned_limits import DEFAULT as LEARNED

NAME = r"^[A-Za-z0-9_.\-]{1,64}$"
MOST_RULES = 200
ALL = "*"


class RuleFields(BaseModel):
    """One alarm rule, each field by itself."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: str = Field(pattern=NAME, description="unique among the asset's rules")
    quantity: str = Field(description="what is watched", json_schema_extra={"enum": list(QUANTITIES)})
    place: str = Field(default=ALL, min_length=1, max_length=160, description="sensor, sensor/gear, …; * for each")
    basis: Basis | None = Field(default=None, description="where the limits come from; by default as the quantity says")
    watch: float | None = Field(default=None, description="limit of the level watch, in the quantity's unit")
    alarm: float | None = Field(default=None, description="limit of the level alarm, in the quantity's unit")
    direction: Literal["above", "below"] | None = Field(default=None, description="in which the quantity is bad")
    hysteresis: float = Field(default=0.05, ge=0, lt=1, description="share of a limit by which it must be undercut")
    windows: int = Field(default=1, ge=1, le=1000, description="windows in a row that raise it, and that end it")
    seconds: float = Field(default=0.0, ge=0, le=1e7, description="how long the level must hold besides [s]")
    learn_windows: int = Field(
        default=LEARNED.windows, ge=LEARNED.windows, le=1000, description="healthy windows that limits are learned from"
    )
    without_depth: bool = Field(
        default=False, description="only where no wear depth is known: wear itself raises levels, and is then judged"
    )
    enabled: bool = True

    @field_validator("quantity")
    @classmethod
    def _is_known(cls, quantity: str) -> str:
        if quantity not in QUANTITIES:
            raise ValueError(f"quantity {quantity!r} is not known; known are {', '.join(QUANTITIES)}")
        return quantity


class Rule(RuleFields):
    """One alarm rule, whose fields fit one another."""

    @model_validator(mode="after")
    def _fits_its_quantity(self) -> Rule:
        known = QUANTITIES[self.quantity]
        if self.basis is not None and self.basis not in known.bases:
            raise ValueError(f"basis of {self.quantity} must be {' or '.join(known.bases)}, not {self.basis}")
        limits = [limit for limit in (self.watch, self.alarm) if limit is not None]
        if self.limits_from != "fixed":
            if limits:
                raise ValueError(f'watch and alarm are limits of basis = "fixed"; this rule is {self.limits_from}')
            return self
        if not limits:
            raise ValueError('a rule of basis = "fixed" needs a limit: watch, alarm or both')
        if self.watch is not None and self.alarm is not None:
            further = self.alarm - self.watch if self.is_above else self.watch - self.alarm
            if further < 0:
                raise ValueError(f"alarm = {self.alarm:g} must lie beyond watch = {self.watch:g} ({self.bad_side})")
        return self

    @property
    def limits_from(self) -> Basis:
        """Where the limits come from."""
        if self.basis is not None:
            return self.basis
        if self.watch is not None or self.alarm is not None:
            return "fixed"
        return QUANTITIES[self.quantity].bases[0]

    @property
    def bad_side(self) -> Literal["above", "below"]:
        """On which side of its limits the quantity is bad."""
        return self.direction or QUANTITIES[self.quantity].direction

    @property
    def is_above(self) -> bool:
        """Whether large values are bad."""
        return self.bad_side == "above"

    def covers(self, quantity: str, place: str) -> bool:
        """Whether the rule watches this quantity at this place."""
        return self.enabled and self.quantity == quantity and self.place in (ALL, place)


Rules = Annotated[tuple[Rule, ...], Field(max_length=MOST_RULES)]


class RuleFile(BaseModel):
    """A set of rules: in a file, `[[rule]]` tables."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    rule: Rules

    @model_validator(mode="after")
    def _names_are_unique(self) -> RuleFile:
        names = [rule.name for rule in self.rule]
        double = sorted({name for name in names if names.count(name) > 1})
        if double:
            raise ValueError(f"more than one rule is called {', '.join(double)}")
        return self


INDICATORS = ("rms", "kurtosis", "fm0", "fm4", "sideband_level_factor")
BY_STATUS = ("depth", "life", "wear_rate", "effect", "level", "modulation", "unexplained", "encoder_ratio")
DURATION = 3  # windows in a row for learned limits
DATA_DURATION = 2  # windows in a row without usable data

DEFAULT_RULES: tuple[Rule, ...] = (
    *(Rule(name=name, quantity=name) for name in BY_STATUS),
    Rule(name="data", quantity="data", windows=DATA_DURATION),
    *(Rule(name=name, quantity=name, windows=DURATION, without_depth=True) for name in INDICATORS),
)


def load_rules(path: Path) -> tuple[Rule, ...]:
    """The rules of a TOML file; InputError says what in it is wrong."""
    given = load_document(path, "file of alarm rules, with [[rule]] tables,")
    try:
        return RuleFile.model_validate(given).rule
    except ValidationError as error:
        raise InputError(f"{path}: {first_fault(error)}") from None


def rules_at(path: Path | None) -> tuple[Rule, ...]:
    """The alarm rules of assets that have none of their own: those of a file, where one is given."""
    return DEFAULT_RULES if path is None else load_rules(path)


def first_fault(error: ValidationError) -> str:
    """The first fault of rules: where, and what."""
    first = error.errors()[0]
    at = ".".join(str(part) for part in first["loc"]) or "rules"
    return f"{at}: {first['msg'].removeprefix('Value error, ')}"


def rules_from(stored: Sequence[Mapping[str, Any]]) -> tuple[Rule, ...]:
    """Rules as they were stored."""
    return tuple(Rule.model_validate(rule) for rule in stored)
