"""Findings of all detectors, brought into agreement: the order in which they were asked does not decide the result.

A detector's answer rests on what others have found: sidebands of an eccentricity are judged otherwise where teeth
differ, the mesh is fitted with what the teeth make of its lines, a ripple may be made by pitch errors. A detector that
was asked before these findings were there is asked again, without its own, in the order of `DETECTORS`, until every
answer rests on the findings that are reported. In that order itself only the mesh is
asked twice, where the accelerometer is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from twin.effects import EFFECTS
from twin.errors import ImpossibleSize
from twin.tracing.context import TracingContext
from twin.tracing.detectors import DETECTORS, Detector
from twin.tracing.findings import Findings

MOST_ROUNDS = 3  # of asking again

Known = dict[str, frozenset[str]]  # by detector: what it knew of the findings that its answer rests on


def ask(context: TracingContext, detector: Detector, known: Known) -> TracingContext:
    """The context with the findings of one detector; `known` notes what its answer rests on.

    A detector whose fit gives an effect a size that no machine has, finds none: the vibration has another cause.
    """
    before = context.with_findings(without_own(context.findings, detector))
    try:
        findings = detector.detect(before)
    except ImpossibleSize:
        findings = before.findings
    weak = [e for e in findings.effects if not context.required.accepts(e.name, e.log_evidence)]
    for effect in weak:
        if effect.name not in context.fixed:
            findings = findings.without(effect.name)
    known[detector.name] = consulted(without_own(findings, detector), detector)  # it may have ruled some out itself
    for step in DETECTORS:  # what it had made better of this detector's findings has gone with them
        if step.refines == detector.reports:
            known.pop(step.name, None)
    return context.with_findings(findings)


def settled(context: TracingContext, known: Known, detectors: Sequence[Detector] = DETECTORS) -> TracingContext:
    """The context once every answer rests on the findings that are reported.

    known      of each detector that has been asked; those that have not are left alone
    detectors  in the order in which they are asked again
    """
    if context.findings.teeth_separate:  # no steady mesh: whatever else was found rests on nothing
        effects = tuple(e for e in context.findings.effects if EFFECTS[e.name].facts.separates_teeth)
        rest = Findings(effects=effects, teeth_separate=True, accelerometer_fault=context.findings.accelerometer_fault)
        return context.with_findings(rest)
    rank = {d.name: i for i, d in enumerate(DETECTORS)}
    asked = set(known)
    for _ in range(MOST_ROUNDS):
        stale = [
            d
            for d in sorted(detectors, key=lambda d: rank.get(d.name, len(rank)))
            if d.name in asked and known.get(d.name) != consulted(without_own(context.findings, d), d)
        ]
        if not stale:
            break
        context = ask(context, stale[0], known)
        for detector in stale[1:]:
            if known.get(detector.name) != consulted(without_own(context.findings, detector), detector):
                context = ask(context, detector, known)
    return context.with_findings(_in_order(context.findings))


def consulted(findings: Findings, detector: Detector) -> frozenset[str]:
    """What there is of the findings that a detector's answer rests on: names of effects, and of suspected forces."""
    suspected = {f.name for f in findings.forces if _by(f.name) in detector.consults}
    effects = {
        f"{e.name} from {e.addition.onset_revolutions:g}"
        for e in findings.effects
        if _by(e.name) in detector.consults and e.name not in suspected  # confirming a suspicion changes nothing
    }
    return frozenset(effects | {f"suspected {name}" for name in suspected})


def without_own(findings: Findings, detector: Detector) -> Findings:
    """The findings without the effects that a detector reports."""
    return replace(findings, effects=tuple(e for e in findings.effects if _by(e.name) != detector.reports))


def _in_order(findings: Findings) -> Findings:
    """Effects in the order of the detectors that report them."""
    rank = {d.reports: i for i, d in enumerate(DETECTORS)}
    return replace(findings, effects=tuple(sorted(findings.effects, key=lambda e: rank.get(_by(e.name), 0))))


def _by(name: str) -> str:
    return str(EFFECTS[name].facts.detector)
