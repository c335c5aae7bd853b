"""Exudyn: the 21-DOF model with its contacts, or without, by explicit Runge–Kutta steps of order 4 (RK44).

The coordinates are the modes of the model without its mesh, with sparse stiffness and damping, but for one, which is
the mesh deflection. The contacts are then one connector on one coordinate, whose force is a user function of a few
numbers; that is about seven times as fast as a function of all coordinates of the model. The function is written three
times: in Python, with its loop compiled by numba, and as a symbolic user function, which exudyn evaluates in C++ and
which holds the tables as a tree of conditions. The module is the one without range checks and with AVX2; nothing is
written to files; accelerations at the end of a step, which nobody reads, are not computed, and the constant mass matrix
is factorised once. `computeMassMatrixInversePerBody` is left off: with it the result is wrong.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

sys.exudynFast = True  # type: ignore[attr-defined]  # read when exudyn is imported

import exudyn as exu  # noqa: E402
import exudyn.itemInterface as items  # noqa: E402
import numpy as np  # noqa: E402
from exchange import Found, per_step, serve  # noqa: E402
from exudyn.advancedUtilities import CreateSymbolicUserFunction  # noqa: E402
from numba import njit  # noqa: E402

RIGID = 1e-9  # of the largest entry: below it a stiffness is rounding
APART = -1e-3  # openings beyond this never close [m]

esym = exu.symbolic


def reachable(problem: dict[str, Any]) -> list[list[tuple[float, float, float]]]:
    """Side, stiffness and opening of the contacts that can close at every sample of the tables."""
    side, stiffness, open_by = (problem[name] for name in ("side", "stiffness", "open_by"))
    return [
        [
            (float(s), float(k), float(e))
            for s, k, e in zip(side, stiffness[:, i], open_by[:, i], strict=True)
            if e > APART
        ]
        for i in range(problem["samples"])
    ]


def in_python(problem: dict[str, Any]) -> Callable[..., float]:
    rate, n, τ = problem["samples"] / problem["period"], problem["samples"], problem["damping_time"]
    table = reachable(problem)

    def force(mbs: Any, t: float, number: int, d: float, v: float, k: float, c: float, offset: float) -> float:
        x, total = d + τ * v, 0.0
        for side, stiffness, open_by in table[int(t * rate + 0.5) % n]:
            closed = side * x + open_by
            if closed > 0.0:
                total += side * stiffness * closed
        return total

    return force


def by_numba(problem: dict[str, Any]) -> Callable[..., float]:
    rate, n, τ = problem["samples"] / problem["period"], problem["samples"], problem["damping_time"]
    side, stiffness, open_by = problem["side"], problem["stiffness"].T.copy(), problem["open_by"].T.copy()

    @njit("float64(float64, float64, float64)", fastmath=True)
    def total(t: float, d: float, v: float) -> float:
        i, x, force = int(t * rate + 0.5) % n, d + τ * v, 0.0
        for p in range(side.size):
            closed = side[p] * x + open_by[i, p]
            if closed > 0.0:
                force += side[p] * stiffness[i, p] * closed
        return force

    def force(mbs: Any, t: float, number: int, d: float, v: float, k: float, c: float, offset: float) -> float:
        return total(t, d, v)

    return force


def symbolic(problem: dict[str, Any]) -> Callable[..., Any]:
    """The table as a tree of conditions, of which one branch is evaluated: an index must be a number, not a symbol."""
    rate, n, τ = problem["samples"] / problem["period"], problem["samples"], problem["damping_time"]
    table, zero = reachable(problem), esym.Real(0.0)

    def of_row(x: Any, side: float, stiffness: float, open_by: float) -> Any:
        return side * stiffness * esym.max(x + open_by if side > 0 else open_by - x, zero)

    def at(u: Any, x: Any, first: int, end: int) -> Any:
        if end - first == 1:
            forces = [of_row(x, *one) for one in table[first]]
            return sum(forces[1:], start=forces[0])
        middle = (first + end) // 2
        return esym.IfThenElse(u < float(middle), at(u, x, first, middle), at(u, x, middle, end))

    def force(mbs: Any, t: Any, number: Any, d: Any, v: Any, k: Any, c: Any, offset: Any) -> Any:
        return at(esym.mod(t * rate + 0.5, esym.Real(float(n))), d + v * τ, 0, n)

    return force


def coordinates(problem: dict[str, Any]) -> tuple[np.ndarray, int]:
    """T of q = T·p, and which coordinate of p is the mesh deflection: the others are modes of the model without mesh.

    The deflection takes the place of a rotation of a whole shaft, which has neither stiffness nor damping.
    """
    roots = np.sqrt(np.diag(problem["mass"]))
    squares, modes = np.linalg.eigh(problem["stiffness_matrix"] / np.outer(roots, roots))
    modes = modes / roots[:, None]
    along = problem["mesh"] @ modes
    i = int(np.argmax(np.where(squares < RIGID * squares.max(), np.abs(along), 0.0)))
    inverse = np.eye(len(modes))
    inverse[i] = along
    return modes @ np.linalg.inv(inverse), i


def sparse(matrix: np.ndarray) -> Any:
    """Without what is rounding alone."""
    kept = np.where(np.abs(matrix) > RIGID * np.abs(matrix).max(), matrix, 0.0)
    container = exu.MatrixContainer()
    container.SetWithDenseMatrix(kept, useDenseMatrix=False)
    return container


class Machine:
    """The model in exudyn; `force` is the user function of the contacts, None without them."""

    def __init__(self, problem: dict[str, Any], force: Callable[..., Any] | None, is_symbolic: bool = False):
        T, self.deflection = coordinates(problem)
        M, C, K = (T.T @ problem[name] @ T for name in ("mass", "damping", "stiffness_matrix"))
        self.step = 2 * problem["period"] / problem["samples"]
        self.container = exu.SystemContainer()
        self.mbs = mbs = self.container.AddSystem()
        n = len(M)
        node = mbs.AddNode(
            items.NodeGenericODE2(
                referenceCoordinates=[0.0] * n, initialCoordinates=np.linalg.solve(T, problem["start"]).tolist(),
                initialCoordinates_t=[0.0] * n, numberOfODE2Coordinates=n,
            )
        )  # fmt: skip
        mbs.AddObject(
            items.ObjectGenericODE2(
                nodeNumbers=[node],
                massMatrix=M,
                dampingMatrix=sparse(C),
                stiffnessMatrix=sparse(K),
                forceVector=T.T @ problem["load"],
            )
        )
        if force is not None:
            ground = mbs.AddNode(items.NodePointGround())
            markers = [
                mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=number, coordinate=coordinate))
                for number, coordinate in ((ground, 0), (node, self.deflection))
            ]
            if is_symbolic:
                force = self.kept = CreateSymbolicUserFunction(
                    mbs, force, "springForceUserFunction", itemTypeName="ObjectConnectorCoordinateSpringDamper"
                )
            mbs.AddObject(
                items.ObjectConnectorCoordinateSpringDamper(markerNumbers=markers, springForceUserFunction=force)
            )
        mbs.Assemble()

    def run(self, steps: int) -> float:
        """The deflection after so many steps [m]."""
        settings = exu.SimulationSettings()
        time = settings.timeIntegration
        time.numberOfSteps, time.endTime, time.verboseMode = steps, steps * self.step, 0
        time.reuseConstantMassMatrix = True
        time.explicit.computeEndOfStepAccelerations = False
        time.explicit.useLieGroupIntegration = False
        time.explicit.eliminateConstraints = False
        settings.solution.file.write = False
        settings.solution.sensors.active = False
        settings.parallel.numberOfThreads = 1
        self.mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.RK44, storeSolver=False)
        return float(self.mbs.systemData.GetODE2Coordinates()[self.deflection])


def transient(problem: dict[str, Any]) -> Found:
    machines = {
        "python": Machine(problem, in_python(problem)),
        "numba": Machine(problem, by_numba(problem)),
        "symbolic": Machine(problem, symbolic(problem), is_symbolic=True),
        "linear": Machine(problem, None),
    }
    short, long = problem["short"], problem["long"]
    times = {name: per_step(machine.run, short, long) for name, machine in machines.items()}
    return times, {name: machine.run(problem["checked"]) for name, machine in machines.items()}


if __name__ == "__main__":
    serve("exudyn", {"transient": transient})
