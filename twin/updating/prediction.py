"""The response that the twin expects of a window at a depth.

The steady state is solved once at the window's own speed and torque, at the expected depth; other depths follow the
master curve, line by line, scaled by what the difference in condition did to each line.

    Y_k = H_k·ρ(f_k)·t(f_k)·m_k,      RMS² = ½·Σ_k |Y_k|² + noise²      over the mesh harmonics in the band

m_k   the twin's line of transmission error             [m]
t     measured over predicted transmission error, learned
H_k   the twin's path from transmission error to the accelerometer, 21 degrees of freedom  [m/s² per m]
ρ     measured over predicted path, learned
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.effects.extended import window_lines
from twin.errors import NotConverged
from twin.model import Condition, Model
from twin.thresholds import deciding
from twin.updating.depth import HARMONICS, Response
from twin.updating.frequency_correction import FrequencyCorrection
from twin.updating.memory import Memory
from twin.wear.curve import LINES, MasterCurve, MeshLines


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedFactors:
    """Priors of the factors of path and mesh."""

    path_spread: float = deciding(
        0.5,
        of="the twin's path from mesh to accelerometer",
        meaning="standard deviation of a factor's real and imaginary part before anything is learned",
        source="not derived: machines with a casing (D10, D11) are 80–95 % off line by line",
    )
    mesh_spread: float = deciding(
        0.15,
        of="the twin's line of transmission error",
        meaning="standard deviation of a factor's real and imaginary part before anything is learned",
        source="not derived: machines with a casing (D10, D11) are 3–8 % off line by line",
    )
    reach: float = deciding(
        0.03,
        of="frequency",
        meaning="relative frequency over which a factor is alike",
        source="not derived: of the order of the width of a resonance",
    )
    memory: float = deciding(
        12.0,
        unit="windows",
        meaning="windows after which what was learned counts by 1/e less",
        source="not derived: what was learned a dozen windows ago counts little",
    )


FACTORS = LearnedFactors()
PATH = FrequencyCorrection(spread=FACTORS.path_spread, reach=FACTORS.reach, memory=FACTORS.memory)
MESH = FrequencyCorrection(spread=FACTORS.mesh_spread, reach=FACTORS.reach, memory=FACTORS.memory)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Expectation:
    """The twin's lines over depth at one window's condition."""

    curve: MasterCurve
    condition: Condition
    solved: bool  # whether the steady state at the window's own condition was found
    contact_loss: float  # share of the mesh without contact, at the expected depth
    ratio: MeshLines  # own condition over the curve's; `mean` is a difference [m]
    beyond: np.ndarray  # acceleration lines above the LINES-th, at the expected depth [m/s²]
    unworn: MeshLines | None = None  # lines of new flanks at this condition, where effects make them another curve's

    @classmethod
    def at(
        cls, model: Model, curve: MasterCurve, condition: Condition, depth: float, new: Model | None = None
    ) -> Expectation:
        """Solves the steady state of the curve's profile at a depth [m] under a condition.

        new  the model of the time when the flanks were new, with the effects of then; None where it had none
        """
        depth = max(depth, curve.start_depth)
        beyond, loss, solved = np.empty(0, dtype=complex), float("nan"), True
        try:
            found = window_lines(model, curve.profile(depth), condition)
        except NotConverged:
            solved = False
        else:
            beyond, loss = found.beyond, found.contact_loss
            own, base = found.lines, curve.lines_at(depth)
            ratio = MeshLines(
                transmission_error=own.transmission_error / base.transmission_error,
                mean=own.mean - base.mean,
                pinion_motion=own.pinion_motion / base.pinion_motion,
                acceleration=own.acceleration / base.acceleration,
            )
        if not solved:
            one = np.ones(LINES, dtype=complex)
            shift = model.compliance_outside_mesh * (condition.torque - curve.condition.torque)
            ratio = MeshLines(transmission_error=one, mean=shift, pinion_motion=one, acceleration=one)
        return cls(
            curve=curve,
            condition=condition,
            solved=solved,
            contact_loss=loss,
            ratio=ratio,
            beyond=beyond,
            unworn=None if new is None else window_lines(new, new.unworn, condition).lines,
        )

    def rms(self, lines: np.ndarray, teeth: int, band: tuple[float, float], noise: float) -> float:
        """RMS [m/s²] in a band [Hz] of acceleration lines (LINES,), with those beyond them and a noise floor."""
        every = np.concatenate((lines, self.beyond))
        frequencies = np.arange(1, every.size + 1) * teeth * self.condition.speed_hz
        return band_rms(every, frequencies, band, noise)

    def lines(self, depth: float) -> MeshLines:
        """Lines at a depth [m]."""
        base, ratio = self.curve.lines_at(depth), self.ratio
        return MeshLines(
            transmission_error=base.transmission_error * ratio.transmission_error,
            mean=base.mean + ratio.mean,
            pinion_motion=base.pinion_motion * ratio.pinion_motion,
            acceleration=base.acceleration * ratio.acceleration,
        )

    def response(self, pinion_only: bool, from_unworn: bool) -> Response:
        """What gives, at depths (m,) [m], the lines that the encoders see, or what wear changed of them (m, HARMONICS),
        and the mean (m,) [m]."""
        quantity = "pinion_motion" if pinion_only else "transmission_error"
        scale, offset = getattr(self.ratio, quantity)[:HARMONICS], self.ratio.mean
        new: np.ndarray | None = None
        if from_unworn and self.unworn is None:
            new = self.curve.over(np.zeros(1), quantity, most=HARMONICS)[0][0] * scale
        elif from_unworn:
            new = getattr(self.unworn, quantity)[:HARMONICS]

        def at(depths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            lines, mean = self.curve.over(depths, quantity, "mean", most=HARMONICS)
            lines = lines * scale
            return lines if new is None else lines - new, mean + offset

        return at


def parts(predicted: np.ndarray, unworn: np.ndarray) -> np.ndarray:
    """√(|m₀|² + |m − m₀|²) of lines predicted, m, and of unworn flanks, m₀; complex (n,) each, in one unit."""
    return np.hypot(np.abs(unworn), np.abs(predicted - unworn))


def band_rms(lines: np.ndarray, frequencies: np.ndarray, band: tuple[float, float], noise: float) -> float:
    """RMS [m/s²] of complex lines within a band [Hz], with a noise floor added; all (n,)."""
    inside = (frequencies >= band[0]) & (frequencies <= band[1])
    return float(np.sqrt(0.5 * np.sum(np.abs(lines[inside]) ** 2) + noise**2))


def line_frequencies(teeth: int, speed_hz: float) -> np.ndarray:
    """Frequencies of mesh harmonics 1 … LINES [Hz]."""
    return np.arange(1, LINES + 1) * teeth * speed_hz


def predicted_lines(
    memory: Memory, expectation: Expectation, depth: float, index: int, teeth: int
) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration lines [m/s²] at a depth [m] with what was learned of path and mesh, and their frequencies [Hz]."""
    f = line_frequencies(teeth, expectation.condition.speed_hz)
    path, mesh = PATH.predict(memory.path, f, index), MESH.predict(memory.mesh, f, index)
    return expectation.lines(depth).acceleration * path * mesh, f
