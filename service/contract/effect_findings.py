"""Findings of the status that are other than wear: effects, what is new of the mesh's modulation, unknown content."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from service.contract.finding import Finding, Level, sentence
from service.contract.parts import causes_of
from twin import assessment
from twin.assessment.key import MICROMETRE, PERCENT
from twin.attention import StatusLimits

OTHER_ACTIONS = {"mesh_change": "Inspect the flanks and the lubrication of the gears at the next stop."}
PLURALS = ("errors", "teeth")  # at the end of a label
SETTLED = ("accepted", "pinned")  # by an engineer
CONFIRMATION = "inspect the machine, or replace the estimates in the rig file by measured values"
UNNAMED_ACTION = "Find out what has changed in the machine, and inspect it at the next stop."
"""For changes against a baseline that are no effect of the table."""
ERRORS = ("waveform", "transmission_error", "rms")
TIMES = {1: "once", 2: "twice", 3: "three times"}

Rule = Callable[[assessment.Assessment, StatusLimits], Iterable[Finding]]


def _effects(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    from twin.effects.channel_faults import facts_of  # loads half of the twin, which a start does without

    for effect in found.effects:
        known = facts_of(effect.name)
        if known is not None and known.acts_on == "unknown" and found.unexplained.verdict == "unknown_effect":
            continue  # its reason says it
        names = (effect.name, *effect.evidence.indistinguishable_from)
        label = " or ".join(label_of(name) for name in names)
        alarm = all(getattr(facts_of(name), "alarm_class", "watch") == "alarm" for name in names)
        action = OTHER_ACTIONS.get(effect.name, UNNAMED_ACTION) if known is None else known.action
        where = f" in {', '.join(effect.channels)}" if effect.channels else ""
        sizes = ", ".join(_size(name, p) for name, p in effect.parameters.items() if _is_size(effect.name, name, p))
        plural = label_of(effect.name).endswith(PLURALS)
        verb = (
            ("are suspected" if plural else "is suspected")
            if effect.status == "suspected"
            else ("were found" if plural else "was found")
        )
        subject = "/".join(["effect", effect.name, *effect.channels])
        acts = f"{action.removesuffix('.')} ({', '.join(effect.channels)})." if effect.channels else action
        reason = f"{label[:1].upper()}{label[1:]} {verb}{where}" + (f": {sizes}." if sizes else ".")
        if len(names) > 1:
            reason = f"{reason.removesuffix('.')}; the channels do not distinguish them."
        for caveat in effect.caveats:
            reason = f"{reason.removesuffix('.')}; {caveat[:1].lower()}{caveat[1:]}"
        if effect.status == "suspected":
            alarm, acts = False, f"Record further windows to confirm it ({label}): {acts[:1].lower()}{acts[1:]}"
        elif effect.caveats and effect.status not in SETTLED:
            alarm, acts = False, f"Confirm the effect ({label}) before acting on it: {CONFIRMATION}."
        level: Level = "alarm" if alarm else "watch"
        yield Finding(subject=subject, level=level, reason=reason, action=acts, share=explained_by(effect))


def label_of(name: str) -> str:
    """What people call an effect, in a sentence."""
    from twin.effects.channel_faults import label_of

    return label_of(name) or name.replace("_", " ")


def explained_by(effect: assessment.EffectAssessment) -> float | None:
    """The largest share of the energy of an error on held-out windows that an effect explains; None where unknown."""
    pairs = [(getattr(effect.error_before, n), getattr(effect.error_after, n)) for n in ERRORS]
    shares = [1 - (after / before) ** 2 for before, after in pairs if before and after is not None]
    return max(0.0, *shares) if shares else None


def _is_size(effect: str, name: str, parameter: assessment.ParameterValue) -> bool:
    """Whether a parameter says how large an effect is, or is stated all the same; phases are of no use to a person."""
    from twin.effects import EFFECTS

    known = EFFECTS.get(effect)
    shapes = () if known is None else [p.name for p in known.parameters if p.shape and p.name not in known.facts.stated]
    return name not in shapes and parameter.unit != "rad"


def _size(name: str, parameter: assessment.ParameterValue) -> str:
    value, unit = parameter.value, parameter.unit
    if unit == "m":
        value, unit = value / MICROMETRE, "µm"
    elif not unit and name.endswith(("_loss", "_share")):
        value, unit = value / PERCENT, "%"
    figure = f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"  # no power of ten in a sentence
    return f"{name.replace('_', ' ')} {figure}" + (f" {unit}" if unit else "")


def _unknown(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    rest = found.unexplained
    if rest.verdict == "unknown_effect":
        share = "" if rest.share is None else f" ({100 * rest.share:.2g} % of the measured energy)"
        yield Finding(
            subject="unexplained",
            level="alarm" if rest.struck else "watch",
            reason=sentence(f"The vibration has a cause that no effect explains{share}: {rest.reason}"),
            action=f"Stop the machine, and inspect the teeth of the {rest.struck} and what turns with it."
            if rest.struck
            else "Find the cause of the unexplained vibration: look for what runs at these frequencies nearby.",
            share=rest.share,
        )


def _modulation(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    """What is new of the mesh's modulation: of every shaft and multiple the channel where it is deepest."""
    deepest: dict[tuple[str, int], assessment.Modulation] = {}
    for one in found.modulation or ():
        if one.new:
            key = one.shaft, one.multiple
            deepest[key] = max(deepest.get(key, one), one, key=lambda m: m.depth)
    for (shaft, multiple), one in deepest.items():
        low, high = one.healthy or (0.0, 0.0)
        yield Finding(
            subject=f"modulation/{shaft}/{multiple}",
            level="watch",
            reason=f"The mesh vibration is modulated {TIMES[multiple]} per turn of the {shaft}, which is new: "
            f"{one.depth / PERCENT:.3g} % in {one.sensor}, healthy {low / PERCENT:.2g} to {high / PERCENT:.2g} %.",
            action=f"Check for {causes_of(shaft, multiple)}.",
            share=1 - (high / one.depth) ** 2,
        )


def _new(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    """What a panel calls new though the verdict does not: content, tooth pattern, lines of no shaft, raw levels."""
    if found.unexplained.verdict == "unknown_effect":
        return  # its reason says them
    if found.attribution is not None and found.attribution.unknown:
        yield Finding(
            subject="unknown", level="watch", reason=sentence(found.attribution.unknown), action=UNNAMED_ACTION
        )
    window = None if found.baseline is None else found.baseline.window
    if window is not None and window.pattern_compared and not window.same_teeth:
        yield Finding(
            subject="tooth_pattern",
            level="watch",
            reason="The pattern of the teeth is not that of the healthy recordings.",
            action="Check whether gears were changed or reassembled, and learn a new baseline if they were.",
        )
    for lines in found.unattributed_lines or ():
        if lines.new:
            yield Finding(
                subject="unattributed_lines",
                level="watch",
                reason=f"Lines {lines.frequency:.3g} Hz from those of the mesh are new, and belong to no shaft.",
                action=f"Find what turns {lines.frequency:.3g} times a second in the machine or nearby.",
            )
    raw = None if found.baseline is None else found.baseline.raw_limit
    for measure in () if raw is None else raw.exceeded:
        name, healthy = "RMS" if measure.name == "rms" else measure.name, f"{measure.low:.3g} to {measure.high:.3g}"
        yield Finding(
            subject=f"level/{measure.channel}",
            level="watch",
            reason=f"The {name} of {measure.channel} is {measure.value:.3g}, healthy {healthy}.",
            action=UNNAMED_ACTION,
        )


def _level(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    """A level far beyond what was learned, with or without a name for its cause."""
    excess = found.level_excess
    if excess is None:
        return
    times = excess.value / excess.median
    of = "the model's, as in the first windows," if excess.relative else "that of the first windows"
    lasting = f" in {excess.windows} windows in a row" if excess.windows > 1 else ""
    yield Finding(
        subject=f"level/{excess.sensor}",
        level="alarm" if excess.lasting else "watch",
        reason=f"The vibration level of {excess.sensor} is {times:.2g} times {of}{lasting} "
        f"(limit {excess.limit / excess.median:.2g}).",
        action=f"Inspect the machine soon, and check the mount of {excess.sensor}: its vibration has risen.",
        share=1 - min((excess.median / excess.value) ** 2, 1.0),
    )


EFFECT_RULES: tuple[Rule, ...] = (_effects, _level, _modulation, _new, _unknown)
