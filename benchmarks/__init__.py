"""Timed runs and evaluations: commands, not tests."""
