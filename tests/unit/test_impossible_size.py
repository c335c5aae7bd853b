"""An effect that a fit gives a size no machine has is not found: the vibration has another cause."""

from dataclasses import dataclass, replace

from twin.effects import EFFECTS
from twin.tracing.detectors import Detector
from twin.tracing.detectors.eccentricity import THRESHOLDS, EccentricityFit, is_proven
from twin.tracing.findings import Findings
from twin.tracing.settling import ask


@dataclass
class Context:
    findings: Findings

    def with_findings(self, findings):
        return replace(self, findings=findings)


@dataclass
class Scales:
    once_per_turn: tuple = (1e-6, 1e-6)
    base_pitch: float = 6e-3


def test_detector_that_fits_an_impossible_size_finds_nothing():
    def detect(context):
        return Findings(effects=(EFFECTS["pinion_eccentricity"](eccentricity=2 * THRESHOLDS.largest),))

    known = {}
    found = ask(Context(Findings()), Detector(name="eccentricity", detect=detect), known)
    assert found.findings.effects == () and "eccentricity" in known


def test_eccentricity_beyond_what_makes_sense_is_not_proven():
    fit = EccentricityFit(
        shaft=0, eccentricity=1e-4, high_point=0.0, std=1e-6, log_evidence=1e4, by_sidebands=1e4, run_out=1e-4,
        disagreement=0.0, shift_share=0.0, shift_share_std=0.1,
    )  # fmt: skip
    assert is_proven(fit, Scales(), False, THRESHOLDS)
    assert not is_proven(replace(fit, eccentricity=1.2e-3, run_out=1.2e-3), Scales(), False, THRESHOLDS)


def test_largest_eccentricity_is_the_bound_of_the_parameter():
    (bound,) = (p.high for p in EFFECTS["pinion_eccentricity"].parameters if p.name == "eccentricity")
    assert bound == THRESHOLDS.largest
