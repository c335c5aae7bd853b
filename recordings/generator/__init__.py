"""Whole wear campaigns, simulated: an independent machine for the twin to be tried on.

    campaign = simulate(spec, rig)
    write(campaign, "campaign.mcap", "campaign.truth.json")

Another formulation than the twin's, which shares with it the rig file and nothing else: thin slices across
the face with hardening contact, exact corner contact and back flanks, one worn surface a tooth, time
integration, a structure that is off as machines are, and instruments with noise and errors.
"""

from recordings.generator.campaign import Campaign, simulate
from recordings.generator.deliver import simulate_file, write
from recordings.generator.errors import SimulationError, SpecError

EDITION = 1  # raised when a spec gives another recording than before; that of one effect: `Effect.edition`

__all__ = ["EDITION", "Campaign", "SimulationError", "SpecError", "simulate", "simulate_file", "write"]
