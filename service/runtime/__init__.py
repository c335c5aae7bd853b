"""The loop from frames to results, and what runs it: a server, a command, a replay, a demonstration."""

SERVES = "gear-twin serves"
"""How the line begins that a service prints once HTTP is served at the address that follows."""
