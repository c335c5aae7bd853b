"""Thresholds and detection limits of one rig, by simulation: what is tried, one task at a time.

The tasks are pure and do not depend on one another, so that whoever runs them may spread them over processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from twin.detectability.limits import NOT_SIMULATED, DetectionLimit, limit_of, simulated_effects, size_of
from twin.detectability.nulls import null_evidence, one_campaign
from twin.detectability.windows import Campaign
from twin.effects import EFFECTS
from twin.required_evidence import DEFAULT, NullEvidence, RequiredEvidence
from twin.rig import Rig

Mapped = Callable[[Callable[..., Any], Sequence[Any]], Iterable[Any]]  # as the built-in map, in order
Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Study:
    """What the simulated machines of a rig show."""

    campaign: Campaign
    nulls: NullEvidence
    failed: int  # healthy machines without a steady state
    required: RequiredEvidence
    limits: tuple[DetectionLimit, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Healthy:
    """One healthy machine, by its seed."""

    rig: Rig
    campaign: Campaign

    def __call__(self, seed: int) -> Any:
        return one_campaign(self.rig, self.campaign, seed)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WithEffect:
    """The detection limit of one effect, by its name."""

    rig: Rig
    campaign: Campaign
    machines: int
    required: RequiredEvidence

    def __call__(self, name: str) -> DetectionLimit:
        return limit_of(self.rig, self.campaign, name, range(self.machines), self.required)


def study(
    rig: Rig,
    campaign: Campaign,
    *,
    rate: float = DEFAULT.rate,
    healthy: int = 100,
    machines: int = 2,
    mapped: Mapped = map,
    progress: Progress = lambda share, doing: None,
) -> Study:
    """Simulates healthy machines, then machines with one effect each; NotAvailable where the rig has no model.

    healthy   machines without an effect
    machines  for each effect
    """
    names = list(simulated_effects())
    share = healthy / (healthy + len(names) * machines * 5)  # of the work: a limit takes some five trials
    found = list(_told(mapped(Healthy(rig=rig, campaign=campaign), range(healthy)), healthy, 0.0, share, progress))
    nulls = null_evidence([effects for effects in found if effects is not None])
    required = nulls.required(rate, sum(1 for kind in EFFECTS.values() if kind.facts.detector))
    task = WithEffect(rig=rig, campaign=campaign, machines=machines, required=required)
    limits = list(_told(mapped(task, names), len(names), share, 1.0, progress))
    for name, why in NOT_SIMULATED.items():
        first = size_of(EFFECTS[name])
        limits.append(
            DetectionLimit(
                name=name, parameter=first.name, unit=first.unit, value=None, factor=1.0, note=f"not simulated: {why}"
            )
        )
    return Study(
        campaign=campaign,
        nulls=nulls,
        failed=sum(effects is None for effects in found),
        required=required,
        limits=tuple(limits),
    )


def _told(results: Iterable[Any], count: int, start: float, end: float, progress: Progress) -> Iterator[Any]:
    what = "healthy machines" if start == 0 else "machines with an effect"
    for i, result in enumerate(results, start=1):
        progress(start + (end - start) * i / count, what)
        yield result
