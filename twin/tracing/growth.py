"""How the size of an effect has gone on, as it is reported: law, rate, size at the latest window, second change.

    rate = (p(n) − p_none)/(n − n_0)         of the parameter p that gives the size, mean since the onset n_0

Source   the laws: twin/effects/size_law.py
"""

from __future__ import annotations

import numpy as np

from twin.assessment import Growth, ParameterValue
from twin.effects.size_law import size_parameters
from twin.tracing.attribution import AttributedEffect

NAMES = {"linear": "linear", "stepped": "second_change"}  # of laws, as results report them


def growth_of(item: AttributedEffect, revolutions: float) -> Growth | None:
    """How an effect's size has gone on until so many revolutions of the pinion; None where it is constant."""
    addition = item.addition
    law = NAMES.get(addition.law.kind)
    if law is None:
        return None
    parameter = size_parameters(addition.effect)[0]
    whole, unit, std = item.parameters[parameter.name]
    now = addition.at(revolutions)
    value = parameter.neutral if now is None else float(getattr(now, parameter.name))
    full = whole - parameter.neutral
    share = abs((value - parameter.neutral) / full) if full else 0.0
    rate, change, factor, factor_std = None, None, None, None
    size_std = std * share
    if law == "linear":
        turned = max(revolutions - addition.onset_revolutions, 1.0)
        mean = (value - parameter.neutral) / turned
        spread = float(np.hypot(size_std / turned, mean * (item.onset_std or 0.0) / turned))
        rate = ParameterValue(value=mean, unit=f"{unit}/rev" if unit else "1/rev", std=spread)
    else:
        factor = addition.law.factors[-1]
        change_std, factor_std = item.change_std or (0.0, 0.0)
        change = ParameterValue(value=addition.law.revolutions[-1], unit="rev", std=change_std)
        size_std = float(np.hypot(size_std, full * factor_std))
    return Growth(
        law=law,
        parameter=parameter.name,
        size=ParameterValue(value=value, unit=unit, std=size_std),
        rate=rate,
        second_change=change,
        factor=None if factor is None else ParameterValue(value=factor, unit="", std=factor_std or 0.0),
    )
