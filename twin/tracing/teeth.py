"""What differs from tooth to tooth: pitch errors, and a tooth that is softer than the others.

    X_m = R_m·Σ_k f_k·e^{−2πi·m·k/z}          lines of the transmission error at whole orders m of one gear's turn

f_k  displacement of tooth k along the line of action, or whatever tooth k does to the response      [m]
R_m  response to one tooth's unit displacement, by the harmonic balance

Pitch errors are there from the first window, constant and spread over the turn. A crack is local: what it changes lies
within two tooth pitches, at the passage of one tooth. Teeth that wear a little differently make lines that grow from
nothing with depth. The lowest orders belong to run-out and the encoder's graduation: they get that much scatter.
The response is not linear once errors reach what the load deflects (3 µm): after a linear start the fit goes on with
the whole response.

Source   twin/effects/pitch_error.py, tooth_crack.py; P. D. McFadden, Mech. Syst. Signal Process. 1 (1987) 173–183
Holds    both encoders; windows that resolve the orders (8 turns and more)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twin.effects import EFFECTS
from twin.effects.response import Effect, solve_with
from twin.features.teeth import SURROGATES, _shares
from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.tracing.scatter import MODELLED
from twin.wear.profile import WornProfile

LOWEST = (3, 4)  # orders of pinion and gear below which eccentricity and graduation stand
HIGHEST = (15, 41)
FLOOR = (0.12e-6, 0.22e-6)  # rms of a healthy machine's pattern in its first windows [m]
LOCAL_FLOOR = (0.12e-6, 0.1e-6)  # the same within two tooth pitches, where no healthy machine has its energy [m]
FIRST = 3  # windows that count as the first
NEAR = 2  # windows on either side of a change
GRADUATION = (0.6e-6, 1.6e-6)  # of the orders below, of pinion and gear [m]
NOISE, RELATIVE = 0.03e-6, 0.05  # of a line: [m], of its own size
PRIOR = 5e-6  # of a tooth's displacement [m]
UNIT = 0.3e-6  # displacement at which the linear response is taken [m]
LEAST_NOISE = 0.01e-6  # of a line's change [m]
SHAPE = 0.15  # of a change's line: what the response to a softer tooth may be off
STEPS = 3
JUMP = 0.08e-6  # rms of a change that a crack makes at least [m]
LOCAL = 0.6  # share of a pattern's energy within two tooth pitches, from the start
SUDDEN = 3.0  # times the changes before it
LOCAL_EVIDENCE = 12.0  # line changes over noise, squared, summed, halved
LOSSES = np.array([0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pattern:
    """Lines of one gear's own orders in one window, in the twin's angle."""

    revolutions: float
    orders: np.ndarray  # m (n,)
    lines: np.ndarray  # X_m complex (n,) [m]

    @property
    def rms(self) -> float:
        return float(np.sqrt(0.5 * np.sum(np.abs(self.lines) ** 2)))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ToothFinding:
    """Pitch errors or a crack."""

    effect: Effect
    onset: float  # revolutions
    log_evidence: float
    std: float  # of the teeth's displacement [m], or of the stiffness loss
    tooth_std: float = 0.0  # of the cracked tooth's number
    over_healthy: float = 0.0  # energy of pitch errors' lines beyond that of a healthy machine's, over it
    detail: str


def patterns(
    windows: Sequence[WindowFeatures], teeth: tuple[int, int], phase: float, gear: int, lowest: int | None = None
) -> list[Pattern]:
    """Lines of the pinion (0) or the gear (1) in every window, at the orders that all of them resolve."""
    low = LOWEST[gear] if lowest is None else lowest
    keys = [(0, m, 0) if gear == 0 else (0, 0, m) for m in range(low, HIGHEST[gear] + 1)]
    seen = [w for w in windows if w.transmission_error is not None and w.transmission_error.unit == "m"]
    keys = [k for k in keys if all(w.transmission_error.get(*k) is not None for w in seen)]  # type: ignore[union-attr]
    m = np.array([k[1 + gear] for k in keys], dtype=int)
    order = m * (1.0, teeth[0] / teeth[1])[gear]
    turn = np.exp(-1j * order * phase / teeth[0])
    out = []
    for w in seen:
        assert w.transmission_error is not None
        lines = np.array([w.transmission_error.at(*k) for k in keys], dtype=complex)
        out.append(Pattern(revolutions=w.revolutions or 0.0, orders=m, lines=lines * turn))
    return out if m.size >= 5 else []


def _impulse(model: Model, condition: Condition, profile: WornProfile, effects, effect: Effect, gear: int, m):
    """Change of the gear's lines that an effect makes (n,) [m]."""
    period = ("pinion", "gear")[gear]
    order = m * (1.0, model.mesh.pair.teeth[0] / model.mesh.pair.teeth[1])[gear]
    response = solve_with(model, (*effects, effect), profile, condition, period)
    response.steady.require_converged()
    return response.transmission_error(order)


def _shifted(z: int, m: np.ndarray, one: np.ndarray, next_one: np.ndarray) -> np.ndarray:
    """e^{∓2πi·m·k/z} for all teeth (n, z), in the sense in which the passages count them."""
    forward = np.exp(-2j * np.pi * m / z)
    against = np.abs(next_one - one * forward.conj()).sum() < np.abs(next_one - one * forward).sum()
    base = forward.conj() if against else forward
    return base[:, None] ** np.arange(z)[None, :]


def _one_tooth(z: int, tooth: int, value: float) -> tuple[float, ...]:
    return tuple(value if k == tooth else 0.0 for k in range(z))


def find_pitch_errors(
    model: Model,
    windows: Sequence[WindowFeatures],
    condition: Condition,
    profile: WornProfile,
    phase: float,
    effects: Sequence[Effect] = (),
) -> ToothFinding | None:
    """Pitch errors of both gears from the first windows; None where a healthy machine's lines explain them.

    windows  measurement windows, the first first; only the first few are used
    effects  of the mesh's period, that are in the twin already
    """
    first = list(windows)[:FIRST]
    teeth = model.mesh.pair.teeth
    strength, counts, measured = [], [], []
    for gear in (0, 1):
        seen = patterns(first, teeth, phase, gear)
        lines = np.mean([p.lines for p in seen], axis=0) if seen else np.zeros(0)
        strength.append(float(np.sqrt(0.5 * np.sum(np.abs(lines) ** 2))) / FLOOR[gear])
        counts.append(lines.size)
        measured.append(_with_low_orders(first, teeth, phase, gear))
    if max(strength) < 1.0:
        return None
    present = [gear for gear in (0, 1) if strength[gear] > 1.0 and measured[gear] is not None]
    names = ("pinion", "gear")
    values: dict[str, np.ndarray] = {names[gear]: np.zeros(teeth[gear]) for gear in present}
    solvers = {}
    for gear in present:
        pattern = measured[gear]
        assert pattern is not None
        m, z = pattern.orders, teeth[gear]
        unit = [EFFECTS["pitch_error"](**{names[gear]: _one_tooth(z, k, UNIT)}) for k in (0, 1)]
        one, following = (_impulse(model, condition, profile, effects, e, gear, m) for e in unit)
        A = (one / UNIT)[:, None] * _shifted(z, m, one, following)
        low = m < LOWEST[gear]
        std = np.hypot(NOISE, RELATIVE * np.abs(pattern.lines)) + np.where(low, GRADUATION[gear], 0.0)
        B = np.concatenate((A.real / std[:, None], A.imag / std[:, None], np.eye(z) / PRIOR))
        solvers[gear] = (B, std, m)
    rest = {gear: measured[gear].lines for gear in present}  # type: ignore[union-attr]
    for step in range(STEPS):
        for gear in present:
            B, std, _ = solvers[gear]
            z = teeth[gear]
            r = rest[gear] / std
            right = np.concatenate((r.real, r.imag, -values[names[gear]] / PRIOR))
            correction = np.linalg.lstsq(B, right, rcond=None)[0]
            values[names[gear]] = values[names[gear]] + correction - correction.mean()
        if step == STEPS - 1:
            break
        whole = EFFECTS["pitch_error"](**{n: tuple(v.tolist()) for n, v in values.items()})
        response = solve_with(model, (*effects, whole), profile, condition)
        if not response.steady.converged:
            break
        for gear in present:
            m = solvers[gear][2]
            order = m * (1.0, teeth[0] / teeth[1])[gear]
            rest[gear] = measured[gear].lines - response.transmission_error(order)  # type: ignore[union-attr]
    B, _, _ = solvers[present[0]]
    std_of = float(np.sqrt(np.mean(np.diag(np.linalg.inv(B.T @ B)))))
    # every line a circular Gaussian, of a healthy machine's variance or of its own
    evidence = sum(n * (s**2 - 1 - 2 * np.log(s)) for s, n in zip(strength, counts, strict=True) if s > 1)
    sizes = ", ".join(f"{n} {1e6 * float(np.std(v)):.2g} µm rms" for n, v in values.items())
    return ToothFinding(
        effect=EFFECTS["pitch_error"](**{n: tuple(v.tolist()) for n, v in values.items()}),
        onset=0.0,
        log_evidence=float(evidence),
        std=std_of,
        detail=sizes,
        over_healthy=float(sum(s**2 - 1 for s in strength if s > 1)),
    )


def _with_low_orders(windows, teeth, phase: float, gear: int) -> Pattern | None:
    """The mean pattern of the first windows from order 1 on."""
    seen = patterns(windows, teeth, phase, gear, lowest=1)
    if not seen:
        return None
    return Pattern(
        revolutions=seen[0].revolutions, orders=seen[0].orders, lines=np.mean([p.lines for p in seen], axis=0)
    )


def local_share(change: np.ndarray, m: np.ndarray, z: int) -> tuple[float, float]:
    """Share of a change's energy within two tooth pitches, and what one spread over the turn reaches in a hundred."""
    _, _, (share,) = _shares(change[None, :], m, z)
    rng = np.random.default_rng(z)
    turned = np.abs(change) * np.exp(2j * np.pi * rng.random((SURROGATES, change.size)))
    return float(share), float(np.quantile(_shares(turned, m, z)[2], 0.99))


def find_crack(
    model: Model,
    windows: Sequence[WindowFeatures],
    conditions: Sequence[Condition],
    profiles: Sequence[WornProfile],
    phase: float,
    effects: Sequence[Effect] = (),
) -> ToothFinding | None:
    """A tooth that has become softer, or was from the start; None where no local change stands out."""
    teeth = model.mesh.pair.teeth
    best: ToothFinding | None = None
    for gear in (0, 1):
        seen = patterns(windows, teeth, phase, gear)
        if len(seen) < 2:
            continue
        found = _local_onset(seen, teeth[gear], gear)
        if found is None:
            continue
        at, change, noise = found
        with_crack = range(at, len(windows))
        i = with_crack[min(1, len(with_crack) - 1)]
        finding = _fitted_crack(model, conditions[i], profiles[i], effects, gear, seen[0].orders, change, noise)
        if finding is None:
            continue
        effect, evidence, std, tooth_std = finding
        onset = 0.0 if at == 0 else 0.5 * (seen[at - 1].revolutions + seen[at].revolutions)
        if best is None or evidence > best.log_evidence:
            best = ToothFinding(
                effect=effect,
                onset=onset,
                log_evidence=evidence,
                std=std,
                tooth_std=tooth_std,
                detail="a single displaced tooth would look alike" if at == 0 else "",
            )
    return best


def _local_onset(seen: Sequence[Pattern], z: int, gear: int) -> tuple[int, np.ndarray, float] | None:
    """First window with a local pattern, the change that came with it (n,) and the noise of a line of it [m].

    The noise is what a line changes by from window to window otherwise, wear included.
    """
    m = seen[0].orders
    X = np.array([p.lines for p in seen])
    steps = np.array([np.sqrt(0.5 * np.sum(np.abs(b - a) ** 2)) for a, b in pairwise(X)])
    noise = max(float(np.median(steps)) * np.sqrt(2 / m.size), LEAST_NOISE)
    candidates = []
    for at in range(1, len(seen)):
        change = X[at : at + NEAR].mean(axis=0) - X[max(at - NEAR, 0) : at].mean(axis=0)  # before wear adds its own
        rms = float(np.sqrt(0.5 * np.sum(np.abs(change) ** 2)))
        quiet = float(np.median(np.delete(steps, at - 1))) if steps.size > 1 else 0.0
        share, spread = local_share(X[at] - X[at - 1], m, z)
        if rms > JUMP and steps[at - 1] > SUDDEN * max(quiet, 0.01e-6) and share > spread:
            candidates.append((steps[at - 1], at, change))
    latest = max(candidates, key=lambda c: c[0]) if candidates else None
    start = X[: FIRST if latest is None else min(latest[1], FIRST)].mean(axis=0)
    share, spread = local_share(start, m, z)
    # what was local before a change was there from the start: wear alone makes it change once more
    if float(np.sqrt(0.5 * np.sum(np.abs(start) ** 2))) > LOCAL_FLOOR[gear] and share > spread and share > LOCAL:
        return 0, X[:FIRST].mean(axis=0), max(noise, LOCAL_FLOOR[gear] * np.sqrt(2 / m.size))
    return None if latest is None else (latest[1], latest[2], noise)


def _fitted_crack(
    model, condition, profile, effects, gear: int, m, change, noise: float
) -> tuple[Effect, float, float, float] | None:
    """The softer tooth whose response meets a change best, its evidence, the std of the loss and of its number."""
    z = model.mesh.pair.teeth[gear]
    on = ("pinion", "gear")[gear]
    kind = EFFECTS["tooth_crack"]
    order = m * (1.0, model.mesh.pair.teeth[0] / model.mesh.pair.teeth[1])[gear]
    σ2 = noise**2 + (SHAPE * np.abs(change)) ** 2
    turned = None
    tried, by_tooth = [], {}
    for loss in LOSSES:
        response = solve_with(model, (*effects, kind(stiffness_loss=float(loss), tooth=0, on=on)), profile, condition)
        if not response.steady.converged:
            continue
        one = response.transmission_error(order)
        if turned is None:
            two = solve_with(model, (*effects, kind(stiffness_loss=float(loss), tooth=1, on=on)), profile, condition)
            turned = _shifted(z, m, one, two.transmission_error(order))
        misfit = (np.abs(change[:, None] - one[:, None] * turned) ** 2 / σ2[:, None]).sum(axis=0)
        tooth = int(np.argmin(misfit))
        tried.append((float(misfit[tooth]), float(loss), tooth))
        by_tooth[float(loss)] = misfit
    if not tried:
        return None
    none = float((np.abs(change) ** 2 / σ2).sum())
    tried.sort()
    misfit, loss, tooth = tried[0]
    std = float(LOSSES[1] - LOSSES[0])  # where no parabola tells
    if len(tried) > 2:  # a parabola through the best and its neighbours
        near = sorted((q, c) for c, q, k in tried if k == tooth and abs(q - loss) < 0.11)
        if len(near) == 3:
            a, b, _ = np.polyfit([q for q, _ in near], [c for _, c in near], 2)
            if a > 0:
                loss = float(np.clip(-b / (2 * a), near[0][0], near[-1][0]))
                std = float(np.sqrt(max(misfit / m.size, 1.0) / (2 * a)))
    evidence = 0.5 * (none - misfit)
    if evidence < LOCAL_EVIDENCE or misfit > 0.6 * none:
        return None
    likely = np.exp((misfit - by_tooth[tried[0][1]]) / max(misfit / m.size, 1.0))
    away = (np.arange(z) - tooth + z // 2) % z - z // 2
    tooth_std = float(np.sqrt(likely @ away**2 / likely.sum()))
    effect = kind(stiffness_loss=loss, tooth=tooth, on=on)
    return effect, float(evidence), float(np.hypot(std, MODELLED * loss)), tooth_std
