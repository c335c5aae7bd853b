"""The twin of each asset: that of the service, with the healthy baseline of this asset.

An asset's own baseline goes before that of the settings, and that of the settings holds for assets with its tooth
counts alone.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

from service.errors import InputError
from service.results.baseline_store import BaselineStore
from service.runtime.twin_port import Twin
from twin.errors import TwinError
from twin.rig import Rig

log = logging.getLogger(__name__)


class AssetTwins:
    """Twins by asset."""

    def __init__(self, twin: Twin, baselines: BaselineStore) -> None:
        self._twin, self._baselines = twin, baselines

    def of(self, asset: str, rig: Rig) -> Twin:
        """The twin of an asset."""
        options = self._twin.options
        if options is None:
            return self._twin
        baseline = self._own(asset) or _fitting(options.baseline, rig)
        return (
            self._twin
            if baseline is options.baseline
            else replace(self._twin, options=replace(options, baseline=baseline))
        )

    def _own(self, asset: str) -> Any:
        path = self._baselines.path(asset)
        if path is None:
            return None
        from service.files.baseline import read_baseline

        try:
            return read_baseline(path)
        except InputError as error:
            log.error("%s: its baseline cannot be used: %s", asset, error, extra={"asset": asset})
            return None


def _fitting(baseline: Any, rig: Rig) -> Any:
    """The baseline of the settings where it can be of this machine."""
    if baseline is None:
        return None
    try:
        return baseline if tuple(baseline.rig.teeth) == tuple(rig.teeth) else None
    except TwinError:  # tooth counts that are not known contradict nothing
        return baseline
