"""An inspection: a depth that someone measured on the flanks, compared with the twin's own figure.

The twin's depth at the inspection's revolution count is interpolated linearly in revolutions over its
windows, median and band alike. Outside the windows it is extrapolated and says so: before the first
window along the line from new gears (no depth at no revolutions), after the last along the straight
line through the latest windows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot
from typing import Any

import numpy as np

from service.contract.base import not_available

TAIL = 5  # windows that set the slope beyond the last one
BAND_IN_STD = 2 * 1.6449  # width of a normal 5–95 % band in standard deviations
KEYS = ("median", "p05", "p95")


def compare(inspection: Mapping[str, Any], trend: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The twin's depth [µm] compared with the inspection's; `difference` is twin minus measured.

    inspection  `revolutions`, `max_depth_um`, `flank`, `std_um`
    trend       a point a window, with `revolutions` and `depth_um.{flank}.{median,p05,p95}`
    """
    n, measured, flank = inspection["revolutions"], inspection["max_depth_um"], inspection["flank"]
    revolutions, depths = _depths(trend, flank)
    if not revolutions.size:
        reason = f"the twin has no depth of the {flank} flank yet to compare with the inspection"
        return {"twin": not_available(reason)}
    extrapolated = not revolutions[0] <= n <= revolutions[-1]
    depth = {key: _at(n, revolutions, column) for key, column in zip(KEYS, depths.T, strict=True)}
    low, high = sorted((depth["p05"], depth["p95"]))
    difference = depth["median"] - measured
    std = hypot(inspection["std_um"], (high - low) / BAND_IN_STD)
    return {
        "twin": {
            "max_depth_um": {"median": depth["median"], "p05": low, "p95": high},
            "extrapolated": extrapolated,
            "from_revolutions": float(revolutions[0]),
            "to_revolutions": float(revolutions[-1]),
        },
        "difference_um": difference,
        "difference_percent": 100 * difference / measured if measured else None,
        "within_band": bool(low <= measured <= high),
        "difference_in_std": difference / std if std > 0 else None,
    }


def _depths(trend: Sequence[Mapping[str, Any]], flank: str) -> tuple[np.ndarray, np.ndarray]:
    """Revolutions (n,) rising and depth's median, p05, p95 (n, 3) [µm] of the windows that have them."""
    rows = []
    for point in trend:
        band = (point.get("depth_um") or {}).get(flank)
        if band and point.get("revolutions") is not None:
            median = band["median"]
            rows.append([point["revolutions"], *(median if band[k] is None else band[k] for k in KEYS)])
    if not rows:
        return np.empty(0), np.empty((0, 3))
    table = np.asarray(sorted(rows, key=lambda row: row[0]), dtype=float)
    return table[:, 0], table[:, 1:]


def _at(n: float, revolutions: np.ndarray, depth: np.ndarray) -> float:
    first, last = revolutions[0], revolutions[-1]
    if first <= n <= last:
        return float(np.interp(n, revolutions, depth))
    if n < first:
        return float(depth[0] * n / first)
    x, y = revolutions[-TAIL:], depth[-TAIL:]
    spread = float(np.sum((x - x.mean()) ** 2))
    if spread == 0:  # one window: the line from new gears
        slope = depth[-1] / last if last else 0.0
    else:
        slope = float(np.sum((x - x.mean()) * (y - y.mean()))) / spread
    return float(depth[-1] + max(slope, 0.0) * (n - last))
