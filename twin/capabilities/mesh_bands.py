"""Levels of the mesh harmonics' bands, where the twin predicts nothing to compare them with."""

from __future__ import annotations

from twin.assessment import HarmonicBand, Residual, Unavailable
from twin.capabilities.context import Context, Draft


def applies(context: Context, draft: Draft) -> bool:
    """Where the bands were measured and no window has been compared with anything yet."""
    measured = context.features.mesh_bands is not None and context.mesh_frequency is not None
    return not draft.modelled and measured and isinstance(draft.assessment.residual, Unavailable)


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with the measured bands as its residual."""
    mesh, missing = context.mesh_frequency, draft.assessment.residual
    assert mesh is not None and isinstance(missing, Unavailable)
    bands = tuple(
        HarmonicBand(harmonic=k, frequency=k * mesh, measured=rms, predicted=None)
        for k, rms in enumerate(context.features.mesh_bands or (), 1)
    )
    return draft.with_parts(residual=Residual(bands=bands, reason=missing.reason))
