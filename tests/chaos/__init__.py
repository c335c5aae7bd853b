"""Faults and attacks, drawn from seeds so that each can be repeated: `make chaos`, `python -m tests.chaos`."""
