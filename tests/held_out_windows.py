"""Windows compared with a twin, made up: lines of one channel, measured and predicted."""

import numpy as np

from twin.tracing.held_out_error import ChannelComparison, HeldOutComparison

ORDERS = np.array([1.0, 2.0, 19.0, 38.0])
MESH = np.array([0.0, 0.0, 3.0, 2.0])
RIPPLE = np.array([0.0, 0.2j, 0.0, 0.0])
SILENT = ChannelComparison(**{name: np.zeros(0) for name in ("orders", "measured", "predicted", "std", "variance")})


def lines(predicted, measured, std=1e-3, scatter=0.08):
    """One channel; what a healthy machine scatters by is its noise and a share of every predicted line."""
    predicted, measured = (np.asarray(x, dtype=complex) for x in (predicted, measured))
    variance = 2 * std**2 + (scatter * np.abs(predicted)) ** 2 + (0.01 * np.abs(measured).max(initial=0.0)) ** 2
    return ChannelComparison(
        orders=ORDERS, measured=measured, predicted=predicted, std=np.full(ORDERS.size, std), variance=variance
    )


def window(predicted, measured, channel="torque", index=0, std=1e-3, scatter=0.08):
    """One window with the lines of one channel."""
    channels = {"acceleration": SILENT, channel: lines(predicted, measured, std, scatter)}
    return HeldOutComparison(index=index, speed_hz=10.0, channels=channels, rms_measured=1.0, rms_predicted=1.0)
