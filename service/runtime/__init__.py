"""The loop from frames to results, and the programs that run it."""
