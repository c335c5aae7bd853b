"""A machine's own rig file and mapping from a few answers, and what a machine can tell with the sensors that it has."""
