"""The reference rig's model in the states that the tests of dynamics and wear look at."""

from functools import lru_cache

import numpy as np

from tests.mesh_pairs import UNSW_RIG
from twin.dynamics.contact_loss import solve_through_contact_loss
from twin.dynamics.harmonic_balance import Contacts, SteadyState
from twin.dynamics.integrator import Motion
from twin.dynamics.structure import direction
from twin.model import Calibration, Condition, Model
from twin.rig import Rig
from twin.wear.evolution import WearPoint, evolve
from twin.wear.profile import WornProfile

RIG = Rig.from_mapping(UNSW_RIG)
PRIOR = Calibration.prior(RIG)
TEN = Condition(speed_hz=10.0, torque=10.0)
FOURTEEN = Condition(speed_hz=14.0, torque=9.0)


@lru_cache(maxsize=8)
def model(samples: int = 1024) -> Model:
    return Model.of(RIG, PRIOR, samples=samples)


@lru_cache(maxsize=8)
def wear_path(condition: Condition, until_depth: float) -> tuple[WearPoint, ...]:
    """From new to worn at one condition with the rig file's calibration."""
    twin = model()
    return tuple(
        evolve(
            twin.mesh,
            lambda profile, near: twin.steady(profile, condition, near),
            twin.unworn,
            PRIOR.contact_half_width,
            until_depth,
        )
    )


def worn(condition: Condition, depth: float) -> WornProfile:
    """A profile about this deep [m], as wear makes it; the unworn one for depth 0."""
    return wear_path(condition, depth)[-1].profile if depth else model().unworn


def contacts(profile: WornProfile, condition: Condition, samples: int) -> Contacts:
    return model(samples).mesh.contacts(profile, condition.speed_hz, damping_time=PRIOR.damping_time)


def steady(contacts: Contacts, condition: Condition) -> SteadyState:
    twin = model()
    return solve_through_contact_loss(twin.structure, contacts, twin.mean_force(condition)).require_converged()


def torques(condition: Condition) -> np.ndarray:
    """Constant torques at motor and brake in balance; (21,)."""
    z1, z2 = RIG.teeth
    return direction({"th1": condition.torque, "th13": -condition.torque * z2 / z1})


def lines_of_last(motion: Motion, steps: int, count: int) -> np.ndarray:
    """Complex amplitudes of the acceleration's harmonics 1 … count over the last `steps` steps."""
    return 2 * np.fft.rfft(motion.acceleration[-steps - 1 : -1, 0])[1 : count + 1] / steps


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest deviation of any line, of the largest line."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())
