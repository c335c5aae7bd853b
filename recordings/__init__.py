"""Recorded campaigns, the rigs they were made on, and the generator that makes them."""

from __future__ import annotations


def simulate_file(spec_path, out_path, truth_path=None, progress=None):
    """Simulates the campaign of a spec file into a recording; see `recordings.generator.simulate_file`.

    The generator, with its compiled solver, is loaded only when it is called for.
    """
    from recordings.generator import simulate_file as simulate

    return simulate(spec_path, out_path, truth_path, progress)
