"""Calibrated values after a window, with their uncertainty and what they rest on."""

from __future__ import annotations

from dataclasses import asdict

from twin.assessment import CalibrationAssessment, Unavailable
from twin.errors import NotAvailable
from twin.model import Calibration
from twin.rig import Rig
from twin.updating.calibration import outliers
from twin.updating.memory import Memory


def calibration_of(rig: Rig, memory: Memory) -> CalibrationAssessment | Unavailable:
    """The calibration in use: of the rig file until unworn windows have been seen."""
    fit = memory.fit
    if fit is None:
        try:
            prior = Calibration.prior(rig)
        except NotAvailable as missing:
            return Unavailable(reason=str(missing))
        return CalibrationAssessment(source="rig file", values=asdict(prior), mesh_stiffness=rig.mesh_stiffness_source)
    return CalibrationAssessment(
        source="windows",
        values=asdict(fit.calibration),
        std=dict(fit.std),
        windows=fit.windows,
        misfit=fit.misfit,
        doubts=tuple(outliers(rig, fit)),
        compliance_scale=memory.compliance_scale,
        mesh_phase=memory.phase,
        path_lines_learned=len(memory.path),
        mesh_stiffness=rig.mesh_stiffness_source,
    )
