"""What a machine will be able to tell with its sensors and what is known of it, and what one more would add.

The rules are those of the core: transmission error needs encoder edges on both shafts that resolve the mesh harmonics
from which the depth is read; a depth needs a model and a count of revolutions; comparison with a healthy baseline needs
tooth counts, a speed and an accelerometer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from service.setup.answers import Answers
from service.setup.rig_file import RigDraft
from twin.features.extract import USABLE_RATE
from twin.rig import Rig
from twin.updating.depth import HARMONICS
from twin.updating.update import NEEDED

YES, PARTLY, NO = "yes", "partly", "no"


@dataclass(frozen=True, slots=True, kw_only=True)
class Equipment:
    """Sensors and knowledge of one machine."""

    accelerometers: int
    edges: tuple[int, int]  # a turn of the driving and of the driven shaft; 0 for none
    torque: bool
    teeth: tuple[int, int] | None
    speed_known: bool
    without_model: tuple[str, ...]  # why there is no model; empty where there is one
    estimated: bool  # whether the structure of the model is generic
    limit: bool  # whether an end of life is stated

    @property
    def both_encoders(self) -> bool:
        """Whether both encoders resolve the mesh harmonics that carry the depth."""
        return all(self.resolves(shaft) for shaft in (0, 1))

    def resolves(self, shaft: int) -> bool:
        """Whether the encoder of a shaft resolves mesh harmonics 1 to 3."""
        return self.teeth is not None and self.edges[shaft] >= self.edges_needed(shaft)

    def edges_needed(self, shaft: int) -> int:
        """Edges a turn of a shaft that resolve the mesh harmonics from which the depth is read."""
        assert self.teeth is not None
        return -int(-HARMONICS * self.teeth[shaft] // USABLE_RATE)

    @property
    def turns(self) -> bool:
        """Whether revolutions are counted."""
        return any(self.edges)

    @property
    def angle(self) -> bool:
        """Whether there is an angle to average over: counted, or from the mesh lines."""
        return self.turns or (self.teeth is not None and self.speed_known and self.accelerometers > 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ability:
    """One thing that users ask, and whether this machine can tell."""

    what: str
    level: str  # YES, PARTLY or NO
    how: str  # from what, how well, or what it needs


def equipment_of(answers: Answers, draft: RigDraft) -> Equipment:
    """The equipment that the answers describe."""
    accelerometers = len(answers.accelerometers)
    return equipment_of_rig(draft.rig, accelerometers, answers.edges, answers.torque_meter, draft.without_model)


def _without_model(rig: Rig, reasons: tuple[str, ...]) -> tuple[str, ...]:
    """Why a rig file holds no model, in the words of the answers where they say why."""
    missing = [key for key in NEEDED if not rig.has(key)]
    if not missing:
        return ()
    if missing == ["sensors.accelerometer"]:
        return ("no accelerometer is there to compare the model with",)
    return reasons or (f"the rig file does not give {', '.join(missing[:4])}{' …' if len(missing) > 4 else ''}",)


def equipment_of_rig(
    rig: Rig, accelerometers: int, edges: tuple[int, int], torque: bool, reasons: tuple[str, ...] = ()
) -> Equipment:
    """The equipment of a machine with a rig file and so many sensors.

    reasons  why the rig file holds no model, where they are known
    """
    known = rig.has("gears.pinion.teeth", "gears.gear.teeth")
    return Equipment(
        accelerometers=accelerometers,
        edges=edges,
        torque=torque,
        teeth=rig.teeth if known else None,
        speed_known=rig.has("operating.pinion_speed_hz"),
        without_model=_without_model(rig, reasons),
        estimated=bool(rig.estimated.parts),
        limit=rig.get("end_of_life.max_depth") is not None,
    )


def abilities(e: Equipment) -> tuple[Ability, ...]:
    """The answer to every question that users ask, most wanted first."""
    return tuple(Ability(what=what, level=level, how=how) for what, rule in RULES.items() for level, how in (rule(e),))


def _depth(e: Equipment) -> tuple[str, str]:
    if e.without_model:
        return NO, f"no model: {'; '.join(e.without_model)}"
    if e.both_encoders:
        return YES, "from the transmission error" + (
            "; the structure is estimated, so the band is wide and the depth preliminary" if e.estimated else ""
        )
    if e.resolves(0):
        return PARTLY, "from the pinion's motion alone: depends on the structure, wide band"
    if e.accelerometers and e.turns:
        return PARTLY, "from the vibration level, which depends on damping more than on wear: a rough guide"
    return NO, f"needs an encoder on both shafts, or a count of revolutions{_too_coarse(e)}"


def _too_coarse(e: Equipment) -> str:
    if e.teeth is None:
        return ""
    coarse = [
        f"the {name}'s encoder needs at least {e.edges_needed(i)} edges a turn and has {e.edges[i]}"
        for i, name in enumerate(("driving shaft", "driven shaft"))
        if 1 < e.edges[i] < e.edges_needed(i)
    ]
    return f" ({'; '.join(coarse)})" if coarse else ""


def _life(e: Equipment) -> tuple[str, str]:
    level, _ = _depth(e)
    if level == NO:
        return NO, "needs a wear depth"
    if not e.limit:
        return NO, "needs a wear limit (end_of_life.max_depth)"
    return level, "from the growth of the depth over at least three measurements, to the stated limit"


def _effects(e: Equipment) -> tuple[str, str]:
    if e.without_model:
        return NO, "needs a model; see comparison with a healthy baseline"
    if e.both_encoders and e.accelerometers:
        return (PARTLY if e.estimated else YES), (
            "eccentricity, misalignment, pitch errors, tooth crack, friction, sensor faults"
            + ("; only where they exceed what the estimated structure leaves open" if e.estimated else "")
        )
    return (
        PARTLY,
        "shaft-synchronous forces, bearing defects and sensor faults; tooth and gear errors need both encoders",
    )


def _baseline(e: Equipment) -> tuple[str, str]:
    if not e.accelerometers or e.teeth is None:
        return NO, "needs an accelerometer and the tooth counts"
    if not e.angle:
        return NO, "needs a speed: a tachometer, an encoder or the nominal speed"
    return (
        YES,
        "with at least five recordings of the healthy machine over its loads: local tooth fault, run-out, sensor",
    )


def _indicators(e: Equipment) -> tuple[str, str]:
    if not e.accelerometers:
        return NO, "needs an accelerometer"
    if not e.angle:
        return PARTLY, "RMS, kurtosis and crest factor; FM0, FM4, NA4 and sidebands need a speed"
    return YES, "RMS, kurtosis, FM0, FM4, NA4, sidebands, against time and revolutions"


def _pair(e: Equipment) -> tuple[str, str]:
    if e.turns and all(e.edges) and e.teeth is not None:
        return YES, "gear ratio, run-out of either gear, missed counts, from both encoders"
    return NO, "needs an encoder on both shafts and the tooth counts"


def _level(e: Equipment) -> tuple[str, str]:
    if not e.accelerometers:
        return NO, "needs an accelerometer"
    return YES, "RMS of the band" + (", and of the first five mesh harmonics" if e.angle and e.teeth else "")


RULES: dict[str, Callable[[Equipment], tuple[str, str]]] = {
    "wear depth": _depth,
    "remaining life": _life,
    "other effects, by the model": _effects,
    "change against a healthy baseline": _baseline,
    "condition indicators": _indicators,
    "ratio and run-out of the gears": _pair,
    "vibration level": _level,
}


def one_more(e: Equipment) -> tuple[str, ...]:
    """What one more sensor would add, a sentence for each that adds something; the largest gain first."""
    found: list[tuple[int, str]] = []
    for name, more in _candidates(e):
        gained = [
            (now, then)
            for now, then in zip(abilities(e), abilities(more), strict=True)
            if _rank(then.level) > _rank(now.level) or (then.level == now.level != NO and then.how != now.how)
        ]
        raised = [(now, then) for now, then in gained if _rank(then.level) > _rank(now.level)]
        if gained:
            text = "; ".join(f"{then.what}: {then.how}" for _, then in (raised or gained))
            found.append((-len(raised), f"{name}: {text}"))
    if not e.torque and not e.without_model and e.both_encoders:
        found.append((0, TORQUE))
    return tuple(text for _, text in sorted(found, key=lambda pair: pair[0]))


TORQUE = (
    "a torque meter: the mean of the transmission error, which gives the depth without knowledge of the structure; "
    "without one the load is taken as nominal and only the mesh lines are used"
)


def _rank(level: str) -> int:
    return (NO, PARTLY, YES).index(level)


def _candidates(e: Equipment) -> list[tuple[str, Equipment]]:
    out: list[tuple[str, Equipment]] = []
    if not e.accelerometers:
        out.append(("an accelerometer on the pinion's bearing", replace(e, accelerometers=1)))
    if e.teeth is None:
        return out
    for i, name in enumerate(("driving", "driven")):
        if not e.resolves(i):
            need = e.edges_needed(i)
            edges = (need, e.edges[1]) if i == 0 else (e.edges[0], need)
            out.append((f"an encoder with at least {need} edges a turn on the {name} shaft", replace(e, edges=edges)))
    if not e.turns:
        out.append(("a tachometer (one pulse a turn)", replace(e, edges=(1, e.edges[1]))))
    if not e.resolves(0) and not e.resolves(1):
        both = (e.edges_needed(0), e.edges_needed(1))
        out.append((f"encoders on both shafts ({both[0]} and {both[1]} edges a turn at least)", replace(e, edges=both)))
    return out
