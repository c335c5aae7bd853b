"""What can go wrong in a simulation.

SimulationError
└── SpecError   a spec that cannot be simulated: name, value, unit, allowed range
"""


class SimulationError(Exception):
    """A campaign that could not be simulated to its end."""


class SpecError(SimulationError):
    """A spec (or its rig) that no campaign can be made of."""
