"""Bridges to other networks of a plant: results and alarms out, slow values in. One file a network."""
