"""The compiled kernels of the twin, written in C (`source/`), called on numpy arrays.

They are compiled when the package is installed (`setup.py`) and loaded here. What they compute is stated where they are
used: twin/dynamics (balance, contact loss, integrator, stability), twin/wear (profiles) and twin/features (despike,
interpolation, noise floor).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from ctypes import POINTER, Structure, addressof, byref, c_char, c_double, c_int, c_int64, c_void_p
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twin.errors import ParameterError

LIBRARY = __file__.removesuffix("__init__.py") + "kernels.so"


def _load() -> ctypes.CDLL:
    try:
        library = ctypes.CDLL(LIBRARY)
    except OSError as error:
        raise ImportError(
            f"the compiled kernels of gear-twin cannot be loaded ({error}): install it again, by `make install`"
        ) from error
    doubles, count = c_void_p, c_int64
    library.newton.argtypes = [POINTER(_Balance), doubles, c_double, c_double, count, c_double, POINTER(_Progress),
                               POINTER(_Answer)]  # fmt: skip
    library.branch_solutions.argtypes = [POINTER(_Balance), doubles, c_double, *[doubles] * 4, POINTER(_Progress)]
    library.to_lines.argtypes = library.to_samples.argtypes = [count, doubles, doubles]
    library.carry_on.argtypes = [POINTER(_Balance), POINTER(_Balance), doubles, doubles, c_double, doubles,
                                 POINTER(_Progress), POINTER(_Answer)]  # fmt: skip
    library.quasi_static.argtypes = [count, count, doubles, doubles, doubles, c_double, doubles]
    library.share_load.argtypes = [count] * 4 + [doubles] * 6 + [c_double, doubles, doubles]
    library.integrate.argtypes = [POINTER(_Motion), count, count, *[doubles] * 6]
    library.monodromy.argtypes = [count, count, count, doubles, doubles, doubles, c_double, doubles]
    library.spline.argtypes = [count, count, c_double, c_double, doubles, count, doubles, doubles, doubles]
    library.middle.argtypes = library.at_extremes.argtypes = library.moments.argtypes = [count, doubles, doubles]
    library.all_near.argtypes = [count, doubles, c_double]
    for name in ("middle", "at_extremes", "moments", "all_near"):
        getattr(library, name).restype = c_int64
    library.averages.argtypes = [count, count, doubles, count, doubles, count, doubles]
    library.quintic_coefficients.argtypes = [count, doubles, doubles]
    library.quintic_at.argtypes = library.linear_at.argtypes = [count, doubles, count, doubles, doubles]
    library.quintic_coefficients_of_four.argtypes = [count, *[doubles] * 5]
    library.quintic_means_of_four.argtypes = [count, doubles, count, count, doubles, doubles]
    library.cubics_at.argtypes = [count, doubles, doubles, count, doubles, doubles, doubles]
    library.best_phases.argtypes = [count, count, doubles, doubles, count, *[doubles] * 3, c_double, c_double,
                                    doubles, doubles]  # fmt: skip
    library.noise_floor.argtypes = [count, doubles, doubles, count, count, doubles, *[c_double] * 4, count, doubles,
                                    doubles]  # fmt: skip
    for name in (
        "to_lines",
        "to_samples",
        "newton",
        "branch_solutions",
        "carry_on",
        "integrate",
        "monodromy",
        "spline",
        "noise_floor",
    ):
        getattr(library, name).restype = c_int
    for name in ("quasi_static", "share_load", "averages", "quintic_coefficients", "quintic_coefficients_of_four",
                 "quintic_at", "quintic_means_of_four", "linear_at", "cubics_at", "best_phases"):  # fmt: skip
        getattr(library, name).restype = None
    return library


class _Balance(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("contacts", "samples", "actions", "low")),
        *((name, c_void_p) for name in ("stiffness", "open_by", "side", "weights", "closing", "inverse", "ratios",
                                        "driven", "low_inverse")),
        ("mean_force", c_double), ("rounding", c_double),
    )  # fmt: skip


class _Progress(Structure):
    _fields_ = (*((name, c_int64) for name in ("iterations", "products", "stalled")), ("residual", c_double))


class _Answer(Structure):
    _fields_ = tuple(
        (name, c_void_p) for name in ("forces", "force_lines", "action_lines", "tangent", "action_tangents")
    )


class _Motion(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("modes", "contacts", "samples", "actions", "responses")),
        *((name, c_void_p) for name in ("omega2", "damping", "mesh", "load", "directions", "seen", "stiffness",
                                        "separation", "separation_rate", "side", "weights")),
        *((name, c_double) for name in ("damping_time", "first", "speed", "speed_rate", "step")),
    )  # fmt: skip


_kernels = _load()
_NOTHING = c_char * 0


def _given(values: np.ndarray, *shape: int | None) -> np.ndarray:
    """As the kernels read it, doubles in one block, of this shape; None stands for any length.

    The kernels do not look again: what is too short would be read beyond its end.
    """
    out = np.ascontiguousarray(values, dtype=float)
    if out.shape == shape:
        return out
    if len(out.shape) != len(shape) or any(n not in (have, None) for n, have in zip(shape, out.shape, strict=True)):
        raise ParameterError(f"an array of shape {out.shape} in place of {shape}")
    return out


def _at(values: np.ndarray) -> int:
    """Address of an array's first number."""
    if values.flags.writeable:
        return addressof(_NOTHING.from_buffer(values.data))
    return values.ctypes.data  # five times slower


def _checked(status: int) -> None:
    if status:
        raise MemoryError("no memory for the compiled kernels")


def split(lines: np.ndarray) -> np.ndarray:
    """Complex lines (…, m) as the kernels read them: real parts, then imaginary parts (…, 2m)."""
    return np.concatenate((lines.real, lines.imag), axis=-1)


def joined(lines: np.ndarray) -> np.ndarray:
    """The kernels' lines (…, 2m) as complex ones (…, m)."""
    m = lines.shape[-1] // 2
    return lines[..., :m] + 1j * lines[..., m:]


def to_lines(samples: np.ndarray) -> np.ndarray:
    """Two-sided Fourier coefficients k ≥ 0 of a record; (n,) → (n//2 + 1,) complex, n even."""
    if samples.size % 2 or not samples.size:
        raise ParameterError(f"a record of {samples.size} samples: an even number is needed")
    x, out = _given(samples, None), np.empty(samples.size + 2)
    _checked(_kernels.to_lines(x.size, _at(x), _at(out)))
    return joined(out)


def to_samples(lines: np.ndarray) -> np.ndarray:
    """The record of such coefficients; (m,) → (2m − 2,)."""
    given, out = split(lines), np.empty(2 * lines.size - 2)
    _checked(_kernels.to_samples(out.size, _at(given), _at(out)))
    return out


class Progress(NamedTuple):
    """What a solution has come to."""

    residual: float  # largest, of the mean force
    iterations: int
    products: int
    stalled: int  # last steps without progress


class Solution(NamedTuple):
    """What `CompiledBalance.newton` leaves at the motion that it reached."""

    progress: Progress
    deflection: np.ndarray  # (n,) [m]
    forces: np.ndarray  # of every contact (p, n) [N]
    force_lines: np.ndarray  # of the mesh force (m,) complex [N]
    action_lines: np.ndarray  # of every action (a, m) complex
    tangent: np.ndarray  # slope of the mesh force against d (n,) [N/m]
    action_tangents: np.ndarray  # of every action (a, n)


class _Room(NamedTuple):
    """Where the kernels leave the contacts of a motion."""

    arrays: tuple[np.ndarray, ...]  # as `_Answer` names them
    answer: _Answer
    actions: int

    @classmethod
    def of(cls, balance: CompiledBalance, tangents: int) -> _Room:
        """Room for the contacts of a balance, and for the slopes of so many actions."""
        n, actions = balance.samples, balance.actions
        arrays = (
            np.empty((balance.contacts, n)), np.empty(balance.lines), np.empty((actions, balance.lines)), np.empty(n),
            np.empty((tangents, n)),
        )  # fmt: skip
        return cls(arrays, _Answer(*map(_at, arrays)), actions)

    def solution(self, done: _Progress, deflection: np.ndarray) -> Solution:
        forces, force_lines, action_lines, tangent, action_tangents = self.arrays
        return Solution(
            progress=Progress(done.residual, done.iterations, done.products, done.stalled), deflection=deflection,
            forces=forces, force_lines=joined(force_lines), action_lines=joined(action_lines), tangent=tangent,
            action_tangents=action_tangents[: self.actions],
        )  # fmt: skip


class CompiledBalance:
    """The equations of one period, ready for the kernels; see twin/dynamics/harmonic_balance.py.

    stiffness, open_by  k_p and e_p + τ·e_p' of every contact (p, n)
    side                (p,) +1 or −1
    weights             of every action and contact (a, p, n)
    closing, inverse    lines of 1 + iωτ and of 1/G, as `split` gives them (2m,)
    ratios              G_c/G of every action, likewise (a, 2m)
    driven              lines of d under the loads alone, likewise (2m,)
    mean_force [N], rounding [m]
    """

    def __init__(
        self,
        stiffness: np.ndarray,
        open_by: np.ndarray,
        side: np.ndarray,
        weights: np.ndarray,
        closing: np.ndarray,
        inverse: np.ndarray,
        ratios: np.ndarray,
        driven: np.ndarray,
        mean_force: float,
        rounding: float,
    ) -> None:
        p, n = self.contacts, self.samples = stiffness.shape
        a, lines = self.actions, self.lines = len(ratios), n + 2
        self._kept = (
            _given(stiffness, p, n), _given(open_by, p, n), _given(side, p), _given(weights, a, p, n),
            _given(closing, lines), _given(inverse, lines), _given(ratios, a, lines), _given(driven, lines),
        )  # fmt: skip
        self._balance = _Balance(self.contacts, self.samples, self.actions, 0, *map(_at, self._kept), None,
                                 mean_force, rounding)  # fmt: skip

    def _with(self, low: np.ndarray | None) -> _Balance:
        """With the inverse of the low harmonics (2·low, 2·low) in single precision."""
        if low is not None:
            if low.dtype != np.float32 or low.shape != (len(low), len(low)) or len(low) > self.lines:
                raise ParameterError(f"low harmonics {low.dtype} {low.shape} of {self.samples} samples")
            low = np.ascontiguousarray(low)
        self._low = low
        self._balance.low = 0 if low is None else len(low) // 2
        self._balance.low_inverse = None if low is None else _at(low)
        return self._balance

    def newton(
        self,
        start: np.ndarray,
        low: np.ndarray | None,
        tolerance: float,
        *,
        most_steps: int,
        most_products: float,
        parted: float,
        stalled: int,
    ) -> Solution:
        """Newton's method from a deflection (n,).

        low      inverse of the low harmonics (2·low, 2·low), single precision
        parted   share of the mean slope below which the contacts part, so that no step is taken
        stalled  steps without progress before these
        """
        deflection = _given(start, self.samples).copy()
        room = _Room.of(self, self.actions)
        done = _Progress(0, 0, stalled, 0.0)
        _checked(_kernels.newton(byref(self._with(low)), _at(deflection), tolerance, parted, most_steps, most_products,
                                 byref(done), byref(room.answer)))  # fmt: skip
        return room.solution(done, deflection)

    def carry_on(
        self, other: CompiledBalance, d_hat: np.ndarray, left: np.ndarray, low: np.ndarray | None, tolerance: float
    ) -> Solution:
        """The motion with lines d_hat (m,), carried on to slightly other equations by the derivatives of these.

        left  residual of these equations at d_hat (m,), which the motion keeps under the others
        low   inverse of the low harmonics (2·low, 2·low), single precision
        The progress tells the residual of the others at the new motion; the lines of the force are those that their
        structure needs for it.
        """
        if other.samples != self.samples:
            raise ParameterError(f"{other.samples} samples a period: the motion has {self.samples}")
        d, rest = _given(split(d_hat), self.lines), _given(split(left), self.lines)
        deflection, room = np.empty(self.samples), _Room.of(other, max(self.actions, other.actions))
        done = _Progress()
        _checked(_kernels.carry_on(byref(self._with(low)), byref(other._with(None)), _at(d), _at(rest), tolerance,
                                   _at(deflection), byref(done), byref(room.answer)))  # fmt: skip
        return room.solution(done, deflection)

    def branch_solutions(
        self, d_hat: np.ndarray, low: np.ndarray | None, tolerance: float
    ) -> tuple[Progress, np.ndarray, np.ndarray]:
        """J⁻¹·(−R) and J⁻¹·(−∂R/∂ln rounding) at the lines of a motion (m,) complex, each to a relative tolerance."""
        lines = _given(split(d_hat), self.lines)
        step, slope = np.empty_like(lines), np.empty_like(lines)
        tangent, action_tangents = np.empty(self.samples), np.empty((self.actions, self.samples))
        done = _Progress()
        _checked(_kernels.branch_solutions(
            byref(self._with(low)), _at(lines), tolerance, _at(step), _at(slope), _at(tangent), _at(action_tangents),
            byref(done),
        ))  # fmt: skip
        return Progress(done.residual, done.iterations, done.products, done.stalled), joined(step), joined(slope)


def quasi_static(stiffness: np.ndarray, separation: np.ndarray, side: np.ndarray, mean_force: float) -> np.ndarray:
    """d (n,) at which the drive flanks (side > 0) of contacts (p, n) carry the mean force at every instant."""
    p, n = stiffness.shape
    k, e, σ, out = _given(stiffness, p, n), _given(separation, p, n), _given(side, p), np.empty(n)
    _kernels.quasi_static(p, n, _at(k), _at(e), _at(σ), mean_force, _at(out))
    return out


def integrate(
    modal: dict[str, np.ndarray],
    contacts: dict[str, np.ndarray],
    phase: dict[str, float],
    steps: int,
    keep: int,
    start: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, ...]:
    """Runge–Kutta of order 4 in modal coordinates; twin/dynamics/integrator.py says what it is for.

    modal     omega2, damping, mesh, load (m,), directions (a, m), seen (r, m)
    contacts  stiffness, separation, separation_rate (p, n), side (p,), weights (a, p, n)
    phase     damping_time, first, speed, speed_rate, step

    Returns displacement and acceleration (kept, r), deflection and mesh force (kept,), and where it ends (m,) each.
    """
    m, (p, n) = len(modal["omega2"]), contacts["stiffness"].shape
    actions, responses = len(modal["directions"]), len(modal["seen"])
    shapes = {
        "omega2": (m,), "damping": (m,), "mesh": (m,), "load": (m,), "directions": (actions, m),
        "seen": (responses, m), "stiffness": (p, n), "separation": (p, n), "separation_rate": (p, n), "side": (p,),
        "weights": (actions, p, n),
    }  # fmt: skip
    kept = {name: _given(values, *shapes[name]) for name, values in (modal | contacts).items()}
    x, v = _given(start[0], m).copy(), _given(start[1], m).copy()
    count = steps // keep + 1
    seen, accelerated = np.empty((count, responses)), np.empty((count, responses))
    d, force = np.empty(count), np.empty(count)
    motion = _Motion(modes=m, contacts=p, samples=n, actions=actions, responses=responses,
                     **{name: _at(values) for name, values in kept.items()}, **phase)  # fmt: skip
    _checked(_kernels.integrate(byref(motion), steps, keep, *map(_at, (x, v, seen, accelerated, d, force))))
    return seen, accelerated, d, force, x, v


def monodromy(modes: np.ndarray, directions: np.ndarray, impulses: np.ndarray, damping_time: float) -> np.ndarray:
    """Of exact steps of the modes (m, 2, 2), directions (f, m) and impulses (f, n) of forces; (2m, 2m)."""
    m, (forces, n) = len(modes), impulses.shape
    given = _given(modes, m, 2, 2), _given(directions, forces, m), _given(impulses, forces, n)
    out = np.empty((2 * m, 2 * m))
    _checked(_kernels.monodromy(m, n, forces, *map(_at, given), damping_time, _at(out)))
    return out


def spline(first: float, spacing: float, values: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cubic splines (not-a-knot) through evenly spaced points (curves, m), m ≥ 5: values and slopes (curves, k)."""
    y, x = _given(values, None, None), _given(at, None)
    if y.shape[1] < 5:
        raise ParameterError(f"a spline through {y.shape[1]} points: at least 5 are needed")
    out, slopes = np.empty((len(y), x.size)), np.empty((len(y), x.size))
    _checked(_kernels.spline(*y.shape, first, spacing, _at(y), x.size, _at(x), _at(out), _at(slopes)))
    return out, slopes


def averages(values: np.ndarray, weights: np.ndarray, stride: int) -> np.ndarray:
    """Averages around every `stride`-th of n values a row, by weights (2·reach + 1,); (r, n) → (r, n//stride + 1)."""
    x, w = _given(values, None, None), _given(weights, None)
    if w.size % 2 == 0:
        raise ParameterError(f"{w.size} weights have no middle: an odd number is needed")
    out = np.empty((len(x), x.shape[1] // stride + 1))
    _kernels.averages(*x.shape, _at(x), w.size // 2, _at(w), stride, _at(out))
    return out


def quintic_coefficients(values: np.ndarray) -> np.ndarray:
    """B-spline coefficients of degree 5 of values mirrored about the first and the last; (n,) → (n,)."""
    x = _given(values, None)
    out = np.empty(x.size)
    if x.size:
        _kernels.quintic_coefficients(x.size, _at(x), _at(out))
    return out


def quintic_coefficients_of_four(records: Sequence[np.ndarray]) -> np.ndarray:
    """B-spline coefficients of one to four records (n,) side by side; (n, 4), the last record's repeated."""
    given = [_given(values, records[0].size) for values in records]
    out = np.empty((records[0].size, 4))
    if not 0 < len(given) <= 4:
        raise ParameterError(f"{len(given)} records side by side: one to four are needed")
    if len(out):
        padded = given + given[-1:] * (4 - len(given))
        _kernels.quintic_coefficients_of_four(len(out), *map(_at, padded), _at(out))
    return out


def quintic_means_of_four(coefficients: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Means over the periods of four splines (n, 4) at positions counted in samples (periods, m); (4, m)."""
    c, x = _given(coefficients, None, 4), _given(at, None, None)
    if not c.size or not x.size:
        raise ParameterError(f"no mean of splines {c.shape} at positions {x.shape}")
    out = np.empty((x.shape[1], 4))
    _kernels.quintic_means_of_four(len(c), _at(c), *x.shape, _at(x), _at(out))
    return np.ascontiguousarray(out.T)


def _interpolated(kernel: Callable[..., None], values: np.ndarray, at: np.ndarray) -> np.ndarray:
    v, x = _given(values, None), _given(at, None)
    if not v.size:
        raise ParameterError("no values to interpolate between")
    out = np.empty(x.size)
    kernel(v.size, _at(v), x.size, _at(x), _at(out))
    return out


def quintic_at(coefficients: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The spline of coefficients (n,) at positions counted in samples (m,); NaN where a position is not finite."""
    return _interpolated(_kernels.quintic_at, coefficients, at)


def linear_at(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (n,) at positions counted in samples (m,), on straight lines; beyond the ends the outermost values."""
    return _interpolated(_kernels.linear_at, values, at)


def cubics_at(
    knots: np.ndarray, cubics: np.ndarray, at: np.ndarray, slopes: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes of piecewise cubics at each place; (m + 1,), (4, m), (k,) → (k,), (k,) or (0,).

    knots   not falling
    cubics  coefficients of (x − knot)³ … (x − knot)⁰ of every piece
    slopes  whether they are wanted
    """
    x, places = _given(knots, None), _given(at, None)
    if x.size < 2:
        raise ParameterError(f"{x.size} knots bound no piece")
    c, value, slope = _given(cubics, 4, x.size - 1), np.empty(places.size), np.empty(places.size if slopes else 0)
    _kernels.cubics_at(x.size - 1, _at(x), _at(c), places.size, _at(places), _at(value), _at(slope) if slopes else None)
    return value, slope


def noise_floor(
    power: np.ndarray,
    known: np.ndarray,
    block: int,
    *,
    least: int,
    bias: np.ndarray,
    first: tuple[float, float],
    clipped: float,
    correlation: float,
    passes: int,
) -> tuple[np.ndarray, float] | None:
    """Floor (n,) of a power (n,) and its degrees of freedom, of twin/features/noise_floor.py; None if lines fill all.

    known        (n,) bool, bins of lines
    block        bins over which the floor is taken for level, at most n, of which `least` must be no line's
    bias         of the median of 0 … block values (block + 1,)
    first        quantile of the first pass, and its bias
    clipped      probability at which a bin is taken for part of a line
    correlation  of neighbouring bins
    """
    p, lines, biases = _given(power, None), np.ascontiguousarray(known, dtype=bool), _given(bias, block + 1)
    if lines.shape != p.shape or not 0 < block <= p.size:
        raise ParameterError(f"a power of {p.size} bins, lines {lines.shape} and blocks of {block}")
    floor, freedom = np.empty(p.size), np.empty(1)
    status = _kernels.noise_floor(p.size, _at(p), _at(lines), block, least, _at(biases), *first, clipped, correlation,
                                  passes, _at(floor), _at(freedom))  # fmt: skip
    if status > 0:
        return None
    _checked(status)
    return floor, float(freedom[0])


def best_phases(products: np.ndarray, phases: np.ndarray, prior: float, spread: float) -> np.ndarray:
    """ψ that is lowest in −Σ_k Re(p_k·e^{−ikψ}) + ½·((ψ − prior)/spread)² (m,) [rad].

    products  p_k, k = 1 … h (m, h) complex
    phases    scanned first [rad] (n,)
    spread    infinite where nothing is known before
    """
    m, h = products.shape
    given = _given(products.real, m, h), _given(products.imag, m, h)
    cost, out = np.empty(2 * phases.size), np.empty(m)
    scanned = map(_at, _waves(h, phases.tobytes()))
    _kernels.best_phases(m, h, *map(_at, given), phases.size, *scanned, prior, spread, _at(cost), _at(out))
    return out


@lru_cache(maxsize=4)
def _waves(harmonics: int, phases: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The phases scanned (n,), and cosines and sines of their multiples (h, n) each."""
    ψ = np.frombuffer(phases).copy()
    orders = np.outer(np.arange(1, harmonics + 1), ψ)
    return ψ, np.cos(orders), np.sin(orders)
