"""Histories that a wear rate may have had, as wear_forecast.py weighs them: which there are, and their priors.

A history is a form of the rate (none, a trend, a power of the revolutions, running-in, a step, or none with a shift of
the depths) with a wander g,
irregular wear u and a share s of the stated scatter; the symbols are those of wear_forecast.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twin.thresholds import deciding

DRAWN = "tuned on drawn wear histories of even seeds (benchmarks.reliability), of all classes"


@dataclass(frozen=True, slots=True, kw_only=True)
class RateHistories:
    """Histories of the wear rate that are weighed against each other, and their priors."""

    wanders: tuple[float, ...] = deciding(
        (0.0, 0.05, 0.1, 0.2, 0.4, 0.8),
        of="the wear rate, over the revolutions so far",
        meaning="standard deviations of its wander that are weighed; those above zero are equally probable at first",
        source="derivation: steps of a factor of two, from what a depth within 2 % resolves to a doubled rate",
    )
    steady: float = deciding(
        0.6,
        meaning="probability that the rate does not wander",
        source=DRAWN,
    )
    irregular: tuple[float, ...] = deciding(
        (0.0, 0.004, 0.012),
        of="the work so far",
        meaning="standard deviations of irregular wear, independent from one stretch to the next, that are weighed",
        source="not derived: from below what a depth resolves to the scatter stated from window to window",
    )
    running_in: tuple[float, ...] = deciding(
        (0.05, 0.12, 0.3, 0.7),
        of="the revolutions so far",
        meaning="lengths over which running-in decays by a factor e",
        source="derivation: between the first windows and the whole of what was seen, in even ratios",
    )
    running_in_size: float = deciding(
        1.0,
        of="the mean wear rate so far",
        meaning="standard deviation of what running-in adds to the rate of new flanks",
        source="not derived: running-in takes the rate down by half within thousands of revolutions",
    )
    running_in_prior: float = deciding(
        0.2,
        meaning="probability that a pair runs in so that it can be seen",
        source=DRAWN,
    )
    trend_sizes: tuple[float, ...] = deciding(
        (0.15, 0.5),
        of="the mean wear rate so far",
        meaning="standard deviations of a steady change of the rate over the revolutions so far, equally probable",
        source="not derived: a change that is just seen, and half as fast again",
    )
    trend_prior: float = deciding(
        0.2,
        meaning="probability that the rate has changed steadily",
        source=DRAWN,
    )
    trend_damping: float = deciding(
        1.0,
        of="the revolutions so far",
        meaning="revolutions ahead over which a trend fades by a factor e",
        source=DRAWN,
    )
    powers: tuple[float, ...] = deciding(
        (0.5, 2.0),
        meaning="exponents p of a change of the wear as N^p that goes on, equally probable",
        source="derivation: of wear as N^q, a constant rate next to one of these follows every q from 0.5 to 2",
    )
    power_size: float = deciding(
        0.7,
        of="the mean wear rate so far",
        meaning="standard deviation of the rate of such a change now",
        source="derivation: wear as N^0.5 has half of the mean rate now, and as N^2 twice the mean rate",
    )
    power_prior: float = deciding(
        0.1,
        meaning="probability that the wear changes as a power of the revolutions",
        source="not derived: one machine in ten",
    )
    step_size: float = deciding(
        0.7,
        of="the mean wear rate so far",
        meaning="standard deviation of a sudden change of the rate",
        source="not derived: a factor of two up or down, one standard deviation",
    )
    step_prior: float = deciding(
        0.1,
        meaning="probability that the rate has changed suddenly so far",
        source="not derived: one machine in ten",
    )
    shift_size: float = deciding(
        0.025,
        of="the work so far",
        meaning="standard deviation of a shift of all depths from a window on",
        source="not derived: what an effect below its detection limit does to a depth",
    )
    shift_prior: float = deciding(
        0.15,
        meaning="probability that all depths from some window on are shifted",
        source=DRAWN,
    )
    scatters: tuple[float, ...] = deciding(
        (0.25, 1.0),
        of="the stated scatter of a depth from window to window",
        meaning="shares of it that are weighed, equally probable at first",
        source="derivation: windows of constant speed and torque scatter by less than what is stated for all",
    )
    alike: float = deciding(
        3.5,
        of="ln of the work",
        meaning="distance over which depths by the encoders are off alike",
        source="as InspectionFaults.alike_fused",
    )
    most_points: int = deciding(
        16,
        unit="windows",
        meaning="windows that are weighed one by one; of more, older neighbours are merged",
        source="not derived: the time grows with the cube of it",
    )
    most_steps: int = deciding(
        8,
        unit="places",
        meaning="places of a sudden change that are weighed, between windows",
        source="not derived: the time grows with it",
    )


HISTORIES = RateHistories()


class Grid(NamedTuple):
    """One history a row, (h,) each, and what they are made of (k,): every choice of g, u and s."""

    form: np.ndarray
    choice: np.ndarray
    prior: np.ndarray
    wander: np.ndarray  # g (k,)
    irregular: np.ndarray  # u (k,)
    scatter: np.ndarray  # s (k,)


@lru_cache(maxsize=32)
def grid_of(steps: int, histories: RateHistories) -> Grid:
    """All histories; forms other than the plain one have every second g and u."""
    decays = len(histories.running_in)
    step, shift = (histories.step_prior, histories.shift_prior) if steps else (0.0, 0.0)
    trends, powers = len(histories.trend_sizes), len(histories.powers)
    plain = 1 - histories.running_in_prior - histories.trend_prior - histories.power_prior - step - shift
    forms = [plain, *[histories.trend_prior / trends] * trends, *[histories.power_prior / powers] * powers]
    forms += [histories.running_in_prior / decays] * decays
    forms += [step / steps] * steps + [shift / steps] * steps if steps else []
    g, u, s = (np.array(values) for values in (histories.wanders, histories.irregular, histories.scatters))
    choices = np.arange(g.size * u.size * s.size).reshape(g.size, u.size, s.size)
    share = np.full(choices.shape, (1 - histories.steady) / (g.size - 1))
    share[0] = histories.steady
    rows = []
    for form, prior in enumerate(forms):
        each = (slice(None, None, 2),) * 2 if form else ()
        weights = share[each].ravel()
        rows.append((np.full(weights.size, form), choices[each].ravel(), prior * weights / weights.sum()))
    of = (values.ravel() for values in np.meshgrid(g, u, s, indexing="ij"))
    return Grid(*(np.concatenate(column) for column in zip(*rows, strict=True)), *of)


class Forms(NamedTuple):
    """Changes of the rate that have a form, m of them."""

    windows: np.ndarray  # φ at the windows (m, n)
    now: np.ndarray  # φ now (m,)
    slope: np.ndarray  # φ' now (m,)
    size: np.ndarray  # standard deviation of c over the mean rate (m,)
    decay: np.ndarray  # N_r, infinite where there is none (m,)
    trend: np.ndarray  # φ″ of a trend, 0 where there is none (m,)
    power: np.ndarray  # p of a change as N^p, 1 where there is none (m,)
    shifted: np.ndarray  # 1 at the windows whose depths are shifted, else 0 (m, n)


def forms_of(N: np.ndarray, now: float, histories: RateHistories) -> Forms:
    """Forms over windows at revolutions N (n,) and now: those of a kind one after the other."""
    decays, trends = now * np.array(histories.running_in), len(histories.trend_sizes)
    powers = np.array(histories.powers)
    between = 0.5 * (N[1:] + N[:-1])
    steps = min(histories.most_steps, between.size)
    places = between[np.linspace(0, between.size - 1, steps).round().astype(int)] if steps else np.zeros(0)
    counts = np.append(N, now)
    none = np.zeros((1, counts.size))
    φ = np.concatenate(
        [
            none,
            np.repeat(counts[None] ** 2 / (2 * now), trends, axis=0),
            now / powers[:, None] * (counts / now) ** powers[:, None],
            -decays[:, None] * np.expm1(-counts / decays[:, None]),
            np.maximum(counts - places[:, None], 0.0),
            np.repeat(none, steps, axis=0),
        ]
    )

    kinds = [1, trends, powers.size, decays.size, steps, steps]  # forms of each
    of_trends, of_powers, of_running_in = (slice(sum(kinds[:i]), sum(kinds[: i + 1])) for i in (1, 2, 3))
    slope = np.repeat([0.0, 1.0, 1.0, 0.0, 1.0, 0.0], kinds)
    slope[of_running_in] = np.exp(-now / decays)
    size = np.repeat([0.0, 0.0, histories.power_size, histories.running_in_size, histories.step_size, 0.0], kinds)
    size[of_trends] = histories.trend_sizes
    decay, power = np.full(size.size, np.inf), np.ones(size.size)
    decay[of_running_in], power[of_powers] = decays, powers
    return Forms(
        windows=φ[:, :-1],
        now=φ[:, -1],
        slope=slope,
        size=size,
        decay=decay,
        trend=np.repeat([0.0, 1 / now, 0.0, 0.0, 0.0, 0.0], kinds),
        power=power,
        shifted=np.concatenate([np.zeros((len(φ) - steps, N.size)), places[:, None] < N]),
    )
